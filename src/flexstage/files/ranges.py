"""What numbers and words of a description may be, said in the types of its fields."""

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
    """Numbers that a field may hold: ``Annotated[float, Range(low=0.0)]``; all are finite."""

    low: float = -math.inf
    """The lowest."""
    high: float = math.inf
    """The highest."""
    above: bool = False
    """Whether the lowest itself is left out."""
    below: bool = False
    """Whether the highest itself is left out."""
    remark: str = ""
    """What else a message says, such as what holds where the field is not given."""

    @property
    def is_share(self) -> bool:
        """Whether its numbers are shares of a whole, which may be written in per cent."""
        return self.low >= 0.0 and self.high <= 1.0

    def holds(self, value: float) -> bool:
        """Say whether a number is in it."""
        low = self.low < value if self.above else self.low <= value
        high = value < self.high if self.below else value <= self.high
        # a whole number may be too large for a float
        return low and high and (isinstance(value, int) or math.isfinite(value))

    def text(self, *, whole: bool) -> str:
        """Say what it holds, in whole numbers or in any."""
        if whole:
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
#: A share of a whole, such as a confidence, that is neither none nor all of it.
INNER_SHARE = Range(low=0.0, high=1.0, above=True, below=True)

#: A length of a part [m].
Size = Annotated[Length, POSITIVE]
#: A share of a whole [1].
Share = Annotated[float, Range(low=0.0, high=1.0)]
#: How many, one at least.
Count = Annotated[int, Range(low=1, high=1e6)]
#: How many, or none.
Whole = Annotated[int, Range(low=0, high=1e6)]
#: Seed of random numbers.
Seed = Annotated[int, Range(low=0)]


@dataclass(frozen=True, slots=True)
class Written:
    """How a value of a field is written on a command line: ``Annotated[str, Written("NAME")]``."""

    metavar: str = ""
    """What its value is called in the help."""
    bare: str | None = None
    """The unit of a number without one; None where a unit is needed."""
    commas: bool = False
    """Whether several values stand in one text with commas between, and not one an option."""
    help: str = ""
    """What the help says behind the text of each such field."""
    read: Callable[[str], Any] | None = None
    """Reads a value that is no number and no word."""
    write: Callable[[Any], str] = str
    """Writes such a value so that it is read back."""


#: A frequency above 0 [Hz]; a bare number is in hertz.
PositiveFrequency = Annotated[Frequency, POSITIVE, Written(bare="Hz")]


class Stated:
    """Base of what a text states and a program may give as it is, such as bounds of a parameter."""

    __slots__ = ()


def written_as(kind: Any) -> Written | None:
    """Return how values of a type are written, where it says so."""
    extras = typing.get_args(kind)[1:] if typing.get_origin(kind) is Annotated else ()
    return next((e for e in reversed(extras) if isinstance(e, Written)), None)  # the outermost


@lru_cache(maxsize=1024)
def range_of(kind: Any) -> tuple[Range, bool] | None:
    """Return the range of a type, with whether its numbers are whole; None where it has none."""
    if typing.get_origin(kind) is not Annotated:
        return None
    bare, *extras = typing.get_args(kind)
    found = next((e for e in extras if isinstance(e, Range)), None)
    return None if found is None else (found, bare is int)


def wanted(kind: Any, value: Any) -> str:
    """Say what a value of a type must be that it is not; nothing where all is well."""
    check = _check_of(kind)
    return "" if check is None else check(value)


# hashes of types take longer than the checks themselves: one look-up a type, or a class
@lru_cache(maxsize=1024)
def _check_of(kind: Any) -> Callable[[Any], str] | None:
    """Return what says what a value of a type must be; None where it may be anything."""
    if (inner := optional_part(kind)) is not None:
        given = _check_of(inner)
        return None if given is None else lambda value: "" if value is None else given(value)
    bare = typing.get_args(kind)[0] if typing.get_origin(kind) is Annotated else None
    if typing.get_origin(bare) in (tuple, Literal) and (each := _check_of(bare)) is not None:
        return each
    if typing.get_origin(kind) is tuple:
        part = _check_of(typing.get_args(kind)[0])
        if part is None:
            return None
        return lambda values: next((said for v in values if (said := part(v))), "")
    if typing.get_origin(kind) is Literal:
        words = typing.get_args(kind)
        return lambda value: "" if value in words else f"one of {', '.join(words)}"
    if (found := range_of(kind)) is None:
        return None
    range_, whole = found

    def check(value: Any) -> str:
        numbers = value if isinstance(value, tuple) else (value,)
        held = all(
            isinstance(n, (int, float)) and range_.holds(n) and (not whole or n == int(n))
            for n in numbers
        )
        return "" if held else range_.text(whole=whole)

    return check


@lru_cache(maxsize=512)
def _checks_of(cls: type) -> tuple[tuple[str, Callable[[Any], str], bool], ...]:
    """Return the fields of a class that are checked, how, and whether their numbers are whole."""
    made = []
    for name, (_, kind) in field_types(cls).items():
        found = range_of(optional_part(kind) or kind)
        if (check := _check_of(kind)) is not None:
            made.append((name, check, found is not None and found[1]))
    return tuple(made)


def require_ranges(thing: Any, error: type[FlexstageError], of: str) -> None:
    """Refuse a description whose numbers and words are not what its types say; `of` says whose.

    A whole number that was given as 3.0 becomes 3.
    """
    for name, check, whole in _checks_of(type(thing)):
        value = getattr(thing, name)
        if said := check(value):
            raise error(f"{name} of {of} must be {said}, got {_show(value)}")
        if whole and isinstance(value, float):
            object.__setattr__(thing, name, int(value))


def _show(value: Any) -> str:
    if isinstance(value, str):
        return f"'{value}'"
    return f"{value:g}" if isinstance(value, (int, float)) else repr(value)
