"""Records with known answers, for every test that needs a measurement."""

import numpy as np

from graindamp.signals.record import Record


def record_of(
    bed_force,
    frequency=100.0,
    velocity_amplitude=0.3,
    n_cycle=30,
    sampling_rate=39215.7,
    container_mass=0.085,
    motion_kind="velocity",
    delay=0.0,
    noise=0.0,
    seed=1,
    tell_frequency=True,
    **extra,
):
    """Container moving as x = X sin(omega t), driven by its own inertia plus `bed_force(angle)` [N].

    The force channel comes `delay` [s] late; `noise` is a share of each channel's rms.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(int(n_cycle * sampling_rate / frequency)) / sampling_rate
    omega = 2 * np.pi * frequency
    late = omega * (time - delay)
    force = -container_mass * omega * velocity_amplitude * np.sin(late) + bed_force(late)
    motion = {
        "velocity": velocity_amplitude * np.cos(omega * time),
        "acceleration": -velocity_amplitude * omega * np.sin(omega * time),
        "displacement": velocity_amplitude / omega * np.sin(omega * time),
    }[motion_kind]
    force = force + noise * np.std(force) * rng.normal(size=len(time))
    motion = motion + noise * np.std(motion) * rng.normal(size=len(time))
    return Record(
        force, motion, motion_kind, sampling_rate, sampling_rate, frequency if tell_frequency else None, **extra
    )


def linear_bed(loss_factor, mass_ratio, bed_mass, frequency, velocity_amplitude):
    """Force of a bed with complex effective mass m_bed (m' - i eta), acceleration -omega V sin(angle)."""
    scale = bed_mass * 2 * np.pi * frequency * velocity_amplitude
    # F = Re[M A exp(i angle)] with A = i omega V: M A = omega V m_bed (i m' + eta).
    return lambda angle: scale * (loss_factor * np.cos(angle) - mass_ratio * np.sin(angle))
