"""From materials, walls and contact laws as described to the number tables that the engine reads.

Materials of particles and surfaces of walls share one numbering: first the particles' materials, then the surfaces. A
surface is a material together with the constants that a wall or coating overrides, so that two aluminium walls with
different friction are two surfaces, and steel walls are apart from steel particles. A contact of particle and wall
has R* = the particle's radius and m* = its mass.

Moduli mix as in Hertz (1882) and Mindlin (1949): 1/E* = sum (1 - nu^2)/E and 1/G* = sum (2 - nu)/G over both bodies,
with G = E / (2 (1 + nu)). Everything else is taken whole from the most specific description, never averaged: coating
or wall, else the pair of materials, else the damper's contact.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.columns import (
    FRICTION,
    N_COLUMN,
    N_NODE,
    ROLLING,
    RULE,
    SHEAR,
    SMOOTHING,
    SPEED_SCALE,
    STIFFNESS,
    TANGENTIAL_DASHPOT,
)
from graindamp.dem.laws import NormalLaw, TangentialLaw
from graindamp.dem.restitution import Curve, constant, loss_table, plateau, tabulated
from graindamp.errors import InputError
from graindamp.spec.contact import (
    ContactMaterialSpec,
    ContactOverride,
    ContactSpec,
    PlateauRestitution,
    RestitutionSpec,
    TableRestitution,
    canonical,
)
from graindamp.spec.simulation import DamperSpec

NORMAL_LAW = {
    "hertz-gonthier": NormalLaw.HERTZ_GONTHIER,
    "hertz-viscoelastic": NormalLaw.HERTZ_VISCOELASTIC,
    "linear": NormalLaw.LINEAR,
}
"""Code of a normal law by its name in a description."""

TANGENTIAL_LAW = {
    "none": TangentialLaw.NONE,
    "tanh": TangentialLaw.TANH,
    "mindlin": TangentialLaw.MINDLIN,
    "linear": TangentialLaw.LINEAR,
}
"""Code of a tangential law by its name in a description."""

SCALE_OF_CONSTANT = 1.0
"""Speed at the middle of the loss table where the restitution does not depend on speed [m/s]; any would do."""

YIELD_FACTOR = 5.5 / 4.0 * math.pi
"""Stiffness of a body over yield stress and radius, Wong & Rongong (2009), Eq. 10 [-]."""


class Interactions(NamedTuple):
    """Number tables of one damper's contacts. Rows and columns of walls among themselves are zero: walls never
    touch."""

    names: tuple[str, ...]
    """Materials of the particles, then surfaces of walls, inserts and what lies behind coatings."""
    n_particle_material: int
    """How many of the names belong to particles."""
    density: NDArray[np.float64]
    """Density of each [kg/m^3], 0 where it is not given, which only surfaces may leave out; (material,)."""
    pair: NDArray[np.float64]
    """Constants of a contact, columns as in :mod:`graindamp.dem.columns`; (material, material, N_COLUMN)."""
    loss: NDArray[np.float64]
    """Damping constants over onset speed; (material, material, N_NODE, 2)."""
    normal: NormalLaw
    """Normal law of all contacts but those with foam."""
    tangential: TangentialLaw
    """Tangential law of all contacts."""
    tension: bool
    """Whether viscous laws may attract."""
    rolling: bool
    """Whether some pair has rolling resistance."""
    component: tuple[int, ...]
    """Number of the material of each component of the bed, in the order of damper.particles."""
    wall: dict[str, int]
    """Number of the surface that particles touch on each wall of the container, by name; the coating's where there is
    one."""
    backing: dict[str, int]
    """Number of the surface of the stiff wall behind each coating, by name of the wall."""
    insert: tuple[int, ...]
    """Number of the surface of each insert, in the order of damper.inserts."""


class _Surface(NamedTuple):
    """A material and the overrides of one wall; equal ones share a number."""

    material: ContactMaterialSpec
    override: ContactOverride
    is_coating: bool = False
    """Coatings are soft on purpose, and are not softened further."""


def interactions_of(damper: DamperSpec) -> Interactions:
    """Numbering of materials and surfaces of a damper, and the constants of every contact between them.

    Raises:
        InputError: a yield stress that stiffness_rule needs is missing.
    """
    contact = damper.contact
    particles: list[ContactMaterialSpec] = []
    component = tuple(_number(particles, one.material) for one in damper.particles)
    n_particle = len(particles)

    surfaces: list[_Surface] = []
    places: list[list[str]] = []
    wall, backing = {}, {}
    for name in damper.container.wall_names:
        given = damper.container.walls.get(name)
        base = _Surface(damper.container.wall_material(name), _only_override(given))
        coating = None if given is None else given.coating
        if coating is None:
            wall[name] = n_particle + _place(surfaces, places, base, name)
        else:
            layer = _Surface(coating.layer, _only_override(coating), is_coating=True)
            wall[name] = n_particle + _place(surfaces, places, layer, f"coating of {name}")
            backing[name] = n_particle + _place(surfaces, places, base, f"behind coating of {name}")
    insert = tuple(
        n_particle + _place(surfaces, places, _Surface(one.material, ContactOverride()), one.name or f"insert {number}")
        for number, one in enumerate(damper.inserts, 1)
    )

    bodies = [_Surface(material, ContactOverride()) for material in particles] + surfaces
    n_material = len(bodies)
    pair = np.zeros((n_material, n_material, N_COLUMN))
    loss = np.zeros((n_material, n_material, N_NODE, 2))
    tables: dict[RestitutionSpec, NDArray[np.float64]] = {}
    for a in range(n_particle):
        for b in range(a, n_material):
            chosen = _Chosen(contact, bodies[a].material, bodies[b], is_wall=b >= n_particle)
            restitution = chosen.restitution
            curve, scale = restitution_curve(restitution)
            if restitution not in tables:
                tables[restitution] = loss_table(contact.law, curve, scale, contact.tension, N_NODE)
            pair[a, b], pair[b, a] = chosen.rows(scale)
            loss[a, b] = loss[b, a] = tables[restitution]

    names = [_label(material) for material in particles]
    names += [f"{_label(one.material)} ({', '.join(where)})" for one, where in zip(surfaces, places, strict=True)]
    return Interactions(
        names=tuple(names),
        n_particle_material=n_particle,
        density=np.array([body.material.density or 0.0 for body in bodies]),
        pair=pair,
        loss=loss,
        normal=NORMAL_LAW[contact.law],
        tangential=TANGENTIAL_LAW[contact.tangential],
        tension=contact.tension,
        rolling=bool(np.any(pair[:, :, ROLLING] > 0)),
        component=component,
        wall=wall,
        backing=backing,
        insert=insert,
    )


def restitution_curve(restitution: RestitutionSpec) -> tuple[Curve, float]:
    """Restitution as a function of impact speed, and the speed [m/s] about which it varies, for the middle of its
    table."""
    if isinstance(restitution, TableRestitution):
        scale = math.sqrt(restitution.speed[0] * restitution.speed[-1])
        return tabulated(restitution.speed, restitution.restitution), scale
    if isinstance(restitution, PlateauRestitution):
        curve = plateau(restitution.plateau, restitution.reference_speed, restitution.exponent)
        return curve, restitution.reference_speed
    return constant(restitution), SCALE_OF_CONSTANT


def reduced_youngs_modulus(a: ContactMaterialSpec, b: ContactMaterialSpec) -> float:
    """E* of two bodies in contact [Pa], 1/E* = sum (1 - nu^2)/E. Source: Hertz (1882), J. reine angew. Math. 92,
    156-171."""
    return 1.0 / sum((1.0 - one.poisson_ratio**2) / one.youngs_modulus for one in (a, b))


def reduced_shear_modulus(a: ContactMaterialSpec, b: ContactMaterialSpec) -> float:
    """G* of two bodies in contact [Pa], 1/G* = sum (2 - nu)/G. Source: Mindlin (1949), J. Appl. Mech. 16, 259-268."""
    return 1.0 / sum((2.0 - one.poisson_ratio) * 2.0 * (1.0 + one.poisson_ratio) / one.youngs_modulus for one in (a, b))


class _Chosen:
    """The constants that hold for one particle material and one other body: the most specific description wins."""

    def __init__(self, contact: ContactSpec, material: ContactMaterialSpec, other: _Surface, is_wall: bool) -> None:
        self.contact, self.a, self.b, self.is_wall = contact, material, other.material, is_wall
        self.softening = 1.0 if other.is_coating else contact.softening
        names = (
            {canonical(material.name), canonical(other.material.name)}
            if material.name and other.material.name
            else None
        )
        pairs = [pair for pair in contact.pairs if {canonical(name) for name in pair.between} == names]
        self.overrides: Sequence[ContactOverride] = [other.override, *pairs]

    def _value(self, name: str) -> float | None:
        """Constant called `name` of the most specific description that gives it."""
        for override in self.overrides:
            value: float | None = getattr(override, name)
            if value is not None:
                return value
        default: float | None = getattr(self.contact, name)
        return default

    @property
    def restitution(self) -> RestitutionSpec:
        """Restitution of the contact."""
        given = [override.restitution for override in self.overrides if override.restitution is not None]
        return given[0] if given else self.contact.restitution

    def rows(self, speed_scale: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Rows of the pair table for the particle against the other body, and the other way round."""
        row = np.zeros(N_COLUMN)
        row[FRICTION] = self._value("friction")
        row[ROLLING] = self._value("rolling_friction")
        row[TANGENTIAL_DASHPOT] = self._value("tangential_dashpot")
        row[SPEED_SCALE] = speed_scale
        row[SMOOTHING] = self.contact.smoothing
        back = row.copy()
        softening = self.softening
        stiffness = self._value("stiffness")
        if self.contact.law != "linear":
            modulus = reduced_youngs_modulus(self.a, self.b)
            row[STIFFNESS] = 4.0 / 3.0 * modulus / softening
            row[SHEAR] = self._ratio() * 2.0 * modulus / softening
        elif stiffness is not None:
            row[STIFFNESS] = stiffness / softening
            row[SHEAR] = self._ratio()
        else:
            row[RULE] = back[RULE] = 1.0
            row[STIFFNESS], row[SHEAR] = (value / softening for value in self._entity(self.a))
            back[STIFFNESS], back[SHEAR] = (value / softening for value in self._entity(self.b))
            return row, back
        return row, row

    def _ratio(self) -> float:
        """Tangential over normal stiffness [-]; Mindlin's 4 G*/E* is 2 (1 - nu)/(2 - nu) for equal materials.

        Wong & Rongong's 2.4 / (1 + nu) takes the mean nu where a stiffness is given in place of their rule.
        """
        if self.contact.shear == "mindlin":
            return 4.0 * reduced_shear_modulus(self.a, self.b) / reduced_youngs_modulus(self.a, self.b)
        if self.contact.shear == "as-printed":
            return 2.4 / (1.0 + 0.5 * (self.a.poisson_ratio + self.b.poisson_ratio))
        return self.contact.shear

    def _entity(self, body: ContactMaterialSpec) -> tuple[float, float]:
        """Normal and shear stiffness of one of the two bodies over its radius [N/m^2], for two in series.

        "entity", as printed: 5.5/4 pi Y, and 3.3 pi Y / (1 + nu) in shear (Eq. 11). "contact": both bodies get what
        makes the series 2.75 pi Y R* with the smaller Y, that is twice as much at a wall, where R* is the particle's
        whole radius and the engine gives the wall the radius of the particle.
        """
        if self.contact.interpretation == "entity":
            soft = body
            normal = YIELD_FACTOR * self._yield_stress(body)
        else:
            soft = min(self.a, self.b, key=self._yield_stress)
            normal = 2.0 * YIELD_FACTOR * self._yield_stress(soft) * (2.0 if self.is_wall else 1.0)
        if self.contact.shear == "as-printed":
            return normal, normal * 2.4 / (1.0 + soft.poisson_ratio)
        return normal, normal * self._ratio()

    def _yield_stress(self, body: ContactMaterialSpec) -> float:
        if body.yield_stress is None:
            raise InputError(
                'damper.contact: stiffness_rule = "yield-stress" needs the yield stress of every material, but '
                f"{_label(body)} has none; write that material as a table with yield_stress, such as "
                '{ name = "steel", yield_stress = "345 MPa" }'
            )
        return body.yield_stress


def _number(known: list[ContactMaterialSpec], material: ContactMaterialSpec) -> int:
    if material not in known:
        known.append(material)
    return known.index(material)


def _place(known: list[_Surface], places: list[list[str]], surface: _Surface, where: str) -> int:
    """Place of a surface in the list, after adding it if it is new; `where` is noted for its label."""
    if surface not in known:
        known.append(surface)
        places.append([])
    number = known.index(surface)
    places[number].append(where)
    return number


def _only_override(given: ContactOverride | None) -> ContactOverride:
    """The contact constants of a wall or coating, without its material, so that equal ones compare equal."""
    if given is None:
        return ContactOverride()
    return ContactOverride(**{name: getattr(given, name) for name in ContactOverride.model_fields})


def _label(material: ContactMaterialSpec) -> str:
    return material.name or f"unnamed, E = {material.youngs_modulus:g} Pa"
