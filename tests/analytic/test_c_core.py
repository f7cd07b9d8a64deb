"""The C of a stage against `DynamicModel.simulate` stepped one sample at a time: the same bits.

gcc without contraction and LLVM without fast mathematics round each sum and product alike, and both
call the C library of the machine for exp, log and sine; what numpy computes with its own kernels
(tables, weights) is exported as numbers.

Evidence (Exported files): C core, sample by sample (Python): same bits; fitted pieces $10^{-12}$
"""

import ctypes
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexstage.hysteresis import (
    AsymmetricBoucWen,
    BoucWen,
    Dahl,
    Duhem,
    DynamicModel,
    GeneralisedBoucWen,
    GeneralisedMaxwellSlip,
    HysteresisModel,
    LogCreep,
    PrandtlIshlinskii,
    Preisach,
    Sensor,
    dynamic_model,
)
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.system import frequency_response
from tests.c_stage import CStage, stepped, wandering

STROKE, RANGE = 37e-6, (-3.0, 118.0)
SENSORS = {
    "x": Sensor(
        gain=1.013,
        offset=3e-8,
        bandwidth_hz=2900.0,
        quantisation=1.3e-9,
        mains_amplitude=2e-8,
        mains_phase=0.37,
    ),
    "y": Sensor(gain=-0.97, offset=-1e-9, bandwidth_hz=4300.0, noise_rms=3e-9),
}


def piezo(**options: object) -> DynamicModel:
    stage = design("vgtu-piezo")
    given = {
        "bandwidth": 1700.0,
        "current": 0.23,
        "creep": LogCreep(rate_per_decade=0.017),
        "sensors": SENSORS,
        "time_step": 1.1e-4,
    } | options
    return dynamic_model(stage, lumped_system(stage), **given)  # type: ignore[arg-type]


def bouc_wen(share: float = 0.31, exponent: float = 1.0) -> BoucWen:
    gain = STROKE / 120.0
    scale = (share * STROKE / 3.0) ** (1.0 - exponent)
    return BoucWen(
        gain=gain,
        hysteresis_gain=share * gain,
        beta=0.031 * scale,
        gamma=0.017 * scale,
        exponent=exponent,
    )


def in_pieces() -> dict[str, HysteresisModel]:
    """Models in closed form between samples, in volts and metres."""
    g = STROKE / 120.0
    return {
        "bouc-wen": bouc_wen(),
        "dahl": Dahl(gain=1.2 * g, stiffness=0.4 * g, limit=5.3e-6),
        "duhem": Duhem(
            rate=0.04,
            anhysteretic=np.array([1e-6, 0.83 * g]),
            tangent=np.array([0.6 * g]),
            input_range=RANGE,
        ),
        "generalised-bouc-wen": GeneralisedBoucWen(
            gain=g,
            hysteresis_gain=0.31 * g,
            shape=(0.031, 0.012, -0.003, 0.007, 0.002, -0.001),
            centre=13.0,
        ),
        "prandtl-ishlinskii": PrandtlIshlinskii(
            gain=0.6 * g,
            thresholds=np.array([2.3, 9.7, 22.0]),
            weights=np.array([0.2 * g, 0.11 * g, 0.07 * g]),
        ),
        "maxwell-slip": GeneralisedMaxwellSlip(
            stiffness=0.7 / g,
            thresholds=np.array([2e-6, 6.1e-6]),
            element_stiffness=np.array([0.2 / g, 0.17 / g]),
        ),
        "preisach": Preisach(
            gain=0.4 * g,
            thresholds=np.array([2.1, 9.3]),
            knots=np.array([0.0, 41.0, 90.0]),
            slopes=np.array([[0.2 * g, 0.3 * g], [0.1 * g, 0.15 * g]]),
        ),
    }


@pytest.fixture(scope="module")
def full() -> DynamicModel:
    return piezo()


def test_full_piezo_stage_gives_the_same_bits(full: DynamicModel, tmp_path: Path) -> None:
    # amplifier with slew and ends of its range, hysteresis with reversals, creep, sensors
    u = wandering(150, [RANGE, (-30.0, 150.0)], seed=5)
    expected, memory = stepped(full, u)
    made = CStage(tmp_path, full)
    np.testing.assert_array_equal(made.run(u), expected)
    assert np.ptp(expected[:, 0]) > 1e-5
    for d in full.drives:
        assert made.get(f"{d.name}.voltage") == memory.amplifiers[d.name][1]


@pytest.mark.slow
@pytest.mark.parametrize("flags", [("-O1",), ("-O2",), ("-O3",), ("-O3", "-march=native")])
def test_optimisation_does_not_change_a_bit(
    full: DynamicModel, tmp_path: Path, flags: tuple[str, ...]
) -> None:
    u = wandering(150, [RANGE, RANGE], seed=8)
    made = CStage(tmp_path, full, (*flags, "-ffp-contract=off"))
    np.testing.assert_array_equal(made.run(u), stepped(full, u)[0])


@pytest.mark.parametrize(
    ("kind", "other"),
    [
        ("bouc-wen", "dahl"),
        ("duhem", "generalised-bouc-wen"),
        ("prandtl-ishlinskii", "maxwell-slip"),
        ("preisach", "bouc-wen"),
    ],
)
def test_hysteresis_in_pieces_gives_the_same_bits(kind: str, other: str, tmp_path: Path) -> None:
    # another kind on the other drive: each finds its own
    model = piezo(
        hysteresis={"x": in_pieces()[kind], "y": in_pieces()[other]}, bandwidth=None,
        current=None, sensors=None, keep_modes=9,
    )  # fmt: skip
    u = wandering(150, [RANGE, RANGE], seed=11)
    expected = stepped(model, u)[0]
    made = CStage(tmp_path, model).run(u)
    np.testing.assert_array_equal(made, expected)
    assert np.ptp(expected, axis=0).min() > 1e-6


@pytest.mark.parametrize("mode_count", [1, pytest.param(7, marks=pytest.mark.slow)])
def test_fewer_modes_and_coarse_steps_give_the_same_bits(mode_count: int, tmp_path: Path) -> None:
    # at 3 ms modes turn by many radians and lags by more than their time constant
    creep = LogCreep(rate_per_decade=0.02, shortest=0.0017, longest=3.0, per_decade=1)
    model = piezo(keep_modes=mode_count, time_step=3.1e-3, creep=creep)
    u = wandering(150, [RANGE, RANGE], seed=3)
    np.testing.assert_array_equal(CStage(tmp_path, model).run(u), stepped(model, u)[0])


@pytest.mark.parametrize("name", ["vgtu-mechanical", "parallelogram"])
def test_linear_drives_give_the_same_bits(name: str, tmp_path: Path) -> None:
    stage = design(name)
    model = dynamic_model(stage, lumped_system(stage), time_step=0.9e-4)
    ranges = [(-1e-4, 1.3e-4)] * len(model.drives)
    u = wandering(150, ranges, seed=6)
    np.testing.assert_array_equal(CStage(tmp_path, model).run(u), stepped(model, u)[0])


def without_closed_form() -> dict[str, HysteresisModel]:
    """Models without closed form between samples, in volts and metres."""
    g = STROKE / 120.0
    return {
        "bouc-wen 1.6": bouc_wen(exponent=1.6),
        "bouc-wen 2": bouc_wen(exponent=2.0),
        "dahl 0.7": Dahl(gain=1.2 * g, stiffness=0.4 * g, limit=5.3e-6, exponent=0.7),
        "asymmetric-bouc-wen": AsymmetricBoucWen(
            gain=g,
            quadratic=1e-3 * g,
            cubic=-2e-6 * g,
            hysteresis_gain=0.31 * g,
            beta=0.031,
            gamma=0.017,
            lowest_input=RANGE[0],
            highest_input=RANGE[1],
        ),
        "duhem": Duhem(
            rate=0.04,
            anhysteretic=np.array([1e-6, 0.83 * g, 1e-3 * g, -3e-6 * g]),
            tangent=np.array([0.6 * g, 1e-3 * g]),
            input_range=RANGE,
        ),
    }


@pytest.mark.parametrize(
    ("kind", "other"),
    [
        ("bouc-wen 1.6", "duhem"),
        pytest.param("asymmetric-bouc-wen", "bouc-wen 2", marks=pytest.mark.slow),
        pytest.param("dahl 0.7", "asymmetric-bouc-wen", marks=pytest.mark.slow),
    ],
)
def test_fitted_hysteresis_agrees_to_12_digits(kind: str, other: str, tmp_path: Path) -> None:
    # both fit the same pieces; numpy takes logarithms and roots of whole arrays by its own kernels
    both = {"x": without_closed_form()[kind], "y": without_closed_form()[other]}
    model = piezo(hysteresis=both, keep_modes=9, sensors=None)
    u = wandering(80, [RANGE, RANGE], seed=13)
    expected = stepped(model, u)[0]
    made = CStage(tmp_path, model).run(u)
    size = np.abs(expected).max(axis=0)
    assert np.all(np.abs(made - expected) <= 1e-12 * size)


def test_settled_and_readings_at_rest(full: DynamicModel, tmp_path: Path) -> None:
    made = CStage(tmp_path, full)
    for commands in ((37.0, 81.0), (140.0, -12.0)):
        made.settle(*commands)
        memory = full.settled({"x": commands[0], "y": commands[1]})
        rest = made.readings()
        u = np.array(commands) + 0.3 * np.arange(40.0)[:, None]
        np.testing.assert_array_equal(made.run(u), stepped(full, u, memory)[0])
        # at rest the sensor of y sees what the modes hold; that of x adds its mains and steps
        assert rest[1] == -0.97 * memory.sensors["y"][0] - 1e-9
        assert abs(rest[0] - 1.013 * memory.sensors["x"][0] - 3e-8) < 2e-8 + 0.65e-9


def test_a_jump_passes_the_hysteresis_and_takes_no_time(tmp_path: Path) -> None:
    model = piezo(bandwidth=None, current=None)
    u = wandering(60, [RANGE, RANGE], seed=2)
    made = CStage(tmp_path, model)
    made.run(u)
    memory = stepped(model, u)[1]
    to = (91.3, 14.2)
    made.jump(*to)
    memory = replace(
        memory,
        hysteresis={
            d.name: d.hysteresis.simulate([v], memory.hysteresis[d.name]).state
            for d, v in zip(model.drives, to, strict=True)
            if d.hysteresis is not None
        },
    )
    # no mode has moved, nothing follows at once: the sensors see what they saw
    later = np.tile(to, (80, 1))
    np.testing.assert_array_equal(made.run(later), stepped(model, later, memory)[0])


def test_a_jump_before_an_amplifier_changes_its_command_alone(
    full: DynamicModel, tmp_path: Path
) -> None:
    made = CStage(tmp_path, full)
    made.settle(20.0, 30.0)
    before = made.readings()
    made.jump(60.0, 10.0)
    np.testing.assert_array_equal(made.readings(), before)
    memory = full.settled({"x": 20.0, "y": 30.0})
    memory.amplifiers["x"][0], memory.amplifiers["y"][0] = 60.0, 10.0
    later = np.tile((60.0, 10.0), (50, 1))
    np.testing.assert_array_equal(made.run(later), stepped(full, later, memory)[0])


def test_a_jump_of_an_imposed_displacement_is_a_very_short_ramp(tmp_path: Path) -> None:
    # its rate acts too: a blow. A ramp within a step a thousandth as long does nearly the same; the
    # difference falls with the length of the ramp
    stage = design("vgtu-mechanical")
    system = lumped_system(stage)
    coarse = dynamic_model(stage, system, time_step=1e-4, keep_modes=6)
    made = CStage(tmp_path, coarse)
    leap = [3.1e-5, -1.7e-5]
    made.jump(*leap)
    at_once = made.readings()
    after = made.run(np.tile(leap, (30, 1)))
    differences = []
    for parts in (200, 400):
        fine = dynamic_model(stage, system, time_step=1e-4 / parts, keep_modes=6)
        _, memory = stepped(fine, np.array([leap]))
        # the memory is in SI units, so a model of another step takes it
        held = {d.name: np.full(30, v) for d, v in zip(coarse.drives, leap, strict=True)}
        found = coarse.simulate(held, memory).readings
        expected = np.stack([found[p.name] for p in coarse.probes], axis=1)
        differences.append(np.abs(after - expected).max() / np.abs(expected).max())
    assert differences[0] < 0.02
    assert differences[1] == pytest.approx(0.5 * differences[0], rel=0.05)
    feed = np.stack([d.feedthrough for d in coarse.drives], axis=1) @ leap
    np.testing.assert_allclose(at_once, feed, rtol=1e-12)


def test_a_copy_of_the_bytes_is_a_saved_state(full: DynamicModel, tmp_path: Path) -> None:
    u = wandering(200, [RANGE, RANGE], seed=21)
    made = CStage(tmp_path, full)
    made.run(u[:90])
    saved = bytes(made.bytes)
    once = made.run(u[90:])
    made.bytes = ctypes.create_string_buffer(saved, len(saved))
    np.testing.assert_array_equal(made.run(u[90:]), once)


def test_two_instances_side_by_side_do_not_meet(full: DynamicModel, tmp_path: Path) -> None:
    u, w = (wandering(60, [RANGE, RANGE], seed=s) for s in (31, 32))
    made = CStage(tmp_path, full)
    alone = [made.run(u)]
    made.bytes = made.fresh()
    alone.append(made.run(w))
    one, two = made.fresh(), made.fresh()
    together: list[list[np.ndarray]] = [[], []]
    for k in range(60):
        for i, (instance, given) in enumerate(((one, u), (two, w))):
            made.bytes = instance
            together[i].append(made.run(given[k : k + 1])[0])
    np.testing.assert_array_equal(np.array(together), np.array(alone))


def test_imposed_displacement_follows_the_frequency_response(tmp_path: Path) -> None:
    # a slow and a fast sine, settled: what C gives against the matrices with the drive in place.
    # Lines between samples lack (pi f h)^2 / 3 of a sine, which is divided out; what is left of the
    # transient after this long is below 1e-7
    stage = design("vgtu-mechanical")
    system = lumped_system(stage)
    model = dynamic_model(stage, system, time_step=2e-6)
    made = CStage(tmp_path, model)
    drives = [d.name for d in model.drives]
    for f in (210.0, 830.0):
        made.bytes = made.fresh()
        n = 150_000 + 5 * round(1.0 / (f * model.step))
        t = np.arange(1, n + 1) * model.step
        u = np.zeros((n, len(drives)))
        u[:, drives.index("x")] = 1.9e-6 * np.sin(2.0 * np.pi * f * t) * np.minimum(1.0, t / 0.05)
        y = made.run(u)[:, [p.name for p in model.probes].index("x")]
        late = slice(150_000, None)
        base = np.stack((np.sin(2 * np.pi * f * t[late]), np.cos(2 * np.pi * f * t[late])), axis=1)
        (a, b), *_ = np.linalg.lstsq(base, y[late], rcond=None)
        found = complex(a, b) / 1.9e-6 / np.sinc(f * model.step) ** 2
        expected = complex(frequency_response(system, [f], "x", "x", drives="in place").value[0])
        assert abs(found - expected) < 1e-6 * abs(expected)


def test_what_cannot_be_stepped_is_said(full: DynamicModel, tmp_path: Path) -> None:
    made = CStage(tmp_path, full)
    made.run(wandering(20, [RANGE, RANGE], seed=1))
    before = bytes(made.bytes)
    assert "a command is not finite" in (made.message([[np.nan, 3.0]]) or "")
    assert "a command is not finite" in (made.message([[3.0, np.inf]]) or "")
    assert bytes(made.bytes) == before
    # a way so long that its exponential would take thousands of parts
    other = CStage(tmp_path / "other", piezo(bandwidth=None, current=None))
    assert "too much in one step" in (other.message([[1e6, 0.0]]) or "")


def test_hysteresis_that_runs_away_is_said(tmp_path: Path) -> None:
    g = STROKE / 120.0
    wild = BoucWen(gain=g, hysteresis_gain=0.3 * g, beta=0.01, gamma=-0.4)
    model = piezo(bandwidth=None, current=None)
    x, y = model.drives
    model = replace(model, drives=(replace(x, hysteresis=wild), y))
    made = CStage(tmp_path, model)
    there_and_back = 2000.0 * np.sign(np.sin(np.arange(400) * 0.1))
    u = np.stack((there_and_back, 0.0 * there_and_back), axis=1)
    assert made.message(u) is not None
