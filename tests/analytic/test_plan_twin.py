"""Plans on the simulated stage against what is known of it."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flexstage.base.errors import ModelError, NotConnectedError, PlanError
from flexstage.base.progress import listen
from flexstage.centring import ARCSEC, exact_error, read_table
from flexstage.centring.from_records import centre_files
from flexstage.experiments import VerifiedStep, find_plan, read_plan, run_plan
from flexstage.experiments.plan import dry_run, plan_from_text
from flexstage.experiments.verbs import centre
from flexstage.experiments.verbs.centre import CentredStep
from flexstage.instruments.connect import connect
from flexstage.instruments.pi.simulated.address import simulated_controller
from flexstage.instruments.pi.simulated.server import GcsServer
from flexstage.instruments.record_run import record_now
from flexstage.instruments.requests import TwinRequest
from flexstage.lumped import lumped_system
from flexstage.records import read_record, write_record
from flexstage.stage.designs import design
from flexstage.system import modes
from flexstage.virtual import VirtualTable, virtual_stage
from flexstage.virtual.table import StageOnTable
from tests.result_schema import require_valid

SENSORS = """\
plan: 1
stage: vgtu-piezo
sensors:
  x: {channel: 1}
  y: {channel: 2}
  x.across: {channel: 3}
  x.vertical: {channel: 4}
steps:
"""


#: A stage whose loop has few samples.
TWIN = "twin://?seed=11&model=lumped&quiet=1&servo_rate=1000"


def carried_out(text, tmp_path, address="twin://?seed=11&model=lumped&quiet=1&scatter=0", **more):
    plan = plan_from_text(SENSORS + text)
    with connect(address, design("vgtu-piezo")) as instrument:
        return run_plan(plan, instrument, tmp_path / "run", **more)


def test_a_stage_without_scatter_gives_what_was_published_of_it(tmp_path):
    found = carried_out(
        "  - {name: loops, excite: {kind: cycles, axis: x, rate: 1 Hz, cycles: 3, condition: 2,"
        " shape: cosine}}\n"
        "  - {name: motion, measure: {of: loops, test: motion, along: x, across: x.across,"
        " vertical: x.vertical}}\n"
        "  - {name: blows, excite: {kind: hammer-impacts, axis: x, impacts: 4}}\n"
        "  - {name: blow, measure: {of: blows, test: response, sample_rate: 10 kHz,"
        " band: [200 Hz, 800 Hz]}}\n"
        "  - {name: figures, characterise: {of: [motion, blow]}}\n",
        tmp_path,
    )

    def value(quantity: str) -> float:
        return found.figure(quantity, "x").estimate.value

    # the simulation is set to these, by cycles at the same rate; its creep goes on meanwhile, by
    # some tenths of a per cent
    assert value("output_displacement") == pytest.approx(63.12e-6, rel=5e-3)
    assert value("hysteresis_loop_width") == pytest.approx(7.91e-6, rel=1e-2)
    assert value("straightness") == pytest.approx(0.11e-6, rel=0.03)
    assert value("straightness_out_of_plane") == pytest.approx(0.09e-6, rel=0.03)
    # drives taken out; the fit of noisy blows is good to a hundredth of a hertz
    assert value("natural_frequency_hz") == pytest.approx(337.0, rel=1e-3)


def test_a_small_multisine_finds_the_mode_with_the_drives_in_place(tmp_path):
    found = carried_out(
        "  - {name: sines, excite: {kind: multisine, axis: x, band: [500 Hz, 1400 Hz],"
        " amplitude: 1 V, period: 0.4 s, periods: 4}}\n"
        "  - {name: place, measure: {of: sines, test: response, output: [x], sample_rate: 10 kHz,"
        " band: [500 Hz, 1400 Hz]}}\n"
        "  - {name: figures, characterise: {of: [place]}}\n",
        tmp_path,
    )
    # of the stage as drawn; the simulation sets its free modes to what was published, 3.4 % off
    drawn = modes(lumped_system(design("vgtu-piezo")), drives="in place", count=1).frequency_hz[0]
    got = found.figure("natural_frequency_hz", "x").estimate
    assert got.value == pytest.approx(float(drawn), rel=0.05)
    assert got.uncertainty < 0.01


@pytest.mark.slow
def test_the_inverse_and_control_leave_little_of_the_loop(tmp_path):
    found = carried_out(
        "  - {name: sines, excite: {kind: multisine, axis: x, band: [500 Hz, 1400 Hz],"
        " amplitude: 1 V, period: 0.4 s, periods: 4}}\n"
        "  - {name: place, measure: {of: sines, test: response, output: [x], sample_rate: 10 kHz,"
        " band: [500 Hz, 1400 Hz]}}\n"
        "  - {name: in-place, characterise: {of: [place]}}\n"
        "  - {name: memory, excite: {kind: designed, axis: x, rates: [2 Hz, 10 Hz],"
        " hold_time: 2 s, duration: 10 s, multisine: false}}\n"
        "  - {name: memories, measure: {of: memory, along: x}}\n"
        "  - {name: preisach, identify: {of: [memories], output: x, characterised_by: in-place}}\n"
        "  - {name: open, verify: {model: preisach, along: x, reference: {settle: 1, cycles: 2}}}\n"
        "  - {name: closed, verify: {model: preisach, along: x, "
        "control_modes: [feedback, both, learning], trials: 3,"
        " reference: {settle: 1, cycles: 2, shape: triangle}}}\n"
        "  - {name: modeless, identify: {of: [memories], output: x}}\n"
        "  - {name: alone, verify: {model: modeless, along: x, control_modes: [learning], "
        "trials: 2, reference: {settle: 1, cycles: 2, shape: triangle}}}\n"
        "  - {name: inverse, compensate: {model: preisach, reference: {settle: 1, cycles: 1}}}\n"
        "  - {name: again, measure: {of: inverse, along: x}}\n",
        tmp_path,
        address="twin://?seed=11&model=lumped",
    )
    still, closed = found.step("open"), found.step("closed")
    assert isinstance(still, VerifiedStep)
    assert isinstance(closed, VerifiedStep)
    # a Preisach model leaves about a hundredth of the loop, and half a per cent of the stroke
    best = still.run("inverse")
    assert best.reduction_percent is not None
    assert best.reduction_percent > 98.0
    assert best.tracking.rms < 0.005 * still.stroke
    assert still.run("open loop").tracking.loop_width > 0.1 * still.stroke
    # the sensor has 5 nm of noise and 7 nm rms of the mains
    assert closed.run("both").tracking.rms < 25e-9 < closed.run("feedback").tracking.rms
    learned = closed.run("learning")
    assert len(learned.errors) >= 2
    # beside the control it begins where both are, and what the mains add is not learned
    assert max(learned.errors) < 25e-9
    assert learned.tracking.rms < 25e-9
    # a model that knows no mode tunes no control: learned in open loop, while it creeps on
    alone = found.step("alone")
    assert isinstance(alone, VerifiedStep)
    first, last = alone.run("learning").errors
    assert last < 0.3 * first
    quantities = {(f.quantity, f.test) for f in found.all_figures}
    assert ("compensated_loop_width", "open") in quantities
    assert ("hysteresis_loop_width", "open") in quantities
    # the command that was made alone does as well, but for the zero that has crept away meanwhile
    record = found.step("again").evaluated
    error = record.channel("x").values - record.channel("reference").values
    assert float(error.std()) < 0.003 * still.stroke
    assert abs(float(error.mean())) < 0.02 * still.stroke


def test_a_scale_is_centred_by_the_simulated_stage_and_read_back(tmp_path):
    plan = read_plan(find_plan("centring"))
    with connect("twin://?seed=4&model=lumped", design("vgtu-piezo")) as instrument:
        first = run_plan(plan, instrument, tmp_path)
        again = run_plan(plan, instrument, tmp_path, resume=True)
    done = first.step("centring")
    assert isinstance(done, CentredStep)
    assert done.reached
    # where the scale was put at first: 14 and -11 um
    assert done.moves[0].true_length == pytest.approx(17.8e-6, abs=0.1e-6)
    assert done.moves[-1].true_length < 0.1e-6
    # what was measured covers where it really was, within its 95 % interval or nearly
    for move in done.moves:
        assert abs(move.length - move.true_length) < 2.0 * move.uncertainty
    assert again.step("centring").moves == done.moves
    require_valid(json.loads((tmp_path / "results.json").read_text("utf-8")), "run")


class WithoutHammer:
    """An instrument as a controller is: it cannot strike the stage."""

    capabilities = frozenset()

    def __init__(self, instrument):
        self._instrument = instrument

    def __getattr__(self, name):
        return getattr(self._instrument, name)


def test_a_plan_that_strikes_is_refused_before_anything_moves(tmp_path):
    plan = read_plan(find_plan("vgtu-mechanical"))
    said = "the .* has no hammer for impacts-x, impacts-y: .*; the stage has not moved"
    address = "twin://?seed=4&model=lumped&servo_rate=1000"
    with connect(address, design("vgtu-mechanical")) as instrument:
        with pytest.raises(PlanError, match=said):
            run_plan(plan, WithoutHammer(instrument), tmp_path / "run")
        assert not (tmp_path / "run").exists()
        # its other steps are possible
        run_plan(plan, WithoutHammer(instrument), tmp_path / "run", only=("hold-x",))


def test_a_record_is_awaited_until_it_no_longer_grows(tmp_path, monkeypatch):
    file, now = tmp_path / "turn.csv", [0.0]

    def sleep(seconds: float) -> None:
        # begun after 0.7 s, written on every 0.8 s, whole after 3.1 s
        now[0] += seconds
        file.write_text("x" * sum(at <= now[0] for at in (0.7, 1.5, 2.3, 3.1)))

    monkeypatch.setattr(centre, "time", SimpleNamespace(monotonic=lambda: now[0], sleep=sleep))
    centre._await(file, 20.0)
    assert file.read_text() == "xxxx"
    assert 4.1 < now[0] < 5.0


def test_a_scale_is_centred_by_records_that_a_person_writes(tmp_path, monkeypatch):
    # the person sees what file is wanted, turns the table and writes it
    monkeypatch.chdir(tmp_path)
    # a file is whole before the plan looks for it
    monkeypatch.setattr(centre, "_QUIET", 0.0)
    monkeypatch.setattr(centre, "_POLL", 0.0)
    (tmp_path / "turns").mkdir()
    plan = plan_from_text(
        SENSORS + "  - {name: fine, centre: {radius: 40 mm, heads: [0 deg, 92 deg, 178 deg],"
        " target: 0.2 um, records: {folder: turns, angle: angle,"
        " error: [head 1, head 2, head 3], wait: 20 s}}}\n"
    )
    table = VirtualTable(
        radius=40e-3,
        heads=tuple(np.radians([0.0, 92.0, 178.0])),
        eccentricity=(14e-6, -11e-6),
        noise=1.0 * ARCSEC,
        turns=2,
    )
    c, s = np.cos(np.radians(23.0)), np.sin(np.radians(23.0))
    rest, left = [], []
    address = f"{TWIN}&scatter=0"

    with connect(address, design("vgtu-piezo")) as twin:

        def heard(what: str, _: float) -> None:
            if "turn the table and write" not in what:
                return
            at = np.array([twin.channel(1), twin.channel(2)])
            rest[:] = rest or [at]
            bench = table.moved(*np.array([[c, -s], [s, c]]) @ (at - rest[0]))
            left.append(float(np.hypot(*bench.eccentricity)))
            write_record(bench.record(index=len(left)), tmp_path / what.split(" write ")[1])

        with listen(heard):
            found = run_plan(plan, twin, tmp_path / "run")
    (step,) = found.steps
    assert step.reached
    assert left[0] == pytest.approx(np.hypot(14e-6, 11e-6), rel=1e-6)
    assert left[-1] < 0.2e-6
    assert len(left) == len(step.moves)
    # the report says what the records leave open, once
    assert [note.count("graduation error") for note in step.notes].count(1) == 1
    assert "simulated" not in step.line
    assert all(move.true_length is None for move in step.moves)
    step = (
        "  - {name: fine, centre: {radius: 40 mm, heads: [0 deg],"
        " records: {folder: none, wait: 0.1 s}}}"
    )
    with pytest.raises(PlanError, match="give radius and heads"):
        plan_from_text(SENSORS + step.replace("radius: 40 mm, ", ""))
    again = plan_from_text(SENSORS + step)
    with (
        connect(address, design("vgtu-piezo")) as twin,
        pytest.raises(PlanError, match=r"no record none.fine-0\.csv was written within 0\.1 s"),
    ):
        run_plan(again, twin, tmp_path / "other")
    # files of the first run would move the stage by what was
    with (
        connect(address, design("vgtu-piezo")) as twin,
        pytest.raises(PlanError, match=r"fine-0\.csv is of an earlier run"),
    ):
        run_plan(plan, twin, tmp_path / "third")


TABLE = """\
table: 1
name: comparator
scale: {radius: 40 mm, eccentricity: 18 um}
heads: {angles: [0 deg, 92 deg, 178 deg], noise: NOISE}
axis: {speed: SPEED}
mounting_angle: 23 deg
tolerance: {error: 1 arcsec}
"""
ANGLES = np.radians([0.0, 92.0, 178.0])
#: The plan of a table whose heads are sensors of the instrument; only the folder is missing for
#: files.
TURNS = """\
plan: 1
stage: vgtu-piezo
sensors:
  x: {channel: 1}
  y: {channel: 2}
  angle: {channel: 13, unit: rad}
  head 1: {channel: 14, unit: rad}
  head 2: {channel: 15, unit: rad}
  head 3: {channel: 16, unit: rad}
steps:
  - name: fine
    centre:
      radius: 40 mm
      heads: [0 deg, 92 deg, 178 deg]
      target: 0.2 um
      records: {angle: angle, reading: [head 1, head 2, head 3], duration: 2.2 s}
"""


@pytest.mark.parametrize(
    ("records", "words"),
    [
        ("folder: turns, error: [h1]", "2 angles of heads and 1 columns"),
        ("folder: turns, error: [h1, h2], reading: [h1, h2]", "error or of reading: leave one out"),
        ("angle: angle, reading: [h1, h2, h3], duration: 2 s", "2 angles of heads and 3 columns"),
    ],
)
def test_columns_that_are_not_those_of_the_heads_are_refused_with_the_plan(records, words) -> None:
    step = "  - {name: fine, centre: {radius: 40 mm, heads: [0 deg, 180 deg], records: {RECORDS}}}"
    with pytest.raises(PlanError, match=words):
        plan_from_text(SENSORS + step.replace("RECORDS", records))


def described_table(folder, *, noise="0.5 arcsec", speed="60 rpm"):
    file = folder / "table.yaml"
    file.write_text(TABLE.replace("NOISE", noise).replace("SPEED", speed), "utf-8")
    return file


def served(table):
    request = TwinRequest(
        seed=11, servo_rate=1e3, fast=True, identity="flexstage", table=str(table)
    )
    controller = simulated_controller(design("vgtu-piezo"), request, quiet=True, scatter=False)
    server = GcsServer(controller, patience=300.0)
    server.start()
    return server


def reached(server):
    host, port = server.address
    return connect(f"gcs://{host}:{port}", design("vgtu-piezo"), timeout=300.0)


def turn_of(angle, error):
    """Return an error as a reading of a head, as it comes from an encoder."""
    return np.mod(angle + error, 2.0 * np.pi)


def test_the_stage_carries_the_scale_under_the_heads_of_the_twin(tmp_path):
    table = described_table(tmp_path, noise="0 arcsec")
    address = f"twin://?model=lumped&quiet=1&scatter=0&servo_rate=1000&table={table}"
    with connect(address, design("vgtu-piezo")) as twin:
        names = ("angle", "head 1", "head 2", "head 3")
        assert [twin.channels.numbers[name] for name in names] == [13, 14, 15, 16]
        signals = [twin.channels.signal(name) for name in names]
        found = []
        low, high = (np.array([a.limits.position[k] for a in twin.axes.values()]) for k in (0, 1))
        for offset in ([0.0, 0.0], [8e-6, 0.0], [0.0, -5e-6]):
            for axis, at in zip(twin.axes.values(), 0.5 * (low + high) + offset, strict=True):
                axis.set_closed_loop(True)
                axis.move_to(float(at))
            record = record_now(twin, signals, 200.0, 400)
            theta, *readings = (channel.values for channel in record.channels)
            # to first order, d = (e_x sin b - e_y cos b) / R with b = theta + alpha
            for read, alpha in zip(readings, ANGLES, strict=True):
                error = np.mod(read - theta + np.pi, 2.0 * np.pi) - np.pi
                b = theta + alpha
                terms = np.stack((np.sin(b), -np.cos(b), np.ones(b.size)), axis=1)
                found.append(40e-3 * np.linalg.lstsq(terms, error, rcond=None)[0][:2])
    centres = np.array(found).reshape(3, 3, 2)
    # the heads see one scale, whose mounting error is as described
    np.testing.assert_allclose(centres - centres[:, :1], 0.0, atol=20e-9)
    assert np.hypot(*centres[0, 0]) == pytest.approx(18e-6, abs=50e-9)
    # a move of the platform, turned by the mounting angle of the stage on the table
    c, s = np.cos(np.radians(23.0)), np.sin(np.radians(23.0))
    np.testing.assert_allclose(centres[1, 0] - centres[0, 0], [8e-6 * c, 8e-6 * s], atol=80e-9)
    np.testing.assert_allclose(centres[2, 0] - centres[0, 0], [5e-6 * s, -5e-6 * c], atol=80e-9)


def test_a_plan_centres_alike_by_the_table_of_the_twin_and_by_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # a file is whole before the plan looks for it
    monkeypatch.setattr(centre, "_QUIET", 0.0)
    monkeypatch.setattr(centre, "_POLL", 0.0)
    server = served(described_table(tmp_path))
    try:
        with reached(server) as instrument:
            by_twin = run_plan(plan_from_text(TURNS), instrument, tmp_path / "twin")
    finally:
        server.close()
    (there,) = by_twin.steps
    assert there.reached
    assert there.moves[0].length == pytest.approx(18e-6, abs=50e-9)
    # each turn is kept as it was read
    turns = [read_record(tmp_path / "twin" / "records" / f"fine.turn-{k}.h5") for k in range(4)]
    assert [c.unit for c in turns[0].channels] == ["rad"] * 4
    assert len(there.moves) == 4

    # a person at a table with the same scale writes what its heads read
    bench = VirtualTable(
        radius=40e-3,
        heads=tuple(ANGLES),
        eccentricity=there.moves[0].eccentricity,
        noise=0.5 * ARCSEC,
        turns=2,
        seed=5,
    )
    c, s = np.cos(np.radians(23.0)), np.sin(np.radians(23.0))
    (tmp_path / "turns").mkdir()
    rest = []
    address = f"{TWIN}&scatter=0"
    with connect(address, design("vgtu-piezo")) as twin:

        def heard(what: str, _: float) -> None:
            if "turn the table and write" in what:
                at = np.array([twin.channel(1), twin.channel(2)])
                rest.append(at)
                carried = bench.moved(*np.array([[c, -s], [s, c]]) @ (at - rest[0]))
                read = carried.record(index=len(rest))
                angle, *errors = read.channels
                columns = [replace(e, values=turn_of(angle.values, e.values)) for e in errors]
                file = tmp_path / what.split(" write ")[1]
                write_record(replace(read, channels=(angle, *columns)), file)

        plan = plan_from_text(TURNS.replace("records: {", "records: {folder: turns, "))
        with listen(heard):
            by_files = run_plan(plan, twin, tmp_path / "files")
    (here,) = by_files.steps
    assert here.reached
    assert [m.kind for m in here.moves] == [m.kind for m in there.moves]
    for one, other in zip(there.moves, here.moves, strict=True):
        # noise, and the position that the sensors read when a file was written
        allowed = 3.0 * np.hypot(one.uncertainty, other.uncertainty) + 50e-9
        assert np.hypot(*np.subtract(one.eccentricity, other.eccentricity)) < allowed
    assert "simulated" not in there.line + here.line


def test_a_link_that_is_lost_in_mid_turn_leaves_a_run_to_resume(tmp_path):
    plan = plan_from_text(TURNS)
    table = described_table(tmp_path)
    server = served(table)
    done = [0.0]

    def heard(what: str, share: float) -> None:
        # the server goes while the second turn is read
        if what == "recording":
            if done[-1] == 1.0:
                server.close()
            done.append(share)

    said = "step 'fine': .*; [0-9]+ samples are saved by the writer, of 220"
    try:
        with (
            reached(server) as instrument,
            listen(heard),
            pytest.raises(NotConnectedError, match=said),
        ):
            run_plan(plan, instrument, tmp_path / "run")
    finally:
        server.close()
    state = json.loads((tmp_path / "run" / "run.json").read_text("utf-8"))
    assert state["steps"]["fine"]["status"] == "failed"
    server = served(table)
    try:
        with reached(server) as instrument:
            found = run_plan(plan, instrument, tmp_path / "run", resume=True)
    finally:
        server.close()
    assert found.steps[0].reached
    records = tmp_path / "run" / "records"
    # what was read before is kept, under other names
    assert (records / "fine.turn-0.replaced-1.h5").exists()
    assert (records / "fine.turn-1.partial-1.h5").exists()
    assert (records / "fine.turn-1.h5").exists()


def test_a_table_that_stands_still_is_refused(tmp_path, monkeypatch):
    table = described_table(tmp_path, speed="0 rpm")
    address = "twin://?model=lumped&quiet=1&servo_rate=1000"
    plan = plan_from_text(TURNS)
    with (
        connect(f"{address}&table={table}", design("vgtu-piezo")) as twin,
        pytest.raises(
            PlanError, match=r"'fine': the table turned 0\.000 times by 'angle' in 2\.2 s"
        ),
    ):
        run_plan(plan, twin, tmp_path / "still")
    slow = described_table(tmp_path, speed="20 rpm")
    with (
        connect(f"{address}&table={slow}", design("vgtu-piezo")) as twin,
        pytest.raises(PlanError, match=r"turned 0\.73. times .* a turn or more"),
    ):
        run_plan(plan, twin, tmp_path / "slow")
    # a stage without a table has no such sensors, which is found before it moves
    monkeypatch.setattr(centre.InstrumentPositioner, "to_middle", None)
    with (
        connect(address, design("vgtu-piezo")) as twin,
        pytest.raises(ModelError, match="'fine': there is no sensor '13' to record"),
    ):
        run_plan(plan, twin, tmp_path / "none")
    for sensor, channel in (("angle", 13), ("head 2", 15)):
        described = f"{sensor}: {{channel: {channel}, unit: rad}}"
        metres = plan_from_text(TURNS.replace(described, described.replace(", unit: rad", "")))
        (problem,) = dry_run(metres, design("vgtu-piezo")).problems
        assert f"sensor '{sensor}' reads an angle: give it 'unit: rad'" in problem
    # six measurements at most: the first, two trials and three moves
    assert dry_run(plan, design("vgtu-piezo")).steps[0].duration == pytest.approx(6 * 2.2)
    with pytest.raises(PlanError, match="give the sensors of angle and of error or reading"):
        plan_from_text(TURNS.replace(", duration: 2.2 s", ""))
    with pytest.raises(PlanError, match="reads the sensor 'head 3', which is not described"):
        plan_from_text(TURNS.replace("  head 3: {channel: 16, unit: rad}\n", ""))


def test_a_table_is_carried_by_a_stage_with_two_axes(tmp_path):
    table = described_table(tmp_path)
    with pytest.raises(ModelError, match="'parallelogram' must have two axes"):
        connect(f"twin://parallelogram?table={table}")


def test_a_table_runs_alike_in_two_parts_and_its_heads_are_as_noisy_as_described(tmp_path):
    table = read_table(described_table(tmp_path))
    stage = StageOnTable(
        virtual_stage(design("vgtu-mechanical"), seed=2, sample_rate_hz=1e3), table
    )
    command = np.full((2, 5000), 1e-4)
    whole = stage.run(command, (True, True)).reading
    stage.reset()
    parts = [stage.run(command[:, a:b], (True, True)).reading for a, b in ((0, 1), (1, 5000))]
    np.testing.assert_array_equal(whole, np.concatenate(parts, axis=1))
    heads = [c.number for c in stage.channels if c.name.startswith("head")]
    theta, *readings = whole[[12, *(n - 1 for n in heads)], 1000:]
    # 60 rpm at 1 kHz
    np.testing.assert_allclose(np.mod(np.diff(theta), 2.0 * np.pi), 2.0 * np.pi / 1e3, rtol=1e-9)
    noise = []
    for read in readings:
        error = np.mod(read - theta + np.pi, 2.0 * np.pi) - np.pi
        # the second difference of white noise has six times its variance
        noise.append(np.diff(error, 2) / np.sqrt(6.0))
    assert np.std(noise, axis=1) == pytest.approx(0.5 * ARCSEC, rel=0.1)
    assert np.max(np.abs(np.triu(np.corrcoef(noise), 1))) < 0.1


@pytest.mark.parametrize("settings", [(0,), (0, 1, 4, 6)])
def test_a_scale_is_centred_by_an_autocollimator_at_the_faces_of_a_polygon(
    settings, tmp_path, monkeypatch
):
    """The polygon has an error of order 1, which only several settings tell from the scale's."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(centre, "_QUIET", 0.0)
    (tmp_path / "turns").mkdir()
    radius, alpha = 40e-3, np.radians(50.0)
    plan = plan_from_text(
        SENSORS + "  - {name: fine, centre: {radius: 40 mm, heads: [50 deg], target: 0.3 um,"
        " records: {folder: turns, wait: 20 s}}}\n"
    )
    theta = np.arange(24) * np.pi / 12.0
    # of 1 um at the radius
    faces = 1e-6 / radius * np.sin(theta + alpha) + 2.0 * ARCSEC * np.cos(5.0 * theta)
    random = np.random.default_rng(8)
    rest, true = [], []

    with connect(f"{TWIN}&scatter=0", design("vgtu-piezo")) as twin:

        def heard(what: str, _: float) -> None:
            if "turn the table and write" not in what:
                return
            at = np.array([twin.channel(1), twin.channel(2)])
            rest[:] = rest or [at]
            true.append(at - rest[0] + (14e-6, -11e-6))
            off = exact_error(theta, true[-1], radius, head_angle=alpha)
            rows = [
                (faces + np.roll(off, -s)) / ARCSEC + s + random.normal(0.0, 0.05, 24)
                for s in settings
            ]
            np.savetxt(
                what.split(" write ")[1],
                np.column_stack((np.arange(1, 25), *rows)),
                delimiter=",",
                comments="",
                header=",".join(("face", *(f"s{s}" for s in settings))),
            )

        with listen(heard):
            (step,) = run_plan(plan, twin, tmp_path / "run").steps
    assert step.reached
    seen = np.array([1e-6, 0.0]) if settings == (0,) else np.zeros(2)
    for move, at in zip(step.moves, true, strict=True):
        np.testing.assert_allclose(move.eccentricity, at + seen, atol=0.05e-6)
    assert any("faces of order 1" in note for note in step.notes) == (settings == (0,))


@pytest.mark.parametrize("header", ["face,first,second", "face,round,reading"])
def test_rounds_of_an_autocollimator_are_no_settings_of_the_polygon(header, tmp_path):
    face = np.arange(12.0)
    rows = np.column_stack((face, face, face))
    if "round" in header:
        rows = np.vstack([np.column_stack((face, np.full(12, k), face)) for k in (0.0, 1.0)])
    file = tmp_path / "fine-0.csv"
    np.savetxt(file, rows, delimiter=",", comments="", header=header)
    request = centre.RecordedTurns(folder="turns").request((0.0,), 40e-3)
    with pytest.raises(PlanError, match="turned on the table, such as s0"):
        centre._at_polygon(file, request, [])


def test_readings_of_an_indicator_are_typed_in_with_their_unit(tmp_path):
    # in micrometres at every 10 degrees, as by dial: e_x cos(theta) + e_y sin(theta)
    theta = np.radians(np.arange(0.0, 720.0, 10.0))
    random = np.random.default_rng(3)
    dial = 12.0 * np.cos(theta) - 7.0 * np.sin(theta) + random.normal(0.0, 0.2, theta.size)
    rows = (f"{10 * i},{value:.1f}" for i, value in enumerate(dial))
    file = tmp_path / "fine-0.csv"
    file.write_text("\n".join(("angle,dial", *rows)), "utf-8")
    records = centre.RecordedTurns(folder="turns", angle="angle deg", error=("dial um",))
    (setup,) = centre_files([file], records.request((0.0,), 40e-3)).setups
    assert setup.centre is not None
    np.testing.assert_allclose(setup.centre.vector, [12e-6, -7e-6], atol=0.2e-6)
