"""Everything says what it is, and describes no parameter that it does not take."""

import dataclasses
import enum
import functools
import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import pytest
import typer

import flexstage
from flexstage.files.schema import field_texts

SECTION = re.compile(
    r"^(?P<title>[A-Z][A-Za-z ]+)\n-{3,}[ ]*\n(?P<body>(?:(?!.+\n-{3,}).*\n?)*)", re.M
)


def modules() -> list[ModuleType]:
    """Every module of the package but the one that runs it."""
    names = [found.name for found in pkgutil.walk_packages(flexstage.__path__, "flexstage.")]
    return [flexstage, *map(importlib.import_module, sorted(set(names) - {"flexstage.__main__"}))]


def is_public_module(name: str) -> bool:
    return not any(part.startswith("_") for part in name.split("."))


def unwrapped(thing: Any) -> Any:
    """Return the function under a cache or a compiler."""
    return inspect.unwrap(getattr(thing, "py_func", thing))


def is_documentable(thing: Any) -> bool:
    return inspect.isclass(thing) or inspect.isfunction(unwrapped(thing))


def commands() -> set[Any]:
    """Return the functions behind the command line, which document themselves by their help."""
    found = set()
    for app in apps():
        found |= {unwrapped(command.callback) for command in app.registered_commands}
        if app.registered_callback is not None:
            found.add(unwrapped(app.registered_callback.callback))
    return found


@functools.cache
def apps() -> list[typer.Typer]:
    candidates = (
        thing
        for module in modules()
        if module.__name__.startswith("flexstage.cli")
        for thing in vars(module).values()
    )
    return list(
        {id(thing): thing for thing in candidates if isinstance(thing, typer.Typer)}.values()
    )


def defined_things() -> Iterator[tuple[str, Any]]:
    """Give every public function and class with its full name, and their public methods."""
    seen = set(map(id, commands()))
    for module in modules():
        if not is_public_module(module.__name__):
            continue
        for name, named in list(vars(module).items()):
            thing = unwrapped(named)
            if name.startswith("_") or not is_documentable(thing) or id(thing) in seen:
                continue
            if getattr(thing, "__module__", None) == module.__name__:
                seen.add(id(thing))
                label = f"{module.__name__}.{thing.__qualname__}"
                yield label, thing
                if inspect.isclass(thing):
                    yield from methods(label, thing)


def is_face(module: ModuleType) -> bool:
    return hasattr(module, "__path__") and (
        hasattr(module, "__all__") or module.__name__.count(".") <= 1
    )


def methods(label: str, cls: type) -> Iterator[tuple[str, Any]]:
    """Give the public methods that a class is the first to define: an override says nothing."""
    for name, raw in vars(cls).items():
        if name.startswith("_") or any(hasattr(base, name) for base in cls.__bases__):
            continue
        if isinstance(raw, property):
            yield f"{label}.{name}", raw
        elif isinstance(raw, functools.cached_property):
            yield f"{label}.{name}", property(raw.func)
        elif isinstance(raw, classmethod | staticmethod) or inspect.isfunction(unwrapped(raw)):
            # Bound to the class, a class method no longer shows `cls`.
            thing = unwrapped(getattr(cls, name)) if isinstance(raw, staticmethod) else raw
            yield f"{label}.{name}", thing


def documented(docstring: str, *titles: str) -> list[str]:
    """Return the names that the sections with these titles list, without stars and types."""
    names = []
    for section in SECTION.finditer(docstring + "\n"):
        if section["title"] in titles:
            for line in section["body"].splitlines():
                if line.strip() and not line[0].isspace():
                    names += [name.strip(" *`") for name in line.split(":")[0].split(",")]
    return names


def parameters(thing: Callable[..., Any]) -> list[str]:
    """Return the names of the parameters that a caller gives."""
    if isinstance(thing, classmethod):
        thing = thing.__func__
    names = [name for name in inspect.signature(unwrapped(thing)).parameters if name[0] != "_"]
    return [name for name in names if name not in {"self", "cls"}]


def taken(thing: Any) -> list[str] | None:
    """Return what a function takes or a class is made with; nothing where that is not its own."""
    if isinstance(thing, property):
        return []
    if not inspect.isclass(thing):
        return parameters(thing)
    if dataclasses.is_dataclass(thing):
        return [f.name for f in dataclasses.fields(thing) if f.init and f.name[0] != "_"]
    if hasattr(thing, "_fields") and issubclass(thing, tuple):
        return list(thing._fields)
    if issubclass(thing, enum.Enum) or getattr(thing, "_is_protocol", False):
        return None
    own = vars(thing).get("__init__")
    return None if own is None else parameters(own)


def faults(label: str, thing: Any) -> list[str]:
    """Say what a docstring lacks, or which names it describes that are not there."""
    generated = inspect.isclass(thing) and (thing.__doc__ or "").startswith(f"{thing.__name__}(")
    docstring = inspect.cleandoc(thing.__doc__ or "")
    if not docstring or generated:
        return [f"{label}: has no docstring"]
    names = taken(thing)
    if names is None:
        return []
    listed = documented(docstring, "Parameters", "Other Parameters")
    if inspect.isclass(thing):
        listed += [n for n in documented(docstring, "Attributes") if not hasattr(thing, n)]
    unknown = [name for name in listed if name not in names]
    return [f"{label}: documents {', '.join(unknown)}, not in it"] if unknown else []


def silent_fields(label: str, cls: type) -> list[str]:
    """Say which fields of a class have no text below them, there or in a base."""
    texts = field_texts(cls)
    names = [name for name in taken(cls) or [] if name not in texts]
    return [f"{label}: says nothing below {', '.join(names)}"] if names else []


def test_every_module_says_what_it_is() -> None:
    silent = [module.__name__ for module in modules() if not (module.__doc__ or "").strip()]
    assert not silent, f"modules without a docstring: {', '.join(silent)}"


def test_everything_says_what_it_is() -> None:
    found = [fault for label, thing in defined_things() for fault in faults(label, thing)]
    assert not found, "\n" + "\n".join(found)


def test_every_field_of_a_public_class_is_described() -> None:
    found = []
    for module in filter(is_face, modules()):
        for name in getattr(module, "__all__", []):
            thing = getattr(module, name)
            if inspect.isclass(thing) and (
                dataclasses.is_dataclass(thing) or hasattr(thing, "_fields")
            ):
                found += silent_fields(f"{module.__name__}.{name}", thing)
    assert not found, "\n" + "\n".join(found)


def test_everything_exported_exists() -> None:
    absent = [
        f"{module.__name__}.{name}"
        for module in modules()
        for name in getattr(module, "__all__", [])
        if not hasattr(module, name)
    ]
    assert not absent, f"named in __all__ but absent: {', '.join(absent)}"


def test_only_faces_export() -> None:
    behind = [m.__name__ for m in modules() if hasattr(m, "__all__") and not is_face(m)]
    assert not behind, f"behind the faces, but with an __all__: {', '.join(behind)}"


def test_every_command_and_option_has_help() -> None:
    if not apps():
        pytest.skip("there is no command line yet")

    def silent(path: str, command: Any) -> Iterator[str]:
        if not (command.help or "").strip():
            yield path
        # with the settings of the program: what is made here of its parameters is kept by them
        context = typer.Context(command, info_name=path, help_option_names=["-h", "--help"])
        for parameter in getattr(command, "get_params", lambda _: command.params)(context):
            if parameter.name != "help" and not (getattr(parameter, "help", None) or "").strip():
                yield f"{path} {parameter.name}"
        for name, inner in getattr(command, "commands", {}).items():
            yield from silent(f"{path} {name}", inner)

    found = {
        fault
        for app in apps()
        if app.registered_commands or app.registered_groups
        for fault in silent("flexstage", typer.main.get_command(app))
    }
    assert not found, f"without help: {sorted(found)}"


# The check itself is checked: it must find each kind of fault, and pass what is right.


def good(model: object, omega: float, *, count: int = 3) -> None:
    """Do a thing.

    Parameters
    ----------
    model : object
        A model.
    omega, count : float
        Two numbers, listed
        with words: and colons.

    Notes
    -----
    nothing : here
    """


def forgetful(model: object, omega: float) -> None:
    """Do a thing.

    Parameters
    ----------
    model
        A model.
    frequency
        Renamed since.
    """


def test_the_check_finds_faults() -> None:
    assert faults("good", good) == []
    assert faults("f", forgetful) == ["f: documents frequency, not in it"]
    assert faults("f", lambda: None) == ["f: has no docstring"]

    @dataclasses.dataclass
    class Bare:
        width: float

    assert faults("Bare", Bare) == ["Bare: has no docstring"]


@dataclasses.dataclass
class Described:
    """A class whose field is described, as those that inherit it are."""

    width: float
    """Its width [m]."""


@dataclasses.dataclass
class Silent(Described):
    """A class with one field more, which says nothing."""

    depth: float


def test_a_field_without_a_text_is_found() -> None:
    assert silent_fields("Described", Described) == []
    assert silent_fields("Silent", Silent) == ["Silent: says nothing below depth"]
