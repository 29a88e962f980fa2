"""Equilibria of a mode with its dampers against closed forms, exhaustive sampling and the fixed-point scheme."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fields_made import constant_field, random_field
from graindamp.couple.balance import Attached, damping_ratio_of, residual
from graindamp.couple.equilibrium import holding_curve, solve_mode
from graindamp.couple.fixed_point import solve_fixed_point
from graindamp.couple.single_mode import load_mode, search_box
from graindamp.errors import InputError
from graindamp.field.ideal import ideal_field
from graindamp.field.interpolate import Interpolant
from graindamp.field.theory import collect_and_collide, collect_and_collide_force_limit, peak_force_ratio
from graindamp.structure.modal import ModalModel
from graindamp.units import STANDARD_GRAVITY

PHI_D, PHI_S, F0 = 0.7, 0.3, 100.0


def one_mode(zeta=0.0, shapes=(PHI_D, PHI_S), frequency=F0, names=("tip", "drive")):
    omega = 2 * np.pi * np.array([frequency])
    shape = np.array(shapes)[:, None]
    return ModalModel(omega, 2 * zeta * omega, shape, np.full_like(shape, np.nan), names)


def solved(field, force, zeta=0.0, outside="refuse", bed_mass=None, container=0.0):
    damper = Attached("d", "tip", Interpolant(field, outside), bed_mass or field.attrs["bed_mass"], container)
    loaded = load_mode(one_mode(zeta), 0, "drive", force, [damper])
    return loaded, solve_mode(loaded, 1)


@pytest.mark.parametrize("zeta", [0.0, 0.01])
@pytest.mark.parametrize("container", [0.0, 0.15])
def test_linear_damper_closed_form(zeta, container):
    eta, mass, bed = 0.6, 0.4, 0.2
    force = 5.0
    loaded, result = solved(constant_field(eta, mass, bed, se=0.01), force, zeta, container=container)
    (state,) = result.equilibria
    modal_mass = 1 + PHI_D**2 * (container + bed * mass)
    omega = 2 * np.pi * F0 / np.sqrt(modal_mass)
    damping = 2 * zeta * 2 * np.pi * F0 + PHI_D**2 * bed * eta * omega
    ratio = damping / (2 * modal_mass * omega)
    rounding = {"rel": 1e-9}
    assert state.frequency == pytest.approx(omega / (2 * np.pi), **rounding)
    assert state.damping_ratio == pytest.approx(ratio, **rounding)
    assert state.modal_amplitude == pytest.approx(PHI_S * force / (damping * omega), **rounding)
    assert state.intensity[0] == pytest.approx(PHI_D * state.modal_amplitude * omega**2 / STANDARD_GRAVITY, **rounding)
    assert state.is_stable
    assert state.slope == pytest.approx(1.0, abs=1e-6)  # difference quotient
    scheme = solve_fixed_point(loaded)
    assert scheme.converged
    assert scheme.last.damping_ratio == pytest.approx(ratio, rel=1e-5)  # its own tolerance


def test_errors_of_the_field_arrive_in_the_damping_ratio():
    """zeta = phi^2 m eta / (2 (1 + phi^2 m m')) without structural damping: both derivatives by hand."""
    eta, mass, bed, se = 0.6, 0.4, 0.2, 0.02
    _, result = solved(constant_field(eta, mass, bed, se=se), 5.0)
    mu = PHI_D**2 * bed
    by_eta = mu / (2 * (1 + mu * mass))
    by_mass = -mu * mu * eta / (2 * (1 + mu * mass) ** 2)
    state = result.equilibria[0]
    assert state.damping_ratio_se == pytest.approx(np.hypot(by_eta, by_mass) * se, rel=1e-5)  # difference quotients
    frequency_se = state.frequency * mu * se / (2 * (1 + mu * mass))
    assert state.frequency_se == pytest.approx(frequency_se, rel=1e-5)
    assert result.efficient_damping_ratio == pytest.approx(float(damping_ratio_of(PHI_D**2, bed)))


def test_two_dampers_add_up():
    fields = constant_field(0.6, 0.4, 0.2), constant_field(1.1, -0.2, 0.1)
    model = one_mode(0.002, (0.7, 0.4, 0.3), names=("a", "b", "drive"))
    dampers = [Attached(n, n, Interpolant(f), f.attrs["bed_mass"]) for n, f in zip("ab", fields, strict=True)]
    result = solve_mode(load_mode(model, 0, "drive", 3.0, dampers), 2)
    (state,) = result.equilibria
    modal = 1 + 0.49 * 0.2 * 0.4 - 0.16 * 0.1 * 0.2
    assert state.frequency == pytest.approx(F0 / np.sqrt(modal), rel=1e-9)  # rounding
    loss = 0.49 * 0.2 * 0.6 + 0.16 * 0.1 * 1.1
    assert state.damping_ratio == pytest.approx((0.004 * np.sqrt(modal) + loss) / (2 * modal), rel=1e-9)
    assert state.intensity[0] / state.intensity[1] == pytest.approx(0.7 / 0.4)


def test_ideal_damper_holds_at_most_1839():
    """F_max = 1.839 m_bed X_opt Omega^2 phi_pd / phi_sh; twice that has no equilibrium, half of it has a stable one
    below and an unstable one above, as the uniqueness criterion d ln eta / d ln Gamma > -1 says."""
    bed, clearance = 0.05, 3e-3
    field = ideal_field("bouncing", np.linspace(90, 110, 9), np.geomspace(41, 400, 300), bed, clearance=clearance)
    _, result = solved(field, 1.0)
    at = 2 * np.pi * F0
    assert peak_force_ratio().force_ratio == pytest.approx(1.839, abs=5e-4)
    gamma_top = peak_force_ratio().stroke_ratio * clearance / np.pi * at**2 / STANDARD_GRAVITY
    assert result.largest_force_intensity == pytest.approx(gamma_top, rel=0.05)  # flat top, resonance moved by m'
    mass_ratio = collect_and_collide(peak_force_ratio().stroke_ratio).effective_mass_ratio
    resonance = F0 / np.sqrt(1 + PHI_D**2 * bed * mass_ratio)
    exact = collect_and_collide_force_limit(bed, clearance, resonance, PHI_D / PHI_S)
    assert result.largest_force == pytest.approx(exact, rel=1e-3)  # field linear between its points, m' varies
    _, more = solved(field, 2 * exact)
    assert more.equilibria == ()
    assert "more than the damper can hold" in more.reason
    assert f"{result.largest_force:.4g} N" in more.reason
    _, less = solved(field, 0.9 * exact)
    assert [state.is_stable for state in less.equilibria] == [True, False]
    assert less.equilibria[0].slope > 0 > less.equilibria[1].slope


@pytest.mark.parametrize("force", [5.0, 15.0, 40.0, 80.0])
def test_refusing_keeps_to_where_the_motion_exists(force):
    """No equilibrium below the existence limit X / X_opt = 0.84, at whatever force."""
    clearance = 1e-3
    field = ideal_field("bouncing", np.geomspace(10, 1000, 40), np.geomspace(5, 400, 40), 0.1, clearance=clearance)
    _, result = solved(field, force, zeta=0.002)
    for state in result.equilibria:
        assert state.displacement[0] / (clearance / np.pi) > 0.84
        assert not state.extrapolated
    assert result.equilibria or result.reason


def test_fold_lies_where_eta_falls_like_one_over_gamma():
    """Sliding bed at high intensity: eta is proportional to 1 / Gamma, so the force held no longer grows."""
    field = ideal_field("sliding", [50.0, 200.0], np.geomspace(5, 500, 60), 0.2, friction=0.1)
    _, result = solved(field, 1.0)
    block = 4 / np.pi * 0.1 * 0.2 * STANDARD_GRAVITY * PHI_D / PHI_S  # friction force, fundamental of a square wave
    assert result.largest_force == pytest.approx(block, rel=1e-3)  # (pi / 2 lambda)^2 / 2 at lambda = 5000
    assert result.equilibria == ()


@given(seed=st.integers(0, 10_000), log_force=st.floats(-1, 2), zeta=st.sampled_from([0.0, 0.003]))
@settings(max_examples=60, deadline=None)
def test_nothing_is_missed_on_rough_fields(seed, log_force, zeta):
    """Every crossing that dense sampling finds is among the equilibria, and every equilibrium balances."""
    force = 10**log_force
    loaded, result = solved(random_field(seed, mass_low=0.2, mass_high=0.6), force, zeta)
    curve = holding_curve(loaded, search_box(loaded), n_amplitude=3000, n_frequency=60)
    # m' varies too little here for the resonance to fold over frequency: one frequency for each amplitude.
    assert (np.diff(curve.log_amplitude) > 0).all()
    above = curve.force > force
    crossings = np.flatnonzero(above[1:] != above[:-1])
    assert len(result.equilibria) >= len(crossings)
    found = np.array([state.intensity[0] for state in result.equilibria])
    for k in crossings:
        inside = (found >= curve.intensity[k] * (1 - 1e-6)) & (found <= curve.intensity[k + 1] * (1 + 1e-6))
        assert inside.any()
    for state in result.equilibria:
        omega = 2 * np.pi * state.frequency
        motion = np.array([-1j * state.displacement[0]])  # at resonance the motion lags the force by a quarter
        stiffness = loaded.omega**2 - omega**2 + 1j * omega * loaded.damping
        receptance = np.array([[PHI_D**2 / stiffness]])
        free = np.array([PHI_D * PHI_S * force / stiffness])
        missing = residual(motion, state.frequency, receptance, free, loaded.dampers)
        scale = abs(motion[0]) + abs(free[0])
        assert abs(missing[0]) < 1e-6 * scale * max(1, abs(PHI_D**2 / stiffness) * omega**2)  # Newton's tolerance


@given(seed=st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_equilibria_alternate_in_stability(seed):
    """On one continuous resonance curve the force held is crossed upwards and downwards in turn."""
    _, result = solved(random_field(seed, mass_low=0.4, mass_high=0.4), 3.0)
    signs = [state.is_stable for state in result.equilibria]
    assert all(a != b for a, b in itertools.pairwise(signs))


def test_fixed_point_ends_at_a_stable_equilibrium_if_it_ends():
    """What the scheme of the paper finds is always among all equilibria."""
    n_converged = 0
    for seed in range(25):
        loaded, result = solved(random_field(seed), 5.0, zeta=0.005, outside="constant")
        scheme = solve_fixed_point(loaded)
        if scheme.converged:
            n_converged += 1
            ratios = [state.damping_ratio for state in result.equilibria]
            assert min(abs(scheme.last.damping_ratio / ratio - 1) for ratio in ratios) < 1e-3  # its own tolerance
        else:
            assert scheme.reason
        assert len(scheme.history) == scheme.n_iter + 1
    assert n_converged > 8  # rough fields make it oscillate; the search by exclusion does not care


def test_reasons_are_told():
    field = constant_field(0.6, 0.4, 0.2, frequency=(90.0, 110.0), intensity=(1.0, 10.0))
    _, low = solved(field, 1e-3)
    assert low.equilibria == ()
    assert "less than its field begins" in low.reason
    _, high = solved(field, 1e3)
    assert "where its field ends" in high.reason
    far = constant_field(frequency=(1000.0, 2000.0))
    _, outside = solved(far, 1.0)
    assert "outside the field" in outside.reason
    _, held = solved(far, 1.0, outside="constant")
    assert held.equilibria[0].extrapolated


def test_nodes_and_bad_calls():
    field = Interpolant(constant_field())
    damper = Attached("d", "tip", field, 0.2)
    node = solve_mode(load_mode(one_mode(0.01, (1e-12, 0.3)), 0, "drive", 1.0, [damper]), 1)
    (state,) = node.equilibria
    assert state.damping_ratio == pytest.approx(0.01)
    assert np.isnan(state.intensity[0])
    undriven = solve_mode(load_mode(one_mode(0.01, (0.7, 0.0)), 0, "drive", 1.0, [damper]), 1)
    assert "node" in undriven.reason
    bare = solve_mode(load_mode(one_mode(0.0, (0.0, 0.3)), 0, "drive", 1.0, [damper]), 1)
    assert "no damping" in bare.reason
    with pytest.raises(InputError, match="no point 'top'"):
        load_mode(one_mode(), 0, "drive", 1.0, [damper._replace(point="top")])
    with pytest.raises(InputError, match="above 0"):
        load_mode(one_mode(), 0, "drive", 0.0, [damper])
    with pytest.raises(InputError, match="rigid"):
        load_mode(one_mode(frequency=0.0), 0, "drive", 1.0, [damper])
