"""`graindamp rules impact`, `layers` and `beta`: one-ball dampers, and beds of several layers."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from graindamp.cli.options import AsJson, need_option, read_option, show_rule
from graindamp.errors import InputError

if TYPE_CHECKING:
    from graindamp.field.theory import TheoryPoint

Text = str | None
WITT = "Witt (2011), Particle impact damping in the horizontal plane, Texas A&M University"


def register_impact(rules: typer.Typer) -> None:
    """Add the commands of this module to `graindamp rules`."""
    rules.command("impact")(rules_impact)
    rules.command("layers")(rules_layers)
    rules.command("beta")(rules_beta)


def rules_impact(
    amplitude: Annotated[Text, typer.Option(help="Displacement amplitude U of the cavity [m].")] = None,
    clearance: Annotated[Text, typer.Option(help="Free travel d of the ball [m]; without it, the tuned one.")] = None,
    restitution: Annotated[str, typer.Option(help="Restitution of ball and wall [-], 0 to below 1.")] = "0",
    mass_ratio: Annotated[str, typer.Option(help="Mass of the ball over modal mass at the cavity [-].")] = "0.01",
    as_json: AsJson = False,
) -> None:
    """One ball between two walls: the clearance for an amplitude, the reverse, and the damping of both together."""
    from math import pi

    from graindamp.field.theory import collect_and_collide
    from graindamp.impact import collision, tuning

    e, mu = need_option("restitution", restitution, ""), need_option("mass-ratio", mass_ratio, "")
    u, d = read_option("amplitude", amplitude, "m"), read_option("clearance", clearance, "m")
    if u is None and d is None:
        raise InputError("give --amplitude, --clearance, or both")
    tuned = tuning.tuned_clearance(u, e) if u is not None else tuning.working_range(d or 0.0, e)
    at_hand = tuning.working_range(d, e) if d is not None else tuned
    document: dict[str, Any] = {
        "clearance": at_hand.clearance,
        "amplitude_best": at_hand.amplitude,
        "amplitude_min": at_hand.amplitude_min,
        "amplitude_stable_max": at_hand.amplitude_stable_max,
        "head_on_psi_m": collision.head_on_specific_damping(mu, e),
    }
    if u is not None:
        alpha = u / at_hand.clearance
        first = collision.first_impact(alpha, mu, e)
        document |= {
            "clearance_tuned": tuned.clearance,
            "clearance_head_on": pi * u,
            "alpha": alpha,
            "first_impact_phase": first.phase,
            "first_impact_approach": first.approach,
            "first_impact_psi_m": first.specific_damping,
        }
        steady = collect_and_collide(pi * alpha, e)
        note = ""
        if not steady.exists:
            note = "no steady motion with two impacts per cycle at this amplitude and clearance"
        elif u > at_hand.amplitude_stable_max:
            note = "the steady motion is unstable; motions nearby give similar damping"
        document |= {
            "steady_motion": steady.branch,
            "steady_loss_factor": steady.loss_factor,
            "steady_psi_m": _psi_m(steady, mu),
            "note": note,
        }
    units = dict.fromkeys(("clearance", "amplitude_best", "amplitude_min", "amplitude_stable_max"), "m")
    units |= {"clearance_tuned": "m", "clearance_head_on": "m", "alpha": "-", "first_impact_phase": "rad"}
    units |= dict.fromkeys(("first_impact_approach", "first_impact_psi_m", "head_on_psi_m"), "-")
    units |= {"steady_loss_factor": "-", "steady_psi_m": "-"}
    show_rule(document, {k: v for k, v in units.items() if k in document}, f"{WITT}, chapter 2; docs: impact", as_json)


def _psi_m(steady: "TheoryPoint", mass_ratio: float) -> float:
    """Mass-normalised specific damping of a steady motion [-]; NaN where it does not exist or leaves no mode."""
    from graindamp.impact.collision import mass_normalised, specific_damping_of

    if not steady.exists or 1.0 + mass_ratio * steady.effective_mass_ratio <= 0.0:
        return float("nan")
    psi = specific_damping_of(steady.loss_factor, mass_ratio, steady.effective_mass_ratio)
    return mass_normalised(psi, mass_ratio)


def rules_layers(
    bed_height: Annotated[str, typer.Option(help="Height of the bed in the direction of gravity [m].")],
    diameter: Annotated[str, typer.Option(help="Particle diameter [m].")],
    as_json: AsJson = False,
) -> None:
    """Layers of equal spheres in a bed, in both readings of the rule, and when the top one begins to move."""
    from graindamp.design.layers import critical_intensity, layers

    height, size = need_option("bed-height", bed_height, "m"), need_option("diameter", diameter, "m")
    planar, packed = layers(height, size, "planar"), layers(height, size, "close-packed")
    document = {
        "layers": planar.rounded,
        "layers_exact": planar.layers,
        "layers_close_packed": packed.rounded,
        "layers_close_packed_exact": packed.layers,
        "spacing": planar.spacing,
        "spacing_close_packed": packed.spacing,
        "critical_intensity": critical_intensity(),
    }
    units = dict.fromkeys(document, "-") | {"spacing": "m", "spacing_close_packed": "m"}
    show_rule(document, units, f"{WITT}, Eqs 4.1, 4.3", as_json)


def rules_beta(
    amplitude: Annotated[str, typer.Option(help="Displacement amplitude of the cavity [m].")],
    frequency: Annotated[str, typer.Option(help="Frequency [Hz].")],
    diameter: Annotated[str, typer.Option(help="Particle diameter [m].")],
    bed_height: Annotated[str, typer.Option(help="Height of the bed in the direction of gravity [m].")],
    cavity_height: Annotated[str, typer.Option(help="Height of the cavity in the direction of gravity [m].")],
    as_json: AsJson = False,
) -> None:
    """Dimensionless acceleration on which the damping by beds of several layers collapses."""
    from graindamp.design.layers import beta

    rule = beta(
        need_option("amplitude", amplitude, "m"),
        need_option("frequency", frequency, "Hz"),
        need_option("diameter", diameter, "m"),
        need_option("bed-height", bed_height, "m"),
        need_option("cavity-height", cavity_height, "m"),
    )
    units = dict.fromkeys(("beta", "intensity", "diameter_ratio", "fill_ratio"), "-")
    show_rule(rule._asdict(), units, f"{WITT}, Eq. 4.4", as_json)
