"""Free decays against closed forms: viscous, Coulomb and quadratic damping, Duffing's frequency, errors and scatter."""

import numpy as np
import pytest
import scipy.integrate
from scipy.special import ellipk

from graindamp.signals.decay import DecayRecord, analyze_decay
from graindamp.signals.decay_repeats import combine
from graindamp.spec.decay import DecayMethodSpec

FREQUENCY = 20.0
OMEGA = 2 * np.pi * FREQUENCY


def psi_of(zeta):
    return 1 - np.exp(-4 * np.pi * zeta / np.sqrt(1 - zeta**2))


def viscous(zeta, rate, duration=None, phase=0.3, amplitude=0.5):
    """Time and a viscous decay of eight times its time constant, at most 4 s."""
    duration = duration or min(8 / (zeta * OMEGA), 4.0)
    time = np.arange(int(duration * rate)) / rate
    damped = OMEGA * np.sqrt(1 - zeta**2)
    return time, amplitude * np.exp(-zeta * OMEGA * time) * np.cos(damped * time + phase)


def analysed(motion, rate, quantity="velocity", **method):
    return analyze_decay(DecayRecord(motion, quantity, rate), DecayMethodSpec(**method))


# Viscous -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("per_cycle", [20, 23.7, 50, 100.3, 333, 1000])
@pytest.mark.parametrize("zeta", [0.0005, 0.005, 0.02, 0.08])
def test_viscous_decay(zeta, per_cycle):
    """1e-5 is what is asked for, from 20 to 1000 samples per cycle; measured at most 2e-6, envelope likewise."""
    _, motion = viscous(zeta, per_cycle * FREQUENCY)
    found = analysed(motion, per_cycle * FREQUENCY)
    assert found.cycles.psi == pytest.approx(psi_of(zeta), abs=3e-6)
    assert found.cycles.psi_average == pytest.approx(psi_of(zeta), abs=3e-6)
    assert found.cycles.psi_envelope == pytest.approx(psi_of(zeta), abs=5e-6)  # ends of the transform included
    # ln(V / V_next) = -ln(1 - Psi) / 2 is off by dPsi / (2 (1 - Psi)): 1.4 dPsi at zeta = 0.08, where Psi is 0.64
    assert found.cycles.log_decrement == pytest.approx(2 * np.pi * zeta / np.sqrt(1 - zeta**2), abs=4e-6)
    assert found.cycles.damping_ratio == pytest.approx(zeta, abs=5e-7)
    assert found.damping_ratio == pytest.approx(zeta, abs=5e-7)
    assert found.cycles.frequency == pytest.approx(FREQUENCY * np.sqrt(1 - zeta**2), rel=1e-6)
    assert np.abs(found.envelope.frequency / (FREQUENCY * np.sqrt(1 - zeta**2)) - 1).max() < 2e-4
    whole = 0.5 * np.exp(-zeta * OMEGA * found.envelope.time)
    assert np.abs(found.envelope.amplitude / whole - 1).max() < 1e-4 + 2 * zeta**2  # peaks lie zeta^2/2 below it


@pytest.mark.parametrize(("per_cycle", "error"), [(8.2, 5e-4), (12, 2e-5), (16, 2e-6)])
def test_few_samples_per_cycle(per_cycle, error):
    """The errors that the documentation states for fewer than 20 samples per cycle."""
    _, motion = viscous(0.02, per_cycle * FREQUENCY)
    assert analysed(motion, per_cycle * FREQUENCY).cycles.psi == pytest.approx(psi_of(0.02), abs=error)


@pytest.mark.parametrize("offset", [0.0, 0.05, 0.4])
@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_offset_and_drift_do_not_bias_small_amplitudes(offset, drift):
    """The decay falls to 1e-5 of its beginning, the offset is as large as that."""
    time, motion = viscous(0.01, 1000.0, duration=9.0)
    found = analysed(motion + offset + drift * time, 1000.0)
    assert found.located.offset == pytest.approx((offset, drift), abs=1e-9)
    assert found.cycles.psi == pytest.approx(psi_of(0.01), abs=1e-6)
    assert found.cycles.frequency == pytest.approx(FREQUENCY * np.sqrt(1 - 1e-4), rel=1e-6)


def test_an_offset_left_in_biases_the_signs_against_each_other():
    _, motion = viscous(0.01, 1000.0, duration=2.0)
    found = analysed(motion + 0.01, 1000.0, baseline="none").cycles
    high, low = found.psi[found.sign > 0], found.psi[found.sign < 0]
    assert high.mean() < psi_of(0.01) < low.mean()


@pytest.mark.parametrize("cut", [0.31, 0.527, 1.0])
def test_truncated_records(cut):
    """A record that ends while the decay is large, anywhere in a cycle."""
    _, motion = viscous(0.01, 1000.0, duration=cut)
    found = analysed(motion + 0.02, 1000.0)
    assert found.cycles.psi == pytest.approx(psi_of(0.01), abs=1e-5)
    assert found.cycles.psi_envelope == pytest.approx(psi_of(0.01), abs=2e-5)


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_all_quantities_of_one_decay_agree(quantity):
    zeta, rate = 0.03, 1000.0
    time = np.arange(2500) / rate
    root = OMEGA * complex(-zeta, np.sqrt(1 - zeta**2))
    order = {"displacement": 0, "velocity": 1, "acceleration": 2}[quantity]
    motion = (4e-3 * root**order * np.exp(root * time + 0.4j)).real
    found = analysed(motion, rate, quantity).cycles
    assert found.psi == pytest.approx(psi_of(zeta), abs=2e-6)
    # A peak lies below the envelope by sqrt(1 - zeta^2) in each of the three.
    envelope = 4e-3 * np.exp(-zeta * OMEGA * found.time) * np.sqrt(1 - zeta**2)
    assert found.displacement == pytest.approx(envelope, rel=1e-5)


# Damping that depends on amplitude ----------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [400.0, 1000.0, 20_000.0])
def test_coulomb_friction(rate):
    """Friction shifts the centre of each half cycle by +-D/2, and every amplitude is D smaller than the one before.

    Between reversals the velocity is a sine, and its peaks are exact; Psi = 1 - (1 - 2 D / A)^2.
    """
    start, step = 1e-3, 2e-5
    time = np.arange(int(23.0 / FREQUENCY * rate)) / rate
    half = np.floor(2 * FREQUENCY * time)
    size = start - half * step - step / 2
    velocity = -size * OMEGA * np.sin(OMEGA * time - np.pi * half) * (-1.0) ** half
    found = analysed(velocity, rate)
    at = np.abs(found.located.extremes.value[:-2]) / OMEGA
    assert found.cycles.psi == pytest.approx(1 - (1 - 2 * step / at) ** 2, abs=1e-6)
    number = np.round((start - step / 2 - at) / step)
    assert at == pytest.approx(start - step / 2 - number * step, rel=1e-6)
    displacement = step / 2 * (-1.0) ** half + size * np.cos(OMEGA * time - np.pi * half) * (-1.0) ** half
    found = analysed(displacement, rate, "displacement")
    at = np.abs(found.located.extremes.value[:-2])
    # The curvature jumps at every peak, which a polynomial rounds off: 2e-5 where Psi is 0.27.
    assert found.cycles.psi == pytest.approx(1 - (1 - 2 * step / at) ** 2, abs=3e-5)


def integrated(acceleration, start, duration, rate):
    """Displacement and velocity of u'' = acceleration(u, v) at rest at `start`."""
    time = np.arange(int(duration * rate)) / rate
    solved = scipy.integrate.solve_ivp(
        lambda _, y: [y[1], acceleration(y[0], y[1])],
        (0.0, duration),
        [start, 0.0],
        method="DOP853",
        t_eval=time,
        rtol=1e-11,
        atol=1e-14,
    )
    return solved.y


@pytest.mark.slow
def test_quadratic_damping():
    """u'' + omega^2 u + c |v| v = 0: from stop to stop (1 + 2 c A) exp(-2 c A) is conserved, 1/A' - 1/A = 8 c / 3."""
    c = 2.0
    displacement, velocity = integrated(lambda u, v: -(OMEGA**2) * u - c * abs(v) * v, 0.01, 4.0, 1000.0)
    found = analysed(displacement, 1000.0, "displacement")
    size = np.abs(found.located.extremes.value)

    def conserved(amplitude, sign):
        return (1 + sign * 2 * c * amplitude) * np.exp(-sign * 2 * c * amplitude)

    # From a stop at A to the next at A': (1 - 2 c A') e^(2 c A') = (1 + 2 c A) e^(-2 c A), both about 1 - 2 (c A)^2.
    left, right = conserved(size[1:], -1.0), conserved(size[:-1], 1.0)
    slope = np.abs(4 * c**2 * size[1:])  # of either side by the amplitude
    assert np.all(np.abs(left - right) / slope < 2e-6 * size[0])
    psi = 1 - (1 / (1 + 8 / 3 * c * size[:-2])) ** 2  # to first order of c A, 0.02 here
    assert found.cycles.psi == pytest.approx(psi, rel=2e-3, abs=1e-6)
    decrement = np.log1p(8 / 3 * c * size[:-2])
    assert found.cycles.log_decrement == pytest.approx(decrement, rel=(c * size[0]) ** 2)  # of second order
    # Cycles of a velocity begin a quarter of a cycle before those of a displacement, with amplitudes of their own.
    cycles = analysed(velocity, 1000.0).cycles
    psi = 1 - (1 / (1 + 8 / 3 * c * cycles.displacement[5:50])) ** 2
    assert cycles.psi[5:50] == pytest.approx(psi, rel=(c * size[0]) ** 2)


@pytest.mark.slow
def test_frequency_of_a_duffing_oscillator():
    """u'' + omega^2 (u + u^3 / 2): the exact frequency falls from 23.5 to 20 Hz as the decay goes on."""
    zeta, cubic = 0.002, 0.5
    displacement, _ = integrated(lambda u, v: -2 * zeta * OMEGA * v - OMEGA**2 * (u + cubic * u**3), 1.0, 8.0, 1000.0)
    found = analysed(displacement, 1000.0, "displacement")
    size = np.abs(found.located.extremes.value)
    at = np.sqrt(size[:-2] * size[2:])
    modulus = cubic * at**2 / (2 * (1 + cubic * at**2))
    exact = FREQUENCY * np.pi / 2 * np.sqrt(1 + cubic * at**2) / ellipk(modulus)
    assert exact[0] > 1.16 * exact[-1]
    # The first value has no zero before its first peak and stands half a cycle late; zeta^2 / 2 = 2e-6.
    assert found.cycles.frequency[1:] == pytest.approx(exact[1:], rel=1e-4)
    assert found.cycles.frequency[0] == pytest.approx(exact[0], rel=1e-3)


def test_intrinsic_damping_is_what_remains_without_particles():
    """Two viscous dampings of one oscillator: Psi of both less Psi of one is Psi of the other, to their product."""
    both, alone = 0.006 + 0.00024, 0.00024
    _, motion = viscous(both, 1000.0)
    particles = analysed(motion, 1000.0).cycles.psi - psi_of(alone)
    assert particles == pytest.approx(psi_of(0.006), abs=1.05 * psi_of(0.006) * psi_of(alone))


# Noise -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_standard_errors_match_the_scatter_of_repeats(noise):
    """150 repeats tell a standard deviation to 6 %; 20 % is three of that and the error of the noise itself."""
    zeta, repeats, n = 0.004, 150, 60
    columns = {name: [] for name in ("psi", "psi_average", "frequency", "damping_ratio")}
    errors = {name: [] for name in columns}
    for seed in range(repeats):
        _, motion = viscous(zeta, 1000.0, duration=5.0)
        motion = motion + 0.02 + 0.5 * noise * np.random.default_rng(seed).normal(size=len(motion))
        cycles = analysed(motion, 1000.0).cycles
        for name in columns:
            columns[name].append(getattr(cycles, name)[:n])
            errors[name].append(getattr(cycles, f"{name}_error")[:n])
    for name in columns:
        values, error = np.array(columns[name]), np.array(errors[name])
        ratio = values.std(axis=0, ddof=1) / error.mean(axis=0)
        assert ratio.mean() == pytest.approx(1.0, abs=0.08), name
        assert np.all((ratio > 0.7) & (ratio < 1.3)), name
    truth = psi_of(zeta)
    values = np.array(columns["psi"])
    bias = (values.mean(axis=0) - truth) / (values.std(axis=0, ddof=1) / np.sqrt(repeats))
    assert np.abs(bias).max() < 4.0  # of 60 values
    assert abs(values.mean() - truth) < 3 * values.mean(axis=1).std(ddof=1) / np.sqrt(repeats)


@pytest.mark.slow
def test_standard_errors_of_bins_cover_the_truth():
    """Means over bins of three repeats: two standard errors cover the truth in at least 88 % of the bins."""
    zeta, covered = 0.01, []
    for trial in range(12):
        found = []
        for repeat in range(3):
            _, motion = viscous(zeta, 1000.0, duration=4.0, phase=0.1 * repeat)
            noise = np.random.default_rng(100 * trial + repeat).normal(size=len(motion))
            found.append(analysed(motion + 5e-4 * noise, 1000.0))
        curve = combine(found, 10)
        covered.append(np.abs(curve.psi - psi_of(zeta)) < 2 * curve.psi_error)
    assert np.concatenate(covered).mean() > 0.88


def test_the_tail_tells_noise_that_is_not_white():
    """Noise of a recorder that filters at twice the frequency: no trace at high frequency, but in the tail."""
    time, motion = viscous(0.02, 1000.0, duration=12.0)
    rough = np.random.default_rng(7).normal(size=len(time) + 40)
    noise = 1e-3 * np.convolve(rough, np.hanning(43)[1:-1], mode="valid")[: len(time)]
    found = analysed(motion[: len(noise)] + noise, 1000.0)
    assert found.located.peak_noise == pytest.approx(noise.std(), rel=0.25)
    assert found.located.sample_noise < 0.1 * found.located.peak_noise
    last = found.cycles
    assert np.std((last.psi - psi_of(0.02)) / last.psi_error) == pytest.approx(1.0, abs=0.4)


# Filter ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cycles", [2, 4, 8])
def test_band_pass_leaves_an_exponential_decay_as_it_is(cycles):
    """It takes out offset, third harmonic and a mode at 6.3 times the frequency, and half its length at each end."""
    time, motion = viscous(0.01, 1000.0, duration=3.0)
    other = 0.05 * np.exp(-5 * time) * np.sin(2 * np.pi * 126 * time) + 0.1
    other += 0.02 * np.exp(-4 * time) * np.sin(3 * OMEGA * time)
    rough = analysed(motion + other, 1000.0).cycles.psi
    found = analysed(motion + other, 1000.0, filter_cycles=cycles).cycles
    error = np.abs(found.psi - psi_of(0.01)).max()
    assert error < 0.1 * np.abs(rough - psi_of(0.01)).max()
    assert error < 2e-3
    assert 0.0 < found.time[0] - 0.5 * cycles / FREQUENCY < 1.0 / FREQUENCY


def test_band_pass_averages_a_sudden_change_over_its_length():
    """Damping that changes at one instant: half of the filter's length away nothing is left of it."""
    rate, change = 1000.0, 1.5
    time = np.arange(3000) / rate
    exponent = np.where(time < change, 0.01 * time, 0.01 * change + 0.003 * (time - change))
    motion = np.exp(-OMEGA * exponent) * np.sin(OMEGA * time)
    found = analysed(motion, rate, filter_cycles=4).cycles
    before = found.time + 1 / FREQUENCY < change - 2 / FREQUENCY
    after = found.time > change + 2 / FREQUENCY
    assert found.psi[before] == pytest.approx(1 - np.exp(-4 * np.pi * 0.01), abs=1e-4)
    assert found.psi[after] == pytest.approx(1 - np.exp(-4 * np.pi * 0.003), abs=1e-4)
