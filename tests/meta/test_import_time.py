"""``import flexstage`` is fast, because it loads no heavy library."""

import subprocess
import sys

HEAVY = {"sympy", "matplotlib", "pint", "scipy", "shapely", "control", "ngsolve", "dask", "typer"}
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


def test_import_takes_under_half_a_second() -> None:
    # The best of five: the others measure what else the machine is doing.
    assert min(fresh_import()[0] for _ in range(5)) < 0.5


def test_import_loads_nothing_heavy() -> None:
    assert HEAVY & fresh_import()[1] == set()
