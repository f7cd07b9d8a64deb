"""Requests: the options of a job as one frozen dataclass, from which every form of it is made.

The name of a field is that of its option and key, its annotation determines valid values and their
form, the text below it is the help. A field that is a request itself is a group of options.
"""

import math
import re
import shlex
import sys
import typing
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from flexstage.base.choose import did_you_mean, unknown
from flexstage.base.errors import FlexstageError, ModelError, UnitError
from flexstage.files.format import dimension_of, field_types, optional_part
from flexstage.files.ranges import Range, Stated, Written, fault_of, range_of, written_as
from flexstage.quantities.units import DIMENSIONS, Dimension, parse, readable_text


@dataclass(frozen=True, kw_only=True)
class Request:
    """Base of requests; a new request is checked against the types of its fields."""

    heading: ClassVar[str] = ""
    """Heading of its options in the help of a command; empty for the common heading."""
    refused_as: ClassVar[type[FlexstageError]] = ModelError
    """Error of an invalid value."""
    one_value: ClassVar[bool] = False
    """As part of another request it is one option: --of a=1,b=2."""

    def __post_init__(self) -> None:
        require_fields(self, type(self), self.refused_as)

    @classmethod
    def job(cls) -> str:
        """Return the name of its command: "sweep" for a `SweepRequest`."""
        return cls.__name__.removesuffix("Request").lower()


RequestT = TypeVar("RequestT", bound=Request)


def require_fields(
    thing: Any, kind: type[Request], error: type[FlexstageError], of: str = ""
) -> None:
    """Refuse an object with the fields of a request and invalid values; `of` is its noun.

    A whole number such as 3.0 becomes 3.
    """
    for name, field in request_fields(kind).items():
        value = getattr(thing, name)
        if fault := field.fault(value):
            raise error(f"{name}{of} must be {fault}, got {field.in_words(value)}")
        if field.value is int and isinstance(value, float):
            object.__setattr__(thing, name, int(value))


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestField:
    """A field of a request, for options, forms and command lines."""

    name: str
    """Name."""
    kind: Any
    """Type."""
    value: Any
    """Type of one value, without range and form."""
    many: bool
    """Any number of values."""
    pair: bool
    """The two ends of a range."""
    default: Any
    """Default value; `dataclasses.MISSING` for a required field."""
    words: tuple[str, ...]
    """Words of a choice; none for other fields."""
    dimension: Dimension | None
    """Dimension of its number."""
    range: Range | None
    """Range of its number."""
    written: Written
    """Form of a value."""

    @property
    def option(self) -> str:
        """Option of commands: ``--name``."""
        return f"--{self.name.strip('_').replace('_', '-')}"

    @property
    def label(self) -> str:
        """Label in a form."""
        return self.name.replace("_", " ").capitalize()

    @property
    def repeated(self) -> bool:
        """True if its option is repeated for several values."""
        return self.many and not self.written.commas

    @property
    def holds_tuple(self) -> bool:
        """True if its value is a tuple."""
        annotated = typing.get_origin(self.kind) is Annotated
        bare = typing.get_args(self.kind)[0] if annotated else self.kind
        return typing.get_origin(bare) is tuple

    @property
    def metavar(self) -> str:
        """Placeholder of the value in the help."""
        if self.pair and not self.written.metavar:
            return "LOW:HIGH"
        if self.written.metavar or self.words:
            return self.written.metavar or "|".join(self.words)
        if self.dimension is not None:
            return self.dimension.name.upper()
        return {float: "NUMBER", int: "NUMBER", Path: "FILE"}.get(self.value, "TEXT")

    def read(self, text: str) -> Any:
        """Return the value of a text.

        Raises
        ------
        UnitError, ModelError
            The text is not a valid value of the field.
        """
        if self.many and self.written.commas:
            values = tuple(self._one(word.strip()) for word in text.split(",") if word.strip())
            if not values:
                among = f" of {', '.join(self.words)}" if self.words else ""
                raise ModelError(f"must name at least one{among}, got '{text[:40]}'")
            return values
        return self._ends(text) if self.pair else self._one(text)

    def fault(self, value: Any) -> str:
        """Return the requirement that a value violates; empty for a valid value."""
        if value is None:
            return "" if self.default is None else "given"
        if self.value is bool:
            return "" if isinstance(value, bool) else "true or false"
        if self.written.read is not None:
            if value == self.default:
                return ""
            try:
                self.written.write(value)
            except (TypeError, ValueError, AttributeError):
                return f"a valid {self.metavar} of {self.option}"
            return fault_of(self.kind, value)
        if self.pair:
            if not isinstance(value, tuple) or len(value) != 2:
                return "two ends of a range"
            alone = "[" in self.metavar  # both ends may be equal
            if fault := next(filter(None, map(self._fault, value)), ""):
                return fault
            return (
                "" if value[0] < value[1] or (alone and value[0] == value[1]) else "a rising range"
            )
        if self.many:
            if not isinstance(value, tuple):
                return "a tuple of values"
            return next(filter(None, map(self._fault, value)), "")
        return self._fault(value)

    def _fault(self, value: Any) -> str:
        if self.words:
            return "" if value in self.words else f"one of {', '.join(self.words)}"
        if self.value not in (float, int):
            texts = self.value is str or self.value == str | Stated
            return "a text" if texts and not isinstance(value, self.value) else ""
        integer = self.value is int
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return self._noun
        if isinstance(value, float) and math.isnan(value):
            return self._noun
        if not integer and not abs(value) <= sys.float_info.max and not isinstance(value, float):
            return "a number within the range of a float"
        if integer and abs(value) < math.inf and value != int(value):
            return self._noun if self.range is None else self.range.text(integer=True)
        return "" if self.range is None or self.range.holds(value) else self.allowed

    @property
    def allowed(self) -> str:
        """Range of its numbers in words."""
        assert self.range is not None
        unit = "" if self.dimension is None else f" {self.dimension.si}"
        return f"{self.range.text(integer=self.value is int)}{unit}"

    def in_words(self, value: Any) -> str:
        """Return a value in words, valid or not."""
        try:
            return ", ".join(self.texts(value))
        except (TypeError, ValueError, AttributeError, OverflowError):
            return repr(value)[:60]

    def _ends(self, text: str) -> tuple[Any, Any]:
        """Return both ends of a range; a single value is both where the help has brackets."""
        ends = [self._one(word.strip()) for word in re.split(r":|\.\.", text)]
        alone = len(ends) == 1 and "[" in self.metavar
        ends *= 2 if alone else 1
        if len(ends) != 2 or not (ends[0] < ends[1] or alone):
            unit = "" if self.dimension is None else f" {self.dimension.units[0]}"
            example = f'must be a range {self.metavar}, such as "10{unit}:20{unit}"'
            raise ModelError(f"{'must rise' if len(ends) == 2 else example}, got '{text[:40]}'")
        return ends[0], ends[1]

    def _one(self, text: str) -> Any:
        if self.written.read is not None:
            value = self.written.read(text)
            if fault := fault_of(self.kind, value):
                raise ModelError(f"must be {fault}, got '{text[:40]}'")
            return value
        if self.words:
            if text not in self.words:
                raise ModelError(
                    f"must be {', '.join(self.words[:-1])} or {self.words[-1]}, got "
                    f"'{text[:40]}'{did_you_mean(text, self.words)}"
                )
            return text
        if self.value is bool:
            if text not in ("yes", "no"):
                raise ModelError(f"must be yes or no, got '{text[:40]}'")
            return text == "yes"
        if self.value is Path:
            return Path(text)
        if self.value not in (float, int):
            return text
        value: float
        if self.dimension is not None:
            value = parse(text, self.dimension.name, bare_unit=self.written.bare)
        else:
            value = read_number(text, self._noun)
        if self.range is not None and not self.range.holds(value):
            percent = self.is_share and 1.0 < value <= 100.0 and not text.strip().endswith("%")
            hint = f'; write "{value:g} %"' if percent else ""
            raise ModelError(f"must be {self.allowed}, got '{text}'{hint}")
        return value

    @property
    def is_share(self) -> bool:
        """True if it is a share."""
        return self.range is not None and self.range.is_share

    @property
    def _noun(self) -> str:
        if self.value is int:
            return "a whole number"
        return 'a share, such as "1.2 %" or 0.012' if self.is_share else "a number"

    def texts(self, value: Any) -> list[str]:
        """Return the texts of a value, each of which `read` accepts."""
        values = value if self.many or self.pair else (value,)
        texts = [self._text(one) for one in values]
        if self.pair:
            return [":".join(texts)]
        return [",".join(texts)] if self.many and self.written.commas else texts

    def _text(self, value: Any) -> str:
        if self.written.read is not None:
            return self.written.write(value)
        if self.value is bool:
            return "yes" if value else "no"
        if isinstance(value, (str, Path)):
            return str(value)
        dimension = self.dimension
        if dimension is None or not abs(value) < math.inf:
            return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)
        if dimension.name not in DIMENSIONS:  # that of a column, in its own unit
            return f"{float(value)!r} {dimension.si}"
        return readable_text(value, dimension.name)


@lru_cache(maxsize=256)
def request_fields(cls: type[Request]) -> Mapping[str, RequestField]:
    """Return the fields of a request with values, by their names.

    Fields that are not compared control the computation and are not part of a command line.
    """
    return {
        name: _field(name, declared, kind)
        for name, (declared, kind) in field_types(cls).items()
        if declared.compare and (not is_request(kind) or kind.one_value)
    }


def request_groups(cls: type[Request]) -> tuple[tuple[str, type[Request]], ...]:
    """Return the fields of a request that are groups of options, with their types."""
    return tuple(
        (name, kind)
        for name, (_, kind) in field_types(cls).items()
        if is_request(kind) and not kind.one_value
    )


def is_request(kind: Any) -> bool:
    """Return whether a type is a request."""
    return isinstance(kind, type) and issubclass(kind, Request)


def _field(name: str, declared: Any, kind: Any) -> RequestField:
    written_form, bounds, dimension, many, pair = None, None, None, False, False
    kind = annotated = optional_part(kind) or kind
    if is_request(kind):
        written_form = Written("NAME=VALUE,...", read=partial(_read_parts, kind), write=_parts_text)
    while True:
        written_form = written_form or written_as(kind)  # of the outermost type
        written = written_form or Written()
        if (field_range := range_of(kind)) is not None:
            bounds = field_range[0]
        if (quantity := dimension_of(kind)) is not None:
            dimension = quantity[0]
        if is_request(kind):
            break
        if written.read is not None and typing.get_origin(kind) is not tuple:
            kind = str
            break
        if typing.get_origin(kind) is Annotated:
            kind = typing.get_args(kind)[0]
        elif typing.get_origin(kind) is tuple:
            inner = typing.get_args(kind)
            kind, many, pair = inner[0], inner[-1] is Ellipsis, inner[-1] is not Ellipsis
        else:
            break
    default = declared.default
    if default is MISSING and declared.default_factory is not MISSING:
        default = declared.default_factory()
    return RequestField(
        name=name,
        kind=annotated,
        value=kind,
        many=many,
        pair=pair,
        default=default,
        words=typing.get_args(kind) if typing.get_origin(kind) is Literal else (),
        dimension=dimension,
        range=bounds,
        written=written,
    )


def _read_parts(kind: type[Request], text: str) -> Request:
    """Return the request of a text such as "a=1,b=2", whose values may have commas."""
    fields, values = request_fields(kind), {}
    for part in re.split(r",\s*(?=[a-z][a-z_-]*\s*=)", text) if text.strip() else ():
        name, equals, value = part.partition("=")
        name = name.strip().replace("-", "_")
        if not equals:
            raise kind.refused_as(f"must be NAME=VALUE of {', '.join(fields)}, got '{part[:40]}'")
        if name not in fields:
            raise kind.refused_as(unknown("name", name, fields))
        try:
            part_value = fields[name].read(value.strip())
        except FlexstageError as error:
            raise kind.refused_as(f"{name} {error}") from None
        values[name] = (part_value,) if fields[name].repeated else part_value
    return kind(**values)


def _parts_text(request: Request) -> str:
    """Return the text of a request that is one value."""
    fields = request_fields(type(request)).values()
    values = ((field, getattr(request, field.name)) for field in fields)
    return ",".join(
        f"{field.name}={','.join(field.texts(value))}"
        for field, value in values
        if value != field.default and value is not None
    )


def request_of(
    kind: type[RequestT], request: RequestT | None, changes: Mapping[str, Any]
) -> RequestT:
    """Return a request with named fields replaced; without a request, with other fields default.

    A text is parsed like that of an option; a field of several values accepts a single one.
    """
    fields = request_fields(kind)
    groups = [name for name, _ in request_groups(kind)]
    for name in changes:
        if name not in fields and name not in groups:
            raise kind.refused_as(unknown("option", name, [*fields, *groups]))
    values = {n: _field_value(kind, fields[n], v) if n in fields else v for n, v in changes.items()}
    return kind(**values) if request is None else replace(request, **values)


def _field_value(kind: type[Request], field: RequestField, value: Any) -> Any:
    """Return the value of a field from a program: as it is, or the text of an option."""
    if value is None:
        return field.default if field.default is not MISSING else None
    plain = field.repeated or field.value is bool or (field.words and not field.written.commas)
    if isinstance(value, str) and not plain:
        try:
            return field.read(value)
        except FlexstageError as error:
            raise kind.refused_as(f"{field.name}: {error}") from None
    if isinstance(value, Mapping) and is_request(field.kind):
        return request_of(field.kind, None, value)
    if not field.holds_tuple:
        return value
    if isinstance(value, Mapping):
        return tuple(f"{name}={text}" for name, text in value.items())
    several = isinstance(value, Iterable) and not isinstance(value, str)
    return tuple(value) if several else (value,)


def option_words(request: Request) -> list[str]:
    """Return the options of a command line for a request.

    Examples
    --------
    >>> from flexstage.studies.explore.requests import SweepRequest
    >>> option_words(SweepRequest(over=("neck=0.3..0.8 mm",), samples=40))
    ['--over', 'neck=0.3..0.8 mm', '--samples', '40']
    """
    return list(_option_words(request))


def command_line(request: Request, *subject: str) -> str:
    """Return the command line of a request on a subject, quoted for a shell.

    Examples
    --------
    >>> from flexstage.studies.explore.requests import SweepRequest
    >>> command_line(SweepRequest(over=("leg_spacing=30 %",)), "parallelogram")
    "flexstage sweep parallelogram --over 'leg_spacing=30 %'"
    """
    return shlex.join(["flexstage", request.job(), *subject, *option_words(request)])


def recorded(request: Request) -> dict[str, Any]:
    """Return the fields without their defaults as plain data, in SI units.

    Examples
    --------
    >>> from flexstage.studies.explore.requests import SweepRequest
    >>> recorded(SweepRequest(over=("neck=0.3..0.8 mm",), samples=40))
    {'over': ['neck=0.3..0.8 mm'], 'samples': 40}
    """
    data = {field.name: _recorded(field, value) for field, value in _unusual(request)}
    groups = {name: recorded(getattr(request, name)) for name, _ in request_groups(type(request))}
    return data | {name: group for name, group in groups.items() if group}


def _recorded(field: RequestField, value: Any) -> Any:
    if isinstance(value, tuple):
        return [_recorded(field, one) for one in value]
    if isinstance(value, Request):
        return recorded(value)
    if isinstance(value, Path):
        return value.as_posix()
    if value is None or isinstance(value, (str, int)):
        return value
    finite = isinstance(value, float) and math.isfinite(value)
    return value if finite else field._text(value)


def _unusual(request: Request) -> Iterator[tuple[RequestField, Any]]:
    """Yield the fields whose values differ from their defaults, with these values."""
    for field in request_fields(type(request)).values():
        value = getattr(request, field.name)
        if value != field.default and value is not None:
            yield field, value


def _option_words(request: Request) -> Iterator[str]:
    for field, value in _unusual(request):
        if field.value is bool:
            yield field.option if value else f"--no-{field.option[2:]}"
            continue
        for text in field.texts(value):
            yield from (field.option, text)
    for name, _ in request_groups(type(request)):
        yield from _option_words(getattr(request, name))


def read_number(text: str, noun: str) -> float:
    """Return the number of a text, which may be in per cent unless it must be whole."""
    integer = noun == "a whole number"
    share = text.strip().endswith("%") and not integer
    try:
        value = int(text) if integer else float(text.strip().removesuffix("%"))
    except ValueError:
        raise UnitError(f"expected {noun}, got '{text[:40]}'") from None
    if isinstance(value, float) and not math.isfinite(value):
        raise UnitError(f"expected {noun} that is finite, got '{text[:40]}'")
    return value / 100.0 if share else value
