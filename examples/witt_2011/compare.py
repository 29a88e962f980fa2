"""One co-simulated decay against the event-driven solver, cycle by cycle: a ball without floor, friction and gravity.

    python compare.py

Prints both damping capacities and how far they lie apart.
"""

import numpy as np
import witt_dampers
from decays import RATE

from graindamp.couple.cosimulate import Carried, cosimulate
from graindamp.impact.decay import damping_per_cycle, free_decay
from graindamp.impact.system import on_structure
from graindamp.signals.decay import analyze_decay, mass_normalised
from graindamp.signals.decay_record import DecayRecord

CLEARANCE, DISPLACEMENT, RESTITUTION = 14.88e-3, 8e-3, 0.3
"""Clearance d and initial displacement U0 [m], restitution of the ball with its end walls [-]."""


def both(duration: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    """U [m] and Psi_m [-] of the cycles of the event-driven and of the co-simulated decay; shape (2, cycle) each."""
    whole = witt_dampers.structure(witt_dampers.INSERT_MASS[CLEARANCE])
    damper, bed = witt_dampers.channel(CLEARANCE, DISPLACEMENT, restitution=RESTITUTION, friction=0.0)
    damper = damper.model_copy(update={"gravity": (0.0, 0.0, 0.0)})
    case = witt_dampers.decay_case(whole, (Carried(damper, "tip", packing=bed),), DISPLACEMENT, duration, 10.0 * RATE)
    run = cosimulate(case)
    assert np.abs(run.residual).max() < 1e-3
    cycles = analyze_decay(DecayRecord(run.velocity("tip"), "velocity", 10.0 * RATE)).cycles
    system = on_structure(whole.model, [witt_dampers.ball(CLEARANCE, RESTITUTION)])
    events = free_decay(system, DISPLACEMENT, cycles_max=duration * whole.mode.frequency, sample_rate=10.0 * RATE)
    exact = analyze_decay(DecayRecord(events.v @ whole.model.shape[1], "velocity", 10.0 * RATE)).cycles
    n = min(len(cycles.psi), len(exact.psi), len(damping_per_cycle(system, events).amplitude))
    ratio = witt_dampers.BALL_MASS / whole.mass
    displacement = np.array([exact.displacement[:n], cycles.displacement[:n]])
    damping = [mass_normalised(one.psi[:n] - witt_dampers.INTRINSIC, ratio) for one in (exact, cycles)]
    return displacement, np.array(damping)


def main() -> None:
    displacement, damping = both()
    for k in range(displacement.shape[1]):
        print(
            f"cycle {k / 2:4.1f}: U {1e3 * displacement[0, k]:.4f} and {1e3 * displacement[1, k]:.4f} mm, Psi_m "
            f"{damping[0, k]:.3f} and {damping[1, k]:.3f}"
        )
    apart = np.abs(displacement[1] / displacement[0] - 1.0)
    print(f"amplitudes apart by at most {apart.max():.1e}, damping by {np.abs(damping[1] - damping[0]).max():.3f}")


if __name__ == "__main__":
    main()
