"""What a simulated stage is set to, found once in a test process for the same figures.

A simulated stage is tuned to published frequencies, and its stacks to the width of a loop, by
searches that depend on these figures alone. Tests make the same stages dozens of times.
"""

import functools
import importlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import pytest

from flexstage.stage import Stage


@contextmanager
def set_once() -> Iterator[None]:
    """Search once for the necks and the stacks of the same stage."""
    # functions on the face of a room may have the names of its modules
    as_built = importlib.import_module("flexstage.virtual.as_built")
    build = importlib.import_module("flexstage.virtual.build")
    virtual_stack = build.virtual_stack
    tune = as_built._tuned
    found: dict[Any, Stage] = {}

    def tuned(
        made: Stage, frequencies: Mapping[str, float], moved: Mapping[str, tuple[float, float]]
    ) -> Stage:
        key = made, tuple(sorted(frequencies.items())), tuple(sorted(moved.items()))
        if key not in found:
            found[key] = tune(made, frequencies, moved)
        return found[key]

    stack = functools.cache(virtual_stack)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(as_built, "_tuned", tuned)
        patch.setattr(as_built, "virtual_stack", stack)
        patch.setattr(build, "virtual_stack", stack)
        yield
