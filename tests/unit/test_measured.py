"""Measured records to a field: which of them are one setting of the rig."""

from types import SimpleNamespace

import numpy as np
import pytest

from graindamp.field.measured import field_of


def record(frequency, intensity, loss_factor, nominal=None):
    """What the analysis of a record gives."""
    return SimpleNamespace(
        label="made", problems=(), frequency=frequency, intensity=intensity, nominal_intensity=nominal,
        loss_factor=loss_factor, effective_mass_ratio=0.5, loss_factor_error=0.01, effective_mass_ratio_error=0.01,
        dissipated_energy=np.nan, power=np.nan, n_cycle=20, status=0, modulus_ratio=0.6,
    )  # fmt: skip


def field(records):
    return field_of(records, 0.3, "made", {})


def test_a_finely_stepped_sine_keeps_its_points():
    """Steps of a thousandth, each within what counts as the same frequency of its neighbour."""
    f, eta = np.arange(1000.0, 1101.0), np.linspace(0.1, 0.3, 101)
    found = field([record(a, 5.0, b) for a, b in zip(f, eta, strict=True)])
    np.testing.assert_array_equal(found["frequency"], f)
    np.testing.assert_array_equal(found["loss_factor"].to_numpy().ravel(), eta)


def test_finely_stepped_levels_are_settings_of_their_own():
    gamma = 1.018 ** np.arange(20)
    found = field([record(100.0, level, 0.4) for level in gamma])
    np.testing.assert_allclose(found["intensity"], gamma, rtol=1e-15)


def test_repeats_of_one_setting_are_one_point():
    """The rig holds its level to a percent, the frequency to a few parts in a hundred thousand."""
    repeats = [record(100.0, 5.0, 0.40), record(100.003, 5.04, 0.42), record(200.0, 5.02, 0.3)]
    found = field(repeats)
    assert found.sizes == {"frequency": 2, "intensity": 1}
    assert found["loss_factor"].to_numpy()[0, 0] == pytest.approx(0.41)
    assert found["loss_factor_se"].to_numpy()[0, 0] == pytest.approx(0.01)  # half of their difference
