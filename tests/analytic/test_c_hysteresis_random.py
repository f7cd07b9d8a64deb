"""Hysteresis in C with parameters drawn at random, stable or not, bit for bit as in Python."""

from collections.abc import Callable

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.hysteresis import (
    AsymmetricBoucWen,
    BoucWen,
    Dahl,
    Duhem,
    GeneralisedBoucWen,
    GeneralisedMaxwellSlip,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    Preisach,
)
from flexstage.hysteresis.model import HysteresisModel
from tests.c_hysteresis import Array, Compiled, table, walk

Random = np.random.Generator


def exponent(rng: Random) -> float:
    return float(rng.choice([1.0, 2.0, 1.0 + 10.0 ** rng.uniform(-6.0, 0.8)]))


def law(rng: Random, n: float, count: int) -> list[float]:
    return (rng.normal(size=count) * 0.05 * 5e-6 ** (1.0 - n)).tolist()


def bouc_wen(rng: Random) -> HysteresisModel:
    n = exponent(rng)
    beta, gamma = law(rng, n, 2)
    gain, A = rng.normal() * 1e-6, 10.0 ** rng.uniform(-8.0, -6.0)
    return BoucWen(gain=gain, hysteresis_gain=A, beta=beta, gamma=gamma, exponent=n)


def asymmetric(rng: Random) -> HysteresisModel:
    n = exponent(rng)
    beta, gamma = law(rng, n, 2)
    return AsymmetricBoucWen(
        gain=rng.normal() * 1e-6, quadratic=rng.normal() * 1e-9, cubic=rng.normal() * 1e-12,
        hysteresis_gain=10.0 ** rng.uniform(-8.0, -6.0), beta=beta, gamma=gamma, exponent=n,
        lowest_input=-40.0, highest_input=140.0,
    )  # fmt: skip


def generalised(rng: Random) -> HysteresisModel:
    n = exponent(rng)
    return GeneralisedBoucWen(
        gain=rng.normal() * 1e-6, hysteresis_gain=10.0 ** rng.uniform(-8.0, -6.0), exponent=n,
        shape=tuple(law(rng, n, 6)), centre=rng.normal() * 60.0,
    )  # fmt: skip


def dahl(rng: Random) -> HysteresisModel:
    return Dahl(
        gain=rng.normal() * 1e-6, stiffness=10.0 ** rng.uniform(-8.0, -6.0),
        limit=10.0 ** rng.uniform(-7.0, -4.0), exponent=rng.choice([0.0, 1.0, rng.uniform(0, 4)]),
    )  # fmt: skip


def duhem(rng: Random) -> HysteresisModel:
    scale = np.array([1e-6, 1e-6, 1e-8, 1e-10])
    f, g = rng.integers(1, 5, size=2)
    return Duhem(
        rate=10.0 ** rng.uniform(-4.0, 1.5), input_range=(-40.0, 140.0),
        anhysteretic=rng.normal(size=f) * scale[:f], tangent=rng.normal(size=g) * scale[:g],
    )  # fmt: skip


def prandtl(rng: Random) -> PrandtlIshlinskii:
    m = rng.integers(1, 12)
    thresholds, weights = np.cumsum(rng.exponential(5.0, m)), rng.normal(size=m) * 1e-7
    return PrandtlIshlinskii(gain=rng.normal() * 1e-6, thresholds=thresholds, weights=weights)


def modified(rng: Random) -> HysteresisModel:
    zones = np.sort(rng.normal(size=rng.integers(0, 6)) * 3e-5)
    return ModifiedPrandtlIshlinskii(
        **prandtl(rng).parameters(),  # type: ignore[arg-type]
        dead_zones=zones, dead_zone_weights=rng.normal(size=zones.size) * 0.4,
    )  # fmt: skip


def maxwell(rng: Random) -> HysteresisModel:
    m, zones = rng.integers(1, 9), np.sort(rng.normal(size=rng.integers(0, 6)) * 3e-5)
    return GeneralisedMaxwellSlip(
        stiffness=2e6, thresholds=np.cumsum(rng.exponential(4e-6, m)),
        element_stiffness=rng.uniform(0.0, 4e5, m),
        dead_zones=zones, dead_zone_weights=rng.uniform(-1.0, 1.0, zones.size) * 3e5,
    )  # fmt: skip


def preisach(rng: Random) -> HysteresisModel:
    # Knots at tenths: plays come to stand on them.
    m, knots = rng.integers(1, 9), np.unique(np.round(rng.normal(size=rng.integers(3, 9)) * 40, 1))
    return Preisach(
        thresholds=np.cumsum(np.round(rng.exponential(6.0, m), 1) + 0.1), knots=knots,
        slopes=rng.normal(size=(m, knots.size - 1)) * 1e-7, gain=rng.normal() * 1e-6,
    )  # fmt: skip


def drive(model: HysteresisModel, rng: Random) -> Array:
    u = walk(int(rng.integers(1 << 30)), 120)
    u = np.round(u, 1) if rng.random() < 0.5 else u
    # Back at no voltage at all, a Maxwell-slip model in Python refuses the rounding of its state.
    return np.where(np.abs(u) < 0.05, 0.37, u) if model.kind == "maxwell-slip" else u


@pytest.mark.parametrize(
    "seed", [*range(6), *(pytest.param(k, marks=pytest.mark.slow) for k in range(6, 30))]
)
@pytest.mark.parametrize(
    "make",
    [bouc_wen, asymmetric, generalised, dahl, duhem, prandtl, modified, maxwell, preisach],
)
def test_a_random_model_is_that_of_python(
    make: Callable[[Random], HysteresisModel], seed: int
) -> None:
    rng = np.random.default_rng((make.__name__.encode()[0], len(make.__name__), seed))
    model = make(rng)
    by_moves, by_lines = Compiled(model), Compiled(model)
    along, state = model.initial_state(), model.initial_state()
    for u in drive(model, rng):
        value = by_moves.moves(np.array([u]))[0]
        try:
            response = model.simulate([u], state)
        except ModelError:
            assert not np.isfinite(value)
            return
        state = response.state
        assert value == response.values[0]
        np.testing.assert_array_equal(by_moves.memory, state)
        if by_lines.code.pieces:
            expected = model.segments([along[0], u], along)
            assert expected is not None
            _, pieces, _ = by_lines.line(float(u))
            along = expected.state
            np.testing.assert_array_equal(pieces, table(expected))
            np.testing.assert_array_equal(by_lines.memory, along)


def test_a_play_that_is_moved_by_rounding_alone_stays_in_its_interval_on_a_knot() -> None:
    # Downwards by so little that the play, on the knot, is moved to where it is. Its function there
    # differs by rounding between the two intervals that meet on the knot.
    rng = np.random.default_rng(71)
    met = told = 0
    while met < 25:
        knot, threshold = rng.uniform(1.0, 60.0), rng.uniform(0.3, 9.0)
        u = float(np.nextafter(knot - threshold, -np.inf))
        if not (knot - u > threshold and u + threshold == knot):
            continue
        met += 1
        model = Preisach(
            thresholds=np.array([threshold]), knots=np.array([-90.0, knot, 130.0]),
            slopes=rng.uniform(1e-8, 9e-8, size=(1, 2)), gain=0.0,
        )  # fmt: skip
        compiled = Compiled(model)
        compiled.memory[:] = [knot - 0.4 * threshold, knot]
        expected = model.simulate([u], compiled.memory.copy()).values[0]
        assert compiled.moves(np.array([u]))[0] == expected
        (low, high), (at_low, at_high) = model.slopes[0], compiled.code.parameters[-2:]
        told += at_low + low * knot != at_high + high * knot
    assert told > 0
