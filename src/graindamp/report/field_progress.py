"""How a campaign is getting on: a line on the terminal, and a map with its page that fill in while it runs."""

import html
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from graindamp.campaign.outlook import Outlook, PlaceView
from graindamp.report.field_pictures import Picture
from graindamp.report.figures import log_axis
from graindamp.report.page import table_html
from graindamp.report.tables import Table
from graindamp.report.wording import verbatim
from graindamp.units import STANDARD_GRAVITY

DRAW_EVERY = 5.0
"""Seconds between pictures, at least; a picture takes half a second."""
LINE_EVERY = 30.0
"""Seconds between lines where the error stream is no terminal."""
_FACE = {"running": "#cfe8ff", "elsewhere": "#e6e6e6"}
_HATCH = {"queued": "//", "running": "..", "elsewhere": ".."}

Real = NDArray[np.float64]


def line_of(outlook: Outlook) -> str:
    """Points done, running and failed, time left and worst standard error, in one line."""
    words = [f"{outlook.n_done} of {outlook.n_point} done", f"{outlook.n_running} running"]
    if outlook.n_elsewhere:
        words.append(f"{outlook.n_elsewhere} elsewhere")
    if outlook.n_failed:
        words.append(f"{outlook.n_failed} failed")
    if np.isfinite(outlook.worst_error):
        words.append(f"worst error {100 * outlook.worst_error:.2g} %")
    if outlook.seconds_left is not None and outlook.n_done < outlook.n_point:
        words.append(f"{clock(outlook.seconds_left)} left")
    return f"{outlook.stage}: {', '.join(words)}"


def clock(seconds: float) -> str:
    """A time as 2:05, or 1:02:05 with hours."""
    hours, rest = divmod(round(seconds), 3600)
    return f"{hours}:{rest // 60:02d}:{rest % 60:02d}" if hours else f"{rest // 60}:{rest % 60:02d}"


def progress_map(outlook: Outlook, title: str) -> Figure:
    """Loss factor and effective mass ratio at the points that are done; the others hatched, the failed ones crossed."""
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    places = outlook.places
    f = np.array([place.frequency for place in places])
    gamma = np.array([place.intensity for place in places])
    for axes, name, label, colors in (
        (panels[0], "loss_factor", "loss factor η [-]", "viridis"),
        (panels[1], "effective_mass_ratio", "effective mass ratio m′ [-]", "cividis"),
    ):
        values = np.array([getattr(place, name) for place in places], float)
        known = values[np.isfinite(values)]
        low = min(float(known.min(initial=0.0)), 0.0)
        norm = Normalize(low, max(float(known.max(initial=0.1)), 0.1))
        mappable = _cells(axes, places, values, norm, colors)
        axes.set(xscale="log", yscale="log", xlabel="frequency f [Hz]")
        axes.set(xlim=(_edges(f)[0], _edges(f)[-1]), ylim=(_edges(gamma)[0], _edges(gamma)[-1]))
        for axis in (axes.xaxis, axes.yaxis):
            log_axis(axis)
        _strokes(axes, outlook.clearance)
        figure.colorbar(mappable, ax=axes).set_label(label)
    panels[0].set_ylabel("excitation intensity Γ [-]")
    figure.suptitle(f"{verbatim(title)}\n{line_of(outlook)}", fontsize=10)
    return figure


def _cells(axes: Axes, places: Sequence[PlaceView], values: Real, norm: Normalize, colors: str) -> Any:
    """A rectangle for each point of a grid, a mark for each of scattered points."""
    f_axis = sorted({place.frequency for place in places})
    g_axis = sorted({place.intensity for place in places})
    is_grid = len(places) == len(f_axis) * len(g_axis)
    f_edge, g_edge = _edges(np.array(f_axis)), _edges(np.array(g_axis))
    mappable = axes.scatter([], [], c=[], cmap=colors, norm=norm)
    for place, value in zip(places, values, strict=True):
        known = place.state == "done" and np.isfinite(value)
        face = mappable.to_rgba(value) if known else _FACE.get(place.state, "#ffffff")
        hatch = None if known else _HATCH.get(place.state)
        if is_grid:
            i, j = f_axis.index(place.frequency), g_axis.index(place.intensity)
            box = (f_edge[i], g_edge[j]), f_edge[i + 1] - f_edge[i], g_edge[j + 1] - g_edge[j]
            axes.add_patch(Rectangle(*box, facecolor=face, edgecolor="#bbbbbb", hatch=hatch, lw=0.3))
        else:
            axes.plot(place.frequency, place.intensity, "o", ms=9, mfc=face, mec="#777777", mew=0.8)
        if place.state == "failed":
            axes.plot(place.frequency, place.intensity, "x", color="#d00000", ms=8, mew=2)
    return mappable


def _edges(values: Real) -> Real:
    """Borders of cells round values, halfway between them on a logarithmic scale; a fifth beside one alone."""
    logs = np.log(np.unique(values))
    if len(logs) < 2:
        return np.exp(np.array([logs[0] - 0.2, logs[0] + 0.2])) if len(logs) else np.array([1.0, 10.0])
    middle = 0.5 * (logs[1:] + logs[:-1])
    ends = 2 * logs[0] - middle[0], 2 * logs[-1] - middle[-1]
    return np.asarray(np.exp(np.concatenate([[ends[0]], middle, [ends[1]]])))


def _strokes(axes: Axes, clearance: float | None) -> None:
    """Lines of constant stroke X, as multiples of h / pi, where a bouncing bed damps best."""
    if clearance is None:
        return
    low, high = axes.get_xlim()
    floor, top = axes.get_ylim()
    f = np.geomspace(low, high, 100)
    for factor, style in ((0.5, ":"), (1.0, "--"), (2.0, ":")):
        gamma = factor * clearance / np.pi * (2 * np.pi * f) ** 2 / STANDARD_GRAVITY
        inside = (gamma > floor) & (gamma < top)
        if np.count_nonzero(inside) > 5:
            axes.plot(f[inside], gamma[inside], style, color="#d55e00", lw=1.2)
            k = np.flatnonzero(inside)[-1]
            text = "X = h/π" if factor == 1.0 else f"{factor:g} h/π"
            axes.annotate(
                text, (f[k], gamma[k]), (3, -3), textcoords="offset points", va="top", fontsize=7, color="#d55e00"
            )


class FieldProgress:
    """Takes what a campaign tells, and shows it: a line for people, a map and a page in files.

    Attributes:
        picture: the map, PNG.
        page: the page, HTML; it loads itself again as long as the campaign runs.
    """

    def __init__(self, output: Path, title: str, *, quiet: bool = False) -> None:
        """Show the campaign of one field.

        Args:
            output: file of the field; picture and page are named after it.
            title: of the field.
            quiet: no line, files only.
        """
        self.picture, self.page = output.with_suffix(".map.png"), output.with_suffix(".html")
        self._title, self._quiet = title, quiet
        self._drawn = self._said = -np.inf
        self._last: Outlook | None = None
        self._shown = ""
        self._status: Any = None
        self._remarks: tuple[str, ...] = ()
        self._tables: tuple[Table, ...] = ()
        self._pictures: tuple[Picture, ...] = ()

    def __call__(self, outlook: Outlook) -> None:
        """Show the state, if it is time to."""
        now = time.monotonic()
        shown = repr((outlook.stage, outlook.n_done, outlook.places))  # no NaN is equal to another
        self._last = outlook
        if self._status is not None:
            self._status.update(line_of(outlook))
        elif not self._quiet and now - self._said > LINE_EVERY:
            print(line_of(outlook), file=sys.stderr)
            self._said = now
        if shown != self._shown and now - self._drawn > DRAW_EVERY and outlook.n_done < outlook.n_point:
            self.draw("running")
            self._drawn, self._shown = time.monotonic(), shown

    def __enter__(self) -> "FieldProgress":
        """Begin to show."""
        if not self._quiet:
            from graindamp.report.console import messages

            console = messages()
            if console.is_terminal:
                self._status = console.status("starting")
                self._status.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None) -> None:
        """Take the line away and draw the last state."""
        if self._status is not None:
            self._status.stop()
        if self._last is not None:
            if not self._quiet:
                print(line_of(self._last), file=sys.stderr)
            self.draw("finished" if kind is None else "stopped")

    def conclude(self, remarks: Sequence[str], tables: Sequence[Table], pictures: Sequence[Picture]) -> None:
        """What the page shows below the map once the field is done; pictures lie beside it."""
        self._remarks, self._tables, self._pictures = tuple(remarks), tuple(tables), tuple(pictures)

    def draw(self, state: str) -> None:
        """Write map and page. A picture that cannot be written stops nothing: results count."""
        if self._last is None or not self._last.places:
            return
        with suppress(OSError), _drafts(self.picture, self.page) as (picture, page):
            picture.parent.mkdir(parents=True, exist_ok=True)
            progress_map(self._last, self._title).savefig(picture, dpi=110, format="png")
            page.write_text(self._html(state), encoding="utf-8")

    def _html(self, state: str) -> str:
        assert self._last is not None
        again = '<meta http-equiv="refresh" content="5">' if state == "running" else ""
        title, line = html.escape(self._title), html.escape(line_of(self._last))
        legend = "hatched: waiting; dotted: running (grey: by another campaign); red cross: failed"
        below = "".join(f'<div class="warn">{html.escape(remark)}</div>' for remark in self._remarks)
        below += "".join(table_html(table) for table in self._tables)
        below += "".join(
            f'<img alt="{html.escape(one.name)}" src="{html.escape(one.path.name)}"><p>{html.escape(one.caption)}</p>'
            for one in self._pictures
        )
        stamp = time.strftime("%Y-%m-%d %H:%M:%S")
        return (
            f'<!doctype html><html lang="en"><head><meta charset="utf-8">{again}<title>{title}</title>'
            "<style>body{font:15px/1.5 system-ui,sans-serif;max-width:1200px;margin:2rem auto;padding:0 1rem}"
            "img{max-width:100%}table{border-collapse:collapse;font-size:13px}.wide{overflow-x:auto}"
            "th,td{padding:.25rem .6rem;text-align:right;border-bottom:1px solid #e5e5e5}"
            ".warn{background:#fff6e0;border-left:4px solid #e69f00;padding:.4rem .8rem;margin:.4rem 0}</style></head>"
            f"<body><h1>{title}</h1><p>{state}, {stamp}. {line}.</p>"
            f'<img alt="map of the field" src="{html.escape(self.picture.name)}?{time.time():.0f}"><p>{legend}.</p>'
            f"{below}</body></html>\n"
        )


@contextmanager
def _drafts(*targets: Path) -> Iterator[tuple[Path, ...]]:
    """Files that take their names when all of them are whole."""
    drafts = tuple(path.with_name(f".{path.name}.part") for path in targets)
    try:
        yield drafts
        for draft, target in zip(drafts, targets, strict=True):
            draft.replace(target)
    finally:
        for draft in drafts:
            draft.unlink(missing_ok=True)
