"""What a reader must be told of a simulated field wherever it is used."""

import xarray as xr

from graindamp.field.beds import bed_remarks
from graindamp.field.softening import softening_remarks


def remarks_on(field: xr.Dataset) -> tuple[str, ...]:
    """A sentence for everything that the numbers of a field do not tell: softened contacts, beds not compared."""
    return (*softening_remarks(field), *bed_remarks(field))
