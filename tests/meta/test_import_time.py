"""`import flexstage` and the commands are fast: they load no library that they do not use."""

import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

import flexstage

HEAVY = {
    "GTC", "control", "dask", "ezdxf", "h5py", "matplotlib", "netgen", "ngsolve", "nicegui",
    "numba", "numpy", "pint", "scipy", "serial", "shapely", "sqlalchemy", "sympy", "typer", "yaml",
}  # fmt: skip
COMMANDS = """
import json, sys
from flexstage.cli import main
for words in json.loads(sys.argv[1]):
    try:
        main(words)
    except SystemExit as ended:
        assert not ended.code, ended.code
    print("\\nloaded", *sys.modules)
"""
SCRIPT = """
import sys, time
start = time.perf_counter()
import flexstage
print(time.perf_counter() - start, *sorted({name.split('.')[0] for name in sys.modules}))
"""


def fresh_import() -> tuple[float, set[str]]:
    """Import the package in a new process; return the seconds and the packages loaded."""
    command = [sys.executable, "-c", SCRIPT]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return float(out[0]), set(out[1:])


@pytest.mark.slow
@pytest.mark.alone
def test_import_takes_under_half_a_second() -> None:
    # The best of five: the others measure what else the machine is doing.
    assert min(fresh_import()[0] for _ in range(5)) < 0.5


def test_import_loads_nothing_heavy() -> None:
    assert HEAVY & fresh_import()[1] == set()


# What each command may load of the heavy libraries, of SciPy only the parts that are named; in one
# process where each may load what those before it load.
@pytest.mark.parametrize(
    "commands",
    [
        (
            (["--help"], set()),
            (["check", "vgtu-piezo"], {"numpy", "shapely", "yaml"}),
            (
                ["show", "vgtu-piezo", "--out", "stage.svg"],
                {"matplotlib", "numpy", "shapely", "yaml"},
            ),
        ),
        ((["analyse", "vgtu-piezo", "--model", "lumped"], {"numpy", "scipy", "yaml"}),),
    ],
    ids=lambda commands: commands[-1][0][0],
)
def test_a_command_loads_what_it_uses(
    commands: tuple[tuple[list[str], set[str]], ...], tmp_path: Path
) -> None:
    command = [sys.executable, "-c", COMMANDS, json.dumps([words for words, _ in commands])]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    said = [line.split() for line in ran.stdout.splitlines() if line.startswith("loaded ")]
    slow = {"matplotlib.pyplot", "scipy.optimize", "scipy.signal", "scipy.sparse", "scipy.stats"}
    for (_, allowed), loaded in zip(commands, map(set, said), strict=True):
        assert "flexstage.cli" in loaded
        assert HEAVY & loaded <= allowed | {"typer"}
        assert slow & loaded == set()


def test_a_module_does_not_hide_a_function_of_its_name() -> None:
    module = importlib.import_module("flexstage.system.modes")
    assert flexstage.system.modes is module.modes


def test_a_package_says_what_it_lacks() -> None:
    with pytest.raises(AttributeError, match=r"'flexstage\.fem' has no attribute 'superelment'"):
        flexstage.fem.superelment  # type: ignore[attr-defined]  # noqa: B018
