"""What all commands share: reading options with units, printing JSON, progress and warnings."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from graindamp.errors import InputError
from graindamp.units import STANDARD_GRAVITY, to_si

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document (SI units) and nothing else.")]


def print_json(document: Any) -> None:
    """Print a plain document; what is not finite must have become None before."""
    print(json.dumps(document, indent=1, allow_nan=False))


def read_option(option: str, value: str | None, unit: str) -> float | None:
    """SI number of an option's text.

    Raises:
        InputError: naming the option.
    """
    if value is None:
        return None
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise InputError(f"--{option}: given '{value}'; {error}") from None


def need_option(option: str, value: str | None, unit: str) -> float:
    """SI number of an option that cannot be left out.

    Raises:
        InputError: naming the option.
    """
    number = read_option(option, value, unit)
    if number is None:
        raise InputError(f"--{option} is needed")
    return number


def read_intensity(option: str, value: str | None) -> float | None:
    """Intensity [-], typed as a plain number or as an acceleration such as '40 g' or '392 m/s^2'."""
    if value is None:
        return None
    try:
        return to_si(value, "")
    except ValueError:
        number = read_option(option, value, "m/s^2")
        return None if number is None else number / STANDARD_GRAVITY


@contextmanager
def progress_of(quiet: bool) -> Iterator[Callable[[str], None]]:
    """Tells a person what is going on, on the error stream; nothing if that is not a terminal or `quiet`."""
    if quiet:
        yield lambda text: None
        return
    from graindamp.report.console import messages

    console = messages()
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status("starting") as status:
        yield lambda text: status.update(text)


def warn(lines: list[str] | tuple[str, ...]) -> None:
    """Warnings on the error stream, a line each."""
    for line in lines:
        print(f"warning: {line}", file=sys.stderr)


def show_rule(document: dict[str, Any], units: dict[str, str], source: str, as_json: bool) -> None:
    """A rule's answer: JSON, or one line per value with its unit and the source."""
    from graindamp.report.wording import plain

    if as_json:
        from graindamp.report.plain import plain as as_plain

        print_json(as_plain(document | {"units": units, "source": source}))
        return
    width = max(24, *(len(key) for key in document))
    for key, value in document.items():
        if value == "":
            continue
        text = plain(value, 5, units.get(key, "")) if isinstance(value, float) else str(value)
        print(f"{key.replace('_', ' '):{width}s} {text}")
    print(f"{'source':{width}s} {source}")
