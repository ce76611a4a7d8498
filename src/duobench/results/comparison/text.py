"""Numbers of a comparison as text, the same on the page, in its tables and in its sentences."""

from __future__ import annotations

from collections.abc import Sequence

from duobench.results.comparison.entrants import Cell

MINUS = "\N{MINUS SIGN}"
_SMALLEST = 0.001
"""P-values below are not told apart."""


def rate_text(cell: Cell) -> str:
    """Success rate in percent: of a run with one digit, of the paper as it stands there."""
    return f"{100 * cell.rate:.0f}" if cell.interval is None else f"{100 * cell.rate:.1f}"


def progress_text(cell: Cell) -> str:
    """Mean final progress with two digits."""
    return f"{cell.progress:.2f}"


def cell_text(cell: Cell | None) -> str:
    """A cell of the paper's table, `44.0 (0.63)`; a dash where there is none."""
    return f"{rate_text(cell)} ({progress_text(cell)})" if cell else "–"


def interval_text(interval: tuple[float, float]) -> str:
    """An interval of rates in percent."""
    return "–".join(f"{100 * end:.1f}" for end in interval)


def points_text(difference: float) -> str:
    """A difference of rates in percentage points, with its sign."""
    return signed(100 * difference, 1)


def points_interval_text(interval: tuple[float, float]) -> str:
    """An interval of a difference in percentage points."""
    return " to ".join(points_text(end) for end in interval)


def signed(value: float, digits: int) -> str:
    """A number with its sign, a real minus; what rounds to 0 has none."""
    text = f"{abs(value):.{digits}f}"
    if float(text) == 0:
        return text
    return f"{'+' if value > 0 else MINUS}{text}"


def p_text(p: float) -> str:
    """A p-value with three digits."""
    return f"< {_SMALLEST}" if p < _SMALLEST else f"{p:.3f}"


def p_phrase(p: float) -> str:
    """A p-value in a sentence: `p = 0.012` or `p < 0.001`."""
    text = p_text(p)
    return f"p {text}" if text.startswith("<") else f"p = {text}"


def about(number: int) -> str:
    """A rough number: two digits of it, rounded up, with commas."""
    size = 10 ** max(0, len(str(number)) - 2)
    return f"{-(-number // size) * size:,}"


def listed(names: Sequence[str], conjunction: str = "and") -> str:
    """Names in a row of words."""
    *first, last = names
    return f"{', '.join(first)} {conjunction} {last}" if first else last
