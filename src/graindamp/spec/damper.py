"""What a damper is, as far as its coupling to a structure needs to know."""

from graindamp.spec.model import Spec
from graindamp.spec.quantity import Length, Mass, MassOrZero


class DamperSpec(Spec):
    """A container of particles."""

    name: str = "damper"
    """Name of the damper in tables and figures."""
    bed_mass: Mass
    """Mass of all particles [kg], > 0."""
    container_mass: MassOrZero = 0.0
    """Mass of the empty container [kg], >= 0."""
    clearance: Length | None = None
    """Free travel h of the compacted bed along the motion [m], > 0; draws the stroke lines X = h / pi."""
    description: str = ""
    """Particles, container, fill and direction of gravity in words."""
