"""Packages whose modules are imported on first use, so that a command loads only what it runs."""

import ast
import sys
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas


def import_on_use(package: str) -> None:
    """Import what a package's ``if TYPE_CHECKING:`` block names when it is first used.

    That block is the only list: type checkers read it as imports, and so does this function.
    A package's ``__init__`` calls it with ``__name__``; its source must be installed. A star stands
    for all that the block of that module names.
    """
    module, homes = sys.modules[package], names_for_types(package)
    for starred in [home for home, name in homes.values() if name == "*"]:
        homes |= names_for_types(starred)
    homes.pop("*", None)
    module.__dict__["_homes"] = homes
    module.__class__ = _Package


def names_for_types(module: str) -> dict[str, tuple[str, str]]:
    """Return what a module imports for type checkers: each name, its module and its name there."""
    spec = find_spec(module)
    source = None if spec is None else spec.loader.get_source(module)  # type: ignore[union-attr]
    if source is None:
        raise ImportError(f"{module} needs the source of its file: install the wheel")
    return {
        name.asname or name.name: (line.module or "", name.name)
        for block in ast.parse(source).body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for line in block.body
        if isinstance(line, ast.ImportFrom)
        for name in line.names
    }


def data_frame(data: Any, **more: Any) -> "pandas.DataFrame":
    """Return columns by name, or rows, as a data frame; what is `more` goes to pandas."""
    try:
        import pandas
    except ImportError as error:
        raise ImportError(
            "a data frame needs pandas, which is not installed: run 'pip install pandas'"
        ) from error
    return pandas.DataFrame(data, **more)


def require_extra(extra: str, module: str, what: str, error: type[Exception]) -> None:
    """Raise an `error` that says what to install where the module of an extra is missing.

    `what` says what needs it, "acquisition cards".
    """
    try:
        import_module(module)
    except ImportError as missing:
        raise error(
            f'{what} needs a package that is not installed: pip install "flexstage[{extra}]"'
        ) from missing


class _Package(ModuleType):
    """A package that imports its names on first use."""

    _homes: dict[str, tuple[str, str]]

    def __getattr__(self, name: str) -> Any:
        if name not in self._homes:
            raise AttributeError(
                f"module '{self.__name__}' has no attribute '{name}'", name=name, obj=self
            )
        home, original = self._homes[name]
        if home == self.__name__:
            value = import_module(f"{home}.{original}")  # one of its own subpackages
        else:
            value = getattr(import_module(home), original)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        # the import system sets each submodule; one that is called like a public name would hide it
        own = isinstance(value, ModuleType) and value.__name__ == f"{self.__name__}.{name}"
        if not (own and name in self._homes):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        own = {name for name, (home, _) in self._homes.items() if home == self.__name__}
        return sorted({*self._homes, *self.__dict__.get("__all__", ())} - own)
