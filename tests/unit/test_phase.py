import numpy as np
import pytest

from graindamp.signals.phase import EmptyRun, calibrate


def runs(delay, frequencies, error=1e-4, mass=0.085):
    return [EmptyRun(f, mass * np.exp(-2j * np.pi * f * delay), error) for f in frequencies]


def test_same_frequency_is_read_and_neighbours_are_interpolated():
    calibration = calibrate(runs(35e-6, [40, 100, 400]))
    assert calibration.at(100.1)[0] == pytest.approx(-2 * np.pi * 100 * 35e-6)
    phase, error = calibration.at(200)
    assert phase == pytest.approx(-2 * np.pi * 200 * 35e-6)  # a delay is linear in frequency
    assert error == pytest.approx(1e-4)


def test_outside_it_is_a_delay_with_a_wider_error():
    phase, error = calibrate(runs(35e-6, [100, 200])).at(400)
    assert phase == pytest.approx(-2 * np.pi * 400 * 35e-6)
    assert error > 0.1 * abs(phase)


def test_scatter_between_runs_sets_the_error():
    rng = np.random.default_rng(4)
    many = [EmptyRun(100.0, 0.085 * np.exp(1j * (0.02 + 0.005 * rng.normal())), 1e-5) for _ in range(25)]
    calibration = calibrate(many)
    assert len(calibration.frequency) == 1
    assert calibration.standard_error[0] == pytest.approx(0.005 / 5, rel=0.4)  # 25 runs know their scatter to 15 %
    assert abs(calibration.phase[0] - 0.02) < 4 * calibration.standard_error[0]
