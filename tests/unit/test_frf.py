import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.structure.frf import accelerance, mobility, receptance
from graindamp.structure.modal import ModalModel

MODEL = ModalModel(
    omega=np.array([0.0, 300.0, 1000.0]),
    damping=np.array([0.0, 6.0, 30.0]),
    shape=np.array([[0.4, 0.7, 0.5], [0.4, -0.6, 0.2]]),
    slope=np.full((2, 3), np.nan),
    points=("damper", "shaker"),
)
FREQUENCY = np.linspace(1.0, 300.0, 400)


def with_mode(omega, damping):
    return ModalModel(np.array([omega]), np.array([damping]), np.array([[2.0]]), np.array([[np.nan]]), ("a",))


def test_single_mode_is_the_oscillator():
    omega = 2 * np.pi * FREQUENCY
    exact = 1 / (0.25 * 300**2 - 0.25 * omega**2 + 1j * omega * 0.25 * 6)  # modal mass 1 / phi^2 = 0.25 kg
    assert receptance(with_mode(300.0, 6.0), FREQUENCY, "a", "a") == pytest.approx(exact, rel=1e-12)  # rounding


def test_response_decays_from_a_push():
    """Under exp(+i omega t) a passive receptance lags: its imaginary part is not positive at the driven point."""
    assert (receptance(MODEL, FREQUENCY, "damper", "damper").imag <= 0).all()
    assert (mobility(MODEL, FREQUENCY, "damper", "damper").real >= 0).all()
    at_resonance = receptance(with_mode(300.0, 6.0), 300.0 / (2 * np.pi), "a", "a")
    assert np.angle(at_resonance) == pytest.approx(-np.pi / 2, abs=1e-12)  # rounding


def test_mobility_and_accelerance_are_derivatives():
    i_omega = 2j * np.pi * FREQUENCY
    x = receptance(MODEL, FREQUENCY, "damper", "shaker")
    assert mobility(MODEL, FREQUENCY, "damper", "shaker") == pytest.approx(i_omega * x, rel=1e-14)  # rounding
    assert accelerance(MODEL, FREQUENCY, "damper", "shaker") == pytest.approx(i_omega**2 * x, rel=1e-14)


def test_reciprocity():
    there, back = receptance(MODEL, FREQUENCY, "damper", "shaker"), receptance(MODEL, FREQUENCY, "shaker", "damper")
    assert (there == back).all()


def test_a_rigid_mode_is_an_apparent_mass():
    rigid = with_mode(0.0, 0.0)
    assert accelerance(rigid, FREQUENCY, "a", "a") == pytest.approx(4.0, rel=1e-14)  # phi^2 = 1 / 0.25 kg; rounding


def test_scalar_frequency_gives_a_scalar():
    assert receptance(MODEL, 10.0, "damper", "damper").shape == ()
    assert receptance(MODEL, [10.0], "damper", "damper").shape == (1,)


def test_static_response_without_rigid_modes():
    assert receptance(with_mode(300.0, 6.0), 0.0, "a", "a") == pytest.approx(4 / 300**2, rel=1e-15)  # rounding


@pytest.mark.parametrize("response", [receptance, mobility, accelerance])
def test_zero_frequency_with_rigid_modes_is_explained(response):
    with pytest.raises(InputError, match="infinite at 0 Hz: the structure has rigid-body modes"):
        response(MODEL, [0.0, 1.0], "damper", "shaker")


def test_undamped_resonance_is_explained():
    with pytest.raises(InputError, match="infinite at 50 Hz, where an undamped mode lies"):
        receptance(with_mode(2 * np.pi * 50.0, 0.0), [10.0, 50.0], "a", "a")


def test_a_mode_that_takes_no_part_may_be_at_resonance():
    model = MODEL._replace(shape=np.array([[0.0, 0.7, 0.5], [0.4, -0.6, 0.2]]))
    assert np.isfinite(receptance(model, 0.0, "damper", "shaker"))


@pytest.mark.parametrize("frequency", [-1.0, np.nan, [1.0, np.inf]])
def test_impossible_frequency(frequency):
    with pytest.raises(InputError, match="finite and not negative"):
        receptance(MODEL, frequency, "damper", "shaker")


def test_unknown_point():
    with pytest.raises(InputError, match="no point 'shakr'; nearest is 'shaker'"):
        receptance(MODEL, 1.0, "damper", "shakr")
