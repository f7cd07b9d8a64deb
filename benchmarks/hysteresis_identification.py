"""Identification of hysteresis against general optimisers, and the plant against integrators.

`python -m benchmarks.hysteresis_identification [auto] [bouc-wen] [preisach] [growth]` runs it
alone. Every optimiser fits the same samples behind the same chain, and offset and settling are
taken out of its problem. A hit is a start whose misfit ends within 0.1 % of the best of all.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution, least_squares, lsq_linear, nnls

from benchmarks.cases import Row
from benchmarks.timing import Timed
from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis import BoucWen, Preisach
from flexstage.hysteresis.chain.creep import LogCreep
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.identification.chain_search import find_chain
from flexstage.hysteresis.identification.identify import identify
from flexstage.hysteresis.identification.measurement import measurement
from flexstage.hysteresis.identification.model_fit import FitData, behind_chain, fit_data, fits
from flexstage.hysteresis.identification.residuals import cross_validate, residuals
from flexstage.hysteresis.models.fits import BoucWenFit, PreisachFit, shape_at
from flexstage.records import Channel, Record
from flexstage.virtual.stack import virtual_stack

__all__ = ["auto", "bouc_wen", "growth", "identification", "preisach", "record"]


SAMPLES = 24_000
STARTS = 20
#: A misfit within this share of the best of all is a hit.
HIT = 1e-3


def record(count: int = SAMPLES, seed: int = 11) -> Record:
    """Return a trial: a virtual stack with creep and lag, at two rates, with nested loops."""
    t: Array = np.arange(count, dtype=np.float64) * (24.0 / count)
    # 0.75 Hz for 16 s, then 7.5 Hz; loops shrink after four full ones, and again in the fast part
    phase = np.where(t < 16.0, 0.75 * t, 12.0 + 7.5 * (t - 16.0))
    slow = np.clip(1.0 - 0.11 * (np.floor(phase) - 3.0), 0.12, 1.0)
    fast = np.clip(1.0 - 0.03 * (np.floor(phase) - 36.0), 0.3, 1.0)
    size = np.where(t < 16.0, slow, fast)
    u = 60.0 * size * (1.0 - np.cos(2.0 * np.pi * phase))
    dt = float(t[1])
    y = 1e6 * virtual_stack((0.0, 120.0), 38e-6, 0.125).simulate(u).values
    creep, lag = LogCreep(rate_per_decade=0.018), Lag(delay=7e-4)
    y = creep.simulate(y, dt, creep.settled(0.0, dt)).values
    y = lag.simulate(y, dt).values
    y = y + np.random.default_rng(seed).normal(0.0, 0.005, count)
    return Record(
        channels=(
            Channel(name="voltage", values=u, unit="V"),
            Channel(name="displacement", values=y, unit="um"),
        ),
        time=t,
    )


def _data(given: Record) -> FitData:
    m = measurement([given], "voltage", "displacement")
    return fit_data(m, find_chain(m).values)


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """A route, its seconds, what came out."""

    name: str
    seconds: float
    words: str


def _rows(case: str, taken: list[Taken]) -> Iterator[Row]:
    for one in taken:
        yield Row(
            case=case,
            route=one.name,
            time=Timed(seconds=one.seconds),
            ratio=one.seconds / taken[0].seconds,
            limit=one.words,
        )


def _least(work: Callable[[], Any], runs: int = 3) -> tuple[float, Any]:
    """Least seconds of the processor of some runs, and what the last one returned."""
    times, made = [], None
    for _ in range(runs):
        start = time.process_time()
        made = work()
        times.append(time.process_time() - start)
    return min(times), made


def _stages(kind: str, given: Record) -> list[Taken]:
    """Time identification as a whole and in its parts."""
    method = fits()[kind]
    m = measurement([given], "voltage", "displacement")
    identify(given, "voltage", "displacement", model=kind)
    whole, found = _least(lambda: identify(given, "voltage", "displacement", model=kind))
    chain, _ = _least(lambda: find_chain(m))
    data = _data(given)
    fit, made = _least(lambda: method.fit(replace(data, memo={})))

    def validate() -> object:
        method.fit(data)
        return cross_validate(method, data, made.search)

    folds = _least(validate)[0]
    within = len(data.memo) > 0
    held = f"left {found.rms_percent:.3g} %, on cycles held out {found.heldout_rms_percent:.3g} %"
    return [
        Taken(name="flexstage, identify, with cross-validation", seconds=whole, words=held),
        Taken(name="flexstage, chain and fit without it", seconds=chain + fit, words=""),
        Taken(name="of that: the chain", seconds=chain, words="delay, creep, resonance"),
        Taken(name="of that: the fit", seconds=fit, words=""),
        Taken(
            name="the cross-validation" + (", columns known" if within else ""),
            seconds=folds,
            words="",
        ),
    ]


# ------------------------------------------------------------------------------- all the models


def auto(count: int = SAMPLES) -> Iterator[Row]:
    """Choose a model of all, against global searches for two of them alone."""
    given = record(count)
    data = _data(given)
    problem, method = _FourParameters(data), PreisachFit(smoothing=WEIGHT)
    identify(given, "voltage", "displacement")

    def by_nnls() -> Array:
        matrix, target, _ = _full_matrix(method, data)
        return nnls(matrix, target, maxiter=50 * matrix.shape[1])[0]

    seconds, found = _least(lambda: identify(given, "voltage", "displacement"))
    best = f"{found.kind}, {found.heldout_rms_percent:.3g} % on cycles held out"
    taken = [
        Taken(name="flexstage, four models, chain, cross-validation", seconds=seconds, words=best)
    ]
    for name, work in (
        ("scipy differential_evolution, Bouc-Wen", lambda: _evolved(problem, np.full(4, 0.5))),
        ("scipy nnls, full matrix of Preisach", by_nnls),
    ):
        alone, _ = _least(work, 1)
        taken.append(Taken(name=name, seconds=alone, words="one fit behind a known chain"))
    yield from _rows(f"choosing among all models, {count} samples", taken)


# ------------------------------------------------------------------------------------- Bouc-Wen


class _FourParameters:
    """The misfit as a function of all four parameters of Bouc-Wen."""

    def __init__(self, data: FitData) -> None:
        self._data = data
        (section,), (rows,) = data.sections, data.rows
        self._section, self._y = section, section.y[rows.at]
        self._basis = np.linalg.qr(section.nuisance[rows.at])[0]
        self._slope = data.stroke / data.input_scale
        self.calls = 0

    def model(self, p: Array) -> BoucWen:
        beta, gamma = shape_at(p[:2], self._data.input_scale)
        gains = self._slope * p[2:]
        return BoucWen(
            gain=float(gains[0]),
            hysteresis_gain=max(float(gains[1]), 1e-9),
            beta=beta,
            gamma=gamma,
        )

    def left(self, p: Array) -> Array:
        """What is left for the searched pair and both gains, each over the mean slope."""
        return self.left_by(self.model(p))

    def left_raw(self, p: Array) -> Array:
        """What is left for gain, hysteresis gain, beta, gamma as they are."""
        d, a, beta, gamma = p.tolist()
        away = np.full(self._y.size, 1e3)
        try:
            left = self.left_by(BoucWen(gain=d, hysteresis_gain=a, beta=beta, gamma=gamma))
        except ModelError:
            # it runs away, which is far from any optimum
            return away
        return left if np.abs(left).max() < 1e3 else away

    def left_by(self, model: BoucWen) -> Array:
        """What a model leaves behind the chain, over the stroke."""
        self.calls += 1
        y = model.simulate(self._section.u).values
        e = self._y - behind_chain([y[:, None]], self._data)[0][:, 0]
        return (e - self._basis @ (self._basis.T @ e)) / self._data.stroke

    def rms(self, p: Array) -> float:
        return float(np.sqrt(np.mean(self.left(p) ** 2)))


BOUNDS = np.array([[0.0, 0.0, 0.3, 0.0], [1.0, 1.0, 3.0, 3.0]])


def bouc_wen(count: int = SAMPLES, starts: int = STARTS) -> Iterator[Row]:
    """Identify Bouc-Wen: time, and the share of starts that reach the best known optimum."""
    given = record(count)
    data = _data(given)
    problem = _FourParameters(data)
    draw = np.random.default_rng(23)
    begins = draw.uniform(BOUNDS[0], BOUNDS[1], (starts, 4))

    def ours(begin: Array) -> float:
        errors = residuals(BoucWenFit().fit(data, begin[:2]).model, data).predicted_at(data.use)
        left = np.concatenate(errors)
        return float(np.sqrt(np.mean(left**2))) / data.stroke

    def within(begin: Array) -> float:
        found = least_squares(problem.left, begin, bounds=BOUNDS, x_scale="jac")
        return problem.rms(found.x)

    def raw(begin: Array) -> float:
        model = problem.model(begin)
        p = np.array([model.gain, model.hysteresis_gain, model.beta, model.gamma])
        low = np.array([-np.inf, 1e-9, -np.inf, -np.inf])
        found = least_squares(problem.left_raw, p, bounds=(low, np.inf), x_scale="jac")
        return float(np.sqrt(np.mean(found.fun**2)))

    routes: list[tuple[str, Callable[[Array], float], int]] = [
        ("flexstage, one random start", ours, starts),
        ("scipy least_squares over all four, scaled as ours", within, starts),
        ("scipy least_squares over d, A, beta, gamma", raw, starts),
        ("scipy differential_evolution over all four", lambda b: _evolved(problem, b), 3),
    ]
    misfits, seconds, calls = [], [], []
    for _, route, runs in routes:
        ends, times = [], []
        problem.calls = 0
        for begin in begins[:runs]:
            start = time.perf_counter()
            ends.append(route(begin))
            times.append(time.perf_counter() - start)
        misfits.append(np.array(ends))
        seconds.append(float(np.median(times)))
        calls.append(problem.calls / runs)
    best = min(float(m.min()) for m in misfits)
    taken = [
        Taken(
            name=name,
            seconds=s,
            words=f"{np.sum(m <= best * (1.0 + HIT))} of {m.size} at {100 * best:.5g} %, worst "
            f"{100 * m.max():.5g} %" + (f"; {c:.0f} simulations a start" if c else ""),
        )
        for (name, _, _), m, s, c in zip(routes, misfits, seconds, calls, strict=True)
    ]
    yield from _rows(f"fitting Bouc-Wen to {count} samples, median of starts", taken)
    yield from _rows(f"identifying Bouc-Wen from {count} samples", _stages("bouc-wen", given))


def _evolved(problem: _FourParameters, begin: Array) -> float:
    found = differential_evolution(
        problem.rms, list(zip(*BOUNDS, strict=True)), rng=int(1e6 * begin[0])
    )
    return float(found.fun)


# ------------------------------------------------------------------------------------- Preisach

WEIGHT = 3e-7


def _full_matrix(method: PreisachFit, data: FitData) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Columns without nuisance and their penalty below them; the output; which columns move."""
    (section,), (rows,) = data.sections, data.rows
    quasi = np.concatenate(list(method.columns(section, data)), axis=1)
    columns = behind_chain([quasi], data)[0]
    moving = np.ptp(columns, axis=0) > 1e-9 * np.ptp(columns, axis=0).max()
    penalty = method.smoothing(data, moving)
    assert penalty is not None
    values, vectors = np.linalg.eigh(penalty * rows.at.size * data.input_scale**2)
    below = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    basis = np.linalg.qr(section.nuisance[rows.at])[0]
    y = section.y[rows.at]
    whole = np.vstack((columns - basis @ (basis.T @ columns), below))[:, moving]
    target = np.concatenate((y - basis @ (basis.T @ y), np.zeros(below.shape[0])))
    return whole, target, moving


def preisach(count: int = SAMPLES, size: int = 16) -> Iterator[Row]:
    """Identify Preisach: time, and the optimum against solvers of the full matrix."""
    given = record(count)
    data = _data(given)
    method = PreisachFit(size, size, WEIGHT)
    matrix, target, moving = _full_matrix(method, data)

    def cost(x: Array) -> float:
        return float(np.sum((matrix @ x - target) ** 2))

    def ours() -> Array:
        model = method.fit(replace(data, memo={})).model
        assert isinstance(model, Preisach)
        return model.slopes.ravel()[moving]

    def by_trf() -> Array:
        built, y, _ = _full_matrix(method, data)
        return lsq_linear(built, y, bounds=(0.0, np.inf), tol=1e-10, max_iter=200).x

    def by_bvls() -> Array:
        built, y, _ = _full_matrix(method, data)
        return lsq_linear(built, y, bounds=(0.0, np.inf), method="bvls", tol=1e-10).x

    def by_nnls() -> Array:
        built, y, _ = _full_matrix(method, data)
        return nnls(built, y, maxiter=50 * built.shape[1])[0]

    ours()
    routes = [
        ("flexstage, given weight", ours, 3),
        ("scipy nnls, full matrix", by_nnls, 1),
        ("scipy lsq_linear, trust region", by_trf, 1),
        ("scipy lsq_linear, bvls", by_bvls, 1),
    ]
    found = [(name, *_least(work, runs)) for name, work, runs in routes]
    best = min(cost(x) for _, _, x in found)
    taken = [
        Taken(
            name=name,
            seconds=seconds,
            words=f"cost {cost(x) / best - 1.0:.1e} above the least, {np.sum(x > 1e-9)} above zero",
        )
        for name, seconds, x in found
    ]
    yield from _rows(f"fitting Preisach {size} x {size} to {count} samples", taken)
    yield from _rows(f"identifying Preisach from {count} samples", _stages("preisach", given))


def growth(
    lengths: tuple[int, ...] = (6_000, 24_000, 96_000, 384_000),
    sizes: tuple[int, ...] = (8, 16, 24, 32),
) -> Iterator[Row]:
    """Time how fits grow with the record and with the number of operators."""
    for kind in ("bouc-wen", "preisach"):
        taken = []
        for n in lengths:
            given = record(n)
            seconds, _ = _least(
                lambda: identify(given, "voltage", "displacement", model=kind),  # noqa: B023 (run at once)
                runs=2 if n < 100_000 else 1,
            )
            taken.append(Taken(name=f"{n} samples", seconds=seconds, words=""))
        yield from _rows(f"identify, {kind}, length of the record", taken)
    data = _data(record())
    taken = []
    for size in sizes:
        method = PreisachFit(size, size, WEIGHT)
        seconds, _ = _least(lambda: method.fit(replace(data, memo={})), runs=2)  # noqa: B023
        taken.append(Taken(name=f"{size} x {size}", seconds=seconds, words=""))
    yield from _rows(f"fitting Preisach to {SAMPLES} samples, number of operators", taken)


CASES = {"auto": auto, "bouc-wen": bouc_wen, "preisach": preisach, "growth": growth}


def identification() -> Iterator[Row]:
    """Time the identification of a record, by model and with the model chosen."""
    for case in CASES.values():
        yield from case()


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.hysteresis_identification", description=__doc__
    )
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    chosen = parser.parse_args().cases or list(CASES)
    for name in chosen:
        for case, group in groupby(CASES[name](), key=lambda row: row.case):
            print(f"\n{case}")
            for row in group:
                print(f"  {row.route:<50} {row.time!s:>9} {row.ratio:>9.4g}   {row.limit}")


if __name__ == "__main__":
    main()
