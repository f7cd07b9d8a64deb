"""A campaign of tests by kind, trials of a budget, and a modal fit, against other ways to do it.

`python -m benchmarks.measuring [campaigns] [budget] [modal]` runs it alone, in one thread, by
turns, with times of the processor.
"""

import argparse
import contextlib
import io
import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np

from benchmarks.cases import Row
from benchmarks.timing import in_turns
from flexstage.base.arrays import Array, Complex
from flexstage.experiments.campaign.plan import Test
from flexstage.experiments.campaign.results import Characterisation, evaluate
from flexstage.experiments.virtual_campaign import VirtualCampaign, virtual_campaign
from flexstage.measure.modal.fit import fit_modes
from flexstage.measure.modal.stabilisation import stable_poles
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.measure.uncertainty.monte_carlo import monte_carlo
from flexstage.measure.uncertainty.propagate import Influence, propagate
from flexstage.stage.designs import design
from flexstage.virtual.as_built import as_built

__all__ = ["budget", "campaigns", "characterise", "modal"]

Route = tuple[str, Callable[[], object], str]

STAGES = ("vgtu-piezo", "vgtu-mechanical")
TRIALS = 1_000_000
LINES = 5000
#: Frequency [Hz] and damping ratio of the modes that are fitted, and the band's lower end [Hz].
MODES = ((210.0, 0.013), (254.2, 0.01), (533.0, 0.02))
LOWEST = 50


def tested(made: VirtualCampaign, tests: tuple[Test, ...]) -> Characterisation:
    """Evaluate some tests of a campaign."""
    part = replace(made.campaign, tests=tests)
    return evaluate(part, lambda test: [made.records[name] for name in test.records])


def campaigns(names: tuple[str, ...] = STAGES, runs: int = 5) -> Iterator[Row]:
    """Time a virtual campaign of each stage, test by test."""
    for name in names:
        built = as_built(design(name), seed=1)
        made = virtual_campaign(built, seed=1)

        tests = made.campaign.tests
        routes: list[Route] = [
            (
                f"all of {len(tests)} tests, from records in memory",
                lambda m=made, t=tests: tested(m, t),
                "modal fits, curves of the motion",
            ),
            (
                "making the records",
                lambda b=built: virtual_campaign(b, seed=1),
                "noise, and modes of the hammer's stage",
            ),
        ]
        for kind in dict.fromkeys(test.kind for test in tests):
            own = tuple(test for test in tests if test.kind == kind)
            samples = sum(made.records[n].channels[0].values.size for t in own for n in t.records)
            routes.append(
                (
                    f"of that {len(own)} x {kind}",
                    lambda m=made, t=own: tested(m, t),
                    f"{samples} samples",
                )
            )
        yield from _rows(f"campaign of {name}", routes, runs)


def gauge() -> tuple[Callable[..., Any], tuple[Influence, ...]]:
    """Return the end gauge of the GUM (JCGM 100:2008, H.1), in nanometres and kelvin."""

    def normal(name: str, value: float, u: float, freedom: float = math.inf) -> Influence:
        return Influence(name=name, value=value, uncertainty=u, degrees_of_freedom=freedom)

    def uniform(name: str, value: float, half: float) -> Influence:
        return Influence(name=name, value=value, half_width=half)

    def length(ls: Any, d: Any, d1: Any, d2: Any, a: Any, t: Any, c: Any, da: Any, dt: Any) -> Any:
        return ls + d + d1 + d2 - ls * (da * (t + c) + a * dt)

    return length, (
        normal("standard", 50_000_623.0, 25.0, 18),
        normal("mean", 215.0, 5.8, 24),
        normal("random", 0.0, 3.9, 5),
        normal("systematic", 0.0, 6.7, 8),
        uniform("expansion", 11.5e-6, 2e-6),
        normal("temperature", -0.1, 0.2),
        Influence(name="cycle", value=0.0, half_width=0.5, distribution="arcsine"),
        uniform("expansions apart", 0.0, 1e-6),
        uniform("temperatures apart", 0.0, 0.05),
    )


def plain_trials(trials: int) -> tuple[float, float, Array]:
    """Draw the same influences by NumPy alone, all at once; mean, deviation, quantiles."""
    rng = np.random.default_rng(1)
    length, influences = gauge()
    drawn = []
    for i in influences:
        if i.distribution == "arcsine":
            drawn.append(0.5 * np.sin(2.0 * np.pi * rng.random(trials)))
        elif i.half_width is not None:
            drawn.append(rng.uniform(i.value - i.half_width, i.value + i.half_width, trials))
        else:
            drawn.append(rng.normal(i.value, i.uncertainty or 0.0, trials))
    y = length(*drawn)
    return float(y.mean()), float(y.std(ddof=1)), np.quantile(y, (0.025, 0.975))


def by_gtc() -> float:
    """Propagate to first order by GTC itself."""
    from GTC import ureal

    length, influences = gauge()
    numbers = [ureal(i.value, i.standard_uncertainty, i.degrees_of_freedom) for i in influences]
    return float(length(*numbers).u)


def budget(trials: int = TRIALS, runs: int = 5) -> Iterator[Row]:
    """Time a million trials of a budget of nine influences, and the first order."""
    length, influences = gauge()
    first, drawn = propagate(length, influences), monte_carlo(length, influences, trials=trials)
    routes: list[Route] = [
        (
            "flexstage, Monte Carlo, both intervals, trials kept",
            lambda: monte_carlo(length, influences, trials=trials, seed=1),
            f"drawing normal numbers, sorting; u = {drawn.uncertainty:.2f} nm",
        ),
        (
            "NumPy, all trials at once, two quantiles",
            lambda: plain_trials(trials),
            f"drawing, memory; u = {plain_trials(trials)[1]:.2f} nm",
        ),
        (
            "flexstage, first order, with the budget",
            lambda: propagate(length, influences),
            f"GTC twice, Python; u = {first.uncertainty:.2f} nm",
        ),
        ("GTC, first order", by_gtc, f"Python; u = {by_gtc():.2f} nm"),
    ]
    yield from _rows(f"budget of {len(influences)} influences, {trials:.0e} trials", routes, runs)


def responses(lines: int, outputs: int, noise: float = 0.003) -> tuple[Array, Complex]:
    """Return frequencies and responses of three modes, with noise, shape (lines, outputs)."""
    rng = np.random.default_rng(1)
    f: Array = np.linspace(0.0, 1000.0, lines + 1)
    s = 2j * np.pi * f[:, None]
    h = np.zeros((f.size, outputs), dtype=np.complex128)
    for frequency, zeta in MODES:
        p = 2.0 * math.pi * frequency * complex(-zeta, math.sqrt(1.0 - zeta * zeta))
        residue = rng.standard_normal(outputs) - 20j * rng.standard_normal(outputs)
        h += residue / (s - p) + residue.conj() / (s - p.conjugate())
    white = rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape)
    return f, h + noise * np.abs(h).max() * white


def modal(lines: int = LINES, outputs: tuple[int, ...] = (1, 4), runs: int = 4) -> Iterator[Row]:
    """Time poles of forty orders, and the whole fit, beside sdypy-EMA where it is installed."""
    for count in outputs:
        f, h = responses(lines, count)
        measured = MeasuredResponse(
            frequency_hz=f,
            response=h[:, :, None],
            inputs=("force",),
            outputs=tuple(f"point {i + 1}" for i in range(count)),
            output_units=("m",) * count,
            variance=np.full((f.size, count, 1), 2.0 * (0.003 * float(np.abs(h).max())) ** 2),
        )
        band = (float(LOWEST), float(f[-1]))
        routes: list[Route] = [
            (
                "flexstage, modes, residues, covariances, their number found",
                lambda m=measured, b=band: fit_modes(m, band=b),
                "likelihood of all lines; eigenvalues",
            ),
            (
                "flexstage, of that poles of 39 orders",
                lambda m=measured, b=band: stable_poles(m, band=b),
                "eigenvalues of orders up to 40: their power 4; powers at all lines",
            ),
        ]
        peer = _peer(f, h)
        if peer is not None:
            routes += [
                (
                    "sdypy-EMA, poles (lscf), picking 3, residues (lsfd)",
                    lambda p=peer: p(fit=True),
                    "products and eigenvalues of orders up to 80",
                ),
                (
                    "sdypy-EMA, of that poles of 40 orders",
                    lambda p=peer: p(fit=False),
                    "the same",
                ),
            ]
        yield from _rows(
            f"modes of {count} response{'s' if count > 1 else ''}, {lines} lines", routes, runs
        )


def _peer(f: Array, h: Complex) -> Callable[..., object] | None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            from sdypy import EMA
        except ImportError:
            return None

    def work(*, fit: bool) -> object:
        # its polynomials are real: each pole takes two of their order
        model = EMA.Model(
            frf=h.T,
            freq=f,
            lower=LOWEST,
            upper=round(f[-1]),
            pol_order_high=40,
            frf_form="receptance",
        )
        model.get_poles("lscf", show_progress=False)
        if fit:
            # told where they are, instead of clicking at the diagram
            with contextlib.redirect_stderr(io.StringIO()):
                model.select_closest_poles([frequency for frequency, _ in MODES])
            model.get_constants(f_lower=LOWEST, f_upper=float(model.freq[-1]))
        return model

    return work


def _rows(case: str, routes: list[Route], runs: int) -> Iterator[Row]:
    times = in_turns([work for _, work, _ in routes], runs=runs)
    for (route, _, limit), took in zip(routes, times, strict=True):
        ratio = took.seconds / times[0].seconds
        yield Row(case=case, route=route, time=took, ratio=ratio, limit=limit)


CASES = {"campaigns": campaigns, "budget": budget, "modal": modal}


def characterise() -> Iterator[Row]:
    """Time virtual tests by kind, trials of a budget, and modal fits."""
    for case in CASES.values():
        yield from case()


def main() -> None:
    """Print the table of the cases that are named, or of all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.measuring", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="CASE", help=", ".join(CASES))
    names = parser.parse_args().names or list(CASES)
    for case, group in groupby((row for name in names for row in CASES[name]()), lambda r: r.case):
        print(f"\n{case}")
        for row in group:
            print(f"  {row.route:<62} {row.time!s:>9} {row.ratio:>8.3g}   {row.limit}")


if __name__ == "__main__":
    main()
