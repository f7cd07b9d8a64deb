"""What is compiled is that of the sources that are there."""

import importlib
import sys
from pathlib import Path

import pytest

from flexstage.hysteresis.compiled import forget_outdated


def test_a_caller_follows_what_it_calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba alone keeps the caller as it was compiled first."""
    room = tmp_path / "room"
    room.mkdir()
    monkeypatch.syspath_prepend(room)
    (room / "a_caller.py").write_text(
        "from flexstage.hysteresis.compiled import compiled\nfrom a_callee import inner\n"
        "@compiled\ndef outer(x):\n    return inner(x) + 1.0\n"
    )
    said = []
    for factor in (2.0, 2.0, 10.0):
        content = (
            "from flexstage.hysteresis.compiled import compiled\n"
            f"@compiled\ndef inner(x):\n    return {factor} * x\n"
        )
        if not (room / "a_callee.py").exists() or (room / "a_callee.py").read_text() != content:
            (room / "a_callee.py").write_text(content)
        forget_outdated((room,))
        importlib.invalidate_caches()
        outer = importlib.import_module("a_caller").outer
        said.append((outer(3.0), sum(outer.stats.cache_hits.values())))
        # the next import is as that of a new process
        for name in ("a_caller", "a_callee"):
            del sys.modules[name]
    assert said == [(7.0, 0), (7.0, 1), (31.0, 0)]


def test_a_room_that_cannot_be_written_to_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "__pycache__").write_text("no folder")
    forget_outdated((tmp_path,))
    assert (tmp_path / "__pycache__").read_text() == "no folder"
