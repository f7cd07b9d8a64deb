"""Settings of the process that the tests run in."""

import atexit
import ctypes
import functools
import gc
import math
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule
from hypothesis import settings

from tests import evidence_table
from tests.longest import LONGEST
from tests.shared_data import ABSENT

# The same examples on every machine and day: a change is to blame for what fails, not chance. New
# ones are searched for by `make evidence`, with the profile of that name; a find becomes an example
# of its test. The same examples find what was broken since, which needs fewer than a search does.
settings.register_profile("fixed", derandomize=True, database=None, deadline=None, max_examples=25)
settings.register_profile(
    "search", derandomize=False, deadline=None, print_blob=True, max_examples=100
)
settings.load_profile("fixed")

# Threads of the finite elements wait by turning in circles, so that two test processes with two
# threads each are five times slower than one after the other. Read when the library is loaded.
os.environ.setdefault("NGS_NUM_THREADS", "1")

# The matrix library's threads wait the same way; many small least squares are faster without them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# What is compiled is kept, also where the surroundings say that nothing is: else each run rewrites
# the assertions of all tests anew, and each process that a test starts compiles the package.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# The processes of a parallel run inherit the width of a screen, a single one does not: what a
# command prints must not depend on how many processes run the tests.
os.environ.pop("COLUMNS", None)

# Runs and locks of tests stay out of the user's own store, and so does what they condense: one
# folder for all processes of a run, which take it over from the process that starts them.
_OWN = tempfile.mkdtemp(prefix="flexstage-tests-")
if "PYTEST_XDIST_WORKER" not in os.environ:
    os.environ["FLEXSTAGE_CACHE"] = _OWN
os.environ["FLEXSTAGE_CATALOGUE"] = f"{_OWN}/catalogue.sqlite"
os.environ["FLEXSTAGE_STATE"] = f"{_OWN}/state"
atexit.register(shutil.rmtree, _OWN, ignore_errors=True)


# What is started behind `&` or `nohup` ignores Ctrl-C, and so do its children; tests send it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """What is collected stays to the end: no collector of garbage need look through it."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        # tests make much that lives to their end: looking for what does not pays less often
        gc.set_threshold(10_000, 10, 20)
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_collect_file() -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """No file below has an example in a docstring: nothing is looked through for one."""
    return [found for found in (yield) if not isinstance(found, DoctestModule)]


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Processes side by side begin with the longest tests, so that none waits at the end for one.

    Each gets a part of the list, and at its end those that remain to others.
    """
    processes = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    place = {name: k for k, name in enumerate(LONGEST)}
    first = sorted((i for i in items if i.name in place), key=lambda item: place[item.name])
    if processes == 1 or len(items) < 2 * processes * len(first):
        return
    rest = [item for item in items if item.name not in place]
    left, parts = len(items), []
    for k in range(processes):
        size = left // (processes - k)
        own = first[k::processes]
        parts += [*own, *rest[: size - len(own)]]
        del rest[: size - len(own)]
        left -= size
    items[:] = parts


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """What the functions of a file remember is forgotten at its end: a process must not grow."""
    module = getattr(item, "module", None)
    if module is None or module is getattr(nextitem, "module", None):
        return
    for made in vars(module).values():
        if getattr(made, "__module__", "") == module.__name__ and hasattr(made, "cache_clear"):
            made.cache_clear()
    # memory that is free goes back to the system, for the processes beside this one
    if sys.platform == "linux" and hasattr(ctypes.CDLL(None), "malloc_trim"):
        ctypes.CDLL(None).malloc_trim(0)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--evidence-page", type=Path, help="write the table of evidence to this file")


def pytest_unconfigure(config: pytest.Config) -> None:
    """Say at the very end how much evidence was absent, and not only which tests were skipped."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or hasattr(config, "workerinput"):
        return
    if file := config.getoption("--evidence-page", None):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(evidence_table.page(evidence_table.outcomes_of(reporter)), "utf-8")
    absent = sum(ABSENT in str(report.longrepr) for report in reporter.stats.get("skipped", ()))
    if absent:
        reporter.write_line(f"{absent} skipped, which compare with measurements: {ABSENT}")


@pytest.fixture(scope="session", autouse=True)
def _without_progress() -> Iterator[None]:
    """Lines of progress come by the clock: what a test reads must not depend on the machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("flexstage.cli.output._QUIET_PERIOD", math.inf)
        yield


@pytest.fixture(scope="session", autouse=True)
def _files_are_left_to_the_system(request: pytest.FixtureRequest) -> Iterator[None]:
    """Files of tests need not outlive the machine: none waits for the disk, but beside a clock."""
    with pytest.MonkeyPatch.context() as patch:
        if not request.config.option.markexpr.endswith(" and alone"):
            patch.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def _commands_are_parsed_by_one_parser() -> Iterator[None]:
    """A process makes the parser of its command line once; tests run a thousand in theirs."""
    import typer.main

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", functools.cache(typer.main.get_command))
        yield
