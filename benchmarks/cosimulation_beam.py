"""A damper on a beam: its field of aged beds against slow sweeps with the particles in the loop; and how a bed ages.

    python benchmarks/cosimulation_beam.py [--keep FOLDER] [--out FILE.md]

The damper of examples/small-damper-field.toml, 500 spheres, sits near the tip of a steel cantilever, and a harmonic
force halfway along sweeps slowly through the first mode. Three beds are swept, and the same three are shaken at one
frequency and three intensities about the resonance, which makes a small field; graindamp's coupling solves the beam
with it. The second part follows the loss factor of a shaken bed over its cycles, and compares with sweeps of an
oscillator. Runs are kept in FOLDER and not repeated; some 15 minutes on one core.
"""

import argparse
import math
import platform
from collections.abc import Sequence
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.campaign.point import task_of
from graindamp.couple.balance import Attached
from graindamp.couple.cosimulate import Carried, Case, SweptForce, cosimulate
from graindamp.couple.equilibrium import Equilibrium, solve_mode
from graindamp.couple.single_mode import load_mode
from graindamp.dem.simulate import simulate
from graindamp.field.interpolate import Interpolant
from graindamp.field.schema import make_field
from graindamp.impact.system import oscillator
from graindamp.signals.simulated import cycle_values
from graindamp.spec.field import FieldSpec
from graindamp.spec.model import load_spec
from graindamp.spec.simulation import DamperSpec
from graindamp.spec.structure import BeamSpec, MaterialSpec, ModalDampingSpec, PointMassSpec, RectangleSection
from graindamp.structure.modal import ModalModel, beam_modal_model, point_index
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]

DAMPER = Path(__file__).parent.parent / "examples" / "small-damper-field.toml"
BEDS = 3
"""Seeds of beds, each swept and shaken."""
WINDOWS = 60
"""Parts of a sweep, over each of which an amplitude is taken."""
NEAR = 0.4
"""Phase between force and velocity [rad] up to which windows count as near the resonance: amplitudes above 0.92 of the
largest where the mode is linear."""
RATIO = 0.001
"""Damping ratio of beam and oscillator without bed [-]."""
BEAM = BeamSpec(
    length=0.25,
    section=RectangleSection(width=20e-3, height=25e-3),
    material=MaterialSpec(youngs_modulus=207e9, density=7840.0),
    ends=("clamped", "free"),
    damping=ModalDampingSpec(ratio=RATIO),
    n_mode=2,
)
PLACES = {"damper": 0.23, "force": 0.125}
"""Of the damper and of the force along the beam [m]."""
CONTAINER = 0.1
"""Mass of the empty container [kg]."""
FORCE, CENTRE, HALF, DURATION = 0.5, 285.0, 20.0, 2.0
"""Sweep of the beam: amplitude [N], middle and half range [Hz], duration [s]."""
INTENSITIES = (0.9, 1.2, 1.6)
"""At which the beds of the small field are shaken, at CENTRE [-]."""
CYCLES, YOUNG = 150, 75
"""Cycles of a shaken bed, and those left out [-]."""
AGE = (250.0, 0.3, 249.9, 2.036)
"""Oscillator of cosimulation.py [Hz] and force [N]; frequency [Hz] and intensity [-] of the beds shaken alike."""
AGE_SWEEP = (250.09, 8.5, 2.0)
"""Middle and half range [Hz], duration [s] of its sweep."""


class Resonance(NamedTuple):
    """Where force and modal velocity are in phase, the definition that a field's equilibrium has, too."""

    frequency: float
    """[Hz]"""
    damping_ratio: float
    """[-]"""
    speed: float
    """Amplitude of the modal velocity [m kg^1/2/s]."""


def beam_model() -> ModalModel:
    """Two modes of the beam with the empty container."""
    return beam_modal_model(BEAM, PLACES, [PointMassSpec(name="box", position=PLACES["damper"], mass=CONTAINER)])


def bed(seed: int) -> DamperSpec:
    """The damper with another bed."""
    damper = load_spec(DAMPER, FieldSpec).damper
    return damper.model_copy(update={"packing": damper.packing.model_copy(update={"seed": seed})})


def swept(model: ModalModel, at: str, drive: SweptForce, seed: int, turning: bool, keep: Path) -> tuple[Real, Real]:
    """Times [s] and velocity of the first mode [m kg^1/2/s] in a sweep with the damper at a point."""
    path = keep / f"swept-{drive.start:g}-{drive.stop:g}-{drive.amplitude:g}-{seed}{'-turning' * turning}.npz"
    if not path.exists():
        # The container stands on the beam with the base of its cylinder, the origin of its axes.
        along = (0.0, 1.0, 0.0) if turning else None
        carried = Carried(bed(seed), at, along=along)
        case = Case(
            model, (carried,), drive.duration, forces=(drive,), sample_rate=40.0 * drive.stop, steps_per_contact=30
        )
        run = cosimulate(case)
        print(f"{path.name}: {run.seconds:.0f} s, energy open {np.abs(run.residual).max():.1e}", flush=True)
        np.savez(path, time=run.time, speed=run.v[:, 0])
    kept = np.load(path)
    return kept["time"], kept["speed"]


def resonance(time: Real, speed: Real, omega: float, push: float, drive: SweptForce) -> Resonance:
    """Resonance of a mode from a sweep.

    With the envelope V of its velocity, the modal force P and the loaded modal mass m = (omega_k / Omega)^2, slow
    changes included, P - 2 m V' = (2 zeta Omega m + i x) V, x zero at the resonance. Both parts are straight lines over
    the windows near it.

    Args:
        time: [s].
        speed: modal velocity [m kg^1/2/s].
        omega: eigenfrequency without bed [rad/s].
        push: modal force amplitude P [N kg^-1/2].
        drive: the sweep.
    """
    rate = (drive.stop - drive.start) / drive.duration
    turned = 2.0 * speed * np.exp(-2j * math.pi * (drive.start + 0.5 * rate * time) * time)
    n = round(drive.duration / WINDOWS / (time[1] - time[0]))
    count = len(time) // n
    envelope = turned[: n * count].reshape(count, n).mean(axis=1)
    middle = time[: n * count].reshape(count, n).mean(axis=1)
    frequency = drive.start + rate * middle
    mass = (omega / (2.0 * math.pi * frequency)) ** 2
    # The force is a sine, whose phasor is -i P.
    resisting = (-1j * push - 2.0 * mass * np.gradient(envelope, middle)) / envelope
    is_far = np.abs(np.angle(resisting)) >= NEAR
    largest = int(np.argmax(np.where(is_far, 0.0, np.abs(envelope))))
    edges = np.flatnonzero(np.concatenate([[True], is_far, [True]]))
    after = int(np.searchsorted(edges, largest + 1))
    near = slice(int(edges[after - 1]), int(edges[after]) - 1)
    line = np.polyfit(frequency[near] - frequency[largest], resisting[near].imag, 1)
    place = float(frequency[largest] - line[1] / line[0])
    loss = np.polyval(np.polyfit(frequency[near] - place, resisting[near].real, 1), 0.0)
    turn = 2.0 * math.pi * place
    ratio = float(loss) * turn / (2.0 * omega**2)
    return Resonance(place, float(ratio), push / float(loss))


def shaken(frequency: float, intensity: float, seed: int, cycles: int, keep: Path) -> tuple[Real, Real, float]:
    """Loss factor and effective mass ratio of every cycle of a shaken bed [-], and its mass [kg]."""
    path = keep / f"shaken-{frequency:g}-{intensity:g}-{seed}-{cycles}.npz"
    if not path.exists():
        one = task_of(load_spec(DAMPER, FieldSpec), frequency, intensity, seed).simulation
        run = simulate(one.model_copy(update={"run": one.run.model_copy(update={"cycles": float(cycles)})}))
        values = cycle_values(run)
        np.savez(path, eta=values.loss_factor, m=values.effective_mass_ratio, bed=run.bed_mass)
        print(path.name, flush=True)
    kept = np.load(path)
    return kept["eta"], kept["m"], float(kept["bed"])


def spread(values: Sequence[float] | Real) -> tuple[float, float]:
    """Mean, and its standard error from the spread of beds; NaN of one."""
    found = np.asarray(values, float)
    if len(found) == 1:
        return float(found[0]), math.nan
    return float(found.mean()), float(found.std(ddof=1)) / math.sqrt(len(found))


def solved(model: ModalModel, seeds: Sequence[int], first: int, last: int, keep: Path) -> Equilibrium:
    """Resonance of the beam's first mode by the field of some beds, averaged over some of their cycles."""
    rows = []
    for intensity in INTENSITIES:
        runs = [shaken(CENTRE, intensity, seed, CYCLES, keep) for seed in seeds]
        losses = [float(one[first:last].mean()) for one, _, _ in runs]
        inertias = [float(one[first:last].mean()) for _, one, _ in runs]
        rows.append((*spread(losses), *spread(inertias), runs[0][2]))
    eta, eta_se, ratio, ratio_se, mass = np.array(rows).T
    # Over the range of the sweep the values are taken as constant in frequency.
    errors = {"loss_factor_se": np.tile(eta_se, (2, 1)), "effective_mass_ratio_se": np.tile(ratio_se, (2, 1))}
    values = np.tile(eta, (2, 1)), np.tile(ratio, (2, 1))
    ends = [CENTRE - HALF, CENTRE + HALF]
    field = make_field(ends, INTENSITIES, *values, mass[0], source="shaken beds", variables=errors)
    damper = Attached("damper", "damper", Interpolant(field), mass[0])
    states = solve_mode(load_mode(model, 0, "force", FORCE, [damper]), 1).stable
    assert len(states) == 1
    return states[0]


def told(values: Sequence[float], error: float, digits: int) -> str:
    """Mean of values in words, with the error that a field tells or, NaN, with that of their spread."""
    mean, own = spread(values)
    shown = own if math.isnan(error) else error
    return f"{mean:.{digits}f}" + ("" if math.isnan(shown) else f" ± {shown:.{digits}f}")


def beam(keep: Path) -> list[str]:
    """Table of the beam."""
    model = beam_model()
    shape = model.shape[:, 0]
    here, pushed = abs(shape[point_index(model, "damper")]), abs(shape[point_index(model, "force")])
    drive = SweptForce("force", FORCE, CENTRE - HALF, CENTRE + HALF, DURATION, soft_start=0.05)
    bare = model.omega / (2.0 * math.pi)
    lines = [
        f"Without bed: {bare[0]:.2f} Hz and {bare[1]:.0f} Hz, ζ = {100 * RATIO:g} %.",
        "",
        "| bed | f field [Hz] | f together [Hz] | ζ field [%] | ζ together [%] | Γ field | Γ together |",
        "| --- | --: | --: | --: | --: | --: | --: |",
    ]

    def together(seed: int, turning: bool = False) -> tuple[float, float, float]:
        time, speed = swept(model, "damper", drive, seed, turning, keep)
        one = resonance(time, speed, model.omega[0], FORCE * pushed, drive)
        level = 2.0 * math.pi * one.frequency * one.speed * here / STANDARD_GRAVITY
        return one.frequency, 100.0 * one.damping_ratio, level

    everyone = [*([seed] for seed in range(BEDS)), list(range(BEDS))]
    for seeds in everyone:
        state = solved(model, seeds, YOUNG, CYCLES, keep)
        field = (
            (state.frequency, state.frequency_se),
            (100.0 * state.damping_ratio, 100.0 * state.damping_ratio_se),
            (float(state.intensity[0]), float(state.intensity_se[0])),
        )
        found = list(zip(*(together(seed) for seed in seeds), strict=True))
        cells = [
            f"{told([field[k][0]], field[k][1], digits)} | {told(found[k], math.nan, digits)}"
            for k, digits in enumerate((2, 3, 3))
        ]
        lines.append(f"| {seeds[0] + 1 if len(seeds) == 1 else 'all'} | {' | '.join(cells)} |")
    young = solved(model, range(BEDS), 10, 40, keep)
    turned, plain = together(0, turning=True), together(0)
    lines += [
        "",
        f"With the field of cycles 10 to 40 in place of {YOUNG} to {CYCLES}: {young.frequency:.2f} ± "
        f"{young.frequency_se:.2f} Hz, ζ = {100 * young.damping_ratio:.3f} ± {100 * young.damping_ratio_se:.3f} %.",
        f"Bed 1 in a container that turns with the slope of the beam as well: {turned[0]:.2f} Hz, ζ = {turned[1]:.3f} "
        f"%; along a line: {plain[0]:.2f} Hz, {plain[1]:.3f} %.",
    ]
    return lines


def ageing(keep: Path) -> list[str]:
    """Tables of a bed over its cycles."""
    own, force, frequency, intensity = AGE
    lines = [
        "| cycles | " + " | ".join(f"η of bed {seed + 1}" for seed in range(BEDS)) + " | mean | ζ [%] |",
        "| --- |" + " --: |" * (BEDS + 2),
    ]
    runs = [shaken(frequency, intensity, seed, 200, keep) for seed in range(BEDS)]
    mass, structure = runs[0][2], 0.5
    for first, last in ((0, 20), (20, 40), (40, 80), (80, 120), (120, 160), (160, 200), (10, 60), (100, 200)):
        eta = [float(run[0][first:last].mean()) for run in runs]
        ratio = [float(run[1][first:last].mean()) for run in runs]
        zeta = [RATIO + 0.5 * e * mass / (structure + m * mass) for e, m in zip(eta, ratio, strict=True)]
        lines.append(
            f"| {first} to {last} | {' | '.join(f'{value:.3f}' for value in eta)} "
            f"| {spread(eta)[0]:.3f} ± {spread(eta)[1]:.3f} "
            f"| {100 * spread(zeta)[0]:.3f} ± {100 * spread(zeta)[1]:.3f} |"
        )
    model = oscillator(structure, own, RATIO)
    centre, half, duration = AGE_SWEEP
    drive = SweptForce("mass", force, centre - half, centre + half, duration, soft_start=0.2)
    found = [
        resonance(
            *swept(model, "mass", drive, seed, False, keep), model.omega[0], force * float(model.shape[0, 0]), drive
        )
        for seed in range(BEDS)
    ]
    level = [2 * math.pi * one.frequency * one.speed * model.shape[0, 0] / STANDARD_GRAVITY for one in found]
    lines += ["", "| swept | f [Hz] | ζ [%] | Γ |", "| --- | --: | --: | --: |"]
    for seed, one in enumerate(found):
        lines.append(f"| bed {seed + 1} | {one.frequency:.2f} | {100 * one.damping_ratio:.3f} | {level[seed]:.3f} |")
    means = [
        told([one.frequency for one in found], math.nan, 2),
        told([100 * one.damping_ratio for one in found], math.nan, 3),
        told([float(value) for value in level], math.nan, 3),
    ]
    lines.append(f"| mean | {' | '.join(means)} |")
    return lines


READ_BEAM = f"""A steel cantilever of 250 x 20 x 25 mm carries the damper in a container of {CONTAINER} kg at 230 mm; a
force of {FORCE} N at 125 mm sweeps from {CENTRE - HALF:g} to {CENTRE + HALF:g} Hz in {DURATION:g} s; two modes.
"Field": the beds shaken at {CENTRE:g} Hz and Γ = {", ".join(f"{value:g}" for value in INTENSITIES)}, cycles {YOUNG} to
{CYCLES}, and the resonance that graindamp's coupling solves with it. "Together": where force and modal
velocity are in phase. ± from the spread of beds. Beds keep their character: one with a higher loss factor
when shaken damps more in the sweep as well."""

READ_AGE = f"""Loss factor of beds shaken from rest at {AGE[2]:g} Hz and Γ = {AGE[3]:g}, and sweeps of the same beds on
an oscillator of 0.5 kg and {AGE[0]:g} Hz under {AGE[1]:g} N. η grows for a hundred cycles and more, in all beds,
so that the spread of young beds does not tell of it. A sweep has shaken its bed for more than 200 cycles when
it reaches the resonance. At the Γ where the sweeps have it, η of beds of cycles 100 to 200, falling as 1/Γ, gives
ζ = 1.54 ± 0.03 %."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, default=Path("cosimulation-runs"))
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "cosimulation_beam.md")
    given = parser.parse_args()
    given.keep.mkdir(parents=True, exist_ok=True)
    lines = [
        "# A damper on a beam, and how a bed ages",
        "",
        f"date {date.today()}, {platform.machine()}, Python {platform.python_version()}, numba {version('numba')}; "
        f"damper examples/{DAMPER.name}.",
        "",
        "## Field against slow sweep on a beam",
        "",
        READ_BEAM,
        "",
        *beam(given.keep),
        "",
        "## A bed over its cycles",
        "",
        READ_AGE,
        "",
        *ageing(given.keep),
        "",
    ]
    given.out.write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
