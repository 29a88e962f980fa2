"""Small worlds of particles with known answers, for every test that needs the engine."""

from math import pi, sqrt

import numpy as np

from graindamp.dem.columns import FORCE_COS, FORCE_SIN, N_STEP, SPEED_COS, SPEED_SIN
from graindamp.dem.container import enclosure_of
from graindamp.dem.energy import velocity_now
from graindamp.dem.engine import start
from graindamp.dem.interactions import interactions_of
from graindamp.dem.motion import AMPLITUDE, DIRECTION, FUNDAMENTAL, OMEGA, PHASE, MotionKind
from graindamp.dem.state import Motion
from graindamp.dem.world import Bed, world_of
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec

GRAVITY = 9.81

STEEL = {"name": "ball", "youngs_modulus": 208e9, "poisson_ratio": 0.3, "density": 7900.0}
RIGID = {"name": "rigid", "youngs_modulus": 1e21, "poisson_ratio": 0.3}
"""Ten orders stiffer than any particle here, so that 1/E* and 1/G* are the particle's to rounding."""

FLOOR = {"kind": "walls", "planes": [{"name": "floor", "point": [0, 0, 0], "normal": "z"}]}


def channel(length, axis="z"):
    """Two planes `length` [m] apart, the first at 0."""
    point = [length * (c == axis) for c in "xyz"]
    return {
        "kind": "walls",
        "planes": [
            {"name": "first", "point": [0, 0, 0], "normal": axis},
            {"name": "second", "point": point, "normal": f"-{axis}"},
        ],
    }


def damper_of(particle=STEEL, wall=RIGID, container=FLOOR, inserts=(), lid=None, radius=1e-3, **contact):
    """Description of a damper; `particle` may be a list of materials. By default nothing dissipates."""
    materials = particle if isinstance(particle, list) else [particle]
    damper = {
        "particles": [{"material": material, "radius": radius} for material in materials],
        "fill": {"count": 1},
        "container": {"material": wall, **container},
        "inserts": list(inserts),
        "contact": {"restitution": 1.0, "friction": 0.0, "tangential": "none", **contact},
        "packing": {"direction": "-z"},
    }
    if lid is not None:
        damper["lid"] = lid
    whole = {"damper": damper, "motion": {"kind": "rest"}, "run": {"duration": 1.0}}
    return parse_spec(whole, SimulationSpec, "made").damper


def made(
    damper,
    time_step,
    position,
    radius,
    velocity=(0.0, 0.0, 0.0),
    spin=(0.0, 0.0, 0.0),
    material=0,
    gravity=(0.0, 0.0, 0.0),
    locked=False,
    begin=True,
    folder=None,
    lid_height=None,
    **options,
):
    """A started world.

    Args:
        damper: from :func:`damper_of`.
        time_step: [s].
        position: centres [m]; (particle, 3).
        radius: [m]; one or one per particle.
        velocity: in the container's frame [m/s]; one or one per particle.
        spin: [rad/s]; likewise.
        material: number of the material; likewise.
        gravity: [m/s^2].
        locked: True gives all particles an infinite moment of inertia.
        begin: False leaves the world to be started.
        folder: of the file of a mesh.
        lid_height: distance of the lid from the wall opposite to it [m].
        options: of :func:`graindamp.dem.world.world_of`.
    """
    position = np.atleast_2d(np.array(position, dtype=float))
    n = len(position)
    bed = Bed(
        position,
        np.broadcast_to(np.asarray(radius, dtype=float), n).copy(),
        np.broadcast_to(np.asarray(material, np.int32), n).copy(),
        np.broadcast_to(np.asarray(velocity, dtype=float), (n, 3)).copy(),
        np.broadcast_to(np.asarray(spin, dtype=float), (n, 3)).copy(),
    )
    interactions = interactions_of(damper)
    enclosure = enclosure_of(damper, interactions, lid_height, folder=folder)
    worlds = world_of(bed, enclosure, interactions, gravity, time_step, **options)
    if locked:
        worlds.particles.inverse_mass[..., 1] = 0.0
    return start(worlds) if begin else worlds


def state_of(worlds):
    """Positions, velocities and spins at the same time, in the order in which the particles were given."""
    order = np.argsort(worlds.particles.identity[0])
    velocity, spin = velocity_now(worlds)
    return worlds.particles.position[0, order, :3].copy(), velocity[order], spin[order]


def harmonic(frequency, amplitude, direction=(1.0, 0.0, 0.0), phase=0.0):
    """Container at `amplitude` sin(2 pi f t + phase) [m] along a direction, its Fourier sums included."""
    wave, timing = np.zeros((1, 1, 5)), np.zeros((1, 8))
    wave[0, 0, OMEGA] = 2.0 * pi * frequency
    wave[0, 0, PHASE] = phase
    wave[0, 0, AMPLITUDE : AMPLITUDE + 3] = amplitude * np.asarray(direction)
    timing[0, DIRECTION : DIRECTION + 3] = direction
    timing[0, FUNDAMENTAL] = 2.0 * pi * frequency
    zeros = np.zeros((1, 3))
    return Motion(
        np.array([MotionKind.HARMONICS], np.int32),
        wave,
        np.zeros((1, 1, 3)),
        timing,
        zeros.copy(),
        zeros.copy(),
        zeros.copy(),
    )


def effective_mass(worlds, first=0, last=None):
    """Loss factor eta and effective mass m' of the bed [-] from the Fourier sums of cycles `first` to `last` - 1.

    M = F/A = m_bed (m' - i eta) with F the force that drives the bed, minus that of the particles on the container.
    """
    sums = worlds.record.fourier[0, first:last].sum(axis=0)
    force = (sums[FORCE_COS] - 1j * sums[FORCE_SIN]) * 2.0 / sums[N_STEP]
    speed = (sums[SPEED_COS] - 1j * sums[SPEED_SIN]) * 2.0 / sums[N_STEP]
    omega = worlds.motion.timing[0, FUNDAMENTAL]
    return ratio(worlds, -force / (1j * omega * speed))


def effective_mass_of_series(worlds, n_cycle):
    """As :func:`effective_mass`, from the recorded force series of the last `n_cycle` cycles."""
    omega = worlds.motion.timing[0, FUNDAMENTAL]
    interval = worlds.record.stride[0] * worlds.rules.time_step[0]
    n = round(n_cycle * 2.0 * pi / omega / interval)
    stop = int(worlds.record.n_sample[0])
    series = worlds.record.series[0, stop - n : stop] @ worlds.motion.timing[0, DIRECTION : DIRECTION + 3]
    # A sample is the mean of the stride's steps that end at (sample + 1) strides.
    middle = (np.arange(stop - n, stop) + 0.5) * interval + 0.5 * worlds.rules.time_step[0]
    wave = np.exp(-1j * omega * middle)
    return ratio(worlds, -(series[:, :-1].sum(axis=1) @ wave) / (1j * omega * (series[:, -1] @ wave)))


def ratio(worlds, mass):
    """eta and m' of a complex effective mass [kg]."""
    relative = mass / np.sum(1.0 / worlds.particles.inverse_mass[0, :, 0])
    return -relative.imag, relative.real


def mass_of(radius, density):
    """Mass of a sphere [kg]."""
    return density * 4.0 / 3.0 * pi * radius**3


def hertz(radius, *bodies):
    """Stiffness k of F = k overlap^1.5 [N/m^1.5] for R* = `radius`, from the moduli of one or two bodies."""
    compliance = sum((1.0 - body["poisson_ratio"] ** 2) / body["youngs_modulus"] for body in bodies)
    return 4.0 / 3.0 / compliance * sqrt(radius)


def hertz_time(stiffness, mass, speed):
    """Duration of an elastic Hertz contact [s], 2.9433 overlap/speed."""
    return 2.94327 * (1.25 * mass * speed**2 / stiffness) ** 0.4 / speed


def loose(count, cell, low, high, seed, shuffle=0.2):
    """`count` places of a disturbed cubic lattice of width `cell` [m] that fills a box from `low` up by layers."""
    rng = np.random.default_rng(seed)
    number = np.maximum(((np.asarray(high) - low) // cell).astype(int), 1)
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in number), indexing="ij"), -1).reshape(-1, 3)
    grid = grid[np.lexsort((grid[:, 0], grid[:, 1], grid[:, 2]))]
    place = low + (grid + 0.5) * cell
    assert len(place) >= count
    return place[:count] + shuffle * cell * (rng.random((count, 3)) - 0.5)
