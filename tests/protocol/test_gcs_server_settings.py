"""Settings of the simulated GCS controller, and what it refuses while something goes on."""

import re

import pytest

from flexstage.instruments.pi.simulated.server import ServerSession
from flexstage.system.servo import Notch, ServoSettings
from tests.gcs_device import controller, opened, talk

E = "{:.9e}".format


def test_parameters_are_listed_with_type_and_items():
    session = opened()
    lines = session.feed(b"HPA?\n").decode().rstrip("\n").split(" \n")
    assert (lines[0], lines[-1]) == ("The following parameters are valid:", "end of help")
    values = session.feed(b"SPA?\n").decode().rstrip("\n").split(" \n")
    for line in lines[1:-1]:
        number, rest = line.split("=", 1)
        nothing, level, items, kind, group, name = rest.split("\t")
        assert nothing == ""
        assert level in ("0", "9")
        assert group
        assert name
        found = [value.split("=", 1)[1] for value in values if f" {number}=" in value]
        assert len(found) == int(items)
        form = {"FLOAT": r"-?\d\.\d{9}e[+-]\d\d", "INT": r"\d+", "CHAR": r"[\w. ]+"}[kind]
        assert all(re.fullmatch(form, value) for value in found)


def test_settings_of_control_are_changed_together():
    """Gains in um on the wire; a notch by its gain and its width, as 2 zeta of zeros and poles."""
    interpreter = controller()
    session = ServerSession(interpreter)
    line = (
        b"SPA 2 0x07000300 0.3 2 0x07000301 1500 2 0x08000101 1200 2 0x08000201 0.04 "
        b"2 0x08000301 0.7 2 0x08000100 0 2 0x7F000010 2500\n"
    )
    session.feed(line)
    assert session.feed(b"ERR?\n") == b"0\n"
    found = interpreter.device.servo("2")
    assert found.proportional == pytest.approx(0.3e6, rel=1e-12)
    assert found.integral == pytest.approx(1.5e9, rel=1e-12)
    assert found.lowpass_hz == 2500.0
    (notch,) = found.notches
    assert notch.frequency_hz == 1200.0
    assert (notch.zero_damping, notch.pole_damping) == pytest.approx((0.014, 0.35), rel=1e-12)
    # the gain at its frequency is what the parameter says; the low-pass is taken off
    bare = ServoSettings(proportional=1.0, notches=found.notches)
    assert abs(bare.response([1200.0], 10e3)[0]) == pytest.approx(0.04, rel=1e-9)
    # the second stays the second though the first is none
    said = session.feed(b"SPA? 2 0x08000100 2 0x08000101\n")
    assert said == f"2 0x08000100={E(0)} \n2 0x08000101={E(1200)}\n".encode()
    # one bad number leaves all as it was
    session.feed(b"SPA 2 0x07000300 0.9 2 0x08000100 -5\n")
    assert session.feed(b"ERR?\n") == b"17\n"
    assert interpreter.device.servo("2") == found


def test_settings_changed_elsewhere_are_told():
    interpreter = controller()
    session = ServerSession(interpreter)
    session.feed(b"SPA 1 0x08000100 0 1 0x08000102 900\n")
    interpreter.device.set_servo_settings("1", ServoSettings(notches=(Notch(frequency_hz=456),)))
    said = session.feed(b"SPA? 1 0x08000100 1 0x08000102\n")
    assert said == f"1 0x08000100={E(456)} \n1 0x08000102={E(0)}\n".encode()


def test_voltages_and_positions_of_a_refusal_have_numbers_of_their_own():
    answers, errors = talk(
        opened(), "SVO 1 1\nMOV 1 61\nSVA 1 5\nMVR 1 -3\nSVO 1 0\nMOV 1 1\nSVA 1 -6"
    )
    assert answers == ""
    assert errors == [7, 303, 7, 5, 302]


def test_commands_while_a_wave_runs():
    session = opened()
    talk(session, "WAV 1 X PNT 1 3 1 2 3\nWAV 2 X PNT 1 1 1\nWSL 1 1\nWGC 1 0\nWGO 1 1")
    lines = "SVA 1 5\nWGO 1 1\nWSL 1 2\nWGC 1 2\nWAV 1 X PNT 1 1 0\nWCL 2 1\nWTR 0 2 1\nSVO 1 1"
    assert talk(session, lines) == ("", [73] * 8)
    assert talk(session, "WGO 1 0\nWGO?\nSVA 1 5\nONT?\nSVA? 1") == (
        f"1=0 \n2=0\n1=1 \n2=1\n1={E(5)}\n",
        0,
    )


def test_a_table_that_runs_as_voltages_does_not_become_positions():
    session = opened()
    talk(session, "WAV 1 X PNT 1 2 5 6\nWSL 1 1 2 1\nWGC 1 0\nSVO 2 1\nWGO 1 1")
    assert talk(session, "WGO 2 1\nWGO?") == ("1=1 \n2=0\n", [73])


def test_a_table_that_was_cleared_takes_no_room():
    session = opened()
    talk(session, "WAV 1 X LIN 3000 1 0 3000 0 0\nWSL 1 1\nWGO 1 1\nWGO?\nWGO?\nWGO?")
    lines = "WCL 1\nWAV 2 X LIN 4000 1 0 4000 0 0\nWSL 1 2\nWGO 1 1\nWGO? 1"
    assert talk(session, lines) == ("1=1\n", 0)
