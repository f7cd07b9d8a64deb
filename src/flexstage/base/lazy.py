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
    """Import the names in a package's ``if TYPE_CHECKING:`` block on first use.

    That block is the only list: type checkers read it as imports, and so does this function.
    A package's ``__init__`` calls it with ``__name__``; its source must be installed. A star means
    all names in the block of that module.
    """
    module, homes = sys.modules[package], names_for_types(package)
    for starred in [home for home, name in homes.values() if name == "*"]:
        homes |= names_for_types(starred)
    homes.pop("*", None)
    module.__dict__["_homes"] = homes
    module.__class__ = _Package


def names_for_types(module: str) -> dict[str, tuple[str, str]]:
    """Return the imports of a module for type checkers: module and name there, by name."""
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


def data_frame(data: Any, **options: Any) -> "pandas.DataFrame":
    """Return columns by name, or rows, as a data frame; pandas receives the options."""
    try:
        import pandas
    except ImportError as error:
        raise ImportError(
            "a data frame needs pandas, which is not installed: run 'pip install pandas'"
        ) from error
    return pandas.DataFrame(data, **options)


def require_extra(extra: str, module: str, what: str, error: type[Exception]) -> None:
    """Raise an `error` that names the extra to install where its module is missing.

    `what` is the function that needs it, such as "a Parquet file".
    """
    try:
        import_module(module)
    except ImportError as import_error:
        raise error(
            f'{what} needs a package that is not installed: pip install "flexstage[{extra}]"'
        ) from import_error


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
        # the import system sets each submodule; one with the name of a public object would hide it
        submodule = isinstance(value, ModuleType) and value.__name__ == f"{self.__name__}.{name}"
        if not (submodule and name in self._homes):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        subpackages = {name for name, (home, _) in self._homes.items() if home == self.__name__}
        return sorted({*self._homes, *self.__dict__.get("__all__", ())} - subpackages)
