"""Description of a shaker measurement: files, channels, masses."""

from typing import Literal

from pydantic import Field

from graindamp.spec.model import Spec
from graindamp.spec.quantity import Angle, Frequency, Length, Mass, MassOrZero


class ChannelsSpec(Spec):
    """Which column, dataset, variable or record of a file is what, where its own names do not tell."""

    force: str | None = None
    """Name of the force channel; default: recognised by its name, unit or UFF data type."""
    motion: str | None = None
    """Name of the velocity, acceleration or displacement channel; default: recognised likewise."""
    motion_kind: Literal["velocity", "acceleration", "displacement"] | None = None
    """What the motion channel measures; default: told by its name, unit or UFF data type."""
    force_unit: str | None = None
    """Unit of the force channel, such as "kN"; default: as the file says, else N."""
    motion_unit: str | None = None
    """Unit of the motion channel, such as "mm/s"; default: as the file says, else SI."""
    force_sign: Literal[1, -1] = 1
    """-1 when the sensor's positive force points against the positive motion (compression positive), else 1."""
    sampling_rate: Frequency | None = None
    """Samples per second [Hz], > 0; default: as the file says or its time column."""
    with_force: bool = True
    """False where the motion alone is read and no force looked for, as of a free decay; default true."""


class MeasurementSpec(Spec):
    """Force and motion signals of one damper on a shaker, at any number of operating points."""

    files: tuple[str, ...] = Field(min_length=1)
    """Signal files (.csv .txt .h5 .hdf5 .mat .uff .unv), relative to this description."""
    empty_files: tuple[str, ...] = ()
    """Signal files of the empty container, for the phase between the channels."""
    name: str = "damper"
    """Name of the damper in tables and figures."""
    description: str = ""
    """Particles, container, fill and direction of gravity in words."""
    bed_mass: Mass | None = None
    """Mass of all particles [kg], > 0; default: as the files say."""
    container_mass: MassOrZero | None = None
    """Mass of the empty container and all that moves beyond the force sensor [kg], >= 0; default: as the files say."""
    clearance: Length | None = None
    """Free travel h of the compacted bed along the motion [m], > 0; draws the stroke lines X = h / pi."""
    frequency: Frequency | None = None
    """Driving frequency of all files [Hz], > 0; default: as each file says, else found from the motion."""
    skip_cycles: int | None = Field(default=None, ge=0)
    """Cycles to drop at the start of each record, >= 0; default: the transient is detected."""
    phase_uncertainty: Angle = 0.017453292519943295
    """Phase error assumed between force and motion where no empty-container run tells it [rad], >= 0; default 1 deg."""
    channels: ChannelsSpec = ChannelsSpec()
    """Names, units and sign of the channels."""
