"""One program at a time holds a stage, and a program that dies holds it no longer."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexstage.base.errors import ModelError, NotConnectedError
from flexstage.files.names import user_folder
from flexstage.instruments.lock import holder, stage_lock

HOLD = """
import sys
from flexstage.files.names import user_folder
from flexstage.instruments.lock import stage_lock
with stage_lock(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.readline()
"""


@pytest.fixture(autouse=True)
def _state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEXSTAGE_STATE", str(tmp_path / "state"))


@pytest.fixture
def other() -> Iterator[subprocess.Popen[str]]:
    """Another program that holds stage S-41."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, "S-41"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_another_program_is_named(other: subprocess.Popen[str]) -> None:
    with (
        pytest.raises(
            NotConnectedError, match=rf"'S-41' is in use by '-c S-41' \(process {other.pid} on"
        ),
        stage_lock("S-41"),
    ):
        pass
    found = holder("S-41")
    assert found is not None
    assert found.pid == other.pid
    with stage_lock("S-42"):  # another stage
        pass


def test_the_lock_ends_with_the_program(other: subprocess.Popen[str]) -> None:
    other.communicate("\n", timeout=300)
    with stage_lock("S-41"):
        assert (found := holder("S-41")) is not None
        assert found.pid == os.getpid()
    assert holder("S-41") is None


@pytest.mark.skipif(sys.platform == "win32", reason="there is no kill -9")
def test_a_program_that_is_killed_leaves_no_lock(other: subprocess.Popen[str]) -> None:
    other.send_signal(signal.SIGKILL)
    other.wait(timeout=300)
    left = holder("S-41")
    assert left is not None  # its word is still there, and holds nobody off
    assert left.pid == other.pid
    with stage_lock("S-41"):
        assert (found := holder("S-41")) is not None
        assert found.pid == os.getpid()


def test_the_same_program_does_not_hold_a_stage_twice() -> None:
    with (
        stage_lock("7"),
        pytest.raises(NotConnectedError, match=f"process {os.getpid()}"),
        stage_lock("7"),
    ):
        pass
    with stage_lock("7"):
        pass


def test_waiting_for_it_ends(other: subprocess.Popen[str]) -> None:
    with pytest.raises(NotConnectedError), stage_lock("S-41", timeout=0.1):
        pass
    other.communicate("\n", timeout=300)
    with stage_lock("S-41", timeout=300.0):
        pass


def test_serial_numbers_that_look_alike_stay_apart(tmp_path: Path) -> None:
    with stage_lock("A/B") as one, stage_lock("A:B") as two, stage_lock("A_B") as three:
        assert len({one, two, three}) == 3
        assert {p.parent for p in (one, two, three)} == {tmp_path / "state" / "locks"}
    with stage_lock("../../etc/passwd", directory=tmp_path) as path:
        assert path.parent == tmp_path


def test_word_that_is_cut_short_is_no_word(tmp_path: Path) -> None:
    with stage_lock("5", directory=tmp_path):
        (tmp_path / "stage-5.json").write_text('{"pid": 3, "ho')
        assert holder("5", directory=tmp_path) is None
        with (
            pytest.raises(NotConnectedError, match="whose name is unknown"),
            stage_lock("5", directory=tmp_path),
        ):
            pass


def test_what_cannot_be_locked(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="needs a serial number"), stage_lock("  "):
        pass
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(ModelError, match="FLEXSTAGE_STATE"),
        stage_lock("5", directory=tmp_path / "file"),
    ):
        pass


def test_where_the_state_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert user_folder("state") == tmp_path / "state"
    monkeypatch.delenv("FLEXSTAGE_STATE")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert user_folder("state") == tmp_path / "flexstage"
