"""Identities of the Bouc-Wen family: splitting, inversion, scaling, symmetry, dissipation.

Evidence (Hysteresis and records): split steps (whole step); inverse (input): rounding,
*consistency*
"""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flexstage.base.errors import ModelError
from flexstage.hysteresis import (
    AsymmetricBoucWen,
    BoucWen,
    Dahl,
    GeneralisedBoucWen,
)
from flexstage.hysteresis.model import HysteresisModel, ModelProperty
from flexstage.hysteresis.models.power_law import moved

# A compiled loop is slow the first time.
settings.register_profile("compiled", deadline=None, max_examples=25)
quick = settings.get_profile("compiled")

# Outputs below are of the size 1; those of 120 V are some 70.
ROUNDING = 2e-13

exponents = st.one_of(st.sampled_from([1.0, 2.0]), st.floats(1.0, 6.0))
levels = st.lists(st.floats(-120.0, 120.0), min_size=2, max_size=12).map(np.array)


@st.composite
def bouc_wen(draw: st.DrawFn) -> BoucWen:
    """Draw a dissipative, invertible model, whose h saturates at some volts times the gain."""
    n = draw(exponents)
    saturation = draw(st.floats(2.0, 9.0))
    beta = draw(st.floats(0.2, 1.0))
    gamma = beta * draw(st.floats(-0.45, 1.0))
    A = 0.3
    scale = A / ((beta + gamma) * saturation**n)
    return BoucWen(
        gain=draw(st.floats(1.2, 2.0)),
        hysteresis_gain=A,
        beta=beta * scale,
        gamma=gamma * scale,
        exponent=n,
    )


@st.composite
def asymmetric(draw: st.DrawFn) -> AsymmetricBoucWen:
    plain = draw(bouc_wen())
    return AsymmetricBoucWen(
        **plain.parameters(),  # type: ignore[arg-type]
        quadratic=draw(st.floats(-4e-4, 5e-4)),
        cubic=draw(st.floats(0.0, 2e-6)),
        lowest_input=-121.0,
        highest_input=131.0,
    )


@st.composite
def generalised(draw: st.DrawFn) -> GeneralisedBoucWen:
    n = draw(exponents)
    scale = 4.3 ** (1.0 - n)
    small = st.floats(-0.009, 0.009)
    return GeneralisedBoucWen(
        gain=draw(st.floats(1.2, 2.0)),
        hysteresis_gain=0.3,
        shape=tuple(scale * b for b in (0.06, *draw(st.tuples(*[small] * 5)))),
        centre=draw(st.floats(-50.0, 70.0)),
        exponent=n,
    )


@st.composite
def dahl(draw: st.DrawFn) -> Dahl:
    return Dahl(
        gain=draw(st.floats(1.0, 2.0)),
        stiffness=draw(st.floats(0.01, 0.15)),
        limit=draw(st.floats(1.0, 9.0)),
        exponent=draw(st.one_of(st.just(1.0), st.floats(0.0, 2.5))),
    )


models = st.one_of(bouc_wen(), asymmetric(), generalised(), dahl())


def held(model: HysteresisModel) -> dict[str, bool]:
    return {condition.name: condition.holds for condition in model.properties()}


def loop_area(model: HysteresisModel, u: np.ndarray, y: np.ndarray) -> float:
    """The work of h = d u - y over a closed path of short steps: the integral of h du."""
    h = model.gain * u - y  # type: ignore[attr-defined]
    return float(np.sum((h[1:] + h[:-1]) / 2.0 * np.diff(u)))


# ------------------------------------------------------------------------------- every model


@settings(quick)
@given(models, levels, st.integers(2, 7), st.integers(0, 2**31))
def test_a_step_in_parts_is_the_step(
    model: HysteresisModel, u: np.ndarray, parts: int, seed: int
) -> None:
    whole = model.simulate(u)
    rng = np.random.default_rng(seed)
    cut = np.concatenate([[0.0], u])
    fractions = np.sort(rng.random((u.size, parts)), axis=1)
    fractions[:, -1] = 1.0
    fine = (cut[:-1, None] + np.diff(cut)[:, None] * fractions).ravel()
    fine[parts - 1 :: parts] = u
    # A gap that closes with a root does so in any number of parts, but sensitively.
    slack = 1e5 if isinstance(model, Dahl) and model.exponent < 1.0 else 1.0
    found = model.simulate(fine)
    np.testing.assert_allclose(
        found.values[parts - 1 :: parts], whole.values, atol=slack * ROUNDING, rtol=0.0
    )
    np.testing.assert_allclose(found.state, whole.state, atol=slack * ROUNDING, rtol=0.0)


@settings(quick)
@given(models, levels, st.data())
def test_two_halves_are_the_whole(
    model: HysteresisModel, u: np.ndarray, data: st.DataObject
) -> None:
    at = data.draw(st.integers(1, u.size - 1))
    first = model.simulate(u[:at])
    second = model.simulate(u[at:], first.state)
    whole = model.simulate(u)
    joined = np.concatenate([first.values, second.values])
    np.testing.assert_allclose(joined, whole.values, atol=ROUNDING, rtol=0.0)
    np.testing.assert_allclose(second.state, whole.state, atol=ROUNDING, rtol=0.0)
    assert first.state[0] == u[at - 1]


@settings(quick)
@given(models, levels)
def test_steps_are_the_simulation(model: HysteresisModel, u: np.ndarray) -> None:
    state, out = model.initial_state(), []
    for value in u:
        state, y = model.step(state, float(value))
        out.append(y)
    whole = model.simulate(u)
    np.testing.assert_allclose(out, whole.values, atol=ROUNDING, rtol=0.0)
    np.testing.assert_allclose(state, whole.state, atol=ROUNDING, rtol=0.0)


@settings(quick)
@given(models, levels)
def test_inverse_undoes_the_model(model: HysteresisModel, u: np.ndarray) -> None:
    assert held(model)["invertible"]
    forward = model.simulate(u)
    back = model.inverse(forward.values)
    # The slope of the output is above 0.1 everywhere.
    np.testing.assert_allclose(back.values, u, atol=1e-11, rtol=0.0)
    np.testing.assert_allclose(
        model.simulate(back.values).values, forward.values, atol=1e-12, rtol=0.0
    )
    assert back.state[0] == back.values[-1]


@settings(quick)
@given(models, levels, st.floats(0.02, 60.0), st.floats(1e-7, 30.0))
def test_units_do_not_matter(
    model: HysteresisModel, u: np.ndarray, per_u: float, per_y: float
) -> None:
    """A model in other units of input and output: u = u' per_u, y' = y per_y."""
    old = model.parameters()
    n = float(old["exponent"])  # type: ignore[arg-type]
    slope, psi = per_y * per_u, per_u * per_y ** (1.0 - n)
    factors = {
        "gain": slope,
        "quadratic": slope * per_u,
        "cubic": slope * per_u**2,
        "hysteresis_gain": slope,
        "stiffness": slope,
        "limit": per_y,
        "beta": psi,
        "gamma": psi,
        "exponent": 1.0,
        "centre": 1.0 / per_u,
        "lowest_input": 1.0 / per_u,
        "highest_input": 1.0 / per_u,
    }
    new = {
        name: tuple(psi * b for b in value) if name == "shape" else value * factors[name]  # type: ignore
        for name, value in old.items()
    }
    scaled = type(model)(**new)
    # A path that ends at the centre or where h is zero may take the other branch by one rounding.
    np.testing.assert_allclose(
        scaled.simulate(u / per_u).values / per_y, model.simulate(u).values, atol=1e-11, rtol=0.0
    )


@settings(quick)
@given(st.one_of(bouc_wen(), dahl()), levels)
def test_odd(model: HysteresisModel, u: np.ndarray) -> None:
    np.testing.assert_array_equal(model.simulate(-u).values, -model.simulate(u).values)


@settings(quick)
@given(generalised(), levels)
# a distance that is zero once it is multiplied
@example(
    GeneralisedBoucWen(
        gain=2.0,
        hysteresis_gain=0.3,
        shape=(0.003244997295835587, 0.0, 0.0, 0.0, 0.0, 0.0),
        centre=-5e-324,
        exponent=3.0,
    ),
    np.array([0.0, -1.0]),
)
def test_mirrored_shape(model: GeneralisedBoucWen, u: np.ndarray) -> None:
    """The mirror image has its centre on the other side, and the even parts turned round."""
    signs = (1.0, 1.0, 1.0, -1.0, -1.0, -1.0)
    mirror = dataclasses.replace(
        model,
        centre=-model.centre,
        shape=tuple(s * b for s, b in zip(signs, model.shape, strict=True)),
    )
    np.testing.assert_allclose(
        mirror.simulate(-u).values, -model.simulate(u).values, atol=ROUNDING, rtol=0.0
    )


@settings(quick)
@given(st.one_of(bouc_wen(), generalised(), dahl()), levels)
def test_a_closed_cycle_dissipates(model: HysteresisModel, u: np.ndarray) -> None:
    assert held(model)["dissipative"]
    # Until the cycle closes: the energy that h stores is then the same before and after.
    cycle = np.tile(np.append(u, 0.0), 60)
    state = model.simulate(cycle).state
    corners = np.concatenate([[0.0], u, [0.0]])
    fine = np.interp(
        np.linspace(0.0, u.size + 1.0, 200 * (u.size + 1) + 1), np.arange(u.size + 2), corners
    )
    response = model.simulate(fine, state)
    h, after = state[1], response.state[1]
    stored = abs(after**2 - h**2) / (2.0 * 0.01)
    span = np.ptp(corners)
    error = 1e-4 * span * span * 2.0
    assert loop_area(model, fine, response.values) >= -stored - error


@settings(quick)
@given(models)
def test_from_rest_h_is_bounded(model: HysteresisModel) -> None:
    assert held(model)["bounded"]
    u = np.array([3e3, -4e3, 5e4, -1e5])
    y = model.simulate(u).values
    if isinstance(model, AsymmetricBoucWen):
        y = y - model.quadratic * u**2 - model.cubic * u**3
    h = np.abs(model.gain * u - y)  # type: ignore[attr-defined]
    # Saturated: in the units of the strategies, at no more than this.
    assert np.all(h < 30.0)


# -------------------------------------------------------------------------------- closed form


@settings(quick)
@given(
    st.one_of(
        bouc_wen().map(lambda m: dataclasses.replace(m, exponent=1.0)),
        generalised().map(lambda m: dataclasses.replace(m, exponent=1.0)),
        dahl().map(lambda m: dataclasses.replace(m, exponent=1.0)),
    ),
    levels,
    st.floats(0.0, 1.0),
)
def test_segments_are_the_output_between_samples(
    model: HysteresisModel, u: np.ndarray, fraction: float
) -> None:
    pieces = model.segments(u)
    assert pieces is not None
    assert pieces.start[0] == 0.0
    assert np.all(np.diff(pieces.start) >= 0.0)
    assert pieces.samples == u.size
    places = np.arange(u.size - 1) + fraction
    of = np.searchsorted(pieces.start, places, side="right") - 1
    since = places - pieces.start[of]
    values = (
        pieces.constant[of]
        + pieces.slope[of] * since
        + pieces.amplitude[of] * np.exp(-pieces.rate[of] * since)
    )
    fine = np.empty(2 * u.size - 1)
    fine[::2] = u
    fine[1::2] = u[:-1] + np.diff(u) * fraction
    response = model.simulate(fine)
    # A piece of a rate x keeps 1e-16/x of what h moves in it, and x is at least 1e-5.
    tolerance = 1e-11 + 3e-11 * np.ptp(u)
    np.testing.assert_allclose(values, response.values[1::2], atol=tolerance, rtol=0.0)
    np.testing.assert_allclose(pieces.state, response.state, atol=ROUNDING, rtol=0.0)


@pytest.mark.parametrize("gamma", [0.03, 0.05 - 1e-6, 0.05 - 1e-8, 0.05, 0.07])
def test_segments_of_short_and_long_steps(gamma: float) -> None:
    """A rate of unloading near zero, steps from 1e-6 to 40."""
    model = BoucWen(gain=1.3, hysteresis_gain=0.3, beta=0.05, gamma=gamma)
    u = np.array([39.0, 38.9999, 38.999999, 37.0, 36.99, 12.0, 52.0])
    pieces = model.segments(u)
    assert pieces is not None
    for at, rate in zip(pieces.start[:-1], pieces.rate[:-1], strict=True):
        assert rate == 0.0 or abs(rate) >= 1e-5, at
    places = np.arange(6) + 0.37
    of = np.searchsorted(pieces.start, places, side="right") - 1
    since = places - pieces.start[of]
    smooth = pieces.amplitude[of] * np.exp(-pieces.rate[of] * since)
    fine = np.insert(u, np.arange(1, 7), u[:-1] + 0.37 * np.diff(u))
    expected = model.simulate(fine).values[1::2]
    found = pieces.constant[of] + pieces.slope[of] * since + smooth
    # The limit, hysteresis_gain over the rate of unloading, is what is rounded.
    tolerance = 1e-13 if abs(gamma - 0.05) > 0.01 else 3e-11
    np.testing.assert_allclose(found, expected, atol=tolerance, rtol=0.0)


def test_segments_need_exponent_one_and_two_samples() -> None:
    model = BoucWen(gain=1.3, hysteresis_gain=0.3, beta=0.05, gamma=0.03)
    assert dataclasses.replace(model, exponent=1.4).segments([1.0, 2.0]) is None
    with pytest.raises(ModelError, match="at least two"):
        model.segments([1.0])


@settings(quick)
@given(dahl(), levels)
def test_dahl_with_exponent_one_is_bouc_wen(model: Dahl, u: np.ndarray) -> None:
    model = dataclasses.replace(model, exponent=1.0)
    same = BoucWen(
        gain=model.gain,
        hysteresis_gain=model.stiffness,
        beta=model.stiffness / model.limit,
        gamma=0.0,
    )
    np.testing.assert_allclose(
        model.simulate(u).values, same.simulate(u).values, atol=ROUNDING, rtol=0.0
    )
    near = dataclasses.replace(model, exponent=1.0 + 1e-13)
    np.testing.assert_allclose(
        near.simulate(u).values, same.simulate(u).values, atol=1e-10, rtol=0.0
    )


@settings(quick)
@given(bouc_wen(), levels, st.floats(-60.0, 60.0))
def test_generalised_with_one_shape_number_is_bouc_wen(
    model: BoucWen, u: np.ndarray, centre: float
) -> None:
    plain = dataclasses.replace(model, gamma=0.0)
    same = GeneralisedBoucWen(
        gain=plain.gain,
        hysteresis_gain=plain.hysteresis_gain,
        shape=(plain.beta, 0.0, 0.0, 0.0, 0.0, 0.0),
        centre=centre,
        exponent=plain.exponent,
    )
    np.testing.assert_allclose(
        same.simulate(u).values, plain.simulate(u).values, atol=ROUNDING, rtol=0.0
    )
    assert held(same) == held(plain)


# ---------------------------------------------------------------------------------- power law


@settings(quick)
@given(
    st.floats(1.0, 9.0),
    st.sampled_from([-1.0, 1.0]),
    st.floats(-9.0, 9.0),
    st.floats(-7.0, 0.6),
    st.floats(0.05, 0.95),
)
def test_a_motion_in_parts_and_back(
    n: float, sigma: float, log_z: float, log_tau: float, share: float
) -> None:
    x, tau = math.exp(log_z / n), 10.0**log_tau
    whole = moved(x, tau, 1.0, sigma, sigma, n)
    if not math.isfinite(whole) or whole > 1e3 * max(x, 1.0):
        return
    first = moved(x, share * tau, 1.0, sigma, sigma, n)
    second = moved(first, (1.0 - share) * tau, 1.0, sigma, sigma, n)
    # Growth magnifies what is lost by rounding, by at most the ratio of the slopes.
    grows = max(1.0, (1.0 - sigma * whole**n) / (1.0 - sigma * x**n)) if sigma < 0.0 else 1.0
    assert second == pytest.approx(whole, rel=2e-14 * grows)
    if sigma < 0.0:
        assert -moved(-whole, tau, 1.0, sigma, sigma, n) == pytest.approx(x, rel=1e-13 * grows)


@pytest.mark.parametrize("n", [1.2, 1.7, 2.0, 3.3, 9.0])
def test_a_motion_runs_away_within_a_known_distance(n: float) -> None:
    # the integral of 1/(1 + x^n) from zero to infinity
    reach = math.pi / n / math.sin(math.pi / n)
    assert moved(0.0, reach * (1.0 + 1e-12), 1.0, -1.0, -1.0, n) == math.inf
    assert moved(0.0, 1e300, 1.0, -1.0, -1.0, n) == math.inf
    # of what is left of the distance, x^(1 - n)/(n - 1) at large x
    near = moved(0.0, reach * (1.0 - 1e-9), 1.0, -1.0, -1.0, n)
    assert near ** (1.0 - n) / (n - 1.0) == pytest.approx(1e-9 * reach, rel=1e-5)
    # unloading from beyond where the two terms balance runs away as well, and at it stays
    assert moved(-1.001, 1e300, 1.0, 1.0, 1.0, n) == -math.inf
    assert moved(-1.0, 1e300, 1.0, 1.0, 1.0, n) == -1.0 or n == 2.0


def test_saturation_is_kept() -> None:
    """At saturation, one unit above it and far below it, and after any distance."""
    for n in (1.0, 1.0 + 1e-9, 1.3, 2.0, 3.0, 40.0):
        for start in (0.0, 0.7, 1.0, math.nextafter(1.0, 2.0), 1.7, 40.0):
            for distance in (60.0, 1e9, 1e300):
                found = moved(start, distance, 1.0, 1.0, 1.0, n)
                assert found == pytest.approx(1.0, abs=3e-16), (n, start, distance)


# --------------------------------------------------------------------------- what is refused


def test_a_model_that_runs_away_is_refused() -> None:
    for n in (1.0, 1.4, 2.0):
        model = BoucWen(gain=1.3, hysteresis_gain=0.3, beta=0.01, gamma=-0.03, exponent=n)
        assert not held(model)["bounded"]
        assert not held(model)["dissipative"]
        with pytest.raises(ModelError, match="grew without limit"):
            model.simulate([2.0, 1e6])
        with pytest.raises(ModelError, match="beta \\+ gamma"):
            model.inverse([2.0])


def test_bounded_classes() -> None:
    """Class II: h stays bounded from rest, with gamma above beta; it does not dissipate always."""
    model = BoucWen(gain=1.3, hysteresis_gain=0.3, beta=0.02, gamma=0.05)
    assert held(model) == {"bounded": True, "dissipative": False, "invertible": True}
    y = model.simulate(np.array([500.0, -700.0, 900.0]))
    assert abs(y.state[1]) == pytest.approx(0.3 / 0.07, rel=1e-12)
    assert not held(dataclasses.replace(model, beta=-0.01))["bounded"]


def test_inverse_stops_where_the_output_falls() -> None:
    # dh/du after a reversal from saturation is 0.48: above the gain.
    model = BoucWen(gain=0.45, hysteresis_gain=0.4, beta=0.06, gamma=0.04)
    invertible = model.properties()[2]
    assert isinstance(invertible, ModelProperty)
    assert not invertible.holds
    assert "0.48" in invertible.detail
    # (beta - gamma) |h| reaches 0.05 at h = 2.5.
    gentle = np.array([4.0, 7.0, -3.0])
    y = model.simulate(gentle).values
    np.testing.assert_allclose(model.inverse(y).values, gentle, atol=1e-12, rtol=0.0)
    y = model.simulate([4.0, 40.0, 38.0]).values
    assert y[2] > y[1]
    with pytest.raises(ModelError, match="sample 2"):
        model.inverse(y)


def test_asymmetric_inverse_stays_in_its_range() -> None:
    model = AsymmetricBoucWen(
        gain=1.3,
        quadratic=2e-3,
        cubic=-1e-5,
        hysteresis_gain=0.3,
        beta=0.05,
        gamma=0.03,
        lowest_input=-20.0,
        highest_input=130.0,
    )
    # The slope of the cubic is least at an end: 1.3 - 0.08 - 0.012 and 1.3 + 0.52 - 0.507.
    assert "1.208 and" in model.properties()[2].detail
    top = model.simulate([130.0]).values[0]
    assert model.inverse([top]).values[0] == pytest.approx(130.0, abs=1e-11)
    with pytest.raises(ModelError, match="no input from the lowest_input"):
        model.inverse([top * (1 + 1e-9)])
    with pytest.raises(ModelError, match="only from an input"):
        model.inverse([1.0], [131.0, 0.0])
    steep = dataclasses.replace(model, cubic=-3e-5)
    assert not held(steep)["invertible"]
    with pytest.raises(ModelError, match="sample 0"):
        steep.inverse([1.0])


def test_least_slope_inside_the_range() -> None:
    model = AsymmetricBoucWen(
        gain=1.3,
        quadratic=-6e-3,
        cubic=4e-5,
        hysteresis_gain=0.3,
        beta=0.05,
        gamma=0.03,
        lowest_input=-20.0,
        highest_input=130.0,
    )
    # At u = 50: 1.3 - 0.6 + 0.3.
    assert "1 and" in model.properties()[2].detail


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hysteresis_gain": 0.0}, "positive and finite"),
        ({"exponent": 0.7}, "at least 1"),
        ({"beta": math.nan}, "finite"),
    ],
)
def test_impossible_parameters_are_refused(change: dict[str, float], message: str) -> None:
    good = {"gain": 1.3, "hysteresis_gain": 0.3, "beta": 0.05, "gamma": 0.03}
    with pytest.raises(ModelError, match=message):
        BoucWen(**{**good, **change})
    with pytest.raises(ModelError, match=message):
        AsymmetricBoucWen(
            **{**good, **change}, quadratic=0.0, cubic=0.0, lowest_input=-1.0, highest_input=2.0
        )


def test_other_impossible_parameters_are_refused() -> None:
    with pytest.raises(ModelError, match="six numbers"):
        GeneralisedBoucWen(gain=1.3, hysteresis_gain=0.3, shape=(0.1, 0.2))
    with pytest.raises(ModelError, match="shape number 2"):
        GeneralisedBoucWen(gain=1.3, hysteresis_gain=0.3, shape=(0.1, math.inf, 0, 0, 0, 0))
    with pytest.raises(ModelError, match="limit of Dahl"):
        Dahl(gain=1.3, stiffness=0.3, limit=0.0)
    with pytest.raises(ModelError, match="at least 0"):
        Dahl(gain=1.3, stiffness=0.3, limit=1.0, exponent=-0.1)
    with pytest.raises(ModelError, match="lowest_input"):
        AsymmetricBoucWen(
            gain=1.3,
            quadratic=0.0,
            cubic=0.0,
            hysteresis_gain=0.3,
            beta=0.05,
            gamma=0.03,
            lowest_input=3.0,
            highest_input=2.0,
        )
    model = Dahl(gain=0.35, stiffness=0.3, limit=1.0)
    assert not held(model)["invertible"]
    with pytest.raises(ModelError, match="Dahl cannot be inverted at sample 1"):
        model.inverse([0.3, 0.1])
