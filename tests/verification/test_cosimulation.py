"""Particles and structure simulated together, against closed forms, the event-driven solver and conservation."""

import numpy as np
import pytest

from dem_made import FLOOR, channel, damper_of
from graindamp.couple.cosimulate import (
    Carried,
    Case,
    HarmonicForce,
    SampledForce,
    SweptForce,
    cosimulate,
    cosimulate_batch,
    force_values,
    released,
)
from graindamp.dem.packing_store import Packing
from graindamp.errors import InputError
from graindamp.impact.simulate import at_rest
from graindamp.impact.simulate import simulate as events
from graindamp.impact.system import Ball, on_structure, oscillator
from graindamp.structure.modal import ModalModel

RADIUS = 1e-3
SOFT = {"name": "ball", "youngs_modulus": 2e8, "poisson_ratio": 0.3, "density": 7900.0}
MASS = 7900.0 * 4.0 / 3.0 * np.pi * RADIUS**3


def bed_of(position, radius=RADIUS):
    """A bed that was placed by hand."""
    n = len(position)
    return Packing(np.array(position, float), np.full(n, radius), np.zeros(n, np.int32), 0, 0, 0, 0.5, None, None, 0, 0)


def weightless(**options):
    return damper_of(radius=RADIUS, **{"particle": SOFT, **options}).model_copy(update={"gravity": (0.0, 0.0, 0.0)})


def on_springs(stiffness, overlap):
    """A ball held by two linear springs, one of each wall, that never let go."""
    damper = weightless(container=channel(2.0 * (RADIUS - overlap), "x"), law="linear", stiffness=stiffness)
    return Carried(damper, "mass", packing=bed_of([[RADIUS - overlap, 0, 0]]))


def box_of_balls(side=4, gap=1.02, friction=0.3, seed=0):
    """A cube of balls with room to move, in a box."""
    rng = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(*3 * [np.arange(side)], indexing="ij"), axis=-1).reshape(-1, 3)
    pitch = 2.0 * RADIUS * gap
    position = pitch * (cells + 0.5) + rng.uniform(-0.4, 0.4, cells.shape) * (pitch - 2.0 * RADIUS)
    size = side * pitch
    box = {"kind": "box", "size": [size + 1e-3, size, size]}
    contact = {"restitution": 0.6, "friction": friction, "tangential": "mindlin"}
    return weightless(container=box, wall={**SOFT, "name": "wall"}, **contact), bed_of(position)


def free_body(mass, inertia):
    """A rigid body that moves along one line and turns; slopes are those of its second mode."""
    shape = np.array([[mass**-0.5, 0.0]])
    slope = np.array([[0.0, inertia**-0.5]])
    return ModalModel(np.zeros(2), np.zeros(2), shape, slope, ("mass",))


def test_ball_between_walls_follows_the_event_driven_solver():
    # A contact lasts some microseconds here and nothing there; the difference falls with stiffness.
    gap, restitution = 1e-3, 0.6
    model = oscillator(20.0 * MASS, 50.0, 0.001)
    stiff = weightless(particle={**SOFT, "youngs_modulus": 2e10}, container=channel(2e-3 + gap, "x"), restitution=0.6)
    carried = Carried(stiff, "mass", packing=bed_of([[RADIUS + gap, 0, 0]]))
    q = released(model, "mass", 3e-3)
    run = cosimulate(Case(model, (carried,), 0.1, q=q, sample_rate=2e3))
    system = on_structure(model, [Ball(MASS, gap, restitution)])
    start = at_rest(system)._replace(offset=np.array([gap]), q=q)
    exact = events(system, 0.1, start, sample_rate=2e3)
    difference = run.displacement("mass") - exact.q[:, 0] * model.shape[0, 0]
    assert np.abs(difference).max() < 3e-3 * 3e-3
    assert np.abs(run.residual).max() < 1e-3
    assert run.status == 0


def test_ball_on_springs_is_a_second_mass_to_second_order():
    # Masses M and m joined by 2 k, M on its own spring: matrix exponential of the four states.
    stiffness, frequency = 50.0, 60.0
    model = oscillator(3.0 * MASS, frequency)
    carried = on_springs(stiffness, 2e-4)
    big, spring = 3.0 * MASS, 3.0 * MASS * (2 * np.pi * frequency) ** 2
    k = 2.0 * stiffness
    matrix = np.zeros((4, 4))
    matrix[:2, 2:] = np.eye(2)
    matrix[2] = [-(spring + k) / big, k / big, 0, 0]
    matrix[3] = [k / MASS, -k / MASS, 0, 0]
    start, duration, errors = 1e-5, 0.05, []
    from scipy.linalg import expm

    # The container is held displaced, and the ball with it.
    exact = expm(matrix * duration) @ [start, start, 0, 0]
    for time_step in (4e-6, 2e-6, 1e-6):
        case = Case(model, (carried,), duration, q=released(model, "mass", start), time_step=time_step, sample_rate=1e3)
        run = cosimulate(case)
        errors.append(abs(run.displacement("mass")[-1] - exact[0]))
    order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert errors[-1] < 1e-4 * start
    assert order == pytest.approx(2.0, abs=0.1)


def test_glued_bed_lowers_the_frequency_by_its_mass():
    # Springs 1e4 times stiffer than the structure's hold the ball: f = f0 sqrt(M / (M + m)) to the ratio of stiffness.
    model = oscillator(4.0 * MASS, 20.0)
    k = 4.0 * MASS * (2 * np.pi * 20.0) ** 2
    case = Case(model, (on_springs(1e4 * k, 2e-5),), 0.5, q=released(model, "mass", 1e-6), sample_rate=2e3)
    run = cosimulate(case)
    expected = 20.0 * np.sqrt(4.0 / 5.0)
    phase = np.unwrap(np.angle(run.displacement("mass") - 1j * run.velocity("mass") / (2 * np.pi * expected)))
    frequency = np.polyfit(run.time, phase, 1)[0] / (2 * np.pi)
    assert abs(frequency) == pytest.approx(expected, rel=2e-4)


def test_momentum_is_exchanged_exactly():
    # All sums change by the same products of force and time step, so only rounding is left.
    # Balls that overlap at the start drive each other and the container apart.
    damper, bed = box_of_balls(gap=0.97)
    model = free_body(0.5 * len(bed.radius) * MASS, 1.0)
    v = np.array([1.0, 0.0]) / model.shape[0, 0]
    case = Case(model, (Carried(damper, "mass", packing=bed),), 0.02, v=v)
    run = cosimulate(case)
    body = 1.0 / model.shape[0, 0] ** 2
    total = body + len(bed.radius) * MASS
    whole = total * 1.0  # container and bed start at 1 m/s
    end = run.snapshots[-1][0]
    particles = MASS * (end.velocity[:, 0] + end.container_velocity[0]).sum()
    assert body * run.velocity("mass")[-1] + particles == pytest.approx(whole, rel=1e-12)
    assert run.energy[-1][0].lost > 0.0


@pytest.mark.parametrize("turning", [False, True], ids=["along a line", "turning"])
def test_energy_closes(turning):
    # What the structure lost is in the particles, or was dissipated: to 0.1 % of what passed between them.
    damper, bed = box_of_balls()
    n = len(bed.radius)
    model = ModalModel(
        2 * np.pi * np.array([40.0, 90.0]),
        np.array([1.0, 2.0]),
        np.array([[1.0, 0.4]]) * (5 * n * MASS) ** -0.5,
        np.array([[60.0, -90.0]]) * (5 * n * MASS) ** -0.5,
        ("tip",),
    )
    along = (0.0, 1.0, 0.0) if turning else None
    damper = damper.model_copy(update={"gravity": (0.0, 0.0, -9.81)})
    force = HarmonicForce("tip", 2.0 * n * MASS * 9.81, 41.0, soft_start=0.01)
    carried = Carried(damper, "tip", along=along, pivot=(4e-3, 4e-3, 4e-3), packing=bed)
    run = cosimulate(Case(model, (carried,), 0.1, q=released(model, "tip", 1e-3, mode=0), forces=(force,)))
    assert run.energy[-1][0].lost > 0.05 * run.throughput
    assert np.abs(run.residual).max() < 1e-3


def test_loose_particle_flies_straight_while_its_container_turns():
    # In the frame at rest nothing acts on it: inertia forces of the turning frame must add up to that, to second order.
    model = ModalModel(np.array([2 * np.pi * 30.0]), np.zeros(1), np.array([[2.0]]), np.array([[40.0]]), ("tip",))
    far = {
        "kind": "walls",
        "planes": [{"name": "floor", "point": [0, 0, -1], "normal": "z"}],
    }
    damper = weightless(container=far)
    place, pivot = np.array([0.02, 0.03, 0.0]), (0.001, -0.002, 0.0)
    errors = []
    for time_step in (4e-5, 2e-5):
        carried = Carried(damper, "tip", along=(0.0, 1.0, 0.0), pivot=pivot, packing=bed_of([place]))
        case = Case(model, (carried,), 0.05, v=np.array([1.0]), time_step=time_step, sample_rate=1e3)
        run = cosimulate(case)
        # At the start the container moves by 2 m/s along x and turns by 40 rad/s about along x direction = -z.
        axis = np.cross((0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
        velocity = 2.0 * np.array([1.0, 0.0, 0.0]) + 40.0 * np.cross(axis, place - pivot)
        expected = place + 0.05 * velocity
        angle = run.q[-1, 0] * 40.0 * axis[2]
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        moved = np.array([run.displacement("tip")[-1], 0.0, 0.0])
        found = moved + pivot + turn @ (run.snapshots[-1][0].position[0] - pivot)
        errors.append(np.abs(found - expected).max())
    assert errors[1] < 2e-5
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.5)


def test_bed_under_its_weight_stays_at_rest():
    # Displacements count from the equilibrium under the weight of the bed.
    damper = damper_of(particle=SOFT, radius=RADIUS, container=FLOOR, restitution=0.5).model_copy(
        update={"gravity": (0.0, 0.0, -9.81)}
    )
    sunk = (MASS * 9.81 / (4 / 3 * 2e8 / (1 - 0.09) * RADIUS**0.5)) ** (2 / 3)
    carried = Carried(damper, "mass", direction=(0.0, 0.0, 1.0), packing=bed_of([[0, 0, RADIUS - sunk]]))
    model = oscillator(5.0 * MASS, 10.0)
    sag = MASS * 9.81 / (5.0 * MASS * (2 * np.pi * 10.0) ** 2)
    run = cosimulate(Case(model, (carried,), 0.2, sample_rate=500.0))
    assert np.abs(run.displacement("mass")).max() < 1e-3 * sag


def test_forces_are_those_described():
    # Without particles in reach the structure answers as its closed form says; sweeps and samples as their own values.
    damper = weightless(container=channel(1.0, "x"))
    model = oscillator(1.0, 0.0)
    carried = Carried(damper, "mass", packing=bed_of([[0.5, 0, 0]]))
    sweep = SweptForce("mass", 2.0, 20.0, 60.0, 0.2, "log", soft_start=0.02)
    samples = np.random.default_rng(1).normal(size=40)
    for force in (HarmonicForce("mass", 3.0, 25.0, 0.4), sweep, SampledForce("mass", samples, 200.0)):
        run = cosimulate(Case(model, (carried,), 0.2, forces=(force,), sample_rate=5e3, time_step=1e-5))
        time = np.linspace(0.0, 0.2, 200001)
        values = force_values(force, time)
        impulse = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])
        expected = np.interp(run.time, time, impulse)
        # The bed's mass of 33 mg rides along only where it touches, which it does not.
        assert run.velocity("mass") == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


def test_a_batch_gives_what_each_case_gives_alone():
    cases = []
    for side, amplitude in ((2, 1e-3), (3, 2e-3)):
        damper, bed = box_of_balls(side)
        model = oscillator(5 * len(bed.radius) * MASS, 50.0)
        first = Carried(damper, "mass", packing=bed)
        ball = Carried(weightless(container=channel(3e-3, "x")), "mass", packing=bed_of([[1.2e-3, 0, 0]]))
        cases.append(Case(model, (first, ball)[: side - 1], 0.02 * side, q=released(model, "mass", amplitude)))
    batch = cosimulate_batch(cases, n_thread=2)
    for case, run in zip(cases, batch, strict=True):
        alone = cosimulate(case)
        assert np.array_equal(alone.q, run.q)
        assert np.array_equal(alone.force[1:], run.force[1:])
        assert alone.energy[-1] == run.energy[-1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"duration": -1.0}, "duration is -1.0"),
        ({"dampers": ()}, "dampers is empty"),
        ({"q": np.zeros(3)}, "q has shape (3,), but must be 1 finite numbers"),
        ({"forces": (HarmonicForce("end", 1.0, 10.0),)}, "no point 'end'"),
        ({"forces": (SweptForce("mass", 1.0, 0.0, 10.0, 1.0),)}, "forces[1].start is 0.0"),
        ({"forces": (SampledForce("mass", np.array([1.0]), 10.0),)}, "forces[1].samples"),
        ({"steps_per_contact": 3}, "steps_per_contact is 3"),
    ],
)
def test_bad_cases_are_named(change, words):
    case = Case(oscillator(1.0, 10.0), (on_springs(1.0, 1e-4),), 0.1)._replace(**change)
    with pytest.raises(InputError, match=words.replace("(", r"\(").replace(")", r"\)").replace("[", r"\[")):
        cosimulate(case)


def test_a_turning_container_needs_slopes():
    carried = on_springs(1.0, 1e-4)._replace(along=(0.0, 1.0, 0.0))
    with pytest.raises(InputError, match="slope of the structure at point 'mass' is not known"):
        cosimulate(Case(oscillator(1.0, 10.0), (carried,), 0.1))


def test_released_shapes():
    model = ModalModel(
        np.array([10.0, 40.0]), np.zeros(2), np.array([[1.0, 1.0], [0.5, -1.0]]), np.full((2, 2), np.nan), ("a", "b")
    )
    assert model.shape[0] @ released(model, "a", 2e-3) == pytest.approx(2e-3)
    assert released(model, "b", 1e-3, mode=1) == pytest.approx([0.0, -1e-3])
    with pytest.raises(InputError, match="no static shape"):
        released(model._replace(omega=np.array([0.0, 40.0])), "a", 1e-3)
