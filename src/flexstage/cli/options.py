"""Options and arguments of commands, made from signatures, docstrings and requests."""

import copy
import functools
import inspect
import math
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


def option(metavar: str, help: str, *names: str, **settings: Any) -> Any:
    """Declare an option with the name of its value and its help."""
    return typer.Option(*names, metavar=metavar, help=help, **settings)


def refuse(fault: object, message: str, error: type[Exception] = ModelError) -> None:
    """Raise an error with a message if options are wrong or do not go together."""
    if fault:
        raise error(message)


def from_docstring(command: Callable[..., None]) -> Callable[..., None]:
    """Make the options and arguments of a command from its docstring, and those of its groups.

    The text of a parameter in the section Parameters is its help. The name of its value precedes
    the text, ``LENGTH: Radius of the fillets.``, and so does another name of the option,
    ``--column COLUMN: ...``. A parameter without text there has its help in its type, as the shared
    options do. A parameter whose type is a request becomes one option for each of its fields, those
    of nested requests included. A dataclass is treated likewise: its docstring describes the
    fields, its `panel` is their section of the help.
    """
    summary, parameters = _parse_docstring(command)
    # every command accepts --quiet
    always_quiet = all(parameter.name != "quiet" for parameter in parameters)
    if always_quiet:
        kind = inspect.Parameter.KEYWORD_ONLY
        parameters.append(inspect.Parameter("quiet", kind, default=False, annotation=QuietOption))
    groups = {
        parameter.name: parameter.annotation
        for parameter in parameters
        if isinstance(parameter.annotation, type) and is_dataclass(parameter.annotation)
    }
    for name, kind in groups.items():
        at = next(i for i, parameter in enumerate(parameters) if parameter.name == name)
        parameters[at : at + 1] = (
            list(_request_parameters(kind))
            if issubclass(kind, Request)
            else _parse_docstring(kind, getattr(kind, "panel", None))[1]
        )

    @functools.wraps(command)
    def run(**values: Any) -> None:
        for name, group in groups.items():
            if issubclass(group, Request):
                values[name] = _build_request(group, values)
            else:
                values[name] = group(
                    **{field.name: values.pop(field.name) for field in fields(group)}
                )
        if always_quiet:
            del values["quiet"]
        command(**values)

    run.__doc__ = summary
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.requests = [kind for kind in groups.values() if issubclass(kind, Request)]  # type: ignore[attr-defined]
    return run


def _request_parameters(kind: type[Request]) -> Iterator[inspect.Parameter]:
    """Yield the options of a request and of those nested in it; the help page reads their texts."""
    for field in request_fields(kind).values():
        type_of = _type_of(field)
        yield inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=_default(field),
            annotation=Annotated[type_of, _option_of(field, kind.heading or None)],
        )
    for _, group in request_groups(kind):
        yield from _request_parameters(group)


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
    # as a text for the help, parsed like any other value; the units library is slow
    if field.dimension is not None and isinstance(field.default, float):
        units, si = field.dimension.units, field.dimension.si
        if si == "rad" and field.default:
            return f"{math.degrees(field.default):.6g} deg"
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


def _build_request(kind: type[Request], option_values: dict[str, Any]) -> Request:
    """Return a request from the values of its options, which are removed from the values."""
    values = {}
    for field in request_fields(kind).values():
        value = option_values.pop(field.name)
        if value is None:
            value = field.default
        elif field.repeated:
            value = tuple(value)
        values[field.name] = value
    return kind(
        **values,
        **{name: _build_request(group, option_values) for name, group in request_groups(kind)},
    )


def request_texts(command: Any) -> dict[str, str]:
    """Return the help of the options that come from the requests of a command, by their names."""
    from flexstage.files.schema import field_texts, part_texts

    texts: dict[str, str] = {}
    requests = list(getattr(command, "requests", ()))
    while requests:
        kind = requests.pop()
        request_options = request_fields(kind)
        for name, text in field_texts(kind).items():
            if name in request_options:
                field = request_options[name]
                end = "; may be repeated." if field.repeated else "."
                parts = part_texts(field.kind) if is_request(field.kind) else ""
                help = f"{text.removesuffix('.')}{end} {field.written.help}{parts}"
                texts[name] = help.strip()
        requests += [group for _, group in request_groups(kind)]
    return texts


def _parse_docstring(
    thing: Callable[..., Any], panel: str | None = None
) -> tuple[str, list[inspect.Parameter]]:
    """Return the summary of a docstring, and the parameters with their help."""
    summary, texts = "", {}
    for part in (*reversed(getattr(thing, "__mro__", ())), thing):  # of base classes, too
        # without docstrings (python -OO) options have no help
        text = inspect.cleandoc(part.__doc__ or "")
        summary, _, section = text.partition("\n\nParameters\n----------\n")
        entries = re.split(r"^(?=\S)", section, flags=re.MULTILINE)
        pairs = (entry.split("\n", 1) for entry in entries if entry)
        texts |= {name: " ".join(entry_text.split()) for name, entry_text in pairs}
    parameters = []
    for name, parameter in inspect.signature(thing).parameters.items():
        kind = parameter.annotation
        if name in texts:
            kind = _annotated(name, kind, texts[name], panel)
        parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=kind))
    return summary, parameters


def _annotated(name: str, kind: Any, text: str, panel: str | None) -> Any:
    """Return the type of a parameter with its help, the name of its value and its options."""
    base, *declared = get_args(kind) if get_origin(kind) is Annotated else (kind,)
    info = copy.copy(declared[0]) if declared else typer.Option()
    head, separator, help = text.partition(": ")
    if not separator or (base is bool and not head.startswith("--")):
        head, help = "", text
    words = head.split()
    if sum(not word.startswith("--") for word in words) > 1:
        words, help = [], text
    info.help = help
    info.rich_help_panel = panel or info.rich_help_panel
    info.metavar = " ".join(w for w in words if not w.startswith("--")) or info.metavar
    names = tuple(w for w in words if w.startswith("--"))
    # a flag has no --no- form
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
