"""What gpu_check.py found, as files: JSON for programs, Markdown and a plot for people, written again after every part;
and the time that its parts have."""

import json
import time
from pathlib import Path
from typing import Any

from gpu_ceilings import Card, ceilings

SPOKEN = ("rows", "table")
"""Entries of a part that are tables."""

NOT_MEASURED = "not yet measured"


class OutOfTime(Exception):
    """A part has used its time."""


class Clock:
    """Time of the check and of its parts [s]."""

    def __init__(self, total: float) -> None:
        """Begin."""
        self.begin = time.perf_counter()
        self.end = self.until = self.begin + total

    def part(self, seconds: float) -> None:
        """A part begins."""
        self.until = min(time.perf_counter() + seconds, self.end)

    @property
    def left(self) -> float:
        """To the end of the part [s]."""
        return self.until - time.perf_counter()

    @property
    def spent(self) -> float:
        """Since the beginning [s]."""
        return time.perf_counter() - self.begin

    def check(self) -> None:
        """Raise OutOfTime at the end of the part."""
        if self.left < 0.0:
            raise OutOfTime


class Report:
    """All results so far, and the folder that they are written to.

    Attributes:
        told: results by part.
        failed: checks that did not hold, in words; those that were left out are among them.
        left_out: timings that were left out, in words.
        held: number of checks that held.
    """

    def __init__(self, folder: Path, stem: str, about: dict[str, Any]) -> None:
        """Nothing is known yet."""
        self.folder, self.stem = folder, stem
        self.failed: list[str] = []
        self.left_out: list[str] = []
        self.held = 0
        self.told: dict[str, Any] = {"about": about, "failed": self.failed, "left_out": self.left_out, "seconds": 0.0}
        folder.mkdir(parents=True, exist_ok=True)

    def demand(self, holds: bool, message: str) -> None:
        """Note a check; `message` says how it does not hold."""
        if holds:
            self.held += 1
        else:
            self.failed.append(message)
            print(f"WRONG: {message}", flush=True)

    def leave_out(self, timing: str) -> None:
        """Note a timing, not a check, that was left out."""
        self.left_out.append(timing)
        print(f"left out: {timing}", flush=True)

    def save(self) -> None:
        """Write everything, whole or not at all."""
        for suffix, text in ((".json", json.dumps(self.told, indent=1)), (".md", self.page())):
            draft = self.folder / f".{self.stem}.part"
            draft.write_text(text, encoding="utf-8")
            draft.replace(self.folder / f"{self.stem}{suffix}")

    def page(self) -> str:
        """The results as Markdown."""
        told = self.told
        lines = [f"# GPU check, {told['about']['date']}", ""]
        lines += [", ".join(f"{k} {v}" for k, v in told["about"].items() if k != "date"), ""]
        failed = "; ".join(self.failed) or ("nothing" if self.held else "no check was made")
        lines += [f"Checks that held: {self.held}. Failed: {failed}. Took {told['seconds']:.0f} s.", ""]
        lines += [f"Timings left out: {'; '.join(self.left_out) or 'none'}.", ""]
        if "rates" in told:
            lines += [
                "| | |",
                "| --- | --- |",
                *(f"| {name} | {value} |" for name, value in self.summary().items()),
                "",
            ]
        for name, part in told.items():
            if name in ("about", "failed", "left_out", "seconds"):
                continue
            lines += [f"## {name.replace('_', ' ')}", ""]
            lines += [f"- {key}: {_short(value)}" for key, value in part.items() if key not in SPOKEN]
            lines += _points(part["rows"]) if "rows" in part else []
            lines += _costs(part["table"]) if "table" in part else []
            lines.append("")
        return "\n".join(lines)

    def summary(self) -> dict[str, str]:
        """The rows of the table in docs/gpu.md. The whole field is measured alone; its result lies beside this one."""
        told, (speed, worlds, particles) = self.told, self._largest()
        card, one, other = told.get("card"), told.get("one_world", {}), told.get("dem_engine", {})
        rows = {f"particle-steps/s, {worlds} worlds of {particles} spheres": _measured(speed)}
        share = NOT_MEASURED
        if speed and card:
            limits = ceilings(Card(**card))
            parts = [f"{speed / limit:.2%} of {limit:.2g} ({name})" for name, limit in limits.items()]
            share = f"{', '.join(parts)}; card's numbers from {card['source']}"
        rows["the same over the ceilings"] = share
        rows[f"one world of {particles} spheres against one processor core"] = (
            f"{one['ratio']:.3g} times, with {one['best']}" if "ratio" in one else NOT_MEASURED
        )
        rows[f"{worlds} worlds of {particles} spheres against DEM-Engine on one of them"] = (
            f"{speed / other['rate']:.3g} times" if speed and "rate" in other else NOT_MEASURED
        )
        path = self.folder / f"{self.stem.replace('check', 'field').replace('rehearsal', 'field_rehearsal')}.json"
        whole = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        field = whole.get("whole_field", {})
        rows["a field of 28 x 15 points through `graindamp field`"] = (
            f"{field['seconds']:.0f} s, {field['usable']} of {field['places']} points, "
            f"{whole['about']['card']}, {whole['about']['date']}"
            if "seconds" in field
            else NOT_MEASURED
        )
        return rows

    def _largest(self) -> tuple[float, int, int]:
        """Particle-steps per second of most worlds of most particles, 0 if unknown, and these numbers."""
        table = self.told.get("rates", {}).get("table", [])
        if not table:
            return 0.0, 0, 0
        row = max(table, key=lambda row: (row["particles"], row["worlds"]))
        return float(row["rate"]), int(row["worlds"]), int(row["particles"])

    def plot(self) -> Path | None:
        """Cost against worlds and particles per world, as a picture; None without two numbers of worlds."""
        table = self.told.get("rates", {}).get("table", [])
        if len({row["worlds"] for row in table}) < 2:
            return None
        from matplotlib.figure import Figure

        figure = Figure(figsize=(10, 4.2), layout="constrained")
        speed, cost = figure.subplots(1, 2)
        for n in sorted({row["particles"] for row in table}):
            rows = sorted((row for row in table if row["particles"] == n), key=lambda row: int(row["worlds"]))
            worlds = [row["worlds"] for row in rows]
            speed.plot(worlds, [row["rate"] for row in rows], "o-", label=f"{n} particles per world")
            cost.plot(worlds, [1e6 * row["step_seconds"] for row in rows], "o-", label=f"{n} particles per world")
        other = self.told.get("dem_engine", {}).get("rate")
        if other:
            speed.axhline(other, color="#555555", ls="--", label="DEM-Engine, one bed of the most particles")
        speed.set(ylabel="particle-steps per second [1/s]")
        cost.set(ylabel="time of one step of all worlds [µs]")
        for axes in (speed, cost):
            axes.set(xscale="log", yscale="log", xlabel="worlds at once [-]")
            axes.grid(alpha=0.3)
            axes.legend(fontsize=8)
        about = self.told["about"]
        figure.suptitle(f"{about['card']}, {about['date']}", fontsize=10)
        path = self.folder / f"{self.stem}.png"
        figure.savefig(path, dpi=130)
        return path


def _measured(value: float) -> str:
    return f"{value:.3g}" if value else NOT_MEASURED


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _points(rows: list[list[float]]) -> list[str]:
    """Operating points against the processor."""
    lines = ["", "| point | eta | se | m' | se | cycles | eta CPU | se | m' CPU | se | cycles | z | z |"]
    lines += ["| --: " * 13 + "|"]
    return lines + ["| " + " | ".join(f"{x:.4g}" for x in row) + " |" for row in rows] + [""]


def _costs(rows: list[dict[str, float]]) -> list[str]:
    """Cost against numbers of worlds and particles."""
    lines = ["", "| particles per world | worlds | particle-steps/s | step of all worlds [µs] | bytes per particle |"]
    lines += ["| --: " * 5 + "|"]
    for row in rows:
        lines.append(
            f"| {row['particles']:.0f} | {row['worlds']:.0f} | {row['rate']:.3g} | {1e6 * row['step_seconds']:.3g} "
            f"| {row['bytes_per_particle']:.0f} |"
        )
    return [*lines, ""]
