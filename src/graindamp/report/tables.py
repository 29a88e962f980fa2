"""Tables of results: one description, shown on a terminal, in a page, or as CSV."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from graindamp.couple.equilibrium import Equilibrium
from graindamp.couple.predict import Prediction, Study
from graindamp.couple.response import peaks
from graindamp.field.robustness import Robustness
from graindamp.field.schema import damper_of
from graindamp.field.store import table_of
from graindamp.report.document import status_names
from graindamp.report.wording import plain, with_error
from graindamp.signals.power import OperatingPoint


class Table(NamedTuple):
    """A heading, column titles with units, rows of text, and what to know when reading it."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def damping_table(prediction: Prediction) -> Table:
    """Every equilibrium of every mode under every force."""
    rows: list[tuple[str, ...]] = []
    for solved in prediction.modes:
        for mode in solved:
            result, scheme = mode.result, mode.fixed_point
            shown = "–" if scheme is None else "not converged"
            if scheme is not None and scheme.converged:
                shown = f"{100 * scheme.last.damping_ratio:.3g} ({scheme.n_iter})"
            head = (
                f"{result.force:g}",
                str(result.number),
                f"{result.bare_frequency:.2f}",
                plain(100 * result.bare_damping_ratio),
            )
            tail = (plain(100 * result.efficient_damping_ratio), shown)
            if not result.equilibria:
                rows.append((*head, "–", "–", "–", "–", "none", *tail))
            for state in result.equilibria:
                rows.append((*head, *_state_cells(state), *tail))
    return Table(
        "Damping at resonance",
        (
            "force [N]",
            "mode",
            "f bare [Hz]",
            "ζ structure [%]",
            "f with beds [Hz]",
            "ζ [%]",
            "Γ [-]",
            "η [-]",
            "state",
            "ζ if η = 1 [%]",
            "ζ fixed point [%] (turns)",
        ),
        tuple(rows),
        "± is one standard error propagated from the field. Γ and η are those of the damper that moves most. "
        "'*' marks a field used outside its points; what lies there is a guess.",
    )


def _state_cells(state: Equilibrium) -> tuple[str, ...]:
    most = int(np.nanargmax(state.intensity)) if np.isfinite(state.intensity).any() else None
    word = ("stable" if state.is_stable else "unstable") + (" *" if state.extrapolated else "")
    return (
        with_error(state.frequency, state.frequency_se),
        with_error(state.damping_ratio, state.damping_ratio_se, scale=100),
        "0" if most is None else with_error(state.intensity[most], state.intensity_se[most]),
        "–" if most is None else plain(state.loss_factor[most]),
        word,
    )


def resonance_table(prediction: Prediction) -> Table | None:
    """Resonances read off the response curves beside those solved mode by mode; None without a response."""
    if not prediction.responses:
        return None
    rows = []
    for force, sweeps, solved in zip(prediction.forces, prediction.responses, prediction.modes, strict=True):
        found = peaks(sweeps[0])
        for mode in solved:
            for state in mode.result.stable:
                near = min(found, key=lambda peak: abs(peak.frequency - state.frequency), default=None)
                if near is None or abs(near.frequency / state.frequency - 1) > 0.1:
                    continue
                rows.append(
                    (
                        f"{force:g}",
                        str(mode.result.number),
                        f"{state.frequency:.2f}",
                        f"{near.frequency:.2f}",
                        f"{100 * state.damping_ratio:.3g}",
                        "–" if math.isnan(near.damping_ratio) else f"{100 * near.damping_ratio:.3g}",
                        f"{near.mobility:.3g}",
                    )
                )
    return Table(
        "Resonances: single mode against response curve",
        (
            "force [N]",
            "mode",
            "f single mode [Hz]",
            "f curve [Hz]",
            "ζ single mode [%]",
            "ζ half-power of curve [%]",
            "peak mobility [m/(N s)]",
        ),
        tuple(rows),
        "The half-power bandwidth mixes the damping of all amplitudes between the peak and 71 % of it; it agrees with "
        "the single mode where the field is flat, and shows how far the resonance departs from a linear one where not.",
    )


def points_table(points: Sequence[OperatingPoint], states: Sequence[int] | None = None) -> Table:
    """Every record of a measurement; `states` of what they come from, where that knows more than the signals."""
    rows = tuple(
        (
            point.label,
            plain(point.frequency, 5),
            plain(point.intensity, 4),
            with_error(point.loss_factor, point.loss_factor_error),
            with_error(point.effective_mass_ratio, point.effective_mass_ratio_error),
            with_error(1e3 * point.dissipated_energy, float("nan")),
            with_error(point.power, float("nan")),
            f"{point.n_cycle} (-{point.n_skipped})",
            ", ".join(status_names(status)) or "ok",
        )
        for point, status in zip(points, states or [point.status for point in points], strict=True)
    )
    return Table(
        "Operating points",
        (
            "record",
            "f [Hz]",
            "Γ [-]",
            "η [-]",
            "m′ [-]",
            "energy [mJ/cycle]",
            "power [W]",
            "cycles (dropped)",
            "status",
        ),
        rows,
        "± is one standard error over cycles, with their correlation, drift and phase error. Energy and power are "
        "relatively as uncertain as η.",
    )


def field_table(field: xr.Dataset) -> Table:
    """Every operating point of a field."""
    columns = table_of(field)
    others = columns.get("loss_factor_other", np.array([np.nan]))
    second = bool(np.isfinite(others).any())

    def other_cells(row: dict[str, float]) -> tuple[str, ...]:
        names = ("loss_factor_other", "effective_mass_ratio_other") if second else ()
        return tuple(with_error(row[name], row.get(f"{name}_se", np.nan)) for name in names)

    rows = tuple(
        (
            plain(row["frequency"], 5),
            plain(row["intensity"], 4),
            with_error(row["loss_factor"], row["loss_factor_se"]),
            with_error(row["effective_mass_ratio"], row["effective_mass_ratio_se"]),
            *other_cells(row),
            plain(1e3 * row["dissipated_energy"], 4),
            plain(row["power"], 4),
            ", ".join(status_names(int(row["status"]))) or "ok",
        )
        for row in (dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True))
    )
    damper = damper_of(field)
    return Table(
        f"{damper.get('name', 'effective field')}: bed mass {1e3 * field.attrs['bed_mass']:.5g} g",
        (
            *("f [Hz]", "Γ [-]", "η [-]", "m′ [-]"),
            *(("other η [-]", "other m′ [-]") if second else ()),
            *("energy [mJ/cycle]", "power [W]", "status"),
        ),
        rows,
        f"{field.attrs.get('source', '')}. ± is one standard error{_of_one_bed(field)}. Energy and power are "
        "relatively as uncertain as η."
        + (" Other: the second answer of a point that depends on where the bed started." if second else ""),
    )


def _of_one_bed(field: xr.Dataset) -> str:
    """What errors of a simulated field tell of other beds."""
    if "bed_study" in field.attrs:
        return ", the scatter of beds included"
    return " within the run of one bed; other beds differ by more" if field.attrs.get("seeds") == 1 else ""


def robustness_table(found: Robustness) -> Table:
    """How good a field stays over its range."""
    (f_low, f_high), (g_low, g_high) = found.frequency_range, found.intensity_range
    rows = (
        (f"share of the range with η ≥ {found.level:g} [%]", with_error(*found.share, scale=100)),
        ("least η [-]", with_error(*found.worst)),
        ("steepest |d ln η / d ln X| below X_opt [-]", with_error(*found.steepest)),
        ("mean |d ln η / d ln X| below X_opt [-]", with_error(*found.steepness)),
    )
    covered = "" if found.covered > 0.999 else f" The field knows about {100 * found.covered:.0f} % of the range."
    return Table(
        f"Robustness over {f_low:g} to {f_high:g} Hz, {g_low:g} to {g_high:g} g",
        ("measure", "value"),
        rows,
        f"Shares by area over ln f and ln Γ. ± is one standard error.{covered}",
    )


def study_table(study: Study) -> Table:
    """Damping ratio of every mode over the value varied."""
    numbers = [result.number for result in study.predictions[0]]
    rows = []
    for value, results in zip(study.value, study.predictions, strict=True):
        cells = [f"{value:.4g}"]
        for result in results:
            stable = result.stable
            mark = " *" if stable and stable[0].extrapolated else ""
            cells.append(
                with_error(stable[0].damping_ratio, stable[0].damping_ratio_se, scale=100) + mark if stable else "none"
            )
        rows.append(tuple(cells))
    return Table(
        f"Damping ratio over {study.name}",
        (study.name, *(f"ζ mode {number} [%]" for number in numbers)),
        tuple(rows),
        "The stable equilibrium of smallest amplitude; '*' marks a field used outside its points.",
    )
