"""Tables and progress on a terminal. Everything but results goes to the error stream."""

import sys

from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from graindamp.report.tables import Table


def show(table: Table) -> None:
    """Print a table to standard output, as wide as it needs to be where that is not a terminal."""
    console = Console(width=None if sys.stdout.isatty() else 200, highlight=False)
    grid = RichTable(title=table.title, title_justify="left", header_style="bold", caption=table.note or None)
    grid.caption_justify = "left"
    for k, column in enumerate(table.columns):
        grid.add_column(Text(column), justify="left" if k == 0 and not column.endswith("]") else "right")
    for row in table.rows:
        grid.add_row(*(Text(cell) for cell in row))
    console.print(grid)


def messages() -> Console:
    """Console of the error stream, for progress, warnings and errors."""
    return Console(stderr=True, highlight=False, soft_wrap=True)
