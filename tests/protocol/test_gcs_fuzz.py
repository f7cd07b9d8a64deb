"""Random and mutated lines: the simulated controller survives, and moves only when it is told to.

What a motion command is, and where it leads, is said here by a grammar of its own: regular
expressions on the whole line, without anything of the interpreter.

Evidence (Instruments, twin, control): a million random lines (separate grammar): no false motion,
*consistency* [*evidence*]
"""

import random
import re
import time

import pytest

from flexstage.instruments.pi.simulated.clock import FastTime
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.server import ServerSession
from tests.gcs_device import FormulaDevice
from tests.tiers import sizes

NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?"
PAIRS = re.compile(rf" *(MOV|MVR|SVA)((?: +[12] +{NUMBER})+) *\r?", re.IGNORECASE)
#: How a waveform is started or stopped, and the way to the zero of the sensors.
MODE = r"(?:0*(?:0|1|257)|0x0*(?:0|1|101))"
ZERO = rf" *ATZ(?: +[12] +(?:NAN|{NUMBER}))* *\r?"
OTHERS = {
    "waves": re.compile(rf" *WGO(?: +[12] +{MODE})+ *\r?", re.IGNORECASE),
    "servo": re.compile(rf" *SVO(?: +[12] +0*[01])+ *\r?|{ZERO}", re.IGNORECASE),
    "reboot": re.compile(r" *RBT *\r?", re.IGNORECASE),
    "strike": re.compile(r" *IMP +[12] *\r?", re.IGNORECASE),
    # whoever says STP wants it to stop, whatever else is said
    "stop": re.compile(
        rf" *(?:STP(?: .*)?|HLT(?: +[12])*|WGO(?: +[12] +{MODE})+|EAX(?: +[12] +0*[01])+) *\r?",
        re.IGNORECASE,
    ),
}
EXAMPLES = """\
*IDN?|CSV?|VER?|HLP?|HPA?|SPA?|SAI? ALL|TPC?|TSC?|ERR?|STP|HLT 1|SVO 1 1 2 1|SVO 2 0|SVO?
MOV 1 10 2 5.5|MOV 2 -3e0|MVR 1 0.5|MVR 2 -.25|MOV? 1|POS?|ONT? 1 2|VEL 1 500|VEL? 2|VOL?
SVA 1 20|SVA 2 3 1 7|SVA?|TMN?|TMX? 1|PUN?|VMI?|VMA?|NLM?|PLM?|FRF?|HDR?
DRC 1 1 1 2 1 2|DRC 3 3 20|DRT 0 1 0|DRT 0 0 0|DRT 0 4 0|DRR? 1 5 1 2|DRR? 1 1
DRL? 1|RTR 20|RTR?|TNR?|WAV 1 X SIN_P 200 10 5 200 0 100|WAV 2 X PNT 1 5 1 2 3 4 5
WAV 2 & PNT 6 2 5 6|WAV 3 X LIN 100 -4 10 90 5 20|WAV 1 X RAMP 50 2 0 50 0 5 25
WAV 4 X PNT 1 1 3|WCL 2|WSL 1 1 2 3|WSL 1 4|WGC 1 2|WGC 1 0|WGO 1 1
WGO 1 1 2 1|WGO 1 0|WGO?|WTR 0 3 1|GWD? 1 5 2|GWD?|TSP? 3|CST?
CCL 1 advanced|CCL?|SEP?|SPA 1 0x07000300 3|SPA 1 0x08000100 700 1 0x08000200 .1
SPA? 1 369099265|SPA 1 0x7F000003 1|SPA 1 0x7F000003 0|IMP 1|RBT|SPA 2 0x7F000011 3
SPA 1 0x7F000001 0.01|STP 1|ATZ|ATZ 1 NAN 2 5|ATZ?|WGO 1 0x101|WGO 2 257|WOS 1 2.5|OVF?
SRG? 1 1|TAD?|TNS? 3|IFC?|IFC? IPADR|SSN?|IDN?|AOS?|LIM?|TRS?|ONL 1 0|ONL 1 1 2 1|ONL?|EAX 1 0
EAX 1 1|EAX?|FRF 1|FNL|FPL 2|RON 1 0|RON?|DCO 1 1|DCO?|VCO 1 0|VCO 1 1|VCO?|VMA 1 90|VMI 1 2
NLM 1 3|PLM 1 55|TWC|TWS 1 10 1|CTO 1 3 4|CTO?|DRT 1 1 0 2 1 0|SPA 1 0x16000300 2"""
SEEDS = [line.encode() for line in EXAMPLES.replace("\n", "|").split("|")]
WORDS = [
    b"1",
    b"2",
    b"0",
    b"3",
    b"-1",
    b"1e9",
    b"nan",
    b"X",
    b"&",
    b"PNT",
    b"0x07000300",
    b"",
    b"?",
]


def mutated(rng):
    """A line of the grammar, changed in a few places; or noise."""
    draw = rng.random()
    if draw < 0.1:
        noise = rng.randbytes(rng.randrange(60))
        return noise.replace(b"\n", b"").replace(b"\x18", b"")
    line = bytearray(rng.choice(SEEDS))
    if draw < 0.35:
        return bytes(line)
    for _ in range(rng.randrange(1, 4)):
        kind, at = rng.randrange(6), rng.randrange(len(line) + 1)
        if kind == 0 and line:
            del line[at % len(line)]
        elif kind == 1:
            line[at:at] = bytes(
                [rng.choice(b" 0123456789.-+eE?*#XxMOVSAWGD\r\x00\x04\x05\x06\x07\x09\xff")]
            )
        elif kind == 2 and line:
            line[at % len(line)] = rng.randrange(32, 127)
        elif kind == 3:
            words = bytes(line).split(b" ")
            words[rng.randrange(len(words))] = rng.choice(WORDS)
            line = bytearray(b" ".join(words))
        elif kind == 4:
            line += b" " + rng.choice(WORDS)
        else:
            line = bytearray(bytes(line).swapcase())
    return bytes(line).replace(b"\n", b"").replace(b"\x18", b"")


def plain(line):
    """A line without the characters that are commands of their own; None where it is not ASCII."""
    text = line.translate(None, b"\x04\x05\x07\x09").lstrip(bytes(range(32)))
    text = text.removesuffix(b"\r")
    return text.decode("ascii") if all(32 <= byte < 127 for byte in text) else None


def allowed(line, call, before, running):
    """Say whether a line can have led to a call of the device."""
    text = plain(line)
    if text is None:
        return False
    kind = call if isinstance(call, str) else call[0]
    if kind in OTHERS:
        return OTHERS[kind].fullmatch(text) is not None
    if kind == "commands" and re.fullmatch(ZERO, text, re.IGNORECASE):
        return True
    found = PAIRS.fullmatch(text)
    if found is None:
        return False
    word = found[1].upper()
    if (kind == "targets") != (word in ("MOV", "MVR")):
        return False
    words = found[2].split()
    values = dict(zip(words[::2], map(float, words[1::2]), strict=True))
    scale = 1e-6 if kind == "targets" else 1.0
    relative = word == "MVR"
    if relative and running:  # the wave may have ended in the time of the command
        return set(call[1]) == set(values)
    wanted = {a: v * scale + (before[kind][a] if relative else 0.0) for a, v in values.items()}
    return len(words) == 2 * len(values) and all(
        abs(call[1][axis] - value) <= 1e-12 + 1e-9 * abs(value) for axis, value in wanted.items()
    )


def commanded(device):
    """What axes are told to do."""
    return {
        "targets": {axis: device.target(axis) for axis in device.axes},
        "commands": {axis: device.command(axis) for axis in device.axes},
    }


def told(device):
    """Where axes are led by what was commanded last."""
    return {
        axis: (state.servo, state.target, state.end, state.wave is None)
        for axis, state in device.state.items()
    }


def fuzz(count, seed):
    """Say random lines; return the time of each tenth of them [s], and the number of calls."""
    rng = random.Random(seed)
    device = FormulaDevice()
    interpreter = Interpreter(device, FastTime(device))
    session = ServerSession(interpreter)
    times, calls, answered = [], 0, 0
    for i in range(count):
        if i % (count // 10) == 0:
            times.append(-time.process_time())
        line = mutated(rng)
        before, was_told = commanded(device), told(device)
        running = any(device.wave_running(axis) for axis in device.axes)
        device.calls = []
        answer = session.feed(line + b"\n")
        answered += bool(answer)
        assert answer == b"" or answer.endswith(b"\n"), line
        for call in device.calls:
            calls += 1
            assert allowed(line, call, before, running), (line, call)
        # without a call, and without a wave that ends, an axis is told nothing new
        if not device.calls and not running:
            assert told(device) == was_told, line
        assert 0 <= session.error < 1000
        assert not session.busy
        if i % (count // 10) == count // 10 - 1:
            times[-1] += time.process_time()
    assert session.backlog == 0
    assert answered > count // 10
    return times, calls


def test_random_lines():
    _, calls = fuzz(8000, seed=11)
    assert calls > 200  # many a line was a motion command, and was carried out


@pytest.mark.parametrize("count", sizes(slow=100_000, evidence=1_000_000))
def test_many_random_lines(count):
    times, calls = fuzz(count, seed=5)
    assert calls > count // 50
    # a line at the end takes no longer than one at the start; the factor is for a busy computer
    assert min(times[-3:]) < 3.0 * min(times[:3])


def test_random_bytes_cut_anywhere():
    """The same bytes in other pieces give the same answers."""
    rng = random.Random(8)
    data = b"\n".join(mutated(rng) for _ in range(1200)) + b"\n"
    sessions = []
    answers = []
    for largest in (1 << 20, 1000, 7):
        device = FormulaDevice()
        sessions.append(ServerSession(Interpreter(device, FastTime(device))))
        cut = random.Random(largest)
        said, at = bytearray(), 0
        while at < len(data):
            size = cut.randrange(1, largest + 1)
            said += sessions[-1].feed(data[at : at + size])
            at += size
        answers.append(bytes(said))
    assert len(answers[0]) > 4000
    assert answers[1] == answers[0]
    assert answers[2] == answers[0]
    assert len({session.error for session in sessions}) == 1


@pytest.mark.parametrize("name", ["vgtu-piezo", "vgtu-mechanical"])
def test_random_lines_to_the_simulated_stage(name):
    """Nothing breaks down, and no command leaves the limits, with the real simulation below."""
    from flexstage.instruments.pi.simulated.controller import VirtualController
    from flexstage.stage.designs import design
    from flexstage.virtual.build import virtual_stage

    device = VirtualController(virtual_stage(design(name), model="lumped", seed=2))
    session = ServerSession(Interpreter(device, FastTime(device)))
    rng = random.Random(21)
    errors = set()
    for _ in range(700):
        line = mutated(rng)
        answer = session.feed(line + b"\n")
        assert answer == b"" or answer.endswith(b"\n"), line
        errors.add(session.error)
        for axis, description in device.axes.items():
            voltage = description.limits.voltage
            if voltage is not None:
                assert voltage[0] <= device.voltage(axis) <= voltage[1]
    # it was refused for many reasons, never for a simulation that broke down
    assert len(errors) > 10
    assert 333 not in errors
