"""Numbers as people read them."""

import math
from collections.abc import Iterable


def with_error(value: float, error: float, unit: str = "", scale: float = 1.0) -> str:
    """'0.866 ± 0.020 unit': the error to two digits, the value to the same place; an unknown error is not shown.

    Args:
        value: in SI.
        error: its standard error in the same unit, NaN if unknown.
        unit: unit to print.
        scale: factor from SI to that unit.
    """
    tail = f" {unit}" if unit else ""
    if not math.isfinite(value):
        return "–"
    value, error = value * scale, error * scale
    if not math.isfinite(error) or error <= 0:
        return f"{value:.4g}{tail}"
    digits = max(0, min(12, 1 - math.floor(math.log10(error))))
    return f"{value:.{digits}f} ± {error:.{digits}f}{tail}"


def verbatim(text: str) -> str:
    """What a user has named something, for a figure, where a dollar sign would begin a formula."""
    return text.replace("$", r"\$")


def plain(value: float, digits: int = 3, unit: str = "") -> str:
    """A number to some digits with its unit; a dash for NaN, words for infinity."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "no limit"
    value = 0.0 if abs(value) < 1e-14 else value  # rounding of a closed form
    return f"{value:.{digits}g}{' ' + unit if unit else ''}"


def softened(factors: Iterable[float]) -> list[str]:
    """What to say of a run whose contacts are softened by these factors; nothing of stiff ones."""
    told = ", ".join(f"{factor:g}" for factor in sorted({*factors} - {1.0}))
    return [f"contacts softened by {told}: a run with softening = 1 tells what that does"] if told else []
