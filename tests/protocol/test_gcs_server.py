"""Conversations with the simulated GCS controller, byte for byte, on a device that is exact.

Time passes with commands: 1 ms each, and a question about motion leads on until its answer changes,
so that every number below follows from the speeds of the device by hand.
"""

import pytest

from flexstage.instruments.pi.simulated.server import ServerSession
from tests.gcs_device import RATE, controller, opened, talk

IDENTITY = b"flexstage, formula (simulated), 7, 1.2\n"


@pytest.fixture
def session():
    return opened()


def exchange(session, *lines):
    return [session.feed(line + b"\n") for line in lines]


def test_connect(session):
    said = exchange(session, b"CSV?", b"ERR?", b"*IDN?", b"ERR?", b"SAI?", b"ERR?")
    assert said == [b"2.0\n", b"0\n", IDENTITY, b"0\n", b"1 \n2\n", b"0\n"]


def test_versions_are_lines_of_name_and_number(session):
    lines = session.feed(b"VER?\n").split(b" \n")
    assert len(lines) > 1
    assert lines[0] == b"FW: 1.2"
    assert all(b": " in line for line in lines)
    assert lines[-1].endswith(b"\n")


def test_start_up(session):
    """What a client sends after it has connected: help, stop, position control, status."""
    help_text = session.feed(b"HLP?\n")
    assert help_text.startswith(b"The following commands are valid: \n#4 ")
    assert help_text.endswith(b" \nend of help\n")
    assert exchange(session, b"\x18", b"ERR?", b"ERR?") == [b"", b"10\n", b"0\n"]
    assert exchange(session, b"SVO 1 1 2 1", b"ERR?", b"SVO?") == [b"", b"0\n", b"1=1 \n2=1\n"]
    assert [session.feed(c) for c in (b"\x07", b"\x05", b"\x09")] == [b"\xb1\n", b"0\n", b"0\n"]


def test_move_and_wait(session):
    """Axis 1 needs 5 ms for 10 um at 2 mm/s, axis 2 needs 5.5 ms for 5.5 um at 1 mm/s."""
    assert exchange(session, b"SVO 1 1 2 1", b"MOV 1 10 2 5.5", b"\x05") == [b"", b"", b"0\n"]
    # asked for at once, it has led on until both stand
    assert exchange(session, b"ONT? 1 2", b"POS?") == [
        b"1=1 \n2=1\n",
        b"1=1.000000000e+01 \n2=5.500000000e+00\n",
    ]
    assert exchange(session, b"MOV?", b"VOL? 1", b"ERR?") == [
        b"1=1.000000000e+01 \n2=5.500000000e+00\n",
        b"1=2.000000000e+01\n",
        b"0\n",
    ]


def test_position_on_the_way(session):
    """A plain question takes 1 ms: 2 um further each time."""
    said = exchange(session, b"SVO 1 1", b"MOV 1 50", b"POS? 1", b"POS? 1")
    assert said[2:] == [b"1=2.000000000e+00\n", b"1=4.000000000e+00\n"]


def test_limits_are_told(session):
    said = exchange(session, b"TMN?", b"TMX? 2", b"PUN?", b"VMI? 1", b"VMA?", b"VEL?")
    assert said == [
        b"1=-2.000000000e+00 \n2=1.000000000e+00\n",
        b"2=3.100000000e+01\n",
        b"1=um \n2=um\n",
        b"1=-5.000000000e+00\n",
        b"1=1.200000000e+02 \n2=1.000000000e+02\n",
        b"1=2.000000000e+03 \n2=1.000000000e+03\n",
    ]


def test_a_target_outside_limits_answers_error_7_and_moves_nothing(session):
    session.feed(b"SVO 1 1 2 1\nMOV 1 10 2 5\nONT?\n")
    assert exchange(session, b"MOV 1 12 2 31.001", b"ERR?", b"ERR?") == [b"", b"7\n", b"0\n"]
    assert exchange(session, b"MOV?", b"POS?") == [b"1=1.000000000e+01 \n2=5.000000000e+00\n"] * 2


def test_data_recorder(session):
    """Recorded with a move: 2 um/ms, sampled every 2 ms from the sample after the command on."""
    lines = (
        b"SVO 1 1",
        b"SPA? 1 369099265",
        b"SPA? 1 0x16000200",
        b"SPA? 1 0x16000300 1 0x0E000200",
        b"RTR 20",
        b"RTR?",
        b"DRC 1 1 1 2 1 2",
        b"DRT 0 1 0",
        b"MOV 1 10",
        b"DRL? 1",
        b"ERR?",
    )
    assert exchange(session, *lines) == [
        b"",
        b"1 369099265=2000\n",
        b"1 0x16000200=6000\n",
        b"1 0x16000300=3 \n1 0x0E000200=1.000000000e-04\n",
        b"",
        b"20\n",
        b"",
        b"",
        b"",
        b"1=3\n",  # 5 ms and 1 ms
        b"0\n",
    ]
    assert session.feed(b"DRR? 1 3 1 2\n") == (
        b"# REM = flexstage, formula (simulated), 7, 1.2 \n"
        b"# VERSION = 1 \n"
        b"# TYPE = 1 \n"
        b"# SEPARATOR = 32 \n"
        b"# DIM = 2 \n"
        b"# SAMPLE_TIME = 0.002000000000 \n"
        b"# NDATA = 3 \n"
        b"# NAME0 = Target Position of axis 1 \n"
        b"# NAME1 = Current Position of axis 1 \n"
        b"# END_HEADER \n"
        b"1.000000000e+01 2.000000000e-01 \n"
        b"1.000000000e+01 4.200000000e+00 \n"
        b"1.000000000e+01 8.200000000e+00\n"
    )


def test_recorder_lists_what_it_can_record(session):
    lines = session.feed(b"HDR?\n").decode().split(" \n")
    assert lines[:7] == [
        "#RecordOptions",
        "0=Nothing is recorded",
        "1=Target Position of axis",
        "2=Current Position of axis",
        "3=Position Error of axis",
        "7=Control Voltage of output chan",
        "20=Sensor mech.linear of input chan",
    ]
    assert "#TriggerOptions" in lines
    assert lines[-1] == "end of help\n"


def test_wave_generator(session):
    lines = (
        b"SVO 1 1",
        b"MOV 1 5",
        b"ONT? 1",
        b"WAV 1 X SIN_P 2000 10 5 2000 0 1000",
        b"WAV 2 X PNT 1 4 1 2 3 4",
        b"WAV 2 & PNT 5 2 5 6",
        b"WSL 1 1",
        b"WGC 1 3",
        b"WGO 1 1",
        b"ERR?",
        b"\x09",
    )
    assert exchange(session, *lines) == [
        b"",
        b"",
        b"1=1\n",
        b"",
        b"",
        b"",
        b"",
        b"",
        b"",
        b"0\n",
        b"1\n",
    ]
    axis = session._interpreter.device.state["1"]
    assert (axis.choice, axis.cycles, axis.wave.size) == ((1, 0), 3, 2000)
    assert session.feed(b"GWD? 6 1 2\n").endswith(b" \n6.000000000e+00\n")
    assert session.feed(b"GWD? 1 3 2\n").endswith(
        b"# SAMPLE_TIME = 0.000100000000 \n# NDATA = 3 \n# NAME0 = Wave Table 2 \n# END_HEADER \n"
        b"1.000000000e+00 \n2.000000000e+00 \n3.000000000e+00\n"
    )
    # a question leads on by a quarter of a second, or to the end of the wave after 0.6 s
    assert session.feed(b"WGO?\n" * 2) == b"1=1 \n2=0\n1=0 \n2=0\n"
    assert session.feed(b"POS? 1\n") == b"1=5.000024674e+00\n"


def test_a_wave_runs_as_voltages_where_control_is_off(session):
    """10 in a table are 10 um under control, and 10 V without it: 5 um at 0.5 um/V."""
    session.feed(b"WAV 1 X PNT 1 3 0 4 10\nWSL 1 1 2 1\nWGO 1 1\nWGO?\n")
    assert session.feed(b"POS? 1\nERR?\n") == b"1=5.000000000e+00\n0\n"
    session.feed(b"SVO 1 1\nMOV 1 0\nONT?\nWGO 1 1\nWGO?\n")
    assert session.feed(b"POS? 1\nERR?\n") == b"1=1.000000000e+01\n0\n"
    # one table cannot be both at once
    session.feed(b"MOV 1 0\nONT?\nWGO 1 1 2 1\n")
    assert session.feed(b"ERR?\nWGO?\n") == b"405\n1=0 \n2=0\n"


def test_voltages_in_open_loop(session):
    said = exchange(session, b"SVA 1 20 2 40", b"ONT?", b"SVA?", b"VOL?", b"POS?", b"SVA 1 15")
    assert said[2:5] == [
        b"1=2.000000000e+01 \n2=4.000000000e+01\n",
        b"1=2.000000000e+01 \n2=4.000000000e+01\n",
        b"1=1.000000000e+01 \n2=1.000000000e+01\n",
    ]
    assert exchange(session, b"SVA? 1", b"SVA 1 121", b"ERR?", b"SVA? 1") == [
        b"1=1.500000000e+01\n",
        b"",
        b"302\n",
        b"1=1.500000000e+01\n",
    ]


def test_screws_have_positions_and_no_voltages():
    session = opened("screw")
    answers, errors = talk(session, "TPC?\nSVO?\nMOV 2 250\nSVO 1 1\nMOV?")
    assert errors == 0
    assert answers == "0\n1=1 \n2=1\n1=0.000000000e+00 \n2=2.500000000e+02\n"
    assert talk(session, "SVO 1 0\nVOL?\nSVA 1 1\nSVA?") == ("", [34, 2, 2, 2])
    listed = session.feed(b"HLP?\nHDR?\nHPA?\n")
    assert not any(word in listed for word in (b"SVA", b"VOL?", b"7=Control", b"P-Term"))
    assert b"MOV" in listed


def test_a_blow_is_recorded_only_with_the_drives_out(session):
    assert talk(session, "DRC 1 1 200 2 1 201\nIMP 1") == ("", [34])
    assert talk(session, "SVO 1 1\nSPA 1 0x7F000003 1") == ("", [303])
    answers, errors = talk(session, "SVO 1 0\nSPA 1 0x7F000003 1\nSPA? 1 0x7F000003\nIMP 1\nDRL?")
    assert errors == 0
    assert answers.startswith("1 0x7F000003=1\n1=")
    names = session.feed(b"DRR? 1 2 1 2\n")
    assert b"# NAME0 = Hammer Force [N] at axis 1 \n" in names
    assert b"# NAME1 = Response to Impact [m/s^2] of axis 1 \n" in names


def test_reboot_leaves_nothing(session):
    session.feed(
        b"SVO 1 1\nMOV 1 10\nONT?\nWAV 1 X PNT 1 2 3 4\nDRC 1 1 2\nDRT 0 1 0\nSPA 1 0x07000300 4\n"
    )
    session.feed(b"RBT\n")
    answers, errors = talk(session, "SVO?\nPOS? 1\nGWD? 1 1 1\nSPA? 1 0x07000300")
    assert errors == [401]
    assert answers == "1=0 \n2=0\n1=0.000000000e+00\n1 0x07000300=0.000000000e+00\n"
    assert talk(session, "SVO 1 1\nMOV 1 1\nONT?\nDRL? 1")[0].endswith("1=0\n")


def test_lines_may_be_cut_anywhere_and_end_with_carriage_return():
    whole = b"SVO 1 1\r\nMOV 1 7.25\nONT? 1\r\n\r\nPOS? 1\nerr?\n"
    expected = b"1=1\n1=7.250000000e+00\n0\n"
    assert opened().feed(whole) == expected
    for size in (1, 2, 3, 7):
        session = opened()
        pieces = (whole[i : i + size] for i in range(0, len(whole), size))
        assert b"".join(session.feed(piece) for piece in pieces) == expected


def test_simulated_time_is_led_on(session):
    before = float(session.feed(b"SPA? 1 0x7F000001\n").split(b"=")[1])
    session.feed(b"SVO 1 1\nMOV 1 50\nSPA 1 0x7F000001 0.0105\n")
    after = float(session.feed(b"SPA? 1 0x7F000001\n").split(b"=")[1])
    # four commands of 1 ms and what was asked for, to one sample of the loop
    assert after - before == pytest.approx(0.0145, abs=1.0 / RATE)


def test_records_and_waves_are_read_by_the_reader_of_measured_files(session, tmp_path):
    from flexstage.records import read_record

    session.feed(b"SVO 1 1\nRTR 2\nDRC 1 1 1 2 1 2 3 3 20\nDRT 0 1 0\nMOV 1 10\nDRL?\n")
    file = tmp_path / "trace.gcs"
    file.write_bytes(session.feed(b"DRR? 1 20 1 2 3\n"))
    record = read_record(file, format="gcs")
    assert record.sample_rate_hz == pytest.approx(5000.0, rel=1e-9)
    assert record.channel("Current Position of axis 1").values[[0, 10]] == pytest.approx(
        [0.2, 4.2], rel=1e-9
    )
    assert record.channel("Sensor mech.linear of input chan 3").values == pytest.approx([3.0] * 20)
    session.feed(b"WAV 2 X LIN 30 -4 5 30 0 3\nWTR 0 7 1\n")
    file.write_bytes(session.feed(b"GWD? 1 30 2\n"))
    record = read_record(file, format="gcs")
    assert record.sample_rate_hz == pytest.approx(RATE / 7.0, rel=1e-9)
    assert record.channel("Wave Table 2").values[0] == 5.0


def test_the_identity_always_says_that_it_is_simulated():
    interpreter = controller()
    assert b"simulated" in ServerSession(interpreter).feed(b"*IDN?\n")
