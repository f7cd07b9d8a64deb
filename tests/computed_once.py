"""What several tests of a file ask of one function is computed once.

Tests change nothing in it.
"""

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from flexstage.base.provenance import content_hash


@contextmanager
def computed_once(module: str, function: str) -> Iterator[None]:
    """Let a function that is imported where it is called answer the same from memory."""
    compute = getattr(importlib.import_module(module), function)
    known: dict[str, Any] = {}

    def computed(*given: Any, **options: Any) -> Any:
        key = content_hash((given, options))
        if key not in known:
            known[key] = compute(*given, **options)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(f"{module}.{function}", computed)
        yield
