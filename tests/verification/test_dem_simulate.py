"""Whole simulations of a tiny bed: the same again to the last bit, and a velocity field against its own particles."""

from math import pi

import numpy as np
import pytest

from graindamp.dem.simulate import simulate
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec

CELL = 4e-3
STUFF = {"name": "soft", "youngs_modulus": "200 MPa", "poisson_ratio": 0.3, "density": 7900}


def spec_of(tangential, seed=0, integrator="verlet"):
    return parse_spec(
        {
            "damper": {
                "particles": [{"material": STUFF, "radius": {"kind": "uniform", "low": "1.6 mm", "high": "2 mm"}}],
                "fill": {"count": 20},
                "container": {
                    "kind": "cylinder",
                    "radius": "7 mm",
                    "length": "25 mm",
                    "axis": "z",
                    "material": STUFF,
                },
                "lid": {"kind": "rigid", "clearance": "2 mm"},
                "contact": {"restitution": 0.6, "friction": 0.3, "tangential": tangential},
                "packing": {"direction": "-z", "seed": seed, "tap": {"max_cycles": 20}},
            },
            "motion": {"kind": "harmonic", "frequency": 80.0, "intensity": 8.0, "direction": "z"},
            "run": {
                "cycles": 5,
                "snapshots_per_cycle": 4,
                "velocity_field": {"cell": CELL, "phase": 0.5 * pi},
                "integrator": integrator,
            },
        },
        SimulationSpec,
        where="made",
    )


def facts(run):
    """All numbers that a run gives, but for the time it took."""
    numbers = [run.packing.position, run.force, run.velocity, run.cycle_force, run.cycle_velocity, run.centre]
    numbers += [run.energy, run.impact_counts, run.largest_overlap, run.largest_speed, run.contacts_per_particle]
    numbers += [number for snapshot in run.snapshots for number in (*snapshot[:1], *snapshot[2:])]
    return [np.asarray(number) for number in (*numbers, *run.end, run.velocity_field.velocity)]


@pytest.mark.parametrize(("tangential", "integrator"), [("tanh", "verlet"), ("mindlin", "verlet"), ("tanh", "gear")])
def test_the_same_description_gives_the_same_bits(tmp_path, tangential, integrator):
    """Packed, settled and shaken twice, each time from nothing; another seed is another bed."""
    first, again = (
        simulate(spec_of(tangential, integrator=integrator), cache=tmp_path / name) for name in ("first", "again")
    )
    assert first.n_step > 1000
    for one, other in zip(facts(first), facts(again), strict=True):
        assert np.array_equal(one, other, equal_nan=True)
    other = simulate(spec_of(tangential, 1, integrator), cache=tmp_path / "other")
    assert not np.array_equal(first.force, other.force)


def test_velocity_field_is_the_mean_over_the_particles_in_each_cell(tmp_path):
    """Snapshots at the same phase hold the particles that the field was averaged over."""
    run = simulate(spec_of("tanh"), cache=tmp_path)
    field = run.velocity_field
    at_phase = [s for s in run.snapshots if abs(s.phase - 0.5 * pi) < 0.1]
    assert len(at_phase) == field.n_cycle == 5
    position, velocity = (np.concatenate([s[k] for s in at_phase]) for k in (2, 3))
    assert field.met.sum() == len(position) == 5 * 20
    assert abs(velocity).max() > 0.05
    for place in np.ndindex(field.met.shape):
        low = field.origin + CELL * np.array(place)
        inside = ((position >= low) & (position < low + CELL)).all(axis=1)
        assert inside.sum() == field.met[place]
        if inside.any():
            # Rounding of a mean of some ten numbers.
            np.testing.assert_allclose(field.velocity[place], velocity[inside].mean(axis=0), rtol=1e-13, atol=1e-16)
        else:
            assert np.isnan(field.velocity[place]).all()
    assert (field.cell, field.phase) == (CELL, 0.5 * pi)
