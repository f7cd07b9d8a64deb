"""Hysteresis: stepping, with a stage, all models, and growth.

`python -m benchmarks.hysteresis [stepping] [stage] [models] [growth]` runs it alone.

Routes of one case take turns, several times; a time is the least of a route, a ratio the median of
the ratios within the turns. Displacements are in um here, voltages from 0 to 120 V.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from benchmarks import hysteresis_peers as peers
from benchmarks.cases import Row
from benchmarks.timing import Timed
from flexstage.base.arrays import Array
from flexstage.hysteresis import (
    BoucWen,
    Dahl,
    Duhem,
    GeneralisedMaxwellSlip,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    Preisach,
)
from flexstage.hysteresis.chain.element import forcing
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.model import HysteresisModel

__all__ = ["Route", "growth", "hysteresis", "models", "rows", "stage", "stepping"]


SAMPLES = 1_000_000
#: Samples of the record that errors are measured on, and slow routes are timed on.
FEW = 5000
RECORD = 24_000
ROUNDS = 7
DT = 1e-4
MODEL = BoucWen(gain=0.593, hysteresis_gain=0.544, beta=0.05, gamma=0.03)
MODE = StageModes(frequency_hz=[339.0], damping_ratio=[0.012])


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """One way to do what a case is about.

    Parameters
    ----------
    name : str
        What it is.
    work : Callable
        What is timed.
    scale : float
        How much of the case it does not do: its time is multiplied by this.
    words : str
        Figures beside its time.
    """

    name: str
    work: Callable[[], Any]
    scale: float = 1.0
    words: str = ""


def rows(
    case: str,
    routes: list[Route],
    *,
    samples: float = 0.0,
    rounds: int = ROUNDS,
) -> Iterator[Row]:
    """Time the routes of a case in turns, after a warm-up of each."""
    for route in routes:
        if route.scale < 20.0:
            route.work()
    turns = [[_seconds(route) for route in routes] for _ in range(rounds)]
    for i, route in enumerate(routes):
        least = min(turn[i] for turn in turns)
        paired = statistics.median(turn[i] / turn[0] for turn in turns)
        each = f"{1e9 * least / samples:.3g} ns a sample" if samples else ""
        yield Row(
            case=case,
            route=route.name,
            time=Timed(seconds=least),
            ratio=paired,
            limit="; ".join(word for word in (each, route.words) if word),
        )


def _seconds(route: Route) -> float:
    start = time.perf_counter()
    route.work()
    return (time.perf_counter() - start) * route.scale


def _off(found: Array, exact: Array) -> str:
    return f"error {np.abs(found - exact).max():.1g} um"


def _runge_kutta(u: Array) -> Array:
    y = np.empty_like(u)
    peers.runge_kutta(u, MODEL.gain, MODEL.hysteresis_gain, MODEL.beta, MODEL.gamma, y)
    return y


def _runge_kutta_with_mode(u: Array) -> Array:
    y = np.empty_like(u)
    angle, zeta = float(MODE.omega[0]) * DT, MODE.damping_ratio[0]
    numbers = (MODEL.gain, MODEL.hysteresis_gain, MODEL.beta, MODEL.gamma, angle, zeta)
    peers.runge_kutta_with_mode(u, np.array(numbers), y)
    return y


def stepping(count: int = SAMPLES) -> Iterator[Row]:
    """Time Bouc-Wen with exponent 1 over a sine sweep."""
    u, few, to = peers.sweep(count), peers.sweep(FEW), np.empty(count)
    falling = -u / 60.0
    exact = peers.in_30_digits(MODEL, few)
    powers = BoucWen(gain=0.593, hysteresis_gain=0.544, beta=0.05, gamma=0.03, exponent=1.3)
    ivp = peers.solve_ivp_lines(MODEL, few, DT)
    routes = [
        Route(
            name="flexstage, run by run",
            work=lambda: MODEL.simulate(u),
            words=_off(MODEL.simulate(few).values, exact),
        ),
        Route(name="a pass over memory: y = 2 x", work=lambda: np.multiply(u, 2.0, out=to)),
        Route(name="the same into a new array", work=lambda: u * 2.0),
        Route(name="the exponentials alone: numpy.exp", work=lambda: np.exp(falling, out=to)),
        Route(
            name="Runge-Kutta 4, compiled, a step a sample",
            work=lambda: _runge_kutta(u),
            words=_off(_runge_kutta(few), exact),
        ),
        Route(
            name=f"scipy solve_ivp, rtol 1e-8 ({FEW} samples, scaled)",
            work=lambda: peers.solve_ivp_lines(MODEL, few, DT),
            scale=count / FEW,
            words=_off(ivp, exact),
        ),
        Route(name="flexstage, exponent 1.3, step by step", work=lambda: powers.simulate(u)),
    ]
    yield from rows(f"Bouc-Wen over {count} samples", routes, samples=count)


def _with_stage(modes: StageModes, u: Array) -> Array:
    return modes.through(forcing(MODEL, u, MODEL.initial_state()), DT).values


def stage(count: int = SAMPLES // 10) -> Iterator[Row]:
    """Time Bouc-Wen and a mode of 339 Hz behind it, at 10 kHz."""
    from tests.analytic.test_coupled_stepping import in_30_digits

    u, few = peers.sweep(count), peers.sweep(FEW // 5)
    many = peers.sweep(FEW)
    u[0] = few[0] = many[0] = 0.0
    modes = StageModes(
        frequency_hz=[339.0, 811.0, 1850.0],
        damping_ratio=[0.012, 0.01, 0.02],
        share=[0.8, 0.15, 0.05],
    )
    exact = _with_stage(MODE, many)
    digits = in_30_digits(few, DT)
    coarse = _runge_kutta_with_mode(many)
    routes = [
        Route(
            name="flexstage, through segments in closed form",
            work=lambda: _with_stage(MODE, u),
            words=_off(_with_stage(MODE, few), digits),
        ),
        Route(
            name="Runge-Kutta 4, compiled, a step a sample",
            work=lambda: _runge_kutta_with_mode(u),
            words=_off(coarse, exact),
        ),
        Route(
            name=f"scipy solve_ivp, rtol 1e-8 ({FEW} samples, scaled)",
            work=lambda: peers.solve_ivp_lines(MODEL, many, DT, MODE),
            scale=count / FEW,
            words=_off(peers.solve_ivp_lines(MODEL, many, DT, MODE), exact),
        ),
        Route(
            name="flexstage, three modes",
            work=lambda: _with_stage(modes, u),
        ),
    ]
    yield from rows(f"Bouc-Wen and a mode over {count} samples", routes, samples=count)


def _plays(count: int) -> tuple[Array, Array]:
    thresholds = 60.0 * np.arange(1, count + 1) / (count + 1)
    weights = np.exp(-thresholds / 25.0)
    return thresholds, 0.2 * weights / weights.sum()


def prandtl_ishlinskii(count: int) -> PrandtlIshlinskii:
    """Return a model with some plays."""
    thresholds, weights = _plays(count)
    return PrandtlIshlinskii(gain=0.35, thresholds=thresholds, weights=weights)


def preisach(plays: int, means: int) -> Preisach:
    """Return a model on a grid."""
    thresholds = 60.0 * np.arange(plays) / plays
    slopes = np.exp(-thresholds / 25.0)[:, None] * (1.3 - np.linspace(0.0, 0.6, means))[None, :]
    return Preisach(
        thresholds=thresholds,
        knots=np.linspace(0.0, 120.0, means + 1),
        slopes=0.55 * slopes / slopes.sum(axis=0).mean(),
    )


def _models() -> list[tuple[str, HysteresisModel]]:
    thresholds, weights = _plays(16)
    zones = 60.0 * (np.arange(8) + 0.5) / 8
    return [
        ("Bouc-Wen", BoucWen(gain=0.593, hysteresis_gain=0.2, beta=0.05, gamma=0.03)),
        ("Dahl", Dahl(gain=0.593, stiffness=0.251, limit=5.3)),
        ("Dahl, exponent 1.4", Dahl(gain=0.593, stiffness=0.15, limit=5.3, exponent=1.4)),
        (
            "Duhem",
            Duhem(
                rate=0.04,
                anhysteretic=np.array([2.0, 0.45, 0.4e-3]),
                tangent=np.array([0.3]),
                input_range=(0.0, 120.0),
            ),
        ),
        ("Prandtl-Ishlinskii, 16 plays", prandtl_ishlinskii(16)),
        (
            "modified Prandtl-Ishlinskii, 16 plays, 8 dead zones",
            ModifiedPrandtlIshlinskii(
                gain=0.35,
                thresholds=thresholds,
                weights=weights,
                dead_zones=zones,
                dead_zone_weights=np.full(8, -0.015),
            ),
        ),
        (
            "Maxwell-slip, 16 elements",
            GeneralisedMaxwellSlip(
                stiffness=1.5, thresholds=0.5 * thresholds, element_stiffness=3.0 * weights
            ),
        ),
        ("Preisach, 16 x 16", preisach(16, 16)),
    ]


def models(count: int = RECORD) -> Iterator[Row]:
    """Time every model and its inverse."""
    u = peers.sweep(count)
    forward, back = [], []
    for name, model in _models():
        y = model.simulate(u).values
        returned = np.abs(model.inverse(y).values - u).max()
        forward.append(Route(name=name, work=lambda m=model: m.simulate(u)))
        back.append(
            Route(name=name, work=lambda m=model, y=y: m.inverse(y), words=f"off {returned:.0e} V")
        )
    yield from rows(f"{count} samples of each model", forward, samples=count)
    yield from rows(f"the inverse of {count} samples of each model", back, samples=count)


def growth(
    plays: tuple[int, ...] = (8, 16, 32, 64),
    lengths: tuple[int, ...] = (6_000, 24_000, 96_000, 384_000, 1_500_000),
) -> Iterator[Row]:
    """Time how models grow with their plays and with the record."""
    u = peers.sweep(RECORD)
    by_plays = [("Prandtl-Ishlinskii", prandtl_ishlinskii), ("Preisach", lambda n: preisach(n, n))]
    for name, make in by_plays:
        made = [make(n) for n in plays]
        grown = [(n, m, m.simulate(u).values) for n, m in zip(plays, made, strict=True)]
        forward = [Route(name=f"{n} plays", work=lambda m=m: m.simulate(u)) for n, m, _ in grown]
        yield from rows(f"{name}, {RECORD} samples", forward, samples=RECORD)
        back = [Route(name=f"{n} plays", work=lambda m=m, y=y: m.inverse(y)) for n, m, y in grown]
        yield from rows(f"its inverse, {name}", back, samples=RECORD)
    for name, model in (("Bouc-Wen", MODEL), ("Preisach, 16 x 16", preisach(16, 16))):
        by_length = []
        for n in lengths:
            long = peers.sweep(n)
            by_length.append((n, Route(name=f"{n} samples", work=lambda x=long: model.simulate(x))))  # noqa: B023 (run at once)
        first: float | None = None
        for n, route in by_length:
            for row in rows(f"{name}, length of the record", [route], samples=n):
                first = first or row.time.seconds
                yield replace(row, ratio=row.time.seconds / first)


CASES = {
    "stepping": stepping,
    "stage": stage,
    "models": models,
    "growth": growth,
}


def hysteresis() -> Iterator[Row]:
    """Time steps, stages and records of every hysteresis model."""
    for case in CASES.values():
        yield from case()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hysteresis", description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    chosen = parser.parse_args().cases or list(CASES)
    for name in chosen:
        for case, group in groupby(CASES[name](), key=lambda row: row.case):
            print(f"\n{case}")
            for row in group:
                print(f"  {row.route:<56} {row.time!s:>9} {row.ratio:>9.4g}   {row.limit}")


if __name__ == "__main__":
    main()
