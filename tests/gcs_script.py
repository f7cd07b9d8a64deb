"""A controller by script: answers as a PI controller would, in memory or behind a socket, and errs
on demand. It knows nothing of the simulated controller of the package."""

import re
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

HDR = (
    "#RecordOptions|0=Nothing is recorded|1=Target Position of axis|2=Current Position of axis|"
    "7=Control Voltage of output chan|16=Voltage of output chan|19=Sensor ElecLinear of input chan|"
    "20=Sensor MechLinear of input chan|22=Slowed Target position of axis|#TriggerOptions|"
    "0=Default Setting|1=Any CMD Changing Pos|3=External Trigger|4=Immediate Trigger|"
    "#Parameters to be set with SPA|0x16000000=Data Recorder Table Rate|"
    "#Additional information|3 record tables|end of help"
)
PARAMETERS = {
    0x07000300: ("Servo Loop P-Term", {"1": "0.02", "2": "0.02", "3": "0.02"}),
    0x0E000200: ("Servo Update Time", {"1": "5.0000e-05"}),
    0x13000004: ("Max Wave Points", {"1": "4000"}),
    0x1300010A: ("Number Of Waves", {"1": "6"}),
    0x16000200: ("Data Recorder Max Points", {"1": "6000"}),
    0x16000201: ("Data Recorder Points Per Table", {"1": "2000"}),
}
COMMANDS = (
    "#5 #9 #24 *IDN? CSV? DRC DRL? DRR? DRT ERR? GWD? HDR? HLP? HPA? MOV MOV? ONT? POS? PUN? RTR "
    "RTR? SAI? SPA SPA? STP SVA SVA? SVO SVO? TMN? TMX? TNR? TPC? TSC? TSP? VMA? VMI? VOL? WAV WCL "
    "WGC WGO WSL WTR"
)


class ScriptedController:
    """Three piezo axes: 1 and 2 of the stage, 3 of something else.

    `faults` maps a command to what is said instead of the right answer, once: bytes, or a function
    of the right answer that returns bytes or None. `log` holds whatever came, line by line.
    """

    def __init__(self, *, unit: str = "um", commands: str = COMMANDS):
        self.unit, self.commands = unit, commands.split()
        self.identity = "(c) Maker GmbH, P-727.3, 117, 9.31"
        self.log: list[str] = []
        self.faults: dict[str, bytes | Callable[[bytes], bytes | None]] = {}
        self.parameters = {key: (name, dict(v)) for key, (name, v) in PARAMETERS.items()}
        self.low: dict[str, float] = {"1": -5.0, "2": 2.5, "3": 0.0}
        self.high: dict[str, float] = {"1": 95.0, "2": 88.25, "3": 10.0}
        self.volts = (-20.0, 110.0)
        self.gain = 1.0  # volts at the drive by number of SVA
        self.scale = 1.0  # of points that are written to wave tables
        self.arrives = True  # axes come to their targets
        self.sample_time = 5e-5
        self.connections = 0
        self.power_on()

    def power_on(self) -> None:
        self.error = 0
        self.servo = dict.fromkeys("123", False)
        self.target = dict.fromkeys("123", 0.0)
        self.sva = dict.fromkeys("123", 0.0)
        self.waves: dict[str, list[float]] = {}
        self.running, self.moving = 0, 0
        self.rate, self.recorded = 1, 0
        self._part = bytearray()

    # in memory ----------------------------------------------------------------------------------

    def take(self, data: bytes) -> bytes:
        """Return what is said to some bytes."""
        said = bytearray()
        for byte in data:
            char = bytes([byte])
            if char in b"\x05\x07\x09\x18":
                said += self._say(f"#{byte}")
            elif char == b"\n":
                line, self._part = self._part.decode("ascii"), bytearray()
                said += self._say(line)
            else:
                self._part += char
        return bytes(said)

    def _say(self, line: str) -> bytes:
        self.log.append(line)
        words = line.split()
        answer = self._answer(words[0], words[1:])
        said = b"" if answer is None else (" \n".join(answer) + "\n").encode("latin-1")
        key = line if line in self.faults else words[0]
        if key not in self.faults:
            return said
        fault = self.faults.pop(key)
        found = fault(said) if callable(fault) else fault
        return b"" if found is None else found

    def _answer(self, name: str, words: list[str]) -> Sequence[str] | None:
        if name not in self.commands and name != "ERR?":
            return self._refuse(2)
        plain = _PLAIN.get(name)
        if plain is not None:
            return plain(self)
        if name in _OF_AXES:
            return [f"{w}={_OF_AXES[name](self, w)}" for w in words]
        if name in _SILENT:
            return None
        return getattr(self, "_do_" + re.sub(r"\W", "_", name))(words)

    def _refuse(self, code: int) -> None:
        self.error = code

    def help(self) -> list[str]:
        known = [f"{name} says something" for name in self.commands]
        return ["The following commands are valid:", *known, "end of help"]

    def listing(self) -> list[str]:
        return [
            "The following parameters are valid:",
            *(f"0x{k:X}=0\t{len(v)}\tFLOAT\tGroup\t{n}" for k, (n, v) in self.parameters.items()),
            "end of help",
        ]

    def _do_ERR_(self, _):
        code, self.error = self.error, 0
        return [str(code)]

    def _do__24(self, _):
        self.error, self.running, self.moving = 10, 0, 0
        self.target = {a: v + 0.125 for a, v in self.target.items()}

    def _do_STP(self, _):
        self._do__24(_)

    def _do_SPA_(self, words):
        return [f"{words[0]} {words[1]}={self.parameters[int(words[1], 0)][1][words[0]]}"]

    def _do_SPA(self, words):
        for item, key, value in zip(words[::3], words[1::3], words[2::3], strict=True):
            self.parameters[int(key, 0)][1][item] = value

    def _do_SVO(self, words):
        self.servo[words[0]] = words[1] == "1"

    def _do_MOV(self, words):
        axis, value = words[0], float(words[1])
        if not self.servo[axis]:
            return self._refuse(5)
        if not self.low[axis] <= value <= self.high[axis]:
            return self._refuse(7)
        self.target[axis] = value
        return None

    def _do_SVA(self, words):
        if self.servo[words[0]]:
            return self._refuse(303)
        self.sva[words[0]] = float(words[1])
        return None

    def _do_WAV(self, words):
        points = [float(w) * self.scale for w in words[5:]]
        assert words[2] == "PNT"
        assert len(points) == int(words[4])
        if words[1] == "X":
            self.waves[words[0]] = points
        else:
            assert int(words[3]) == len(self.waves[words[0]]) + 1
            self.waves[words[0]] += points

    def _do_WCL(self, words):
        self.waves.pop(words[0], None)

    def _do_GWD_(self, words):
        first, count = int(words[0]) - 1, int(words[1])
        return self._array([self.waves[w][first : first + count] for w in words[2:]])

    def _do_WGO(self, words):
        for generator, mode in zip(words[::2], words[1::2], strict=True):
            if mode == "1" and generator not in self.waves:
                return self._refuse(401)
            bit = 1 << int(generator) - 1
            self.running = self.running | bit if mode == "1" else self.running & ~bit
        if self.running:
            self.recorded = 50
        return None

    def _do_DRT(self, words):
        if words[1] == "4":
            self.recorded = 50

    def _do_RTR(self, words):
        self.rate = int(words[0])

    def _do_DRR_(self, words):
        first, count = int(words[0]), int(words[1])
        # column t, row k of a record: t + k/1000
        columns = [[int(t) + (first + k) / 1000 for k in range(count)] for t in words[2:]]
        return self._array(columns, self.sample_time * self.rate)

    def _array(self, columns: Sequence[Sequence[float]], step: float = 5e-5) -> list[str]:
        head = ["REM made by script", "VERSION = 1", "TYPE = 1", "SEPARATOR = 32"]
        head += [f"DIM = {len(columns)}", f"SAMPLE_TIME = {step:.9f}", f"NDATA = {len(columns[0])}"]
        head += [f"NAME{j} = column {j}" for j in range(len(columns))] + ["END_HEADER"]
        rows = [" ".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True)]
        return [f"# {line}" for line in head] + rows


_SILENT = ("DRC", "WSL", "WGC", "WTR", "WOS")
_PLAIN: dict[str, Callable[[ScriptedController], Sequence[str]]] = {
    "*IDN?": lambda c: [c.identity],
    "CSV?": lambda c: ["2.0"],
    "HLP?": ScriptedController.help,
    "HPA?": ScriptedController.listing,
    "HDR?": lambda c: HDR.split("|"),
    "SAI?": lambda c: ["1", "2", "3"],
    "TPC?": lambda c: ["3"],
    "TSC?": lambda c: ["4"],
    "TNR?": lambda c: ["3"],
    "RTR?": lambda c: [str(c.rate)],
    "#5": lambda c: [f"{c.moving:X}"],
    "#9": lambda c: [f"{c.running:X}"],
}
_OF_AXES: dict[str, Callable[[ScriptedController, str], object]] = {
    "PUN?": lambda c, a: c.unit,
    "TMN?": lambda c, a: f"{c.low[a]:.9e}",
    "TMX?": lambda c, a: f"{c.high[a]:.9e}",
    "VMI?": lambda c, a: f"{c.volts[0]:.4f}",
    "VMA?": lambda c, a: f"{c.volts[1]:.4f}",
    "SVO?": lambda c, a: int(c.servo[a]),
    "ONT?": lambda c, a: int(c.arrives),
    "MOV?": lambda c, a: f"{c.target[a]:.9e}",
    "POS?": lambda c, a: f"{c.target[a] + 0.001:.9e}",
    "VOL?": lambda c, a: f"{c.sva[a] * c.gain:.6f}",
    "SVA?": lambda c, a: f"{c.sva[a]:.6f}",
    "TSP?": lambda c, a: f"{0.25 * int(a):.6f}",
    "DRL?": lambda c, a: c.recorded,
}


class InMemory:
    """A conversation with a script; what is said is there at once."""

    def __init__(self, controller: ScriptedController):
        self.controller, self.said, self.closed = controller, bytearray(), False
        self.sent: list[bytes] = []
        controller.connections += 1

    def send(self, data: bytes) -> None:
        self.sent.append(data)
        self.said += self.controller.take(data)

    def receive(self, timeout: float) -> bytes:
        said, self.said = bytes(self.said), bytearray()
        return said

    def another(self) -> "InMemory":
        return InMemory(self.controller)

    def close(self) -> None:
        self.closed = True


# behind a socket --------------------------------------------------------------------------------


class CutError(Exception):
    """Raised by a fault: the server cuts the connection."""


@contextmanager
def served(controller: ScriptedController) -> Iterator[int]:
    """Serve a script on a free port of the loopback; yields the port."""
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(0.02)
    ended = threading.Event()
    lock = threading.Lock()
    links: list[socket.socket] = []
    threads: list[threading.Thread] = []

    def talk(link: socket.socket) -> None:
        with link:
            link.settimeout(5.0)
            while not ended.is_set():
                try:
                    data = link.recv(65536)
                    if not data:
                        return
                    with lock:
                        said = controller.take(data)
                    if said:
                        link.sendall(said)
                except (OSError, CutError):
                    return

    def accept() -> None:
        while not ended.is_set():
            try:
                link, _ = listener.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            controller.connections += 1
            links.append(link)
            thread = threading.Thread(target=talk, args=(link,), daemon=True)
            threads.append(thread)
            thread.start()

    acceptor = threading.Thread(target=accept, daemon=True)
    acceptor.start()
    try:
        yield listener.getsockname()[1]
    finally:
        ended.set()
        acceptor.join(5.0)
        listener.close()
        for link in links:
            with suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)
        for thread in threads:
            thread.join(5.0)
