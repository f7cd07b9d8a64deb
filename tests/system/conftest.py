"""Fixtures of the tests of whole commands."""

import pickle
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.undrawn import undrawn as _undrawn
from tests.virtual_stages import set_once


@pytest.fixture(scope="session", autouse=True)
def _virtual_stages_are_set_once() -> Iterator[None]:
    with set_once():
        yield


@pytest.fixture
def undrawn() -> Iterator[None]:
    """No figure is drawn; only for tests that look at none."""
    with _undrawn():
        yield


@pytest.fixture
def meshed_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mesher and geometry kernel run in this process: for parts that they bear."""
    from flexstage.elasticity import step_file
    from flexstage.fem import part_mesh

    def called(work: Callable[..., Any], *given: Any, **_: object) -> Any:
        # copied on both ways, as between two processes
        return pickle.loads(pickle.dumps(work(*pickle.loads(pickle.dumps(given)))))

    monkeypatch.setattr(part_mesh, "in_own_process", called)
    monkeypatch.setattr(step_file, "in_own_process", called)
