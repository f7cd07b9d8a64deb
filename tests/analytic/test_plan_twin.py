"""Plans on the simulated stage against what is known of it."""

import json

import numpy as np
import pytest

from flexstage.base.errors import PlanError
from flexstage.base.progress import listen
from flexstage.centring import ARCSEC
from flexstage.experiments import VerifiedStep, find_plan, read_plan, run_plan
from flexstage.experiments.plan import plan_from_text
from flexstage.experiments.verbs.centre import CentredStep
from flexstage.instruments.connect import connect
from flexstage.lumped import lumped_system
from flexstage.records import write_record
from flexstage.stage.designs import design
from flexstage.system import modes
from flexstage.virtual import VirtualTable
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
    with connect("twin://?seed=4&model=lumped", design("vgtu-mechanical")) as instrument:
        with pytest.raises(PlanError, match=said):
            run_plan(plan, WithoutHammer(instrument), tmp_path / "run")
        assert not (tmp_path / "run").exists()
        # its other steps are possible
        run_plan(plan, WithoutHammer(instrument), tmp_path / "run", only=("hold-x",))


def test_a_scale_is_centred_by_records_that_a_person_writes(tmp_path, monkeypatch):
    # the person sees what file is wanted, turns the table and writes it
    monkeypatch.chdir(tmp_path)
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

    with connect("twin://?seed=11&model=lumped&quiet=1&scatter=0", design("vgtu-piezo")) as twin:

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
    assert "simulated" not in step.line
    assert all(move.true_length is None for move in step.moves)
    step = (
        "  - {name: fine, centre: {radius: 40 mm, heads: [0 deg],"
        " records: {folder: none, wait: 1 s}}}"
    )
    with pytest.raises(PlanError, match="give radius and heads"):
        plan_from_text(SENSORS + step.replace("radius: 40 mm, ", ""))
    again = plan_from_text(SENSORS + step)
    with (
        connect("twin://?seed=11&model=lumped&quiet=1", design("vgtu-piezo")) as twin,
        pytest.raises(PlanError, match=r"no record none.fine-0\.csv was written within 1 s"),
    ):
        run_plan(again, twin, tmp_path / "other")
    # files of the first run would move the stage by what was
    with (
        connect("twin://?seed=11&model=lumped&quiet=1", design("vgtu-piezo")) as twin,
        pytest.raises(PlanError, match=r"fine-0\.csv is of an earlier run"),
    ):
        run_plan(plan, twin, tmp_path / "third")
