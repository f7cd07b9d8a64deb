"""The twin in real time under load: eight clients read while one runs a waveform."""

import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from flexstage.instruments.pi.simulated.clock import Pacemaker
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.server import GcsServer
from flexstage.stage.designs import design
from flexstage.virtual.build import virtual_stage

pytestmark = [pytest.mark.slow, pytest.mark.alone]

READERS, RATE_HZ, SECONDS = 8, 100, 4.0
#: Table samples, samples of the loop that each lasts, and how often the table is run.
POINTS, DIVIDER, CYCLES = 500, 20, 2

#: A client in a process of its own, as clients are: it asks for both positions at its rate, and
#: prints how many answers came and the longest time that one took.
READER = """
import socket, sys, time
port, rate, seconds = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
link = socket.create_connection(("127.0.0.1", port), timeout=5.0)
link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
count, worst, start = 0, 0.0, time.monotonic()
while count < rate * seconds:
    time.sleep(max(0.0, start + count / rate - time.monotonic()))
    asked = time.monotonic()
    link.sendall(b"POS?\\n")
    answer = b""
    while answer.count(b"\\n") < 2:
        answer += link.recv(4096)
    assert answer.startswith(b"1=")
    worst = max(worst, time.monotonic() - asked)
    count += 1
print(count, worst, time.monotonic() - start)
"""


class Client:
    """A line-by-line client with a time-out."""

    def __init__(self, port: int) -> None:
        self._link = socket.create_connection(("127.0.0.1", port), timeout=20.0)
        self._link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._file = self._link.makefile("rb")

    def tell(self, *lines: str) -> None:
        self._link.sendall(("\n".join(lines) + "\nERR?\n").encode())
        assert self._file.readline() == b"0\n", lines

    def ask(self, line: str) -> list[str]:
        self._link.sendall(f"{line}\n".encode())
        lines = []
        while True:
            line = self._file.readline().decode().rstrip("\n")
            lines.append(line.rstrip())
            if not line.endswith(" "):
                return lines

    def close(self) -> None:
        self._file.close()
        self._link.close()


@pytest.fixture
def twin():
    controller = VirtualController(virtual_stage(design("vgtu-piezo"), model="lumped", seed=2))
    pace = Pacemaker(controller)
    server = GcsServer(Interpreter(controller, pace))
    server.start()
    yield controller, pace, server
    server.close()


def test_eight_readers_cost_the_waveform_no_sample_and_no_time(twin) -> None:
    controller, pace, server = twin
    port = server.address[1]
    table = 40.0 - 40.0 * np.cos(2.0 * np.pi * np.arange(POINTS) / POINTS)
    client = Client(port)
    samples = POINTS * DIVIDER * CYCLES
    for first in range(0, POINTS, 20):
        part = " ".join(f"{v:.6f}" for v in table[first : first + 20])
        sign = "X" if first == 0 else "&"
        client.tell(f"WAV 1 {sign} PNT {first + 1} 20 {part}")
    client.tell("WTR 0 20 1", "WSL 1 1", f"WGC 1 {CYCLES}", "RTR 1")
    # the waveform begins at 0 V, and its zero left the axis elsewhere
    client.tell("SVA 1 0")
    time.sleep(0.1)
    # what is recorded: the voltage at the stack of axis 1, and the reading of its sensor
    client.tell("DRC 1 1 7", "DRC 2 1 2", "DRT 0 1 0")
    before, began = controller.now, time.monotonic()
    late, lost = pace.late, pace.lost
    readers = [
        subprocess.Popen(
            [sys.executable, "-c", READER, str(port), str(RATE_HZ), str(SECONDS)],
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(READERS)
    ]
    try:
        time.sleep(0.5)
        client.tell("WGO 1 1")
        while int(client.ask("\x09")[0], 16):
            time.sleep(0.02)
        heard = [reader.communicate(timeout=30.0)[0].split() for reader in readers]
    finally:
        for reader in readers:
            reader.kill()
    simulated, real = controller.now - before, time.monotonic() - began
    # simulated time went with real time: within the tick of 5 ms and the scheduling of one command
    assert abs(simulated - real) < 0.1
    assert pace.lost == lost
    # a tick is late when other programs hold both cores; here it must be the exception
    assert pace.late - late < 0.05 * real / 5e-3
    for count, worst, took in heard:
        assert int(count) == RATE_HZ * SECONDS
        assert float(took) < SECONDS + 0.5
        assert float(worst) < 0.5
    # every sample of the waveform was run, and recorded, at the period of the loop
    header = client.ask(f"DRR? 1 {samples} 1 2")
    rows = np.array([line.split() for line in header if line and line[0] != "#"], dtype=float)
    assert rows.shape == (samples, 2)
    step = next(line for line in header if "SAMPLE_TIME" in line).split("=")[1]
    assert float(step) == pytest.approx(1.0 / controller.sample_rate_hz, rel=1e-6)
    client.close()
    wanted = np.interp(
        np.arange(samples) / DIVIDER % POINTS, np.arange(POINTS + 1), np.append(table, table[0])
    )
    # the amplifier follows with a lag of 80 us: the voltage is the table so much later, to within
    # the curvature of the cosine
    at = np.arange(200, samples)
    slopes = np.gradient(wanted) * controller.sample_rate_hz
    delay = np.polyfit(slopes[at], (wanted - rows[:, 0])[at], 1)[0]
    left = (wanted - rows[:, 0] - delay * slopes)[at]
    assert 0.0 < delay < 5e-4
    # a sample that was left out or run twice would leave a step of one sample's slope, for good
    assert np.abs(left).max() < 0.5 * np.abs(slopes).max() / controller.sample_rate_hz
