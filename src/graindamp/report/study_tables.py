"""Tables of what was studied beside a field: softened contacts, other beds."""

import xarray as xr

from graindamp.field.beds import BedStudy, bed_study_of
from graindamp.field.softening import Extrapolation, SofteningStudy, study_of
from graindamp.report.tables import Table
from graindamp.report.wording import plain, with_error


def tables_of(field: xr.Dataset, dampers: str = "") -> tuple[Table, ...]:
    """Tables of the studies that a field keeps; names of its dampers for the headings."""
    softening, beds = study_of(field), bed_study_of(field)
    return (
        *(() if softening is None else (softening_table(softening, dampers),)),
        *(() if beds is None else (bed_table(beds, dampers),)),
    )


def softening_table(study: SofteningStudy, dampers: str = "") -> Table:
    """What the softening of its contacts does to a field, point by point; names of its dampers for the heading."""
    at = ", ".join(f"{factor:g}" for factor in study.factors)

    def cells(part: Extrapolation, fits: bool | None) -> tuple[str, ...]:
        found = ", ".join(plain(value) for value in part.value.tolist())
        if fits is False:
            return found, "–", "–"
        return found, with_error(part.described, part.described_se), with_error(part.error, part.error_se)

    rows = tuple(
        (
            plain(one.frequency, 5),
            plain(one.intensity, 4),
            *cells(one.loss_factor, fits),
            *cells(one.effective_mass_ratio, fits),
            {True: "yes", False: "no", None: "–"}[fits],
            f"{100 * error:.0f}",
        )
        for one, fits, error in zip(study.points, study.are_straight, study.relative_errors, strict=True)
    )
    told = tuple(f"{name} {what}" for name in ("η", "m′") for what in (f"at {at}", "at 1, by line", "error"))
    return Table(
        f"What softening {study.chosen:g} does to the field" + (f" of {dampers}" if dampers else ""),
        ("f [Hz]", "Γ [-]", *(f"{name} [-]" for name in told), "line fits", "error [% of η]"),
        rows,
        f"Line: straight in softening^{study.power:g}. Error: at softening {study.chosen:g} against 1; the last column "
        "has the larger one of η and m′, and where no line fits, the largest difference. ± is one standard error.",
    )


def bed_table(study: BedStudy, dampers: str = "") -> Table:
    """How beds of one description differ, point by point; names of their dampers for the heading."""
    rows = []
    for k, (one, parted) in enumerate(zip(study.points, study.are_parted, strict=True)):
        scatters = ("–", "–") if parted else tuple(f"{100 * value:.1f}" for value in study.scatters(k))
        values = [
            ", ".join(plain(v) for v in column.tolist()) for column in (one.loss_factor, one.effective_mass_ratio)
        ]
        rows.append((plain(one.frequency, 5), plain(one.intensity, 4), values[0], scatters[0], values[1], scatters[1]))
    pooled = study.pooled
    told = "no point at which the beds move alike, the errors of the field are those of its runs"
    if pooled is not None:
        eta, mass = (with_error(part.value, part.error, scale=100) for part in pooled)
        told = f"all points together {eta} % for η and {mass} % for m′, which the errors of the field contain"
    return Table(
        "How beds of one description differ" + (f", {dampers}" if dampers else ""),
        (
            "f [Hz]",
            "Γ [-]",
            "η of each bed [-]",
            "scatter of η [% of η]",
            "m′ of each bed [-]",
            "scatter of m′ [% of η]",
        ),
        tuple(rows),
        f"Scatter: standard deviation between beds beyond the errors of the runs, over the larger of η and "
        f"{study.floor:g}; {told}. –: the beds move in different ways.",
    )
