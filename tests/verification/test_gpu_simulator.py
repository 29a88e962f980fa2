"""The GPU back end in numba's simulator, which runs kernels as Python: the same numbers as the processor's engine."""

from unittest.mock import patch

import numpy as np
import pytest

pytest.importorskip("numba_cuda", reason="the extra `gpu` (numba-cuda) is not installed")

from dem_made import FLOOR, STEEL, channel, damper_of, harmonic, loose
from gpu_made import Launched, Team, alone_kernels, bed_of, both, packing_of, quick_turns, spec_of
from graindamp.dem.gpu import batch, device, load, memory
from graindamp.dem.gpu.batch import Task, simulate_batch
from graindamp.dem.gpu.device import Builder, Variant
from graindamp.dem.gpu.kernels import Kernels, advance, kernels_of
from graindamp.dem.gpu.memory import Memory
from graindamp.dem.simulate import simulate
from graindamp.dem.world import motion_at_rest
from graindamp.errors import InputError
from graindamp.signals.simulated import ratios_of
from graindamp.signals.stopping import Stopping
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec

RADIUS = 2.5e-3
DOUBLE = 1e-9
"""Relative to the largest value. Sums have the processor's order; what differs is the form of the overlap, rounding of
one part in 1e-16 magnified by a few contacts."""
MIXED = 1e-5
"""Single precision has 6e-8; a few hundred steps of a few contacts magnify it."""


def assert_close(device, cpu, tolerance):
    for a, b in zip(device[:3], cpu[:3], strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * max(np.abs(b).max(), 1e-12))
    # Energies over what was turned over; sums over the largest of them.
    scale = max(cpu[3].stored, cpu[3].lost)
    np.testing.assert_allclose(device[3], cpu[3], rtol=0, atol=10 * tolerance * scale)
    np.testing.assert_allclose(device[4], cpu[4], rtol=0, atol=10 * tolerance * max(np.abs(cpu[4]).max(), 1e-12))


def eight_balls():
    """Spheres of three sizes, about to meet each other and the walls."""
    rng = np.random.default_rng(5)
    place = loose(8, 2.2 * RADIUS, np.zeros(3), np.array([0.0132, 0.0132, 0.03]), seed=4, shuffle=0.04)
    return bed_of(place, rng.choice([0.8, 0.9, 1.0], 8) * RADIUS, rng.normal(0, 0.5, (8, 3)), rng.normal(0, 20, (8, 3)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("precision", "contact"),
    [
        ("double", {"tangential": "tanh"}),
        ("mixed", {"tangential": "tanh"}),
        ("double", {"tangential": "mindlin", "rolling_friction": 0.02, "tangential_dashpot": 0.2}),
        ("mixed", {"tangential": "mindlin", "rolling_friction": 0.02, "tangential_dashpot": 0.2}),
        ("double", {"law": "linear", "stiffness": 2e4, "tangential": "linear"}),
        ("mixed", {"law": "hertz-viscoelastic", "tangential": "none", "tension": True}),
    ],
)
def test_shaken_balls_move_as_on_the_processor(precision, contact):
    softening = {} if "stiffness" in contact else {"softening": 1000.0}
    damper = damper_of(
        STEEL,
        {**STEEL, "name": "wall"},
        {"kind": "box", "size": [0.0125, 0.0125, 0.03]},
        restitution=0.7,
        **{"friction": 0.3, **softening, **contact},
    )
    cpu, device = both(damper, eight_balls(), lambda: harmonic(60.0, 1e-3, (0.6, 0.0, 0.8)), 8e-6, 150, precision)
    assert cpu[3].lost > 1e-5  # there were impacts
    assert_close(device, cpu, DOUBLE if precision == "double" else MIXED)


@pytest.mark.slow
@pytest.mark.parametrize("blocks", [2, 3])
def test_a_team_of_blocks_shares_a_world(blocks):
    """Blocks that run side by side and meet through a counter in memory."""
    damper = damper_of(
        STEEL,
        {**STEEL, "name": "wall"},
        {"kind": "box", "size": [0.0125, 0.0125, 0.03]},
        restitution=0.7,
        friction=0.3,
        tangential="mindlin",
        softening=1000.0,
    )
    cpu, device = both(
        damper,
        eight_balls(),
        lambda: harmonic(60.0, 1e-3, (0.6, 0.0, 0.8)),
        8e-6,
        150,
        "double",
        team=Team(blocks, 4),
    )
    assert_close(device, cpu, DOUBLE)


@pytest.mark.parametrize("precision", ["double", "mixed"])
@pytest.mark.parametrize("restitution", [0.3, 0.9])
def test_restitution_of_one_ball(precision, restitution):
    """The asked restitution to the error of some 40 steps in a bounce, the processor's to rounding."""
    damper = damper_of(STEEL, STEEL, FLOOR, restitution=restitution, softening=1e4)
    bed = bed_of([0.0, 0.0, 1.0001e-3], 1e-3, [0.0, 0.0, -0.1])
    cpu, device = both(damper, bed, motion_at_rest, 5e-6, 90, precision, gravity=(0.0, 0.0, 0.0))
    assert device[1][0, 2] == pytest.approx(0.1 * restitution, rel=0.02)
    assert_close(device, cpu, DOUBLE if precision == "double" else MIXED)


def test_nanometres_of_overlap_far_from_the_origin():
    """Mixed precision keeps positions and their differences double. Half a metre from the origin single precision knows
    places to 30 nm; two balls and a ball at a wall overlap by 2 nm there, and the force follows."""
    far, overlap, radius = 0.5, 2e-9, 1e-3
    damper = damper_of(STEEL, STEEL, channel(far + radius - overlap), restitution=0.9)
    places = [[far, 0.0, far], [far, 0.0, far - 2 * radius + overlap], [-far, far, far]]
    cpu, device = both(damper, bed_of(places, radius), motion_at_rest, 1e-7, 40, "mixed", gravity=(0.0, 0.0, 0.0))
    assert cpu[3].stored > 0.0
    assert np.all(np.abs(cpu[1][:, 2]) > 1e-6)
    # The overlap is what is left of places of 0.5 m that double precision knows to 6e-17 m: 3e-8 of it.
    assert_close(device, cpu, MIXED)


@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_walls_of_many_shapes(precision):
    """A ball each at foam, a solid box, a solid cylinder, and the shell and end of a cylinder."""
    inserts = (
        {"kind": "box", "material": "steel", "center": [0.0, 0.0, 0.01], "size": [4e-3, 4e-3, 4e-3], "angle": 0.4},
        {
            "kind": "cylinder",
            "material": "steel",
            "start": [-0.02, 8e-3, 0.02],
            "end": [0.02, 8e-3, 0.02],
            "radius": 2e-3,
        },
    )
    damper = damper_of(
        STEEL,
        {**STEEL, "name": "wall"},
        {"kind": "cylinder", "axis": "z", "radius": 0.015, "length": 0.05},
        inserts,
        {"kind": "foam", "height": 0.045, "coefficients": [2e3, 1e5, 1e7], "travel": 5e-3, "loss_factor": 0.3},
        restitution=0.6,
        friction=0.2,
        tangential="tanh",
        softening=1000.0,
    )
    places = [
        [0.0, 0.0, 0.0439],
        [2.855e-3, 1.207e-3, 0.01],
        [0.0, 4.9e-3, 0.0205],
        [0.0, -0.01385, 0.01],
        [0.005, -0.005, 1.1e-3],
    ]
    speeds = [[0.1, 0.0, 0.6], [-0.5, 0.1, 0.0], [0.0, 0.5, 0.0], [0.3, -0.5, 0.0], [0.0, 0.2, -0.5]]
    bed = bed_of(places, 1e-3, speeds)
    cpu, device = both(
        damper, bed, lambda: harmonic(60.0, 1e-3, (0.0, 0.0, 1.0)), 5e-6, 100, precision, lid_height=0.05
    )
    assert cpu[3].loss_lid > 0.0
    assert np.all(np.abs(cpu[1] - speeds).max(axis=1) > 0.02)  # each met its wall
    assert_close(device, cpu, DOUBLE if precision == "double" else MIXED)


@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_wall_of_a_mesh(precision, tmp_path):
    """Balls at a face, an edge between two coplanar triangles, and a corner of a box."""
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box(bounds=[[0, 0, 0], [20, 20, 20]]).export(tmp_path / "box.stl")
    mesh = {"kind": "mesh", "file": "box.stl", "length_unit": "mm"}
    damper = damper_of(
        STEEL, {**STEEL, "name": "wall"}, mesh, restitution=0.6, friction=0.2, tangential="mindlin", softening=1000.0
    )
    places = [[0.006, 0.012, 1.05e-3], [0.0101, 0.01, 1.05e-3], [1.1e-3, 1.05e-3, 0.01]]
    bed = bed_of(places, 1e-3, [[0.1, 0.2, -0.5], [-0.4, 0.1, -0.5], [-0.5, -0.4, 0.3]])
    cpu, device = both(damper, bed, motion_at_rest, 5e-6, 80, precision, folder=tmp_path)
    assert cpu[3].loss_normal_wall > 0.0
    assert_close(device, cpu, DOUBLE if precision == "double" else MIXED)


TASKS = [(6, 1000.0, 100.0), (4, 1300.0, 150.0), (5, 1100.0, 40.0)]
"""Particles, frequency [Hz], intensity."""


def tasks():
    return [Task(spec_of(count, f, intensity), packing_of(count)) for count, f, intensity in TASKS]


def run_all(given, **options):
    """All runs, by number of the task."""
    options = {"precision": "double", "variant": Variant(threads=4), "chunk": 150, **options}
    is_alone = options["variant"].threads == 1 and "team" not in options
    kernels = alone_kernels if is_alone else batch.kernels_of
    with quick_turns(), patch.object(batch, "kernels_of", kernels):
        return dict(simulate_batch(given, **options))


def facts(run):
    """All of a run that must agree to the last bit."""
    return [run.cycle_force, run.cycle_velocity, run.impact_counts, *run.end, np.array(run.energy)]


@pytest.fixture(scope="module")
def two_slots():
    return run_all(tasks(), slots=2)


@pytest.mark.slow
def test_a_batch_gives_what_single_runs_give(two_slots):
    """Worlds of different size, frequency and intensity; the third takes the place of the first that ends."""
    assert sorted(two_slots) == [0, 1, 2]
    for number, (spec, packing, _) in enumerate(tasks()):
        cpu, device = simulate(spec, packing=packing), two_slots[number]
        assert device.status == cpu.status
        assert (device.n_step, device.time_step) == (cpu.n_step, cpu.time_step)
        np.testing.assert_array_equal(device.impact_counts, cpu.impact_counts)
        for a, b in zip(device.end, cpu.end, strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=DOUBLE * np.abs(b).max())
        np.testing.assert_allclose(device.cycle_force, cpu.cycle_force, rtol=DOUBLE)
        np.testing.assert_allclose(device.cycle_velocity, cpu.cycle_velocity, rtol=DOUBLE)
        np.testing.assert_allclose(device.energy[-1], cpu.energy[-1], atol=DOUBLE * cpu.energy[-1].stored)
        np.testing.assert_allclose(device.centre[-1], cpu.centre[-1], atol=DOUBLE * 1e-3)
        assert device.contacts_per_particle == pytest.approx(cpu.contacts_per_particle)
        assert device.wall_contacts == pytest.approx(cpu.wall_contacts)


def different_tasks():
    """Operating points that share nothing but the batch: walls, materials, contacts, gravity and kind of motion differ.
    In each a ball is 0.05 mm from a wall that meets it."""
    usual = spec_of(3).damper.model_dump()
    brief, cycle = {"duration": 6e-4, "settle": 0.0}, {"cycles": 1, "settle": 5e-5}

    def task(count, motion, run, shift=(-0.15e-3, 0.0, 0.0), **damper):
        told = {"damper": {**usual, **damper, "fill": {"count": count}}, "motion": motion, "run": run}
        packing = packing_of(count)
        return Task(parse_spec(told, SimulationSpec, "made"), packing._replace(position=packing.position + shift))

    box = {"kind": "box", "size": [8e-3, 8e-3, 6e-3], "material": "steel"}
    slope = {
        "kind": "walls",
        "planes": [{"name": "slope", "point": [0.0, 0.0, -1.8e-3], "normal": [0.2, 0.0, 1.0]}],
        "material": "steel",
    }
    spring = {"restitution": 0.8, "friction": 0.4, "tangential": "mindlin", "rolling_friction": 0.02, "softening": 1e4}
    viscoelastic = {"law": "hertz-viscoelastic", "restitution": 0.5, "friction": 0.1, "softening": 1e4}
    light = [{"material": "aluminium-6060", "radius": 1e-3}]
    sweep = {"kind": "sweep", "start": 900.0, "stop": 1500.0, "duration": 6e-4, "speed": 0.4}
    waves = [
        {"frequency": 1000.0, "intensity": 200.0, "phase": 1.0},
        {"frequency": 2000.0, "intensity": 60.0, "direction": "z"},
    ]
    noise = {"kind": "random", "frequencies": [800.0, 2000.0], "psd": [2e3, 2e3], "duration": 4e-3, "seed": 3}
    return [
        task(3, {"kind": "harmonic", "frequency": 1000.0, "intensity": 200.0}, cycle),
        task(4, sweep, brief, (-0.15e-3, 4e-3, 3e-3), container=box, contact=spring),
        task(2, {"kind": "rest"}, brief, container=slope, gravity=[30.0, 0.0, -3000.0]),
        task(2, {"kind": "series", "file": "shaken.npz"}, brief, particles=light, contact=viscoelastic),
        task(
            3, {"kind": "harmonics", "components": waves}, cycle, particles=light, contact={**spring, "friction": 0.1}
        ),
        task(2, noise, brief),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_worlds_that_share_nothing_run_in_one_batch(tmp_path, precision):
    """All kinds of motion, and four worlds at a time for six; each is what the processor makes of it alone."""
    time = np.linspace(0.0, 2e-3, 201)
    np.savez(tmp_path / "shaken.npz", time=time, acceleration=1500.0 * np.cos(2.0 * np.pi * 700.0 * time))
    given = different_tasks()
    assert {task.spec.motion.kind for task in given} == {"harmonic", "harmonics", "sweep", "rest", "series", "random"}
    runs = run_all(given, slots=4, folder=tmp_path, precision=precision, variant=Variant(threads=1))
    tolerance = DOUBLE if precision == "double" else MIXED
    for number, (spec, packing, _) in enumerate(given):
        cpu, device = simulate(spec, packing=packing, folder=tmp_path), runs[number]
        assert cpu.impact_counts[1].sum() > 0, spec.motion.kind
        assert (device.status, device.n_step, device.time_step) == (cpu.status, cpu.n_step, cpu.time_step)
        np.testing.assert_array_equal(device.impact_counts, cpu.impact_counts)
        last, own = cpu.energy[-1], device.energy[-1]
        np.testing.assert_allclose(own, last, rtol=0, atol=10 * tolerance * max(last.stored, last.lost))
        np.testing.assert_allclose(device.centre[-1], cpu.centre[-1], rtol=0, atol=tolerance * 1e-3)
        # Ten times as much in sums over a cycle, in which forces of impacts partly cancel.
        np.testing.assert_allclose(device.cycle_force, cpu.cycle_force, rtol=10 * tolerance)
        np.testing.assert_allclose(device.cycle_velocity, cpu.cycle_velocity, rtol=DOUBLE)


@pytest.mark.slow
def test_results_depend_neither_on_neighbours_nor_on_launches(two_slots):
    """Bit for bit: alone, with other pieces, and again."""
    alone = run_all(tasks()[:1], slots=1, chunk=37)
    for a, b in zip(facts(alone[0]), facts(two_slots[0]), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.slow
def test_full_lists_grow_and_nobody_can_tell(two_slots, monkeypatch):
    monkeypatch.setattr(load, "PAIRS_PER_PARTICLE", 0.0)
    monkeypatch.setattr(load, "TOUCHES_PER_PARTICLE", 0.0)
    monkeypatch.setattr(load, "LEAST_ROOM", 2)
    tight = run_all(tasks()[:1], slots=1)
    for a, b in zip(facts(tight[0]), facts(two_slots[0]), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.slow
def test_too_little_memory_means_fewer_slots(monkeypatch):
    """Two worlds fit, but not the longer lists of both; they start anew one after the other."""
    monkeypatch.setattr(load, "LEAST_ROOM", 2)
    monkeypatch.setattr(load, "PAIRS_PER_PARTICLE", 0.0)
    empty, refused = memory._empty, []

    def little(shape, kind):
        if shape[0] > 1 and len(shape) == 2 and shape[1] not in (2, 4, 5, 6) and 7 < shape[1] < 40:
            refused.append(shape)
            raise MemoryError
        return empty(shape, kind)

    monkeypatch.setattr(batch, "LAUNCH_SECONDS", 1.0)
    monkeypatch.setattr(memory, "_empty", little)
    runs = run_all([Task(spec_of(4, cycles=1), packing_of(4)), Task(spec_of(5, cycles=1), packing_of(5))], slots=2)
    assert refused
    assert sorted(runs) == [0, 1]
    assert all(len(run.cycle_force) == 1 for run in runs.values())


def bouncing(cycles=16, frequency=1500.0, intensity=2200.0):
    """An operating point of two balls that meet ends and each other, 40 steps per cycle."""
    spec = spec_of(2, frequency, intensity, cycles=cycles)
    coarse = {"steps_per_contact": 10.0, "sample_rate": 20.0 * frequency}
    return Task(spec.model_copy(update={"run": spec.run.model_copy(update=coarse)}), packing_of(2))


def on_the_processor(task, rule):
    """The run of a task, ended by a rule."""
    omega, mass = 2.0 * np.pi * task.spec.base_frequency, np.sum(4.0 / 3.0 * np.pi * task.packing.radius**3 * 7850.0)

    def enough(cycles):
        values = ratios_of(cycles.force, cycles.velocity, omega, mass)
        return rule.enough(values.loss_factor, values.effective_mass_ratio)

    return simulate(task.spec, packing=task.packing, enough=enough)


def stopping(number=0):
    """A rule that looks at eight cycles, and is content after some more."""
    return Stopping(0.02, 0.05, 8)


@pytest.fixture(scope="module")
def stopped():
    """A run that its rule ends in the middle of a launch."""
    return run_all([bouncing()], stopping=stopping, slots=1, chunk=10**6, variant=Variant(threads=1))[0]


@pytest.mark.slow
def test_the_device_ends_a_run_that_is_known_well_enough(stopped, monkeypatch):
    """With the cycle with which the processor ends it; what has no rule beside it runs on, and the next world takes its
    slot. A slot is added under way, and what the cycles before gave is kept. The host reads rows of worlds that have
    ended and of no other."""
    read, asked = Memory.read, []

    def reads(self, part, name, slot=None):
        asked.append((part, name))
        return read(self, part, name, slot)

    monkeypatch.setattr(Memory, "read", reads)
    given = [bouncing(), bouncing(11, 1300.0), bouncing(9)]
    rules = [stopping(), None, Stopping(1e-9, 1e-9, 8)]
    runs = run_all(hesitant(given), stopping=rules.__getitem__, slots=2, chunk=150, variant=Variant(threads=1))
    cpu = [on_the_processor(given[0], stopping()), *(simulate(task.spec, packing=task.packing) for task in given[1:])]
    assert [len(run.cycle_force) for run in cpu] == [10, 11, 9]
    for number, one in enumerate(cpu):
        assert runs[number].n_step == one.n_step
        np.testing.assert_allclose(runs[number].cycle_force, one.cycle_force, rtol=DOUBLE)
        for a, b in zip(runs[number].end, one.end, strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * max(np.abs(b).max(), 1.0))
    assert list(runs) == [0, 1, 2]
    assert asked.count(("slots", "rows")) == len(given) + 1  # and once as all arrays were made anew
    for a, b in zip(facts(runs[0]), facts(stopped), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.slow
def test_a_team_ends_with_the_cycle_that_is_enough(stopped, monkeypatch):
    """All blocks leave the world after the same step, though one alone has judged it."""

    def kernels(variant):
        team, clear = Team(2, 2), kernels_of(variant).clear
        with monkeypatch.context() as patch:
            patch.setattr(device, "_SimulatedCuda", lambda: team)
            return Kernels(Launched(team, Builder(variant).plain(advance)), clear)

    monkeypatch.setattr(batch, "kernels_of", kernels)
    run = run_all([bouncing()], stopping=stopping, slots=1, team=2, chunk=390, variant=Variant(threads=2))[0]
    assert run.n_step == stopped.n_step
    np.testing.assert_allclose(run.end.position, stopped.end.position, rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("launches", "cycles"), [(0, 8), (1, 10)])
def test_worlds_in_a_hurry_end_with_their_next_cycle(launches, cycles):
    """From the start: with the fewest cycles of a mean. After 390 steps, 3 of them at rest: with the tenth."""
    asked = iter(range(100))
    runs = run_all(
        [bouncing(), bouncing()],
        stopping=[None, Stopping(1e-9, 1e-9, 8)].__getitem__,
        hurry=lambda: next(asked) >= launches,
        slots=2,
        chunk=390,
        variant=Variant(threads=1),
    )
    assert [len(run.cycle_force) for run in runs.values()] == [cycles, cycles]
    assert next(asked) == launches + 1  # what is true once is not asked again


@pytest.mark.slow
def test_a_run_goes_on_where_another_ended():
    first = simulate(spec_of(4, cycles=1), packing=packing_of(4))
    spec = spec_of(4, 1100.0, cycles=1)
    cpu = simulate(spec, packing=packing_of(4), start=first.end)
    device = run_all([Task(spec, packing_of(4), first.end)])[0]
    np.testing.assert_allclose(device.cycle_force, cpu.cycle_force, rtol=DOUBLE)
    np.testing.assert_allclose(device.end.velocity, cpu.end.velocity, rtol=0, atol=DOUBLE)


def test_what_the_batch_does_not_do():
    spec = spec_of()
    wanted = spec.model_copy(update={"run": spec.run.model_copy(update={"snapshots_per_cycle": 2})})
    with pytest.raises(InputError, match=r"snapshots_per_cycle is not available on the GPU"):
        run_all([Task(wanted, packing_of(6))])
    with pytest.raises(InputError, match="mixed"):
        run_all([], precision="half")


def hesitant(given):
    """The tasks one by one, with a moment between them in which there is none."""
    for task in given:
        yield task
        yield None


@pytest.mark.slow
@pytest.mark.parametrize("most", [2, 1])
def test_tasks_that_come_later_get_slots_of_their_own(most, monkeypatch):
    """The second world comes after the first launch; where memory for two is refused it takes the place of the first.
    Bit for bit what one batch gives."""
    given = [Task(spec_of(count, cycles=1), packing_of(count)) for count in (3, 2)]
    together = run_all(given, slots=2, variant=Variant(threads=1))
    empty, slots = memory._empty, []

    def little(shape, kind):
        slots.append(shape[0])
        if shape[0] > most:
            raise MemoryError
        return empty(shape, kind)

    monkeypatch.setattr(memory, "_empty", little)
    one_by_one = run_all(hesitant(given), slots=2, chunk=70, variant=Variant(threads=1))
    assert max(slots) == 2
    assert sorted(one_by_one) == [0, 1]
    for number, run in one_by_one.items():
        for a, b in zip(facts(run), facts(together[number]), strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_refused_task_is_told_and_numbers_stay():
    wanted = spec_of(2, cycles=1)
    wrong = wanted.model_copy(update={"run": wanted.run.model_copy(update={"snapshots_per_cycle": 2})})
    told = {}
    tasks = [Task(wrong, packing_of(2)), None, Task(wrong, packing_of(2))]
    assert run_all(tasks, refused=told.__setitem__) == {}
    assert list(told) == [0]  # nothing was under way: the batch has ended
    assert "snapshots_per_cycle" in str(told[0])
