"""Particles and structure simulated together, against closed forms, the event-driven solver and conservation."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

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


def on_springs(stiffness, overlap, point="mass", y=0.0):
    """A ball held by two linear springs, one of each wall, that never let go."""
    damper = weightless(container=channel(2.0 * (RADIUS - overlap), "x"), law="linear", stiffness=stiffness)
    return Carried(damper, point, packing=bed_of([[RADIUS - overlap, y, 0]]))


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
    # The container is held displaced, and the ball with it.
    exact = expm(matrix * duration) @ [start, start, 0, 0]
    for time_step in (4e-6, 2e-6, 1e-6):
        case = Case(model, (carried,), duration, q=released(model, "mass", start), time_step=time_step, sample_rate=1e3)
        run = cosimulate(case)
        errors.append(abs(run.displacement("mass")[-1] - exact[0]))
    order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    # Leapfrog is off by (w dt)^2 / 24 of a phase w T. At 1 us the slow motion, 325 /s, gives 7e-8 of the amplitude, the
    # fast one, 2016 /s, 2e-5 of its share, which is below 1 % where the ball starts at rest on the container.
    assert errors[-1] < 2e-7 * start
    # Terms of fourth order over those of second are (w dt)^2 w T, 0.007 for the fast motion at 4 us: 0.01 of the order.
    assert order == pytest.approx(2.0, abs=0.01)


def test_two_dampers_at_two_points_of_a_two_mode_structure():
    # Two modes and two balls on springs: matrix exponential of the eight states, to second order.
    omega, damping = 2 * np.pi * np.array([40.0, 130.0]), np.array([2.0, 5.0])
    shape = np.array([[1.0, 0.6], [0.5, -0.9]]) * (5.0 * MASS) ** -0.5
    model = ModalModel(omega, damping, shape, np.full((2, 2), np.nan), ("near", "far"))
    springs = (20.0, 50.0)
    dampers = tuple(on_springs(k, 2e-4, point) for k, point in zip(springs, model.points, strict=True))
    held = 2.0 * np.array(springs)
    matrix = np.zeros((8, 8))
    matrix[:4, 4:] = np.eye(4)
    matrix[4:6, :2] = -np.diag(omega**2) - (shape.T * held) @ shape
    matrix[4:6, 2:4] = shape.T * held
    matrix[4:6, 4:6] = -np.diag(damping)
    matrix[6:, :2] = (held * shape.T / MASS).T
    matrix[6:, 2:4] = -np.diag(held) / MASS
    q, duration, errors = np.array([8e-6, 3e-6]) / shape[0, 0], 0.05, []
    exact = expm(matrix * duration) @ np.concatenate([q, shape @ q, np.zeros(4)])
    for time_step in (4e-6, 2e-6):
        run = cosimulate(Case(model, dampers, duration, q=q, time_step=time_step, sample_rate=1e3))
        errors.append(np.abs(run.q[-1] - exact[:2]) / np.abs(q).max())
        assert len(run.bed_mass) == 2
    # As for one ball: (w dt)^2 / 24 of the phase w T, at 2 us 3e-6 for the second mode with its balls, 850 /s, and 2e-4
    # for the balls against it, 2000 /s, of their share of some 2 %.
    assert errors[1].max() < 1e-5
    # Terms of fourth order are (w dt)^2 w T = 0.007 of those of second at 4 us, 2000 /s.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.007)


def test_ball_on_springs_in_a_turning_container_to_second_order():
    # In the frame at rest: a container that moves and turns with one mode, by 0.07 rad, and a ball that two springs of
    # the container's x axis hold 20 mm from the pivot while it slides freely across: Runge-Kutta of order 8.
    omega, shape, slope, stiffness = 2 * np.pi * 30.0, (3.0 * MASS) ** -0.5, 15.0 * (3.0 * MASS) ** -0.5, 50.0
    model = ModalModel(np.array([omega]), np.zeros(1), np.array([[shape]]), np.array([[slope]]), ("tip",))
    overlap, pivot, y0, q0, duration = 2e-4, np.array([-0.02, 3e-3]), 8e-3, 5e-3 / shape, 0.05
    middle = RADIUS - overlap

    def place(q):
        # The axis is y x x = -z.
        angle = -slope * q
        return pivot + np.array([shape * q, 0.0]), np.array([np.cos(angle), np.sin(angle)])

    def in_frame(origin, along, position):
        arm = position - pivot
        return origin + arm[0] * along + arm[1] * np.array([-along[1], along[0]])

    def rate(_, state):
        q, v, x, y, u, w = state
        origin, along = place(q)
        arm = np.array([x, y]) - origin
        force = -2.0 * stiffness * (arm @ along + pivot[0] - middle) * along
        moment = arm[0] * force[1] - arm[1] * force[0]
        return [v, -(omega**2) * q - shape * force[0] + slope * moment, u, w, *force / MASS]

    origin, along = place(q0)
    start = in_frame(origin, along, np.array([middle, y0]))
    exact = solve_ivp(rate, (0.0, duration), [q0, 0.0, *start, 0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-16).y[:, -1]
    carried = on_springs(stiffness, overlap, "tip", y0)._replace(along=(0.0, 1.0, 0.0), pivot=(*pivot, 0.0))
    errors = []
    for time_step in (4e-6, 2e-6):
        run = cosimulate(Case(model, (carried,), duration, q=np.array([q0]), time_step=time_step, sample_rate=1e3))
        origin, along = place(run.q[-1, 0])
        ball = in_frame(origin, along, run.snapshots[-1][0].position[0, :2])
        errors.append(np.abs([run.displacement("tip")[-1] - shape * exact[0], *(ball - exact[2:4])]))
    # (w dt)^2 / 24 of the phase w T at 2 us: 6e-8 of paths of some 6 mm for the mode, 0.4 nm, and 7e-5 of the vibration
    # of the ball on its springs, 2000 /s, which the start from rest leaves at (190 / 2000)^2 of 5 mm, 3 nm.
    assert errors[1].max() < 4e-9
    # Terms of fourth order are (w dt)^2 w T = 0.007 of those of second at 4 us, 2000 /s.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.007)


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
    # Balls that overlap at the start drive each other and the container apart; an external force pushes the container.
    damper, bed = box_of_balls(gap=0.97)
    model = free_body(0.5 * len(bed.radius) * MASS, 1.0)
    v = np.array([1.0, 0.0]) / model.shape[0, 0]
    force = HarmonicForce("mass", 30.0 * len(bed.radius) * MASS, 130.0, 0.5)
    case = Case(model, (Carried(damper, "mass", packing=bed),), 0.02, v=v, forces=(force,))
    run = cosimulate(case)
    body = 1.0 / model.shape[0, 0] ** 2
    total = body + len(bed.radius) * MASS
    # Container and bed start at 1 m/s; the first and the last step kick by half.
    kicks = force_values(force, np.arange(run.n_step + 1) * run.time_step)
    whole = total * 1.0 + run.time_step * np.trapezoid(kicks)
    end = run.snapshots[-1][0]
    particles = MASS * (end.velocity[:, 0] + end.container_velocity[0]).sum()
    assert body * run.velocity("mass")[-1] + particles == pytest.approx(whole, rel=1e-12)
    assert run.energy[-1][0].lost > 0.0


def in_the_frame_at_rest(run, inertia):
    """Momentum along x [kg m/s] of the balls in a turning container at the end of a run, and their angular momentum
    about +z through where its pivot started [kg m^2/s], in the frame at rest; `inertia` of a ball [kg m^2]."""
    shot, model = run.snapshots[-1][0], run.case.model
    angle, turn = -model.slope[0] @ run.q[-1], -model.slope[0] @ run.v[-1]
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    arm = (shot.position[:, :2] - np.array(run.case.dampers[0].pivot)[:2]) @ matrix.T
    velocity = shot.velocity[:, :2] @ matrix.T + turn * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    velocity[:, 0] += run.velocity("mass")[-1]
    arm[:, 0] += run.displacement("mass")[-1]
    about = MASS * (arm[:, 0] * velocity[:, 1] - arm[:, 1] * velocity[:, 0]) + inertia * (shot.spin[:, 2] + turn)
    return MASS * velocity[:, 0].sum(), about.sum()


@pytest.mark.parametrize("held", [False, True], ids=["along the line", "about the pivot"])
def test_momentum_in_a_turning_container(held):
    # A free body full of balls turns: an external force gives momentum along its line, which nothing else does. With
    # its pivot held, the force acts on a lever of the body and gives angular momentum.
    damper, bed = box_of_balls(gap=0.97)
    body, inertia, ball, lever = 32 * MASS, 32 * MASS * 4e-6, 0.4 * MASS * RADIUS**2, 2e-3
    moves, turns = 0.0 if held else body**-0.5, inertia**-0.5
    shape = np.array([[moves, 0.0], [moves, lever * turns * held]])
    model = ModalModel(np.zeros(2), np.zeros(2), shape, np.array([[0.0, turns], [0.0, turns]]), ("mass", "lever"))
    force = HarmonicForce("lever", 30.0 * body, 130.0, 0.5)
    carried = Carried(damper, "mass", along=(0.0, 1.0, 0.0), pivot=(2e-3, 4e-3, 4e-3), packing=bed)
    v, errors = np.array([0.0 if held else 0.3 / moves, 30.0 / turns]), []
    time = np.linspace(0.0, 0.02, 20001)
    impulse = np.trapezoid(force_values(force, time), time)
    arm = bed.position[:, :2] - [2e-3, 4e-3]
    # The axis is -z, about which body and balls turn together at the start.
    spun = -30.0 * (inertia + len(arm) * ball + MASS * (arm**2).sum()) - lever * impulse
    pushed = 0.3 * (body + len(arm) * MASS) + 30.0 * MASS * arm[:, 1].sum() + impulse
    for time_step in (4e-6, 2e-6):
        run = cosimulate(Case(model, (carried,), 0.02, v=v, forces=(force,), time_step=time_step))
        along, about = in_the_frame_at_rest(run, ball)
        if held:
            errors.append(abs(about - run.v[-1, 1] / turns - spun))
        else:
            errors.append(abs(along + body * run.velocity("mass")[-1] - pushed))
        assert run.energy[-1][0].lost > 0.0
    assert abs(run.q[-1, 1] * turns) > 0.3
    # The forces of the turning frame are those of whole steps, its motion that of half ones, so that here momentum is
    # kept to second order only: 1.3e-6 and 1.3e-5 of the whole at 2 us, of which the impulse is 5 and 9 %. Two runs of
    # a bed part over time, which moves the ratio of 4 by some per cent; a first order would give 2.
    assert errors[1] < 2e-5 * abs(spun if held else pushed)
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.5)


@pytest.mark.parametrize("turning", [False, True], ids=["along a line", "turning"])
def test_energy_closes(turning):
    # What the structure lost is in the particles, or was dissipated: to 0.1 % of what passed between them with the 40
    # steps per contact of the default, and open with the square of the time step.
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
    case = Case(model, (carried,), 0.1, q=released(model, "tip", 1e-3, mode=0), forces=(force,))
    coarse, run = (cosimulate(case._replace(steps_per_contact=steps)) for steps in (20, 40))
    assert run.energy[-1][0].lost > 0.05 * run.throughput
    # 0.04 to 0.05 %, and 0.19 to 0.23 % with twice the time step.
    assert np.abs(run.residual).max() < 6e-4
    # The two beds take different ways, and terms of fourth order are some per cent: 4.3, and 4.2 from 40 to 80 steps.
    assert np.abs(coarse.residual).max() / np.abs(run.residual).max() == pytest.approx(4.0, abs=0.5)


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
    # Leapfrog is off by (w dt)^2 / 24 of the phase w T = 9.4 of the turning, 6e-6 at 20 us, times the path of 0.15 m.
    assert errors[1] < 1e-6
    # Terms of third order over those of second are w dt = 0.0075 at 40 us, and change the ratio of 4 by so much of it.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.0075)


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
