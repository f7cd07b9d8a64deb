"""What goes wrong at a controller: what was sent then, what was not, and what is said of it.

Evidence (Instruments, twin, control): link and controller faults (scripted controllers): every
case, *simulated*
"""

import socket
import threading
from contextlib import closing

import numpy as np
import pytest

from flexstage.base.errors import ControllerError, FlexstageError, LimitError, NotConnectedError
from flexstage.instruments.pi.connection import TransferLimits
from flexstage.instruments.pi.controller import PiController
from flexstage.instruments.pi.conversation import GcsClient
from flexstage.instruments.protocol import Signal, Waveform
from flexstage.instruments.transport import InProcess, NoAnswerError, TcpLink
from flexstage.stage.designs import design
from tests.gcs_script import CutError, InMemory, ScriptedController, served

STAGE = design("vgtu-piezo")
#: Long enough for an answer on a busy computer, and short where it must pass [s].
TIMEOUT = 0.3


class Clock:
    """Time that passes only by sleeping."""

    def __init__(self):
        self.now = 0.0

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def opened(
    script: ScriptedController | None = None, **options
) -> tuple[PiController, ScriptedController, Clock]:
    script, clock = ScriptedController() if script is None else script, Clock()
    controller = PiController.open(
        InProcess(InMemory(script)),
        STAGE,
        clock=lambda: clock.now,
        sleep=clock.sleep,
        **options,
    )
    script.log.clear()
    return controller, script, clock


def commands(log: list[str]) -> list[str]:
    """What came, without questions."""
    return [line for line in log if "?" not in line.split()[0] and line not in ("#5", "#9")]


def cut(_: bytes) -> bytes:
    raise CutError


def soon(condition) -> None:
    """Wait until another thread has done what it should."""
    for _ in range(500):
        if condition():
            return
        threading.Event().wait(0.01)
    raise AssertionError("it did not come")


def shape(*values: float, quantity: str = "voltage") -> Waveform:
    return Waveform(
        values={"x": np.array(values)},
        sample_rate_hz=4e3,
        quantity=quantity,  # type: ignore[arg-type]
    )


# answers that come late, in halves, or never --------------------------------------------------


def late(script: ScriptedController, question: str, carrier: str) -> None:
    """Let the answer to a question come only before that to another one."""
    held: list[bytes] = []
    script.faults[question] = held.append
    script.faults[carrier] = lambda said: held.pop() + said


def test_a_late_answer_is_not_taken_for_that_to_the_next_question():
    controller, script, _ = opened()
    script.target["1"], script.target["2"] = 11.0, 22.0
    late(script, "POS? 1", "*IDN?")
    with pytest.raises(
        NoAnswerError, match=r"did not answer 'POS\? 1' within 2 s; other questions are answered"
    ):
        controller.axes["x"].position()
    # the same question again, whose late answer would look right
    script.target["1"] = 12.0
    assert controller.axes["x"].position() == pytest.approx(12.001e-6)
    assert controller.axes["y"].position() == pytest.approx(22.001e-6)
    assert commands(script.log) == []


@pytest.mark.parametrize("kept", [1, 5, 12])
def test_half_an_answer_is_none_and_its_rest_is_dropped(kept):
    controller, script, _ = opened()
    rest: list[bytes] = []

    def halve(said: bytes) -> bytes:
        rest.append(said[kept:])
        return said[:kept]

    script.faults["POS? 1"] = halve
    script.faults["*IDN?"] = lambda said: rest.pop() + said
    with pytest.raises(NoAnswerError):
        controller.axes["x"].position()
    assert controller.axes["x"].position() == pytest.approx(1e-9)


def test_half_an_answer_whose_rest_is_lost_does_not_spoil_the_next():
    controller, script, _ = opened()
    script.faults["POS? 1"] = lambda said: said[:6]
    with pytest.raises(NoAnswerError):
        controller.axes["x"].position()
    assert controller.axes["x"].position() == pytest.approx(1e-9)


def test_half_a_list_of_lines_is_no_answer():
    controller, script, _ = opened()
    script.faults["HPA?"] = lambda said: said[: len(said) // 2]
    with pytest.raises(NoAnswerError):
        controller.client.ask("HPA?")
    assert controller.axes["x"].position() == pytest.approx(1e-9)


def test_a_late_answer_to_the_identity_is_told_from_a_new_one():
    controller, script, _ = opened()
    held: list[bytes] = []

    def hold(said: bytes) -> None:
        held.append(said)
        # with the answer to whatever is asked next, be it the same
        script.faults |= dict.fromkeys(("*IDN?", "CSV?"), lambda said: held.pop() + said)

    script.faults["*IDN?"] = hold
    with pytest.raises(NoAnswerError):
        controller.client.ask("*IDN?")
    assert controller.client.ask("SAI?") == ["1", "2", "3"]


def test_after_an_answer_of_somebody_else_the_own_one_is_not_taken_for_the_next():
    pieces = [b"Maker, Model, 5, 1\n", b"2.0\n", b"0\n"]
    pieces += [b"77.5\n", b"1=3.5\n", b"Maker, Model, 5, 1\n", b"1=4.5\n"]

    class Link:
        name = "wire"

        def send(self, data: bytes) -> None: ...

        def receive(self, timeout: float) -> bytes:
            return pieces.pop(0)

        def close(self) -> None: ...

    client = GcsClient(Link())
    with pytest.raises(ControllerError, match="another program may be using"):
        client.ask_values("POS?", ["1"])
    assert client.ask_values("POS?", ["1"]) == [4.5]


def test_where_nobody_says_whether_a_command_was_carried_out_the_user_is_told_to_look():
    controller, script, _ = opened()
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    late(script, "ERR?", "*IDN?")
    with pytest.raises(NoAnswerError, match=r"did not confirm 'MOV 1 5' within .* check the pos"):
        axis.move_to(5e-6)
    assert axis.closed_loop
    assert commands(script.log) == ["SVO 1 1", "MOV 1 5"]


def test_who_answers_no_more_is_given_up_and_nothing_more_leaves():
    controller, script, _ = opened()
    script.faults |= {"POS?": b"", "*IDN?": b""}
    with pytest.raises(NotConnectedError, match=r"neither 'POS\? 1' nor '\*IDN\?'"):
        controller.axes["x"].position()
    script.log.clear()
    for job in (
        lambda: controller.axes["x"].set_closed_loop(True),
        lambda: controller.axes["x"].set_voltage(5.0),
        controller.waves.running,
    ):
        with pytest.raises(NotConnectedError, match=r"the connection to .* is closed"):
            job()
    assert script.log == []
    controller.close()


@pytest.mark.parametrize("said", [b"\xff\xfe\x00\x13garbage\n", b"\n", b"1=\n", b"1\n", b"2=5.0\n"])
def test_garbage_is_no_reading_and_the_link_is_in_step_after_it(said):
    controller, script, _ = opened()
    script.faults["POS?"] = said
    with pytest.raises(ControllerError, match="POS"):
        controller.axes["x"].position()
    assert controller.axes["x"].position() == pytest.approx(1e-9)


def test_more_lines_than_were_asked_for_are_no_answer_to_the_next_question():
    controller, script, _ = opened()
    script.faults["POS? 1"] = lambda said: said + b"1=77.0\n"
    assert controller.axes["x"].position() == pytest.approx(1e-9)
    assert controller.axes["x"].position() == pytest.approx(1e-9)


class Interrupted(InMemory):
    """A key is pressed while an answer is waited for."""

    press = False

    def receive(self, timeout: float) -> bytes:
        if self.press:
            self.press = False
            raise KeyboardInterrupt
        return super().receive(timeout)


def test_after_a_key_the_answer_that_was_not_read_is_not_taken_for_another():
    link = Interrupted(ScriptedController())
    client = GcsClient(InProcess(link))
    link.press = True
    with pytest.raises(KeyboardInterrupt):
        client.ask("POS? 1")
    link.controller.target["1"] = 40.0
    assert client.ask_values("POS?", ["1"]) == [40.001]


def test_an_answer_without_end_is_cut_off(monkeypatch):
    monkeypatch.setattr("flexstage.instruments.pi.conversation._LARGEST", 4096)
    controller, script, _ = opened()
    script.faults["HPA?"] = b"more \n" * 1000
    with pytest.raises(NotConnectedError, match="sends an endless answer"):
        controller.client.ask("HPA?")


def test_many_threads_get_each_their_own_answers():
    script = ScriptedController()
    for axis, value in zip("123", (10.0, 20.0, 5.0), strict=True):
        script.target[axis] = value
    wrong: list[float] = []
    with (
        served(script) as port,
        closing(GcsClient(TcpLink("127.0.0.1", port), timeout=5.0)) as client,
    ):

        def ask(axis: str, wanted: float) -> None:
            for _ in range(60):
                (value,) = client.ask_values("POS?", [axis])
                if value != pytest.approx(wanted + 0.001):
                    wrong.append(value)

        threads = [
            threading.Thread(target=ask, args=(axis, script.target[axis])) for axis in "123123"
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(20.0)
        assert not any(thread.is_alive() for thread in threads)
    assert wrong == []


# links that break -----------------------------------------------------------------------------


@pytest.fixture
def networked():
    """A controller behind a socket, with the script that plays it."""
    script = ScriptedController()
    with served(script) as port:
        link = TcpLink("127.0.0.1", port, timeout=2.0)
        controller = PiController.open(
            link, STAGE, timeout=TIMEOUT, transfer=TransferLimits(poll=1e-3, rows=10)
        )
        script.log.clear()
        yield controller, script
        controller.close()


def test_a_link_that_is_cut_in_a_move_stops_the_stage_over_another_one(networked):
    controller, script = networked
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    script.arrives = False
    script.faults["ONT?"] = cut
    with pytest.raises(NotConnectedError):
        axis.move_to(30e-6)
    soon(lambda: "#24" in script.log)
    assert commands(script.log) == ["SVO 1 1", "MOV 1 30", "#24"]
    assert script.connections == 2


@pytest.mark.parametrize("command", ["MOV", "WGO", "SVO? 1"])
def test_a_link_that_is_cut_with_a_command_stops_what_it_may_have_started(networked, command):
    controller, script = networked
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    axis.move_to(10e-6)
    controller.waves.load(shape(10e-6, 10.5e-6, quantity="position"))
    script.log.clear()
    script.faults[command] = cut
    with pytest.raises(NotConnectedError):
        (controller.waves.start if command == "WGO" else lambda: axis.move_to(11e-6))()
    soon(lambda: "#24" in script.log)
    sent = commands(script.log)
    assert sent[-1] == "#24"
    assert len(sent) == (3 if command == "WGO" else 2)


def test_a_link_that_is_cut_in_a_record_leaves_what_was_read(networked):
    controller, script = networked
    controller.recorder.configure([Signal(kind="position", source="x", name="x")], 20e3, 40)
    controller.recorder.start()
    first = controller.recorder.read(0, 20)
    script.faults["DRR? 31 10 1"] = cut
    with pytest.raises(NotConnectedError):
        controller.recorder.read(20, 20)
    assert first.size == 20
    assert commands(script.log) == ["DRC 1 1 2", "DRC 2 0 0", "DRC 3 0 0", "RTR 1", "DRT 0 4 0"]


def test_a_link_that_is_cut_while_a_table_is_written_starts_nothing(networked):
    controller, script = networked
    script.faults["WAV"] = cut
    with pytest.raises(NotConnectedError):
        controller.waves.load(shape(0.0, 1.0, 2.0))
    with pytest.raises(ControllerError, match="load one before"):
        controller.waves.start()
    assert not any(line.startswith("WGO") for line in script.log)


def test_a_server_that_hangs_up_or_is_gone_is_not_connected(networked):
    controller, script = networked
    script.faults["POS?"] = cut
    with pytest.raises(NotConnectedError, match=r"closed the link|is lost"):
        controller.axes["x"].position()
    controller.stop()  # never raises


def test_a_server_that_says_nothing_is_not_waited_for_long():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        link = TcpLink("127.0.0.1", silent.getsockname()[1], timeout=1.0)
        with pytest.raises(NotConnectedError, match=r"does not answer '\*IDN\?'"):
            PiController.open(link, STAGE, timeout=0.03)
        with pytest.raises(NotConnectedError, match="is closed"):
            link.send(b"x")


# moves that do not end ------------------------------------------------------------------------


def test_an_axis_that_does_not_arrive_is_stopped():
    controller, script, clock = opened()
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    axis.move_to(5e-6, wait=False)
    script.arrives = False
    with pytest.raises(
        ControllerError, match="after 3 s and was stopped, with its position control switched"
    ):
        axis.wait(3.0)
    assert clock.now == pytest.approx(3.0, abs=0.02)
    sent = commands(script.log)
    assert "SVO 1 0" in sent[sent.index("#24") :]
    assert not axis.closed_loop


def test_an_axis_that_goes_on_moving_in_open_loop_is_stopped():
    controller, script, _ = opened()
    script.moving = 0b01
    with pytest.raises(ControllerError, match="'x' was not at rest after 1 s"):
        controller.axes["x"].wait(1.0)
    assert script.log[-1] == "#24"


def test_an_axis_that_was_stopped_on_its_way_has_not_arrived():
    controller, script, _ = opened()
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    # the stop makes it stand, so that the controller calls it on target
    script.faults["ONT?"] = lambda said: controller.stop() or said
    with pytest.raises(ControllerError, match="was stopped before it reached its target") as info:
        axis.move_to(5e-6)
    assert info.value.code == 10


def test_an_axis_that_somebody_else_stopped_or_sent_elsewhere_has_not_arrived():
    controller, script, _ = opened()
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    script.faults["ONT?"] = lambda said: script.target.__setitem__("1", 4.0) or said
    with pytest.raises(ControllerError, match="sent to 5, but its target is now 4"):
        axis.move_to(5e-6)


def test_a_key_in_a_wait_stops_the_stage():
    link = Interrupted(ScriptedController())
    controller = PiController.open(InProcess(link), STAGE, sleep=lambda _: None)
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    axis.move_to(5e-6, wait=False)
    link.controller.arrives = False
    link.controller.faults["ONT?"] = lambda said: setattr(link, "press", True) or said
    with pytest.raises(KeyboardInterrupt):
        axis.wait()
    assert link.controller.log[-1] == "#24"


def test_control_that_does_not_come_on_is_said():
    controller, script, _ = opened()
    script.faults["SVO? 1"] = b"1=0\n"
    with pytest.raises(ControllerError, match="was switched on but is still off"):
        controller.axes["x"].set_closed_loop(True)


def test_a_voltage_ramp_ends_where_it_is_stopped():
    controller, script, _ = opened()
    script.faults["SVA 1 9"] = lambda said: controller.stop() or said
    with pytest.raises(ControllerError, match="stopped"):
        controller.axes["x"].set_voltage(50.0)
    # stopped by the thread, and once more since the last step may have come after it
    assert commands(script.log) == ["SVA 1 1", "SVA 1 5", "SVA 1 9", "#24", "#24"]


# controllers that were restarted --------------------------------------------------------------


def test_a_move_after_a_restart_says_that_the_controller_was_restarted():
    controller, script, _ = opened()
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    script.power_on()
    with pytest.raises(ControllerError, match=r"lost settings .* restarted") as info:
        axis.move_to(5e-6)
    assert info.value.code == 5
    assert script.target["1"] == 0.0


def test_a_waveform_is_not_started_after_a_restart():
    controller, script, _ = opened()
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    axis.move_to(10e-6)
    controller.waves.load(shape(10e-6, 11e-6, quantity="position"))
    script.power_on()
    with pytest.raises(ControllerError, match="restarted"):
        controller.waves.start()
    assert not any(line.startswith("WGO") for line in script.log)


def test_a_table_that_is_gone_says_that_the_controller_was_restarted():
    controller, script, _ = opened()
    controller.waves.load(shape(0.0, 1.0))
    script.power_on()
    with pytest.raises(
        ControllerError, match="although this program had written it: it was restarted"
    ):
        controller.waves.start()
    assert script.running == 0


def test_a_record_rate_that_is_gone_shows_before_a_waveform_is_started():
    controller, script, _ = opened()
    controller.recorder.configure([Signal(kind="position", source="x", name="x")], 5e3, 40)
    controller.waves.load(shape(0.0, 1.0))
    script.power_on()
    with pytest.raises(ControllerError, match="record rate is 1 instead of 4"):
        controller.waves.start()


def test_a_wait_that_ends_after_a_restart_does_not_call_it_arrived():
    controller, script, _ = opened()
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    script.faults["ONT?"] = lambda said: script.power_on() or said
    with pytest.raises(ControllerError, match="restarted"):
        axis.move_to(5e-6)


# numbers that are not what they should be -----------------------------------------------------


@pytest.mark.parametrize("scale", [1e3, 1e-3, -1.0, 0.0])
def test_a_table_that_holds_other_numbers_is_never_run(scale):
    script = ScriptedController()
    script.scale = scale
    controller, script, _ = opened(script)
    with pytest.raises(ControllerError, match="uses other units"):
        controller.waves.load(shape(0.0, 1.5, 3.0, 4.5, 3.0, 0.0))
    assert "WCL 1" in script.log
    with pytest.raises(ControllerError, match="load one before"):
        controller.waves.start()
    assert not any(line.startswith("WGO") for line in script.log)


def test_after_a_table_failed_the_one_before_it_is_not_run_either():
    controller, script, _ = opened()
    controller.waves.load(shape(0.0, 1.0, 2.0))
    script.scale = 2.0
    with pytest.raises(ControllerError, match="uses other units"):
        controller.waves.load(shape(0.0, 1.5, 3.0))
    with pytest.raises(ControllerError, match="load one before"):
        controller.waves.start()


def test_a_table_whose_end_was_lost_is_never_run():
    controller, script, _ = opened(transfer=TransferLimits(line_limit=40))
    script.faults["WAV 1 & PNT 12 1 5"] = lambda said: (
        script.waves["1"].__setitem__(11, 0.0) or said
    )
    with pytest.raises(ControllerError, match=r"contains 0 at point 12, where 5 was written"):
        controller.waves.load(shape(*range(10), 5.5, 5.0))


@pytest.mark.parametrize(("gain", "there"), [(10.0, "10 V"), (0.0, "0 V"), (-1.0, "-1 V")])
def test_a_controller_that_does_not_count_in_volts_gets_one_small_step(gain, there):
    script = ScriptedController()
    script.gain = gain
    controller, script, _ = opened(script)
    with pytest.raises(ControllerError, match=f"sent to 1 V, but its drive is at {there}"):
        controller.axes["x"].set_voltage(90.0)
    assert commands(script.log) == ["SVA 1 1"]


def test_a_slow_amplifier_is_waited_for():
    controller, script, _ = opened()
    script.faults["VOL? 1"] = lambda said: (
        script.faults.__setitem__("VOL? 1", b"1=0.2\n") or said
    )  # the first reading after the step is of before
    controller.axes["x"].set_voltage(1.0)
    assert commands(script.log) == ["SVA 1 1"]


@pytest.mark.parametrize("text", ["nan", "-1.#IND", "inf", "1.#INF"])
def test_a_sensor_without_a_number_is_said(text):
    controller, script, _ = opened()
    script.faults |= {"POS?": f"2={text}\n".encode(), "TSP?": f"4={text}\n".encode()}
    script.faults["VOL?"] = f"2={text}\n".encode()
    with pytest.raises(ControllerError, match="sensor of axis 'y' reads"):
        controller.axes["y"].position()
    with pytest.raises(ControllerError, match="sensor 4 reads"):
        controller.channel(4)
    with pytest.raises(ControllerError, match="voltage of axis 'y' reads"):
        controller.axes["y"].set_voltage(5.0)
    assert commands(script.log) == []


def test_a_sensor_without_a_number_is_in_the_record_as_such():
    controller, script, _ = opened()
    controller.recorder.configure([Signal(kind="position", source="x", name="x")], 20e3, 20)
    controller.recorder.start()
    script.faults["DRR?"] = lambda said: said.replace(b"1.005000", b"nan")
    values = controller.recorder.read(0, 20).channel("x").values
    assert np.flatnonzero(np.isnan(values)).tolist() == [4]


def test_a_record_of_another_rate_is_not_taken():
    controller, script, _ = opened()
    controller.recorder.configure([Signal(kind="position", source="x", name="x")], 20e3, 20)
    controller.recorder.start()
    script.sample_time = 1e-4
    with pytest.raises(ControllerError, match=r"set to 5e-05 s, but the record has 0.0001"):
        controller.recorder.read(0, 20)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda said: said[: said.rindex(b" \n", 0, said.rindex(b" \n"))] + b"\n",  # rows lost
        lambda said: said.replace(b"1.007000", b"1.007000 1.0"),  # a column too many
        lambda said: said.replace(b"1.007000", b"one"),
        lambda said: b"0\n",
    ],
)
def test_a_record_that_is_damaged_is_not_taken(spoil):
    controller, script, _ = opened()
    controller.recorder.configure([Signal(kind="position", source="x", name="x")], 20e3, 20)
    controller.recorder.start()
    script.faults["DRR?"] = spoil
    with pytest.raises(ControllerError):
        controller.recorder.read(0, 20)
    assert controller.recorder.read(0, 20).size == 20


@pytest.mark.parametrize(
    ("question", "said"),
    [
        ("TMN?", b"1=100.0\n"),  # above the highest
        ("TMX?", b"1=nan\n"),
        ("SAI?", b"1\n"),  # one axis for a stage of two
        ("SPA?", b"1 0x123=5\n"),  # about another parameter
        ("SVO?", b"1=0\n"),  # about one axis of two
    ],
)
def test_a_controller_that_answers_nonsense_is_not_connected_to(question, said):
    script = ScriptedController()
    script.faults[question] = said
    link = InMemory(script)
    with pytest.raises(FlexstageError):
        PiController.open(InProcess(link), STAGE)
    assert link.closed
    assert commands(script.log) == []


def test_a_value_that_the_controller_refuses_moves_nothing_and_is_explained():
    controller, script, _ = opened()
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    script.high["1"] = 50.0  # limits became narrower after the connection
    with pytest.raises(ControllerError, match="outside the limits of the axis") as info:
        axis.move_to(60e-6)
    assert info.value.code == 7
    assert script.target["1"] == 0.0
    with pytest.raises(LimitError):
        axis.move_to(96e-6)
