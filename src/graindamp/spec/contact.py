"""Description of what happens where two bodies touch: materials, restitution, friction, and the laws of force."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from graindamp.errors import InputError
from graindamp.materials import MATERIALS, material_named
from graindamp.spec.model import Spec
from graindamp.spec.quantity import (
    ContactRestitution,
    ContactStiffness,
    Density,
    FrictionOrZero,
    FrictionSlope,
    Number,
    PoissonRatio,
    Ratio,
    Speed,
    YieldStress,
    YoungsModulus,
)

LARGEST_SOFTENING = 1e4
"""Softening is refused above this [-]: overlaps grow with its power 0.4, and a steel sphere of 1.25 mm radius that
hits another at 1 m/s (overlap 2.6 um) would be pressed by a tenth of its radius, where no contact law holds."""


def canonical(name: str) -> str:
    """Name of a material as it is compared: lower case, with hyphens for blanks and underscores."""
    return "-".join(name.lower().replace("_", " ").split())


class ContactMaterialSpec(Spec):
    """Elastic material of particles, walls or inserts."""

    name: str = ""
    """Name of the material, by which pairs refer to it. A table with the name of a known material takes from there
    what it does not say."""
    youngs_modulus: YoungsModulus
    """Young's modulus E [Pa], > 0."""
    poisson_ratio: PoissonRatio
    """Poisson's ratio nu [-], 0 to 0.5; 0.5 is incompressible, beyond it no solid is stable."""
    density: Density | None = None
    """Density rho [kg/m^3], > 0; needed for particles only, since walls do not move in their own frame."""
    yield_stress: YieldStress | None = None
    """Yield stress Y [Pa], > 0; needed where stiffness_rule = "yield-stress"."""


def _material(value: Any) -> Any:
    """Named material, or a table completed from the named material that it refers to."""
    if isinstance(value, str):
        value = {"name": material_named(value).name}
    if not isinstance(value, Mapping) or canonical(str(value.get("name", ""))) not in MATERIALS:
        return value
    known = material_named(str(value["name"]))
    return {
        "youngs_modulus": known.youngs_modulus,
        "poisson_ratio": known.poisson_ratio,
        "density": known.density,
        "yield_stress": known.yield_stress,
        **value,
        "name": known.name,
    }


ContactMaterial = Annotated[ContactMaterialSpec, BeforeValidator(_material)]
"""A material: the name of a known one, or a table."""


class TableRestitution(Spec):
    """Restitution over impact speed from a table; linear in the logarithm of the speed, constant beyond its ends."""

    speed: tuple[Speed, ...] = Field(min_length=1)
    """Impact speeds [m/s], > 0, ascending."""
    restitution: tuple[ContactRestitution, ...] = Field(min_length=1)
    """Coefficient of restitution at each speed [-], 0.01 to 1."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len(self.speed) != len(self.restitution):
            raise InputError(
                f"speed has {len(self.speed)} and restitution {len(self.restitution)} values; give as many"
            )
        if any(b <= a for a, b in zip(self.speed, self.speed[1:], strict=False)):
            raise InputError(f"speed must ascend, given {', '.join(f'{v:g}' for v in self.speed)} m/s")
        return self


class PlateauRestitution(Spec):
    """Restitution that falls from 1 at rest to a plateau, e = e_inf + (1 - e_inf) / (1 + (v / v0)^p).

    The form follows the finite element results of Meyer & Seifried (2023), Fig. 3, as far as their text describes
    them: 1 for very slow impacts, a rapid fall, an almost constant value for fast ones.
    """

    plateau: ContactRestitution
    """Restitution e_inf of fast impacts [-], 0.01 to 1."""
    reference_speed: Speed
    """Speed v0 at which half of the fall is done [m/s], > 0."""
    exponent: Number = Field(default=1.0, gt=0, le=10)
    """Exponent p of the fall [-], > 0 to 10; above 10 it is a step, on which an impact's outcome would hang by
    chance."""


def _restitution_kind(value: Any) -> str | None:
    """Tag of the union's member; tags are no names of fields, which messages would take them for."""
    if isinstance(value, Mapping):
        kinds = {"by table": {"speed", "restitution"}, "by formula": {"plateau", "reference_speed", "exponent"}}
        shared = {kind: len(keys & set(value)) for kind, keys in kinds.items()}
        return max(shared, key=lambda kind: shared[kind]) if any(shared.values()) else None
    if isinstance(value, Spec):
        return "by table" if isinstance(value, TableRestitution) else "by formula"
    return "number"


RestitutionSpec = Annotated[
    Annotated[ContactRestitution, Tag("number")]
    | Annotated[TableRestitution, Tag("by table")]
    | Annotated[PlateauRestitution, Tag("by formula")],
    Discriminator(
        _restitution_kind,
        custom_error_type="restitution",
        custom_error_message=(
            "give a number from 0.01 to 1, a table with speed and restitution, "
            "or a table with plateau, reference_speed and exponent"
        ),
    ),
]
"""Coefficient of restitution [-]: constant, or over impact speed."""


class ContactOverride(Spec):
    """What may differ from the damper's [contact] for some contacts; what is left out stays as there.

    Pairs, walls and coatings inherit from it, because each takes the same keys with the same meaning.
    """

    restitution: RestitutionSpec | None = None
    """Coefficient of restitution [-], 0.01 to 1, or a table over speed; default: as in contact."""
    friction: FrictionOrZero | None = None
    """Coefficient of friction [-], >= 0; default: as in contact."""
    rolling_friction: FrictionOrZero | None = None
    """Coefficient of rolling resistance [-], >= 0; default: as in contact."""
    tangential_dashpot: Ratio | None = None
    """Tangential over normal dashpot [-], >= 0, for tangential springs; default: as in contact."""
    stiffness: ContactStiffness | None = None
    """Normal stiffness of the contact [N/m], > 0, for law = "linear"; default: as in contact."""


class PairSpec(ContactOverride):
    """What holds between two materials, whichever of them is the particle's."""

    between: tuple[str, str]
    """Names of the two materials; twice the same for contacts within one material."""


def _shear(value: Any) -> str:
    return "rule" if isinstance(value, str) and value in ("mindlin", "as-printed") else "ratio"


ShearSpec = Annotated[
    Annotated[Literal["mindlin", "as-printed"], Tag("rule")] | Annotated[Ratio, Field(gt=0, le=10), Tag("ratio")],
    Discriminator(_shear),
]


class ContactSpec(Spec):
    """Laws of the contact forces, and the constants of all contacts that no pair, wall or coating overrides.

    The order of precedence is coating, wall, pair, contact: the coating's own value, else the wall's (unless it has a
    coating), else that of the pair of materials, else the one given here. Nothing is averaged between materials.
    """

    law: Literal["hertz-gonthier", "hertz-viscoelastic", "linear"] = "hertz-gonthier"
    """Normal force: "hertz-gonthier" (Gonthier et al. 2004, Meyer & Seifried 2023 Eq. 9), "hertz-viscoelastic"
    (dashpot growing with the fourth root of the overlap, Tsuji et al. 1992) or "linear" (spring and dashpot, Cundall
    & Strack 1979)."""
    tension: bool = False
    """Whether a viscous law may pull bodies together as they part, for comparison with codes that let it; the
    Gonthier law never does."""
    tangential: Literal["tanh", "mindlin", "linear", "none"] = "tanh"
    """Tangential force: "tanh" (smoothed Coulomb friction without a spring), "mindlin" (spring of Hertz contacts),
    "linear" (spring of linear contacts) or "none". Only a spring holds a slope at rest."""
    restitution: RestitutionSpec
    """Coefficient of restitution [-], 0.01 to 1, or a table: speed and restitution, or plateau, reference_speed and
    exponent."""
    friction: FrictionOrZero
    """Coefficient of friction [-], >= 0, of every two materials that no pair names."""
    rolling_friction: FrictionOrZero = 0.0
    """Coefficient of rolling resistance mu_r [-], >= 0: the moment is mu_r times reduced radius times normal force."""
    smoothing: FrictionSlope = 1000.0
    """Slope tau of tanh friction [s/m], > 0: friction reaches three quarters of its limit at a slip of 1/tau. The
    default of 1 mm/s lies below the container's speed at 1 g up to 1000 Hz (1.6 mm/s), so that friction is full
    wherever a bed moves against its container. Steeper slopes are not followed by the time step during fast impacts,
    where the friction is then limited."""
    tangential_dashpot: Ratio = 0.0
    """Tangential over normal dashpot [-], >= 0, for tangential springs."""
    stiffness: ContactStiffness | None = None
    """Normal stiffness of a contact [N/m], > 0, for law = "linear"; give it or stiffness_rule."""
    stiffness_rule: Literal["yield-stress"] | None = None
    """"yield-stress": normal stiffness of law = "linear" from yield stresses and radii (Wong & Rongong 2009, Eqs
    10-11)."""
    interpretation: Literal["entity", "contact"] = "entity"
    """How stiffness_rule is read: "entity" as printed, each body with 5.5/4 pi Y R and both in series; "contact", the
    plastic loading that the formula stems from, 2.75 pi Y R* with the smaller of the yield stresses, which is twice
    as stiff between equal particles."""
    shear: ShearSpec = "mindlin"
    """Tangential stiffness: "mindlin" (of elastic spheres, 2 (1 - nu) / (2 - nu) times the normal one for equal
    materials), "as-printed" (Wong & Rongong 2009, Eq. 11, with stiffness_rule only), or its ratio to the normal
    stiffness [-], above 0 to 10."""
    softening: Number = Field(default=1.0, ge=1, le=LARGEST_SOFTENING)
    """Divisor of every stiffness but that of coatings and foam [-], 1 to 10000: allows time steps longer by its power
    0.4 (linear: 0.5) at the price of overlaps larger by as much. Compare two values before trusting a result: a
    softened bed bounces otherwise."""
    pairs: tuple[PairSpec, ...] = ()
    """Pairs of materials with constants of their own ([[damper.contact.pairs]] in the file)."""

    @model_validator(mode="after")
    def _laws_fit(self) -> Self:
        linear = self.law == "linear"
        if self.tangential == "mindlin" and linear:
            raise InputError('tangential = "mindlin" needs a Hertz law; with law = "linear" choose "linear" or "tanh"')
        if self.tangential == "linear" and not linear:
            raise InputError(
                f'tangential = "linear" needs law = "linear"; with law = "{self.law}" choose "mindlin" or "tanh"'
            )
        if linear and (self.stiffness is None) == (self.stiffness_rule is None):
            raise InputError(
                'law = "linear" needs either stiffness [N/m] or stiffness_rule = "yield-stress", and not both'
            )
        if not linear and (self.stiffness is not None or self.stiffness_rule is not None):
            raise InputError(
                f'law = "{self.law}" takes its stiffness from the materials; leave out stiffness and stiffness_rule, '
                'use softening to reduce it, or choose law = "linear"'
            )
        if self.shear == "as-printed" and self.stiffness_rule is None:
            raise InputError(
                'shear = "as-printed" belongs to stiffness_rule = "yield-stress"; choose "mindlin" or a ratio'
            )
        if self.tension and self.law == "hertz-gonthier":
            raise InputError(
                'law = "hertz-gonthier" never pulls; leave out tension or choose "hertz-viscoelastic" or "linear"'
            )
        return self

    @model_validator(mode="after")
    def _pairs_fit(self) -> Self:
        seen = set()
        for pair in self.pairs:
            names = frozenset(map(canonical, pair.between))
            if names in seen:
                raise InputError(f"the pair {' and '.join(pair.between)} is given twice; keep one")
            seen.add(names)
            check_override(pair, self, f"the pair {' and '.join(pair.between)}")
        return self


def check_override(given: ContactOverride, contact: ContactSpec, where: str) -> None:
    """Complain of a stiffness under a law that has none of its own.

    Raises:
        InputError: naming `where`.
    """
    if given.stiffness is not None and contact.law != "linear":
        raise InputError(
            f'{where} gives a stiffness, but law = "{contact.law}" takes it from the materials; leave it out'
        )
