"""Every public thing says what it is, and documents exactly the parameters that it takes."""

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


def public_things() -> Iterator[tuple[str, Any]]:
    """Give every public function and class with its full name, and their public methods."""
    seen = set(map(id, commands()))
    for module in modules():
        exported = getattr(module, "__all__", None)
        if exported is None:
            if not is_public_module(module.__name__):
                continue
            exported = [name for name in vars(module) if not name.startswith("_")]
        for name in exported:
            thing = unwrapped(getattr(module, name))
            home = getattr(thing, "__module__", None) or ""
            if not is_documentable(thing) or not home.startswith("flexstage"):
                continue
            if id(thing) not in seen:
                seen.add(id(thing))
                label = f"{home}.{thing.__qualname__}"
                yield label, thing
                if inspect.isclass(thing):
                    yield from methods(label, thing)


def methods(label: str, cls: type) -> Iterator[tuple[str, Any]]:
    for name, raw in vars(cls).items():
        if name.startswith("_"):
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
    """Say what a docstring lacks, or has too much."""
    generated = inspect.isclass(thing) and (thing.__doc__ or "").startswith(f"{thing.__name__}(")
    docstring = inspect.cleandoc(thing.__doc__ or "")
    if not docstring or generated:
        return [f"{label}: has no docstring"]
    names = taken(thing)
    if names is None:
        return []
    if not inspect.isclass(thing):
        listed = documented(docstring, "Parameters", "Other Parameters")
    else:
        listed = documented(docstring, "Parameters", "Other Parameters", "Attributes")
        # Attributes that are not fields (properties, say) may be described with the fields.
        extra = set(documented(docstring, "Attributes")) - set(names)
        listed = [name for name in listed if name not in extra or not hasattr(thing, name)]
    missing = [name for name in names if name not in listed]
    unknown = [name for name in listed if name not in names]
    out = [f"{label}: does not document {', '.join(missing)}"] if missing else []
    return out + ([f"{label}: documents {', '.join(unknown)}, not in it"] if unknown else [])


def test_every_module_says_what_it_is() -> None:
    silent = [module.__name__ for module in modules() if not (module.__doc__ or "").strip()]
    assert not silent, f"modules without a docstring: {', '.join(silent)}"


def test_docstrings_equal_signatures() -> None:
    found = [fault for label, thing in public_things() for fault in faults(label, thing)]
    assert not found, "\n" + "\n".join(found)


def test_everything_exported_exists() -> None:
    absent = [
        f"{module.__name__}.{name}"
        for module in modules()
        for name in getattr(module, "__all__", [])
        if not hasattr(module, name)
    ]
    assert not absent, f"named in __all__ but absent: {', '.join(absent)}"


def test_every_command_and_option_has_help() -> None:
    if not apps():
        pytest.skip("there is no command line yet")

    def silent(path: str, command: Any) -> Iterator[str]:
        if not (command.help or "").strip():
            yield path
        for parameter in command.params:
            if not (getattr(parameter, "help", None) or "").strip():
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
    assert faults("f", forgetful) == [
        "f: does not document omega",
        "f: documents frequency, not in it",
    ]
    assert faults("f", lambda: None) == ["f: has no docstring"]

    @dataclasses.dataclass
    class Bare:
        width: float

    assert faults("Bare", Bare) == ["Bare: has no docstring"]
