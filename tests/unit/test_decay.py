"""Free decays: what is refused and why, what is flagged, where a decay begins and ends, errors, bins."""

import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.signals import decay_local as local
from graindamp.signals.decay import DecayRecord, analyze_decay, band_pass, coarse_frequency, mass_normalised
from graindamp.signals.decay_errors import cycle_sensitivity, moving_average, spread
from graindamp.signals.decay_noise import white_noise
from graindamp.signals.decay_repeats import combine
from graindamp.spec.decay import DecayMethodSpec, DecaySpec
from graindamp.spec.model import parse_spec

RATE, FREQUENCY = 1000.0, 20.0
TIME = np.arange(4000) / RATE


def ring(zeta=0.01, frequency=FREQUENCY, time=TIME, amplitude=1.0):
    """A viscous decay that begins with its largest peak a quarter of a cycle late."""
    return amplitude * np.exp(-zeta * 2 * np.pi * frequency * time) * np.sin(2 * np.pi * frequency * time)


def analysed(motion, quantity="velocity", rate=RATE, **method):
    return analyze_decay(DecayRecord(motion, quantity, rate, "run", "run.csv"), DecayMethodSpec(**method))


# What no decay can be found in --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (np.zeros(4000), r"run.csv: the velocity is constant \(0 m/s\)"),
        (np.full(4000, 3.0), r"constant \(3 m/s\)"),
        (
            np.where(TIME == 1.0, np.nan, ring()),
            "1 of 4000 velocity samples are NaN or infinite, the first at sample 1001",
        ),
        (np.where(TIME >= 3.999, np.inf, ring()), "first at sample 4000"),
        (ring()[:30], "30 samples; a decay needs one signal of at least 40"),
        (ring().reshape(2, -1), "2x2000 samples"),
        (ring()[:110], "peaks in a row of an oscillation of .* Hz, 6 are needed"),
        (ring(zeta=-0.01), "the largest at 3.9.* s of 4 s, where a decay would have died away"),
        (np.sin(2 * np.pi * FREQUENCY * TIME), "does not decay: 1 m/s at .* is it still driven"),
        (TIME, "1 peaks in a row of an oscillation of 0.75 Hz"),
        ((TIME > 2.0).astype(float), "1 peaks in a row of an oscillation of 0.75 Hz"),
        (ring(frequency=180.0), "5.56 samples per cycle of 180 Hz at 1000 Hz, at least 8"),
    ],
)
def test_nonsense_is_refused_with_the_reason(motion, message):
    with pytest.raises(InputError, match=message):
        analysed(motion)


@pytest.mark.parametrize("rate", [0.0, -5.0, np.nan])
def test_a_rate_that_is_none_is_refused(rate):
    with pytest.raises(InputError, match=r"sampling rate is .* must be positive"):
        analysed(ring(), rate=rate)


def test_an_unknown_quantity_is_refused():
    with pytest.raises(InputError, match="'speed'; allowed are velocity, acceleration, displacement"):
        analysed(ring(), quantity="speed")


def test_noise_alone_is_no_decay():
    with pytest.raises(InputError):
        analysed(np.random.default_rng(1).normal(size=4000), frequency=FREQUENCY)


def test_a_filter_longer_than_the_record_is_refused():
    with pytest.raises(InputError, match="filter_cycles = 100 is longer than the record"):
        analysed(ring(), filter_cycles=100)


# What is flagged ----------------------------------------------------------------------------------------------------


def test_a_clean_decay_has_no_warnings():
    assert analysed(ring()).warnings == ()


def test_a_third_harmonic_is_named_with_its_size():
    motion = ring() * (1 + 0.1 * np.sin(2 * np.pi * 3 * FREQUENCY * TIME) / np.sin(2 * np.pi * FREQUENCY * TIME + 1e-9))
    (line,) = analysed(motion).warnings
    assert "run: an oscillation of 60" in line
    assert "10 %" in line
    assert "filter_cycles" in line


def test_a_second_mode_that_dies_early_is_named():
    motion = ring(0.004) + 0.2 * np.exp(-TIME * 8) * np.sin(2 * np.pi * 130 * TIME)
    assert any("oscillation of 12" in line or "oscillation of 13" in line for line in analysed(motion).warnings)


def test_beats_are_named():
    motion = np.exp(-0.3 * TIME) * (np.sin(126 * TIME) + 0.3 * np.sin(132 * TIME))
    assert any("the amplitude rises in" in line for line in analysed(motion).warnings)


def test_clipped_peaks_are_left_out():
    found = analysed(np.clip(ring(), -0.5, 0.5))
    assert "are clipped and left out" in found.warnings[0]
    assert found.cycles.time[0] == pytest.approx(0.56, abs=0.02)  # 0.5 is reached after ln 2 / (zeta omega) = 0.552 s
    exact = 1 - np.exp(-4 * np.pi * 0.01)
    assert found.cycles.psi == pytest.approx(
        exact, abs=1e-5
    )  # clipped peaks lie beyond, and pull at the offset a little


def test_a_wrong_unit_is_doubted():
    """Millimetres per second taken for metres per second: strokes of metres."""
    assert any("is the unit of the velocity right?" in line for line in analysed(ring(amplitude=500.0)).warnings)


def test_few_samples_per_cycle_are_flagged():
    assert "10.3 samples per cycle" in analysed(ring(frequency=97.3), rate=1000.0).warnings[0]


# Where a decay begins and ends -----------------------------------------------------------------------------------


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
@pytest.mark.parametrize("before", [0.0, 0.0123, 0.5])
def test_it_begins_after_the_release(quantity, before):
    """Held at 4 mm, then released: the plateau, the step of the acceleration and the kink do not count."""
    zeta, omega = 0.01, 2 * np.pi * FREQUENCY
    time = np.arange(6000) / RATE - before
    damped = omega * np.sqrt(1 - zeta**2)
    size = 4e-3 * np.exp(-zeta * omega * np.maximum(time, 0))
    held = time < 0
    u = np.where(held, 4e-3, size * (np.cos(damped * time) + zeta * omega / damped * np.sin(damped * time)))
    v = np.where(held, 0.0, -size * omega**2 / damped * np.sin(damped * time))
    a = np.where(held, 0.0, -2 * zeta * omega * v - omega**2 * u)
    found = analysed({"displacement": u, "velocity": v, "acceleration": a}[quantity], quantity)
    first = {"displacement": 0.5, "velocity": 0.25, "acceleration": 0.5}[quantity] / FREQUENCY
    assert found.cycles.time[0] - before == pytest.approx(first, abs=0.01 / FREQUENCY)  # zeta shifts peaks by 0.2 %
    exact = 1 - np.exp(-4 * np.pi * zeta / np.sqrt(1 - zeta**2))
    assert found.cycles.psi == pytest.approx(exact, abs=1e-6)
    # U over a quarter of a cycle or half of one, from the amplitude at the release
    there = 4e-3 * np.exp(-zeta * omega * (found.cycles.time[0] - before))
    assert found.cycles.displacement[0] == pytest.approx(there, rel=2e-4)


def test_it_ends_at_the_stated_multiple_of_the_noise():
    rng = np.random.default_rng(4)
    motion = ring(0.01, time=np.arange(10_000) / RATE) + 1e-3 * rng.normal(size=10_000)
    for factor in (5.0, 10.0, 40.0):
        found = analysed(motion, noise_factor=factor)
        assert found.located.ends_in_noise
        last = abs(found.located.extremes.value[-1])
        assert last == pytest.approx(factor * found.located.peak_noise, rel=0.35)  # noise of one peak at factor 5
    assert found.located.sample_noise == pytest.approx(1e-3, rel=0.1)


def test_a_truncated_record_ends_with_it():
    found = analysed(ring()[:700])
    assert not found.located.ends_in_noise
    assert found.located.extremes.time[-1] > 0.65


def test_a_motion_that_stops_ends_there():
    motion = np.where(TIME < 1.0, ring(), 0.0) + 1e-4 * np.random.default_rng(2).normal(size=len(TIME))
    found = analysed(motion)
    assert found.located.ends_in_noise
    assert 0.9 < found.located.extremes.time[-1] < 1.0


def test_start_and_end_can_be_given():
    found = analysed(ring(), start=0.5, end=1.5)
    assert 0.5 <= found.located.extremes.time[0] < 0.53
    assert 1.46 < found.located.extremes.time[-1] <= 1.5


def test_a_start_after_the_end_of_the_record():
    with pytest.raises(InputError, match=r"start is 50 s, but the record has [\d.]+ s"):
        analysed(ring(), start=50.0)


# Pieces ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("method", "per_cycle", "error"), [("polynomial", 50, 3e-7), ("polynomial", 20, 1e-6)])
def test_interpolated_peaks_of_a_sine(method, per_cycle, error):
    """Stated in decay_local: 2e-7 for a third of a cycle, 7e-7 for seven samples at 20 per cycle."""
    for shift in np.linspace(0, 1, 11):
        samples = np.sin(2 * np.pi * (np.arange(200) + shift) / per_cycle)
        guess = np.array([int(np.argmax(samples[per_cycle : 2 * per_cycle])) + per_cycle])
        found = local.peaks(samples, guess, local.window_of(method, per_cycle))
        assert found.value[0] == pytest.approx(1.0, abs=error)


def test_bare_samples_and_parabola_are_worse():
    worst = {}
    for method in ("samples", "parabola", "polynomial"):
        found = analysed(ring(0.003, frequency=19.83), peaks=method)
        worst[method] = np.abs(found.cycles.psi - (1 - np.exp(-4 * np.pi * 0.003))).max()
    assert worst["polynomial"] < 1e-5 < worst["parabola"] < 1e-3 < worst["samples"] < 1e-2


def test_windows_beyond_the_record_are_nan():
    found = local.peaks(np.arange(20.0), np.array([0, 19]), local.Window(3, 6))
    assert np.isnan(found.value).all()


def test_noise_from_differences():
    rng = np.random.default_rng(0)
    assert white_noise(ring() + 1e-4 * rng.normal(size=len(TIME)), 50.0) == pytest.approx(1e-4, rel=0.06)
    assert white_noise(ring(), 50.0) < 1e-6


def test_noise_counts_the_rounding_of_the_recorder():
    step = 0.01
    assert white_noise(np.round(ring() / step) * step, 50.0) > 0.9 * step / np.sqrt(12)


def test_moving_average_shrinks_at_the_ends():
    values = np.array([1.0, 2.0, 6.0, 4.0, 5.0])
    assert moving_average(5, 3) @ values == pytest.approx([1.0, 3.0, 4.0, 5.0, 5.0])
    assert moving_average(5, 1) @ values == pytest.approx(values)


def test_errors_know_shared_peaks():
    """The sum of cycles 0 and 2, which share peak 2, depends on peaks 0 and 4 alone."""
    matrix = np.array([[1.0, 0.0, 1.0]]) @ cycle_sensitivity(np.ones(3)).toarray()
    assert matrix == pytest.approx(np.array([[1.0, 0.0, 0.0, 0.0, -1.0]]))
    assert spread(cycle_sensitivity(np.ones(3)), np.full(5, 0.1)) == pytest.approx(0.1 * np.sqrt(2) * np.ones(3))


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_amplitudes_in_all_quantities(quantity):
    found = analysed(ring(0.002), quantity).cycles
    omega = 2 * np.pi * FREQUENCY
    assert found.velocity == pytest.approx(omega * found.displacement, rel=1e-5)
    assert 9.80665 * found.intensity == pytest.approx(omega**2 * found.displacement, rel=1e-5)
    given = {"displacement": found.displacement, "velocity": found.velocity, "acceleration": 9.80665 * found.intensity}
    assert given[quantity][0] == pytest.approx(1.0, rel=0.01)


def test_coarse_frequency_of_a_strong_decay_in_a_long_record():
    motion = ring(0.05, time=np.arange(60_000) / RATE) + 0.01 * np.random.default_rng(1).normal(size=60_000)
    assert coarse_frequency(DecayRecord(motion, "velocity", RATE)) == pytest.approx(FREQUENCY, rel=0.03)


def test_band_pass_has_gain_one_and_nulls():
    kernel = band_pass(RATE, FREQUENCY, 4)
    n = np.arange(len(kernel))
    gain = [abs(np.sum(kernel * np.exp(2j * np.pi * f / RATE * n))) for f in (FREQUENCY, 0.0, 40.0, 60.0, 7.0)]
    assert gain[0] == pytest.approx(1.0, abs=0.01)
    assert max(gain[1:]) < 0.03


def test_mass_normalised_is_equation_2_29():
    assert mass_normalised(np.array([0.3]), 0.5)[0] == pytest.approx(0.3 * 1.5**2 / 0.5)


# Repeats ---------------------------------------------------------------------------------------------------------


def test_bins_of_equal_ratio_hold_every_cycle_once():
    found = [analysed(ring(zeta)) for zeta in (0.01, 0.011)]
    curve = combine(found, 10)
    assert curve.n_cycle.sum() == sum(len(decay.cycles.psi) for decay in found)
    assert np.all(np.diff(curve.displacement) > 0)
    both = curve.n_record == 2
    assert both.sum() > 5
    exact = [1 - np.exp(-4 * np.pi * zeta) for zeta in (0.01, 0.011)]
    assert curve.psi[both] == pytest.approx(np.mean(exact), abs=1e-6)
    assert curve.psi_scatter[both] == pytest.approx(
        (exact[1] - exact[0]) / 2, abs=1e-6
    )  # of two values: half of theirs


def test_one_record_has_the_error_of_its_noise():
    found = analysed(ring() + 1e-3 * np.random.default_rng(3).normal(size=len(TIME)))
    curve = combine([found])
    assert np.isnan(curve.psi_scatter).all()
    assert curve.psi_error == pytest.approx(curve.psi_noise)
    assert np.all(curve.psi_noise > 0)


# Descriptions ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"files": []}, "files"),
        ({"files": ["a.csv"], "particle_mass": "3.5 g"}, "structure_mass is missing"),
        ({"files": ["a.csv"], "intrinsic": "30 mm"}, "intrinsic"),
        ({"files": ["a.csv"], "intrinsic": 1.5}, "intrinsic"),
        ({"files": ["a.csv"], "clearance": "-1 mm"}, "clearance"),
        ({"files": ["a.csv"], "method": {"moving_average": 4}}, "must be odd"),
        ({"files": ["a.csv"], "method": {"filter_cycles": 1}}, "0 for no filter, or 2 or more"),
        ({"files": ["a.csv"], "method": {"start": "2 s", "end": "1 s"}}, "must be later than start"),
        ({"files": ["a.csv"], "method": {"peaks": "spline"}}, "polynomial"),
        ({"files": ["a.csv"], "clearence": "1 mm"}, "nearest valid key is 'clearance'"),
    ],
)
def test_descriptions_are_checked(data, message):
    with pytest.raises(InputError, match=message):
        parse_spec(data, DecaySpec, "command line")


def test_mass_ratio():
    assert DecaySpec(files=("a",), particle_mass="3.52 g", structure_mass="131 g").mass_ratio == pytest.approx(
        3.52 / 131
    )
    assert DecaySpec(files=("a",)).mass_ratio is None
