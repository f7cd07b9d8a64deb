"""What is asked of a job, said once: a frozen dataclass from whose fields every form of it comes.

The name of a field is that of its option and key, its annotation says what a value may be and how
it is written, the text below it is the help. A field that is a request itself is a group of them.
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
from flexstage.files.ranges import Range, Stated, Written, range_of, wanted, written_as
from flexstage.quantities.units import DIMENSIONS, Dimension, parse, readable_text


@dataclass(frozen=True, kw_only=True)
class Request:
    """Base of requests: what the types of the fields say is checked when one is made."""

    heading: ClassVar[str] = ""
    """Heading of its options in the help of a command; that of all options where empty."""
    refused_as: ClassVar[type[FlexstageError]] = ModelError
    """What is raised where a value is not what its field may hold."""
    one_value: ClassVar[bool] = False
    """Whether one option stands for all of it where it is part of another: --of a=1,b=2."""

    def __post_init__(self) -> None:
        require_fields(self, type(self), self.refused_as)

    @classmethod
    def job(cls) -> str:
        """Return the command that carries it out: "sweep" of a `SweepRequest`."""
        return cls.__name__.removesuffix("Request").lower()


Asked = TypeVar("Asked", bound=Request)


def require_fields(
    thing: Any, kind: type[Request], error: type[FlexstageError], of: str = ""
) -> None:
    """Refuse what has the fields of a request, but not values that they can hold; `of` says whose.

    A whole number that was given as 3.0 becomes 3.
    """
    for name, field in request_fields(kind).items():
        value = getattr(thing, name)
        if said := field.fault(value):
            raise error(f"{name}{of} must be {said}, got {field.shown(value)}")
        if field.value is int and isinstance(value, float):
            object.__setattr__(thing, name, int(value))


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestField:
    """A field of a request, as options, forms and command lines need it."""

    name: str
    """Its name."""
    kind: Any
    """Its type."""
    value: Any
    """Type of one value, without range and spelling."""
    many: bool
    """Whether it holds any number of values."""
    pair: bool
    """Whether it holds the two ends of a range."""
    default: Any
    """What it is where nothing is asked; `dataclasses.MISSING` where it must be given."""
    words: tuple[str, ...]
    """The words that it can be; none where it is no choice of words."""
    dimension: Dimension | None
    """Dimension of its number."""
    range: Range | None
    """Range of its number."""
    written: Written
    """How a value is written."""

    @property
    def option(self) -> str:
        """The option of commands: ``--name``."""
        return f"--{self.name.strip('_').replace('_', '-')}"

    @property
    def label(self) -> str:
        """Its name in a form."""
        return self.name.replace("_", " ").capitalize()

    @property
    def repeated(self) -> bool:
        """Whether its option is given once for each value."""
        return self.many and not self.written.commas

    @property
    def holds_tuple(self) -> bool:
        """Whether its value is a tuple."""
        annotated = typing.get_origin(self.kind) is Annotated
        bare = typing.get_args(self.kind)[0] if annotated else self.kind
        return typing.get_origin(bare) is tuple

    @property
    def metavar(self) -> str:
        """What its value is called in the help."""
        if self.pair and not self.written.metavar:
            return "LOW:HIGH"
        if self.written.metavar or self.words:
            return self.written.metavar or "|".join(self.words)
        if self.dimension is not None:
            return self.dimension.name.upper()
        return {float: "NUMBER", int: "NUMBER", Path: "FILE"}.get(self.value, "TEXT")

    def read(self, text: str) -> Any:
        """Return the value that a text says; refuse what the field cannot hold.

        Raises
        ------
        UnitError, ModelError
            It is none.
        """
        if self.many and self.written.commas:
            found = tuple(self._one(word.strip()) for word in text.split(",") if word.strip())
            if not found:
                among = f" of {', '.join(self.words)}" if self.words else ""
                raise ModelError(f"must name one at least{among}, got '{text[:40]}'")
            return found
        return self._ends(text) if self.pair else self._one(text)

    def fault(self, value: Any) -> str:
        """Say what a value must be that it is not; nothing where it is one of the field."""
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
                return f"what {self.metavar} of {self.option} may be"
            return wanted(self.kind, value)
        if self.pair:
            if not isinstance(value, tuple) or len(value) != 2:
                return "two ends of a range"
            alone = "[" in self.metavar  # whose ends may be one
            if said := next(filter(None, map(self._fault, value)), ""):
                return said
            return (
                ""
                if value[0] < value[1] or (alone and value[0] == value[1])
                else "a range that rises"
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
        whole = self.value is int
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return self._noun
        if isinstance(value, float) and math.isnan(value):
            return self._noun
        if not whole and not abs(value) <= sys.float_info.max and not isinstance(value, float):
            return "a number that a float can be"
        if whole and abs(value) < math.inf and value != int(value):
            return self._noun if self.range is None else self.range.text(whole=True)
        return "" if self.range is None or self.range.holds(value) else self.allowed

    @property
    def allowed(self) -> str:
        """The range of its numbers in words."""
        assert self.range is not None
        unit = "" if self.dimension is None else f" {self.dimension.si}"
        return f"{self.range.text(whole=self.value is int)}{unit}"

    def shown(self, value: Any) -> str:
        """Return a value in words, whether it is one of the field or not."""
        try:
            return ", ".join(self.texts(value))
        except (TypeError, ValueError, AttributeError, OverflowError):
            return repr(value)[:60]

    def _ends(self, text: str) -> tuple[Any, Any]:
        """Return both ends of a range; one alone is both where the help says so."""
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
            if said := wanted(self.kind, value):
                raise ModelError(f"must be {said}, got '{text[:40]}'")
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
        """Whether it is a share of a whole."""
        return self.range is not None and self.range.is_share

    @property
    def _noun(self) -> str:
        if self.value is int:
            return "a whole number"
        return 'a share, such as "1.2 %" or 0.012' if self.is_share else "a number"

    def texts(self, value: Any) -> list[str]:
        """Return the texts of a value, each of which `read` understands."""
        values = value if self.many or self.pair else (value,)
        written = [self._text(one) for one in values]
        if self.pair:
            return [":".join(written)]
        return [",".join(written)] if self.many and self.written.commas else written

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
    """Return the fields of a request that hold values, by their names.

    One that is not compared says how the work is done, which no command line asks for.
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
    """Say whether a type is that of a request."""
    return isinstance(kind, type) and issubclass(kind, Request)


def _field(name: str, declared: Any, kind: Any) -> RequestField:
    own, bounds, dimension, many, pair = None, None, None, False, False
    kind = whole = optional_part(kind) or kind
    if is_request(kind):
        own = Written("NAME=VALUE,...", read=partial(_read_parts, kind), write=_parts_text)
    while True:
        own = own or written_as(kind)  # the outermost
        written = own or Written()
        if (found := range_of(kind)) is not None:
            bounds = found[0]
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
        kind=whole,
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
    """Return the request of a text such as "a=1,b=2"; a comma within a value is part of it."""
    known, values = request_fields(kind), {}
    for part in re.split(r",\s*(?=[a-z][a-z_-]*\s*=)", text) if text.strip() else ():
        name, equals, value = part.partition("=")
        name = name.strip().replace("-", "_")
        if not equals:
            raise kind.refused_as(f"must be NAME=VALUE of {', '.join(known)}, got '{part[:40]}'")
        if name not in known:
            raise kind.refused_as(unknown("name", name, known))
        try:
            found = known[name].read(value.strip())
        except FlexstageError as error:
            raise kind.refused_as(f"{name} {error}") from None
        values[name] = (found,) if known[name].repeated else found
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


def request_of(kind: type[Asked], given: Asked | None, named: Mapping[str, Any]) -> Asked:
    """Return a request with the fields that are named in place of its own, or the usual ones.

    A text is read as that of an option; where there may be several values, one will do.
    """
    known = request_fields(kind)
    groups = [name for name, _ in request_groups(kind)]
    for name in named:
        if name not in known and name not in groups:
            raise kind.refused_as(unknown("option", name, [*known, *groups]))
    values = {n: _given(kind, known[n], v) if n in known else v for n, v in named.items()}
    return kind(**values) if given is None else replace(given, **values)


def _given(kind: type[Request], field: RequestField, value: Any) -> Any:
    """Return the value of a field that a program gives: as it is, or as the text of an option."""
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
    """Return the words of a command line that ask for the same as a request.

    Examples
    --------
    >>> from flexstage.studies.explore.requests import SweepRequest
    >>> option_words(SweepRequest(over=("neck=0.3..0.8 mm",), samples=40))
    ['--over', 'neck=0.3..0.8 mm', '--samples', '40']
    """
    return list(_option_words(request))


def command_line(request: Request, *subject: str) -> str:
    """Return the command line that asks for the same about a subject, as a shell takes it.

    Examples
    --------
    >>> from flexstage.studies.explore.requests import SweepRequest
    >>> command_line(SweepRequest(over=("leg_spacing=30 %",)), "parallelogram")
    "flexstage sweep parallelogram --over 'leg_spacing=30 %'"
    """
    return shlex.join(["flexstage", request.job(), *subject, *option_words(request)])


def recorded(request: Request) -> dict[str, Any]:
    """Return what is asked beyond the usual as plain data: values in SI by the names of fields.

    Examples
    --------
    >>> from flexstage.studies.explore.requests import SweepRequest
    >>> recorded(SweepRequest(over=("neck=0.3..0.8 mm",), samples=40))
    {'over': ['neck=0.3..0.8 mm'], 'samples': 40}
    """
    said = {field.name: _recorded(field, value) for field, value in _unusual(request)}
    groups = {name: recorded(getattr(request, name)) for name, _ in request_groups(type(request))}
    return said | {name: group for name, group in groups.items() if group}


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
    """Give the fields that ask for something, and what."""
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
    """Return the number of a text, which may be in per cent if it is not to be a whole one."""
    whole = noun == "a whole number"
    share = text.strip().endswith("%") and not whole
    try:
        value = int(text) if whole else float(text.strip().removesuffix("%"))
    except ValueError:
        raise UnitError(f"expected {noun}, got '{text[:40]}'") from None
    if isinstance(value, float) and not math.isfinite(value):
        raise UnitError(f"expected {noun} that is finite, got '{text[:40]}'")
    return value / 100.0 if share else value
