"""Fixtures of the tests of whole commands."""

import pickle
from collections.abc import Iterator
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
    """The mesher runs in this process: for parts that it bears, where what it makes matters."""
    from flexstage.fem import mesher, part_mesh

    def generate(task: dict[str, Any], *_: object) -> dict[str, Any]:
        # copied on both ways, as between two processes
        given = pickle.loads(pickle.dumps(task))
        return {"mesh": pickle.loads(pickle.dumps(mesher.generate(mesher.MeshTask(**given))))}

    monkeypatch.setattr(part_mesh, "_in_another_process", generate)
