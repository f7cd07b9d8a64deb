"""Models made of plays, and the Duhem model, against hand, relays, sliders and an integrator.

Evidence (Hysteresis and records): play models (single elements): rounding; Duhem (integrator):
$10^{-12}$ of the stroke
"""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from flexstage.base.errors import ModelError
from flexstage.hysteresis import (
    Duhem,
    GeneralisedMaxwellSlip,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
)
from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.models.play_sum import dead_zone_line, dead_zones, play_columns
from flexstage.hysteresis.models.preisach.law import Preisach, preisach_columns

STROKE = 60e-6


def drive(seed: int, count: int, low: float = -13.0, high: float = 127.0) -> np.ndarray:
    """Turning points with straight lines between them, with some samples that stand still."""
    rng = np.random.default_rng(seed)
    turns = rng.uniform(low, high, size=count)
    lines = [np.linspace(a, b, rng.integers(2, 9)) for a, b in itertools.pairwise(turns)]
    return np.concatenate(lines)


def prandtl() -> PrandtlIshlinskii:
    return PrandtlIshlinskii(
        gain=0.31e-6,
        thresholds=np.array([1.3, 4.1, 9.7, 22.0]),
        weights=np.array([0.06e-6, 0.04e-6, 0.07e-6, 0.03e-6]),
    )


def modified() -> ModifiedPrandtlIshlinskii:
    plays = prandtl()
    return ModifiedPrandtlIshlinskii(
        gain=plays.gain,
        thresholds=plays.thresholds,
        weights=plays.weights,
        dead_zones=np.array([-3e-6, 11e-6, 29e-6]),
        dead_zone_weights=np.array([0.25, -0.15, -0.3]),
    )


def maxwell() -> GeneralisedMaxwellSlip:
    return GeneralisedMaxwellSlip(
        stiffness=1.6e6,
        thresholds=np.array([0.7e-6, 2.9e-6, 8.1e-6]),
        element_stiffness=np.array([0.5e6, 0.35e6, 0.2e6]),
        dead_zones=np.array([-4e-6, 17e-6, 33e-6]),
        dead_zone_weights=np.array([0.4e6, -0.3e6, 0.25e6]),
    )


def preisach(seed: int = 5, count: int = 6) -> Preisach:
    rng = np.random.default_rng(seed)
    return Preisach(
        thresholds=np.concatenate([[0.0], np.sort(rng.uniform(0.5, 45.0, count - 1))]),
        knots=np.array([-9.0, 3.0, 31.0, 64.0, 101.0, 119.0]),
        slopes=rng.uniform(0.0, 0.09e-6, size=(count, 5)),
        gain=0.13e-6,
    )


def duhem() -> Duhem:
    return Duhem(
        rate=0.043,
        anhysteretic=np.array([1.1e-6, 0.47e-6, 0.9e-9, -4e-12]),
        tangent=np.array([0.34e-6, 0.3e-9]),
        input_range=(-13.0, 127.0),
    )


# ------------------------------------------------------------------------------------- plays


def test_play_by_hand() -> None:
    u = [3.0, 1.0, -4.0, -4.0, 2.5]
    plays = play_columns(u, [0.5, 2.0])
    assert plays == pytest.approx(np.array([[2.5, 1], [1.5, 1], [-3.5, -2], [-3.5, -2], [2, 0.5]]))


def test_prandtl_ishlinskii_loop_by_hand() -> None:
    """Up from rest, each play starts at its threshold; down from 50, at twice that."""
    model = PrandtlIshlinskii(
        gain=0.3e-6, thresholds=np.array([4.0, 10.0]), weights=np.array([0.1e-6, 0.2e-6])
    )
    y = model.simulate([3.0, 7.0, 50.0, 45.0, 36.0, 20.0, 50.0]).values * 1e6
    first = [0.9, 2.1 + 0.3, 15.0 + 4.6 + 8.0]
    down = [27.6 - 1.5, 27.6 - 0.3 * 14 - 0.1 * 6, 27.6 - 0.3 * 30 - 0.1 * 22 - 0.2 * 10]
    assert y == pytest.approx([*first, *down, 27.6], rel=1e-14)


def test_pieces_of_a_loop_by_hand() -> None:
    """Down from 50 by 40 in two steps, then nothing, then up by 25; thresholds 4 and 10."""
    model = PrandtlIshlinskii(gain=3.0, thresholds=[4.0, 10.0], weights=[1.0, 2.0])
    s = model.segments([50.0, 30.0, 10.0, 10.0, 35.0])
    assert s.start == pytest.approx([0.0, 0.4, 1.0, 2.0, 3.0, 3.32, 3.8])
    assert s.slope == pytest.approx([-60, -80, -120, 0, 75, 100, 150])
    assert s.constant == pytest.approx([276, 252, 204, 84, 84, 108, 156])
    assert np.all(s.amplitude == 0.0)


def test_energy_of_a_cycle_is_that_of_the_plays() -> None:
    """Once around between a and b, a play with threshold r takes in 2 r w (b - a - 2 r)."""
    model = prandtl()
    a, b = -7.0, 61.0
    u = np.concatenate([np.linspace(a, b, 4001), np.linspace(b, a, 4001)[1:]])
    y = model.simulate(u, model.simulate([b, a]).state).values
    work = np.sum(0.5 * (u[1:] + u[:-1]) * np.diff(y))
    r = model.thresholds
    swing = np.maximum(b - a - 2.0 * r, 0.0)
    assert work == pytest.approx(np.sum(2.0 * r * model.weights * swing), rel=1e-5)


def test_prandtl_ishlinskii_inverse_is_a_sum_of_plays_of_the_output() -> None:
    model = prandtl()
    y = STROKE * drive(3, 40) / 127.0
    gain, thresholds, weights = model.inverse_plays()
    closed = gain * y + play_columns(y, thresholds) @ weights
    assert model.inverse(y).values == pytest.approx(closed, abs=1e-12)


def test_maxwell_slip_without_bend_is_a_prandtl_ishlinskii_model() -> None:
    plays = prandtl()
    gain, thresholds, weights = plays.inverse_plays()
    same = GeneralisedMaxwellSlip(
        stiffness=gain + np.sum(weights), thresholds=thresholds, element_stiffness=-weights
    )
    u = drive(4, 60)
    assert same.simulate(u).values == pytest.approx(plays.simulate(u).values, abs=1e-19)


# ---------------------------------------------------------------------------------- Preisach


def relays(model: Preisach, u: np.ndarray, per_interval: int) -> np.ndarray:
    """A Preisach model of relays: each a switch with two thresholds, and nothing else."""
    share = (np.arange(per_interval) + 0.5) / per_interval
    width = np.diff(model.knots)
    means = (model.knots[:-1, None] + width[:, None] * share).ravel()
    weight = np.repeat(model.slopes * width / per_interval, per_interval, axis=1)
    up = means[None, :] + model.thresholds[:, None]
    down = means[None, :] - model.thresholds[:, None]
    on = np.broadcast_to(means < 0.0, up.shape).copy()
    at_rest = on.copy()
    out = np.empty(u.size)
    for n, x in enumerate(u):
        on = np.where(x >= up, True, np.where(x <= down, False, on))
        out[n] = model.gain * x + np.sum(weight * on) - np.sum(weight * at_rest)
    return out


def test_preisach_is_the_limit_of_relays() -> None:
    """A play is at most half a relay's width from the count of relays that are on."""
    model = preisach()
    # Relays end at the outermost knots, where the model goes on.
    u = drive(6, 70, model.knots[0], model.knots[-1])
    y = model.simulate(u).values
    errors = []
    for count in (25, 400):
        bound = np.sum(np.max(model.slopes * np.diff(model.knots) / count, axis=1))
        errors.append(np.max(np.abs(relays(model, u, count) - y)))
        assert errors[-1] <= 0.51 * bound + 1e-19
    assert errors[1] < 0.1 * errors[0]


def test_preisach_columns_are_the_model() -> None:
    model = preisach()
    u = drive(7, 50)
    columns = preisach_columns(u, model.thresholds, model.knots)
    linear = model.gain * u + columns @ model.slopes.ravel()
    assert model.simulate(u).values == pytest.approx(linear, abs=1e-19)


def test_preisach_goes_on_with_its_outermost_slopes() -> None:
    model = Preisach(
        thresholds=np.array([0.0]), knots=np.array([2.0, 5.0, 11.0]), slopes=np.array([[0.3, 0.7]])
    )
    u = [-4.0, 3.0, 6.0, 20.0]
    by_hand = pytest.approx([-1.2, 0.9, 1.5 + 0.7, 1.5 + 10.5])
    assert model.simulate(u).values == by_hand
    assert preisach_columns(u, model.thresholds, model.knots) @ model.slopes.ravel() == by_hand


def test_preisach_with_one_straight_function_each_is_prandtl_ishlinskii() -> None:
    plays = prandtl()
    knots = np.array([-20.0, 7.0, 130.0])
    slopes = np.repeat(plays.weights[:, None], 2, axis=1)
    same = Preisach(gain=plays.gain, thresholds=plays.thresholds, knots=knots, slopes=slopes)
    u = drive(9, 50)
    assert same.simulate(u).values == pytest.approx(plays.simulate(u).values, abs=1e-19)


def test_preisach_inverse_passes_over_what_stands_still() -> None:
    """Without gain the output stands still after a reversal; past that, the inverse is exact."""
    model = Preisach(
        thresholds=np.array([3.0]), knots=np.array([0.0, 50.0, 60.0]), slopes=np.array([[0.5, 0.0]])
    )
    found = model.inverse([10.0, 10.0, 6.0])
    assert found.values == pytest.approx([23.0, 23.0, 9.0])
    assert model.simulate(found.values).values == pytest.approx([10.0, 10.0, 6.0])
    with pytest.raises(ModelError, match="requested at sample 1"):
        model.inverse([20.0, 25.5])


# --------------------------------------------------------------------- S and its dead zones


def test_dead_zones_are_what_their_formula_says() -> None:
    model = modified()
    x = np.linspace(-9e-6, 45e-6, 101)
    by_formula = x.copy()
    for d, w in zip(model.dead_zones, model.dead_zone_weights, strict=True):
        by_formula += w * (np.maximum(x - d, 0.0) if d > 0 else np.minimum(x - d, 0.0))
    assert model.line().at(x) == pytest.approx(by_formula, abs=1e-19)
    assert model.line().inverse().at(by_formula) == pytest.approx(x, abs=1e-19)
    two_below = dead_zone_line(0.7, *dead_zones([-5.0, -2.0, 4.0, 6.0], [0.3, -0.4, 0.5, 0.2]))
    assert two_below.at([-7.0, -3.0, 5.0, 8.0]) == pytest.approx(
        [-4.9 - 0.6 + 2.0, -2.1 + 0.4, 3.5 + 0.5, 5.6 + 2.0 + 0.4]
    )


def test_modified_model_is_its_plays_and_then_s() -> None:
    model, plays = modified(), prandtl()
    u = drive(10, 50)
    inner = play_columns(u, plays.thresholds) @ plays.weights + plays.gain * u
    by_formula = inner.copy()
    for d, w in zip(model.dead_zones, model.dead_zone_weights, strict=True):
        by_formula += w * (np.maximum(inner - d, 0.0) if d > 0 else np.minimum(inner - d, 0.0))
    assert model.simulate(u).values == pytest.approx(by_formula, abs=1e-19)


# ------------------------------------------------------------------------------- Maxwell-slip


def test_maxwell_slip_against_sliders_that_a_root_finder_balances() -> None:
    model = maxwell()
    bound = model.element_stiffness * model.thresholds
    forces, y = np.zeros(3), 0.0

    def sliders(to: float) -> np.ndarray:
        return np.clip(forces + model.element_stiffness * (to - y), -bound, bound)

    def voltage(to: float) -> float:
        bend = sum(
            w * (max(to - d, 0.0) if d > 0 else min(to - d, 0.0))
            for d, w in zip(model.dead_zones, model.dead_zone_weights, strict=True)
        )
        return model.stiffness * to + bend + np.sum(sliders(to))

    u = drive(11, 40)
    out = model.simulate(u).values
    for x, simulated in zip(u, out, strict=True):
        reached = brentq(lambda to, x=x: voltage(to) - x, -1e-3, 1e-3, xtol=1e-20, rtol=1e-14)
        forces, y = sliders(reached), reached
        assert simulated == pytest.approx(y, abs=1e-18)


# -------------------------------------------------------------------------------------- Duhem


def integrated(model: Duhem, u: np.ndarray) -> np.ndarray:
    """The differential equation, from one turning point to the next."""
    f = np.polynomial.Polynomial(model.anhysteretic)
    g = np.polynomial.Polynomial(model.tangent)
    out, last, y = [], 0.0, 0.0
    for x in u:
        if x != last:
            sign = np.sign(x - last)

            def slope(at: float, y: np.ndarray, sign: float = sign) -> np.ndarray:
                return sign * model.rate * (f(at) * 1e6 - y) + g(at) * 1e6

            run = solve_ivp(slope, (last, x), [y * 1e6], method="DOP853", rtol=1e-13, atol=1e-13)
            y = run.y[0, -1] * 1e-6
        out.append(y)
        last = x
    return np.array(out)


def test_duhem_against_an_integrator() -> None:
    model = duhem()
    u = drive(12, 12)
    error = model.simulate(u).values - integrated(model, u)
    assert np.max(np.abs(error)) < 1e-12 * STROKE


@pytest.mark.parametrize("rate", [1e-9, 2e-4, 0.0083, 0.0084, 0.3, 40.0])
def test_duhem_is_exact_at_any_rate(rate: float) -> None:
    """The closed form of a particular solution and an exponential, with 40 digits."""
    mpmath = pytest.importorskip("mpmath")
    model = Duhem(
        rate=rate,
        anhysteretic=duhem().anhysteretic,
        tangent=np.array([0.34e-6, 0.3e-9, -2e-12, 1e-14]),
        input_range=(-13.0, 127.0),
    )
    path = [120.0, 1.0, -11.0, 77.0]
    with mpmath.workdps(60):
        u, y, alpha = mpmath.mpf(0), mpmath.mpf(0), mpmath.mpf(rate)
        f = [mpmath.mpf(c) for c in model.anhysteretic]
        g = [mpmath.mpf(c) for c in model.tangent]
        for x in path:
            s = 1 if x > u else -1
            right = [s * alpha * a + b for a, b in zip(f, g, strict=True)]
            particular = [mpmath.mpf(0)] * 5
            for k in range(3, -1, -1):
                particular[k] = (right[k] - (k + 1) * particular[k + 1]) / (s * alpha)
            at = [mpmath.polyval(particular[::-1], z) for z in (u, mpmath.mpf(x))]
            y = at[1] + (y - at[0]) * mpmath.exp(-alpha * abs(x - u))
            u = mpmath.mpf(x)
        exact = float(y)
    assert model.simulate(path).values[-1] == pytest.approx(exact, abs=1e-14 * STROKE)


def test_duhem_accommodates() -> None:
    """A repeated minor loop comes nearer to a limit cycle by the same factor each time."""
    model = duhem()
    a, b = 40.0, 55.0
    tops = model.simulate([110.0, *([a, b] * 4)]).values[2::2]
    steps = np.diff(tops)
    assert steps[1:] / steps[:-1] == pytest.approx(np.exp(-2 * model.rate * (b - a)), rel=1e-9)
    assert abs(steps[0]) > 1e-3 * STROKE


@pytest.mark.parametrize(("low", "high"), [(-60.0, 60.0), (-100.0, 20.0), (-20.0, 100.0)])
def test_duhem_slope_is_least_after_the_second_turn_from_rest(low: float, high: float) -> None:
    """With f' = a, g = b, w = y - f: w tends to -(a - b)/rate upwards, and plus that downwards."""
    a, b, rate, span = 0.5e-6, 0.31e-6, 0.02, high - low
    model = Duhem(
        rate=rate,
        anhysteretic=np.array([0.0, a]),
        tangent=np.array([b]),
        input_range=(low, high),
    )
    # From rest to one end w goes part of the way, and nearly all of it to the other end.
    ends = np.array([high, -low])
    farthest = np.max(1.0 - (2.0 - np.exp(-rate * ends)) * np.exp(-rate * span))
    # The limit cycle has w = tanh(rate span / 2) at the ends, which is less.
    assert farthest > np.tanh(rate * span / 2)
    least = b - (a - b) * farthest
    assert model._extremes()[0] == pytest.approx(least, rel=1e-12, abs=0.0)
    assert [c.holds for c in model.properties()] == [True, True, True]


# ------------------------------------------------------------------- conditions and refusals


def holds(model: HysteresisModel) -> dict[str, bool]:
    return {c.name: c.holds for c in model.properties()}


def test_conditions_of_good_models_hold() -> None:
    for model in (prandtl(), modified(), maxwell(), preisach(), duhem()):
        assert holds(model) == {"bounded": True, "dissipative": True, "invertible": True}


def test_conditions_find_what_does_not_hold() -> None:
    r = np.array([2.0, 5.0])
    negative = PrandtlIshlinskii(gain=0.4, thresholds=r, weights=np.array([0.3, -0.1]))
    assert holds(negative) == {"bounded": True, "dissipative": False, "invertible": True}
    falling = PrandtlIshlinskii(gain=0.4, thresholds=r, weights=np.array([-0.5, 0.3]))
    assert not holds(falling)["invertible"]
    with pytest.raises(ModelError, match="no inverse"):
        falling.inverse([0.1])
    with pytest.raises(ModelError, match="positive gain"):
        falling.inverse_plays()
    folded = ModifiedPrandtlIshlinskii(
        gain=0.4,
        thresholds=r,
        weights=np.array([0.3, 0.1]),
        dead_zones=np.array([2.0]),
        dead_zone_weights=np.array([-1.5]),
    )
    assert holds(folded) == {"bounded": True, "dissipative": False, "invertible": False}
    with pytest.raises(ModelError, match="slopes are positive"):
        folded.inverse([0.1])
    slider = GeneralisedMaxwellSlip(
        stiffness=1.0, thresholds=r, element_stiffness=np.array([0.4, -0.2])
    )
    assert not holds(slider)["dissipative"]
    steep = Duhem(
        rate=0.2,
        anhysteretic=np.array([0.0, 0.5]),
        tangent=np.array([0.2]),
        input_range=(0.0, 100.0),
    )
    assert holds(steep) == {"bounded": True, "dissipative": True, "invertible": False}
    with pytest.raises(ModelError, match="no inverse"):
        steep.inverse([0.1])
    clockwise = Duhem(
        rate=0.02,
        anhysteretic=np.array([0.0, 0.5]),
        tangent=np.array([0.6]),
        input_range=(0.0, 100.0),
    )
    assert not holds(clockwise)["dissipative"]
    # The curve is as steep as the tangent at zero, and gets steeper faster than memory fades.
    bent = Duhem(
        rate=0.02,
        anhysteretic=np.array([0.0, 0.5, 0.01]),
        tangent=np.array([0.5]),
        input_range=(0.0, 100.0),
    )
    assert not holds(bent)["dissipative"]


def test_preisach_that_is_only_a_play_has_no_unique_inverse() -> None:
    knots, slopes = np.array([0.0, 9.0]), np.array([[0.5], [0.3]])
    model = Preisach(thresholds=np.array([1.0, 2.0]), knots=knots, slopes=slopes)
    assert not holds(model)["invertible"]
    at_zero = Preisach(thresholds=np.array([0.0, 2.0]), knots=knots, slopes=slopes)
    assert holds(at_zero)["invertible"]


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: PrandtlIshlinskii(gain=1, thresholds=[0.0, 1], weights=[1, 1]), "more than 0"),
        (lambda: PrandtlIshlinskii(gain=1, thresholds=[2.0, 1], weights=[1, 1]), "must rise"),
        (lambda: PrandtlIshlinskii(gain=1, thresholds=[1.0, 2], weights=[1]), "shape"),
        (lambda: PrandtlIshlinskii(gain=np.nan, thresholds=[1.0], weights=[1]), "gain must be"),
        (lambda: PrandtlIshlinskii(gain=1, thresholds=[], weights=[]), "at least 1"),
        (lambda: Preisach(thresholds=[-1.0], knots=[0, 1], slopes=[[1]]), "at least 0"),
        (lambda: Preisach(thresholds=[1.0], knots=[0], slopes=[[]]), "at least 2"),
        (lambda: Preisach(thresholds=[1.0], knots=[0, 1, 2], slopes=[[1]]), "shape"),
        (lambda: Preisach(thresholds=[1.0], knots=[0, 1], slopes=[[np.inf]]), "finite"),
        (lambda: dead_zones([0.0], [1.0]), "not zero"),
        (
            lambda: GeneralisedMaxwellSlip(
                stiffness=-0.1, thresholds=[1.0], element_stiffness=[1.0]
            ),
            "must rise with",
        ),
        (
            lambda: Duhem(rate=0, anhysteretic=[1], tangent=[1], input_range=(0, 1)),
            "rate must be",
        ),
        (
            lambda: Duhem(rate=1, anhysteretic=[1] * 5, tangent=[1], input_range=(0, 1)),
            "one to four",
        ),
        (
            lambda: Duhem(rate=1, anhysteretic=[1], tangent=[1], input_range=(1, 2)),
            "hold zero",
        ),
    ],
)
def test_impossible_parameters_are_refused(make, says: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ModelError, match=says):
        make()


def test_states_that_no_input_leads_to_are_refused() -> None:
    model = prandtl()
    with pytest.raises(ModelError, match="no input leads"):
        model.simulate([1.0], [0.0, 0.0, 6.0, 0.0, 0.0])
    with pytest.raises(ModelError, match="finite numbers"):
        model.simulate([1.0], [0.0, 0.0])
    slider = maxwell()
    state = slider.simulate([40.0]).state
    state[0] += 1.0
    with pytest.raises(ModelError, match="no voltage leads"):
        slider.simulate([1.0], state)


def test_duhem_inverse_keeps_to_its_range() -> None:
    model = duhem()
    top = model.simulate([127.0]).values
    assert model.inverse(top).values == pytest.approx([127.0], rel=1e-13)
    # Cycles from end to end reach the ends, though outputs are rounded.
    u = np.tile([127.0, 61.0, 127.0, -13.0, 7.0, -13.0], 9)
    assert model.inverse(model.simulate(u).values).values == pytest.approx(u, abs=1e-11)
    with pytest.raises(ModelError, match="widen it"):
        model.inverse(top * 1.001)


def test_curved_duhem_has_no_pieces_and_one_sample_has_none() -> None:
    assert duhem().segments([0.0, 1.0]) is None
    with pytest.raises(ModelError, match="at least two"):
        prandtl().segments([1.0])


@pytest.mark.parametrize("seed", range(8))
def test_sliders_take_up_their_own_state_at_no_voltage(seed: int) -> None:
    # small voltages leave small displacements, whose rounding is that of the thresholds
    rng = np.random.default_rng(seed)
    for _ in range(5):
        m = int(rng.integers(1, 9))
        model = GeneralisedMaxwellSlip(
            stiffness=rng.uniform(0.8e6, 2.3e6),
            thresholds=np.cumsum(rng.uniform(0.1e-6, 6e-6, m)),
            element_stiffness=rng.uniform(0.05e6, 0.6e6, m),
        )
        u = [*rng.uniform(0.0, 2.0, 30), 0.0, 1e-3]
        state, found = None, []
        for voltage in u:
            response = model.simulate([voltage], state)
            state = response.state
            found.append(response.values[0])
        assert found == pytest.approx(model.simulate(u).values, rel=1e-9, abs=1e-20)
