"""How many particle-steps per second the engine does on one core, and how many LAMMPS does on the same bed.

    python benchmarks/particle_steps_per_second.py [--sizes 150 500 4500 50000] [--with-lammps] [--repeat 5] [--json]
    [--out FILE]

The shaken cylinder of Meyer & Seifried (2023): steel spheres of 1.25 mm radius in an aluminium cylinder across
gravity, pi mm of clearance, 100 Hz, Gamma 40, full stiffness, steps of 0.2 us, Hertz contact with Gonthier damping,
restitution that depends on speed, smoothed friction, energy ledger. Other sizes scale the cylinder. A bed is packed,
shaken for some cycles with softened and one with full stiffness, and kept at eight phases of that cycle: speed
depends on the phase, few contacts in flight and many at impact, so that only the mean over a cycle says anything.
From each phase all codes do the same number of steps in turn. What counts is processor time, which other work on the
machine disturbs less, the best of the repeats at each phase for every code alike. Two worlds on two cores are timed by
the clock on the wall, at all phases too, both worlds at one phase. The answers are checked as well: the energy ledger
closes, and the kinetic energy of the bed after some steps agrees with LAMMPS' `granular`.

50 000 spheres take longer than all others: their bed is grown, not poured, and shaken for two softened cycles."""

import argparse
import json
import math
import platform
import sys
import tempfile
import time
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import lammps_rate
from graindamp.dem.container import Enclosure, enclosure_of
from graindamp.dem.energy import energies, velocity_now
from graindamp.dem.engine import run, start, together
from graindamp.dem.excitation import motion_of
from graindamp.dem.interactions import Interactions, interactions_of
from graindamp.dem.packing import pack
from graindamp.dem.state import Worlds
from graindamp.dem.world import Bed, world_of
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import DamperSpec, SimulationSpec
from start_up import processor

RADIUS, DENSITY = 1.25e-3, 7900.0
FREQUENCY, INTENSITY, TIME_STEP = 100.0, 40.0, 2e-7
PHASES = 8
SOFT = 100.0
CLOSURE = 3e-3
"""Largest error of the energy ledger over what was dissipated [-]; second order in the step, 38 steps per contact."""
SAME_ENERGY = 0.1
"""Largest difference of the bed's kinetic energy from LAMMPS after COMPARED steps [-]; the damping laws differ
slightly."""
LARGE = 20_000
"""Spheres from which a bed is grown instead of poured and tapped, and shaken for one cycle less at full stiffness; it
would take an hour otherwise."""
LARGE_SOFT_CYCLES = 2
"""Softened cycles of such a bed at most [-]."""
FEWEST_STEPS = 400
"""Steps of one repeat at least [-]: lists are renewed every 290 or so, and a repeat without one would flatter."""
TAP = {"frequency": 60.0, "intensity": 4.0, "max_cycles": 20}
COMPARED = 1000
"""Steps after which energies are compared [-]: collisions magnify every difference, and after 0.2 ms the beds are
still the same."""


class State(NamedTuple):
    """A bed at one phase."""

    bed: Bed
    time: float
    """Since the phase of the motion was zero [s]."""


def spec_of(n: int, softening: float = 1.0) -> SimulationSpec:
    """The damper with `n` spheres; its cylinder keeps its proportions."""
    scale = (n / 4500.0) ** (1.0 / 3.0)
    return parse_spec(
        {
            "damper": {
                "particles": [{"material": "steel-s235", "radius": RADIUS}],
                "fill": {"count": n},
                "container": {
                    "kind": "cylinder",
                    "radius": 0.02 * scale,
                    "length": 0.075 * scale + 0.01,
                    "material": "aluminium-6060",
                },
                "lid": {"kind": "rigid", "clearance": math.pi * 1e-3},
                "contact": {
                    "restitution": {"plateau": 0.63, "reference_speed": 0.03, "exponent": 1.0},
                    "friction": 0.1,
                    "softening": softening,
                    "pairs": [
                        {
                            "between": ["steel-s235", "aluminium-6060"],
                            "restitution": {"plateau": 0.54, "reference_speed": 0.03, "exponent": 1.0},
                        }
                    ],
                },
                "packing": {"method": "grow", "tap": False} if n > LARGE else {"tap": TAP},
            },
            "motion": {"kind": "harmonic", "frequency": FREQUENCY, "intensity": INTENSITY, "direction": "x"},
        },
        SimulationSpec,
        where="benchmark",
    )


def world_at(
    state: State, damper: DamperSpec, enclosure: Enclosure, interactions: Interactions, time_step: float, n_step: int
) -> Worlds:
    """A world that goes on from a state."""
    motion = motion_of(spec_of(len(state.bed.radius)).motion, start=-state.time)
    worlds = world_of(
        state.bed,
        enclosure,
        interactions,
        damper.gravity,
        time_step,
        motion,
        n_sample=n_step // 250 + 2,
        stride=250,
        n_cycle=2,
        skin=0.05 * RADIUS,
    )
    return start(worlds)


def state_of(worlds: Worlds, time_now: float) -> State:
    """The bed as it is now."""
    velocity, spin = velocity_now(worlds)
    return State(
        Bed(
            worlds.particles.position[0, :, :3].copy(),
            worlds.particles.position[0, :, 3].copy(),
            worlds.particles.material[0].copy(),
            velocity,
            spin,
        ),
        time_now,
    )


def bed_path(n: int, soft_cycles: int, folder: Path) -> Path:
    """File of a prepared bed."""
    return folder / f"bed-{n}-{soft_cycles}.npz"


def prepared(n: int, soft_cycles: int, folder: Path) -> tuple[list[State], float, float]:
    """States of a bed at eight phases of a cycle, length and radius of its cylinder [m]; stored in `folder`."""
    soft_cycles = min(soft_cycles, LARGE_SOFT_CYCLES) if n > LARGE else soft_cycles
    path = bed_path(n, soft_cycles, folder)
    spec = spec_of(n)
    assert spec.damper.container.kind == "cylinder"
    if not path.exists():
        packing = pack(spec.damper, cache=folder)
        period = 1.0 / FREQUENCY
        interactions = interactions_of(spec_of(n, SOFT).damper)
        enclosure = enclosure_of(spec.damper, interactions, lid_height=packing.lid_height)
        material = np.asarray(interactions.component, np.int32)[packing.component]
        state = State(Bed.at_rest(packing.position, packing.radius, material), 0.0)
        step = TIME_STEP * SOFT**0.4
        for _ in range(soft_cycles):
            n_step = round(period / step)
            worlds = run(world_at(state, spec.damper, enclosure, interactions, period / n_step, 0), n_step)
            state = state_of(worlds, 0.0)
        interactions = interactions_of(spec.damper)
        # Overlaps of softened contacts hold too much energy at full stiffness: a few short bursts from rest let it out.
        at_rest = state.bed
        for _ in range(60):
            resting = State(Bed.at_rest(at_rest.position, at_rest.radius, at_rest.material), 0.0)
            at_rest = state_of(run(world_at(resting, spec.damper, enclosure, interactions, TIME_STEP, 0), 20), 0.0).bed
        state = State(at_rest._replace(velocity=state.bed.velocity, spin=state.bed.spin), 0.0)
        n_step = round(period / TIME_STEP / PHASES)
        states = []
        worlds = world_at(state, spec.damper, enclosure, interactions, TIME_STEP, 0)
        first = 0 if n > LARGE else PHASES
        for k in range(first + PHASES):
            worlds = run(worlds, n_step)
            if k >= first:
                states.append(state_of(worlds, (k + 1) * n_step * TIME_STEP % period))
        np.savez(
            path,
            position=np.array([s.bed.position for s in states]),
            velocity=np.array([s.bed.velocity for s in states]),
            spin=np.array([s.bed.spin for s in states]),
            time=np.array([s.time for s in states]),
            length=np.float64(packing.lid_height or 0.0),
        )
    with np.load(path) as file:
        radius, material = np.full(n, RADIUS), np.zeros(n, np.int32)
        states = [
            State(
                Bed(file["position"][k], radius, material, file["velocity"][k], file["spin"][k]), float(file["time"][k])
            )
            for k in range(PHASES)
        ]
        return states, float(file["length"]), spec.damper.container.radius


def measure(n: int, repeat: int, work: float, lammps: Path | None, soft_cycles: int, folder: Path) -> dict[str, Any]:
    """Rates of all codes on one bed [particle-steps/s], mean over a cycle; see the module's text."""
    states, length, cylinder = prepared(n, soft_cycles, folder)
    spec = spec_of(n)
    interactions = interactions_of(spec.damper)
    enclosure = enclosure_of(spec.damper, interactions, lid_height=length)
    n_step = max(int(work / n), FEWEST_STEPS)
    worlds = [world_at(s, spec.damper, enclosure, interactions, TIME_STEP, (repeat + 3) * n_step) for s in states]
    for k in range(PHASES):
        worlds[k] = run(worlds[k], 50)
    styles: tuple[lammps_rate.Style, ...] = ("gran/hertz/history", "granular") if lammps is not None else ()
    seconds: dict[str, list[list[float]]] = {name: [[] for _ in states] for name in ("graindamp", *styles)}
    open_by, all_lost, contacts, energy_gap = 0.0, 0.0, 0.0, 0.0
    for k, state in enumerate(states):
        before = energies(worlds[k])
        touching = int(worlds[k].clock.counts[0, 2])
        bed = folder / f"bed-{n}-{k}.data"
        if lammps is not None:
            shaking = lammps_rate.Shaking(phase=2.0 * math.pi * FREQUENCY * state.time)
            lammps_rate.write_bed(
                bed, state.bed.position, state.bed.velocity, state.bed.radius, length, cylinder, state.bed.spin, DENSITY
            )
        for _ in range(repeat):
            begin = time.process_time()
            worlds[k] = run(worlds[k], n_step)
            seconds["graindamp"][k].append(time.process_time() - begin)
            for style in styles:
                assert lammps is not None
                result = lammps_rate.rate(lammps, bed, style, n_step, TIME_STEP, shaking)
                seconds[style][k].append(result.processor_seconds)
        after = energies(worlds[k])
        lost = after.lost - before.lost
        open_by += after.stored - before.stored + lost - after.work + before.work
        all_lost += lost
        contacts += (int(worlds[k].clock.counts[0, 2]) - touching) / (repeat * n_step * n * PHASES)
        if lammps is not None and n <= 5000:
            compared = min(n_step, COMPARED)
            result = lammps_rate.rate(lammps, bed, "granular", compared, TIME_STEP, shaking)
            check = run(world_at(state, spec.damper, enclosure, interactions, TIME_STEP, compared), compared)
            velocity, _ = velocity_now(check)
            ours = float(np.sum(velocity**2 / check.particles.inverse_mass[0, :, :1])) / 2.0
            energy_gap = max(energy_gap, abs(ours / result.kinetic_energy - 1.0))
    closure = abs(open_by) / all_lost
    if closure > CLOSURE or energy_gap > SAME_ENERGY:
        sys.exit(
            f"wrong answer with {n} particles: ledger open by {closure:.1e}, energy off LAMMPS by {energy_gap:.1%}"
        )
    rates = {name: PHASES * n_step * n / sum(min(phase) for phase in phases) for name, phases in seconds.items()}
    middle = {name: PHASES * n_step * n / sum(np.median(p) for p in phases) for name, phases in seconds.items()}
    fastest = max((rates[name] for name in styles), default=math.nan)
    both = (
        PHASES
        * 2
        * n_step
        * n
        / sum(
            _pair_seconds(
                [world_at(state, spec.damper, enclosure, interactions, TIME_STEP, 0) for _ in range(2)], n_step, repeat
            )
            for state in states
        )
    )
    return {
        "n_particles": n,
        "particle_steps_per_second": rates["graindamp"],
        "particle_steps_per_second_median": middle["graindamp"],
        "two_worlds_two_cores": both,
        "lammps_gran_hertz_history": rates.get("gran/hertz/history"),
        "lammps_granular": rates.get("granular"),
        "ratio_to_lammps_fastest": rates["graindamp"] / fastest if styles else None,
        "ratio_to_lammps_granular": rates["graindamp"] / rates["granular"] if styles else None,
        "contacts_per_particle": contacts,
        "steps": n_step * PHASES * repeat,
        "ledger_error": closure,
        "kinetic_energy_off_lammps": energy_gap if styles else None,
        "bytes_per_particle": sum(a.nbytes for part in worlds[0][:3] + worlds[0][8:] for a in part) / n,
    }


def _pair_seconds(two: list[Worlds], n_step: int, repeat: int) -> float:
    """Time that two worlds take for `n_step` steps each on two cores, the best of the repeats [s]."""
    pair = run(together(two), 50, n_thread=2)
    seconds = []
    for _ in range(repeat):
        begin = time.perf_counter()
        pair = run(pair, n_step, n_thread=2)
        seconds.append(time.perf_counter() - begin)
    return min(seconds)


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as Markdown, in million particle-steps per second of processor time."""
    lines = [
        "| particles | graindamp | median | 2 worlds, 2 cores (wall) | gran/hertz/history | granular "
        "| ratio to fastest | ratio to granular | contacts per particle | bytes per particle |",
        "| --: | --: | --: | --: | --: | --: | --: | --: | --: | --: |",
    ]

    def number(value: float | None, digits: int = 1, unit: float = 1e6) -> str:
        return "-" if value is None else f"{value / unit:.{digits}f}"

    for r in rows:
        lines.append(
            f"| {r['n_particles']} | {number(r['particle_steps_per_second'])} "
            f"| {number(r['particle_steps_per_second_median'])} | {number(r['two_worlds_two_cores'])} "
            f"| {number(r['lammps_gran_hertz_history'])} | {number(r['lammps_granular'])} "
            f"| {number(r['ratio_to_lammps_fastest'], 2, 1.0)} | {number(r['ratio_to_lammps_granular'], 2, 1.0)} "
            f"| {r['contacts_per_particle']:.2f} | {r['bytes_per_particle']:.0f} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[150, 500, 4500, 50_000], help="numbers of particles")
    parser.add_argument("--repeat", type=int, default=5, help="repeats at every phase; the best counts")
    parser.add_argument("--work", type=float, default=4e6, help="particle-steps of one repeat")
    parser.add_argument("--soft-cycles", type=int, default=6, help="softened cycles before the bed is measured")
    parser.add_argument("--with-lammps", action="store_true", help="install LAMMPS beside and time it in turn")
    parser.add_argument("--folder", type=Path, help="where beds and LAMMPS are kept; default: a temporary folder")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--out", type=Path, help="write the table to this file")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        lammps = lammps_rate.environment(folder / "lammps") if arguments.with_lammps else None
        rows = []
        for n in arguments.sizes:
            rows.append(measure(n, arguments.repeat, arguments.work, lammps, arguments.soft_cycles, folder))
            if not arguments.json:
                print(table(rows[-1:]) if len(rows) == 1 else table(rows[-1:]).splitlines()[-1], flush=True)
        about = {
            "date": date.today().isoformat(),
            "machine": f"{processor()}, one core",
            "python": platform.python_version(),
            "numba": version("numba"),
            "numpy": version("numpy"),
            "lammps": None if lammps is None else lammps_rate.version(lammps),
        }
    if arguments.json:
        print(json.dumps({**about, "rows": rows}, indent=1))
    if arguments.out is not None:
        told = ", ".join(f"{key} {value}" for key, value in about.items() if value)
        text = f"# Particle-steps per second\n\n{told}\n\nMillion particle-steps per second.\n\n{table(rows)}\n"
        arguments.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
