"""A writer that is killed at any moment: all that it had acknowledged can be read.

Evidence (Instruments, twin, control): 50 kills (acknowledged samples): complete [*evidence*]
"""

import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

from flexstage.instruments.recording.archive import examine, recover
from tests.recordings import assert_true
from tests.tiers import sizes

ROOT = Path(__file__).parents[2]
CHILD = """
import os, sys
from tests.recordings import truth, writer
run = writer(sys.argv[1], sync=float(sys.argv[2]))
first, count = 0, 1
block = truth(0, 400_000)
while first + 300 < 400_000:
    run.append(first, {name: v[first : first + count] for name, v in block.items()})
    first += count
    os.write(1, b"%d\\n" % first)  # only after the samples are with the system
    count = count * 7 % 293 + 1
"""


def killed(path, sync, moment):
    """Run a writer, kill it some time after its first chunk; return what it had acknowledged."""
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path), str(sync)], cwd=ROOT, stdout=subprocess.PIPE
    )
    assert child.stdout is not None
    try:
        line = child.stdout.readline()
        assert line == b"1\n"
        time.sleep(moment)
    finally:
        child.kill()
        rest = child.stdout.read()
        child.stdout.close()
        child.wait(30)
    whole = [int(word) for word in rest.split(b"\n")[:-1]]
    return whole[-1] if whole else 1


def check(path, acknowledged):
    found = examine(path)
    # the child may have written a chunk that it did not live to acknowledge
    assert found.samples >= acknowledged
    assert found.samples - acknowledged <= 293
    assert not found.lost
    assert found.damaged_bytes == found.tail_bytes
    if found.samples >= 2:
        record, _ = recover(path)
        assert_true(record, range(found.samples))


def test_killed_at_three_moments(tmp_path):
    for k, moment in enumerate((0.0, 0.004, 0.02)):
        path = tmp_path / f"{k}.stream"
        check(path, killed(path, 0.01, moment))


@pytest.mark.parametrize("kills", sizes(slow=12, evidence=50))
def test_killed_at_random_moments(tmp_path, kills):
    draw = random.Random(20_310_517)
    reached = []
    for k in range(kills):
        path = tmp_path / f"{k}.stream"
        acknowledged = killed(path, draw.choice((0.0, 0.002, 0.5)), draw.uniform(0.0, 0.06))
        check(path, acknowledged)
        reached.append(acknowledged)
        path.unlink()
    # the moments are spread: most children were in the midst of their work
    assert len(set(reached)) > kills // 2
