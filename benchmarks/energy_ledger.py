"""How far the energy ledger of whole simulations is open, in three regimes of a damper, at the default time step.

    python benchmarks/energy_ledger.py [--steps 40 80] [--cycles 10] [--out FILE]

150 steel spheres of 5 mm at full stiffness in an upright cylinder under a lid, with smoothed and with Mindlin's
friction: a bed that stays together (20 Hz, Gamma 0.5, across), one that bounces (25 Hz, Gamma 6, along gravity), and
one that the container strikes from both ends (400 Hz, Gamma 40). The closure is work less losses less gain of stored
energy over all losses, from the second cycle on; nothing in the engine is inferred from the balance, so that it is the
error of the steps."""

import argparse
import platform
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

from graindamp.dem.simulate import simulate
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec
from start_up import processor

REGIMES = {"solid-like": (20.0, 0.5, "x"), "bouncing": (25.0, 6.0, "z"), "decoupled": (400.0, 40.0, "z")}
"""Frequency [Hz], intensity [-] and direction."""


def spec_of(regime: str, tangential: str, steps: int, cycles: int) -> SimulationSpec:
    """One run."""
    frequency, intensity, direction = REGIMES[regime]
    return parse_spec(
        {
            "damper": {
                "particles": [{"material": "steel-s235", "radius": 2.5e-3}],
                "fill": {"count": 150},
                "container": {
                    "kind": "cylinder",
                    "radius": 12.5e-3,
                    "length": 60e-3,
                    "axis": "z",
                    "material": "aluminium-6060",
                },
                "lid": {"kind": "rigid", "clearance": 3e-3},
                "contact": {"restitution": 0.7, "friction": 0.3, "tangential": tangential},
                "packing": {"direction": "-z", "tap": {"max_cycles": 20}},
            },
            "motion": {"kind": "harmonic", "frequency": frequency, "intensity": intensity, "direction": direction},
            "run": {"cycles": cycles, "steps_per_contact": steps},
        },
        SimulationSpec,
        where="benchmark",
    )


def measure(regime: str, tangential: str, steps: int, cycles: int) -> dict[str, Any]:
    """Closure of one run."""
    run = simulate(spec_of(regime, tangential, steps, cycles))
    frequency = REGIMES[regime][0]
    begin = next(k for k, now in enumerate(run.energy_time) if now >= 1.0 / frequency * (1 - 1e-9))
    first, last = run.energy[begin], run.energy[-1]
    lost = last.lost - first.lost
    return {
        "regime": regime,
        "tangential": tangential,
        "steps": steps,
        "steps_met": run.steps_per_contact,
        "lost": lost,
        "closure": (last.work - first.work - lost - last.stored + first.stored) / lost,
        "seconds": run.seconds,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, nargs="+", default=[40, 80], help="steps per shortest expected contact")
    parser.add_argument("--cycles", type=int, default=10, help="cycles of every run; the first is left out")
    parser.add_argument("--out", type=Path, help="write the table to this file")
    arguments = parser.parse_args()
    lines = [
        "| regime | friction | steps per contact | in the fastest impact met | lost [J] | closure [%] | time [s] |",
        "| --- | --- | --: | --: | --: | --: | --: |",
    ]
    print("\n".join(lines))
    for regime in REGIMES:
        for tangential in ("tanh", "mindlin"):
            for steps in arguments.steps:
                r = measure(regime, tangential, steps, arguments.cycles)
                lines.append(
                    f"| {regime} | {tangential} | {steps} | {r['steps_met']:.0f} | {r['lost']:.3g} "
                    f"| {100.0 * r['closure']:.3f} | {r['seconds']:.1f} |"
                )
                print(lines[-1], flush=True)
    if arguments.out is not None:
        about = f"{date.today().isoformat()}, {processor()}, one core, python {platform.python_version()}"
        about += f", numba {version('numba')}, {arguments.cycles} cycles."
        table = "\n".join(lines)
        arguments.out.write_text(f"# Closure of the energy ledger\n\n{about}\n\n{table}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
