"""Packing: what is stored and when it is reused, what is refused, and the geometry under a bed's height."""

import math

import numpy as np
import pytest

from graindamp.dem import packing as packing_module
from graindamp.dem.cavity import Cavity, overlapping, random_places
from graindamp.dem.container import enclosure_of
from graindamp.dem.interactions import interactions_of
from graindamp.dem.packing import PHYSICS, pack, packed
from graindamp.dem.packing_store import load, packing_key, save
from graindamp.dem.settle import SOFT_OVERLAP, softened, softening, time_step
from graindamp.errors import InputError
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import DamperSpec

SOFT = {"name": "soft", "youngs_modulus": "2 GPa", "poisson_ratio": 0.3, "density": 2500}
CYLINDER = {"kind": "cylinder", "radius": "10 mm", "length": "40 mm", "material": SOFT}
SHORT_TAP = {"tap": {"max_cycles": 20}}


def damper(**changes):
    told = {
        "particles": [{"material": SOFT, "radius": "2 mm"}],
        "fill": {"count": 60},
        "container": CYLINDER,
        "contact": {"law": "hertz-viscoelastic", "restitution": 0.6, "friction": 0.2, "tangential": "mindlin"},
        "packing": SHORT_TAP,
        **changes,
    }
    return parse_spec({key: value for key, value in told.items() if value is not None}, DamperSpec, "test")


def cavity_of(spec):
    return Cavity(spec, enclosure_of(spec, interactions_of(spec)), 1e-6)


@pytest.mark.slow
def test_same_seed_same_bed_and_another_seed_another():
    first, again, other = (packed(damper(packing={**SHORT_TAP, "seed": seed})) for seed in (0, 0, 1))
    assert np.array_equal(first.position, again.position)
    assert (first.height, first.top, first.tap_cycles) == (again.height, again.top, again.tap_cycles)
    assert not np.array_equal(first.position, other.position)


@pytest.mark.slow
def test_a_packing_is_stored_and_reused(tmp_path, monkeypatch):
    first = pack(damper(), cache=tmp_path)
    monkeypatch.setattr(packing_module, "packed", None)  # a second packing would fail
    again = pack(damper(name="other name", gravity="none"), cache=tmp_path)
    assert np.array_equal(first.position, again.position)
    assert first._replace(position=0, radius=0, component=0) == again._replace(position=0, radius=0, component=0)
    assert len(list(tmp_path.iterdir())) == 1


def test_a_damaged_file_is_packed_again_with_a_warning(tmp_path):
    first = pack(damper(fill={"count": 3}), cache=tmp_path)
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:300])
    with pytest.warns(UserWarning, match="packed again"):
        again = pack(damper(fill={"count": 3}), cache=tmp_path)
    assert np.array_equal(first.position, again.position)
    assert np.array_equal(load(path).position, first.position)


def test_an_interrupted_packing_leaves_nothing(tmp_path):
    def interrupt(stage, fraction, left):
        if stage == "tap":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pack(damper(fill={"count": 3}), cache=tmp_path, progress=interrupt)
    assert list(tmp_path.iterdir()) == []


def test_progress_names_stages_and_ends_at_one():
    told = []
    packed(damper(fill={"count": 3}), progress=lambda *args: told.append(args))
    assert {stage for stage, _, _ in told} == {"place", "pour", "settle", "tap", "stiffen", "lid"}
    assert all(0.0 <= fraction <= 1.0 and (left is None or left >= 0.0) for _, fraction, left in told)


@pytest.mark.parametrize(
    "changes",
    [
        {"fill": {"count": 61}},
        {"packing": {"tap": False}},
        {"contact": {"restitution": 0.6, "friction": 0.3}},
        {"lid": {"kind": "rigid", "clearance": "2 mm"}},
    ],
)
def test_what_changes_the_bed_changes_its_key(changes):
    assert packing_key(damper(**changes), PHYSICS, None) != packing_key(damper(), PHYSICS, None)
    assert packing_key(damper(), PHYSICS + 1, None) != packing_key(damper(), PHYSICS, None)


def test_loss_of_foam_does_not_change_the_key():
    def key(loss):
        lid = {"kind": "foam", "height": "20 mm", "coefficients": [100, 0, 0], "travel": "5 mm", "loss_factor": loss}
        return packing_key(damper(lid=lid), PHYSICS, None)

    assert key(0.0) == key(0.5)


def test_optional_values_survive_the_file(tmp_path):
    found = packed(damper(fill={"count": 1}))
    save(tmp_path / "one.npz", found)
    again = load(tmp_path / "one.npz")
    assert again.lid_height is None
    assert again.clearance is None
    assert again.height == found.height
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "none.npz")


def test_one_particle_is_a_bed_of_one_diameter():
    found = packed(damper(fill={"count": 1}, lid={"kind": "rigid", "clearance": "3 mm"}))
    assert found.height == pytest.approx(4e-3, rel=1e-3)  # overlap at rest
    assert found.lid_height == pytest.approx(7e-3, rel=1e-3)
    assert found.clearance == pytest.approx(3e-3, rel=1e-12)


def test_a_bed_too_large_for_container_and_clearance_says_what_fits():
    short = {**CYLINDER, "length": "20 mm"}
    with pytest.raises(InputError, match=r"at most about \d+ particles"):
        packed(damper(container=short, fill={"count": 110}, lid={"kind": "rigid", "clearance": "5 mm"}))


def test_planes_without_a_floor_are_refused():
    walls = {"kind": "walls", "material": SOFT, "planes": [{"name": "a", "point": [0, 0, 0], "normal": "x"}]}
    with pytest.raises(InputError, match="floor"):
        packed(damper(container=walls))


def test_a_lid_that_would_cut_an_insert_is_refused():
    star = {"kind": "star", "material": SOFT, "position": "30 mm", "width": "3 mm"}
    with pytest.raises(InputError, match="above the lid"):
        packed(damper(inserts=[star], lid={"kind": "rigid", "clearance": "3 mm"}))


def test_random_places_do_not_overlap_and_lie_inside():
    spec = damper(inserts=[{"kind": "star", "material": SOFT, "position": "15 mm", "width": "3 mm"}])
    cavity = cavity_of(spec)
    rng = np.random.default_rng(0)
    radius = rng.uniform(1e-3, 2e-3, 100)
    place = random_places(cavity, radius, 0.04, rng)
    assert len(overlapping(place, radius)[0]) == 0
    assert (cavity.gaps(place, radius) >= 0.0).all()


def test_sampled_volumes_match_closed_forms():
    sphere = cavity_of(damper(container={"kind": "sphere", "radius": "15 mm", "material": SOFT}))
    # a million evenly spread points: 1e-3 is several times their scatter
    assert sphere.volume_below(0.03) == pytest.approx(4 / 3 * math.pi * 0.015**3, rel=1e-3)
    half = np.array([[0.0, 0.0, -0.015 * 3 / 8]])  # the centre of half a ball lies 3/8 of its radius off the middle
    assert sphere.bed_level(half, np.ones(1)) == pytest.approx(0.015, rel=1e-3)
    star = damper(inserts=[{"kind": "star", "material": SOFT, "position": "15 mm", "width": "3 mm"}])
    free = star.container.volume - star.inserts[0].volume_in(0.01)
    assert cavity_of(star).free_volume() == pytest.approx(free, rel=1e-3)


def test_the_level_of_a_straight_container_is_twice_the_centre():
    cavity = cavity_of(damper())
    position = np.array([[0.004, 0.0, 0.0], [0.010, 0.001, 0.0]])
    assert cavity.bed_level(position, np.ones(2)) == pytest.approx(0.014, rel=1e-12)


def test_softening_gives_the_overlap_asked_for_and_never_stiffens():
    interactions = interactions_of(damper(contact={"restitution": 0.6, "friction": 0.2}))
    radius, speed = np.full(3, 2e-3), 1.0
    divisor = softening(interactions, radius, speed, 0.0)
    soft = softened(interactions, divisor)
    mass = 2500 * 4 / 3 * math.pi * 2e-3**3  # the heaviest contact, with a wall
    stiffness = soft.pair[0, 1, 0] * math.sqrt(2e-3)
    assert (1.25 * mass * speed**2 / stiffness) ** 0.4 == pytest.approx(SOFT_OVERLAP * 2e-3, rel=1e-9)
    assert np.all(softening(interactions, radius, 1e6, 0.0) == 1.0)
    ratio = time_step(soft, radius, SOFT_OVERLAP) / time_step(interactions, radius, SOFT_OVERLAP)
    assert ratio > 1.0
