"""Macros of the simulated GCS controller: written, listed, started, and never without end."""

from flexstage.instruments.pi.simulated.server import ServerSession
from tests.gcs_device import controller, opened


def test_a_macro_is_its_writers_until_it_ends():
    interpreter = controller()
    first, second = ServerSession(interpreter), ServerSession(interpreter)
    first.feed(b"SVO 1 1\nMAC BEG GO\nMOV 1 5\n")
    assert first.feed(b"ERR?\nPOS?\n") == b""  # lines of the macro, ERR? too
    assert second.feed(b"MOV? 1\nMAC BEG X\nERR?\n") == b"1=0.000000000e+00\n1001\n"
    first.feed(b"MAC END\n")
    assert first.feed(b"MOV? 1\n") == b"1=0.000000000e+00\n"
    assert second.feed(b"MAC START GO\nMOV? 1\n") == b"1=5.000000000e+00\n"
    # what was begun and not ended goes with its writer
    first.feed(b"MAC BEG X\nMOV 1 9\n")
    first.close()
    assert second.feed(b"MAC BEG X\nMAC END\nERR?\n") == b"0\n"


def test_macros_are_kept_started_with_values_and_deleted():
    session = opened()
    session.feed(b"SVO 1 1\nMAC BEG up\nMVR 1 $1\nSVO? 1\nMAC END\n")
    assert session.feed(b"MAC START UP 2.5\nMAC START up 1\nMOV? 1\n") == b"1=3.500000000e+00\n"
    assert session.feed(b"MAC START UP 2.5 7\nMAC START UP\nERR?\n") == b"25\n"
    assert session.feed(b"MAC DEL UP\nERR?\nMAC START UP\nERR?\n") == b"0\n20\n"


def test_macros_that_start_each_other_end():
    session = opened()
    session.feed(b"MAC BEG A\nMAC START A\nMAC END\nMAC START A\n")
    assert session.feed(b"ERR?\nCSV?\n") == b"1000\n2.0\n"


def test_macros_do_not_grow_without_end():
    session = opened()
    session.feed(b"MAC BEG A\n" + (b"MOV 1 " + b"1" * 1000 + b"\n") * 100 + b"MAC END\n")
    assert session.feed(b"ERR?\n") == b"309\n"


def test_a_macro_that_was_stopped_starts_no_motion():
    session = opened()
    session.feed(b"SVO 1 1\nMAC BEG A\nMOV 1 9\nMAC END\n")
    session.feed(b"MAC START A\n\x18")
    assert session.feed(b"ERR?\nMOV? 1\n") == b"10\n1=0.000000000e+00\n"
