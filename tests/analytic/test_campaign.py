"""Every kind of test gives back what its record was made of, by formulas written down here."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtri

from flexstage.base.errors import FlexstageError, ModelError, RecordError
from flexstage.experiments.campaign.plan import (
    KINDS,
    Campaign,
    Columns,
    Test,
)
from flexstage.experiments.campaign.results import characterise, evaluate
from flexstage.quantities.estimate import Estimate
from flexstage.quantities.sensor import SensorSpecification
from flexstage.records import Channel, Record
from flexstage.records.read_options import ReadOptions
from tests.measuring_files import function_58

STROKE, LOOP, BEND, WANDER = 63.7e-6, 3.1e-6, 4.3e-8, 6.1e-10
BOW, SLOPE, DROOP = 1.13e-7, 2.9e-3, 0.77e-7
ROLL, PITCH, YAW = 3.7e-6, 2.1e-6, 5.3e-6
NOISE, TURN = 2.5e-9, 4e-8


def record(time: Any = None, over: Any = "time", source: Any = "", **columns: Any) -> Record:
    """Columns as NAME=(values, unit)."""
    size = len(next(iter(columns.values()))[0])
    t = np.arange(size, dtype=float) if time is None else time
    channels = tuple(
        Channel(name=n, values=np.asarray(v, dtype=float), unit=u) for n, (v, u) in columns.items()
    )
    return Record(channels=channels, time=t, over=over, source=source)


def cycles(count, samples=240):
    """Share of the stroke, direction and time of triangles, with the last turning point."""
    k = np.arange(count * samples + 1)
    phase = (k % samples) / samples
    return 1.0 - np.abs(2.0 * phase - 1.0), np.where(phase < 0.5, 1.0, -1.0), k / 40.0


def motion(seed=1, count=7, spread=7e-9, unit="V", span=97.0):
    rng = np.random.default_rng(seed)
    s, way, t = cycles(count)
    approach = spread * rng.standard_normal(count + 1)[np.arange(s.size) // 240]
    hump = 4.0 * s * (1.0 - s)
    position = STROKE * s - 0.5 * LOOP * way * hump - BEND * hump + approach
    noise = lambda size: size * rng.standard_normal(s.size)  # noqa: E731
    return record(
        t,
        command=(3.0 * (unit == "V") + span * s, unit),
        along=(position + WANDER * t + noise(NOISE), "m"),
        across=(SLOPE * position + BOW * hump + noise(NOISE), "m"),
        vertical=(DROOP * hump + noise(NOISE), "m"),
        roll=(ROLL * s + noise(TURN), "rad"),
        pitch=(PITCH * hump + noise(TURN), "rad"),
        yaw=(-YAW * s + noise(TURN), "rad"),
    )


ROLES: Any = ("command", "along", "across", "vertical", "roll", "pitch", "yaw")
NAMED: Any = {n: n for n in ROLES}
SIX = Columns(**NAMED)
SENSORS = (
    SensorSpecification(name="gauge", calibration=7e-4, alignment=3e-3, drift=3e-11),
    SensorSpecification(name="side", calibration=3e-3, alignment=6e-4),
    SensorSpecification(name="turn", calibration=4e-3),
)


def run(test, *records, instruments=()):
    campaign = Campaign(instruments=instruments, tests=(test,))
    return evaluate(campaign, lambda _: list(records))


def near(estimate: Estimate, truth: float, worst: float) -> None:
    """The value is as near as its uncertainty says, which is no more than it may be."""
    low, high = estimate.interval()
    half = max(truth - low, high - truth) if estimate.bounds else 0.5 * (high - low)
    assert abs(estimate.value - truth) < max(2.0 * half, 1e-12 * abs(truth))
    assert 0.0 < half < worst, half


def test_every_kind_has_an_evaluation() -> None:
    assert all(callable(kind.evaluate) for kind in KINDS.values())


def test_motion() -> None:
    test = Test(name="m", test="motion", axis="left arm", records=("a",), columns=SIX)
    found = run(test, motion())
    truth = {
        "output_displacement": (STROKE, 1e-8),
        # a parabola of height h strays by h from its least-squares line, h/3 above and 2 h/3 below
        "linearity": (BEND, 1e-8),
        "hysteresis_loop_width": (LOOP, 1e-8),
        "straightness": (BOW, 3e-9),
        "straightness_out_of_plane": (DROOP, 3e-9),
        "cross_coupling": (SLOPE, 1e-4),
        "roll": (ROLL, 1e-7),
        "pitch": (PITCH, 1e-7),
        "parasitic_rotation": (YAW, 1e-7),
        "drift": (WANDER, 5e-10),
        "repeatability": (7e-9, 4e-8),
    }
    assert {f.quantity for f in found.figures} == set(truth)
    for quantity, (value, worst) in truth.items():
        figure = found.figure(quantity, "left arm")
        assert figure.test == "m"
        assert figure.estimate.note
        near(figure.estimate, value, worst)
    assert {row.origin for row in found.characteristics} == {"measured"}
    with pytest.raises(ModelError, match=r"no test measured roll of axis 'x': avail.*left arm"):
        found.figure("roll", "x")


def test_what_was_not_read_gives_no_figure() -> None:
    columns = Columns(command="command", along="along")
    found = run(Test(name="m", test="motion", axis="x", records=("a",), columns=columns), motion())
    assert {f.quantity for f in found.figures} == {
        "output_displacement", "linearity", "hysteresis_loop_width", "drift", "repeatability",
    }  # fmt: skip


def test_a_sensor_mounted_the_other_way_round() -> None:
    data = motion()
    turned = tuple(replace(c, values=-c.values) if c.name == "along" else c for c in data.channels)
    columns = Columns(command="command", along="along", across="across")
    test = Test(name="m", test="motion", axis="x", records=("a",), columns=columns)
    here = run(test, data)
    there = run(test, replace(data, channels=turned))
    for quantity in ("output_displacement", "linearity", "hysteresis_loop_width", "straightness"):
        one, other = (f.figure(quantity, "x").estimate for f in (here, there))
        assert other.value == pytest.approx(one.value, rel=1e-6), quantity
    assert there.figure("output_displacement", "x").estimate.value > 0.0


def test_sensors_enter_the_budget() -> None:
    test = Test(
        name="m", test="motion", axis="x", records=("a",), columns=SIX, along="gauge",
        transverse="side", angle="turn",
    )  # fmt: skip
    plain = run(replace(test, along=None, transverse=None, angle=None), motion())
    found = run(test, motion(), instruments=SENSORS)

    def parts(quantity):
        return {c.name: c.uncertainty for c in found.figure(quantity, "x").estimate.components}

    stroke = parts("output_displacement")
    assert stroke["calibration"] == pytest.approx(7e-4 * STROKE, rel=1e-3)
    # 1 - cos a of a normal angle a
    assert stroke["alignment"] == pytest.approx(3e-3**2 / math.sqrt(2.0) * STROKE, rel=1e-2)
    assert stroke["drift"] == pytest.approx(3e-11 * 3.0, rel=0.02)
    assert parts("straightness")["calibration"] == pytest.approx(3e-3 * BOW, rel=0.05)
    assert "alignment" not in parts("straightness")
    assert parts("cross_coupling")["alignment"] == pytest.approx(6e-4, rel=1e-9)
    assert parts("roll")["calibration"] == pytest.approx(4e-3 * ROLL, rel=0.05)
    assert parts("drift")["drift"] == pytest.approx(3e-11, rel=1e-9)
    for figure in found.figures:
        raw = plain.figure(figure.quantity, "x").estimate
        assert figure.estimate.uncertainty > raw.uncertainty
        # but for the mean cosine error of the sensor along
        assert figure.estimate.value == pytest.approx(raw.value, rel=1e-5)
    rows = {r.quantity: r for r in found.characteristics}
    row, estimate = rows["roll"], found.figure("roll", "x").estimate
    assert row.uncertainty == estimate.uncertainty
    assert row.degrees_of_freedom == estimate.degrees_of_freedom


def test_resolution_of_a_screw_is_its_step_times_the_ratio() -> None:
    test = Test(
        name="m", test="motion", axis="x", records=("a",), smallest_step=4.7e-7,
        columns=Columns(command="command", along="along"),
    )  # fmt: skip
    found = run(test, motion(unit="m", span=371e-6))
    near(found.figure("resolution", "x").estimate, 4.7e-7 * STROKE / 371e-6, 2e-9)
    with pytest.raises(RecordError, match=r"smallest_step needs a command in m.*'V'"):
        run(test, motion())


def staircase(rise, noise, per=60, levels=15, seed=2):
    rng = np.random.default_rng(seed)
    n = np.repeat(np.arange(levels), per)
    t = np.arange(n.size) / 130.0
    along = rise * n + 1.7e-6 + noise * rng.standard_normal(n.size)
    return record(t, command=(2.0 + 0.13 * n, "V"), along=(along, "m"))


STEPS = Columns(command="command", along="along")


def test_staircase() -> None:
    test = Test(name="s", test="staircase", axis="y", records=("a",), columns=STEPS)
    found = run(test, staircase(31e-9, 4e-9))
    # of the 42 samples of a level that are left when it has settled one half counts
    expected = 2.0 * math.sqrt(2.0) * ndtri(0.95) * 4e-9 / math.sqrt(21)
    near(found.figure("resolution", "y").estimate, expected, 2e-9)
    surer = run(replace(test, confidence=0.99), staircase(31e-9, 4e-9))
    ratio = (
        surer.figure("resolution", "y").estimate.value
        / found.figure("resolution", "y").estimate.value
    )
    assert ratio == pytest.approx(ndtri(0.99) / ndtri(0.95), rel=1e-6)


def test_smallest_steps_are_the_resolution() -> None:
    test = Test(
        name="s", test="staircase", axis="y", records=("a",), columns=STEPS, smallest_steps=True
    )
    found = run(test, staircase(31e-9, 4e-9))
    figure = found.figure("resolution", "y")
    near(figure.estimate, 31e-9, 2e-9)
    assert figure.estimate.note.startswith("mean of the smallest steps")
    with pytest.raises(
        RecordError, match=r"test 's': no step size is distinguishable from the noise"
    ):
        run(test, staircase(1e-10, 4e-9))


def test_hold() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(5000) / 90.0
    values = 3e-6 + 4.1e-9 * rng.standard_normal(t.size) + 1.7e-9 * t
    # what the drive is told stays the same as long as it holds
    data = record(t, along=(values, "m"), command=(np.full(t.size, 31.0), "V"))
    test = Test(
        name="h", test="hold", axis="x", records=("a",), columns=Columns(along="along"),
        along="gauge",
    )  # fmt: skip
    found = run(test, data, instruments=SENSORS)
    near(found.figure("noise", "x").estimate, 4.1e-9, 2e-10)
    near(found.figure("drift", "x").estimate, 1.7e-9, 2e-10)
    told = replace(test, columns=Columns(along="along", command="command"))
    assert run(told, data, instruments=SENSORS).figures == found.figures


RATE, FREQUENCY, DAMPING = 2048.0, 187.3, 0.013


def struck(seed, hits=4, block=4096):
    rng = np.random.default_rng(seed)
    force = np.zeros(hits * block + 512)
    for k in range(hits):
        at = k * block + 150 + int(rng.integers(0, 40))
        force[at : at + 3] = rng.uniform(3.0, 8.0) * np.array((0.4, 1.0, 0.5))
    w = 2.0 * np.pi * np.fft.rfftfreq(2 * force.size, 1.0 / RATE)
    w0 = 2.0 * np.pi * FREQUENCY
    h = -(w**2) / (w0**2 - w**2 + 2j * DAMPING * w0 * w) * 0.6
    a = np.fft.irfft(np.fft.rfft(force, n=2 * force.size) * h)[: force.size]
    a += 0.01 * np.sqrt(np.mean(a**2)) * rng.standard_normal(a.size)
    return record(
        np.arange(force.size) / RATE, f=(force, "N"), a=(a, "m/s^2"), source=f"hit {seed}"
    )


def test_response() -> None:
    test = Test(
        name="r", test="response", axis="x", records=("a", "b"), excitation="hammer",
        columns=Columns(input="f", output=("a",)), band=(90.0, 300.0), modes=1.0, along="clock",
    )  # fmt: skip
    clock = SensorSpecification(name="clock", time_base=2e-5)
    found = run(test, struck(4), struck(5), instruments=(clock,))
    figure = found.figure("natural_frequency_hz", "x").estimate
    near(figure, FREQUENCY, 0.1)
    base = {c.name: c.uncertainty for c in figure.components}["time base"]
    assert base == pytest.approx(2e-5 * FREQUENCY, rel=1e-4)
    damping = found.figure("damping_ratio", "x").estimate
    near(damping, DAMPING, 5e-4)
    assert "time base" not in {c.name for c in damping.components}
    assert found.results[0].details["estimate"].response.averages == 8


def test_response_over_frequency_from_a_universal_file(tmp_path) -> None:
    f = 80.0 + 0.25 * np.arange(900)
    s, w0 = 2j * np.pi * f, 2.0 * np.pi * FREQUENCY
    h = s**2 * 0.7 / (w0**2 + s**2 + 2.0 * DAMPING * w0 * s)
    rng = np.random.default_rng(6)
    white = rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)
    h += 2e-3 * np.abs(h).max() * white
    (tmp_path / "frf.uff").write_bytes(function_58(h, start=80.0, step=0.25))
    test = Test(name="r", test="response", axis="x", records=("frf.uff",), modes=1.0)
    found = characterise(Campaign(tests=(test,)), tmp_path)
    near(found.figure("natural_frequency_hz", "x").estimate, FREQUENCY, 0.05)
    near(found.figure("damping_ratio", "x").estimate, DAMPING, 3e-4)
    assert list(found.sources) == [str(tmp_path / "frf.uff")]
    bad = replace(test, test="hold", columns=Columns(along="0"), modes=None)
    with pytest.raises(RecordError, match=r"of kind hold: .* is over frequency, and it needs"):
        characterise(Campaign(tests=(bad,)), tmp_path)


def test_ring_down() -> None:
    rng = np.random.default_rng(7)
    t = np.arange(2500) / RATE
    w0, since = 2.0 * np.pi * FREQUENCY, t - 0.07
    free = np.exp(-DAMPING * w0 * since) * np.cos(w0 * math.sqrt(1.0 - DAMPING**2) * since)
    values = 2e-6 * np.where(since < 0.0, 1.0, free) + 5e-9 * rng.standard_normal(t.size)
    test = Test(
        name="d", test="ring-down", axis="y", records=("a",), columns=Columns(output=("p",))
    )
    found = run(test, record(t, p=(values, "m")))
    near(found.figure("natural_frequency_hz", "y").estimate, FREQUENCY, 0.05)
    near(found.figure("damping_ratio", "y").estimate, DAMPING, 3e-4)
    with pytest.raises(RecordError, match="one record and the columns of 'output'"):
        run(replace(test, columns=Columns()), record(t, p=(values, "m")))


WIDE, HIGH, LEAN, SKEW = 61.3e-6, 47.9e-6, 1.3e-3, -0.7e-3


def corners(rounds=8, seed=8, noise=6e-9):
    rng = np.random.default_rng(seed)
    k = np.tile(np.arange(4), rounds)
    a, b = WIDE * np.isin(k, (1, 2)), HIGH * (k >= 2)
    x = a + LEAN * b + noise * rng.standard_normal(k.size)
    y = b + SKEW * a + noise * rng.standard_normal(k.size)
    return record(over="point", corner=(k, "1"), u=(x, "m"), v=(y, "m"))


def test_workspace() -> None:
    test = Test(
        name="w", test="workspace", axis="uv", records=("a",), along="gauge",
        columns=Columns(corner="corner", x="u", y="v"),
    )  # fmt: skip
    found = run(replace(test, along=None), corners())
    area = WIDE * HIGH * (1.0 - LEAN * SKEW)
    near(found.figure("workspace_area", "uv").estimate, area, 5e-13)
    # the path of y leans towards x, and that of x away from y: both close the angle or open it
    angle = math.atan2(1.0, LEAN) - math.atan2(SKEW, 1.0) - 0.5 * math.pi
    near(found.figure("squareness", "uv").estimate, angle, 4e-4)
    sensed = run(test, corners(), instruments=SENSORS)
    parts = {
        c.name: c.uncertainty for c in sensed.figure("workspace_area", "uv").estimate.components
    }
    assert parts["calibration"] == pytest.approx(math.sqrt(2.0) * 7e-4 * area, rel=1e-3)
    parts = {c.name: c.uncertainty for c in sensed.figure("squareness", "uv").estimate.components}
    assert parts["alignment"] == pytest.approx(math.sqrt(2.0) * 3e-3, rel=1e-6)


def test_corners_that_are_missing_or_over() -> None:
    test = Test(
        name="w", test="workspace", axis="xy", records=("a",),
        columns=Columns(corner="corner", x="u", y="v"),
    )  # fmt: skip
    whole = corners(rounds=3)

    def part(n):
        cut = tuple(replace(c, values=c.values[:n]) for c in whole.channels)
        return replace(whole, channels=cut, time=whole.time[:n])

    found = run(test, part(10))
    assert found.results[0].notes == (
        "2 complete rounds are evaluated; further visits are ignored",
    )
    for few in (3, 5):
        with pytest.raises(RecordError, match=r"corners are numbered 0 to 3.*at least twice"):
            run(test, part(few))


def approached(runs=4, seed=9):
    rng = np.random.default_rng(seed)
    targets = np.array([0.0, 11e-6, 23e-6, 31e-6, 47e-6, 52e-6])
    bias = 1e-9 * np.array([0.0, 21.0, -13.0, 34.0, 8.0, -5.0])
    rows, reached = [], []
    for _ in range(runs):
        for order, back in ((range(6), 0.0), (range(5, -1, -1), 17e-9)):
            for i in order:
                rows.append(targets[i])
                reached.append(targets[i] + bias[i] + back + 2e-9 * rng.standard_normal())
    return np.array(rows), np.array(reached) + 3.3e-6


def test_positioning() -> None:
    # of 300 seeds the interval of B holds the truth in 97 %
    command, along = approached(seed=10)
    test = Test(
        name="p", test="positioning", axis="x", records=("a",),
        columns=Columns(command="wanted", along="along"),
    )  # fmt: skip
    found = run(test, record(over="point", wanted=(command, "m"), along=(along, "m")))
    # a series up and one down in each run: the stage turned round beyond the ends
    off = (along - command).reshape(4, 2, 6)
    up, down = off[:, 0].T, off[:, 1, ::-1].T
    mean = np.stack((up.mean(axis=1), down.mean(axis=1)))
    spread = np.stack((up.std(axis=1, ddof=1), down.std(axis=1, ddof=1)))
    accuracy = float(np.max(mean + 2.0 * spread) - np.min(mean - 2.0 * spread))
    reversal = float(np.max(np.abs(mean[0] - mean[1])))
    a = found.figure("positioning_accuracy", "x").estimate
    b = found.figure("reversal", "x").estimate
    assert a.value == pytest.approx(accuracy, rel=1e-9)
    assert b.value == pytest.approx(reversal, rel=1e-9)
    assert b.interval()[0] < 17e-9 < b.interval()[1]
    said = found.results[0].notes
    assert said[0].startswith("4 runs to 6 targets: one row for each approach")
    assert any("zero of the reading differs by +3.3" in note for note in said)
    with pytest.raises(RecordError, match="positions in m or angles, and the command is in 'V'"):
        run(test, record(over="point", wanted=(command, "V"), along=(along, "m")))
    with pytest.raises(RecordError, match="from both sides"):
        run(test, record(over="point", wanted=(command[:6], "m"), along=(along[:6], "m")))


def test_the_gain_of_a_sensor_counts_over_the_travel_of_a_positioning_test() -> None:
    command, along = approached(seed=10)
    test = Test(
        name="p", test="positioning", axis="x", records=("a",), along="gauge",
        columns=Columns(command="wanted", along="along"),
    )  # fmt: skip
    found = run(
        test, record(over="point", wanted=(command, "m"), along=(along, "m")), instruments=SENSORS
    )

    def gain(quantity: str) -> tuple[float, float]:
        estimate = found.figure(quantity, "x").estimate
        return estimate.value, {c.name: c.uncertainty for c in estimate.components}["calibration"]

    travel = float(np.ptp(command))
    for quantity in ("positioning_accuracy", "positioning_systematic_deviation"):
        value, part = gain(quantity)
        assert part == pytest.approx(7e-4 * travel, rel=1e-3)
        assert value < 0.1 * travel
    # what is compared at one target has the gain over itself alone
    value, part = gain("reversal")
    assert part == pytest.approx(7e-4 * value, rel=1e-3)


def test_positioning_by_dwells() -> None:
    command, along = approached()
    # no sample says that the stage left the ends in between: they are reached from one side
    wanted, reading = (np.repeat(v, 20) for v in (command, along))
    reading = reading + 1e-9 * np.random.default_rng(10).standard_normal(reading.size)
    test = Test(
        name="p", test="positioning", axis="x", records=("a",),
        columns=Columns(command="wanted", along="along"),
    )  # fmt: skip
    found = run(test, record(over="point", wanted=(wanted, "m"), along=(reading, "m")))
    b = found.figure("reversal", "x").estimate
    assert b.interval()[0] < 17e-9 < b.interval()[1]
    assert b.value == pytest.approx(17e-9, abs=5e-9)
    said = found.results[0].notes
    assert said[0].startswith("4 runs to 4 targets: 41 dwells of about 20 samples")
    assert said[1].startswith(
        "positions that were approached from one side only are ignored: 0, 52 "
    )


def probed(axis, seed=11, count=6, stations=15):
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, stations)
    s = np.tile(np.concatenate((s, s[::-1])), count)
    hump = 4.0 * s * (1.0 - s)
    along, aside, lift = STROKE * s, SLOPE * STROKE * s + 1e-6 * hump, 0.8e-6 * hump
    about_axis, about_side, about_normal = 4e-5 * s, 3e-5 * hump, -7e-5 * s
    plate = np.array([(-21e-3, -17e-3, 12e-3), (19e-3, -22e-3, 11e-3), (3e-3, 23e-3, 17e-3)])
    columns: Any = {"command": (371e-6 * s, "m")}
    first_is_x = axis == "x"
    shift = np.stack((along, aside, lift) if first_is_x else (aside, along, lift), axis=1)
    turn = np.stack(
        (about_axis, about_side, about_normal) if first_is_x else
        (about_side, about_axis, about_normal), axis=1,
    )  # fmt: skip
    moved = np.stack([Rotation.from_rotvec(turn).apply(p) for p in plate], axis=1)
    moved += shift[:, None] + 5e-9 * rng.standard_normal(moved.shape)
    for i, name in enumerate("ABC"):
        for j, letter in enumerate("XYZ"):
            columns[f"{name}.{letter}"] = (moved[:, i, j], "m")
    return record(over="point", **columns)


@pytest.mark.parametrize(("axis", "runs"), [("x", "x"), ("y", "y"), ("travel", "y"), ("y", "x")])
def test_spheres(axis, runs) -> None:
    test = Test(
        name="b", test="spheres", axis=axis, records=("a",),
        columns=Columns(command="command", spheres=("A", "B", "C")),
    )  # fmt: skip
    found = run(test, probed(runs))  # an axis may be called as it likes
    truth = {
        "output_displacement": (STROKE, 5e-8),
        "straightness": (1e-6, 5e-8),
        "straightness_out_of_plane": (0.8e-6, 5e-8),
        "cross_coupling": (SLOPE, 1e-3),
        "roll": (4e-5, 2e-6),
        "pitch": (3e-5, 2e-6),
        "parasitic_rotation": (7e-5, 2e-6),
    }
    for quantity, (value, worst) in truth.items():
        near(found.figure(quantity, axis).estimate, value, worst)
    assert "drift" not in {f.quantity for f in found.figures}
    assert any("rigid body by" in note for note in found.results[0].notes)


def test_spheres_that_cannot_tell_a_motion() -> None:
    test = Test(
        name="b", test="spheres", axis="x", records=("a",),
        columns=Columns(command="command", spheres=("A", "B", "C")),
    )  # fmt: skip
    data = probed("x")
    lifted = {"X": "Z", "Y": "X", "Z": "Y"}  # of each column, what it is called instead
    turned = tuple(
        replace(c, name=c.name[:-1] + lifted[c.name[-1]]) if "." in c.name else c
        for c in data.channels
    )
    with pytest.raises(RecordError, match="the spheres move most along the machine's Z"):
        run(test, replace(data, channels=turned))
    with pytest.raises(RecordError, match="names 2 spheres"):
        run(replace(test, columns=Columns(command="command", spheres=("A", "B"))), data)
    with pytest.raises(RecordError, match=r"no column 'D\.X'"):
        run(replace(test, columns=Columns(command="command", spheres=("A", "B", "D"))), data)
    bare = tuple(replace(c, unit="") if c.name == "B.Y" else c for c in data.channels)
    with pytest.raises(RecordError, match=r"'B\.Y' does not give its unit"):
        run(test, replace(data, channels=bare))


def test_the_first_test_of_a_figure_counts() -> None:
    test = Test(
        name="one", test="staircase", axis="x", records=("a",), columns=STEPS, smallest_steps=True
    )
    other = replace(test, name="two")
    data = {"one": staircase(31e-9, 4e-9), "two": staircase(43e-9, 4e-9)}
    campaign = Campaign(tests=(test, other), notes=("kept",))
    found = evaluate(campaign, lambda t: [data[t.name]])
    assert len(found.figures) == 1
    assert found.figures[0].test == "one"
    assert len(found.results) == 2
    near(found.results[1].figures[0].estimate, 43e-9, 3e-9)
    turned = evaluate(replace(campaign, tests=campaign.tests[::-1]), lambda t: [data[t.name]])
    assert turned.figures[0].test == "two"


@pytest.mark.parametrize("kind", ["motion", "spheres", "staircase", "hold", "workspace"])
def test_two_records_for_a_test_of_one(kind) -> None:
    test = Test(name="t", test=kind, axis="x", records=("a", "b"), columns=SIX)
    with pytest.raises(RecordError, match=f"'t' of kind {kind} is evaluated from one file, got 2"):
        run(test, motion(), motion())


def test_columns_that_cannot_be_used() -> None:
    data = motion()
    test = Test(name="t", test="motion", axis="x", records=("a",), columns=SIX)

    def changed(name, **how):
        channels = tuple(
            replace(c, **{k: v(c.values) if callable(v) else v for k, v in how.items()})
            if c.name == name
            else c
            for c in data.channels
        )
        return replace(data, channels=channels)

    for said, spoiled in (
        ("'along' is in V, and 'along' needs a unit of length", changed("along", unit="V")),
        ("'yaw' does not give its unit, and 'yaw' needs a unit of angle", changed("yaw", unit="")),
        ("'command' is in N, and 'command' needs one of V, m", changed("command", unit="N")),
        ("dead or not connected", changed("roll", values=lambda v: 0.0 * v + 0.3)),
        ("'along' is clipped at", changed("along", values=lambda v: np.minimum(v, 0.9 * v.max()))),
        ("'pitch' is clipped at", changed("pitch", values=lambda v: np.maximum(v, 0.3 * v.max()))),
    ):
        with pytest.raises(RecordError, match=said):
            run(test, spoiled)
    with pytest.raises(RecordError, match="needs the column of 'along'"):
        run(replace(test, columns=Columns(command="command")), data)
    with pytest.raises(RecordError, match="no column 'twist'"):
        run(replace(test, columns=replace(SIX, roll="twist")), data)


def test_a_stage_that_rests_at_its_ends_is_not_cut_off() -> None:
    s, _, _ = cycles(5)
    held = np.clip(1.3 * s - 0.15, 0.0, 1.0)
    t = np.arange(s.size) / 40.0
    coarse = np.round(STROKE * held / 5e-8) * 5e-8
    data = record(t, command=(97.0 * held, "V"), along=(coarse, "m"))
    columns = Columns(command="command", along="along")
    test = Test(name="t", test="motion", axis="x", records=("a",), columns=columns)
    found = run(test, data)
    assert found.figure("output_displacement", "x").estimate.value == pytest.approx(
        STROKE, abs=5e-8
    )


def test_a_record_sampled_unevenly() -> None:
    data = motion()
    keep = np.random.default_rng(12).random(data.size) > 0.2
    # without its turning points a run would truly be shorter
    keep[::120] = True
    thin = replace(
        data,
        channels=tuple(replace(c, values=c.values[keep]) for c in data.channels),
        time=data.time[keep],
    )
    found = run(Test(name="t", test="motion", axis="x", records=("a",), columns=SIX), thin)
    near(found.figure("output_displacement", "x").estimate, STROKE, 1.5e-8)
    near(found.figure("straightness", "x").estimate, BOW, 3e-9)
    hold = Test(name="h", test="hold", axis="x", records=("a",), columns=Columns(along="along"))
    with pytest.raises(RecordError, match="test 'h'"):
        run(hold, thin)


def test_too_few_cycles() -> None:
    test = Test(name="t", test="motion", axis="x", records=("a",), columns=SIX)
    near(run(test, motion(count=3)).figure("straightness", "x").estimate, BOW, 2e-8)
    with pytest.raises(RecordError, match=r"test 't': 3 whole cycles over .* are needed.*got 2"):
        run(test, motion(count=2))


@pytest.mark.parametrize(
    ("said", "changes"),
    [
        ("test 't'.*unknown kind 'jump': choose from motion", {"test": "jump"}),
        ("test 't' names no record", {"records": ()}),
        ("test 't' names no axis", {"axis": " "}),
        ("test 't'.*unknown excitation 'kick'", {"excitation": "kick"}),
        ("modes of test 't' .*whole number from 1 .*got 2.5", {"modes": 2.5}),
        ("modes of test 't' .*whole number from 1 .*got 0", {"modes": 0}),
        ("the band of test 't' must rise", {"band": (900.0, 300.0)}),
        ("confidence of test 't' must be between 0.5 and 1, got 1", {"confidence": 1.0}),
        ("smallest_step of test 't' must be above 0, got 0", {"smallest_step": 0.0}),
    ],
)
def test_tests_that_cannot_be(said, changes) -> None:
    given = {"name": "t", "test": "hold", "axis": "x", "records": ("a",)}
    with pytest.raises(ModelError, match=said):
        Test(**(given | changes))
    with pytest.raises(RecordError, match="sample_rate must be above 0, got -3"):
        ReadOptions(sample_rate=-3.0)


def test_campaigns_that_cannot_be() -> None:
    test = Test(name="t", test="hold", axis="x", records=("a",))
    with pytest.raises(ModelError, match="two test entries are called 't'"):
        Campaign(tests=(test, test))
    with pytest.raises(ModelError, match="one of measured, virtual, got 'dreamt'"):
        Campaign(tests=(test,), origin="dreamt")
    with pytest.raises(ModelError, match=r"the instrument 'eye', which is not described .*none"):
        Campaign(tests=(replace(test, along="eye"),))
    with pytest.raises(ModelError, match=r"instrument 'g': calibration"):
        SensorSpecification(name="g", calibration=-1e-3)
    with pytest.raises(FlexstageError, match="no test"):
        characterise(Campaign(tests=()))


def test_commands_of_a_report_that_has_none() -> None:
    data = probed("x")
    told = data.channel("command").values
    without = replace(data, channels=tuple(c for c in data.channels if c.name != "command"))
    named = Test(
        name="b", test="spheres", axis="x", records=("a",),
        columns=Columns(command="command", spheres=("A", "B", "C")),
    )  # fmt: skip
    listed = replace(named, columns=Columns(spheres=("A", "B", "C")), commands=tuple(told.tolist()))
    assert run(listed, without).figures == run(named, data).figures
    with pytest.raises(
        RecordError, match=r"gives 3 commands for 180 stations: give one command for each station"
    ):
        run(replace(listed, commands=(0.0, 1e-6, 2e-6)), without)


def test_an_abbe_offset_counts_by_the_pitch_that_was_read() -> None:
    """The stroke at a point off the sensor's line differs by the offset times the pitch."""
    s, _, t = cycles(6)
    rng = np.random.default_rng(12)
    pitch = 9e-6 * s + 2e-8 * rng.standard_normal(s.size)
    data = record(
        t,
        command=(90.0 * s, "V"),
        along=(STROKE * s + 2e-9 * rng.standard_normal(s.size), "m"),
        pitch=(pitch, "rad"),
    )
    columns = Columns(command="command", along="along", pitch="pitch")
    test = Test(
        name="m", test="motion", axis="x", records=("a",), columns=columns, along="off", angle="off"
    )

    def stroke_of(**sensor: float) -> Estimate:
        campaign = Campaign(tests=(test,), instruments=(SensorSpecification(name="off", **sensor),))
        return evaluate(campaign, lambda _: [data]).figure("output_displacement", "x").estimate

    plain, off = stroke_of(), stroke_of(abbe_offset=30e-3, abbe_uncertainty=2e-3)
    assert plain.value - off.value == pytest.approx(30e-3 * 9e-6, rel=2e-2)
    parts = {c.name: c.uncertainty for c in off.components}
    assert parts["Abbe"] == pytest.approx(2e-3 * 9e-6, rel=2e-2)
