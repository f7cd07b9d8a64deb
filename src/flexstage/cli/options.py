"""Options and arguments that several commands have, and what their texts mean."""

import copy
import functools
import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields, is_dataclass
from typing import Annotated, Any, get_args, get_origin

import typer

from flexstage.base.errors import FlexstageError, ModelError
from flexstage.files.request import (
    Request,
    RequestField,
    is_request,
    request_fields,
    request_groups,
)


def option(metavar: str, help: str, *names: str, **more: Any) -> Any:
    """Declare an option: what its value is called in the help, and what it says."""
    return typer.Option(*names, metavar=metavar, help=help, **more)


def refuse(wrong: object, sentence: str, error: type[Exception] = ModelError) -> None:
    """Refuse options that are wrong, or do not go together, in a sentence."""
    if wrong:
        raise error(sentence)


def from_docstring(command: Callable[..., None]) -> Callable[..., None]:
    """Make the options and arguments of a command from its docstring, and those of its groups.

    The text of a parameter in the section Parameters is its help; what its value is called stands
    before it, ``LENGTH: Radius of the fillets.``, after a name of its own where it has one,
    ``--column COLUMN: ...``. What is not described there says itself what it is, as the options
    that several commands share do. A parameter whose type is a request stands for an option for
    each of its fields, of the requests in it too, and so does one whose type is a dataclass, whose
    docstring describes them likewise; its `panel` is their section.
    """
    sentence, own = _described(command)
    # a script may say to every command that no progress is wanted
    always_quiet = all(parameter.name != "quiet" for parameter in own)
    if always_quiet:
        kind = inspect.Parameter.KEYWORD_ONLY
        own.append(inspect.Parameter("quiet", kind, default=False, annotation=QuietOption))
    groups = {
        parameter.name: parameter.annotation
        for parameter in own
        if isinstance(parameter.annotation, type) and is_dataclass(parameter.annotation)
    }
    for name, kind in groups.items():
        at = next(i for i, parameter in enumerate(own) if parameter.name == name)
        own[at : at + 1] = (
            list(_asked(kind))
            if issubclass(kind, Request)
            else _described(kind, getattr(kind, "panel", None))[1]
        )

    @functools.wraps(command)
    def run(**given: Any) -> None:
        for name, made in groups.items():
            if issubclass(made, Request):
                given[name] = _filled(made, given)
            else:
                given[name] = made(**{field.name: given.pop(field.name) for field in fields(made)})
        if always_quiet:
            del given["quiet"]
        command(**given)

    run.__doc__ = sentence
    run.__signature__ = inspect.Signature(own)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in own}
    run.requests = [kind for kind in groups.values() if issubclass(kind, Request)]  # type: ignore[attr-defined]
    return run


def _asked(kind: type[Request]) -> Iterator[inspect.Parameter]:
    """Return the options of a request, and of the requests in it; their help is read when shown."""
    for field in request_fields(kind).values():
        yield inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=_default(field),
            annotation=Annotated[_type_of(field), _option_of(field, kind.heading or None)],
        )
    for _, group in request_groups(kind):
        yield from _asked(group)


def _type_of(field: RequestField) -> Any:
    if field.value is bool:
        return bool
    return (list[str] | None) if field.many and not field.written.commas else (str | None)


def _default(field: RequestField) -> Any:
    if field.default is MISSING:
        return inspect.Parameter.empty
    if field.default == ():
        return None
    if field.value is bool or field.default is None:
        return field.default
    # as a text, which the help shows, and which is read as any other; the units library is slow
    if field.dimension is not None and isinstance(field.default, float):
        units, si = field.dimension.units, field.dimension.si
        if field.default and f"m{si}" in units and abs(field.default) < 0.1:
            return f"{1e3 * field.default:g} m{si}"
        return f"{field.default:g} {si if field.default else units[0]}"
    return " ".join(field.texts(field.default)) or None


def _option_of(field: RequestField, panel: str | None) -> Any:
    if field.value is bool:
        names = f"{field.option}/--no-{field.option[2:]}" if field.default else field.option
        return typer.Option(names, rich_help_panel=panel)

    def read(text: str) -> Any:
        try:
            return field.read(text)
        except FlexstageError as error:
            raise typer.BadParameter(str(error)) from None

    return typer.Option(
        field.option,
        parser=read,
        metavar=field.metavar,
        rich_help_panel=panel,
    )


def _filled(kind: type[Request], given: dict[str, Any]) -> Request:
    """Return a request of what the options gave, which is taken out of them."""
    values = {}
    for field in request_fields(kind).values():
        value = given.pop(field.name)
        if value is None:
            value = field.default
        elif field.repeated:
            value = tuple(value)
        values[field.name] = value
    return kind(**values, **{name: _filled(group, given) for name, group in request_groups(kind)})


def request_texts(command: Any) -> dict[str, str]:
    """Return the help of the options that come from the requests of a command, by their names."""
    from flexstage.files.schema import field_texts, part_texts

    texts: dict[str, str] = {}
    left = list(getattr(command, "requests", ()))
    while left:
        kind = left.pop()
        own = request_fields(kind)
        for name, text in field_texts(kind).items():
            if name in own:
                field = own[name]
                end = "; may be repeated." if field.repeated else "."
                parts = part_texts(field.kind) if is_request(field.kind) else ""
                said = f"{text.removesuffix('.')}{end} {field.written.help}{parts}"
                texts[name] = said.strip()
        left += [group for _, group in request_groups(kind)]
    return texts


def _described(
    thing: Callable[..., Any], panel: str | None = None
) -> tuple[str, list[inspect.Parameter]]:
    """Return what a docstring says first, and the parameters with what it says of each."""
    sentence, texts = "", {}
    for part in (*reversed(getattr(thing, "__mro__", ())), thing):  # what a class inherits, too
        # an interpreter that drops docstrings leaves options without help
        text = inspect.cleandoc(part.__doc__ or "")
        sentence, _, section = text.partition("\n\nParameters\n----------\n")
        entries = re.split(r"^(?=\S)", section, flags=re.MULTILINE)
        named = (entry.split("\n", 1) for entry in entries if entry)
        texts |= {name: " ".join(told.split()) for name, told in named}
    parameters = []
    for name, parameter in inspect.signature(thing).parameters.items():
        kind = parameter.annotation
        if name in texts:
            kind = _with_help(name, kind, texts[name], panel)
        parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=kind))
    return sentence, parameters


def _with_help(name: str, kind: Any, text: str, panel: str | None) -> Any:
    """Return the type of a parameter with its help, the name of its value and its own names."""
    base, *known = get_args(kind) if get_origin(kind) is Annotated else (kind,)
    info = copy.copy(known[0]) if known else typer.Option()
    head, found, rest = text.partition(": ")
    if not found or (base is bool and not head.startswith("--")):
        head, rest = "", text
    words = head.split()
    if sum(not word.startswith("--") for word in words) > 1:
        words, rest = [], text
    info.help = rest
    info.rich_help_panel = panel or info.rich_help_panel
    info.metavar = " ".join(w for w in words if not w.startswith("--")) or info.metavar
    names = tuple(w for w in words if w.startswith("--"))
    # a flag has no second name that takes it back
    flag = (f"--{name.replace('_', '-')}",) if base is bool else ()
    info.param_decls = names or info.param_decls or flag
    return Annotated[base, info]


JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the result, or the error, as one JSON object.")
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print no progress on standard error.")
]
AxisOption = Annotated[str | None, option("NAME", "Axis of the stage (default: the first).")]
