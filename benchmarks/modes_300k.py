"""How long do 50 modes of a structure with 300 000 degrees of freedom take, against one bare factorisation?

The structure is a thin steel plate of 8-node solids with incompatible bending modes (Taylor, Beresford & Wilson, 1976),
one layer, simply supported, whose frequencies Mindlin's theory knows in closed form; or, with --free, floating with six
rigid-body modes. Prints a page of markdown: redirect it to benchmarks/results/modes_300k.md.
"""

import argparse
import datetime
import functools
import gc
import itertools
import os
import platform
import resource
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from graindamp.materials import material_named
from graindamp.structure.eigen import Modes, solve_modes

LENGTH, WIDTH, THICKNESS = 1.0, 0.25, 0.003  # [m]
STEEL = material_named("steel")

Array = NDArray[np.float64]


def solid_element(size: Array) -> tuple[Array, Array]:
    """Stiffness [N/m] and consistent mass [kg] of one brick of edges `size` [m], each (24, 24), three dofs per node."""
    corner = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    modulus, nu = STEEL.youngs_modulus, STEEL.poisson_ratio
    shear, lame = modulus / (2 * (1 + nu)), modulus * nu / ((1 + nu) * (1 - 2 * nu))
    elasticity = np.diag([2 * shear] * 3 + [shear] * 3)
    elasticity[:3, :3] += lame
    stiffness, mass = np.zeros((33, 33)), np.zeros((24, 24))
    volume = size.prod() / 8  # weight of each of eight Gauss points
    for point in corner / np.sqrt(3):
        factor = (1 + corner * point) / 2
        shape = factor.prod(axis=1)
        slope = np.stack([corner[:, k] / 2 * np.delete(factor, k, axis=1).prod(axis=1) for k in range(3)], axis=1)
        slope = np.concatenate([slope, np.diag(-2 * point)]) * (2 / size)  # the last three are 1 - xi^2
        strain = np.zeros((6, 33))
        for node, (x, y, z) in enumerate(slope):
            strain[:, 3 * node : 3 * node + 3] = [[x, 0, 0], [0, y, 0], [0, 0, z], [y, x, 0], [0, z, y], [z, 0, x]]
        stiffness += volume * strain.T @ elasticity @ strain
        mass += STEEL.density * volume * np.kron(np.outer(shape, shape), np.eye(3))
    inner = stiffness[24:, :24]
    return stiffness[:24, :24] - inner.T @ np.linalg.solve(stiffness[24:, 24:], inner), mass


def plate(n_dof: int, free: bool) -> tuple[csc_array, csc_array, str]:
    """Stiffness and mass of a plate with at least `n_dof` degrees of freedom, and its mesh in words."""
    n_width = int(np.sqrt(n_dof / 6 * WIDTH / LENGTH))
    lost = 0 if free else 8  # of the dofs of a cross-section, and of each column of an end, to the supports
    n_length = int(np.ceil((n_dof + lost * (n_width + 1)) / (6 * (n_width + 1) - lost)))
    stiffness, mass = solid_element(np.array([LENGTH / n_length, WIDTH / n_width, THICKNESS]))
    node = np.arange((n_length + 1) * (n_width + 1) * 2, dtype=np.int32).reshape(n_length + 1, n_width + 1, 2)
    corners = [
        node[i : n_length + i, j : n_width + j, k].ravel() for i, j, k in itertools.product((0, 1), (0, 1), (0, 1))
    ]
    dof = (3 * np.stack(corners, axis=1)[:, :, None] + np.arange(3, dtype=np.int32)).reshape(-1, 24).astype(np.int32)
    held: list[NDArray[np.int32]] = []
    if not free:  # what moves along an edge, or across the plate, is held; both layers, so the edge may rotate
        held = [3 * node[[0, -1]].ravel() + 1, 3 * node[[0, -1]].ravel() + 2]
        held += [3 * node[:, [0, -1]].ravel(), 3 * node[:, [0, -1]].ravel() + 2]
    loose = np.ones(3 * node.size, dtype=bool)
    loose[np.concatenate(held) if held else []] = False
    mesh = f"{n_length} x {n_width} x 1 solids, {LENGTH} x {WIDTH} m, {THICKNESS * 1e3:g} mm thick"
    return assemble(stiffness, dof, loose), assemble(mass, dof, loose), mesh


def assemble(element: Array, dof: NDArray[np.int32], loose: NDArray[np.bool_]) -> csc_array:
    """Sum of equal elements over the loose degrees of freedom."""
    row, column = np.repeat(dof, 24, axis=1).ravel(), np.tile(dof, 24).ravel()
    full = coo_array((np.tile(element.ravel(), len(dof)), (row, column)), shape=(loose.size, loose.size)).tocsc()
    return full[loose][:, loose].tocsc()


def closed_form(n_mode: int) -> Array:
    """Lowest frequencies [Hz] of the simply supported plate: bending, and shear in its plane from edge to edge.

    Source: Mindlin (1951), Journal of Applied Mechanics 18, 31-38, with shear factor 5/6.
    """
    half_waves = np.arange(1, 200)
    wave = np.pi * np.hypot(half_waves[:, None] / LENGTH, half_waves / WIDTH).ravel()
    rigidity = STEEL.youngs_modulus * THICKNESS**3 / (12 * (1 - STEEL.poisson_ratio**2))
    shear = 5 / 6 * STEEL.youngs_modulus / (2 * (1 + STEEL.poisson_ratio)) * THICKNESS
    area_mass, rotary = STEEL.density * THICKNESS, STEEL.density * THICKNESS**3 / 12
    # (shear k^2 - area_mass x) (rigidity k^2 + shear - rotary x) = (shear k)^2, the smaller root x = omega^2
    a = area_mass * rotary
    b = shear * wave**2 * rotary + area_mass * (rigidity * wave**2 + shear)
    c = shear * rigidity * wave**4
    bending = np.sqrt(2 * c / (b + np.sqrt(b**2 - 4 * a * c)))
    speed = np.sqrt(STEEL.youngs_modulus / (2 * (1 + STEEL.poisson_ratio)) / STEEL.density)
    in_plane = np.pi * speed * np.concatenate([half_waves / LENGTH, half_waves / WIDTH])
    return np.sort(np.concatenate([bending, in_plane]))[:n_mode] / (2 * np.pi)


def timed(repeat: int, work: Callable[[], Any]) -> tuple[list[float], Any]:
    """Wall times [s] of `repeat` runs, and the result of the last."""
    times, result = [], None
    for _ in range(repeat):
        result = None
        gc.collect()
        start = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - start)
    return times, result


def check(modes: Modes, n_mode: int, free: bool) -> list[str]:
    """What was checked, one line each; stops where an answer is wrong."""
    assert modes.residual.max() < 1e-9, modes.residual
    lines = [f"largest residual of K v = omega^2 M v, against the terms it sums up: {modes.residual.max():.1e}"]
    elastic = modes.omega[modes.n_rigid :] / (2 * np.pi)
    assert elastic.size == n_mode
    assert modes.n_rigid == (6 if free else 0)
    lines.append(f"{modes.n_rigid} rigid-body modes, elastic modes from {elastic[0]:.3f} to {elastic[-1]:.3f} Hz")
    if not free:
        deviation = elastic / closed_form(n_mode) - 1
        # Square of the element size, 0.3 % at full size, and 0.1 % for one layer that has no shear factor.
        assert abs(deviation).max() < 4e-3 * max(1.0, 300_000 / modes.vectors.shape[0]), deviation
        lines.append(f"deviation from Mindlin's closed form: {deviation.min():+.2%} to {deviation.max():+.2%}")
    return lines


def processor() -> str:
    """Model name of the processor."""
    info = Path("/proc/cpuinfo")
    names = [line for line in info.read_text().splitlines() if line.startswith("model name")] if info.exists() else []
    return names[0].split(":")[1].strip() if names else platform.processor()


def main() -> None:
    """Build, factorise, solve, check, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=300_000, help="least number of degrees of freedom")
    parser.add_argument("--modes", type=int, default=50, help="number of elastic modes")
    parser.add_argument("--repeat", type=int, default=5, help="runs of which the median is reported")
    parser.add_argument("--free", action="store_true", help="leave the plate free, with six rigid-body modes")
    options = parser.parse_args()

    (build,), (stiffness, mass, mesh) = timed(1, lambda: plate(options.size, options.free))
    shifted = csc_array(stiffness + 1e-10 * stiffness.diagonal().mean() / mass.diagonal().mean() * mass)
    factorise, factor = timed(
        options.repeat,
        lambda: splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}),
    )
    fill = factor.nnz
    solves, _ = timed(5, functools.partial(factor.solve, np.ones(shifted.shape[0])))
    factor = _ = None  # one factor at a time in memory
    solve, modes = timed(options.repeat, lambda: solve_modes(stiffness, mass, options.modes))
    checks = check(modes, options.modes, options.free)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    one, whole = statistics.median(factorise), statistics.median(solve)
    print(f"# {options.modes} modes of {stiffness.shape[0]:,} degrees of freedom\n")
    print(f"{datetime.date.today()}, `python benchmarks/modes_300k.py {'--free ' if options.free else ''}", end="")
    print(f"--size {options.size} --modes {options.modes} --repeat {options.repeat}`\n")
    print(f"- hardware: {os.cpu_count()}-core CPU, {processor()}")
    print(f"- versions: Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}")
    print(f"- model: {'free' if options.free else 'simply supported'} steel plate, {mesh}")
    print(f"- non-zeros: {stiffness.nnz:,} in K, {fill:,} in the factors L and U\n")
    print("| step | median [s] | runs [s] |\n| --- | --- | --- |")
    print(f"| assembly of K and M | {build:.1f} | 1 run |")
    print(f"| bare factorisation | {one:.1f} | {', '.join(f'{t:.1f}' for t in factorise)} |")
    print(f"| one solve with the factors | {statistics.median(solves):.3f} | {', '.join(f'{t:.3f}' for t in solves)} |")
    print(f"| solve_modes, factorisation included | {whole:.1f} | {', '.join(f'{t:.1f}' for t in solve)} |\n")
    print(f"solve_modes takes {whole / one:.2f} times the bare factorisation; peak memory {peak:.1f} GiB.\n")
    print("Checked:")
    for line in checks:
        print(f"- {line}")


if __name__ == "__main__":
    main()
