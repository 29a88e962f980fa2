"""Beam, enclosure and dampers of Witt (2011), with the test matrix of each configuration.

Axes of the dampers: x is the direction of motion, y runs along the beam, gravity points to -z. What the thesis does not
state is assumed here, in one place: materials of the contacts, and where along the beam the three channels lie.
"""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np

from graindamp.couple.cases import Carried, Case, released
from graindamp.dem.packing import pack
from graindamp.dem.packing_store import Packing
from graindamp.impact.cantilever import CantileverMode, cantilever_modes
from graindamp.impact.system import Ball
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import DamperSpec, SimulationSpec
from graindamp.spec.structure import BeamSpec, MaterialSpec, RectangleSection
from graindamp.structure.modal import ModalModel

INTRINSIC = 0.003
"""Specific damping capacity of the beam with its empty enclosure Psi_0 [-]."""

ENCLOSURE_MASS = 0.10225
"""Mass of the empty enclosure without inserts [kg]."""

CHANNEL_WIDTH, CHANNEL_HEIGHT = 12.19e-3, 9.90e-3
"""Width and height of a channel of the inserts [m]."""

CHANNEL_PITCH = (39.80e-3 + CHANNEL_WIDTH) / 4.0
"""Distance of neighbouring channels along the beam [m]: three in 39.80 mm, with four walls of one thickness."""

CAVITY_HEIGHT, CAVITY_WIDTH = 35.31e-3, 24.38e-3
"""Height h_e and width w_e of the cavity of configuration 5 [m]."""

BALL, ROW_BALL, SHOT = 9.50e-3, 4.36e-3, 1.27e-3
"""Diameters of the steel balls of configurations 1 and 2 and of configuration 4, and of the lead shot [m]."""

BALL_MASS, ROW_BALL_MASS, SHOT_MASS = 3.52e-3, 12.43e-3 / 36, 0.01220e-3
"""Their masses [kg]."""

INSERT_MASS = {1.22e-3: 0.87e-3, 4.95e-3: 1.21e-3, 14.88e-3: 2.02e-3, 19.74e-3: 2.43e-3}
"""Mass of the insert [kg] that leaves a clearance d [m]."""

FRICTION = 0.3
"""Of every contact [-]; assumed."""

STEEL_RESTITUTION, LEAD_RESTITUTION = 0.6, 0.3
"""Of steel balls and of lead shot with everything [-]; assumed, ordinary values of the materials."""

POLYCARBONATE = {"name": "polycarbonate", "youngs_modulus": 2.3e9, "poisson_ratio": 0.37}
"""Floor, ceiling and side walls; the inserts' resin is taken as alike. Values assumed, ordinary ones."""

LENGTHS = (34.77e-3, 24.03e-3, 19.63e-3)
"""Lengths l_e of the cavity of configuration 5 [m]."""

BED_HEIGHTS = (4.41e-3, 7.98e-3, 11.84e-3, 16.89e-3)
"""Heights h_p of its beds as stated [m]."""

COUNTS = {
    34.77e-3: (1925, 3919, 5950, 7843),
    24.03e-3: (1243, 2611, 3949, 5510),
    19.63e-3: (1030, 1999, 3052, 4030),
}
"""Number of shot N for each length and height (Table 4.2) [-]."""

SINGLE_BALL = [(d, u) for d in INSERT_MASS for u in (2e-3, 4e-3, 6e-3, 8e-3)]
"""Clearance and initial displacement of the tests of configuration 1 [m]."""

ROW_CLEARANCES = (1.22e-3, 2.25e-3, 4.00e-3, 4.36e-3, 4.95e-3, 7.00e-3, 10.00e-3, 14.88e-3, 19.74e-3)
"""Clearances of configuration 4 [m]."""

LAYERS = [(length, k, u) for length in LENGTHS for k in range(4) for u in (1e-3, 2.5e-3, 5e-3)]
"""Length of the cavity [m], number of the bed's height and initial displacement [m] of runs 1 to 36."""

BEAM = BeamSpec(
    length=0.244,
    section=RectangleSection(width=19.16e-3, height=3.19e-3),
    material=MaterialSpec(youngs_modulus=207e9, density=7840.0, name="4140 steel"),
    ends=("clamped", "free"),
)


class Structure(NamedTuple):
    """The beam with its empty enclosure, as one mode."""

    model: ModalModel
    """Points "inner", "tip" and "outer": the three channels from the clamp outwards; only "tip" is measured."""
    mode: CantileverMode

    @property
    def mass(self) -> float:
        """Mass reduced to the tip M [kg]."""
        return self.mode.mass


def structure(insert_mass: float = 0.0) -> Structure:
    """Beam and empty enclosure, a point mass at the tip; beyond the tip the enclosure goes on along the tangent.

    Args:
        insert_mass: mass of the channels put into the enclosure [kg].
    """
    mode = cantilever_modes(BEAM, ENCLOSURE_MASS + insert_mass)[0]
    offset = np.array([-CHANNEL_PITCH, 0.0, CHANNEL_PITCH])
    slope = float(mode.slope(BEAM.length))
    shape = (1.0 + slope * offset)[:, None] / sqrt(mode.mass)
    ratio = INTRINSIC / (4.0 * pi)
    model = ModalModel(
        np.array([mode.omega]),
        np.array([2.0 * ratio * mode.omega]),
        shape,
        np.full((3, 1), slope / sqrt(mode.mass)),
        ("inner", "tip", "outer"),
    )
    return Structure(model, mode)


def ball(clearance: float, restitution: float, point: str = "tip") -> Ball:
    """The ball of configurations 1 and 2 for the event-driven solver, without floor; clearance [m]."""
    return Ball(BALL_MASS, clearance, restitution, point)


def box(
    size: tuple[float, float, float],
    diameter: float,
    mass: float,
    count: int,
    *,
    particle: str = "steel",
    restitution: float = STEEL_RESTITUTION,
    friction: float = FRICTION,
    softening: float = 1.0,
    tangential: str = "tanh",
    seed: int = 0,
) -> DamperSpec:
    """A box of polycarbonate with aluminium walls at both ends of its length.

    Args:
        size: length along the motion, width along the beam, height [m].
        diameter: of the particles [m].
        mass: of one particle [kg]; sets the density.
        count: particles [-].
        particle: "steel" or "lead".
        restitution: of every contact [-].
        friction: of every contact [-].
        softening: divisor of the stiffness of every contact [-].
        tangential: law of friction, "tanh" or "mindlin".
        seed: of the packing.
    """
    density = mass / (pi / 6.0 * diameter**3)
    damper = {
        "particles": [{"material": {"name": particle, "density": density}, "radius": diameter / 2.0}],
        "fill": {"count": count},
        "container": {
            "kind": "box",
            "size": list(size),
            "material": POLYCARBONATE,
            "walls": {"x-": {"material": "aluminium"}, "x+": {"material": "aluminium"}},
        },
        "contact": {
            "restitution": restitution,
            "friction": friction,
            "tangential": tangential,
            "softening": softening,
        },
        "packing": {"method": "pour", "tap": False, "seed": seed},
    }
    return parse_spec(
        {"damper": damper, "motion": {"kind": "rest"}, "run": {"duration": 1.0}}, SimulationSpec, ""
    ).damper


def placed(position: np.ndarray, diameter: float) -> Packing:
    """A bed whose centres [m] are given; (particle, 3)."""
    n = len(position)
    radius = np.full(n, diameter / 2.0)
    return Packing(np.ascontiguousarray(position), radius, np.zeros(n, np.int32), 0, 0, 0, 0.5, None, None, 0, 0)


def channel(clearance: float, displacement: float, *, seed: int = 0, **options: float) -> tuple[DamperSpec, Packing]:
    """A channel with one ball on its floor, at the wall that will push it: the one on the side of the displacement.

    Args:
        clearance: d [m].
        displacement: initial one U0 [m]; only its sign counts.
        seed: shifts the ball by up to 0.1 mm from the wall, and by up to 1 mm across; 0: not at all.
        options: of :func:`box`.
    """
    length = BALL + clearance
    damper = box((length, CHANNEL_WIDTH, CHANNEL_HEIGHT), BALL, BALL_MASS, 1, **options)  # type: ignore[arg-type]
    away, across = np.random.default_rng(seed).uniform([0.0, -1.0], [0.1e-3, 1.0]) * (seed > 0)
    x = BALL / 2.0 + away if displacement < 0.0 else length - BALL / 2.0 - away
    return damper, placed(np.array([[x, CHANNEL_WIDTH / 2.0 + 1e-3 * across, BALL / 2.0]]), BALL)


def rows(n_row: int, clearance: float, *, seed: int = 0, **options: float) -> tuple[DamperSpec, Packing]:
    """A layer of rows of nine balls on the floor, against the wall that will push them.

    Args:
        n_row: number of rows, 1 to 4.
        clearance: d, length of the cavity less that of the rows in line [m].
        seed: shifts every ball along its row within the width that is left.
        options: of :func:`box`.

    Raises:
        ValueError: the cavity would be longer than the enclosure allows, 35.15 mm.
    """
    length = n_row * ROW_BALL + clearance
    if length > 35.15e-3:
        raise ValueError(f"{n_row} rows and a clearance of {1e3 * clearance:g} mm need {1e3 * length:.2f} mm of 35.15")
    damper = box((length, 39.80e-3, 5.00e-3), ROW_BALL, ROW_BALL_MASS, 9 * n_row, **options)  # type: ignore[arg-type]
    rng = np.random.default_rng(seed)
    spare = 39.80e-3 - 9 * ROW_BALL
    x = length - ROW_BALL * (np.arange(n_row)[:, None] + 0.5) + np.zeros((n_row, 9))
    y = ROW_BALL * (np.arange(9) + 0.5) + spare * np.sort(rng.random((n_row, 9)), axis=1)
    return damper, placed(np.stack([x, y, np.full_like(x, ROW_BALL / 2.0)], axis=-1).reshape(-1, 3), ROW_BALL)


def layers(length: float, height: int, *, seed: int = 0, softening: float = 1.0, **options: float) -> DamperSpec:
    """The cavity of configuration 5 with lead shot, poured.

    Args:
        length: l_e [m], one of :data:`LENGTHS`.
        height: number of the height of the bed, 0 to 3, see :data:`BED_HEIGHTS`.
        seed: of the bed.
        softening: divisor of the stiffness [-].
        options: of :func:`box`.
    """
    size, count = (length, CAVITY_WIDTH, CAVITY_HEIGHT), COUNTS[length][height]
    options = {"restitution": LEAD_RESTITUTION, **options}
    return box(
        size, SHOT, SHOT_MASS, count, particle="lead", softening=softening, tangential="mindlin", seed=seed, **options
    )


def poured(damper: DamperSpec) -> Packing:
    """The bed of a damper, packed under contacts of softening 100 whatever its own: beds of all stiffnesses alike."""
    told = damper.model_dump(exclude_unset=True)
    told["contact"]["softening"] = 100.0
    return pack(DamperSpec.model_validate(told))


def mounted(damper: DamperSpec, packing: Packing, turning: bool, point: str = "tip") -> Carried:
    """A cavity at a point of the beam, its middle on the beam's axis; `turning` with the slope there, or not."""
    if not turning:
        return Carried(damper, point, packing=packing)
    size = damper.container.size  # type: ignore[union-attr]
    x, y, z = (0.5 * side for side in size)
    return Carried(damper, point, along=(0.0, 1.0, 0.0), pivot=(x, y, z), packing=packing)


def decay_case(
    whole: Structure, carried: tuple[Carried, ...], displacement: float, duration: float, rate: float
) -> Case:
    """The beam let go from a displacement of its tip [m], followed for a time [s] at samples per second [Hz]."""
    start = released(whole.model, "tip", displacement, mode=0)
    return Case(whole.model, carried, duration, q=start, sample_rate=rate)
