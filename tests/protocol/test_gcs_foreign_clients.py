"""What drivers that others wrote send, byte for byte, and what of the answers they rely on.

The lines are facts of Odemis' pigcs.py, EPICS motorPIGCS2, ESRF Bliss' pi_*.py, PIPython, pylablib,
Micro-Manager's PI_GCS_2, an adaptor for the E-753, QCoDeS' Mercury, navigate and PyMoDAQ (both by
PIPython); none of their code is here.
`docs/explanation/twin.md` says which versions were run themselves.

Evidence (Instruments, twin, control): [the twin](../explanation/twin.md) (six drivers of others):
all but missing commands
"""

import re
import socket

import numpy as np
import pytest

from flexstage.files.request import request_fields
from flexstage.instruments.pi.connection import parse_identity
from flexstage.instruments.pi.simulated.clock import Pacemaker
from flexstage.instruments.pi.simulated.gcs_state import MODELS
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.server import GcsServer, ServerSession
from flexstage.instruments.requests import TwinRequest
from tests.gcs_device import RATE, FormulaDevice, controller, opened

NUMBER = rb"-?\d\.\d{9}e[+-]\d\d"
#: By client and the controller that it takes the twin for: what is sent, what must be answered.
CONVERSATIONS = {
    ("EPICS", "E-727"): [
        (b"*IDN?\n", rb"[^\n]*E-727[^\n]*\n"),
        (b"CSV?\n", rb"2\.0\n"),
        (b"VEL?\n", rb"1=" + NUMBER + rb" \n2=" + NUMBER + rb"\n"),
        (b"SAI?\n", rb"1 \n2\n"),
        (b"SVO 1 1\n", rb""),
        (b"ERR?\n", rb"0\n"),
        (b"TMN? 1\n", rb"1=-2\.0+e\+00\n"),
        (b"TMX? 1\n", rb"1=6\.0+e\+01\n"),
        (b"\x05", rb"0\n"),
        (b"SVO? 1\n", rb"1=1\n"),
        (b"POS? 1\n", rb"1=" + NUMBER + rb"\n"),
        (b"ONT? 1\n", rb"1=1\n"),
        (b"OVF? 1\n", rb"1=0\n"),
        (b"CCL 1 advanced\n", rb""),
        (b"SPA 1 117441280 0.5\n", rb""),
        (b"CCL 0\n", rb""),
        (b"SPA? 1 117441280\n", rb"1 117441280=5\.0+e-01\n"),
        (b"VEL 1 500.000000\n", rb""),
        (b"MOV 1 12.500000\n", rb""),
        (b"ERR?\n", rb"0\n"),
        (b"\x05", rb"[01]\n"),
        (b"STP\n", rb""),
        (b"ERR?\n", rb"10\n"),
        (b"FRF? 1\n", rb""),  # an E-727 has none of these, and its driver does not ask
        (b"ERR?\n", rb"2\n"),
    ],
    ("EPICS", "E-725"): [
        (b"TRS? 1\n", rb"1=0\n"),
        (b"FRF? 1\n", rb"1=1\n"),
        (b"SVO 1 1\n", rb""),
        (b"SRG? 1 1\n", rb"1 1=0x9000\n"),
        (b"ERR?\n", rb"0\n"),
    ],
    ("EPICS", "E-517"): [
        (b"TPC?\n", rb"2\n"),
        (b"ONL 1 1\n", rb""),
        (b"ONL 2 1\n", rb""),
        (b"ERR?\n", rb"0\n"),
    ],
    ("Micro-Manager", "E-517"): [
        (b"ONL 1 1 2 1\n", rb""),
        (b"ERR?\n", rb"0\n"),
        (b"\x07", rb"\xb1\n"),
        (b"POS? 1 2\n", rb"1=" + NUMBER + rb" \n2=" + NUMBER + rb"\n"),
        (b"SVO 1 1\nSVO 2 1\n", rb""),
        (b"MOV 1 12.5 2 3\n", rb""),
        (b"HLT 1\n", rb""),
        (b"ERR?\n", rb"10\n"),
    ],
    ("Odemis", "E-725"): [
        (b"*IDN?\n", rb".*Physik Instrumente.*,.*E-725.*\n"),
        (b"ATZ? 1\n", rb"1=1\n"),
        (b"SPA? 1 117442049\n", rb"1 117442049=um\n"),
        (b"ERR?\n", rb"0\n"),
        (b"\x05", rb"0\n"),
        (b"\x04", rb"0x[0-9A-F]{8}\n"),
        (b"SPA? 1 117442049\n", rb"1 117442049=um\n"),  # and the line behind it is whole
        (b"ATZ\n", rb""),
        (b"ERR?\n\x05", rb"0\n0\n"),
        (b"SVO 1 1\n", rb""),
        (b"MOV 1 38.08087\n", rb""),
        (b"\x18", rb""),
        (b"ERR?\n", rb"10\n"),
    ],
    ("pylablib", "E-516"): [
        (b"SAI?\n", rb"12\n"),
        (b"ONL 1\n", rb""),
        (b"ONL?\n", rb"1\n"),
        (b"DCO? 1 2\n", rb"1=0 \n2=0\n"),
        (b"VCO? 1 2\n", rb"1=1 \n2=1\n"),
        (b"VMA? 1 2\n", rb"1=" + NUMBER + rb" \n2=" + NUMBER + rb"\n"),
        (b"SVO 1 1 2 1\n", rb""),
        (b"MOV 1 3.00000E+01\n", rb""),
        (b"STP 1 2\n", rb""),
        (b"\x05", rb"0\n"),  # they stand, though the line is refused
        (b"ERR?\n", rb"24\n"),
        (b"NLM 1 1.00000E+01\nPLM 1 4.00000E+01\n", rb""),
        (b"MOV 1 4.50000E+01\n", rb""),
        (b"ERR?\n", rb"7\n"),
    ],
    ("Bliss", "E-753"): [
        (b"SPA? 1 0xe000200\n", rb"1 0xe000200=1\.0+e-04\n"),
        (b"SPA? 1 0X07000900\n", rb"1 0X07000900=" + NUMBER + rb"\n"),
        (b"SEP? 1 0xffff0007\n", rb"1 0xffff0007=flexstage\n"),
        (b"IFC?  IPADR MACADR IPSTART\n", rb"IPADR=\S+ \nMACADR=\S+ \nIPSTART=0\n"),
        (b"SAI?\n", rb"1\n"),  # one axis, whatever stage it drives
        (b"TSP?\n", rb"1=" + NUMBER + rb" \n2=" + NUMBER + rb"\n"),
        (b"TAD?\n", rb"1=-?\d+ \n2=-?\d+\n"),
        (b"SPA 1 0x16000300 2\n", rb""),
        (b"TNR?\n", rb"2\n"),
        (b"DRC 1 1 1 2 1 2\n", rb""),
        (b"RTR 2\n", rb""),
        (b"DRT 1 1 0 2 1 0\n", rb""),
        (b"ERR?\n", rb"0\n"),
        (b"SPA? 1 0xe000200\nRTR?\n", rb"1 0xe000200=" + NUMBER + rb"\n2\n"),
        (
            b"WSL 1 1\nWAV 1 X SIN_P 300 10.000000 0.000000 300 0 150\nWTR 0 1 1\nWGC 1 2\n"
            b"WGO 1 1\nERR?\n",
            rb"0\n",
        ),
    ],
    ("Bliss", "E-727"): [
        (b"IDN?\n", rb"[^\n]*E-727[^\n]*\n"),
        (b"ATZ? 1\n", rb"1=1\n"),
        (b"AOS? 1\n", rb"1=" + NUMBER + rb"\n"),
        (b"TAD? 1\n", rb"1=-?\d+\n"),
        (b"SPA? 1 0x7000000\n", rb"1 0x7000000=" + NUMBER + rb"\n"),
        (b"SPA? 1 0X7000901\n", rb"1 0X7000901=" + NUMBER + rb"\n"),
    ],
    ("Bliss", "E-712"): [
        (b"SVO 1 1 2 1\n", rb""),
        (b"CTO 1 2 1 1 3 3 1 5 10 1 6 20 1 7 1\n", rb""),
        (b"TWC\n", rb""),
        (b"WTR 0 1 1\n", rb""),
        (b"WGC 1 2\n", rb""),
        (b"WSL 1 1\n", rb""),
        (b"WOS 1 0\n", rb""),
        (b"WAV 1 X LIN 100 10.0 0.0 100 0 20\n", rb""),
        (b"TWS 1 10 1\n", rb""),
        (b"CTO 1 3 4\n", rb""),
        (b"MOV 1 0\n", rb""),
        (b"WGO 1 257\n", rb""),
        (b"ERR?\n", rb"0\n"),
        (b"\x09", rb"[01]\n"),
        (b"WGO 1 0\n", rb""),
        (b"ONT? 1 2\nMOV? 1 2\n\x18", rb"1=\d \n2=\d\n1=" + NUMBER + rb" \n2=" + NUMBER + rb"\n"),
        (b"ERR?\n", rb"10\n"),
    ],
    ("E-753 adaptor", "E-753"): [
        (b"SPA? 1 0x07000601\n", rb"1 0x07000601=\xb5M\n"),
        (b"CCL 1 advanced\nERR?\n", rb"0\n"),
        (b"SPA 1 0x06000500 0\nERR?\n", rb"0\n"),
        (b"SVO 1 1\nERR?\n", rb"0\n"),
        (b"MOV 1 30.000000000\nERR?\n", rb"0\n"),
        (b"\x05", rb"[01]\n"),
    ],
    ("QCoDeS Mercury", "C-863"): [
        (b"*IDN?\n", rb"[^\n]*C-863[^\n]*\n"),
        (b"SAI?\n", rb"1\n"),
        (b"SVO?\n", rb"1=1\n"),
        (b"FRF?\n", rb"1=0\n"),  # its axis has seen no switch yet, and takes no position
        (b"MOV 1 0.3\nERR?\n", rb"5\n"),
        (b"LIM? 1\nTRS? 1\n", rb"1=1\n1=1\n"),
        (b"FPL 1\n", rb""),
        (b"ONT?\n" * 99, rb"(1=[01]\n)*1=1\n"),
        (b"FRF?\nPOS?\nERR?\n", rb"1=1\n1=1\.0+e\+00\n0\n"),
        (b"FNL 1\n" + b"ONT?\n" * 99, rb"(1=[01]\n)*1=1\n"),
        (b"POS?\n", rb"1=0\.0+e\+00\n"),
        (b"TCV? 1\nVEL? 1\n", rb"1=1\.0+e-01\n1=1\.0+e-01\n"),
        (b"VEL 1 0.05\nVEL? 1\nVEL 1 0.2\nERR?\n", rb"1=5\.0+e-02\n8\n"),
        (b"MOV 1 0.3\nMOV?\n", rb"1=3\.0+e-01\n"),
        (b"STP\nERR?\n", rb"10\n"),
        (b"#4\nERR?\n", rb"2\n"),  # the characters, where one character is meant
    ],
    ("navigate", "C-884"): [
        (b"CST?\n", rb"1=x \n2=y\n"),
        (b"SVO 1 1 2 1\nRON 1 1 2 1\nFRF\nERR?\n", rb"0\n"),
        (b"\x07", rb"\xb1\n"),
        (b"ONT?\n" * 99, rb"(1=[01] \n2=[01]\n)*1=1 \n2=1\n"),
        (b"FRF?\nPOS? 1 2\n", rb"1=1 \n2=1\n1=5\.0+e-01 \n2=5\.0+e-01\n"),
        (b"MOV 1 0.15 2 0.08\nERR?\n", rb"0\n"),
        (b"ONT? 1 2\n" * 99, rb"(1=[01] \n2=[01]\n)*1=1 \n2=1\n"),
        (b"POS? 1 2\n", rb"1=1\.50+e-01 \n2=8\.0+e-02\n"),
    ],
    ("PyMoDAQ", "C-884"): [
        (b"SPA? 1 0x7000601\n", rb"1 0x7000601=mm\n"),
        (b"TMN? 1\nTMX? 1\n", rb"1=0\.0+e\+00\n1=1\.0+e\+00\n"),
        (b"RON 1 1\nFRF 1\n", rb""),
        (b"\x18ERR?\nFRF? 1\n", rb"10\n1=0\n"),  # one that was stopped is no reference
        (b"FRF 1\n" + b"ONT? 1\n" * 99, rb"(1=[01]\n)*1=1\n"),
        (b"DFH 1\nMOV 1 0.1\nMVR 1 -0.025\nMOV? 1\nGOH 1\nMOV? 1\n",
         rb"1=7\.50+e-02\n1=5\.0+e-01\n"),
        (b"ACC 1 2.5\nACC? 1\nDEC? 1\n", rb"1=2\.50+e\+00\n1=1\.0+e\+00\n"),
        (b"RON 2 0\nFRF? 2\nMOV 2 0.2\nERR?\n", rb"2=1\n0\n"),  # one that needs none
        (b"WAV? 1\nERR?\nSVA? 1\nERR?\n", rb"2\n2\n"),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("client", "model"), CONVERSATIONS)
def test_a_conversation_of_another_client(client, model):
    session = opened("screw" if MODELS[model].motor else "piezo", model=MODELS[model])
    for sent, wanted in CONVERSATIONS[client, model]:
        answer = session.feed(sent)
        assert re.fullmatch(wanted, answer) is not None, (sent, answer)


@pytest.mark.parametrize("name", MODELS)
def test_every_identity_says_that_it_is_simulated(name):
    session = opened(model=MODELS[name])
    said = parse_identity(session.feed(b"*IDN?\n").decode())
    assert said.simulated
    assert (said.model, said.serial_number, said.firmware) == (name, "7", "1.2")
    assert re.search(f"Physik Instrumente.*,.*{name}", session.feed(b"*IDN?\n").decode())


@pytest.mark.parametrize("name", MODELS)
def test_help_lists_what_the_model_knows_and_nothing_else(name):
    model = MODELS[name]
    session = opened(model=model)
    listed = {line.split(" ")[0] for line in session.feed(b"HLP?\n").decode().split(" \n")}
    assert not model.lacks & listed
    assert model.lacks <= set(controller().commands)
    for command in sorted(model.lacks):
        assert session.feed(command.encode() + b"\n") == b""
        assert session.feed(b"ERR?\n") == b"2\n"


def test_the_command_line_offers_every_model():
    offered = request_fields(TwinRequest)["identity"].words
    assert {*MODELS, "flexstage"} == set(offered)


def test_an_offset_is_added_to_a_waveform():
    session = opened()
    session.feed(b"SVO 1 1\nWOS 1 2.5\nWAV 1 X PNT 1 3 0 4 10\nWSL 1 1\nMOV 1 2.5\nONT?\n")
    assert session.feed(b"WGO 1 1\nWGO?\nPOS? 1\nERR?\n").endswith(b"1=1.250000000e+01\n0\n")
    # an axis with another offset cannot run the same table with it
    session.feed(b"WSL 2 1\nSVO 2 1\n")
    assert session.feed(b"WGO 1 1 2 1\nERR?\n") == b"405\n"


def test_a_soft_limit_holds_a_waveform_too():
    session = opened()
    session.feed(b"SVO 1 1\nPLM 1 8\nWAV 1 X LIN 10 9 0 10 0 0\nWSL 1 1\n")
    assert session.feed(b"WGO 1 1\nERR?\nWGO?\n") == b"7\n1=0 \n2=0\n"


def test_an_axis_on_its_way_to_its_zero_says_so():
    device = FormulaDevice()
    interpreter = Interpreter(device, Pacemaker(device))  # nothing passes but by hand
    session = ServerSession(interpreter)
    device.set_commands({"1": 100.0, "2": 50.0})
    device.advance(1.0)
    assert session.feed(b"ATZ\nATZ?\n\x05SVO?\n") == b"1=0 \n2=0\n3\n1=0 \n2=0\n"
    device.advance(1.0)
    assert session.feed(b"ATZ?\nVOL?\n\x05") == (
        b"1=1 \n2=1\n1=0.000000000e+00 \n2=0.000000000e+00\n0\n"
    )
    # another ramp of the voltage is none to the zero
    assert session.feed(b"SVA 1 90\nATZ? 1\n\x05") == b"1=1\n1\n"


@pytest.mark.parametrize(
    ("off", "on", "number"), [("EAX 1 0", "EAX 1 1", b"84\n"), ("ONL 1 0", "ONL 1 1", b"34\n")]
)
def test_an_axis_that_is_off_takes_no_motion(off, on, number):
    session = opened()
    session.feed(f"SVO 1 1\n{off}\n".encode())
    assert session.feed(b"MOV 1 5\nERR?\nMOV? 1\n") == number + b"1=0.000000000e+00\n"
    assert session.feed(f"{on}\nMOV 1 5\nERR?\n".encode()) == b"0\n"


def test_without_control_of_speed_a_move_is_as_fast_as_the_axis():
    session = opened()
    session.feed(b"SVO 1 1\nVEL 1 1\nVCO 1 0\nMOV 1 10\nPOS? 1\n")
    assert session.feed(b"POS? 1\n") == b"1=4.000000000e+00\n"  # 2 um each command of 1 ms
    session.feed(b"ONT?\nVCO 1 1\nMOV 1 20\n")
    assert session.feed(b"POS? 1\n") == b"1=1.000100000e+01\n"  # 1 um/s for 1 ms


def test_parameters_have_a_tab_behind_the_number():
    """PIPython takes the fourth word for the type; Odemis' example shows the tab."""
    lines = opened().feed(b"HPA?\n").decode().split(" \n")[1:-1]
    assert {line.split()[3] for line in lines} == {"INT", "FLOAT", "CHAR"}


def test_a_record_of_the_error_is_what_is_still_to_go():
    session = opened(model=MODELS["E-709"])
    assert session.feed(b"SAI?\nTPC?\nPOS? 2\nERR?\n") == b"1\n1\n15\n"
    session.feed(b"SVO 1 1\nMOV 1 5\nONT? 1\nDRC 1 1 3\nDRT 0 1 0\nMOV 1 9\nONT? 1\n")
    rows = session.feed(b"DRR? 1 3 1\n").decode().split("\n")[-4:-1]
    # of 4 um 3.8, 3.6, 3.4 are still to go: 2 mm/s in samples of 0.1 ms
    np.testing.assert_allclose([float(row) for row in rows], [3.8, 3.6, 3.4], rtol=1e-9)


class Socket:
    """A client in the network, as simple as most are."""

    def __init__(self, address):
        self.link = socket.create_connection(address, timeout=300.0)
        self.came = b""

    def ask(self, text):
        self.link.sendall(text.encode() + b"\n")
        if "?" not in text:
            return []
        lines = []
        while True:
            while b"\n" not in self.came:
                self.came += self.link.recv(65536)
            line, _, self.came = self.came.partition(b"\n")
            lines.append(line.decode("latin-1").strip())
            if not line.endswith(b" "):
                return lines

    def position(self, count=40):
        """Read the record of table 1, by its heading."""
        lines = self.ask(f"DRR? 1 {count} 1")
        heading = [line for line in lines if line.startswith("#")]
        assert all("=" in line for line in heading[:-1])
        assert heading[-1] == "# END_HEADER"
        return np.array([float(line) for line in lines[len(heading) :]])


def test_who_sends_a_heap_of_lines_is_answered_in_turns_with_others():
    """A question is not kept waiting by the thousand of another client."""
    interpreter = controller()
    server = GcsServer(interpreter)
    carried_out = []
    run = interpreter.line

    def line(client, text, **how):
        carried_out.append(text)
        return run(client, text, **how)

    interpreter.line = line
    server.start()
    many, one = Socket(server.address), Socket(server.address)
    with interpreter.pace.lock:  # nothing is carried out until all is there
        many.link.sendall(b"POS?\n" * 2000)
        one.link.sendall(b"VEL? 1\n")
    assert one.link.recv(100) == b"1=2.000000000e+03\n"
    got = b""
    while got.count(b"\n") < 4000:
        got += many.link.recv(65536)
    assert carried_out.index("VEL? 1") < 50  # a few turns of 8 lines
    for link in (many.link, one.link):
        link.close()
    server.close()


@pytest.fixture
def linked():
    server = GcsServer(controller())
    server.start()
    client = Socket(server.address)
    yield client
    client.link.close()
    server.close()


def move(client, where):
    client.ask(f"MOV 1 {where}")
    while client.ask("ONT? 1") != ["1=1"]:
        pass


def test_two_moves_and_two_reads(linked):
    """The record of a move is that move, however long the memory goes on to record the first."""
    linked.ask("SVO 1 1")
    linked.ask("DRC 1 1 2")
    linked.ask("DRT 0 1 0")
    move(linked, 10)
    step = 2e3 / RATE  # 2 mm/s
    first = np.minimum(step * np.arange(1, 41), 10.0)
    np.testing.assert_allclose(linked.position(), first, rtol=1e-9)
    # armed anew, there is nothing to be read before the next move, and an error says so
    linked.ask("DRT 0 1 0")
    assert linked.ask("DRL? 1") == ["1=0"]
    linked.link.sendall(b"DRR? 1 40 1\n")
    assert linked.ask("ERR?") == ["77"]
    move(linked, 30)
    second = np.minimum(10.0 + step * np.arange(1, 41), 30.0)
    np.testing.assert_allclose(linked.position(), second, rtol=1e-9)
    # it stays armed: each move starts it anew
    move(linked, 5)
    third = np.maximum(30.0 - step * np.arange(1, 41), 5.0)
    np.testing.assert_allclose(linked.position(), third, rtol=1e-9)
    # one that is refused starts nothing, and the record of the last one stays
    linked.ask("MOV 1 1000")
    assert linked.ask("ERR?") == ["7"]
    np.testing.assert_allclose(linked.position(), third, rtol=1e-9)


def test_a_new_choice_of_what_is_recorded_ends_the_recording(linked):
    linked.ask("SVO 1 1")
    linked.ask("DRC 1 1 2 2 1 1")
    linked.ask("DRT 0 1 0")
    move(linked, 10)
    linked.ask("DRC 1 1 1")
    count = linked.ask("DRL?")
    assert count[0] == "1=0"  # another quantity: nothing of it is there
    linked.ask("POS?")
    assert linked.ask("DRL?") == count  # and nothing comes before the next move
    move(linked, 12)
    np.testing.assert_allclose(linked.position(), 12.0, rtol=1e-12)
    assert linked.ask("ERR?") == ["0"]


def test_a_recording_at_once_is_ended_by_the_next_trigger(linked):
    linked.ask("SVO 1 1")
    linked.ask("DRC 1 1 2")
    linked.ask("DRT 0 4 0")
    linked.ask("POS?")
    assert linked.ask("DRL? 1") != ["1=0"]
    linked.ask("DRT 0 0 0")
    count = linked.ask("DRL? 1")
    linked.ask("POS?")
    assert linked.ask("DRL? 1") == count
    np.testing.assert_allclose(linked.position(5), 0.0, atol=0.0)
