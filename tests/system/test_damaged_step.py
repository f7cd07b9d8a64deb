"""STEP files that are damaged: one sentence, and never the end of the program that reads them."""

import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from flexstage.base.errors import StageError
from flexstage.elasticity.own_process import BrokenDownError, in_own_process
from flexstage.export import step_files
from flexstage.fem.part import read_step
from flexstage.stage.designs import design
from flexstage.stage.drawing.drawn_stage import read_drawing

ROOT = Path(__file__).resolve().parents[2]
FLEXURES = ROOT.parent / "shared" / "data" / "ansys-flexures"


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The solid of a guide, as it is exported."""
    path = tmp_path_factory.mktemp("step") / "parallelogram.step"
    path.write_bytes(step_files(design("parallelogram"))[path.name])
    return path


@pytest.mark.parametrize("read", [lambda path: read_step(path, solid="all"), read_drawing])
def test_a_file_that_ends_the_geometry_kernel_is_refused_in_one_sentence(
    read: Callable[[Path], object],
    whole: Path,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    damaged = tmp_path / "damaged.step"
    text = whole.read_text("latin-1")
    text, count = re.subn(r"PLANE\('',#\d+\)", "PLANE('',#1e9)", text, count=1)
    damaged.write_text(text, "latin-1")
    with pytest.raises(StageError, match=r"kernel crashed .*'.*damaged\.step'") as caught:
        read(damaged)
    assert count == 1
    assert "\n" not in str(caught.value)
    assert "export it again" in str(caught.value)
    assert capfd.readouterr() == ("", "")


def _mutants(source: Path, folder: Path, first: int, stop: int) -> list[str]:
    """Return what became of damaged copies, whose readers have a process of their own."""
    found = subprocess.run(
        [sys.executable, "-m", "tests.step_mutants", source, folder, str(first), str(stop)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    lines = found.stdout.splitlines()
    assert (found.returncode, found.stderr) == (0, ""), lines[-1:]
    assert len(lines) == 2 * (stop - first)
    return lines


@pytest.mark.slow
def test_no_damage_ends_the_program(whole: Path, tmp_path: Path) -> None:
    lines = _mutants(whole, tmp_path, 0, 8)
    # the damages are real ones
    assert sum("the geometry kernel crashed" in line for line in lines) > 2
    assert sum(line.endswith(": read") for line in lines) > 2


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("name", "first", "stop"),
    [
        ("parallelogram.step", 0, 500),
        ("APA300ML.STEP", 500, 750),
        ("flexor_ID16.STEP", 750, 930),
        ("flexor_025.step", 930, 1000),
    ],
)
def test_none_of_1000_damages_ends_the_program(
    name: str, first: int, stop: int, whole: Path, tmp_path: Path
) -> None:
    source = whole if name == whole.name else FLEXURES / name
    if not source.exists():
        pytest.skip(f"{name} is among the measured files that lie beside the project")
    _mutants(source, tmp_path, first, stop)


# ------------------------------------------------------------------ the process


def test_what_a_function_gives_and_raises_comes_back() -> None:
    assert in_own_process(divmod, 17, 5) == (3, 2)
    with pytest.raises(ZeroDivisionError) as caught:
        in_own_process(divmod, 1, 0)
    assert "Traceback" in "".join(caught.value.__notes__)  # where it happened is not lost


@pytest.mark.parametrize(
    ("code", "seconds", "memory", "said"),
    [
        ("import os; os.abort()", None, None, r"^crashed \((signal 6, SIGABRT|status \d+)\)$"),
        ("import os; os._exit(3)", None, None, r"^crashed \(status 3\)$"),
        ("while True: pass", 1.0, None, "^did not finish within 1 s of computing time$"),
        (
            "import time; time.sleep(600)",
            1.0,
            None,
            "^did not finish within 1 s of computing time$",
        ),
        ("bytearray(5 * 10**9)", None, 1e9, "^needs more than 1 GB of memory$"),
    ],
)
def test_a_process_that_ends_or_takes_too_much_is_told_in_words(
    code: str,
    seconds: float | None,
    memory: float | None,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if sys.platform == "win32" and memory is not None:
        pytest.skip("no limit of memory")
    if "sleep" in code:  # the clock ends it, sooner than it would
        monkeypatch.setattr("flexstage.elasticity.own_process._WAITS", 0.2)
    began = time.monotonic()
    with pytest.raises(BrokenDownError, match=said):
        in_own_process(exec, code, seconds=seconds, memory=memory)
    assert time.monotonic() - began < 60.0
