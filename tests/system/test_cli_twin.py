"""`flexstage twin`: the process of a user, its signals, and what it says about bad input."""

import json
import re
import signal
import socket
import subprocess
import sys
import threading

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.records import read_record
from flexstage.stage.designs import design
from flexstage.virtual import virtual_stage

TIMEOUT = 300.0
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


class Twin:
    """A twin in a process of its own, started and ended as by a user."""

    def __init__(self, *words):
        command = [sys.executable, "-m", "flexstage", "twin", *words]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.watchdog = threading.Timer(TIMEOUT, self.process.kill)
        self.watchdog.start()
        self.line = self.process.stdout.readline()

    def end(self, number=signal.SIGTERM):
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=TIMEOUT)
        self.watchdog.cancel()
        self.watchdog.join()
        return self.process.returncode, out, err


@pytest.fixture
def start():
    twins = []

    def begin(*words):
        twins.append(Twin(*words))
        return twins[-1]

    yield begin
    for twin in twins:
        if twin.process.poll() is None:
            twin.process.kill()
        twin.process.communicate(timeout=TIMEOUT)
        twin.watchdog.cancel()
        twin.watchdog.join()


def ask(link, data, end=b"\n"):
    link.sendall(data)
    said = b""
    while not said.endswith(end) or said.endswith(b" \n"):
        piece = link.recv(65536)
        assert piece
        said += piece
    return said.decode("latin-1")


def refused(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["twin", *words])
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    return ended.value.code, said.err


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]


@POSIX
def test_a_conversation_with_a_process(start, tmp_path):
    port = free_port()
    table = tmp_path / "table.yaml"
    table.write_text(
        "table: 1\nname: t\nscale: {radius: 40 mm, eccentricity: 9 um}\n"
        "heads: {angles: [0 deg, 90 deg]}\naxis: {speed: 60 rpm}\ntolerance: {error: 1 arcsec}\n",
        "utf-8",
    )
    link = None

    def knock():
        """As a client that tries again where it is refused, and then waits a second for answers."""
        nonlocal link
        for _ in range(int(TIMEOUT / 0.01)):
            try:
                link = socket.create_connection(("127.0.0.1", port), timeout=1.0)
                link.sendall(b"*IDN?\nPOS?\n")
                break
            except ConnectionRefusedError:
                threading.Event().wait(0.01)

    client = threading.Thread(target=knock)
    client.start()
    twin = start("vgtu-piezo", "--model", "lumped", "--address", str(port), "--fast", "--seed", "4",
                 "--identity", "flexstage", "--table", str(table), "--json")  # fmt: skip
    client.join()
    # the port opens when it can answer
    with link:
        assert link.recv(65536).endswith(b"\n")
    said = json.loads(twin.line)
    assert said["stage"] == "vgtu-piezo"
    assert said["address"] == f"gcs://127.0.0.1:{said['port']}"
    assert said["fast"] is True
    assert said["channels"] == {"angle": 13, "head 1": 14, "head 2": 15}
    with socket.create_connection(("127.0.0.1", said["port"]), timeout=TIMEOUT) as link:
        assert ask(link, b"*IDN?\n").startswith("flexstage, simulated vgtu-piezo, twin-4, ")
        assert ask(link, b"IFC? IPADR\n") == f"IPADR=127.0.0.1:{port}\n"
        assert ask(link, b"CST?\n") == "1=x \n2=y\n"
        assert ask(link, b"TSC?\n") == "15\n"
        # a head reads the angle of the table, but for the eccentricity [urad]
        angle, head = (
            float(line.split("=")[1]) for line in ask(link, b"TSP? 13 14\n").split("\n")[:2]
        )
        assert 0.0 < abs(head - angle) < 2e3
        assert ask(link, b"SVO 1 1\nMOV 1 20\nONT? 1\nONT? 1\nONT? 1\n", b"1=1\n")
        while ask(link, b"ONT? 1\n") != "1=1\n":
            pass
        # within the window of arrival and the noise of the sensor
        assert float(ask(link, b"POS? 1\n").split("=")[1]) == pytest.approx(20.0, abs=0.06)
        assert ask(link, b"ERR?\n") == "0\n"
        # another program may command, too
        with socket.create_connection(("127.0.0.1", said["port"]), timeout=TIMEOUT) as other:
            assert ask(other, b"MOV 1 25\nERR?\n") == "0\n"
    assert twin.end(signal.SIGTERM) == (0, "", "")


@pytest.mark.slow
@POSIX
def test_an_interrupt_ends_it_well_in_real_time(start):
    twin = start("vgtu-mechanical", "--address", "0.0.0.0:0", "--axes", "X,Y")
    assert twin.line.startswith("twin of vgtu-mechanical at gcs://0.0.0.0:")
    assert "simulated" in twin.line
    assert twin.line.endswith("Ctrl-C stops it\n")
    port = int(twin.line.split(" at gcs://0.0.0.0:")[1].split(" ")[0])
    where = ("127.0.0.1", port)
    with socket.create_connection(where, timeout=TIMEOUT) as link:
        # as what it answers where nothing else is said
        assert re.fullmatch(
            r"Simulated Physik Instrumente \(flexstage\), C-884, twin-0, .*\n",
            ask(link, b"*IDN?\n"),
        )
        assert "SVA" not in ask(link, b"HLP?\n")
        assert ask(link, b"SAI?\n") == "X \nY\n"
        assert ask(link, b"MOV X 0.1\nERR?\n") == "5\n"  # it has been at no switch yet
        assert ask(link, b"FRF\nERR?\n") == "0\n"
        first = float(ask(link, b"SPA? 1 0x7F000001\n").split("=")[1])
        while float(ask(link, b"SPA? 1 0x7F000001\n").split("=")[1]) <= first + 0.05:
            pass
        # a client that is still connected does not hold it up
        status, out, err = twin.end(signal.SIGINT)
    assert (status, out) == (0, "")
    warned, *more = err.splitlines()
    assert warned == f"flexstage: anyone who can reach 0.0.0.0:{port} can move this simulated stage"
    assert not more or "too slow" in more[0]


def test_a_port_that_is_taken(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        status, err = refused(capsys, "vgtu-mechanical", "--address", str(port))
    assert status == 1
    assert f"cannot listen at 127.0.0.1:{port}" in err
    assert "--address" in err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["vgtu-pieso"], "did you mean 'vgtu-piezo'?"),
        (["vgtu-piezo", "--model", "solid"], "lumped or superelement, got 'solid'"),
        (["vgtu-piezo", "--amplifier", "x"], "voltage or charge, got 'x'"),
        (["vgtu-piezo", "--identity", "C-999"], "C-863, C-884 or flexstage, got 'C-999'"),
        (["vgtu-piezo", "--axes", "X,Y,Z"], "at most 2 different names of 1 to 8 letters"),
        (["vgtu-piezo", "--axes", "2"], "such as X,Y, got '2'"),  # the second is called so already
        (["vgtu-piezo", "--axes", "X,"], "got 'X,'"),
        (["vgtu-piezo", "--axes", "a-b"], "got 'a-b'"),
        (["vgtu-piezo", "--address", "70000"], "a port from 0 to 65535, optionally"),
        (["vgtu-piezo", "--servo-rate", "1 um"], "'um' is not a unit of frequency"),
        (["vgtu-piezo", "--servo-rate", "1 Hz"], "must be from 1000 to 50000"),
        (["vgtu-piezo", "--seed", "-1"], "--seed"),
        (["vgtu-piezo", "--table", "absent.yaml"], "absent.yaml"),
    ],
)
def test_bad_input_is_one_sentence(capsys, words, expected):
    status, err = refused(capsys, *words)
    assert status == 2
    assert expected in err


@pytest.mark.parametrize("host", ["ä" * 80, "a" * 70, "x..y"])
def test_a_host_that_no_name_can_have_gets_a_sentence(capsys, host):
    with pytest.raises(SystemExit) as ended:
        main(["twin", "vgtu-piezo", "--address", f"{host}:0"])
    said = capsys.readouterr()
    assert (ended.value.code, said.out) == (1, "")
    assert said.err.count("\n") == 1
    assert "choose another host or port by --address" in said.err


# ------------------------------------------------------------------ a record that is played


def drive_file(file, t, **columns):
    heading = ",".join(["time (s)", *(name.replace("_", " ") for name in columns)])
    np.savetxt(
        file, np.column_stack((t, *columns.values())), delimiter=",", header=heading, comments=""
    )
    return file


def play(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["twin", "vgtu-piezo", *map(str, words)])
    return ended.value.code, capsys.readouterr()


def played(capsys, tmp_path, t, u, *words):
    drive = drive_file(tmp_path / "drive.csv", t, **{"drive (V)": u})
    return play(capsys, "--play", drive, "--out", tmp_path / "measured.csv", *words)


@pytest.mark.parametrize("rate", [300.0, 4000.0])
def test_a_record_that_is_played_is_what_the_twin_does(capsys, monkeypatch, tmp_path, rate):
    t = np.arange(round(0.8 * rate)) / rate
    u = 70.0 - 45.0 * np.cos(2.0 * np.pi * 2.5 * t)
    monkeypatch.setattr("flexstage.virtual.stage.VirtualStage.samples_at_once", 97)
    status, said = played(capsys, tmp_path, t, u, "--axis", "y", "--seed", "3", "--json", "-q")
    assert (status, json.loads(said.out)["files"]) == (0, [str(tmp_path / "measured.csv")])
    record = read_record(tmp_path / "measured.csv")
    assert [(c.name, c.unit) for c in record.channels[1:]] == [("voltage", "V"), ("position", "m")]
    assert record.sample_rate_hz == pytest.approx(rate)
    many = round(10e3 / rate)
    stage = virtual_stage(design("vgtu-piezo"), model="lumped", seed=3, sample_rate_hz=rate * many)
    lead = round(0.5 * rate)
    whole = np.concatenate((25.0 * np.arange(lead) / lead, u))
    at = np.arange(whole.size * many) / many
    command = np.interp(at, np.arange(whole.size), whole)
    samples = stage.run(np.array([0.0 * command, command]), [False, False])
    np.testing.assert_array_equal(
        record.channel("position").values, samples.reading[1, lead * many :: many]
    )
    # a converter of 20 bits and an amplifier of one pole are between
    np.testing.assert_allclose(record.channel("voltage").values, u, atol=0.3)


def test_what_exceeds_limits_is_refused_before_anything_is_written(capsys, tmp_path):
    t = np.arange(400) / 1e3
    status, said = played(capsys, tmp_path, t, 65.0 - 60.0 * np.cos(20.0 * t))
    assert (status, said.out) == (2, "")
    assert "axis 'x' would be sent to 12" in said.err
    assert "its limits are 0 to 120 V" in said.err
    assert not (tmp_path / "measured.csv").exists()
    with pytest.raises(SystemExit):
        main(["twin", "vgtu-piezo", "--out", str(tmp_path / "a.csv")])
    assert "--play and --out are used together" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", ["csv", "npz", "h5", "mat"])
def test_what_was_played_is_marked_as_simulated_in_every_format(capsys, tmp_path, suffix):
    drive = drive_file(tmp_path / "drive.csv", np.arange(60) / 1e3, **{"u (V)": np.arange(60.0)})
    file = tmp_path / f"measured.{suffix}"
    assert play(capsys, "--play", drive, "--out", file, "--seed", "4")[0] == 0
    record = read_record(file)
    assert record.attributes["simulated"] == "twin of vgtu-piezo, axis x, seed 4"
    assert f"'{file.name}' was not measured but simulated: twin of vgtu-piezo" in record.notes[-1]
    assert [c.name for c in record.channels] == ["time", "voltage", "position"]


# The memory of the first record is in the second: a stack that comes from its top stands higher.
def test_records_are_played_in_turn_and_compared_with_their_reference(capsys, tmp_path):
    t = np.arange(500) / 1e3
    big = drive_file(tmp_path / "big.csv", t, **{"u (V)": 60.0 - 60.0 * np.cos(6 * np.pi * t)})
    held = np.full(500, 30.0)
    command = drive_file(
        tmp_path / "command.csv", t, **{"command (V)": held, "reference (um)": 0.5 * held}
    )
    means = []
    for records in ((command,), (big, command)):
        words = [word for record in records for word in ("--play", record)]
        status, output = play(capsys, *words, "--out", tmp_path / "a.csv", "--json")
        assert status == 0
        position = read_record(tmp_path / "a.csv").channel("position").values
        error = position - 0.5e-6 * held
        tracking = json.loads(output.out)["tracking"]
        expected = {
            "rms": np.sqrt(np.mean(error**2)), "mean": error.mean(), "largest": abs(error).max()
        }  # fmt: skip
        assert tracking == pytest.approx(expected)
        means.append(tracking["mean"])
    assert means[1] - means[0] > 7e-6
    _, output = play(capsys, "--play", command, "--out", tmp_path / "a.csv")
    assert "reading less reference of" in output.out


@pytest.mark.parametrize(
    ("columns", "words", "sentence"),
    [
        ({"temperature (K)": 1.0}, (), "must have one column of a voltage next to its time"),
        ({"u (V)": 1.0, "voltage (V)": 1.0}, (), "got 2 of 1: u [V], 2: voltage [V]"),
        ({"u (V)": 1.0}, ("--axis", "q"), "axis 'q', which does not exist (there are: x, y)"),
        ({"u (V)": 1.0}, ("--play", "{slow}"), "one sample rate, got 1000 Hz and, of '{slow}'"),
        ({"u (V)": 1.0}, ("--out", "{drive}"), "--out {drive} is a record of --play"),
        ({"u (V)": 1.0}, ("--table", "a.yaml"), "--table serves a table with the controller"),
    ],
)
def test_what_cannot_be_played_is_one_sentence(capsys, tmp_path, columns, words, sentence):
    t = np.arange(60) / 1e3
    values = {name: size * np.arange(60.0) for name, size in columns.items()}
    files = {
        "drive": drive_file(tmp_path / "drive.csv", t, **values),
        "slow": drive_file(tmp_path / "slow.csv", 3.0 * t, **values),
    }
    before = files["drive"].read_bytes()
    told = [word.format(**files) for word in words]
    status, output = play(
        capsys, "--play", files["drive"], "--out", tmp_path / "measured.csv", *told
    )
    assert (status, output.out, output.err.count("\n")) == (2, "", 1)
    assert sentence.format(**files) in output.err
    assert not (tmp_path / "measured.csv").exists()
    assert files["drive"].read_bytes() == before
