import numpy as np
import pytest
from numpy.testing import assert_array_equal

from field_made import field_document
from graindamp.dem import engine
from graindamp.dem.container import enclosure_of
from graindamp.dem.energy import velocity_now
from graindamp.dem.interactions import interactions_of
from graindamp.dem.packing import PHYSICS, pack
from graindamp.dem.settle import Grains, Scene, time_step
from graindamp.dem.turned import turned
from graindamp.spec.simulation import DamperSpec


def damper(**changes):
    return DamperSpec.model_validate(field_document()["damper"] | changes)


def rms_speed_after(spec, packing, time):
    """Root mean square speed of a bed left to itself from rest [m/s]."""
    interactions = interactions_of(spec)
    material = np.asarray(interactions.component, np.int32)[packing.component]
    grains = Grains.at_rest(packing.position, packing.radius, material, interactions.density)
    scene = Scene(enclosure_of(spec, interactions, lid_height=packing.lid_height), interactions, spec.gravity)
    step = time_step(interactions, packing.radius, 1e-3)
    worlds = engine.run(scene.worlds(grains, step), round(time / step))
    return float(np.sqrt(np.mean(np.sum(velocity_now(worlds)[0] ** 2, axis=1))))


@pytest.mark.slow
def test_a_bed_that_was_turned_rests_under_its_new_gravity(tmp_path):
    """40 spheres slide off each other at once when the cylinder is laid down; settled, they move under 2 mm/s, a
    fiftieth of a fall over a radius."""
    spec = damper()
    packing = pack(spec, cache=tmp_path)
    settled = turned(spec, packing, physics=PHYSICS, cache=tmp_path)
    assert rms_speed_after(spec, packing, 5e-3) > 0.02
    assert rms_speed_after(spec, settled, 5e-3) < 2e-3
    # Lower than before, and inside: nothing else of the packing changes.
    assert settled.position[:, 2].mean() < packing.position[:, 2].mean()
    assert np.hypot(settled.position[:, 1], settled.position[:, 2]).max() < 5e-3
    assert settled._replace(position=packing.position) == packing

    again = turned(spec, packing, physics=PHYSICS, cache=tmp_path)
    assert_array_equal(again.position, settled.position)

    # The same bed under another lid is another bed, in the cache too.
    higher = packing._replace(lid_height=packing.lid_height + 1e-3, clearance=packing.clearance + 1e-3)
    assert turned(spec, higher, physics=PHYSICS, cache=tmp_path).lid_height == higher.lid_height
    assert turned(spec, packing, physics=PHYSICS, cache=tmp_path).lid_height == packing.lid_height


@pytest.mark.parametrize("gravity", ["-x", "none"])
def test_a_bed_that_was_not_turned_stays_as_packed(gravity, tmp_path):
    spec = damper(gravity=gravity)
    packing = pack(damper(fill={"count": 2}, gravity=gravity), cache=tmp_path)
    assert turned(spec, packing, physics=PHYSICS, cache=tmp_path) is packing
