"""From simulated forces on walls to a record: signs, units, and what a bed in flight must not be taken for."""

import numpy as np
import pytest

from graindamp.signals.simulated import cycle_values, label_of, point_of, record_of, status_of
from graindamp.status import Status
from runs_made import description, made_run


@pytest.mark.parametrize(("loss_factor", "mass_ratio"), [(0.4, 0.3), (0.0, 1.0), (1.2, -0.2)])
def test_known_bed_comes_back(loss_factor, mass_ratio):
    """Passive beds have eta > 0 and a rigid one m' = 1; the scatter of 1 % over 30 cycles is the only error."""
    run = made_run(loss_factor, mass_ratio, n_snapshot=0)
    point = point_of(run)
    assert point.loss_factor == pytest.approx(loss_factor, abs=4 * point.loss_factor_error + 1e-9)
    assert point.effective_mass_ratio == pytest.approx(mass_ratio, abs=4 * point.effective_mass_ratio_error + 1e-9)
    assert point.intensity == pytest.approx(10.0, rel=1e-3)  # a block mean of 1/200 cycle passes 0.99996 of it
    cycles = cycle_values(run)
    assert len(cycles.loss_factor) == 30
    assert cycles.loss_factor.mean() == pytest.approx(loss_factor, abs=0.01 * loss_factor + 1e-9)
    assert cycles.effective_mass_ratio.mean() == pytest.approx(mass_ratio, abs=0.01 * abs(mass_ratio))


def test_a_bed_that_clings_to_the_container():
    """Force of particles on the walls is -m a; what drives the container then gives m' = 1 and eta = 0."""
    run = made_run(0.0, 1.0, n_snapshot=0)
    moving = np.gradient(run.velocity[:, 0], run.time)
    force = np.zeros_like(run.force)
    force[:, 1, 0] = -run.mass.sum() * moving
    record = record_of(run._replace(force=force))
    inner = slice(5, -5)
    assert np.allclose(record.force[inner], record.bed_mass * moving[inner])


def test_the_record_says_what_it_is():
    run = made_run(n_snapshot=0)
    record = record_of(run)
    assert record.label == "f100_G10"
    assert record.frequency == 100.0
    assert record.nominal_intensity == pytest.approx(10.0)
    assert record.sampling_rate == pytest.approx(20_000.0)
    assert record.container_mass == 0.0
    assert record.bed_mass == pytest.approx(run.mass.sum())
    assert label_of(description(motion={"kind": "rest"}, run={"duration": 0.1})) == "rest"


def test_time_before_the_motion_is_left_out():
    run = made_run(n_snapshot=0)
    early = run._replace(time=run.time - 0.1)
    assert len(record_of(early).force) == len(run.time) - 2000


def test_a_bed_in_flight_is_no_clipped_channel():
    """A bed that only hits one wall leaves the force at 0, its lowest value, for most of the cycle."""
    run = made_run(n_snapshot=0)
    angle = 2 * np.pi * 100 * run.time
    force = np.zeros_like(run.force)
    force[:, 1, 0] = -(np.maximum(np.cos(angle), 0.0) ** 2)
    point = point_of(run._replace(force=force))
    assert not point.status & Status.CLIPPED
    assert point.loss_factor > 0


def test_phase_has_no_error():
    """A nearly lossless bed is not flagged for a phase error that a simulation cannot have."""
    assert not point_of(made_run(1e-3, 1.0, n_snapshot=0)).status & Status.PHASE_UNCERTAIN


def test_status_holds_both_the_engines_and_the_signals_bits():
    run = made_run(n_snapshot=0, status=int(Status.INTERRUPTED))
    few = run._replace(time=run.time[:300], force=run.force[:300], velocity=run.velocity[:300])
    status = status_of(few, point_of(few))
    assert status & Status.INTERRUPTED
    assert status & Status.TOO_SHORT
    none = run._replace(time=run.time[:0], force=run.force[:0], velocity=run.velocity[:0])
    assert point_of(none).status & Status.TOO_SHORT


def test_a_run_without_a_frequency_has_no_cycles():
    assert not len(cycle_values(made_run(n_snapshot=0)._replace(frequency=None)).loss_factor)
