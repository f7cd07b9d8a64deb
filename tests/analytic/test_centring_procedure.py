"""The move and the whole procedure, on tables and stages whose truth is known.

Evidence (Measuring and centring): procedure, one and four heads, 50 µm, 1 arcsec: residual below
0.1 µm in 600 cases each, *simulated* [*slow*]
"""

import math

import numpy as np
import pytest

from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.calibration import ScaleReadings, against_reference
from flexstage.centring.eccentricity import HeadReadings, eccentricity
from flexstage.centring.geometry import ARCSEC
from flexstage.centring.move import (
    MoveErrors,
    Positioner,
    length_prediction,
    move_errors,
    nearest_in_box,
    planned_move,
    unknown_moves,
)
from flexstage.centring.procedure import (
    CentreReading,
    Centring,
    centre,
    centre_reading,
    table_reading,
)
from flexstage.stage.designs import design
from flexstage.virtual.table import (
    ScaleErrors,
    TableMounting,
    VirtualBench,
    VirtualPositioner,
    VirtualTable,
    scale_errors,
)
from tests.tiers import limits, sizes

PIEZO, SCREW = design("vgtu-piezo"), design("vgtu-mechanical")
RADIUS = 50e-3
FOUR = (0.0, 1.6, 3.1, 4.8)
TINY = 1e-20 * np.eye(2)


def bench(seed, *, stage=PIEZO, heads=(0.3,), method="reference", mode="open loop", **more):
    """A scale 50 um off the axis, in a direction that the stage can go, mounted at any angle."""
    random = np.random.default_rng(seed)
    corner = stage is PIEZO
    positioner = VirtualPositioner(
        stage,
        mode=mode,
        start=(-1.0, -1.0) if corner else (0.0, 0.0),
        mounting=TableMounting(
            angle=random.uniform(-np.pi, np.pi),
            mirrored=bool(random.integers(2)),
            squareness=0.012,
            cross_coupling=(0.006, -0.004),
        ),
        seed=seed,
        **more,
    )
    # from rest, a piezo only pushes: the centre must lie in the quadrant that it reaches
    way = random.uniform(0.15, 1.42) if corner else random.uniform(0.0, 2.0 * np.pi)
    off = -positioner.matrix @ np.array([np.cos(way), np.sin(way)])
    mount = 50e-6 * off / np.hypot(*off) - positioner.true_position
    table = VirtualTable(
        radius=RADIUS,
        heads=heads,
        eccentricity=(mount[0], mount[1]),
        noise=ARCSEC,
        scale=scale_errors(range(2, 20), 2.0 * ARCSEC, seed=1),
        reference_noise=0.0 if method == "reference" else 5.0 * ARCSEC,
        seed=seed,
    )
    return VirtualBench(table, positioner, method=method), positioner


def run(seed, *, procedure=None, **settings) -> tuple[Centring, float, bool]:
    """Centre; return the result, the true eccentricity that is left, and if its region holds it."""
    made, positioner = bench(seed, **settings)
    done = centre(made.measure, positioner, **(procedure or {}))
    truth = made.true_eccentricity
    return done, float(np.hypot(*truth)), done.reading.covers(truth)


# ------------------------------------------------------------------------ a scale far off its axis


@pytest.mark.parametrize("heads", [(0.3,), FOUR])
def test_fifty_micrometres_in_three_moves_with_hysteresis(heads) -> None:
    expected = []
    for seed in range(8):
        done, left, _ = run(seed, heads=heads)
        assert done.steps[0].reading.length.value == pytest.approx(50e-6, abs=0.2e-6)
        assert done.moves <= 3
        assert done.trials == 2
        assert left < 0.1e-6
        assert done.predicted is not None
        expected.append(done.predicted.interval()[1])
    assert np.median(expected) < 0.1e-6


def test_heads_without_a_reference() -> None:
    done, left, _ = run(3, heads=FOUR, method="heads alone")
    assert done.reached
    assert left < 0.1e-6


def test_with_sensors_one_trial_move_and_two_moves_do() -> None:
    for seed in range(6):
        made, positioner = bench(seed, heads=FOUR, mode="closed loop")
        mirrored = bool(np.linalg.det(positioner.matrix) < 0.0)
        done = centre(made.measure, positioner, trials=1, mirrored=mirrored, approach="direct")
        assert done.reached
        assert done.trials + done.moves <= 3
        assert np.hypot(*made.true_eccentricity) < 0.1e-6


def test_the_screw_stage_comes_as_near_as_its_steps_let_it() -> None:
    step = VirtualPositioner(SCREW).settable(0.9e-7, 0.9e-7)[0]
    assert step == pytest.approx(350e-6 / 720 * 110.1 / 350.0)
    for seed in range(8):
        done, left, _ = run(seed, stage=SCREW, heads=FOUR)
        # half a step in each axis, and some noise
        assert left < step / math.sqrt(2.0) + 0.03e-6
        assert done.predicted is not None
        assert done.predicted.value < 0.12e-6


def test_approach_from_below_takes_out_hysteresis_and_backlash() -> None:
    left = {
        (stage.name, approach): [
            run(seed, stage=stage, heads=FOUR, procedure={"approach": approach}, **more)[1]
            for seed in range(6)
        ]
        for stage, more in ((PIEZO, {}), (SCREW, {"backlash": 2e-6}))
        for approach in ("direct", "from below")
    }
    assert np.median(left["vgtu-piezo", "direct"]) > 0.15e-6
    assert np.median(left["vgtu-mechanical", "direct"]) > 0.15e-6
    assert max(left["vgtu-piezo", "from below"]) < 0.1e-6
    assert max(left["vgtu-mechanical", "from below"]) < 0.15e-6


@pytest.mark.parametrize("repeats", sizes(slow=150, evidence=600))
@pytest.mark.parametrize("heads", [(0.3,), FOUR])
def test_the_stated_uncertainty_covers_the_truth(heads, repeats) -> None:
    runs = [run(seed, heads=heads) for seed in range(repeats)]
    region = np.mean([held for _, _, held in runs])
    length = np.mean([done.eccentricity.covers(left) for done, left, _ in runs])
    low, high = limits(repeats, 0.93, 0.97, full=600)
    assert low < region < high
    # an interval that ends at zero holds a length near zero in 97.5 % of all cases
    low, high = limits(repeats, 0.93, 0.99, full=600)
    assert low < length < high
    assert max(left for _, left, _ in runs) < 0.1e-6
    kept = [left <= done.predicted.interval()[1] for done, left, _ in runs if done.predicted]
    low, _ = limits(repeats, 0.94, 1.0, full=600, share=0.975)
    assert np.mean(kept) > low


@pytest.mark.parametrize("repeats", sizes(slow=150, evidence=500))
@pytest.mark.parametrize("heads", [(0.3,), FOUR])
def test_predictions_with_sensors_are_as_good_as_they_say(heads, repeats) -> None:
    setting = {"heads": heads, "mode": "closed loop"}
    runs = [run(seed, procedure={"approach": "direct"}, **setting) for seed in range(repeats)]
    held = [done.predicted.covers(left) for done, left, _ in runs if done.predicted]
    low, high = limits(repeats, 0.93, 0.97, full=500)
    assert low < np.mean(held) < high
    assert low < np.mean([region for _, _, region in runs]) < high


# --------------------------------------------------------------------------------- the limits


def test_what_the_limits_do_not_reach_is_said() -> None:
    positioner = VirtualPositioner(PIEZO, mode="closed loop", mounting=TableMounting(angle=0.3))
    table = VirtualTable(radius=RADIUS, heads=FOUR, eccentricity=(70e-6, 5e-6), noise=ARCSEC)
    made = VirtualBench(table, positioner)
    done = centre(made.measure, positioner, approach="direct")
    left = float(np.hypot(*made.true_eccentricity))
    assert not done.reached
    assert "limits of the stage leave" in done.reason
    assert f"{1e6 * left:.1f} um"[:3] in done.reason
    # no other command would have done better
    low, high = np.array(positioner.limits).T
    grid = np.stack(np.meshgrid(*np.linspace(low, high, 80).T)).reshape(2, -1)
    offsets = made.true_eccentricity - positioner.true_position
    others = np.hypot(*(positioner.matrix @ grid + offsets[:, np.newaxis]))
    assert left < others.min() + 0.05e-6


def test_a_planned_move_keeps_within_the_limits() -> None:
    positioner = VirtualPositioner(SCREW, start=(0.4, -0.2))
    model = unknown_moves((200e-6, 3e-6), TINY, matrix=np.eye(2), matrix_uncertainty=1e-6)
    plan = planned_move(model, positioner)
    assert plan.command[0] >= positioner.limits[0][0]
    assert not plan.within_limits
    assert plan.shortfall == pytest.approx(200e-6 + plan.by[0], abs=0.2e-6)
    assert plan.remaining.covers(plan.shortfall)
    assert "limits" in plan.remaining.note


# ------------------------------------------------------------------------------ learning the moves


@pytest.mark.parametrize("mirrored", [False, True])
def test_trial_moves_tell_angle_sign_gain_and_squareness(mirrored: bool) -> None:
    c, s = math.cos(2.2), math.sin(2.2)
    own = np.array([[1.1, 0.02], [0.01, -0.8 if mirrored else 0.8]])
    J = np.array([[c, -s], [s, c]]) @ own
    e = np.array([31e-6, -12e-6])
    model = unknown_moves(e, TINY)
    for du in (np.array([9e-6, 0.0]), np.array([0.0, -7e-6])):
        e = e + J @ du
        model = model.moved(du).measured(e, TINY)
    assert model.matrix == pytest.approx(J, rel=1e-5)
    assert model.moves == 2


@pytest.mark.parametrize("mirrored", [False, True])
def test_one_trial_move_where_the_axes_are_square(mirrored: bool) -> None:
    J = np.array([[0.6, -0.8], [0.8, 0.6]]) @ np.diag([1.05, 0.9 * (-1.0 if mirrored else 1.0)])
    du = np.array([9e-6, 0.0])
    model = unknown_moves((20e-6, 5e-6), TINY).moved(du)
    model = model.measured(np.array([20e-6, 5e-6]) + J @ du, TINY)
    model = model.square(mirrored=mirrored, gain_ratio=0.9 / 1.05, uncertainty=1e-4)
    assert model.matrix == pytest.approx(J, abs=1e-3)


def test_the_model_is_least_squares_of_all_moves() -> None:
    random = np.random.default_rng(12)
    J = np.array([[0.9, 0.3], [-0.25, 1.1]])
    moves = 1e-5 * random.standard_normal((6, 2))
    sigma = 2e-8
    centre_at = np.array([3e-5, 1e-5]) + np.vstack(([0.0, 0.0], np.cumsum(moves, axis=0))) @ J.T
    read = centre_at + sigma * random.standard_normal(centre_at.shape)
    model = unknown_moves(read[0], sigma**2 * np.eye(2), matrix_uncertainty=1e3)
    for du, z in zip(moves, read[1:], strict=True):
        model = model.moved(du).measured(z, sigma**2 * np.eye(2))
    # e_k = e_0 + J u_k, all at once
    u = np.vstack(([0.0, 0.0], np.cumsum(moves, axis=0)))
    X = np.hstack((np.ones((7, 1)), u))
    solution, *_ = np.linalg.lstsq(X, read, rcond=None)
    assert model.matrix == pytest.approx(solution[1:].T, rel=1e-6)
    last = np.array([1.0, *u[-1]])
    assert model.eccentricity == pytest.approx(last @ solution, rel=1e-8)
    variance = sigma**2 * last @ np.linalg.inv(X.T @ X) @ last
    assert np.diag(model.eccentricity_covariance) == pytest.approx([variance, variance], rel=1e-6)


def test_what_axes_may_do_widens_the_prediction() -> None:
    J = np.array([[0.6, -0.8], [0.8, 0.6]]) @ np.diag([1.05, 0.9])
    model = unknown_moves((20e-6, 5e-6), TINY, matrix=J, matrix_uncertainty=1e-9)
    du = np.array([8e-6, -3e-6])
    errors = MoveErrors(hysteresis=(0.1, 0.2), resolution=(30e-9, 50e-9))
    cov = model.moved(du, errors).eccentricity_covariance
    own = np.array([(0.8e-6) ** 2 + (30e-9) ** 2, (0.6e-6) ** 2 + (50e-9) ** 2])
    assert cov == pytest.approx(J @ np.diag(own) @ J.T, rel=1e-4)
    bent = model.moved(du, MoveErrors(curvature=(1e4, 2e4))).eccentricity_covariance
    own = np.array([(1e4 * 4e-6 * 8e-6) ** 2, (2e4 * 1.5e-6 * 3e-6) ** 2])
    assert bent == pytest.approx(J @ np.diag(own) @ J.T, rel=1e-4)
    # back by as much, the middle of the move is where it was
    there = model.moved(du, MoveErrors(curvature=(1e4, 2e4)))
    back = there.moved(-du, MoveErrors(curvature=(1e4, 2e4)))
    assert np.trace(back.eccentricity_covariance) < 1e-3 * np.trace(bent)


@pytest.mark.parametrize(
    ("vector", "spread"),
    [((0.0, 0.0), (3.0, 3.0)), ((2.0, 0.0), (1.0, 1.0)), ((1.0, -4.0), (0.5, 2.0))],
)
def test_expected_length_against_many_drawn(vector, spread) -> None:
    c, s = math.cos(0.7), math.sin(0.7)
    turn = np.array([[c, -s], [s, c]])
    cov = turn @ np.diag(np.square(spread)) @ turn.T
    found = length_prediction(vector, cov)
    drawn = np.random.default_rng(4).multivariate_normal(vector, cov, 400_000)
    length = np.hypot(drawn[:, 0], drawn[:, 1])
    assert found.value == pytest.approx(length.mean(), rel=0.005)
    assert found.uncertainty == pytest.approx(length.std(), rel=0.01)
    assert found.interval() == pytest.approx(np.quantile(length, (0.025, 0.975)), rel=0.02)


# ------------------------------------------------------------------- positioners and benches


def test_the_virtual_stage_has_the_stroke_and_loop_that_were_measured() -> None:
    positioner = VirtualPositioner(PIEZO, noise=0.0, quantum=0.0)
    assert isinstance(positioner, Positioner)
    commands = np.linspace(*positioner.limits[0], 61)
    cycles = []
    for _ in range(3):
        for path in (commands, commands[::-1]):
            for x in path:
                positioner.move_to(x, 0.0)
                cycles.append(positioner.true_position[0])
    rising, falling = np.reshape(cycles, (3, 2, 61))[-1]
    assert np.ptp(rising) == pytest.approx(63.12e-6, rel=1e-3)
    assert np.max(np.abs(falling[::-1] - rising)) == pytest.approx(7.91e-6, rel=0.03)


def test_mounting_of_the_virtual_stage() -> None:
    positioner = VirtualPositioner(
        SCREW,
        mounting=TableMounting(
            angle=0.5, mirrored=True, squareness=0.1, cross_coupling=(0.03, -0.02)
        ),
        noise=0.0,
    )
    a, b = positioner.move_to(8e-6, -11e-6)
    c, s = math.cos(0.5), math.sin(0.5)
    x = a + (math.sin(0.1) - 0.02) * b
    y = -(0.03 * a + math.cos(0.1) * b)
    assert positioner.true_position == pytest.approx([c * x - s * y, s * x + c * y])


def test_backlash_of_a_screw() -> None:
    positioner = VirtualPositioner(SCREW, noise=0.0, backlash=3e-6)
    reached = []
    for x in (20e-6, 18.5e-6, 10e-6):
        command = positioner.move_to(x, 0.0)[0]
        reached.append(positioner.true_position[0] - command)
    assert reached == pytest.approx([-1.5e-6, 0.0, 1.5e-6], abs=0.2e-6)
    assert move_errors(positioner, "direct").resolution[0] == pytest.approx(1.5e-6)
    assert move_errors(positioner, "from below").resolution[0] == 0.0


def test_a_stage_without_published_stroke_takes_that_of_the_model() -> None:
    from dataclasses import replace

    bare = replace(PIEZO, published=())
    low, high = VirtualPositioner(bare).limits[0]
    assert high - low == pytest.approx(67.5e-6, rel=0.01)


def test_eccentricity_and_order_one_of_the_scale_are_one() -> None:
    scale = ScaleErrors(orders=(1, 2), cosine=np.array([3e-6, 1e-6]), sine=np.array([-5e-6, 2e-6]))
    table = VirtualTable(radius=RADIUS, heads=FOUR, eccentricity=(2e-6, 7e-6), scale=scale)
    made = VirtualBench(table, VirtualPositioner(SCREW, noise=0.0))
    assert table.apparent_eccentricity == pytest.approx([2e-6 - 0.25e-6, 7e-6 - 0.15e-6])
    # off the axis by 1.4e-4 of the radius, order 2 of the scale is read as much out of place
    assert made.measure().vector == pytest.approx(table.apparent_eccentricity, abs=3e-11)


def test_both_ways_of_evaluation_agree() -> None:
    table = VirtualTable(
        radius=RADIUS, heads=FOUR, eccentricity=(31e-6, -17e-6), noise=ARCSEC, samples=120, seed=2
    )
    record = table.record()
    angle, *errors = (channel.values for channel in record.channels)
    first = table_reading(
        against_reference(
            ScaleReadings(angle=angle, errors=np.stack(errors), heads=FOUR), range(1, 7)
        ),
        RADIUS,
    )
    heads = [
        HeadReadings(angle=angle, error=error, head_angle=alpha)
        for alpha, error in zip(FOUR, errors, strict=True)
    ]
    second = centre_reading(eccentricity(heads, radius=RADIUS, orders=6))
    assert first.vector == pytest.approx(second.vector, abs=0.01e-6)
    assert np.diag(first.covariance) == pytest.approx(np.diag(second.covariance), rel=0.6)
    whole = VirtualBench(table, VirtualPositioner(SCREW), method="eccentricity").measure()
    assert whole.covers(table.apparent_eccentricity)


def test_the_region_of_few_degrees_of_freedom() -> None:
    # the square of its half axis, over the variance, is 2 F(2, nu) at 95 %
    held = CentreReading(vector=np.zeros(2), covariance=np.eye(2), degrees_of_freedom=5.0)
    reach = math.sqrt(2.0 * 5.786135)
    assert held.covers((0.0, 0.999 * reach))
    assert not held.covers((0.0, 1.001 * reach))


# ------------------------------------------------------------------------------ what is refused


def test_a_centred_scale_is_left_alone() -> None:
    positioner = VirtualPositioner(SCREW, noise=0.0)
    table = VirtualTable(radius=RADIUS, heads=FOUR, eccentricity=(2e-9, -3e-9), noise=ARCSEC)
    done = centre(VirtualBench(table, positioner).measure, positioner)
    assert (done.trials, done.moves) == (0, 0)
    assert done.reached
    assert done.predicted is None


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"target": 0.0}, "target must be positive"),
        ({"moves": 0}, "at least one move"),
        ({"trials": 3}, "0, 1 or 2"),
        ({"trials": 0}, "must be given"),
        ({"approach": "sideways"}, "from below"),
    ],
)
def test_procedures_that_cannot_be(settings, sentence) -> None:
    made, positioner = bench(0)
    with pytest.raises(ModelError, match=sentence):
        centre(made.measure, positioner, **settings)


def test_stages_and_benches_that_cannot_be() -> None:
    with pytest.raises(ModelError, match="no backlash"):
        VirtualPositioner(PIEZO, backlash=1e-6)
    with pytest.raises(ModelError, match="from -1 to 1"):
        VirtualPositioner(PIEZO, start=(0.0, 1.2))
    with pytest.raises(ModelError, match="must be within"):
        VirtualPositioner(PIEZO).move_to(0.0, 40e-6)
    with pytest.raises(RecordError, match="needs two heads or more"):
        VirtualBench(VirtualTable(radius=0.05), VirtualPositioner(SCREW), method="heads alone")
    with pytest.raises(ModelError, match="trial move"):
        planned_move(unknown_moves((1e-5, 0.0), TINY), VirtualPositioner(SCREW))
    assert nearest_in_box(np.eye(2), np.zeros(2), -np.ones(2), np.ones(2)) == pytest.approx([0, 0])
