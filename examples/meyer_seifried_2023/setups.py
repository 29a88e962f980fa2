"""The dampers of Meyer & Seifried (2023): baseline.toml, the files that differ from it in a few lines, small copies.

Run as a script, it writes those files anew: `python setups.py`.
"""

from math import pi
from pathlib import Path
from typing import NamedTuple

from graindamp.dem.packing_store import Packing
from graindamp.spec.field import FieldSpec, GridPlan
from graindamp.spec.model import load_spec

HERE = Path(__file__).parent

CLEARANCE = pi * 1e-3
"""Nominal clearance of all dampers but those of Table 3 [m]: the optimum stroke is then 1 mm."""

RESIN = '{ name = "tough-2000", youngs_modulus = "2.2 GPa", poisson_ratio = 0.4 }'
"""The printing resin of the inserts; its maker gives the modulus, Poisson's ratio is assumed."""

THIRDS = ("12.5 mm", "25 mm", "37.5 mm")
"""Places of three inserts: even over the 50 mm that are filled."""


class Setup(NamedTuple):
    """What a damper differs in from the baseline."""

    title: str
    clearance: str = "3.14159 mm"
    positions: tuple[str, ...] = ()
    """Middles of the inserts along the axis."""
    arms: int = 4
    coating: str = ""
    """Young's modulus of the coating on both end walls."""


SETUPS = {
    "single-cross": Setup("Single cross", positions=("25 mm",)),
    "triple-cross": Setup("Triple cross", positions=THIRDS),
    "triple-star": Setup("Triple star", positions=THIRDS, arms=8),
    "coated-50hz": Setup("Coated walls for 50 Hz (Table 3)", "4.8 mm", coating="0.27 MPa"),
    "coated-60hz": Setup("Coated walls for 60 Hz (Table 3)", "3.3 mm", coating="0.72 MPa"),
    "coated-80hz": Setup("Coated walls for 80 Hz (Table 3)", "1.9 mm", coating="1.4 MPa"),
    "coated-1.4mpa": Setup("Coated walls of 1.4 MPa (Fig. 11)", coating="1.4 MPa"),
    "coated-55mpa": Setup("Coated walls of 55 MPa (Fig. 11)", coating="55 MPa"),
}
"""All dampers but the baseline, by the stem of their file."""

NAMES = ("baseline", *SETUPS)


def text_of(name: str) -> str:
    """Text of the file of a damper: that of baseline.toml with the lines put in that are different."""
    setup = SETUPS[name]
    lines = (HERE / "baseline.toml").read_text(encoding="utf-8").split("\n")
    base = "# The baseline damper of"
    assert lines[0].startswith(base)
    lines[:2] = [f"# Written by setups.py from baseline.toml. {setup.title}, Meyer & Seifried (2023)."]
    _put(lines, "title = ", f'title = "{setup.title}, Meyer & Seifried (2023)"')
    _put(lines, "max_cycles = ", "max_cycles = 25           # as the paper")
    _put(lines, "name = ", f'name = "{name}"')
    if setup.clearance != "3.14159 mm":
        _put(lines, "clearance = ", f'clearance = "{setup.clearance}"      # of the bed once shaken, up to the coating')
    extra: list[str] = []
    if setup.positions:
        _put(lines, "count = ", 'height = "50 mm"          # the mark, with the axis upright; inserts take room')
        _put(lines, "length = ", 'length = "70 mm"          # the bore while the bed is poured; the lid shortens it')
        pair = ["[[damper.contact.pairs]]", 'between = ["steel-s235", "tough-2000"]']
        pair += ['restitution = { plateau = 0.54, reference_speed = "0.03 m/s", exponent = 1 }  # assumed', ""]
        at = lines.index("[damper.packing]")
        lines[at:at] = pair
        extra += [
            "# Fig. 6: arms of 5 mm x 5 mm from the axis to the wall, one pair along gravity. What joins the inserts,",
            "# and the base plate that they are printed with, are not dimensioned in the paper and left out.",
        ]
        for position in setup.positions:
            extra += ["[[damper.inserts]]", 'kind = "star"', f'position = "{position}"', f"arms = {setup.arms}"]
            extra += ['width = "5 mm"', f"material = {RESIN}", ""]
    if setup.coating:
        extra += ["# Both end walls: Sect. 4.3. Restitution of the polymer is not given; that of the wall is taken."]
        for wall in ("start", "end"):
            extra += [f"[damper.container.walls.{wall}.coating]", f'youngs_modulus = "{setup.coating}"']
            extra += ["poisson_ratio = 0.5", 'thickness = "3 mm"']
            extra += ['restitution = { plateau = 0.54, reference_speed = "0.03 m/s", exponent = 1 }', ""]
    at = lines.index("[damper.lid]")
    lines[at:at] = extra
    (study,) = (k for k, line in enumerate(lines) if line.startswith("[softening_study]"))
    lines[study:] = ["# What softening does to a field is studied with the baseline.", ""]
    return "\n".join(lines)


def _put(lines: list[str], start: str, line: str) -> None:
    (at,) = (k for k, old in enumerate(lines) if old.startswith(start))
    lines[at] = line


def load(name: str) -> FieldSpec:
    """Description of a damper by name, one of :data:`NAMES`."""
    return load_spec(HERE / f"{name}.toml", FieldSpec)


def small(spec: FieldSpec, count: int = 500) -> FieldSpec:
    """A copy with fewer spheres: container and inserts scaled alike, spheres, coatings and clearance as they are."""
    scale = (count / 4500) ** (1 / 3)
    part = spec.model_dump(exclude_unset=True)
    damper = part["damper"]
    damper["fill"] = {"count": count}
    damper["container"]["radius"] *= scale
    damper["container"]["length"] *= max(scale, 0.4)
    damper["inserts"] = [
        insert | {"position": insert["position"] * scale, "width": insert["width"] * scale}
        for insert in damper.get("inserts", ())
    ]
    return FieldSpec.model_validate(part)


def with_contact(spec: FieldSpec, **values: object) -> FieldSpec:
    """A copy with other values in [damper.contact]."""
    part = spec.model_dump(exclude_unset=True)
    part["damper"]["contact"] |= values
    return FieldSpec.model_validate(part)


STIFF_FROM, STIFF_TO = 90.0, 4.1
"""Frequency [Hz] from which, and intensity Gamma [-] up to which, softening brings a resonance of the bed into the
field."""


def stiff(spec: FieldSpec, whole: bool = False) -> FieldSpec:
    """The field at the stiffness of steel, where softening matters most or on the `whole` grid."""
    assert isinstance(spec.plan, GridPlan)
    frequencies = tuple(f for f in spec.plan.frequencies if whole or f > STIFF_FROM)
    intensities = tuple(gamma for gamma in spec.plan.intensities if whole or gamma < STIFF_TO)
    return on_grid(with_contact(spec, softening=1.0), frequencies, intensities, 25)


def on_grid(
    spec: FieldSpec, frequencies: tuple[float, ...], intensities: tuple[float, ...], max_cycles: int
) -> FieldSpec:
    """A copy with other operating points [Hz], [-], of so many cycles at most, and without a study."""
    plan = GridPlan(frequency=frequencies, intensity=intensities)
    stop = spec.stop.model_copy(update={"max_cycles": max_cycles})
    return spec.model_copy(update={"plan": plan, "stop": stop, "softening_study": None})


def with_lid_at(packing: Packing, clearance: float) -> Packing:
    """The same bed under a lid that leaves this clearance [m]; beds are dear, lids are not.

    Raises:
        ValueError: the lid would stand in the bed.
    """
    if packing.clearance is not None and abs(clearance - packing.clearance) < 1e-8:
        return packing
    tops = float((packing.position[:, 0] + packing.radius).max())
    if packing.height + clearance < tops:
        raise ValueError(f"clearance is {clearance:g} m, but the highest sphere needs {tops - packing.height:g} m")
    return packing._replace(lid_height=packing.height + clearance, clearance=clearance)


def main() -> None:
    """Write every file but baseline.toml."""
    for name in SETUPS:
        path = HERE / f"{name}.toml"
        path.write_text(text_of(name), encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main()
