"""Pictures and films of the particles, seen from the side: to scale, whole and cut, coloured by speed.

All is drawn in the frame at rest, in which the container moves. Nothing needs a display.
"""

import os
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import FFMpegWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from matplotlib.transforms import Affine2D, ScaledTranslation
from numpy.typing import NDArray
from PIL import Image

from graindamp.errors import InputError
from graindamp.report.outline import cut, wall_triangles
from graindamp.report.wording import verbatim
from graindamp.signals.simulated import nominal_intensity_of
from graindamp.spec.motion import HarmonicMotion
from graindamp.spec.simulation import SimulationSpec

if TYPE_CHECKING:
    from graindamp.dem.container import Enclosure
    from graindamp.dem.run import Run

Real = NDArray[np.float64]
Format = Literal["gif", "mp4"]

FRAMES_PER_SECOND = 15
"""Speed of films [1/s]; a cycle of 24 snapshots then lasts 1.6 s."""

FRAMES = 240
"""Most snapshots in a film, the last ones; ten cycles of 24."""

RARE = 0.25
"""Particles per cycle below which a cell of the velocity field is left white [-]; its mean would be chance."""

_COLORS = "viridis"
_ARROW = "#c00000"
_WALL, _INSERT, _FOAM = "#222222", "#8a5a00", "#b36ae2"


class View(NamedTuple):
    """How the container is looked at: unit vectors in its frame."""

    right: Real
    """What points to the right in the picture."""
    up: Real
    """What points up."""
    toward: Real
    """What points out of the picture."""
    names: tuple[str, str]
    """What the two axes of the picture are called."""


class Scene(NamedTuple):
    """Particles at one time, in the container's frame."""

    position: Real
    """Centres [m]; (particle, 3)."""
    speed: Real | None
    """What colours them, in the frame at rest; (particle,)."""
    displacement: Real
    """Of the container [m]; (3,)."""


class Stage(NamedTuple):
    """What stays the same from picture to picture."""

    view: View
    walls: dict[str, Real]
    """Lines of every wall in the middle plane [m], by name; each (line, 2, 3)."""
    radius: Real
    """Of the particles [m]; (particle,)."""
    middle: float
    """Coordinate of the middle plane along the view [m]."""
    bounds: tuple[float, float, float, float]
    """Left, right, lower and upper end of what is drawn [m], with room for the motion."""
    scale: tuple[float, float, str]
    """Lowest and highest colour, and what the colour means."""
    gravity: Real
    """In the picture [-]: right and up, unit length; zero where there is none to be seen."""
    motion: Real
    """Direction of the motion in the picture [-], likewise."""


def view_of(spec: SimulationSpec, direction: Any) -> View:
    """Seen from the side: gravity points down, the motion to the right; where both are one line, that line is upright.

    Args:
        spec: the description.
        direction: unit vector of the motion [-].
    """
    gravity = np.asarray(spec.damper.gravity, dtype=np.float64)
    along = np.asarray(direction, dtype=np.float64)
    size = float(np.linalg.norm(gravity))
    if size > 0.0:
        up = -gravity / size
    else:
        up = np.eye(3)[2] if abs(along[2]) < 0.9 else np.eye(3)[1]
        up = up - (up @ along) * along
        up /= np.linalg.norm(up)
    right = along - (along @ up) * up
    if np.linalg.norm(right) < 1e-6:
        right = np.eye(3)[0] if abs(up[0]) < 0.9 else np.eye(3)[1]
        right = right - (right @ up) * up
    right /= np.linalg.norm(right)
    return View(right, up, np.cross(right, up), (_axis_name(right), _axis_name(up)))


def _axis_name(vector: Real) -> str:
    k = int(np.argmax(np.abs(vector)))
    if abs(vector[k]) < 0.999:
        return "along " + np.array2string(vector, precision=2, suppress_small=True)
    return ("−" if vector[k] < 0 else "") + "xyz"[k]


def stage_of(
    spec: SimulationSpec, enclosure: "Enclosure", radius: Real, scenes: list[Scene], direction: Any, scale: Any
) -> Stage:
    """What scenes of one run have in common: view, walls, room and colours."""
    view = view_of(spec, direction)
    low = np.min([np.min(scene.position - radius[:, None], axis=0) for scene in scenes], axis=0)
    high = np.max([np.max(scene.position + radius[:, None], axis=0) for scene in scenes], axis=0)
    triangles = wall_triangles(spec.damper, enclosure, (low, high))
    corners = np.concatenate([part.reshape(-1, 3) for part in triangles.values()] + [low[None], high[None]])
    depth = triangles["container"].reshape(-1, 3) @ view.toward if "container" in triangles else corners @ view.toward
    middle = 0.5 * float(depth.min() + depth.max())
    walls = {name: cut(part, middle * view.toward, view.toward) for name, part in triangles.items()}
    moved = np.array([scene.displacement for scene in scenes])
    reach = []
    for axis in (view.right, view.up):
        room = corners @ axis
        shift = moved @ axis
        margin = 0.06 * float(np.ptp(room))
        reach += [room.min() + min(shift.min(), 0.0) - margin, room.max() + max(shift.max(), 0.0) + margin]
    gravity = np.asarray(spec.damper.gravity, dtype=np.float64)
    size = float(np.linalg.norm(gravity))
    flat = np.stack([view.right, view.up])
    moves = np.asarray(direction, dtype=np.float64) if spec.motion.kind != "rest" else np.zeros(3)
    bounds = (float(reach[0]), float(reach[1]), float(reach[2]), float(reach[3]))
    return Stage(view, walls, radius, middle, bounds, scale, flat @ (gravity / size if size else gravity), flat @ moves)


def speed_scale(spec: SimulationSpec, scenes: Sequence[Scene]) -> tuple[float, float, str]:
    """Colours of speed: lowest, highest, and the label; over the container's velocity amplitude where it has one.

    The fastest hundredth of the particles shares the last colour, so that one of them does not make all others dark.
    """
    unit = velocity_amplitude_of(spec) or 1.0
    speeds = np.concatenate([scene.speed for scene in scenes if scene.speed is not None])
    highest = max(float(np.percentile(speeds, 99.0)), 1e-12)
    label = "speed [m/s]" if unit == 1.0 else f"speed / V [-],  V = {unit:.3g} m/s"
    return 0.0, highest, label


def velocity_amplitude_of(spec: SimulationSpec) -> float | None:
    """Velocity amplitude V of a harmonic motion [m/s]; None for other motions."""
    if not isinstance(spec.motion, HarmonicMotion):
        return None
    return spec.motion.acceleration_amplitude(spec.motion.frequency) / (2.0 * np.pi * spec.motion.frequency)


def headline(spec: SimulationSpec, clearance: float | None) -> str:
    """What every picture of a run says: name, frequency, intensity, stroke and clearance."""
    words = [verbatim(spec.damper.name)]
    gamma = nominal_intensity_of(spec)
    if gamma is not None and spec.base_frequency is not None:
        stroke = 9.80665 * gamma / (2.0 * np.pi * spec.base_frequency) ** 2
        words += [f"f = {spec.base_frequency:.4g} Hz", f"Γ = {gamma:.4g}", f"X = {1e3 * stroke:.3g} mm"]
    elif spec.motion.kind != "rest":
        words.append(f"{spec.motion.kind} motion")
    if clearance is not None:
        words.append(f"h = {1e3 * clearance:.3g} mm")
    return ", ".join(words)


def _speed(shot: Any, unit: float) -> Real:
    return np.asarray(np.linalg.norm(shot.velocity + shot.container_velocity, axis=1) / unit)


def scenes_of(run: "Run") -> list[Scene]:
    """Every snapshot of a run.

    Raises:
        InputError: the run has none.
    """
    if not run.snapshots:
        raise InputError(
            "the run holds no snapshots to draw; write [run] snapshots_per_cycle = 24 in the project and simulate again"
        )
    unit = velocity_amplitude_of(run.spec) or 1.0
    return [Scene(shot.position, _speed(shot, unit), np.asarray(shot.displacement)) for shot in run.snapshots]


def snapshot_figure(run: "Run", number: int = -1) -> Figure:
    """One snapshot from the side: the whole bed, and the bed cut through the middle.

    Args:
        run: a run with snapshots.
        number: which of them; the last by default.

    Raises:
        InputError: the run has none.
    """
    scenes = scenes_of(run)
    scale = speed_scale(run.spec, [scenes[number]])
    stage = stage_of(run.spec, run.enclosure, run.radius, scenes, run.direction, scale)
    figure, panels = _panels(stage)
    _draw(panels[0], stage, scenes[number], whole=True)
    drawn = _draw(panels[1], stage, scenes[number], whole=False)
    _bar(figure, panels, drawn, stage)
    shot = run.snapshots[number]
    figure.suptitle(f"{headline(run.spec, run.packing.clearance)}\n{_moment(run, shot)}", fontsize=11)
    return figure


def packing_figure(spec: SimulationSpec, packing: Any, enclosure: "Enclosure", direction: Any) -> Figure:
    """A packed bed from the side, whole and cut, before anything moves; colours tell the components apart."""
    component = np.asarray(packing.component)
    scene = Scene(packing.position, None, np.zeros(3))
    stage = stage_of(spec, enclosure, packing.radius, [scene], direction, (0.0, 8.0, ""))
    figure, panels = _panels(stage)
    for axes, whole in zip(panels, (True, False), strict=True):
        _draw(axes, stage, scene, whole, component)
    parts = [f"{len(packing.radius)} particles", f"bed height {1e3 * packing.height:.4g} mm"]
    if np.isfinite(packing.solid_fraction):
        parts.append(f"solid fraction {packing.solid_fraction:.3f}")
    figure.suptitle(f"{headline(spec, packing.clearance)}\npacked bed: {', '.join(parts)}", fontsize=11)
    return figure


def _moment(run: "Run", shot: Any) -> str:
    if run.frequency is None:
        return f"t = {shot.time:.4g} s, speed in the frame at rest"
    cycle = shot.time * run.frequency
    return f"t = {cycle:.2f} cycles, speed in the frame at rest"


def _panels(stage: Stage) -> tuple[Figure, list[Axes]]:
    """Two panels of equal scale, above each other where the container is long, beside each other where it is tall."""
    width, height = stage.bounds[1] - stage.bounds[0], stage.bounds[3] - stage.bounds[2]
    stacked = width > 1.3 * height
    if stacked:
        size = 8.2, min(max(2 * 6.3 * height / width + 1.45, 4.0), 11.0)
    else:
        panel = min(max(5.0 * width / height, 2.0), 4.6)
        size = max(2 * panel + 2.4, 6.5), panel * height / width + 1.4
    figure = Figure(figsize=size, layout="compressed")
    shape = (2, 1) if stacked else (1, 2)
    panels = list(np.ravel(figure.subplots(*shape, sharex=True, sharey=True)))
    for axes, title in zip(panels, ("whole", "cut through the middle"), strict=True):
        axes.set_title(title, fontsize=9, pad=9)
    return figure, panels


def _bar(figure: Figure, panels: list[Axes], drawn: Any, stage: Stage) -> None:
    bar = figure.colorbar(drawn, ax=panels, extend="max", fraction=0.05, pad=0.02)
    bar.set_label(stage.scale[2])


def _circles(stage: Stage, scene: Scene, whole: bool) -> tuple[Real, Real, NDArray[np.int64]]:
    """Centres in the picture [mm], diameters [mm] and numbers of the particles, those in front last."""
    position = scene.position + scene.displacement
    depth = position @ stage.view.toward - stage.middle
    radius = stage.radius
    if whole:
        order = np.argsort(depth)
        size = radius
    else:
        size = np.sqrt(np.maximum(radius**2 - depth**2, 0.0))
        order = np.flatnonzero(np.abs(depth) < radius)
    centre = np.stack([position @ stage.view.right, position @ stage.view.up], axis=1)
    return 1e3 * centre[order], 2e3 * size[order], order


def _wall_lines(stage: Stage, scene: Scene, name: str) -> list[Real]:
    line = stage.walls[name] + scene.displacement
    return list(1e3 * np.stack([line @ stage.view.right, line @ stage.view.up], axis=2))


def _spheres(axes: Axes, stage: Stage, scene: Scene, whole: bool, component: Any = None) -> EllipseCollection:
    """The particles in a panel, to scale."""
    centre, size, order = _circles(stage, scene, whole)
    spheres = EllipseCollection(
        size, size, np.zeros(len(size)), units="xy", offsets=centre, offset_transform=axes.transData,
        cmap=_COLORS if component is None else "Pastel1", linewidths=0.3, edgecolors="#00000080",
    )  # fmt: skip
    values = scene.speed if component is None else component
    if values is not None:
        spheres.set_array(np.asarray(values, dtype=np.float64)[order])
        spheres.set_clim(stage.scale[0], stage.scale[1])
    axes.add_collection(spheres)
    return spheres


def _draw(axes: Axes, stage: Stage, scene: Scene, whole: bool, component: Any = None) -> EllipseCollection:
    """A panel with particles, walls and arrows; the particles, for a bar of colours."""
    spheres = _spheres(axes, stage, scene, whole, component)
    _draw_walls(axes, stage, scene)
    left, right, lower, upper = (1e3 * bound for bound in stage.bounds)
    axes.set(xlim=(left, right), ylim=(lower, upper), aspect="equal")
    axes.set_xlabel(f"{stage.view.names[0]} [mm]")
    axes.set_ylabel(f"{stage.view.names[1]} [mm]")
    axes.label_outer()
    _arrows(axes, stage)
    return spheres


def _draw_walls(axes: Axes, stage: Stage, scene: Scene) -> None:
    for name in stage.walls:
        colour = {"container": _WALL, "foam": _FOAM}.get(name, _WALL if "container" not in stage.walls else _INSERT)
        style = "--" if name == "foam" else "-"
        axes.add_collection(
            LineCollection(
                _wall_lines(stage, scene, name),
                colors=colour,
                linewidths=1.8,
                linestyles=style,
                capstyle="projecting" if style == "-" else "butt",
            )
        )


def _arrows(axes: Axes, stage: Stage) -> None:
    """Gravity and the direction of the motion, above the panel's upper right corner."""
    for vector, text, style, place in ((stage.gravity, "g", "-|>", -16.0), (stage.motion, "motion", "<|-|>", -84.0)):
        size = float(np.linalg.norm(vector))
        if size < 0.5:
            continue
        middle, half = np.array([place, 11.0]), 8.0 * vector / size
        points = (
            Affine2D().scale(1.0 / 72.0) + axes.figure.dpi_scale_trans + ScaledTranslation(1.0, 1.0, axes.transAxes)  # type: ignore[arg-type]
        )
        arrow = FancyArrowPatch(
            tuple(middle - half), tuple(middle + half), arrowstyle=style, mutation_scale=8, color=_ARROW, lw=1.2,
            shrinkA=0, shrinkB=0, transform=points, clip_on=False,
        )  # fmt: skip
        arrow.set_in_layout(False)
        axes.add_artist(arrow)
        gap = 5.0 + max(abs(half[0]), 1.0)
        label = axes.text(
            middle[0] + gap, middle[1], text, transform=points, color=_ARROW, fontsize=8, va="center", clip_on=False
        )
        label.set_in_layout(False)


def animate(
    run: "Run", path: Path, kind: Format, progress: Callable[[float], None] = lambda done: None, width: float = 7.5
) -> Path:
    """Film of the last snapshots, at most FRAMES: the bed cut through the middle, in its moving container.

    Args:
        run: a run with snapshots.
        path: file to write, .gif or .mp4.
        kind: "gif" needs nothing; "mp4" needs the program ffmpeg.
        progress: told which part is done [-].
        width: of the picture [inch].

    Raises:
        InputError: no snapshots, no ffmpeg, or the file cannot be written.
    """
    check_film(kind)
    scenes, shots = scenes_of(run)[-FRAMES:], run.snapshots[-FRAMES:]
    scale = speed_scale(run.spec, scenes)
    stage = stage_of(run.spec, run.enclosure, run.radius, scenes, run.direction, scale)
    left, right, lower, upper = stage.bounds
    height = min(max(width * 0.8 * (upper - lower) / (right - left) + 1.2, 2.4), 9.0)
    figure = Figure(figsize=(width, height), layout="compressed")
    canvas: Any = FigureCanvasAgg(figure)  # its methods carry no types
    axes = figure.subplots()
    drawn = _draw(axes, stage, scenes[0], whole=False)
    bar = figure.colorbar(drawn, ax=axes, extend="max", fraction=0.05, pad=0.02)
    bar.set_label(stage.scale[2])
    figure.suptitle(headline(run.spec, run.packing.clearance), fontsize=10)
    axes.set_title(" ", fontsize=9)  # room for the moment
    moment = axes.text(0.0, 1.03, _moment(run, shots[0]), transform=axes.transAxes, fontsize=9)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # the panel must not shift from frame to frame
    lines = [part for part in axes.collections if isinstance(part, LineCollection)]
    for part in (drawn, moment, *lines):
        part.set_visible(False)
    canvas.draw()
    still = canvas.copy_from_bbox(figure.bbox)  # all that does not move is drawn once
    drawn.remove()
    for part in (moment, *lines):
        part.set_visible(True)

    def frame(k: int) -> NDArray[np.uint8]:
        canvas.restore_region(still)
        spheres = _spheres(axes, stage, scenes[k], whole=False)  # the plane cuts other particles in every frame
        axes.draw_artist(spheres)
        spheres.remove()
        for part, name in zip(lines, stage.walls, strict=True):
            part.set_segments(_wall_lines(stage, scenes[k], name))
            axes.draw_artist(part)
        moment.set_text(_moment(run, shots[k]))
        axes.draw_artist(moment)
        progress((k + 1) / len(scenes))
        return np.array(canvas.buffer_rgba())[..., :3]

    return _save_film((frame(k) for k in range(len(scenes))), path, kind)


def check_film(kind: str) -> None:
    """Whether films of this kind can be written here.

    Raises:
        InputError: an unknown kind, or mp4 without the program ffmpeg.
    """
    if kind not in ("gif", "mp4"):
        raise InputError(f"animation: given '{kind}'; allowed are gif and mp4")
    if kind == "mp4" and not FFMpegWriter.isAvailable():
        raise InputError(
            "animation: mp4 needs the program ffmpeg, which is not found; install it (Debian: apt install ffmpeg), or "
            "choose gif"
        )


def _save_film(frames: Iterator[NDArray[np.uint8]], path: Path, kind: Format) -> Path:
    """Write pictures (row, column, 3) as a film that takes its name when it is whole."""
    part = path.with_name(f".part-{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        (_save_gif if kind == "gif" else _save_mp4)(frames, part)
        os.replace(part, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error})") from None
    finally:
        part.unlink(missing_ok=True)
    return path


def _save_gif(frames: Iterator[NDArray[np.uint8]], path: Path) -> None:
    palette = _palette()  # one for all frames, so that nothing flickers
    first, *rest = (Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    length = round(1000 / FRAMES_PER_SECOND)
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=length, loop=0)


def _palette() -> Image.Image:
    """The 256 colours of a film: those of speed, greys from black to white, and the red of the arrows and its edges."""
    speeds = colormaps[_COLORS](np.linspace(0.0, 1.0, 176))[:, :3]
    greys = np.repeat(np.linspace(0.0, 1.0, 64)[:, None], 3, axis=1)
    reds = np.linspace((1.0, 1.0, 1.0), to_rgb(_ARROW), 17)[1:]
    image = Image.new("P", (1, 1))
    image.putpalette(np.rint(255.0 * np.concatenate([speeds, greys, reds])).astype(np.uint8).tobytes())
    return image


def _save_mp4(frames: Iterator[NDArray[np.uint8]], path: Path) -> None:
    first = next(frames)
    rows, columns = first.shape[0] // 2 * 2, first.shape[1] // 2 * 2  # H.264 in colours that players know: even sides
    command = [FFMpegWriter.bin_path(), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{columns}x{rows}", "-r", f"{FRAMES_PER_SECOND}", "-i", "-"]
    command += ["-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-f", "mp4", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as writer:
        assert writer.stdin is not None
        assert writer.stderr is not None
        with suppress(BrokenPipeError):  # ffmpeg has given up; it says why
            for frame in (first, *frames):
                writer.stdin.write(np.ascontiguousarray(frame[:rows, :columns]).tobytes())
            writer.stdin.close()
        told = writer.stderr.read().decode("utf-8", "replace").strip()
    if writer.returncode:
        raise OSError(f"ffmpeg: {told or writer.returncode}")


def velocity_figure(run: "Run") -> Figure:
    """Mean particle velocity in the middle plane at one phase of the cycle, over the container's velocity amplitude.

    Colours: magnitude of the absolute velocity in the plane of the picture, that is in the frame at rest, over V, as
    in Meyer & Seifried (2023), Figs 1 and 9. Arrows: the same with its direction. White: cells that
    fewer than RARE particles a cycle visit.

    Raises:
        InputError: the run has no velocity field.
    """
    field = run.velocity_field
    if field is None:
        raise InputError(
            "the run holds no velocity field; add [run.velocity_field] with cell = twice the particle diameter"
        )
    unit = velocity_amplitude_of(run.spec) or 1.0
    view = view_of(run.spec, run.direction)
    velocity = np.asarray(field.velocity) + unit * np.cos(field.phase) * np.asarray(run.direction) * (
        velocity_amplitude_of(run.spec) is not None
    )
    right, up, toward = (int(np.argmax(np.abs(axis))) for axis in view[:3])
    layers = np.moveaxis(velocity, (right, up, toward), (0, 1, 2))
    n_depth = layers.shape[2]
    middle = layers[:, :, (n_depth - 1) // 2 : n_depth // 2 + 1]  # two layers where the plane lies between them
    met = np.moveaxis(np.asarray(field.met), (right, up, toward), (0, 1, 2))
    met = met[:, :, (n_depth - 1) // 2 : n_depth // 2 + 1]
    seen = np.isfinite(middle).all(axis=3) & (met >= RARE * field.n_cycle)
    number = seen.sum(axis=2)
    mean = np.where(seen[..., None], middle, 0.0).sum(axis=2) / np.where(number, number, 1)[..., None]
    mean = np.where(number[..., None] > 0, mean, np.nan) / unit
    x, y = mean @ view.right, mean @ view.up
    size = np.hypot(x, y)
    edges = [
        1e3 * np.sort(sign * (np.asarray(field.origin)[k] + field.cell * np.arange(layers.shape[n] + 1)))
        for n, (k, sign) in enumerate(((right, view.right[right]), (up, view.up[up])))
    ]
    for n, (k, axis) in enumerate(((right, view.right), (up, view.up))):
        if axis[k] < 0:
            x, y, size = (np.flip(values, axis=n) for values in (x, y, size))
    scene = Scene(run.packing.position, None, np.zeros(3))
    stage = stage_of(run.spec, run.enclosure, run.radius, [scene], run.direction, (0.0, 1.0, ""))
    left, right_end, lower, upper = (1e3 * bound for bound in stage.bounds)
    height = min(max(6.4 * (upper - lower) / (right_end - left) + 1.12, 2.8), 9.0)
    figure = Figure(figsize=(8.0, height), layout="compressed")
    axes = figure.subplots()
    most = float(np.nanmax(size)) if np.isfinite(size).any() else 1.0
    drawn = axes.pcolormesh(*edges, size.T, cmap="turbo", vmin=0.0, vmax=max(most, 1e-12), alpha=0.85)
    centre = [0.5 * (edge[1:] + edge[:-1]) for edge in edges]
    arrow = max(most, 1e-12) / (1.2e3 * field.cell)  # the longest spans a cell and a bit
    axes.quiver(
        *centre, x.T, y.T, angles="xy", scale_units="xy", scale=arrow, width=0.002, color="black", pivot="middle"
    )
    axes.set(aspect="equal", xlabel=f"{view.names[0]} [mm]", ylabel=f"{view.names[1]} [mm]")
    axes.set(xlim=(left, right_end), ylim=(lower, upper))
    _draw_walls(axes, stage, scene)
    bar = figure.colorbar(drawn, ax=axes, fraction=0.05, pad=0.02)
    bar.set_label("in-plane speed / V [-]" if unit != 1.0 else "in-plane speed [m/s]")
    place = f"container at phase {np.rad2deg(field.phase):.4g}°"
    if abs(np.cos(field.phase)) < 1e-6:
        place = f"container at $x_c$ = {'X' if np.sin(field.phase) > 0 else '−X'}"
    text = f"absolute particle velocity in the middle plane, {place}, mean of {field.n_cycle} cycles"
    figure.suptitle(f"{headline(run.spec, run.packing.clearance)}\n{text}", fontsize=10)
    axes.set_title(" ", fontsize=10)  # room for the arrows
    _arrows(axes, stage)
    return figure
