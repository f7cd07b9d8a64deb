"""The recorder of the simulated GCS controller: what starts it, and what a record is read as."""

from flexstage.instruments.pi.simulated.clock import FastTime
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.server import ServerSession
from tests.gcs_device import FormulaDevice, opened, talk


def test_a_refused_move_starts_no_record_later():
    session = opened()
    device = session._interpreter.device
    assert talk(session, "DRC 1 1 7\nDRT 0 1 0\nSVA 1 999\nDRT 0 0 0\nSVA 1 5") == ("", [302])
    assert not device.recorder.recording
    assert device.recorder.recorded == 0


def test_what_was_recorded_is_read_as_what_it_was():
    """Changing what a table records, or the rate, does not rename what is in it."""
    session = opened()
    talk(session, "DRC 1 1 7 2 2 7\nRTR 4\nDRT 0 1 0\nSVA 1 3 2 9\nONT?\nRTR 9\nDRC 1 1 2")
    assert session.feed(b"DRL?\n").startswith(b"1=0 \n2=")
    assert talk(session, "DRR? 1 1 1") == ("", [77])
    text = session.feed(b"DRR? 1 2 2\n")
    assert b"# SAMPLE_TIME = 0.000400000000 \n" in text
    assert b"# NAME0 = Control Voltage of output chan 2 \n" in text


def test_asking_how_much_is_recorded_leads_a_fast_twin_on_to_the_end():
    session = opened()
    device = session._interpreter.device
    talk(session, "DRC 1 1 7\nRTR 10\nDRT 0 4 0")
    assert device.recorder.recording
    session.feed(b"DRL?\n")
    assert device.now > 0.1
    assert session.feed(b"DRL? 1\n") > b"1=50"


def test_triggers_of_the_recorder():
    def recording(lines):
        device = FormulaDevice()
        session = ServerSession(Interpreter(device, FastTime(device)))
        assert talk(session, "DRC 1 1 7\n" + lines)[1] == 0
        return device.recorder.recording or device.recorder.recorded > 0

    assert not recording("DRT 0 0 0\nSVA 1 5")
    assert recording("DRT 0 1 0\nSVA 1 5")
    assert not recording("DRT 0 1 0\nPOS?")
    assert recording("DRT 0 4 0")
    assert recording("DRT 0 2 0\nPOS?")
    assert not recording("DRT 0 2 0")
    assert recording("DRT 0 0 0\nWAV 1 X PNT 1 1 0\nWSL 1 1\nWGO 1 1")


def test_a_recording_that_a_client_started_goes_on_while_a_wave_starts():
    session = opened()
    device = session._interpreter.device
    talk(session, "DRC 1 1 7\nWAV 1 X PNT 1 2 0 2\nWSL 1 1\nDRT 0 4 0\nPOS?\nPOS?")
    before = device.recorder.recorded
    assert talk(session, "WGO 1 1")[1] == 0
    assert device.recorder.recorded == before + 20 > 20
    # one that a wave started begins again with the next
    session = opened()
    device = session._interpreter.device
    talk(session, "DRC 1 1 7\nWAV 1 X PNT 1 2 0 2\nWSL 1 1\nWGO 1 1\nPOS?\nPOS?")
    before = device.recorder.recorded
    assert talk(session, "WGO 1 1")[1] == 0
    # the time of the question for the error passes with what comes next
    session._interpreter.pace.pass_time(0.0)
    assert device.recorder.recorded == 10 < before
