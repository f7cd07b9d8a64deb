"""Where the library of finite elements is not built: what works without it, and what is said.

One process, in which that library is as if it were not installed, does what all tests look at.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

#: Commands by a name, and what they said: status, output and errors.
PROGRAM = """
import contextlib, io, json, sys
for name in ("ngsolve", "netgen"):
    sys.modules[name] = None  # as if it were not installed
from flexstage.cli import main
said = {}
for name, words in json.loads(sys.argv[1]).items():
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main(words)
        except SystemExit as end:
            said[name] = (int(end.code or 0), out.getvalue(), err.getvalue())
from flexstage.stage.designs import design
from flexstage.instruments.connect import connect
with connect("twin://?seed=4&model=lumped", design("vgtu-piezo")) as instrument:
    x = instrument.axes["x"]
    x.set_voltage(20.0)
    said["twin"] = (0, str(x.voltage()), "")
print(json.dumps(said))
"""
ASKED = {
    "superelement": ("analyse", "parallelogram", "--model", "superelement"),
    "step": ("export", "parallelogram", "--to", "step", "--folder", "exported"),
    "part": ("part", "part.step"),
}


class Said(NamedTuple):
    """What a command said, and its exit status."""

    status: int
    out: str
    err: str


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the commands run, with the record of a drive."""
    folder = tmp_path_factory.mktemp("without")
    t = np.arange(2000) / 1000.0
    volts = 50.0 - 50.0 * np.cos(2.0 * np.pi * t)
    moved = 0.2 * volts - 1.5 * np.sin(2.0 * np.pi * t)  # a loop
    rows = np.column_stack([t, volts, moved])
    heading = "time [s],voltage [V],position [um]"
    np.savetxt(folder / "drive.csv", rows, delimiter=",", header=heading, comments="")
    return folder


@pytest.fixture(scope="module")
def said(folder: Path) -> dict[str, Said]:
    """What each of the commands said."""
    commands = {
        **ASKED,
        "rigid": ("analyse", "parallelogram", "--model", "lumped", "--json"),
        "identify": (
            *("identify", "drive.csv", "--input", "voltage", "--output", "position"),
            *("--model", "dahl", "--known", "delay=0 s", "--json", "--quiet"),
        ),
    }
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, json.dumps(commands)],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return {name: Said(*found) for name, found in json.loads(done.stdout).items()}


def test_rigid_bodies_need_no_finite_elements(said: dict[str, Said]) -> None:
    assert said["rigid"].status == 0, said["rigid"].err
    assert "characteristics" in json.loads(said["rigid"].out)


def test_a_twin_needs_none(said: dict[str, Said]) -> None:
    assert float(said["twin"].out) == pytest.approx(20.0, abs=0.1)


def test_a_drive_is_identified_without_them(said: dict[str, Said]) -> None:
    assert said["identify"].status == 0, said["identify"].err


@pytest.mark.parametrize("name", ASKED)
def test_finite_elements_that_are_asked_for_are_one_sentence(
    name: str, said: dict[str, Said], folder: Path
) -> None:
    found = said[name]
    assert found.status == 2
    assert found.err.startswith("flexstage: finite elements need the package ngsolve")
    assert len(found.err.splitlines()) == 1
    assert [path.name for path in folder.iterdir()] == ["drive.csv"]
