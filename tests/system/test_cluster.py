"""A Dask cluster on the loopback address, started by the commands that the manual prints."""

import contextlib
import json
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dask.config
import psutil
import pytest

from flexstage.base.errors import WorkerError
from flexstage.base.progress import listen
from flexstage.studies.explore import Job, open_workers
from flexstage.studies.explore import cluster as cluster_module
from tests import spread_work
from tests.meta.test_docs_snippets import ROOT, blocks
from tests.printed_commands import commands

pytestmark = pytest.mark.slow

PAGE = ROOT / "docs" / "how-to" / "several-machines.md"
PRINTED = [
    command.line
    for block in blocks(PAGE.read_text("utf-8"))
    if block.language == "shell"
    for command in commands(block.code)
    if not command.line.startswith("export ")
]


class Loopback:
    """The scheduler and the two workers of the manual, at a port that is free."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.folder = folder
        certificate, scheduler, worker, self.command = (
            shlex.split(line.replace("8786", str(port))) for line in PRINTED
        )
        subprocess.run(certificate, cwd=folder, check=True, capture_output=True)
        (configuration,) = (b.code for b in blocks(PAGE.read_text("utf-8")) if b.language == "yaml")
        # the tests and the workers run in folders of their own
        configuration = re.sub(r"(cluster\S*\.pem)", rf"{folder}/\1", configuration)
        (folder / "cluster.yaml").write_text(configuration)
        self.address = worker[2]
        scripts = str(Path(sys.executable).parent)
        self.environment = {
            **os.environ,
            "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}",
            # workers import the work of these tests by its name
            "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)]),
            "DASK_CONFIG": str(folder / "cluster.yaml"),
        }
        self.scheduler = self.start(scheduler)
        self.workers = self.start(worker)
        # a computer with other work takes longer to start a scheduler than a client waits for one
        deadline = time.monotonic() + 300.0
        while "Scheduler at" not in (folder / "log.txt").read_text():
            assert self.scheduler.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)

    def start(self, words: list[str]) -> psutil.Popen:
        """Start a command that stays."""
        with (self.folder / "log.txt").open("a") as log:
            return psutil.Popen(
                words, cwd=self.folder, env=self.environment, stdout=log, stderr=log
            )

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            words, cwd=self.folder, env=self.environment, text=True, capture_output=True,
            timeout=600.0, check=False,
        )  # fmt: skip

    def processes(self) -> list[psutil.Process]:
        """The two processes that do the work."""
        return [p for p in self.workers.children() if "spawn_main" in " ".join(p.cmdline())]

    def end_workers(self) -> list[str]:
        """End them all; return the command that starts them."""
        return killed(self.workers)

    def end(self) -> None:
        killed(self.workers)
        killed(self.scheduler)


def killed(process: psutil.Popen) -> list[str]:
    """Kill a command with what it started, and return its words."""
    with contextlib.suppress(psutil.NoSuchProcess):
        for one in process.children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                one.kill()
        process.kill()
    process.wait()
    return process.args


def configured(cluster: Loopback) -> Any:
    """This process as one that the configuration of the cluster was given to."""
    own = dask.config.collect(paths=[cluster.environment["DASK_CONFIG"]], env={})
    return dask.config.set(dask.config.merge(dask.config.config, own))


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Loopback]:
    """One that a test may do harm to."""
    folder = tmp_path / "cluster"
    folder.mkdir()
    started = Loopback(folder)
    with configured(started):
        yield started
    started.end()


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Loopback]:
    cluster = Loopback(tmp_path_factory.mktemp("cluster"))
    yield cluster
    cluster.end()


@pytest.fixture
def unharmed(started: Loopback) -> Iterator[Loopback]:
    """One for all tests that leave it as it is."""
    with configured(started):
        yield started


def job(lasts: float = 0.02, count: int = 211) -> Job:
    payload = {"seed": 8, "lasts": lasts}
    return Job(name="trial", work=spread_work.solutions, payload=payload, count=count, batch=6)


def test_the_manual_prints_a_scheduler_workers_and_a_command():
    assert [line.split()[:2] for line in PRINTED] == [
        ["openssl", "req"], ["dask", "scheduler"], ["dask", "worker"], ["flexstage", "tolerance"],
    ]  # fmt: skip


def test_the_commands_of_the_manual_give_what_one_process_gives(unharmed):
    shared = unharmed.run(*unharmed.command, "--json", "--quiet")
    assert shared.returncode == 0, shared.stderr
    assert shared.stderr == ""
    scheduler = unharmed.command.index("--scheduler")
    words = unharmed.command[:scheduler] + unharmed.command[scheduler + 2 :]
    alone = unharmed.run(*words, "--workers", "1", "--json", "--quiet")
    assert alone.returncode == 0, alone.stderr
    one, other = json.loads(alone.stdout), json.loads(shared.stdout)
    for result in (one, other):
        result["provenance"].pop("created")
    assert one == other


def test_a_killed_worker_changes_nothing(cluster):
    gone = []

    def kill_one(what, done):
        if done > 0.3 and not gone:
            gone.append(cluster.processes()[0])
            gone[0].kill()

    with open_workers(scheduler=cluster.address) as workers, listen(kill_one):
        found = workers.run(job())
    assert gone
    expected = spread_work.solutions({"seed": 8}, 0, 211)
    assert all(found[name].tobytes() == values.tobytes() for name, values in expected.items())


def test_a_lost_scheduler_is_a_sentence_and_the_run_goes_on_later(cluster, tmp_path):
    keep = tmp_path / "kept"

    def end_it(what, done):
        if done > 0.3:
            cluster.scheduler.kill()

    connection = f"the connection to the scheduler at {cluster.address}"
    lost = rf"{connection} was lost; \d+ of 36 batches are stored in {keep}"
    with (
        pytest.raises(WorkerError, match=lost),
        open_workers(scheduler=cluster.address) as workers,
        listen(end_it),
    ):
        workers.run(job(0.1), keep)
    done = len(list(keep.glob("batch-*.npz")))
    assert 10 < done < 36
    found = {}
    with open_workers(1) as workers, listen(found.setdefault):
        workers.run(job(0.1), keep)
    assert next(iter(found)) == f"trial, {done} of 36 batches"


def test_without_workers_it_waits_and_says_so(cluster):
    words = cluster.end_workers()
    said = []

    def heard(what, done):
        if "no worker is connected" in what and said.count(what) == 0:
            cluster.workers = cluster.start(words)
        said.append(what)

    time.sleep(0.5)
    with open_workers(scheduler=cluster.address) as workers, listen(heard):
        assert len(workers.run(job(0.0, 12))["energy"]) == 12
    assert any("no worker is connected, waiting for one" in what for what in said)


def test_other_versions_are_refused(unharmed, monkeypatch):
    own = cluster_module.versions()
    monkeypatch.setattr(cluster_module, "versions", lambda: {**own, "numpy": "1.9.9"})
    has = f"the scheduler has numpy {own['numpy']} and this computer numpy 1.9.9: .* install the"
    with (
        pytest.raises(WorkerError, match=has),
        open_workers(scheduler=unharmed.address) as workers,
    ):
        workers.run(job())


def test_a_worker_of_another_version_that_joins_later_is_refused(cluster):
    (cluster.folder / "older.py").write_text(
        "from flexstage.base import version\nversion.__version__ = '0.0.9'\n"
    )
    cluster.workers = cluster.start([*cluster.end_workers(), "--preload", "older.py"])
    with (
        pytest.raises(WorkerError, match=r"worker tls\S+ has flexstage 0\.0\.9 and this computer"),
        open_workers(scheduler=cluster.address) as workers,
    ):
        workers.run(job())


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("tcp://127.0.0.1", "missing port number"),
        ("http://127.0.0.1:80", "unknown address scheme 'http'"),
        ("tls://127.0.0.1:8786", "needs certificates"),
        ("tcp://127.0.0.1:1", "Timed out|no answer of Dask"),
    ],
)
def test_an_address_without_a_scheduler_is_a_sentence(address, said, monkeypatch):
    monkeypatch.setattr(cluster_module, "_TIMEOUT", 0.5)
    with (
        dask.config.set({"distributed.comm.require-encryption": False}),
        pytest.raises(WorkerError, match=f"no Dask scheduler answers at {address}: .*({said})"),
        open_workers(scheduler=address) as workers,
    ):
        workers.run(job())


@pytest.mark.parametrize("demanded", [None, True])
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "ws://127.0.0.1:8786"])
def test_an_address_that_is_not_encrypted_is_refused(address, demanded):
    with (
        pytest.raises(WorkerError, match=f"^{address} is not encrypted: .* give its tls://"),
        dask.config.set({"distributed.comm.require-encryption": demanded}),
        open_workers(scheduler=address) as workers,
    ):
        workers.run(job())


def test_who_has_no_certificate_is_not_let_in(unharmed):
    address = unharmed.address.replace("tls://", "tcp://")
    # the scheduler listens by TLS alone: another client gets no word of it
    with (
        pytest.raises(WorkerError, match=f"no Dask scheduler answers at {address}"),
        dask.config.set({"distributed.comm.require-encryption": False}),
        open_workers(scheduler=address) as workers,
    ):
        workers.run(job())


def test_what_is_no_scheduler_is_a_sentence(unharmed, monkeypatch):
    """A server of another kind, which says nothing, and a worker."""
    monkeypatch.setattr(cluster_module, "_TIMEOUT", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"tls://127.0.0.1:{silent.getsockname()[1]}"
        with (
            pytest.raises(WorkerError, match="no answer of Dask"),
            open_workers(scheduler=address) as workers,
        ):
            workers.run(job())


def test_a_cluster_that_says_nothing_more_does_not_hold_up_ctrl_c(unharmed, monkeypatch):
    silent, answered = threading.Event(), []
    monkeypatch.setattr(
        cluster_module.Client, "unregister_worker_plugin",
        lambda *_: answered.append(silent.wait(300.0)),
    )  # fmt: skip

    def interrupt(what, done):
        if done > 0.1:
            # not earlier, as a computer with other work connects slowly
            monkeypatch.setattr(cluster_module, "_TIMEOUT", 0.5)
            raise KeyboardInterrupt

    with (
        pytest.raises(KeyboardInterrupt),
        open_workers(scheduler=unharmed.address) as workers,
        listen(interrupt),
    ):
        workers.run(job())
    assert not answered
    silent.set()


def test_ctrl_c_is_left_to_the_cluster(unharmed, tmp_path):
    """A command that is interrupted leaves the workers to others."""
    words = [
        "flexstage", "tolerance", "vgtu-piezo", "--samples", "2000000", "--scheduler",
        unharmed.address, "--folder", str(tmp_path / "made"), "--model", "lumped",
    ]  # fmt: skip
    process = subprocess.Popen(
        words, env={**unharmed.environment, "PYTHONFAULTHANDLER": "1"},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        cwd=tmp_path, start_new_session=True,
    )  # fmt: skip
    batches = tmp_path / "made" / "unfinished"
    deadline = time.monotonic() + 300.0
    while len(list(batches.glob("batch-*.npz"))) < 3 and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    try:
        _, said = process.communicate(timeout=300.0)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)  # where it stands still
        pytest.fail(process.communicate()[1])
    assert process.returncode == 130
    assert "Traceback" not in said
    assert said.splitlines()[-1] == "flexstage: interrupted"
    assert len(list(batches.glob("batch-*.npz"))) >= 3
    with open_workers(scheduler=unharmed.address) as workers:
        assert len(workers.run(job(0.0, 30))["energy"]) == 30
