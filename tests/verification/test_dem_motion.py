"""The container moves as described: displacement against closed forms, velocity and acceleration as its derivatives."""

from math import pi, sqrt

import numpy as np
import pytest

from dem_made import damper_of, made
from graindamp.dem.engine import run
from graindamp.dem.excitation import motion_of, read_series
from graindamp.dem.motion import move
from graindamp.errors import InputError
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec

STANDARD = 9.80665
"""Intensities are multiples of this [m/s^2]."""
OBLIQUE = np.array([0.6, 0.0, 0.8])


def described(motion):
    """A motion as its description is read."""
    damper = {
        "particles": [{"material": "steel-s235", "radius": 1e-3}],
        "fill": {"count": 1},
        "container": {"kind": "box", "size": [0.1, 0.1, 0.1], "material": "steel-s235"},
        "contact": {"restitution": 0.5, "friction": 0.0},
    }
    whole = {"damper": damper, "motion": motion, "run": {}}
    return parse_spec(whole, SimulationSpec, "made").motion


def moved(motion, time):
    """Displacement, velocity and acceleration of the container at many times; (3, time, 3)."""
    found = np.empty((3, len(time), 3))
    for k, now in enumerate(time):
        move(0, now, motion)
        found[:, k] = motion.displacement[0], motion.velocity[0], motion.acceleration[0]
    return found


def risen(time, duration):
    """Soft start as the docs print it."""
    s = np.minimum(time / duration, 1.0)
    return 10 * s**3 - 15 * s**4 + 6 * s**5


def sine(time):
    return OBLIQUE * (0.5 * STANDARD / (2 * pi * 40) ** 2 * np.sin(2 * pi * 40 * time + 0.3))[:, None]


def soft_sine(time):
    return np.eye(3)[0] * (2e-3 * np.sin(2 * pi * 40 * time) * risen(time, 1.5 / 40))[:, None]


def ellipse(time):
    x = 1e-3 * np.sin(2 * pi * 50 * time)
    y = 0.4 / (2 * pi * 130) * np.sin(2 * pi * 130 * time + 1.0)
    return risen(time, 2.0 / 50)[:, None] * np.column_stack([x, 0 * x, y])


SWEEP = {"kind": "sweep", "start": 20.0, "stop": 80.0, "duration": 0.5, "direction": "z"}


def swept(time, law, power, size):
    """A sweep along z from its phase, the integral of the frequency: displacement size omega^-power sin(phase)."""
    first, last, duration = 2 * pi * 20.0, 2 * pi * 80.0, 0.5
    if law == "linear":
        omega = first + (last - first) * time / duration
        phase = first * time + (last - first) * time**2 / (2 * duration)
    else:
        rate = np.log(last / first) / duration
        omega = first * np.exp(rate * time)
        phase = (omega - first) / rate
    return np.array([0.0, 0.0, 1.0]) * (size * omega**-power * np.sin(phase))[:, None]


KINDS = {
    "harmonic": (
        {"kind": "harmonic", "frequency": 40.0, "intensity": 0.5, "direction": [0.6, 0.0, 0.8], "phase": 0.3},
        sine,
    ),
    "soft start": (
        {"kind": "harmonic", "frequency": 40.0, "amplitude": 2e-3, "direction": "x", "soft_start": 1.5},
        soft_sine,
    ),
    "harmonics": (
        {
            "kind": "harmonics",
            "direction": "x",
            "soft_start": 2.0,
            "components": [
                {"frequency": 130.0, "speed": 0.4, "phase": 1.0, "direction": "z"},
                {"frequency": 50.0, "amplitude": 1e-3},
            ],
        },
        ellipse,
    ),
    "sweep at constant amplitude": ({**SWEEP, "amplitude": 1e-3}, lambda t: swept(t, "linear", 0, 1e-3)),
    "sweep at constant speed": ({**SWEEP, "speed": 0.2, "law": "log"}, lambda t: swept(t, "log", 1, 0.2)),
    "sweep at constant intensity": ({**SWEEP, "intensity": 2.0}, lambda t: swept(t, "linear", 2, 2.0 * STANDARD)),
}


def assert_derivatives(motion, time, fastest, rel=1e-7):
    """Velocity and acceleration are those of the displacement, along the times given, whose fastest angular frequency
    is `fastest` [rad/s]."""
    step = 0.02 / fastest
    weight = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0  # central, sixth order
    shifted = np.stack([moved(motion, time + k * step) for k in range(-3, 4)])
    for order in (0, 1):
        slope = np.tensordot(weight, shifted[:, order], 1) / step
        exact = shifted[3, order + 1]
        # 0.02^6/140 of the series is left out, 5e-13; rounding is 1e-16/0.02. A soft start's third derivative jumps at
        # its ends, and soft starts, sweeps and quintics hold higher frequencies than `fastest`.
        np.testing.assert_allclose(slope, exact, atol=rel * abs(exact).max())


@pytest.mark.parametrize("kind", KINDS)
def test_container_moves_as_described(kind):
    description, displacement = KINDS[kind]
    motion = motion_of(described(description))
    time = np.linspace(0.003, 0.49, 211)
    found = moved(motion, time)[0]
    expected = displacement(time)
    np.testing.assert_allclose(found, expected, atol=1e-12 * abs(expected).max())  # rounding of a phase of some 100
    assert_derivatives(motion, time, 2 * pi * 130)


@pytest.mark.parametrize(("kind", "column"), [("amplitude", 0), ("speed", 1), ("intensity", 2)])
def test_a_sweep_keeps_what_it_is_named_for(kind, column):
    """Peaks of displacement, velocity or acceleration stay what is asked, up to the sweep's rate over its frequency."""
    description, _ = KINDS[f"sweep at constant {kind}"]
    strength = {"amplitude": 1e-3, "speed": 0.2, "intensity": 2.0 * STANDARD}[kind]
    time = np.linspace(0.0, 0.5, 10001)
    value = abs(moved(motion_of(described(description)), time)[column, :, 2])
    peak = value[1:-1][(value[1:-1] > value[:-2]) & (value[1:-1] >= value[2:])]
    assert len(peak) > 40  # twice per cycle, 25 cycles in the linear sweep, 22 in the other
    # Rate over frequency, 2 pi 120/(2 pi 20)^2 = 0.048 at the start, stands at right angles to the sine and counts by
    # its square, 2.3e-3, at constant intensity; measured 2.6e-3. At the end it is 16 times smaller, and what is left
    # are peaks between samples, (2 pi 80 x 25 us)^2/2 = 8e-5.
    np.testing.assert_allclose(peak, strength, rtol=5e-3)
    np.testing.assert_allclose(peak[-10:], strength, rtol=2e-4)


@pytest.mark.parametrize("kind", [*KINDS, "random"])
def test_recorded_velocity_is_that_of_the_description(kind):
    """Block means of the container's velocity in a run are displacements over a block, divided by its time."""
    description = RANDOM if kind == "random" else KINDS[kind][0]
    motion, other = motion_of(described(description)), motion_of(described(description))
    time_step, stride, n_sample = 2e-5, 5, 400
    worlds = made(
        damper_of(),
        time_step,
        [[0.0, 0.0, 5.0]],
        1e-3,
        motion=motion,
        n_sample=n_sample,
        stride=stride,
    )
    worlds = run(worlds, n_sample * stride)
    recorded = worlds.record.series[0, :n_sample, -1]
    # A block holds the steps that end in it, so that its mean belongs to half a step later than its middle.
    edge = time_step * (stride * np.arange(n_sample + 1) + 0.5)
    expected = np.diff(moved(other, edge)[0], axis=0) / (stride * time_step)
    # The mean over steps against the integral: (omega time step)^2 / 24 at 200 Hz, 3e-5.
    np.testing.assert_allclose(recorded, expected, atol=1e-4 * abs(expected).max())


def test_container_rests_before_the_motion_starts():
    motion = motion_of(described(KINDS["harmonic"][0]), start=0.1)
    assert not moved(motion, [0.0, 0.0999]).any()
    expected = sine(np.array([0.02]))
    np.testing.assert_allclose(moved(motion, [0.12])[0], expected, rtol=1e-12)  # rounding


@pytest.mark.parametrize("quantity", ["acceleration", "velocity", "displacement"])
def test_a_measured_series_becomes_the_motion_it_was_taken_from(tmp_path, quantity):
    """Samples of a closed form in a file with a unit: the container follows the closed form between them too."""
    omega, n = 2 * pi * 25, 401
    time = np.linspace(1.0, 1.4, n)  # records need not begin at 0
    phase = omega * (time - 1.0)
    value, unit = {
        "acceleration": (-(omega**2) * 1e-3 * np.sin(phase) / STANDARD, "g"),
        "velocity": (omega * 1e-3 * np.cos(phase) * 1e3, "mm/s"),
        "displacement": (1e-3 * np.sin(phase) * 1e3, "mm"),
    }[quantity]
    np.savetxt(tmp_path / "motion.csv", np.column_stack([time, value]), delimiter=",", header="time,value", comments="")
    told = {"kind": "series", "file": "motion.csv", "quantity": quantity, "unit": unit, "direction": "z"}
    motion = motion_of(described(told), folder=tmp_path)
    now = np.linspace(0.01, 0.39, 333)
    found = moved(motion, now)[:, :, 2]
    exact = 1e-3 * np.array([np.sin(omega * now), omega * np.cos(omega * now), -(omega**2) * np.sin(omega * now)])
    assert found.shape == exact.shape
    for k in range(3):
        scale = 1e-3 * omega**k
        # 40 samples per cycle: a cubic spline is right to (2 pi/40)^4/384 = 2e-6, ten times less well at the ends of
        # the record, its slope to (2 pi/40)^3/24 = 2e-4.
        np.testing.assert_allclose(found[k], exact[k], atol=3e-4 * scale)
    # Quintics meet value and two derivatives at every sample, and are differentiated exactly between them.
    assert_derivatives(motion, now[::7] + 1.3e-4, omega, rel=1e-5)


RANDOM = {
    "kind": "random",
    "frequencies": [20.0, 50.0, 200.0],
    "psd": [0.5, 2.0, 0.2],
    "duration": 1.0,
    "seed": 4,
    "direction": "y",
}
"""Corners [Hz] and densities [(m/s^2)^2/Hz]."""


def test_random_motion_has_the_density_that_was_asked_for():
    """Every line of the spectrum, and the mean square against the integral of the density between its corners."""
    motion = motion_of(described(RANDOM))
    n = 2048
    acceleration = moved(motion, np.arange(n) / n)[2, :, 1]
    line = np.fft.rfft(acceleration) / n
    density = 2.0 * abs(line) ** 2  # lines are 1 Hz apart
    frequency = np.arange(n // 2 + 1)
    inside = (frequency >= 20) & (frequency <= 200)
    expected = np.interp(np.log(frequency[inside]), np.log([20, 50, 200]), np.log([0.5, 2.0, 0.2]))
    # Amplitudes are the density's, only phases are drawn; quintics add 1e-7 and what they fold back.
    np.testing.assert_allclose(density[inside], np.exp(expected), rtol=1e-5)
    assert density[~inside].max() < 1e-10 * density.max()

    def integral(f, g, p, q):
        """Of a density linear on two logarithmic axes from p at f to q at g."""
        slope = np.log(q / p) / np.log(g / f)
        return (q * g - p * f) / (slope + 1.0)

    power = integral(20, 50, 0.5, 2.0) + integral(50, 200, 2.0, 0.2)
    # The sum over lines counts half of the first and last one too much: (0.5 + 0.2)/2 of 158 (m/s^2)^2.
    assert np.mean(acceleration**2) == pytest.approx(power, rel=4e-3)
    assert not np.allclose(moved(motion_of(described({**RANDOM, "seed": 5})), [0.3]), moved(motion, [0.3]))


def test_random_motion_is_a_gaussian_process_whose_derivatives_agree():
    motion = motion_of(described(RANDOM))
    # Quintics between 32 samples of the highest frequency: second derivative to (2 pi/32)^4/720 = 2e-6.
    assert_derivatives(motion, np.linspace(0.01, 0.98, 101), 2 * pi * 200, rel=1e-5)
    value = np.concatenate(
        [moved(motion_of(described({**RANDOM, "seed": s})), np.arange(1000) / 1000)[2, :, 1] for s in range(4)]
    )
    kurtosis = np.mean(value**4) / np.mean(value**2) ** 2
    # 4 s of a band 180 Hz wide are 1440 independent values, whose kurtosis has a standard error of sqrt(24/1440): four.
    assert kurtosis == pytest.approx(3.0, abs=4 * sqrt(24 / 1440))


def test_random_motion_repeats_after_its_duration():
    """One second of lines 1 Hz apart, three times on end; the places in the series differ by the rounding of time."""
    motion = motion_of(described(RANDOM))
    time = np.linspace(0.0, 0.99, 34)
    once = moved(motion, time)
    for k in (1, 2):
        np.testing.assert_allclose(moved(motion, time + k), once, atol=1e-9 * abs(once).max())


@pytest.mark.parametrize(
    ("text", "unit", "told"),
    [
        ("time,a\n0,1\n1,2\n", "kg", "unit: given 'kg'"),
        ("", None, "it has no numbers"),
        ("time,a\n", None, "it has no numbers"),
    ],
)
def test_a_series_that_cannot_be_read_is_told(tmp_path, text, unit, told):
    path = tmp_path / "series.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=told):
        read_series(path, "time", None, unit, "m/s^2")
