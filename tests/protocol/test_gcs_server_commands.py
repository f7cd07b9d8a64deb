"""Every command of the simulated GCS controller with good and with bad arguments."""

import re

import pytest

from flexstage.instruments.servo import Notch, ServoSettings
from flexstage.instruments.twin.device import Refusal
from flexstage.instruments.twin.errors_gcs import CODES
from flexstage.instruments.twin.session import Session
from tests.gcs_device import FormulaDevice, controller, opened, talk

E = "{:.9e}".format

#: Lines that are carried out, and what is answered; each to a controller of its own.
GOOD = {
    "*IDN?": "flexstage, formula (simulated), 7, 1.2\n",
    "CCL 1 advanced\nCCL?": "1\n",
    "CCL 1 advanced\nCCL 0\nCCL?": "0\n",
    "CST?": "1=x \n2=y\n",
    "CST? 2": "2=y\n",
    "CSV?": "2.0\n",
    "csv?": "2.0\n",
    "  CSV?  ": "2.0\n",
    "DRC 2 3 20 1 2 7\nDRC? 2 1": "2=3 20 \n1=2 7\n",
    "DRC 2 3 20\nDRC 2 0 0\nDRC? 2": "2=0 0\n",
    "DRL?": "1=0 \n2=0 \n3=0\n",
    "DRT 2 2 0\nDRT?": "1=0 0 \n2=0 0 \n3=0 0\n",  # the next command resets it
    "DRT 0 1 0\nDRT? 3": "3=1 0\n",
    "AOS? 1": f"1={E(0)}\n",
    "ATZ\nATZ?\nATZ?": "1=1 \n2=1\n" * 2,
    "SVO 1 1\nMOV 1 20\nATZ 1 5 2 NAN\nONT?\nSVO?\nVOL? 1": (f"1=1 \n2=1\n1=0 \n2=0\n1={E(5)}\n"),
    "CTO 1 2 1 1 3 3 1 5 10.5\nCTO? 1 5 1 6\nCTO?": (
        "1 5=10.5 \n1 6=0\n1 2=1 \n1 3=3 \n1 5=10.5\n"
    ),
    "DCO 1 1\nDCO?": "1=1 \n2=0\n",
    "EAX 2 0\nEAX?\nEAX 2 1\nEAX? 2": "1=1 \n2=0\n2=1\n",
    "IDN?": "flexstage, formula (simulated), 7, 1.2\n",
    "IFC? IPADR MACADR": "IPADR=127.0.0.1:0 \nMACADR=00-00-00-00-00-00\n",
    "LIM?": "1=0 \n2=0\n",
    "NLM 1 5\nPLM 1 50\nNLM? 1\nPLM?": f"1={E(5)}\n1={E(50)} \n2={E(31)}\n",
    "ONL 1 0\nONL?\nONL 1 1\nONL? 1": "1=0 \n2=1\n1=1\n",
    "OVF?": "1=0 \n2=0\n",
    "RON 1 0\nRON?": "1=0 \n2=0\n",
    "SSN?": "7\n",
    "TAD? 1": "1=-81743\n",  # 29 um below the middle of 62 um, of 93 um
    "TNS? 3": f"3={E(3)}\n",
    "TRS?": "1=0 \n2=0\n",
    "TWS 1 10 1 1 12 0\nTWS?\nTWC\nTWS?": "1 10=1 \n1 12=0\n0\n",
    "VCO 1 0\nVCO?\nVEL 1 5\nVEL? 1\nVCO 1 1\nVEL? 1": f"1=0 \n2=1\n1={E(5)}\n1={E(5)}\n",
    "VMA 1 90\nVMI 1 2\nVMA? 1\nVMI?": f"1={E(90)}\n1={E(2)} \n2={E(0)}\n",
    "WOS 1 -2.5\nWOS?": f"1={E(-2.5)} \n2={E(0)}\n",
    "MAC?": "\n",
    "RMC?": "\n",
    "ERR?": "0\n",
    "FRF? 1": "1=1\n",
    "HLT 1": "",
    "MOV? 1": f"1={E(0)}\n",
    "SVO 2 1\nMVR 2 3\nMVR 2 1.5\nMOV? 2": f"2={E(4.5)}\n",
    "NLM?": f"1={E(-2)} \n2={E(1)}\n",
    "ONT? 2": "2=1\n",
    "PLM? 2": f"2={E(31)}\n",
    "POS? 1": f"1={E(0)}\n",
    "PUN? 2 1": "2=um \n1=um\n",
    "RBT": "",
    "RTR 3\nRTR?": "3\n",
    "SAI? ALL": "1 \n2\n",
    "SEP? 1 0x0E000200": f"1 0x0E000200={E(1e-4)}\n",
    "SPA 1 117441280 7\nSPA? 1 0x07000300\nSEP? 1 0x07000300": (
        f"1 0x07000300={E(7)}\n1 0x07000300={E(0)}\n"
    ),
    "SPA 2 0x07000200 125\nVEL? 2": f"2={E(125)}\n",
    "SPA? 1 0xe000200 1 0X0E000200 1 234881536": (
        f"1 0xe000200={E(1e-4)} \n1 0X0E000200={E(1e-4)} \n1 234881536={E(1e-4)}\n"
    ),
    "SPA? 0 0x16000000": "0 0x16000000=1\n",
    "SPA 1 0x16000300 2\nTNR?\nDRC?": "2\n1=0 0 \n2=0 0\n",
    "SPA 1 0x06000500 0\nSPA? 1 0x6000500": "1 0x6000500=0\n",
    "DRT 1 1 0 2 1 0 3 1 0\nDRT?": "1=1 0 \n2=1 0 \n3=1 0\n",
    "SPA 0 0x16000000 9\nRTR?": "9\n",
    "SPA 1 0x13000109 9\nWTR? 0": "1=9 1 \n2=9 1\n",
    "SPA 2 0x7F000011 3\nSPA? 2 0x7F000011 1 0x7F000011": "2 0x7F000011=3 \n1 0x7F000011=0\n",
    "SPA? 1 0x7F000012 2 0x7F000012": "1 0x7F000012=x \n2 0x7F000012=y\n",
    "SPA? 3 0x7F000020 3 0x7F000021": "3 0x7F000020=x.yaw \n3 0x7F000021=urad\n",
    "SPA? 2 0x07000601": "2 0x07000601=um\n",
    "SVA 1 8\nSVR 1 -3 2 4\nSVA?": f"1={E(5)} \n2={E(4)}\n",
    "SVO 1 1\nSVO? 1": "1=1\n",
    "TMN? 1": f"1={E(-2)}\n",
    "TMX? 1": f"1={E(60)}\n",
    "TNR?": "3\n",
    "TPC?": "2\n",
    "TSC?": "3\n",
    "TSP? 3": f"3={E(3)}\n",
    "TWG?": "2\n",
    "VEL 1 500 2 125.5\nVEL?": f"1={E(500)} \n2={E(125.5)}\n",
    "VMA? 2": f"2={E(100)}\n",
    "VMI?": f"1={E(-5)} \n2={E(0)}\n",
    "VOL? 2": f"2={E(0)}\n",
    "WAV 1 X PNT 1 3 1 2 3\nWAV 1 X PNT 1 2 1 2\nWAV?": "1 1=2 \n2 1=0 \n3 1=0 \n4 1=0\n",
    "WAV 1 X PNT 1 3 1 2 3\nWCL 1 4\nWAV? 1": "1 1=0\n",
    "WAV 3 + PNT 1 2 1 1\nWAV 3 + PNT 1 1 2\nWAV? 3 1": "3 1=2\n",
    "WGC 1 0 2 7\nWGC?": "1=0 \n2=7\n",
    "WGO? 2": "2=0\n",
    "WAV 2 X PNT 1 600 " + "1 " * 600 + "\nWMS? 2 1": "2=5000 \n1=4400\n",
    "WSL 1 4 2 1\nWSL?": "1=4 \n2=1\n",
    "WSL 1 4\nWSL 1 0\nWSL? 1": "1=0\n",
    "WTR 0 12 1\nWTR? 2": "2=12 1\n",
    "WTR 1 5 1 2 5 1\nWTR? 1": "1=5 1\n",
    "STP": "",
}

#: Lines that are refused without an answer, and the error.
BAD = {
    "": 0,
    "  ": 0,
    "XYZ": 2,
    "POS": 2,
    "MOV1 2": 2,
    "é": 1,
    "POS? \x00": 1,
    "POS? \x7f1": 1,
    "*IDN? 1": 24,
    "CSV? 1": 24,
    "VER? x": 24,
    "HLP? MOV": 24,
    "HPA? 1": 24,
    "HDR? 1": 24,
    "ERR? 1": 24,
    "IDN? 1": 24,
    "MAC": 24,
    "MAC BEG": 24,
    "MAC BEG A-B": 18,
    "MAC DEL A": 20,
    "MAC START A": 20,
    "MAC END": 1002,
    "MAC END A": 24,
    "MAC XYZ A": 1003,
    "MAC? A": 20,
    "MAC? A B": 24,
    "RMC? A": 24,
    "SSN? 1": 24,
    "TWC 1": 24,
    **{f"{name}? 3": 15 for name in ("AOS", "ATZ", "DCO", "EAX", "LIM", "OVF", "RON", "TRS")},
    "VCO? 3": 15,
    "ATZ 1": 24,
    "ATZ 3 0": 15,
    "ATZ 1 130": 302,
    "ATZ 1 x": 25,
    "CTO 1 2": 24,
    "CTO 4 2 1": 17,
    "CTO 1 99 1": 17,
    "CTO 1 2 x": 25,
    "CTO? 1": 24,
    "CTO? 1 99": 17,
    "DCO 1": 24,
    "DCO 1 2": 17,
    "EAX 3 1": 15,
    "FNL 3": 15,
    "FNL": 32,
    "FPL 1": 32,
    "FRF 1": 31,
    "IFC? RS": 54,
    "NLM 1 -3": 27,
    "NLM 1 61": 27,
    "PLM 2 0": 27,
    "PLM 2": 24,
    "ONL 1": 24,
    "ONL 3 1": 14,
    "ONL? 3": 14,
    "RON 1 1": 31,
    "SRG? 1": 24,
    "SRG? 3 1": 15,
    "SRG? 1 2": 17,
    "TAD? 4": 14,
    "TNS? 4": 14,
    "TWS 1 10": 24,
    "TWS 9 10 1": 17,
    "TWS 1 0 1": 17,
    "TWS 1 1 2": 17,
    "TWS? 9": 17,
    "VCO 1 2": 17,
    "VMA 3 5": 14,
    "VMA 1 130": 27,
    "VMI 1 -6": 27,
    "WOS 1": 24,
    "WOS 3 1": 15,
    "WOS? 3": 15,
    "SPA 1 0x06000500 2": 17,
    "SPA 1 0x16000300 4": 17,
    "SPA 1 0x16000300 0": 17,
    "DRT 1 1 0 2 0 0": 17,
    "DRT 1 1 0 2": 24,
    "RBT 1": 24,
    "TNR? 1": 24,
    "TPC? 1": 24,
    "TSC? 1": 24,
    "TWG? 1": 24,
    "RTR?  1": 24,
    "CCL? 1": 24,
    "SAI? 1": 1,
    "SAI? ALL ALL": 24,
    "CCL": 24,
    "CCL 2": 17,
    "CCL 1": 56,
    "CCL 1 x": 56,
    "CCL -1": 25,
    "MOV": 24,
    "MOV 1": 24,
    "MOV 3 1": 15,
    "MOV 1 1 1 2": 22,
    "MOV 1 1": 5,
    "MOV 1 1 2": 24,
    "MOV 1 x": 25,
    "MOV 1 nan": 25,
    "MOV 1 inf": 25,
    "MOV 1 1e400": 25,
    "MOV 1 0x10": 25,
    "MOV 1 1_0": 25,
    "MOV 1 1,5": 25,
    "MVR 1 5": 5,
    "MVR 1": 24,
    **{f"{name}? 3": 15 for name in ("MOV", "CST", "FRF", "NLM", "PLM", "PUN", "SVA", "SVO")},
    **{f"{name}? 3": 15 for name in ("TMN", "TMX", "VEL")},
    "VMI? 3": 14,
    "ONT? 0": 15,
    "POS? x": 15,
    "POS? 1 9": 15,
    "SVO 1": 24,
    "SVO 1 2": 17,
    "SVO 1 on": 25,
    "SVO 9 1": 15,
    "SVA 1 121": 302,
    "SVA 2 -0.001": 302,
    "SVA 1 1 2 101": 302,
    "SVR 1 500": 302,
    "SVA 1": 24,
    "HLT 3": 15,
    "VEL 1 0": 8,
    "VEL 1 -1": 8,
    "VEL 1 2001": 8,
    "VEL 1 100 2 1001": 8,
    "VEL 1": 24,
    "VOL? 3": 14,
    "VMA? x": 14,
    "TSP? 4": 14,
    "TSP? 0": 14,
    "SPA": 24,
    "SPA 1 0x07000300": 24,
    "SPA 1 0x99 1": 54,
    "SPA 1 zz 1": 25,
    "SPA 3 0x07000300 1": 15,
    "SPA 2 0x16000000 1": 15,
    "SPA 9 0x7F000020 a": 14,
    "SPA 1 0x07000000 1": 64,
    "SPA 1 0x7F000020 name": 64,
    "SPA 1 0x07000300 x": 25,
    "SPA 1 0x07000300 -1": 17,
    "SPA 1 0x08000100 6000": 17,
    "SPA 1 0x08000300 0": 17,
    "SPA 1 0x7F000001 -1": 17,
    "SPA 1 0x7F000001 1e9": 17,
    "SPA 1 0x7F000003 2": 17,
    "SPA 1 0x7F000011 5": 400,
    "SPA? 1": 24,
    "SPA? 1 0x0": 54,
    "SEP? 9 0x0E000200": 15,
    "DRC": 24,
    "DRC 1 1": 24,
    "DRC 4 1 1": 57,
    "DRC 0 1 1": 57,
    "DRC 1 1 99": 58,
    "DRC 1 3 1": 59,
    "DRC 1 4 20": 59,
    "DRC? 9": 57,
    "DRT 0 1": 24,
    "DRT 9 1 0": 57,
    "DRT 0 3 0": 17,
    "DRT? 9": 57,
    "DRL? 4": 57,
    "DRR? 1": 24,
    "DRR?": 77,
    "DRR? 1 1 1": 77,
    "DRR? 0 1 1": 77,
    "DRR? 1 1 9": 57,
    "RTR": 24,
    "RTR 0": 17,
    "RTR 1.5": 25,
    "RTR 99999999999999": 25,
    "WAV": 404,
    "WAV 1 X": 404,
    "WAV 5 X PNT 1 1 0": 400,
    "WAV 0 X PNT 1 1 0": 400,
    "WAV 1 Y PNT 1 1 0": 1,
    "WAV 1 X SAW 1 1 0": 402,
    "WAV 1 X PNT 1 2 0": 404,
    "WAV 1 X PNT 1": 404,
    "WAV 1 X PNT 2 1 0": 405,
    "WAV 1 & PNT 3 1 0": 405,
    "WAV 1 X PNT 1 1 nan": 25,
    "WAV 1 X SIN_P 10 1 0 10 0": 404,
    "WAV 1 X SIN_P 10 1 0 11 0 5": 405,
    "WAV 1 X SIN_P 10 1 0 10 10 5": 405,
    "WAV 1 X SIN_P 10 1 0 10 0 0": 405,
    "WAV 1 X SIN_P 10 1 0 10 0 10": 405,
    "WAV 1 X SIN_P 0 1 0 0 0 0": 405,
    "WAV 1 X SIN_P 10 x 0 10 0 5": 25,
    "WAV 1 X SIN_P 9999999999 1 0 10 0 5": 403,
    "WAV 1 X RAMP 10 1 0 10 0 3 5": 405,
    "WAV 1 X RAMP 10 1 0 10 0 2": 404,
    "WAV 1 X LIN 10 1 0 10 0 6": 405,
    "WAV 1 X LIN 5001 1 0 10 0 1": 403,
    "WAV? 5": 400,
    "WAV? 1 2": 24,
    "WCL": 24,
    "WCL 5": 400,
    "GWD?": 401,
    "GWD? 1": 24,
    "GWD? 1 1 1": 401,
    "GWD? 1 1 7": 400,
    "WMS? 7": 400,
    "WSL 1": 24,
    "WSL 3 1": 15,
    "WSL 1 5": 400,
    "WSL? 3": 15,
    "WGC 1": 24,
    "WGC 3 1": 15,
    "WGC 1 -1": 25,
    "WGC? 3": 15,
    "WGO": 24,
    "WGO 1 1": 75,
    "WGO 3 1": 15,
    "WGO 1 2": 406,
    "WGO 1 257": 75,
    "WGO 1 0x101": 75,
    "WGO 1 3": 406,
    "WGO 1 0x10": 406,
    "WGO 1 x": 25,
    "WGO? 3": 15,
    "WGR": 75,
    "WGR 1": 24,
    "WTR 1 5": 24,
    "WTR 3 5 1": 15,
    "WTR 0 0 1": 17,
    "WTR 0 5 0": 17,
    "WTR 0 5 2": 17,
    "WTR 1 5 1 2 6 1": 17,
    "WTR 0 99999 1": 17,
    "WTR? 3": 15,
    "IMP": 24,
    "IMP 3": 15,
    "IMP 1": 34,
    "IMP 1 5": 24,
}


@pytest.mark.parametrize("lines", GOOD)
def test_good_arguments(lines):
    answers, errors = talk(opened(), lines)
    # a stop is told to its client, and the rest is carried out
    assert (answers, errors) == (GOOD[lines], [10] if lines[:3] in ("STP", "HLT") else 0)


@pytest.mark.parametrize("line", BAD)
def test_bad_arguments(line):
    session = opened()
    device = session._interpreter.device
    parameters = session.feed(b"SPA?\n")
    assert session.feed(line.encode("latin-1") + b"\n") == b""
    assert session.feed(b"ERR?\n") == f"{BAD[line]}\n".encode()
    assert session.feed(b"ERR?\n") == b"0\n"
    # nothing has moved, and no parameter has changed but the time
    assert device.calls == []
    clock = re.compile(rb"0x7F000001=[^ \n]*")
    assert clock.sub(b"", session.feed(b"SPA?\n")) == clock.sub(b"", parameters)


def test_every_command_has_a_good_and_a_bad_example():
    names = set(controller().commands)
    elsewhere = {"VER?", "HLP?", "HPA?", "HDR?", "SPA?", "DRR?", "GWD?", "WGO", "WGR", "IMP", "MOV"}
    elsewhere |= {"FNL", "FPL", "FRF", "MAC", "SRG?"}
    good = {line.split(" ")[0] for lines in GOOD for line in lines.strip().upper().split("\n")}
    bad = {line.split(" ")[0] for line in BAD if line.strip()}
    assert names - elsewhere - good == set()
    assert names - bad == {"STP"}  # it stops whatever is said with it


def test_help_lists_every_command_once_with_its_name_first():
    lines = opened().feed(b"HLP?\n").decode().rstrip("\n").split(" \n")
    assert lines[0] == "The following commands are valid:"
    assert lines[-1] == "end of help"
    listed = [line.split(" ")[0] for line in lines[1:-1]]
    assert sorted(listed) == sorted(["#4", "#5", "#7", "#9", "#24", *controller().commands])
    session = opened()
    for name in listed[5:]:
        session.feed(f"{name} ? ? ?\n".encode())
        assert session.feed(b"ERR?\n") != b"2\n"


def test_every_refusal_has_a_number():
    assert set(CODES) == set(Refusal)
    assert CODES[Refusal.OUT_OF_LIMITS] == 7
    assert all(number > 0 for number in CODES.values())


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
    session = Session(interpreter)
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
    session = Session(interpreter)
    session.feed(b"SPA 1 0x08000100 0 1 0x08000102 900\n")
    interpreter.device.set_servo_settings("1", ServoSettings(notches=(Notch(frequency_hz=456.0),)))
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
    assert talk(session, "WAV? 2\nWGO 1 0\nWGO?\nSVA 1 5\nONT?\nSVA? 1") == (
        f"2 1=1\n1=0 \n2=0\n1=1 \n2=1\n1={E(5)}\n",
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


def test_a_refused_move_starts_no_record_later():
    session = opened()
    device = session._interpreter.device
    assert talk(session, "DRC 1 1 7\nDRT 0 1 0\nSVA 1 999\nDRT 0 0 0\nSVA 1 5") == ("", [302])
    assert not device.recording()
    assert device.recorded() == 0


def test_a_wave_that_runs_is_recorded_again():
    session = opened()
    device = session._interpreter.device
    talk(session, "DRC 1 1 7\nWAV 1 X PNT 1 2 1 2\nWSL 1 1\nWGC 1 0\nWTR 0 50 1\nWGO 1 1")
    # the error was asked for 1 ms later: ten samples of the loop
    assert device.recorded() == 10
    assert talk(session, "POS?\nPOS?\nWGR")[1] == 0
    assert device.recorded() == 10
    assert device.now > 8e-3


def test_what_was_recorded_is_read_as_what_it_was():
    """Changing what a table records, or the rate, does not rename what is in it."""
    session = opened()
    talk(session, "DRC 1 1 7 2 2 7\nRTR 4\nDRT 0 1 0\nSVA 1 3 2 9\nONT?\nRTR 9\nDRC 1 1 2")
    assert session.feed(b"DRL?\n").startswith(b"1=0 \n2=")
    assert talk(session, "DRR? 1 1 1") == ("", [77])
    text = session.feed(b"DRR? 1 2 2\n")
    assert b"# SAMPLE_TIME = 0.000400000000 \n" in text
    assert b"# NAME0 = Control Voltage of output chan 2 \n" in text


def test_triggers_of_the_recorder():
    def recording(lines):
        device = FormulaDevice()
        from flexstage.instruments.twin.clock import FastTime
        from flexstage.instruments.twin.interpreter import Interpreter

        session = Session(Interpreter(device, FastTime(device)))
        assert talk(session, "DRC 1 1 7\n" + lines)[1] == 0
        return device.recording() or device.recorded() > 0

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
    before = device.recorded()
    assert talk(session, "WGO 1 1")[1] == 0
    assert device.recorded() == before + 20 > 20
    # one that a wave started begins again with the next
    session = opened()
    device = session._interpreter.device
    talk(session, "DRC 1 1 7\nWAV 1 X PNT 1 2 0 2\nWSL 1 1\nWGO 1 1\nPOS?\nPOS?")
    before = device.recorded()
    assert talk(session, "WGO 1 1")[1] == 0
    assert device.recorded() == 10 < before


def test_a_macro_is_its_writers_until_it_ends():
    interpreter = controller()
    first, second = Session(interpreter), Session(interpreter)
    first.feed(b"SVO 1 1\nMAC BEG GO\nMOV 1 5\n")
    assert first.feed(b"ERR?\nPOS?\n") == b""  # lines of the macro, ERR? too
    assert second.feed(b"MOV? 1\nMAC BEG X\nERR?\n") == b"1=0.000000000e+00\n1001\n"
    first.feed(b"MAC END\n")
    assert first.feed(b"MAC? GO\nMOV? 1\n") == b"MOV 1 5 \nERR? \nPOS?\n1=0.000000000e+00\n"
    assert second.feed(b"MAC START GO\nMOV? 1\n") == b"1=5.000000000e+00\n"
    # what was begun and not ended goes with its writer
    first.feed(b"MAC BEG X\nMOV 1 9\n")
    first.close()
    assert second.feed(b"MAC?\nMAC BEG X\nMAC END\nERR?\n") == b"GO\n0\n"


def test_macros_are_kept_started_with_values_and_deleted():
    session = opened()
    session.feed(b"SVO 1 1\nMAC BEG up\nMVR 1 $1\nSVO? 1\nMAC END\n")
    assert session.feed(b"MAC?\nMAC? UP\nERR?\n") == b"UP\nMVR 1 $1 \nSVO? 1\n0\n"
    assert session.feed(b"MAC START UP 2.5\nMAC START up 1\nMOV? 1\n") == b"1=3.500000000e+00\n"
    assert session.feed(b"MAC START UP 2.5 7\nMAC START UP\nERR?\n") == b"25\n"
    assert session.feed(b"MAC DEL UP\nMAC?\nERR?\n") == b"\n0\n"


def test_macros_that_start_each_other_end():
    session = opened()
    session.feed(b"MAC BEG A\nMAC START A\nMAC END\nMAC START A\n")
    assert session.feed(b"ERR?\nCSV?\n") == b"1000\n2.0\n"


def test_macros_do_not_grow_without_end():
    session = opened()
    session.feed(b"MAC BEG A\n" + (b"MOV 1 " + b"1" * 1000 + b"\n") * 100 + b"MAC END\n")
    assert session.feed(b"ERR?\n") == b"309\n"
    assert len(session.feed(b"MAC? A\n")) < 70_000


def test_a_macro_that_was_stopped_starts_no_motion():
    session = opened()
    session.feed(b"SVO 1 1\nMAC BEG A\nMOV 1 9\nMAC END\n")
    session.feed(b"MAC START A\n\x18")
    assert session.feed(b"ERR?\nMOV? 1\n") == b"10\n1=0.000000000e+00\n"
