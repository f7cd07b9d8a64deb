"""Ranges of numbers and choices of words, declared in the types of fields."""

import math
import typing
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, Literal

from flexstage.base.errors import FlexstageError
from flexstage.files.format import field_types, optional_part
from flexstage.quantities.units import Frequency, Length


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Allowed numbers of a field: ``Annotated[float, Range(low=0.0)]``; all are finite."""

    low: float = -math.inf
    """Lowest value."""
    high: float = math.inf
    """Highest value."""
    above: bool = False
    """The lowest value is excluded."""
    below: bool = False
    """The highest value is excluded."""
    remark: str = ""
    """Remark in messages, such as the default."""

    @property
    def is_share(self) -> bool:
        """True if its numbers are shares, which may be written in per cent."""
        return self.low >= 0.0 and self.high <= 1.0

    def holds(self, value: float) -> bool:
        """Return whether a number is in the range."""
        low = self.low < value if self.above else self.low <= value
        high = value < self.high if self.below else value <= self.high
        # a whole number may be too large for a float
        return low and high and (isinstance(value, int) or math.isfinite(value))

    def text(self, *, integer: bool) -> str:
        """Return the range in words, of whole numbers or of any."""
        if integer:
            upper = f" to {self.high:.0f}" if math.isfinite(self.high) else ""
            remark = f" ({self.remark})" if self.remark else ""
            return f"a whole number from {self.low:.0f}{upper}{remark}"
        if not math.isfinite(self.high):
            if not math.isfinite(self.low):
                return "finite"
            return f"{'above' if self.above else 'not below'} {self.low:g}"
        if self.above and self.below:
            return f"between {self.low:g} and {self.high:g}"
        if self.above:
            return f"above {self.low:g}, up to {self.high:g}"
        return f"from {self.low:g} {'to below' if self.below else 'to'} {self.high:g}"


#: Finite, above 0.
POSITIVE = Range(low=0.0, above=True)
#: Finite, 0 or more.
NOT_NEGATIVE = Range(low=0.0)
#: A share between 0 and 1, such as a confidence.
INNER_SHARE = Range(low=0.0, high=1.0, above=True, below=True)

#: A length of a part [m].
Size = Annotated[Length, POSITIVE]
#: A share from 0 to 1 [1].
Share = Annotated[float, Range(low=0.0, high=1.0)]
#: A number of things, at least 1.
Count = Annotated[int, Range(low=1, high=1e6)]
#: A number of things, 0 or more.
CountOrZero = Annotated[int, Range(low=0, high=1e6)]
#: Seed of random numbers.
Seed = Annotated[int, Range(low=0)]


@dataclass(frozen=True, slots=True)
class Written:
    """Form of a value on a command line: ``Annotated[str, Written("NAME")]``."""

    metavar: str = ""
    """Placeholder of the value in the help."""
    bare: str | None = None
    """Unit of a bare number; None where a unit is required."""
    commas: bool = False
    """Several values are one text separated by commas, not repeated options."""
    help: str = ""
    """Addition to the help of each such field."""
    read: Callable[[str], Any] | None = None
    """Reads a value that is neither a number nor a word."""
    write: Callable[[Any], str] = str
    """Writes such a value so that `read` returns it."""


#: A frequency above 0 [Hz]; a bare number is in hertz.
PositiveFrequency = Annotated[Frequency, POSITIVE, Written(bare="Hz")]


class Stated:
    """Base of values that a text or a program may give, such as bounds of a parameter."""

    __slots__ = ()


def written_as(kind: Any) -> Written | None:
    """Return the form of values of a type; None where it has none."""
    extras = typing.get_args(kind)[1:] if typing.get_origin(kind) is Annotated else ()
    return next((e for e in reversed(extras) if isinstance(e, Written)), None)  # the outermost


@lru_cache(maxsize=1024)
def range_of(kind: Any) -> tuple[Range, bool] | None:
    """Return the range of a type and whether its numbers are whole; None where it has none."""
    if typing.get_origin(kind) is not Annotated:
        return None
    bare, *extras = typing.get_args(kind)
    bounds = next((e for e in extras if isinstance(e, Range)), None)
    return None if bounds is None else (bounds, bare is int)


def fault_of(kind: Any, value: Any) -> str:
    """Return the requirement of a type that a value violates; empty for a valid value."""
    check = _check_of(kind)
    return "" if check is None else check(value)


# hashing types takes longer than the checks: one look-up per type or class
@lru_cache(maxsize=1024)
def _check_of(kind: Any) -> Callable[[Any], str] | None:
    """Return the check of values of a type; None where any value is valid."""
    if (inner := optional_part(kind)) is not None:
        inner_check = _check_of(inner)
        return (
            None
            if inner_check is None
            else lambda value: "" if value is None else inner_check(value)
        )
    bare = typing.get_args(kind)[0] if typing.get_origin(kind) is Annotated else None
    if typing.get_origin(bare) in (tuple, Literal) and (each := _check_of(bare)) is not None:
        return each
    if typing.get_origin(kind) is tuple:
        part = _check_of(typing.get_args(kind)[0])
        if part is None:
            return None
        return lambda values: next((fault for v in values if (fault := part(v))), "")
    if typing.get_origin(kind) is Literal:
        words = typing.get_args(kind)
        return lambda value: "" if value in words else f"one of {', '.join(words)}"
    if (bounds := range_of(kind)) is None:
        return None
    range_, integer = bounds

    def check(value: Any) -> str:
        numbers = value if isinstance(value, tuple) else (value,)
        inside = all(
            isinstance(n, (int, float)) and range_.holds(n) and (not integer or n == int(n))
            for n in numbers
        )
        return "" if inside else range_.text(integer=integer)

    return check


@lru_cache(maxsize=512)
def _checks_of(cls: type) -> tuple[tuple[str, Callable[[Any], str], bool], ...]:
    """Return name and check of the fields of a class, and whether their numbers are whole."""
    checks = []
    for name, (_, kind) in field_types(cls).items():
        bounds = range_of(optional_part(kind) or kind)
        if (check := _check_of(kind)) is not None:
            checks.append((name, check, bounds is not None and bounds[1]))
    return tuple(checks)


def require_ranges(thing: Any, error: type[FlexstageError], of: str) -> None:
    """Refuse a description whose numbers or words violate its types; `of` is its noun.

    A whole number such as 3.0 becomes 3.
    """
    for name, check, integer in _checks_of(type(thing)):
        value = getattr(thing, name)
        if fault := check(value):
            raise error(f"{name} of {of} must be {fault}, got {_show(value)}")
        if integer and isinstance(value, float):
            object.__setattr__(thing, name, int(value))


def _show(value: Any) -> str:
    if isinstance(value, str):
        return f"'{value}'"
    return f"{value:g}" if isinstance(value, (int, float)) else repr(value)
