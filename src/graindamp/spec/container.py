"""Description of what holds the particles: container, coatings, inserts and lid, in the container's own frame."""

import difflib
import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from graindamp.errors import InputError
from graindamp.spec.contact import ContactMaterial, ContactMaterialSpec, ContactOverride
from graindamp.spec.model import Spec
from graindamp.spec.quantity import (
    Direction,
    Length,
    Phase,
    Point3,
    PoissonRatio,
    Position,
    Ratio,
    Size3,
    YoungsModulus,
)

Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")


def unit_vector(axis: Axis, sign: float = 1.0) -> tuple[float, float, float]:
    """Unit vector along an axis [-]."""
    x, y, z = (sign if name == axis else 0.0 for name in AXES)
    return x, y, z


def on_axis(axis: Axis, along: float, first: float = 0.0, second: float = 0.0) -> tuple[float, float, float]:
    """Coordinates from that along `axis` and those along the two axes that follow it in the order x, y, z, x, y [m]."""
    values = {axis: along, next_axis(axis): first, next_axis(next_axis(axis)): second}
    return values["x"], values["y"], values["z"]


def next_axis(axis: Axis) -> Axis:
    """The axis that follows in the order x, y, z, x."""
    return AXES[(AXES.index(axis) + 1) % 3]


class CoatingSpec(ContactOverride):
    """A soft layer on a wall, which the particles touch in place of the wall itself.

    Its surface stands where the container's description puts the wall; the stiff wall lies `thickness` behind it and
    acts on a particle that has pressed the layer through. The layer is an elastic half-space of its own modulus
    (Meyer & Seifried 2023, Eqs 12-14), without the stiffening of a thin layer on a stiff ground.
    """

    material: ContactMaterial | None = None
    """Name of the layer's material, or a table; or give youngs_modulus and poisson_ratio."""
    youngs_modulus: YoungsModulus | None = None
    """Young's modulus of the layer [Pa], > 0; with poisson_ratio, in place of material."""
    poisson_ratio: PoissonRatio | None = None
    """Poisson's ratio of the layer [-], 0 to 0.5; rubber is close to 0.5."""
    thickness: Length
    """Thickness of the layer [m], > 0."""

    @model_validator(mode="after")
    def _one_material(self) -> Self:
        moduli = (self.youngs_modulus is not None, self.poisson_ratio is not None)
        if moduli not in ((True, True), (False, False)) or (self.material is None) != all(moduli):
            raise InputError("a coating needs either material, or youngs_modulus and poisson_ratio")
        return self

    @property
    def layer(self) -> ContactMaterialSpec:
        """Material of the layer."""
        if self.material is not None:
            return self.material
        assert self.youngs_modulus is not None
        assert self.poisson_ratio is not None
        return ContactMaterialSpec(name="coating", youngs_modulus=self.youngs_modulus, poisson_ratio=self.poisson_ratio)


class WallSurface(ContactOverride):
    """What is different about one wall."""

    material: ContactMaterial | None = None
    """Material of this wall; default: that of the container."""
    coating: CoatingSpec | None = None
    """A layer on this wall; default: none."""


class _Container(Spec):
    """What all containers have: a material, and walls with names. Abstract; the fields would else be written five
    times."""

    material: ContactMaterial
    """Material of the walls: a name such as "aluminium-6060", or a table with youngs_modulus and poisson_ratio."""
    walls: dict[str, WallSurface] = Field(default_factory=dict)
    """Walls with a material, coating or contact constants of their own, by name."""

    @property
    @abstractmethod
    def wall_names(self) -> tuple[str, ...]:
        """Names of the walls, in a fixed order."""

    @property
    @abstractmethod
    def volume(self) -> float | None:
        """Inner volume without inserts [m^3]; None where the description alone does not tell it."""

    def wall_material(self, wall: str) -> ContactMaterialSpec:
        """Material of a wall, without its coating."""
        surface = self.walls.get(wall)
        return self.material if surface is None or surface.material is None else surface.material

    @model_validator(mode="after")
    def _walls_exist(self) -> Self:
        for name in self.walls:
            if name not in self.wall_names:
                near = difflib.get_close_matches(name, self.wall_names, n=1, cutoff=0.5)
                hint = f"; nearest is '{near[0]}'" if near else ""
                raise InputError(f"no wall is called '{name}'{hint}; this container has {', '.join(self.wall_names)}")
        return self

    def _check_coatings(self, thinnest: float) -> None:
        """Complain of a coating that leaves no room, in a container whose smallest width is `thinnest` [m]."""
        for name, surface in self.walls.items():
            if surface.coating is not None and surface.coating.thickness > thinnest:
                raise InputError(
                    f"the coating of wall '{name}' is {surface.coating.thickness:g} m thick, "
                    f"but the container only {thinnest:g} m at its narrowest; give a thinner one"
                )


class CylinderContainer(_Container):
    """A cylinder about an axis of coordinates, from 0 to its length; walls "side", "start" (at 0) and "end" (at the
    length)."""

    kind: Literal["cylinder"] = "cylinder"
    """Kind of container: "cylinder"."""
    radius: Length
    """Inner radius [m], > 0."""
    length: Length
    """Inner length [m], > 0. With a lid it is that of the bore while the bed is poured; the lid then shortens it."""
    axis: Axis = "x"
    """Axis of the cylinder: "x", "y" or "z"; it passes through the origin."""

    @property
    def wall_names(self) -> tuple[str, ...]:
        """Names of the walls: side, start, end."""
        return ("side", "start", "end")

    @property
    def volume(self) -> float:
        """Inner volume without inserts [m^3]."""
        return math.pi * self.radius**2 * self.length

    @model_validator(mode="after")
    def _coatings_fit(self) -> Self:
        self._check_coatings(min(self.length, 2 * self.radius))
        return self


class BoxContainer(_Container):
    """A box from the origin to its size; walls "x-" (at x = 0), "x+", "y-", "y+", "z-", "z+"."""

    kind: Literal["box"] = "box"
    """Kind of container: "box"."""
    size: Size3
    """Inner lengths along x, y and z [m], > 0. With a lid, the length across it is that while the bed is poured."""

    @property
    def wall_names(self) -> tuple[str, ...]:
        """Names of the walls: x-, x+, y-, y+, z-, z+."""
        return ("x-", "x+", "y-", "y+", "z-", "z+")

    @property
    def volume(self) -> float:
        """Inner volume without inserts [m^3]."""
        return math.prod(self.size)

    @model_validator(mode="after")
    def _coatings_fit(self) -> Self:
        self._check_coatings(min(self.size))
        return self


class SphereContainer(_Container):
    """A hollow sphere about the origin; its wall is called "wall"."""

    kind: Literal["sphere"] = "sphere"
    """Kind of container: "sphere"."""
    radius: Length
    """Inner radius [m], > 0."""

    @property
    def wall_names(self) -> tuple[str, ...]:
        """Name of the wall: wall."""
        return ("wall",)

    @property
    def volume(self) -> float:
        """Inner volume without inserts [m^3]."""
        return 4.0 / 3.0 * math.pi * self.radius**3

    @model_validator(mode="after")
    def _coatings_fit(self) -> Self:
        self._check_coatings(2 * self.radius)
        return self


class MeshContainer(_Container):
    """A closed surface of triangles from a file; its wall is called "mesh"."""

    kind: Literal["mesh"] = "mesh"
    """Kind of container: "mesh"."""
    file: str = Field(min_length=1, pattern=r"\.([sS][tT][lL]|[oO][bB][jJ]|[pP][lL][yY])$")
    """File of the surface (.stl .obj .ply), relative to this description; its volume is found by the reader."""
    length_unit: Literal["m", "cm", "mm", "um", "in"] = "m"
    """Unit of the file's coordinates: "m", "cm", "mm", "um" or "in"; none of the formats says it."""

    @property
    def scale(self) -> float:
        """Length of one unit of the file [m]."""
        return {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}[self.length_unit]

    @property
    def wall_names(self) -> tuple[str, ...]:
        """Name of the wall: mesh."""
        return ("mesh",)

    @property
    def volume(self) -> None:
        """Not known from the description."""
        return

    @model_validator(mode="after")
    def _no_coating(self) -> Self:
        if any(surface.coating is not None for surface in self.walls.values()):
            raise InputError(
                "a mesh cannot be coated, because the stiff wall behind the layer would need a second surface; "
                "give the wall the soft material itself"
            )
        return self


class PlaneSpec(Spec):
    """An endless plane with particles on one side, or a disc."""

    name: str = Field(min_length=1)
    """Name of the wall."""
    point: Point3
    """A point of the plane [m]."""
    normal: Direction
    """Direction into the space of the particles: "z" and the like, or a vector."""
    radius: Length | None = None
    """Radius of a disc about the point, a thin plate that particles meet from both sides and at its rim [m], > 0;
    default: an endless plane."""


class WallsContainer(_Container):
    """Planes that need not close a space, for open arrangements and tests."""

    kind: Literal["walls"] = "walls"
    """Kind of container: "walls"."""
    planes: tuple[PlaneSpec, ...] = Field(min_length=1)
    """The planes, at least one ([[damper.container.planes]] in the file)."""

    @property
    def wall_names(self) -> tuple[str, ...]:
        """Names of the planes."""
        return tuple(plane.name for plane in self.planes)

    @property
    def volume(self) -> None:
        """Not known: the planes need not close a space."""
        return

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        if len(set(self.wall_names)) < len(self.wall_names):
            raise InputError(f"every plane needs a name of its own, given {', '.join(self.wall_names)}")
        return self


ContainerSpec = Annotated[
    CylinderContainer | BoxContainer | SphereContainer | MeshContainer | WallsContainer, Field(discriminator="kind")
]


class BoxInsert(Spec):
    """A solid block inside the container."""

    kind: Literal["box"] = "box"
    """Kind of insert: "box"."""
    name: str = ""
    """Name of the insert in tables; default: insert and its number."""
    material: ContactMaterial
    """Material of its surface: a name, or a table with youngs_modulus and poisson_ratio."""
    center: Point3
    """Centre [m]."""
    size: Size3
    """Lengths along x, y and z before it is turned [m], > 0."""
    axis: Axis = "z"
    """Axis through the centre about which it is turned: "x", "y" or "z"."""
    angle: Phase = 0.0
    """Angle by which it is turned [rad], right-handed."""

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return math.prod(self.size)


class CylinderInsert(Spec):
    """A solid round bar inside the container."""

    kind: Literal["cylinder"] = "cylinder"
    """Kind of insert: "cylinder"."""
    name: str = ""
    """Name of the insert in tables; default: insert and its number."""
    material: ContactMaterial
    """Material of its surface: a name, or a table with youngs_modulus and poisson_ratio."""
    start: Point3
    """Centre of one end [m]."""
    end: Point3
    """Centre of the other end [m]."""
    radius: Length
    """Radius [m], > 0."""

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return math.pi * self.radius**2 * math.dist(self.start, self.end)

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if self.start == self.end:
            raise InputError("start and end of the cylinder are the same point; give two")
        return self


class StarInsert(Spec):
    """Beams across a cylindrical container that cross on its axis (Meyer & Seifried 2023, Fig. 6)."""

    kind: Literal["star"] = "star"
    """Kind of insert: "star"."""
    name: str = ""
    """Name of the insert in tables; default: insert and its number."""
    material: ContactMaterial
    """Material of its surface: a name, or a table with youngs_modulus and poisson_ratio."""
    position: Position
    """Middle of the beams along the container's axis [m], at least half of width from either end."""
    arms: int = Field(default=4, ge=2, le=24, multiple_of=2)
    """Number of arms, even, 2 to 24; two arms make a beam across the section, four arms a cross. More than 24 close
    the section."""
    width: Length
    """Side of the arms' square section [m], > 0."""
    angle: Phase = 0.0
    """Angle of the first beam about the container's axis [rad], from the axis that follows it in the order x, y, z,
    x."""

    def beams(self, axis: Axis, radius: float) -> tuple[BoxInsert, ...]:
        """The beams as blocks across a cylinder of `radius` [m] about `axis`; their corners lie outside its side
        wall."""
        size = on_axis(axis, self.width, 2.0 * radius, self.width)
        center = on_axis(axis, self.position)
        n_beam = self.arms // 2
        return tuple(
            BoxInsert(
                name=self.name,
                material=self.material,
                center=center,
                size=size,
                axis=axis,
                angle=self.angle + k * math.pi / n_beam,
            )
            for k in range(n_beam)
        )

    def volume_in(self, radius: float) -> float:
        """Volume inside a cylinder of `radius` [m^3]: of all beams, less what they share about the axis.

        In the section n beams share their middle, where each point belongs to several; the area of the union of n
        strips is that of 2 n sectors. Exact while the arms do not meet before they reach the side wall.
        """
        n_beam, half = self.arms // 2, self.width / 2.0
        meets = half / math.tan(math.pi / (2 * n_beam)) if n_beam > 1 else 0.0
        edge = math.sqrt(max(radius**2 - half**2, 0.0))
        if half >= radius or meets >= edge:
            return math.pi * radius**2 * self.width
        strip = 2.0 * (half * edge + radius**2 * math.asin(half / radius))
        arm = strip / 2.0 - half * meets  # half a strip, without the triangle to the axis where neighbouring arms meet
        return self.width * 2.0 * n_beam * arm


InsertSpec = Annotated[BoxInsert | CylinderInsert | StarInsert, Field(discriminator="kind")]


class RigidLid(Spec):
    """A stiff wall set at a distance from the bed."""

    kind: Literal["rigid"] = "rigid"
    """Kind of lid: "rigid"."""
    wall: str | None = None
    """Wall that is moved to close the container; default: the one opposite to where the bed is poured, "end" of a
    cylinder."""
    clearance: Length
    """Free travel h between bed and lid [m], > 0."""
    measured: Literal["compacted", "poured"] = "compacted"
    """State of the bed that the clearance is measured from: "compacted" by shaking before the lid is set, or as
    "poured". Shaken beds pack denser by millimetres, so that a lid set on a poured bed leaves more travel than its
    clearance says."""


def _three(value: Any) -> Any:
    if isinstance(value, (list, tuple)) and len(value) != 3:
        raise ValueError("expected three numbers, those of compression, its square and its cube")
    return value


Cubic = Annotated[tuple[float, float, float], BeforeValidator(_three)]


class FoamLid(Spec):
    """Elastic foam pressed onto the bed by a stiff lid (Wong & Rongong 2009, sect. III.B and C).

    Every particle is pressed on its own, against the lid's direction and without friction: a foam follows an uneven
    surface. With z the distance of the particle's top from the floor, the compression of the foam there is x = z -
    height + preload where positive, and the force c1 x + c2 x^2 + c3 x^3. Beyond `travel` the stiff lid behind the
    foam is felt as well.
    """

    kind: Literal["foam"] = "foam"
    """Kind of lid: "foam"."""
    wall: str | None = None
    """Wall that the foam hangs on; default: the one opposite to where the bed is poured, "end" of a cylinder."""
    height: Length
    """Distance from the floor to the surface of the bed that presses the foam by preload [m], > 0."""
    coefficients: Cubic | None = None
    """Force of the foam on one particle over its compression: c1 [N/m], c2 [N/m^2], c3 [N/m^3]. Give it or pressure."""
    pressure: Cubic | None = None
    """Pressure of the foam over its compression: p1 [Pa/m], p2 [Pa/m^2], p3 [Pa/m^3]; a particle carries it on the
    square of its diameter, about its share of the surface of a dense layer. Give it or coefficients."""
    preload: Position = 0.0
    """Compression of the foam by the lid before the container moves [m], >= 0 and below travel."""
    travel: Length
    """Compression at which the foam is solid and the stiff lid behind it is felt [m], > 0; at most the foam's
    thickness."""
    loss_factor: Ratio = 0.0
    """Loss factor of the foam [-], 0 to 1; 0 is elastic."""

    @property
    def polynomial(self) -> tuple[float, float, float]:
        """The three coefficients of force [N/m, ...] or pressure [Pa/m, ...], whichever is given."""
        given = self.coefficients if self.coefficients is not None else self.pressure
        assert given is not None
        return given

    @property
    def relaxed_height(self) -> float:
        """Distance from the floor to the surface of the foam without a bed below it [m]."""
        return self.height - self.preload

    @property
    def lid_height(self) -> float:
        """Distance from the floor to the stiff lid behind the foam, where the top of a particle has spent all travel
        [m]."""
        return self.height - self.preload + self.travel

    @model_validator(mode="after")
    def _pushes(self) -> Self:
        if (self.coefficients is None) == (self.pressure is None):
            raise InputError("a foam lid needs either coefficients (per particle) or pressure, and not both")
        if self.preload >= self.travel:
            raise InputError(
                f"preload is {self.preload:g} m, but the foam is solid at {self.travel:g} m (travel); lower it"
            )
        if self.preload >= self.height:
            raise InputError(
                f"preload is {self.preload:g} m, but the foam hangs {self.height:g} m above the floor; lower it"
            )
        if self.loss_factor > 1:
            raise InputError(f"loss_factor is {self.loss_factor:g}; above 1 the foam would pull while it springs back")
        first, second, third = self.polynomial
        tangents = [first, first + self.travel * (second + third * self.travel)]
        if third > 0 and 0 < -second / (2 * third) < self.travel:
            tangents.append(first - second**2 / (4 * third))
        if min(tangents) < 0 or first == second == third == 0:
            raise InputError(
                f"the foam's force becomes negative between 0 and {self.travel:g} m of compression, "
                "but a foam only pushes; check signs and units of the three coefficients"
            )
        return self


LidSpec = Annotated[RigidLid | FoamLid, Field(discriminator="kind")]


def with_number(
    inserts: tuple[BoxInsert | CylinderInsert | StarInsert, ...],
) -> Mapping[str, BoxInsert | CylinderInsert | StarInsert]:
    """Inserts by name; those without one are called insert and their number."""
    return {insert.name or f"insert {number}": insert for number, insert in enumerate(inserts, 1)}
