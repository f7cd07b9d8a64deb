"""A run over TCP that is killed at random moments: nothing is lost, and it is taken up again."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from flexstage.instruments.recording.archive import examine, recover
from flexstage.records import read_record
from tests.tiers import sizes

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")

TIMEOUT = 300.0
#: Cycles of which each takes 0.5 s of real time.
CYCLES = 16
PLAN = f"""\
plan: 1
stage: vgtu-piezo
sensors:
  x: {{channel: 1, calibration: 0.0005}}
steps:
  - {{name: loops, excite: {{kind: cycles, axis: x, rate: 2 Hz, cycles: {CYCLES}, shape: cosine}}}}
  - {{name: motion, measure: {{of: loops, test: motion, along: x}}}}
  - {{name: figures, characterise: {{of: [motion]}}}}
"""


@pytest.fixture
def twin():
    started = subprocess.Popen(
        [sys.executable, "-m", "flexstage", "twin", "vgtu-piezo", "--address", "0", "--json"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert started.stdout is not None
        said = ""
        while not said.rstrip().endswith("}"):
            line = started.stdout.readline()
            assert line, "the twin ended"
            said += line
        yield json.loads(said)
    finally:
        started.send_signal(signal.SIGINT)
        started.communicate(timeout=TIMEOUT)


def ask(port: int, line: str) -> str:
    with socket.create_connection(("127.0.0.1", port), timeout=TIMEOUT) as link:
        link.sendall(f"{line}\n".encode())
        with link.makefile("rb") as answers:
            said = answers.readline().decode()
            while said.endswith(" \n"):
                said += answers.readline().decode()
                if not said.endswith(" \n"):
                    break
    return said


def _written(stream) -> int | None:
    """When a stream was last written to; None where there is none."""
    with contextlib.suppress(FileNotFoundError):
        return stream.stat().st_mtime_ns
    return None


def _until(there, process) -> bool:
    """Wait; say whether it came before the process ended."""
    end = time.monotonic() + TIMEOUT
    while not there():
        if process.poll() is not None:
            return False
        assert time.monotonic() < end
        time.sleep(0.01)
    return True


@pytest.mark.parametrize("kills", sizes(slow=3, evidence=10))
def test_a_run_that_is_killed_again_and_again_ends_with_all_it_acquired(
    twin, tmp_path, kills: int
) -> None:
    port = int(twin["address"].rsplit(":", 1)[1])
    plan, out = tmp_path / "plan.yaml", tmp_path / "run"
    plan.write_text(PLAN)
    env = os.environ | {
        "FLEXSTAGE_STATE": str(tmp_path / "state"),
        "FLEXSTAGE_CATALOGUE": str(tmp_path / "catalogue.sqlite"),
    }
    words = [
        sys.executable, "-m", "flexstage", "run", str(plan), "--instrument",
        f"gcs://127.0.0.1:{port}", "--folder", str(out), "--yes",
    ]  # fmt: skip
    rng = np.random.default_rng(611)
    stream = out / "records" / "motion.stream"
    kept = []
    for k in range(kills):
        more = ["--resume"] if out.exists() else []
        stale = _written(stream)
        started = subprocess.Popen(
            [*words, *more], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env
        )
        try:
            fresh = _until(lambda old=stale: _written(stream) not in (None, old), started)
            assert fresh, started.communicate()[1]
            time.sleep(rng.uniform(0.0, 0.35 * CYCLES))
            size = stream.stat().st_size if stream.exists() else 0
        finally:
            started.kill()
            err = started.communicate(timeout=TIMEOUT)[1]
        assert "Traceback" not in err, err
        # end what runs on, as an operator would
        ask(port, "STP\nERR?")
        # the controller is there, and the stage holds or ends its waveform within its range
        volts = float(ask(port, "VOL? 1").split("=")[1])
        assert -1e-6 <= volts <= 120.0 + 1e-6
        if stream.exists():
            assert stream.stat().st_size >= size
            if examine(stream).samples < 2:
                continue
            # a chunk that was being written may be cut; all others are there
            record, found = recover(stream)
            assert found.samples == record.size
            read = record.channel("x").values
            assert np.all(np.isfinite(read))
            assert read.max() < 90e-6
            kept.append(record.size)
        assert not (out / "records" / "motion.h5").exists(), f"it ended before kill {k}"
    assert len(kept) >= kills // 3
    done = subprocess.run(
        [*words, "--resume", "--json"],
        capture_output=True, text=True, env=env, timeout=3 * TIMEOUT, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    partial = sorted((out / "records").glob("motion.partial-*.h5"))
    sizes = [read_record(p).size for p in partial]
    # every stream that held samples enough for a record was kept, whole
    assert sorted(s for s in sizes) == sorted(kept)
    whole = read_record(out / "records" / "motion.h5")
    assert whole.size > 500 * CYCLES
    figures = {f["quantity"]: f["value"] for f in json.loads(done.stdout)["figures"]}
    assert figures["output_displacement"] == pytest.approx(63.12e-6, rel=0.1)
