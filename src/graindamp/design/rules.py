"""Closed-form design rules: clearance, coated walls, and the damping an efficient damper gives a mode.

"Meyer & Seifried (2021)" is Granular Matter 23, 64, on effective fields; "Meyer & Seifried (2023)" is Granular Matter
25, on inner structures and coated walls.
"""

from math import hypot, inf, isfinite, log1p, pi, sqrt
from typing import NamedTuple

from graindamp.errors import InputError
from graindamp.field.theory import collect_and_collide, stroke_ratio_best, stroke_ratio_min
from graindamp.units import STANDARD_GRAVITY

COATING_FREQUENCY_LIMIT = 100.0
"""Frequency above which the coating rule is an extrapolation [Hz]: a 55 MPa wall, by rule for 300 Hz, gave 500 Hz."""

COATING_FREQUENCIES_TESTED = (50.0, 80.0)
"""Lowest and highest frequency that coatings were designed and tested for [Hz]: Meyer & Seifried (2023), Table 3."""


class StrokeRule(NamedTuple):
    """Strokes at which a bed of a given clearance collects and collides."""

    stroke: float
    """Displacement amplitude of the largest loss factor [m]."""
    stroke_min: float
    """Displacement amplitude below which the motion does not exist [m]."""
    loss_factor: float
    """Loss factor eta at the best stroke [-]."""


class ClearanceRule(NamedTuple):
    """A clearance and the harmonic motion at which it works best."""

    clearance: float
    """Free travel h of the compacted bed [m]."""
    stroke: float
    """Displacement amplitude X_opt of the container [m]."""
    frequency: float
    """Frequency [Hz]."""
    intensity: float
    """Acceleration amplitude over gravity Gamma [-]."""


class CoatingRule(NamedTuple):
    """A coated wall and the frequency at which it works best."""

    wall_modulus: float
    """Young's modulus of the coating [Pa]."""
    effective_modulus: float
    """Effective Young's modulus of particle and coating in contact [Pa]."""
    frequency: float
    """Design frequency [Hz]."""
    extrapolated: bool
    """True above :data:`COATING_FREQUENCY_LIMIT`, where experiments contradict the rule."""

    @property
    def limits(self) -> str:
        """What tests say about the rule at this frequency; empty within :data:`COATING_FREQUENCIES_TESTED`."""
        low, high = COATING_FREQUENCIES_TESTED
        if self.extrapolated:
            return (
                f"above {COATING_FREQUENCY_LIMIT:g} Hz tests contradict the rule: a coating of 55 MPa, by rule for "
                "300 Hz, was best at about 500 Hz"
            )
        if self.frequency > high:
            return (
                f"tested from {low:g} to {high:g} Hz; a coating of 1.4 MPa, by rule for 88 Hz, was best around 100 Hz"
            )
        return f"tested from {low:g} to {high:g} Hz only" if self.frequency < low else ""


class DampingRule(NamedTuple):
    """What one damper adds to one mode at resonance."""

    damping_ratio: float
    """Damping ratio zeta [-]."""
    specific_damping: float
    """Energy dissipated per cycle over the largest energy of the mode Psi = 4 pi zeta [-]."""
    mass_ratio: float
    """Bed mass over modal mass at the damper phi^2 m_bed [-]."""


class DecayRule(NamedTuple):
    """What the free decay of a mode tells about its damper."""

    loss_factor: float
    """Loss factor eta of the damper [-]."""
    damping_ratio: float
    """Damping ratio zeta of the mode [-]."""


def optimal_stroke(clearance: float, restitution: float = 0.0) -> StrokeRule:
    """Displacement amplitude at which a damper of this clearance dissipates most [m], h / pi for a plastic bed.

    Limits: the bed bounces as one block, gravity and friction along the motion are small (Gamma above about 10). The
    clearance is that of the shaken, compacted bed; a freshly poured one compacts by 5 to 10 % of its height.

    Args:
        clearance: free travel h of the compacted bed [m], > 0.
        restitution: coefficient of restitution R of the bed as a whole and the wall [-], 0 <= R < 1; near 0 for many
            particles, whatever that of one particle.

    Raises:
        InputError: an argument outside its range.

    Source: Meyer & Seifried (2021), Eqs 6 and 7; for R > 0 see :func:`graindamp.field.theory.collect_and_collide`.
    """
    _check_positive(clearance=clearance)
    best = stroke_ratio_best(restitution)
    unit = clearance / pi
    return StrokeRule(
        best * unit, stroke_ratio_min(restitution) * unit, collect_and_collide(best, restitution).loss_factor
    )


def clearance_for(frequency: float, intensity: float = 15.0) -> ClearanceRule:
    """Clearance that puts the best stroke at a frequency and intensity [m]: h = pi Gamma g / Omega^2.

    Limits: as for :func:`optimal_stroke`. Gamma = 15 is the intensity at which, in tests from 50 to 80 Hz, the bouncing
    bed best complements a coated wall; the clearances set there were 1 to 4 % larger than this rule.

    Args:
        frequency: frequency of the container [Hz], > 0.
        intensity: Gamma, acceleration amplitude of the container over gravity [-], > 0.

    Raises:
        InputError: an argument outside its range.

    Source: Meyer & Seifried (2023), Eq. 21.
    """
    _check_positive(frequency=frequency, intensity=intensity)
    stroke = intensity * STANDARD_GRAVITY / (2.0 * pi * frequency) ** 2
    return ClearanceRule(pi * stroke, stroke, frequency, intensity)


def frequency_for(clearance: float, intensity: float = 15.0) -> ClearanceRule:
    """Frequency at which a clearance works best at an intensity [Hz]; inverse of :func:`clearance_for`.

    Args:
        clearance: free travel h of the compacted bed [m], > 0.
        intensity: Gamma, acceleration amplitude of the container over gravity [-], > 0.

    Raises:
        InputError: an argument outside its range.

    Source: Meyer & Seifried (2023), Eq. 21.
    """
    _check_positive(clearance=clearance, intensity=intensity)
    stroke = clearance / pi
    return ClearanceRule(clearance, stroke, sqrt(intensity * STANDARD_GRAVITY / stroke) / (2.0 * pi), intensity)


def coating_modulus(
    design_frequency: float,
    n_line: float,
    particle_mass: float,
    particle_radius: float,
    particle_youngs_modulus: float,
    particle_poisson: float,
    wall_poisson: float = 0.5,
    *,
    intensity: float = 1.0,
    speed_ratio: float = 1.0,
    compression_ratio: float = 1.0,
) -> CoatingRule:
    """Young's modulus of an end-wall coating that makes a damper efficient at low intensity [Pa].

    A line of n particles strikes the coating as one sphere, by Hertz's law; the coating is chosen such that its
    compression equals the stroke:

        E_eff = 15 n m_p a^2 b^(5/2) Omega^3 / (16 sqrt(Gamma g r_p)),

    from which the elasticity of the particle is taken off. Limits: empirical, tested with 3 mm coatings and steel balls
    of 1.25 mm radius from 50 to 80 Hz, where the moduli used were 6 to 64 % above the rule; polymers are viscoelastic,
    and their deformation is large for Hertz's law. Clearance: :func:`clearance_for` at the same frequency.

    Args:
        design_frequency: frequency of the container [Hz], > 0.
        n_line: particles in one line along the motion, length of the bed over particle diameter [-], >= 1.
        particle_mass: mass of one particle [kg], > 0.
        particle_radius: particle radius [m], > 0.
        particle_youngs_modulus: Young's modulus of the particles [Pa], > 0.
        particle_poisson: Poisson's ratio of the particles [-], > -1 and <= 0.5.
        wall_poisson: Poisson's ratio of the coating [-], > -1 and <= 0.5; 0.5 for rubber-like polymers.
        intensity: Gamma at which the coating shall work [-], > 0.
        speed_ratio: a, impact speed over velocity amplitude of the container [-], > 0; the source assumes 1.
        compression_ratio: b, stroke over largest compression of the coating [-], > 0; the source found 1.

    Raises:
        InputError: an argument outside its range, or no coating stiff enough exists.

    Source: Meyer & Seifried (2023), Eqs 12 to 20.
    """
    _check_positive(design_frequency=design_frequency, particle_youngs_modulus=particle_youngs_modulus)
    scale = _coating_scale(n_line, particle_mass, particle_radius, intensity, speed_ratio, compression_ratio)
    effective = scale * (2.0 * pi * design_frequency) ** 3
    particle = particle_youngs_modulus / _plane_strain("particle_poisson", particle_poisson)
    if effective >= particle:
        raise InputError(
            f"design_frequency is {design_frequency:g} Hz and needs an effective modulus of {effective:.3g} Pa, but "
            f"with these particles even a rigid wall gives only {particle:.3g} Pa; lower the frequency or n_line"
        )
    wall = _plane_strain("wall_poisson", wall_poisson) / (1.0 / effective - 1.0 / particle)
    return CoatingRule(wall, effective, design_frequency, design_frequency > COATING_FREQUENCY_LIMIT)


def coating_frequency(
    wall_modulus: float,
    n_line: float,
    particle_mass: float,
    particle_radius: float,
    particle_youngs_modulus: float,
    particle_poisson: float,
    wall_poisson: float = 0.5,
    *,
    intensity: float = 1.0,
    speed_ratio: float = 1.0,
    compression_ratio: float = 1.0,
) -> CoatingRule:
    """Frequency for which a coating of given Young's modulus is made [Hz]; inverse of :func:`coating_modulus`.

    Args:
        wall_modulus: Young's modulus of the coating [Pa], > 0.
        n_line: as for :func:`coating_modulus`, like all that follow.
        particle_mass: [kg].
        particle_radius: [m].
        particle_youngs_modulus: [Pa].
        particle_poisson: [-].
        wall_poisson: [-].
        intensity: [-].
        speed_ratio: [-].
        compression_ratio: [-].

    Raises:
        InputError: an argument outside its range.

    Source: Meyer & Seifried (2023), Eqs 12 to 20.
    """
    scale = _coating_scale(n_line, particle_mass, particle_radius, intensity, speed_ratio, compression_ratio)
    _check_positive(wall_modulus=wall_modulus, particle_youngs_modulus=particle_youngs_modulus)
    particle = particle_youngs_modulus / _plane_strain("particle_poisson", particle_poisson)
    wall = wall_modulus / _plane_strain("wall_poisson", wall_poisson)
    effective = 1.0 / (1.0 / particle + 1.0 / wall)
    frequency = (effective / scale) ** (1.0 / 3.0) / (2.0 * pi)
    return CoatingRule(wall_modulus, effective, frequency, frequency > COATING_FREQUENCY_LIMIT)


def efficiency_damping_ratio(
    shape_squared: float, bed_mass: float, loss_factor: float = 1.0, effective_mass_ratio: float = 1.0
) -> DampingRule:
    """Damping ratio that a damper of given loss factor gives a mode at its resonance [-].

        zeta = mu eta / (2 (1 + mu m')),   Psi = 2 pi eta mu / (1 + mu m') = 4 pi zeta,   mu = phi^2 m_bed.

    With the default eta = m' = 1 it is the yardstick of an efficient damper. Limits: the mode has no other damping,
    keeps its shape, and zeta << 1; the damper does not rotate.

    Args:
        shape_squared: square of the mode shape at the damper, normalised to unit modal mass [1/kg], >= 0.
        bed_mass: mass of all particles [kg], > 0.
        loss_factor: eta of the damper at the operating point [-], >= 0.
        effective_mass_ratio: m' at the operating point [-], any sign.

    Raises:
        InputError: an argument outside its range, or an effective mass so negative that the modal mass vanishes.

    Source: Meyer & Seifried (2021), Eq. 18, with eta and m' kept.
    """
    _check_positive(bed_mass=bed_mass)
    _check("shape_squared", shape_squared, shape_squared >= 0, ">= 0")
    _check("loss_factor", loss_factor, loss_factor >= 0, ">= 0")
    from graindamp.couple.balance import damping_ratio_of

    mass_ratio = shape_squared * bed_mass
    _loaded_mass(mass_ratio, effective_mass_ratio)
    damping_ratio = float(damping_ratio_of(shape_squared, bed_mass, loss_factor, effective_mass_ratio))
    return DampingRule(damping_ratio, 4.0 * pi * damping_ratio, mass_ratio)


def loss_factor_from_decay(decay: float, mass_ratio: float, effective_mass_ratio: float = 1.0) -> DecayRule:
    """Loss factor of the damper that explains the energy a mode loses in one cycle of free vibration [-].

    Limits: as for :func:`efficiency_damping_ratio`; the loss factor is a mean over the amplitudes of the cycle.

    Args:
        decay: share of its energy that the mode loses in one cycle, 1 - (V_next / V)^2 of successive peaks [-],
            >= 0 and < 1.
        mass_ratio: bed mass over modal mass at the damper phi^2 m_bed [-], > 0.
        effective_mass_ratio: m' of the damper [-], any sign.

    Raises:
        InputError: an argument outside its range, or an effective mass so negative that the modal mass vanishes.

    Source: logarithmic decrement of a linear oscillator, and Meyer & Seifried (2021), Eq. 18.
    """
    _check("decay", decay, 0 <= decay < 1, ">= 0 and < 1")
    _check_positive(mass_ratio=mass_ratio)
    decrement = -log1p(-decay) / 2.0
    damping_ratio = decrement / hypot(2.0 * pi, decrement)
    return DecayRule(2.0 * damping_ratio * _loaded_mass(mass_ratio, effective_mass_ratio) / mass_ratio, damping_ratio)


def _loaded_mass(mass_ratio: float, effective_mass_ratio: float) -> float:
    """Modal mass with the damper's effective mass, over that without [-]."""
    loaded = 1.0 + mass_ratio * effective_mass_ratio
    _check(
        "effective_mass_ratio",
        effective_mass_ratio,
        loaded > 0,
        f"above {-1.0 / mass_ratio if mass_ratio else -inf:g}, minus one over the mass ratio",
    )
    return loaded


def _coating_scale(
    n_line: float,
    particle_mass: float,
    particle_radius: float,
    intensity: float,
    speed_ratio: float,
    compression_ratio: float,
) -> float:
    """Effective modulus over Omega^3 [Pa s^3]."""
    _check("n_line", n_line, n_line >= 1, ">= 1")
    _check_positive(
        particle_mass=particle_mass,
        particle_radius=particle_radius,
        intensity=intensity,
        speed_ratio=speed_ratio,
        compression_ratio=compression_ratio,
    )
    mass = n_line * particle_mass * speed_ratio**2 * compression_ratio**2 * sqrt(compression_ratio)
    return 15.0 * mass / (16.0 * sqrt(intensity * STANDARD_GRAVITY * particle_radius))


def _plane_strain(poisson_name: str, poisson: float) -> float:
    """1 - nu^2 [-]."""
    _check(poisson_name, poisson, -1 < poisson <= 0.5, "> -1 and <= 0.5")
    return 1.0 - poisson * poisson


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        _check(name, value, value > 0, "> 0")


def _check(name: str, value: float, allowed: bool, text: str) -> None:
    if not (isfinite(value) and allowed):
        raise InputError(f"{name} is {value}, but must be a finite number {text}")
