"""The conversation with a GCS controller: what is sent, what is taken for an answer, and stops."""

import math
import os
import pty
import re
import sys
import threading
import tty
from contextlib import closing

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexstage.base.errors import ControllerError, ModelError, NotConnectedError
from flexstage.instruments.pi.conversation import GcsClient
from flexstage.instruments.pi.replies import (
    SENTENCES,
    assignments,
    error_sentence,
    number,
    take_lines,
    whole_number,
)
from flexstage.instruments.pi.simulated.device import Refusal
from flexstage.instruments.transport import (
    GatewayLink,
    InProcess,
    NoAnswerError,
    SerialLink,
    TcpLink,
)
from tests.gcs_script import InMemory, ScriptedController, served


def talking(script: ScriptedController | None = None) -> tuple[GcsClient, ScriptedController]:
    script = ScriptedController() if script is None else script
    client = GcsClient(InProcess(InMemory(script)))
    script.log.clear()
    return client, script


class Wire:
    """A link by hand: what comes is put in by the test; an empty one is silent."""

    name = "wire"

    def __init__(self, *pieces: bytes):
        self.pieces, self.sent, self.closed = list(pieces), [], False
        self.waits = threading.Event()
        self.blocked: threading.Event | None = None

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def receive(self, timeout: float) -> bytes:
        self.waits.set()
        if self.blocked is not None:
            assert self.blocked.wait(5.0)
        if not self.pieces:
            raise NoAnswerError("silence")
        return self.pieces.pop(0)

    def close(self) -> None:
        self.closed = True


GREETING = (b"Maker, Model, 5, 1.0\n", b"2.0\n", b"0\n")


# what is sent ---------------------------------------------------------------------------------


def test_meeting_a_controller_asks_three_questions_and_nothing_else():
    link = InMemory(ScriptedController())
    GcsClient(InProcess(link))
    assert link.sent == [b"*IDN?\n", b"CSV?\n", b"ERR?\n"]


def test_a_question_ends_with_a_line_feed_and_a_single_character_does_not():
    wire = Wire(*GREETING, b"1=3.5\n", b"0\n")
    client = GcsClient(wire)
    client.ask("POS? 1")
    client.ask("\x05")
    assert wire.sent[3:] == [b"POS? 1\n", b"\x05"]


def test_a_command_is_followed_by_the_question_whether_it_went_well():
    client, script = talking()
    client.tell("SVO 1 1")
    assert script.log == ["SVO 1 1", "ERR?"]


# what is taken for an answer ------------------------------------------------------------------


def test_an_answer_of_several_lines_ends_with_the_line_without_a_space():
    client = GcsClient(Wire(*GREETING, b"1=0.5 \n2=0", b".25 \n3", b"=1.5\n"))
    assert client.ask("POS? 1 2 3") == ["1=0.5", "2=0.25", "3=1.5"]


@given(st.lists(st.text("0123=. abcXYZ#", max_size=8), min_size=1, max_size=5), st.data())
def test_lines_are_the_same_however_the_bytes_are_cut(lines, data):
    whole = "".join(f"{line}\n" for line in lines).encode()
    cuts = sorted(data.draw(st.lists(st.integers(0, len(whole)), max_size=5)))
    buffer, found = bytearray(), []
    for a, b in zip([0, *cuts], [*cuts, len(whole)], strict=True):
        buffer += whole[a:b]
        found += take_lines(buffer)
    assert found == lines
    assert not buffer


@given(st.floats(-1e300, 1e300))
def test_a_number_that_python_prints_is_read_back(value):
    assert number(repr(value), "POS?") == value
    # ten digits, as controllers print
    assert number(f"{value:.9e}", "POS?") == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("text", ["nan", "NaN", "-nan", "nan(ind)", "1.#QNAN", "-1.#IND00"])
def test_no_number_in_the_ways_of_firmware_is_nan(text):
    assert math.isnan(number(text, "POS?"))


@pytest.mark.parametrize("text", ["", "1,5", "1_000", "abc", "0x10", "1e", "--1", "1 2", "\u0661"])
def test_what_is_no_number_is_refused_with_the_question(text):
    with pytest.raises(ControllerError, match=r"answer to 'POS\?' should be a number"):
        number(text, "POS?")


@pytest.mark.parametrize(
    ("text", "value"), [("0x1F", 31), ("17", 17), ("-3", -3), ("20.0", 20), ("4.", 4)]
)
def test_whole_numbers(text, value):
    assert whole_number(text, "RTR?") == value


@pytest.mark.parametrize("text", ["2.5", "0x", "", "1e3", "zwei"])
def test_what_is_no_whole_number_is_refused(text):
    with pytest.raises(ControllerError, match="should be an integer"):
        whole_number(text, "RTR?")


def test_bits_are_hexadecimal_although_the_answer_does_not_say_so():
    client = GcsClient(Wire(*GREETING, b"1A\n"))
    assert client.ask_whole("\x05", base=16) == 26


@pytest.mark.parametrize(
    "lines",
    [["2=1.5"], ["1=1.5", "1=2"], ["1.5"], ["1=1.5", "2=0"], ["1=1.5", ""], ["0"]],
)
def test_an_answer_about_something_else_is_refused(lines):
    with pytest.raises(ControllerError, match=r"one value for each of 1, got"):
        assignments(lines, ["1"], "POS? 1")


def test_values_come_in_the_order_of_the_names_that_were_asked_for():
    client = GcsClient(Wire(*GREETING, b"2=0.25 \n1=0.5\n"))
    assert client.ask_values("POS?", ["1", "2"]) == [0.5, 0.25]


# errors ---------------------------------------------------------------------------------------


def test_a_refusal_says_what_was_refused_and_why():
    client, _ = talking()
    with pytest.raises(
        ControllerError, match=r"refused 'MOV 1 5': the axis is not referenced.*error 5"
    ) as info:
        client.tell("MOV 1 5")
    assert info.value.code == 5


def test_an_error_of_an_earlier_conversation_is_nobodys():
    script = ScriptedController()
    script.error = 7
    client = GcsClient(InProcess(InMemory(script)))
    client.tell("SVO 1 1")


def test_a_number_without_a_sentence_is_told():
    assert error_sentence(4711) == "error 4711: see the manual of the controller"


def test_every_sentence_is_one_clause_and_no_copy_of_another_but_of_its_pair():
    assert len(SENTENCES) > 60
    for code, words in SENTENCES.items():
        assert re.fullmatch(r"[a-z][^.!?]*[a-z0-9)]", words), (code, words)
        assert 0 < code < 10000


def test_every_error_of_the_simulated_controller_has_a_sentence():
    assert len(Refusal) > 20
    assert set(Refusal) <= set(SENTENCES)


def test_a_question_that_the_controller_refuses_says_so():
    client, _ = talking(ScriptedController(commands="*IDN? CSV?"))
    with pytest.raises(ControllerError, match=r"refused 'POS\? 1': unknown command") as info:
        client.ask("POS? 1")
    assert info.value.code == 2
    assert not isinstance(info.value, NoAnswerError)


@pytest.mark.parametrize(
    ("answers", "sentence"),
    [
        ([b"\x00\xff\x13\n"], "so it is not a GCS controller: check the address"),
        ([b"line one \nline two\n"], "so it is not a GCS controller"),
        ([b"\n"], "so it is not a GCS controller"),
        ([b"Maker, Model, 5, 1\n", b"1.0\n"], "has version '1.0'"),
        ([b"Maker, Model, 5, 1\n", b"3.0\n"], "has version '3.0'"),
        ([b"Maker, Model, 5, 1\n", b"what?\n"], r"'CSV\?' should be a number"),
    ],
)
def test_what_is_no_such_controller_is_refused_and_the_link_closed(answers, sentence):
    wire = Wire(*answers)
    with pytest.raises(ControllerError, match=sentence):
        GcsClient(wire)
    assert wire.closed


def test_who_never_answers_is_given_up():
    wire = Wire()
    with pytest.raises(NotConnectedError, match=r"does not answer '\*IDN\?': connect again"):
        GcsClient(wire)
    assert wire.closed
    assert wire.sent == [b"*IDN?\n"]


# stops ----------------------------------------------------------------------------------------


def test_a_stop_goes_out_while_another_thread_waits_for_an_answer():
    wire = Wire(*GREETING)
    client = GcsClient(wire)
    wire.blocked = threading.Event()
    wire.waits.clear()
    wire.pieces.append(b"1=0.5\n")
    found: list[list[float]] = []
    asking = threading.Thread(target=lambda: found.append(client.ask_values("POS?", ["1"])))
    asking.start()
    assert wire.waits.wait(5.0)
    client.stop()
    assert wire.sent[-2:] == [b"POS? 1\n", b"\x18"]
    wire.blocked.set()
    asking.join(5.0)
    assert found == [[0.5]]


class Stuck(InMemory):
    """Takes the first command and never comes back with it, until it is let go."""

    def __init__(self, controller: ScriptedController):
        super().__init__(controller)
        self.stuck, self.go, self.inside = False, threading.Event(), threading.Event()

    def send(self, data: bytes) -> None:
        if self.stuck:
            self.inside.set()
            assert self.go.wait(5.0)
        super().send(data)


def test_where_the_link_takes_nothing_the_stop_goes_over_a_second_one():
    link = Stuck(ScriptedController())
    client = GcsClient(InProcess(link))
    link.stuck = True
    link.controller.log.clear()
    asking = threading.Thread(target=lambda: client.ask("POS? 1"))
    asking.start()
    assert link.inside.wait(5.0)
    client.stop()
    assert link.controller.log == ["#24"]
    assert link.controller.connections == 2
    link.go.set()
    asking.join(5.0)


def test_a_stop_never_raises_whatever_has_become_of_the_link():
    wire = Wire(*GREETING)
    client = GcsClient(wire)
    client.close()

    def broken(data: bytes) -> None:
        raise NotConnectedError("gone")

    wire.send = broken
    client.stop()
    assert client.stops == 1


def test_a_stop_after_the_link_was_given_up_goes_over_a_second_one():
    script = ScriptedController()
    with served(script) as port, closing(GcsClient(TcpLink("127.0.0.1", port))) as client:
        client.close()
        script.log.clear()
        client.stop()
        for _ in range(500):
            if "#24" in script.log:
                break
            threading.Event().wait(0.01)
        assert script.log == ["#24"]


def test_the_error_that_a_stop_leaves_is_not_blamed_on_the_next_command():
    client, script = talking()
    client.tell("SVO 1 1")
    client.stop()
    client.tell("MOV 1 5")
    assert script.log == ["SVO 1 1", "ERR?", "#24", "ERR?", "MOV 1 5", "ERR?"]


def test_a_command_during_which_it_was_stopped_says_so():
    client, script = talking()
    script.faults["SVO"] = lambda _: client.stop()
    with pytest.raises(ControllerError, match="motion was stopped by a command") as info:
        client.tell("SVO 1 1")
    assert info.value.code == 10


def test_a_command_that_came_after_a_stop_of_somebody_else_is_stopped_too():
    client, script = talking()
    script.servo["1"] = True
    script.error = 10  # the stop came while nobody asked
    with pytest.raises(ControllerError, match="possibly from another program") as info:
        client.tell("MOV 1 5")
    assert info.value.code == 10
    assert script.log == ["MOV 1 5", "ERR?", "#24"]
    client.tell("MOV 1 5")  # and from then on all is as usual


# links ----------------------------------------------------------------------------------------


class Gateway:
    """As the vendor's: texts, an empty one where nothing has come, or pieces of lines."""

    def __init__(self, script: ScriptedController):
        self.script, self.text, self.connected, self.flushed = script, "", True, 0
        self.closed = False

    def send(self, msg: str) -> None:
        assert isinstance(msg, str)
        self.text += self.script.take(msg.encode("latin-1")).decode("latin-1")

    def read(self) -> str:
        piece, self.text = self.text[:7], self.text[7:]
        return piece

    def flush(self) -> None:
        self.flushed += 1

    def close(self) -> None:
        self.closed = True


def test_a_gateway_of_the_user_is_asked_in_texts():
    gateway = Gateway(ScriptedController())
    client = GcsClient(GatewayLink(gateway))
    assert gateway.flushed == 1
    assert client.ask_values("VMA?", ["1", "3"]) == [110.0, 110.0]
    client.close()
    assert gateway.closed


def test_a_gateway_that_is_silent_is_waited_for_by_the_clock():
    now = [0.0]
    link = GatewayLink(
        Gateway(ScriptedController()),
        clock=lambda: now[0],
        sleep=lambda s: now.__setitem__(0, now[0] + s),
    )
    with pytest.raises(NoAnswerError, match=r"no data from gateway Gateway in 0\.5 s"):
        link.receive(0.5)
    assert now[0] == pytest.approx(0.5, abs=0.01)


def test_a_gateway_that_lost_its_connection_or_fails_is_not_connected():
    gateway = Gateway(ScriptedController())
    link = GatewayLink(gateway)
    gateway.connected = False
    with pytest.raises(NotConnectedError, match="is not connected"):
        link.send(b"POS?\n")
    gateway.connected = True

    def fail(msg: str) -> None:
        raise RuntimeError("usb is gone")

    gateway.send = fail
    with pytest.raises(NotConnectedError, match="usb is gone"):
        link.send(b"POS?\n")


def test_an_object_without_send_and_read_is_no_gateway():
    with pytest.raises(ModelError, match=r"needs the methods send\(text\) and read\(\)"):
        GatewayLink(object())


def test_a_conversation_over_a_serial_port():
    ours, theirs = pty.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)
    script, ended = ScriptedController(), threading.Event()

    def serve() -> None:
        while not ended.is_set():
            try:
                data = os.read(ours, 4096)
            except OSError:
                return
            for byte in script.take(data):  # the slowest way in which an answer can come
                os.write(ours, bytes([byte]))

    serving = threading.Thread(target=serve, daemon=True)
    serving.start()
    try:
        client = GcsClient(SerialLink(os.ttyname(theirs), baud=115200))
        assert client.identity == script.identity
        assert client.ask_values("TMX?", ["1", "2"]) == [95.0, 88.25]
        client.stop()
        client.tell("SVO 2 1")
        assert script.servo["2"]
        script.faults["POS?"] = b""
        with pytest.raises(NoAnswerError, match="did not answer 'POS"):
            client.ask("POS? 1", timeout=0.02)
        client.close()
        with pytest.raises(NotConnectedError, match=r"the connection to .* is closed"):
            client.ask("POS? 1")
    finally:
        ended.set()
        os.close(theirs)
        os.close(ours)
        serving.join(5.0)


def test_a_serial_port_that_is_not_there_says_so():
    with pytest.raises(NotConnectedError, match="cannot open the serial port /dev/no-such-port"):
        SerialLink("/dev/no-such-port")


def test_without_the_library_of_serial_ports_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(NotConnectedError, match=r'pip install "flexstage\[serial\]"'):
        SerialLink("/dev/ttyUSB0")


def test_an_address_where_nothing_listens_says_so():
    with served(ScriptedController()) as port:
        pass
    with pytest.raises(NotConnectedError, match=f"cannot connect to 127.0.0.1 port {port}"):
        TcpLink("127.0.0.1", port, timeout=1.0)


def test_a_conversation_over_tcp_is_the_same_as_in_memory():
    here, there = ScriptedController(), ScriptedController()
    memory = GcsClient(InProcess(InMemory(here)))
    with served(there) as port, closing(GcsClient(TcpLink("127.0.0.1", port))) as client:
        for other in (memory, client):
            other.ask("HPA?")
            other.tell("SVO 2 1")
            other.ask_whole("\x05", base=16)
        assert there.log == here.log
        assert client.ask("HDR?") == memory.ask("HDR?")
