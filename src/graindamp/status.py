"""What can go wrong at one operating point: one bit per cause, one remedy per bit."""

from enum import IntFlag


class Status(IntFlag):
    """State of one operating point; 0 is good. Bits add up; :data:`FATAL` ones leave NaN in place of values."""

    OK = 0
    NOT_FINITE = 1
    TOO_SHORT = 2
    CLIPPED = 4
    FREQUENCY_DRIFT = 8
    NOT_SINUSOIDAL = 16
    LENGTH_MISMATCH = 32
    RATE_MISMATCH = 64
    NO_MOTION = 128
    FREQUENCY_MISMATCH = 256
    NOT_STEADY = 512
    PHASE_UNCERTAIN = 1024
    DISTORTED = 2048
    MASS_MISMATCH = 4096
    NO_SOLUTION = 8192
    NOT_PASSIVE = 16384
    UNDERSAMPLED = 32768
    AMPLITUDE_DRIFT = 65536
    NO_FORCE = 131072
    LISTS_FULL = 262144
    PARTICLE_LOST = 524288
    LARGE_OVERLAP = 1048576
    FEW_STEPS = 2097152
    INTERRUPTED = 4194304
    NOT_CONVERGED = 8388608
    BISTABLE = 16777216
    NOT_COMPUTED = 33554432
    NOT_COVERED = 67108864
    IMPLAUSIBLE = 134217728


FATAL = (
    Status.NOT_FINITE
    | Status.TOO_SHORT
    | Status.CLIPPED
    | Status.FREQUENCY_DRIFT
    | Status.NOT_SINUSOIDAL
    | Status.LENGTH_MISMATCH
    | Status.RATE_MISMATCH
    | Status.NO_MOTION
    | Status.FREQUENCY_MISMATCH
    | Status.NO_SOLUTION
    | Status.UNDERSAMPLED
    | Status.NO_FORCE
    | Status.LISTS_FULL
    | Status.PARTICLE_LOST
    | Status.NOT_COMPUTED
    | Status.NOT_COVERED
)
"""Bits whose operating point has no usable value."""

REMEDY: dict[Status, str] = {
    Status.NOT_FINITE: "samples are NaN or infinite; cut them out or export the record again",
    Status.TOO_SHORT: "too few whole cycles remain; record at least 25 cycles after the transient",
    Status.CLIPPED: "samples stick at an extreme value; widen the input range of the channel and measure again",
    Status.FREQUENCY_DRIFT: "the driving frequency changes during the record; use stepped sine, not a sweep",
    Status.NOT_SINUSOIDAL: "the motion is not sinusoidal; control the shaker to a sine",
    Status.LENGTH_MISMATCH: "force and motion differ in length; export both channels of one record",
    Status.RATE_MISMATCH: "force and motion differ in sampling rate; resample them to one clock first",
    Status.NO_MOTION: "the container does not move; check the channel and its unit",
    Status.FREQUENCY_MISMATCH: "the motion does not oscillate at the given frequency; correct it or leave it out",
    Status.NOT_STEADY: "the value still drifts (bed compacts or its motion has not locked in); record longer",
    Status.PHASE_UNCERTAIN: "the phase between the channels is not known well enough; measure the empty container",
    Status.DISTORTED: "the motion carries harmonics above 5 % of its fundamental; the fundamental is used",
    Status.MASS_MISMATCH: "the empty run weighs other than the given container mass; check calibration and mass",
    Status.NO_SOLUTION: "the assumed motion does not exist at this operating point",
    Status.NOT_PASSIVE: "the loss factor is negative beyond its error; check sign and phase of the channels",
    Status.UNDERSAMPLED: "fewer than four samples per cycle; sample faster",
    Status.AMPLITUDE_DRIFT: "the amplitude of the motion changes during the record; use stepped sine at fixed level",
    Status.NO_FORCE: "the force channel is dead; check cable, amplifier and the name of the channel",
    Status.LISTS_FULL: "the lists of neighbours have no room left; the run makes more by itself, report this",
    Status.PARTICLE_LOST: "a particle left its container; lower the time step or stiffen the contact",
    Status.LARGE_OVERLAP: "particles overlap by more than 5 % of a radius; soften less",
    Status.FEW_STEPS: "the fastest impact lasted under 20 time steps; raise steps_per_contact or lower the time step",
    Status.INTERRUPTED: "the run was stopped before its end; the result is partial",
    Status.NOT_CONVERGED: "the standard error is above the tolerance at the limit of cycles; raise max_cycles or seeds",
    Status.BISTABLE: "the answer depends on where the bed started; both values are kept",
    Status.NOT_COMPUTED: "the point has not been computed; run the campaign on, or retry what failed",
    Status.NOT_COVERED: "the place lies outside the points that were simulated; add points there",
    Status.IMPLAUSIBLE: "numbers of a size that no shaker and damper have; check units of channels and masses",
}


def describe(status: int) -> list[str]:
    """Name and remedy of every bit set in `status`, one line each; empty when all is well."""
    return [f"{bit.name}: {REMEDY[bit]}" for bit in Status if bit and status & bit]
