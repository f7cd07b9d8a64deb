"""Several clients of one simulated controller: stop, errors; and the link in memory."""

import threading

import pytest

from flexstage.base.errors import NotConnectedError
from flexstage.instruments.pi.simulated.address import Loopback
from flexstage.instruments.pi.simulated.clock import FastTime
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.server import LONGEST_LINE, ServerSession
from tests.gcs_device import FormulaDevice, controller, opened, talk


@pytest.fixture
def two():
    interpreter = controller()
    return interpreter, ServerSession(interpreter), ServerSession(interpreter)


def test_motion_continues_when_its_client_leaves(two):
    _, first, second = two
    talk(first, "SVO 1 1\nMOV 1 50")
    first.close()
    # nothing stops by it: the axis comes to its target
    assert talk(second, "ONT? 1\nPOS? 1") == ("1=1\n1=5.000000000e+01\n", 0)
    assert talk(second, "MOV 1 7") == ("", 0)


def test_all_clients_may_command_as_at_a_real_controller():
    interpreter = controller()
    first, second = ServerSession(interpreter), ServerSession(interpreter)
    assert talk(first, "SVO 1 1 2 1\nMOV 1 5") == ("", 0)
    assert talk(second, "MOV 1 7 2 3\nONT?\nONT?\nMOV?")[1] == 0
    assert first.feed(b"MOV? 1\n") == b"1=7.000000000e+00\n"
    # a stop is told to all who have given commands, and to nobody who has only looked
    looking = ServerSession(interpreter)
    first.feed(b"MOV 1 50\n")
    assert looking.feed(b"POS?\n\x18")[-1:] == b"\n"
    assert [s.feed(b"ERR?\n") for s in (first, second, looking)] == [b"10\n"] * 3
    first.feed(b"STP\n")
    assert [s.feed(b"ERR?\n") for s in (first, second, looking)] == [b"10\n", b"10\n", b"0\n"]


@pytest.mark.parametrize("line", ["STP 1", "STP 1 2", "STP x y z"])
def test_a_stop_with_too_many_words_stops_and_then_complains(line):
    interpreter = controller()
    first, second = ServerSession(interpreter), ServerSession(interpreter)
    first.feed(b"SVO 1 1 2 1\nMOV 1 50 2 30\nPOS?\n")
    assert second.feed(line.encode() + b"\nERR?\nERR?\n") == b"24\n0\n"
    assert first.feed(b"ERR?\n\x05") == b"10\n0\n"
    place = interpreter.device.position("1"), interpreter.device.position("2")
    assert 0.0 < place[0] < 10e-6
    assert 0.0 < place[1] < 10e-6
    interpreter.device.advance(1.0)
    assert (interpreter.device.position("1"), interpreter.device.position("2")) == place


@pytest.mark.parametrize("byte", [0, 1, 3, 6, 8, 11, 17, 27, 31])
def test_a_control_character_that_is_no_command_spoils_only_a_line_that_has_begun(byte):
    session = opened()
    assert session.feed(bytes([byte]) + b"CSV?\nERR?\n") == b"2.0\n0\n"
    assert session.feed(bytes([byte])) == b""
    assert session.feed(b"CSV?\nERR?\n") == b"2.0\n0\n"
    # cut out of a line it would make another one of it: that is refused
    session.feed(b"SVO 1 1\n")
    assert session.feed(b"MOV 1 1" + bytes([byte]) + b"0\nERR?\nMOV? 1\n") == (
        b"1\n1=0.000000000e+00\n"
    )


def test_the_status_register_tells_each_axis():
    session = opened()
    assert session.feed(b"\x04") == b"0x80008000\n"
    session.feed(b"SVO 1 1\nVEL 1 20\nMOV 1 50\n")
    assert session.feed(b"\x04SRG? 1 1 2 1\n") == b"0x30008000\n1 1=0x3000 \n2 1=0x8000\n"
    session.feed(b"ONT?\n" * 12)
    assert session.feed(b"\x04SRG? 1 1\n") == b"0x90008000\n1 1=0x9000\n"


def test_errors_are_each_clients_own(two):
    _, first, second = two
    first.feed(b"MOV 1 5\n")
    second.feed(b"XYZ\n")
    assert (first.feed(b"ERR?\n"), second.feed(b"ERR?\n")) == (b"5\n", b"2\n")
    first.feed(b"XYZ\nMOV 1\n")  # the last one is kept
    assert first.feed(b"ERR?\nERR?\n") == b"24\n0\n"


@pytest.mark.parametrize("stop", [b"\x18", b"STP\n", b"HLT\n", b"HLT 1\n"])
def test_anyone_can_stop_and_the_one_that_moved_it_is_told(two, stop):
    interpreter, first, second = two
    first.feed(b"SVO 1 1\nMOV 1 50\nPOS?\n")
    assert second.feed(stop) == b""
    assert (first.feed(b"ERR?\n"), second.feed(b"ERR?\n")) == (b"10\n", b"10\n")
    place = interpreter.device.position("1")
    assert 0.0 < place < 10e-6
    interpreter.device.advance(1.0)
    assert interpreter.device.position("1") == place
    assert first.feed(b"MOV? 1\n") == f"1={place * 1e6:.9e}\n".encode()


def test_a_wave_is_stopped_too(two):
    _, first, second = two
    first.feed(b"WAV 1 X LIN 1000 10 0 1000 0 0\nWSL 1 1\nWGC 1 0\nWGO 1 1\n")
    assert first.feed(b"\x09") == b"1\n"
    second.feed(b"\x18")
    assert first.feed(b"\x09\x05") == b"0\n0\n"


def test_a_stop_goes_before_what_came_with_it():
    """What was given before it, and not yet carried out, starts no motion."""
    session = opened()
    device = session._interpreter.device
    session.feed(b"SVO 1 1\n")
    device.calls.clear()
    assert session.feed(b"MOV 1 5\nPOS? 1\n\x18SVO? 1\n") == b"1=0.000000000e+00\n1=1\n"
    assert device.calls == [("stop", None)]
    assert session.feed(b"ERR?\n") == b"10\n"
    # and what is given after it does
    assert session.feed(b"\x18MOV 1 5\nONT?\nPOS? 1\n").endswith(b"1=5.000000000e+00\n")


def test_a_line_that_a_stop_cuts_is_dropped():
    session = opened()
    session.feed(b"SVO 1 1\n")
    session.feed(b"MOV 1 1")
    session.feed(b"\x180\n")  # without the stop it would be 10
    assert session.feed(b"ERR?\nMOV? 1\n") == b"2\n1=0.000000000e+00\n"


def test_characters_are_answered_wherever_they_stand():
    session = opened()
    assert session.feed(b"PO\x05S? \x07" + b"1\x09\n") == b"0\n\xb1\n0\n1=0.000000000e+00\n"


def test_motion_is_told_by_bits():
    session = opened()
    session.feed(b"WAV 1 X LIN 1000 10 0 1000 0 0\nWSL 1 1 2 1\nWGC 1 0 2 0\nWGO 2 1\n")
    assert session.feed(b"\x05\x09") == b"2\n2\n"
    session.feed(b"WGO 2 0 1 1\n")
    assert session.feed(b"\x05\x09") == b"1\n1\n"


def test_a_line_that_is_too_long_is_dropped_whole():
    session = opened()
    for size in (LONGEST_LINE, LONGEST_LINE + 1, 3 * LONGEST_LINE):
        line = b"MOV?".ljust(size)
        assert len(line) == size
        assert session.feed(line + b"\nCSV?\n") == (
            b"1=0.000000000e+00 \n2=0.000000000e+00\n2.0\n" if size == LONGEST_LINE else b"2.0\n"
        )
        assert session.feed(b"ERR?\n") == (b"0\n" if size == LONGEST_LINE else b"3\n")


def test_memory_does_not_grow_with_a_line_that_never_ends():
    session = opened()
    for _ in range(50):
        session.push(b"A" * LONGEST_LINE)
        assert len(session._part) <= LONGEST_LINE
    assert session.backlog == 0


def test_answers_are_made_as_they_are_taken():
    """A long array is made piece by piece, so that a slow reader holds up nobody."""
    session = opened()
    session.feed(b"WAV 1 X LIN 5000 1 0 5000 0 0\n")
    session.push(b"GWD? 1 5000 1\nCSV?\n")
    pieces = []
    while session.busy:
        pieces.append(session.pull(commands=1))
    assert len(pieces) > 5
    assert max(len(piece) for piece in pieces) < 20_000
    assert b"".join(pieces).endswith(b"\n2.0\n")
    assert b"".join(pieces).count(b"\n") == 5000 + 9 + 1


def test_time_that_is_asked_for_passes_in_pieces_and_others_are_heard(two):
    interpreter, first, second = two
    first.push(b"SPA 1 0x7F000001 10\n")
    first.pull(commands=20)
    assert 0.0 < interpreter.device.now < 2.0
    assert second.feed(b"CSV?\n") == b"2.0\n"
    while first.busy:
        first.pull()
    assert interpreter.device.now == pytest.approx(10.0, abs=0.01)


def test_a_simulation_that_breaks_down_is_a_hardware_error():
    from flexstage.base.errors import ControllerError

    class Broken(FastTime):
        def before_command(self, poll=False):
            raise ControllerError("broken")

    device = FormulaDevice()
    session = ServerSession(Interpreter(device, Broken(device)))
    assert session.feed(b"POS?\n") == b""
    assert session.error == 333


def test_simulated_time_is_not_led_on_where_it_is_real():
    from flexstage.instruments.pi.simulated.clock import Pacemaker

    device = FormulaDevice()
    session = ServerSession(Interpreter(device, Pacemaker(device)))
    assert talk(session, "SPA? 1 0x7F000002\nSPA 1 0x7F000001 1") == ("1 0x7F000002=0\n", [34])


def test_link_in_memory():
    link = Loopback(controller())
    assert link.receive(0.0) == b""
    link.send(b"CSV?\nSVO? ")
    assert link.receive(1.0) == b"2.0\n"
    link.send(b"1\n")
    assert link.receive(1.0) == b"1=0\n"
    assert "formula" in link.name
    other = link.another()
    link.send(b"SVO 1 1\n")
    link.close()
    link.close()
    other.send(b"SVO? 1\nERR?\n")
    assert other.receive(1.0) == b"1=1\n0\n"
    with pytest.raises(NotConnectedError):
        link.send(b"CSV?\n")
    with pytest.raises(NotConnectedError):
        link.receive(0.0)


def test_a_stop_in_memory_does_not_wait_for_another_thread():
    """It comes while another thread leads on simulated time by what takes long."""
    interpreter = controller()
    link = Loopback(interpreter)
    link.send(b"SVO 1 1\nVEL 1 1e-3\nMOV 1 50\n")
    inside, places = threading.Event(), []
    advance, stop = interpreter.device.advance, interpreter.device.stop

    def slow(seconds):
        advance(seconds)
        if seconds > 0.04 and not places:
            inside.set()
            threading.Event().wait(1e-3)

    def noted(axes=None):
        stop(axes)
        places.append((interpreter.device.position("1"), interpreter.device.now))

    interpreter.device.advance, interpreter.device.stop = slow, noted
    worker = threading.Thread(target=link.send, args=(b"SPA 1 0x7F000001 3600\n",))
    worker.start()
    assert inside.wait(5.0)
    link.send(b"\x18")
    worker.join(60.0)
    assert not worker.is_alive()
    # it acted long before what the other thread did was over, and for good
    place, when = places[0]
    assert when < 1800.0 < interpreter.device.now
    assert interpreter.device.position("1") == place < 50e-6
