"""`graindamp rules`: closed forms and design formulas, each with its source."""

from typing import Annotated

import typer

from graindamp.cli.options import AsJson, need_option, read_intensity, show_rule
from graindamp.errors import InputError
from graindamp.units import STANDARD_GRAVITY

rules = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Closed-form rules: fields of idealised beds, and design formulas.",
)


Text = str | None
_DIMENSIONLESS = dict.fromkeys(("loss_factor", "effective_mass_ratio"), "-")


def _positive(option: str, value: str, unit: str) -> float:
    """SI number of an option that must be above 0."""
    number = need_option(option, value, unit)
    if not number > 0.0:
        raise InputError(f"--{option}: given '{value}'; a value above 0 is needed")
    return number


@rules.command("bouncing")
def rules_bouncing(
    stroke_ratio: Annotated[Text, typer.Option(help="Stroke over its optimum, X / (h / pi) [-].")] = None,
    restitution: Annotated[str, typer.Option(help="Restitution of bed and wall [-], 0 to below 1.")] = "0",
    clearance: Annotated[Text, typer.Option(help="Free travel h [m]; with frequency and intensity.")] = None,
    frequency: Annotated[Text, typer.Option(help="Driving frequency [Hz].")] = None,
    intensity: Annotated[Text, typer.Option(help="Intensity [-], or an acceleration such as '20 g'.")] = None,
    as_json: AsJson = False,
) -> None:
    """Bed thrown from wall to wall (collect and collide), no gravity."""
    from math import pi

    from graindamp.field import theory

    e = need_option("restitution", restitution, "")
    if stroke_ratio is not None:
        r = need_option("stroke-ratio", stroke_ratio, "")
    elif clearance is not None and frequency is not None and intensity is not None:
        omega = 2 * pi * _positive("frequency", frequency, "Hz")
        level = read_intensity("intensity", intensity) or 0.0
        r = level * STANDARD_GRAVITY / omega**2 * pi / _positive("clearance", clearance, "m")
    else:
        raise InputError("give --stroke-ratio, or --clearance with --frequency and --intensity")
    point = theory.collect_and_collide(r, e)
    low, high, stable = theory.stroke_ratio_min(e), theory.stroke_ratio_max(e), theory.stroke_ratio_stable_max(e)
    note = ""
    if r < low:
        note = f"does not exist: below X/X_opt = {low:.4g} the bed cannot keep up with two impacts per cycle"
    elif r > high:
        note = f"does not exist: above X/X_opt = {high:.4g} the wall just left catches the bed again"
    elif r > stable:
        note = f"exists, but is unstable above X/X_opt = {stable:.4g}; motions nearby give a similar loss factor"
    document = point._asdict() | {
        "stroke_ratio": r,
        "stroke_ratio_min": low,
        "stroke_ratio_best": theory.stroke_ratio_best(e),
        "stroke_ratio_max": high,
        "stroke_ratio_stable_max": stable,
        "note": note,
    }
    source = "exact for one body without gravity; optimum of Bannerman et al. (2011) and Sack et al. (2013)"
    show_rule(document, _DIMENSIONLESS, source, as_json)


@rules.command("sliding")
def rules_sliding(
    intensity: Annotated[str, typer.Option(help="Intensity [-], or an acceleration such as '0.2 g'.")],
    friction: Annotated[str, typer.Option(help="Coefficient of friction of bed and floor [-].")],
    as_json: AsJson = False,
) -> None:
    """Bed that slides as one block on a shaken floor, walls out of reach."""
    from graindamp.field import theory

    point = theory.sliding_bed(read_intensity("intensity", intensity) or 0.0, need_option("friction", friction, ""))
    show_rule(
        point._asdict(), dict.fromkeys(("loss_factor", "effective_mass_ratio"), "-"), "docs: theory, sliding", as_json
    )


@rules.command("bouncing-vertical")
def rules_bouncing_vertical(
    intensity: Annotated[str, typer.Option(help="Intensity [-], or an acceleration such as '1.5 g'.")],
    as_json: AsJson = False,
) -> None:
    """Plastic bed on a vertically shaken floor, no lid."""
    from graindamp.field import theory

    point = theory.bouncing_bed_vertical(read_intensity("intensity", intensity) or 0.0)
    show_rule(point._asdict(), _DIMENSIONLESS, "exact for one plastic body on a shaken floor under gravity", as_json)


@rules.command("coating")
def rules_coating(
    frequency: Annotated[Text, typer.Option(help="Design frequency [Hz]: gives the wall's modulus.")] = None,
    wall_modulus: Annotated[
        Text,
        typer.Option(
            help="Modulus of a coating at hand [Pa]: gives its frequency; with frequency, judged by the rule."
        ),
    ] = None,
    particle_radius: Annotated[
        str, typer.Option("--particle-radius", "--radius", help="Particle radius [m].")
    ] = "1.25 mm",
    bed_length: Annotated[str, typer.Option(help="Length of the bed along the motion [m].")] = "50 mm",
    n_line: Annotated[
        float | None, typer.Option(help="Particles in line along the motion [-], in place of bed-length.")
    ] = None,
    density: Annotated[str, typer.Option(help="Particle density [kg/m^3].")] = "7900 kg/m^3",
    youngs_modulus: Annotated[str, typer.Option(help="Particle Young's modulus [Pa].")] = "208 GPa",
    poisson: Annotated[float, typer.Option(help="Particle Poisson's ratio [-].")] = 0.3,
    wall_poisson: Annotated[float, typer.Option(help="Wall Poisson's ratio [-].")] = 0.5,
    intensity: Annotated[str, typer.Option(help="Intensity for the coating [-], or an acceleration.")] = "1",
    bounce_intensity: Annotated[str, typer.Option(help="Intensity for the clearance [-], or an acceleration.")] = "15",
    speed_ratio: Annotated[float, typer.Option(help="Impact speed over the container's amplitude [-].")] = 1.0,
    compression_ratio: Annotated[float, typer.Option(help="Stroke over compression of the coating [-].")] = 1.0,
    as_json: AsJson = False,
) -> None:
    """Elastic coating of the end walls that makes the bed efficient at low intensity, and the clearance that goes with
    it. Defaults are the damper that the rule was tested with.
    """
    from math import pi

    from graindamp.design.rules import clearance_for, coating_frequency, coating_modulus

    r = need_option("particle-radius", particle_radius, "m")
    length = need_option("bed-length", bed_length, "m")
    if r <= 0:
        raise InputError(f"--particle-radius: given '{particle_radius}'; a radius above 0 is needed")
    line = length / (2 * r) if n_line is None else n_line
    mass = 4 / 3 * pi * r**3 * _positive("density", density, "kg/m^3")
    particles = (line, mass, r, need_option("youngs-modulus", youngs_modulus, "Pa"), poisson, wall_poisson)
    level = read_intensity("intensity", intensity) or 0.0
    if frequency is None and wall_modulus is None:
        raise InputError("give --frequency, --wall-modulus, or both")
    at_hand = None
    if wall_modulus is not None:
        at_hand = coating_frequency(
            need_option("wall-modulus", wall_modulus, "Pa"),
            *particles,
            intensity=level,
            speed_ratio=speed_ratio,
            compression_ratio=compression_ratio,
        )
    rule = at_hand
    if frequency is not None:
        rule = coating_modulus(
            need_option("frequency", frequency, "Hz"),
            *particles,
            intensity=level,
            speed_ratio=speed_ratio,
            compression_ratio=compression_ratio,
        )
    assert rule is not None
    room = clearance_for(rule.frequency, read_intensity("bounce-intensity", bounce_intensity) or 0.0)
    units = {"wall_modulus": "Pa", "effective_modulus": "Pa", "frequency": "Hz", "n_line": "-", "particle_mass": "kg"}
    units |= {"clearance": "m", "stroke": "m", "wall_modulus_at_hand": "Pa", "frequency_at_hand": "Hz"}
    document = rule._asdict() | {"n_line": line, "particle_mass": mass, "clearance": room.clearance}
    document["stroke"] = room.stroke
    limits = rule.limits
    if at_hand is not None and at_hand is not rule:
        document |= {"wall_modulus_at_hand": at_hand.wall_modulus, "frequency_at_hand": at_hand.frequency}
        document["wall_modulus_over_rule"] = at_hand.wall_modulus / rule.wall_modulus
        units["wall_modulus_over_rule"] = "-"
        limits = limits or at_hand.limits
    document["note"] = limits
    show_rule(document, units, "Meyer & Seifried (2023), Eqs 11, 14, 20, 21", as_json)


@rules.command("clearance")
def rules_clearance(
    frequency: Annotated[Text, typer.Option(help="Frequency [Hz]: gives the clearance.")] = None,
    clearance: Annotated[Text, typer.Option(help="Clearance [m]: gives the frequency.")] = None,
    intensity: Annotated[str, typer.Option(help="Intensity to be best at [-], or an acceleration.")] = "15",
    as_json: AsJson = False,
) -> None:
    """Clearance that is best at a frequency and intensity, or the frequency for a clearance."""
    from graindamp.design.rules import clearance_for, frequency_for

    level = read_intensity("intensity", intensity) or 0.0
    if (frequency is None) == (clearance is None):
        raise InputError("give either --frequency or --clearance")
    if frequency is not None:
        rule = clearance_for(need_option("frequency", frequency, "Hz"), level)
    else:
        rule = frequency_for(need_option("clearance", clearance, "m"), level)
    units = {"clearance": "m", "stroke": "m", "frequency": "Hz", "intensity": "-"}
    show_rule(rule._asdict(), units, "Meyer & Seifried (2023), Eqs 11, 21", as_json)


@rules.command("efficiency")
def rules_efficiency(
    bed_mass: Annotated[str, typer.Option(help="Mass of all particles [kg].")],
    shape_squared: Annotated[Text, typer.Option(help="Squared mass-normalised shape at the damper [1/kg].")] = None,
    modal_mass: Annotated[Text, typer.Option(help="Modal mass at the damper [kg], in place of shape-squared.")] = None,
    loss_factor: Annotated[float, typer.Option(help="Loss factor eta [-].")] = 1.0,
    effective_mass_ratio: Annotated[float, typer.Option(help="Effective mass ratio m' [-].")] = 1.0,
    as_json: AsJson = False,
) -> None:
    """Damping ratio that a bed of given loss factor gives to a mode; defaults: the efficiency bound."""
    from graindamp.design.rules import efficiency_damping_ratio

    if (shape_squared is None) == (modal_mass is None):
        raise InputError("give either --shape-squared or --modal-mass")
    if shape_squared is not None:
        squared = need_option("shape-squared", shape_squared, "1/kg")
    else:
        mass = need_option("modal-mass", modal_mass, "kg")
        if mass <= 0:
            raise InputError(f"--modal-mass: given '{modal_mass}'; a mass above 0 is needed")
        squared = 1 / mass
    rule = efficiency_damping_ratio(squared, need_option("bed-mass", bed_mass, "kg"), loss_factor, effective_mass_ratio)
    units = dict.fromkeys(("damping_ratio", "specific_damping", "mass_ratio"), "-")
    show_rule(rule._asdict(), units, "Meyer & Seifried (2021), Eq. 18", as_json)
