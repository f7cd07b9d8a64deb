"""Where the library of finite elements is not built: what works without it, and what is said."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ABSENT = """
import sys
for name in ("ngsolve", "netgen"):
    sys.modules[name] = None  # as if it were not installed
"""
COMMAND = f"""{ABSENT}
from flexstage.cli import main
main(sys.argv[1:])
"""
TWIN = f"""{ABSENT}
from flexstage.designs import design
from flexstage.instruments.connect import connect
with connect("twin://?seed=4&model=lumped", design("vgtu-piezo")) as instrument:
    x = instrument.axes["x"]
    x.set_voltage(20.0)
    print(x.voltage())
"""


def run(*words: str, program: str = COMMAND) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program, *words], capture_output=True, text=True, check=False
    )


def test_rigid_bodies_need_no_finite_elements() -> None:
    found = run("analyse", "parallelogram", "--model", "lumped", "--json")
    assert found.returncode == 0, found.stderr
    assert "characteristics" in json.loads(found.stdout)


def test_a_twin_needs_none() -> None:
    found = run(program=TWIN)
    assert found.returncode == 0, found.stderr
    assert float(found.stdout) == pytest.approx(20.0, abs=0.1)


def test_a_drive_is_identified_without_them(tmp_path: Path) -> None:
    t = np.arange(2000) / 1000.0
    volts = 50.0 - 50.0 * np.cos(2.0 * np.pi * t)
    moved = 0.2 * volts - 1.5 * np.sin(2.0 * np.pi * t)  # a loop
    path = tmp_path / "drive.csv"
    rows = np.column_stack([t, volts, moved])
    np.savetxt(path, rows, delimiter=",", header="time [s],voltage [V],position [um]", comments="")
    found = run(
        *("identify", str(path), "--input", "voltage", "--output", "position"),
        *("--model", "dahl", "--json", "--quiet"),
    )
    assert found.returncode == 0, found.stderr


@pytest.mark.parametrize(
    "words",
    [
        ("analyse", "parallelogram", "--model", "superelement"),
        ("export", "parallelogram", "--to", "step"),
        ("part", "part.step"),
    ],
)
def test_finite_elements_that_are_asked_for_are_one_sentence(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    out = ("--out", str(tmp_path)) if words[0] == "export" else ()
    found = run(*words, *out)
    assert found.returncode == 2
    assert found.stderr.startswith("flexstage: finite elements need the package ngsolve")
    assert len(found.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())
