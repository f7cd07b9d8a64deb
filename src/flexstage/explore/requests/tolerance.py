"""What is asked of a workshop: its scatter, what a good stage has, the yield that is wanted."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

from flexstage.choose import unknown
from flexstage.errors import ModelError
from flexstage.explore.deviations import KINDS, scatter_dimensions
from flexstage.explore.family import batched_figures
from flexstage.explore.figures import chosen_figures, requirements_of
from flexstage.explore.tolerance import ToleranceStudy, tolerance
from flexstage.explore.tolerance_choice import ToleranceChoice, choose_tolerances
from flexstage.explore.workers import Workers
from flexstage.stage import Stage
from flexstage.units import parse
from flexstage.virtual.imperfections import Scatter

Found = tuple[ToleranceStudy, ToleranceChoice | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ToleranceRequest:
    """A lot of stages in words, as the options of `flexstage tolerance`, which say what each is."""

    samples: int = 10_000
    """Stages that are drawn."""
    seed: int = 0
    """Seed of the random numbers."""
    scatter: tuple[str, ...] = ()
    """Standard deviations; the usual ones of wire erosion where not given."""
    require: tuple[str, ...] = ()
    """What a good stage has."""
    of: tuple[str, ...] = ()
    """Figures that are looked at; the usual ones where none is named."""
    target_yield: str | None = None
    """Share of good stages for which the cheapest scatter is sought."""
    cost: tuple[str, ...] = ()
    """Weights of what tolerances cost."""
    model: str = "superelement"
    """Model that corrects the lumped one."""
    follow_necks: bool = False
    """Whether that model says as well how figures follow an offset of all necks."""

    def ready(self, stage: Stage) -> Callable[[Workers, Path | None], Found]:
        """Read the words; return what draws the lot, and chooses tolerances where asked to."""
        if self.model not in ("superelement", "lumped"):
            raise ModelError(f"--model is superelement or lumped, got '{self.model[:40]}'")
        if self.follow_necks and self.model == "lumped":
            raise ModelError("--follow-necks needs another --model than lumped, which says it then")
        process = scatter_of(self.scatter)
        weights = {name: _weight(name, text) for name, text in _pairs(self.cost, "--cost")}
        if self.cost and self.target_yield is None:
            raise ModelError("--cost needs --target-yield: it weighs what is chosen for that")
        target = None if self.target_yield is None else _yield_share(self.target_yield)
        if target is not None and not self.require:
            raise ModelError("--target-yield needs at least one --require: what a good stage has")
        known = batched_figures(stage)
        figures = chosen_figures(self.of, known)
        requirements = requirements_of(self.require, known)

        def run(workers: Workers, keep: Path | None) -> Found:
            study = tolerance(
                stage,
                process,
                figures=figures,
                requirements=requirements,
                samples=self.samples,
                seed=self.seed,
                model=self.model,
                follow_necks=self.follow_necks,
                workers=workers,
                keep=keep,
            )
            if target is None:
                return study, None
            return study, choose_tolerances(study, target, weights=weights, workers=workers)

        return run


def scatter_of(texts: Iterable[str]) -> Scatter:
    """Return the scatter that words say, one after the other; the usual one of what they leave.

    Examples
    --------
    >>> scatter_of(["neck_own=2 um", "modulus=0.5 %"]).neck_own
    2e-06
    """
    names, dimensions = [kind.name for kind in KINDS], scatter_dimensions()
    found = Scatter()
    for pattern, text in _pairs(texts, "--scatter"):
        fitting = [name for name in names if fnmatchcase(name, pattern)]
        if not fitting:
            raise ModelError(unknown("deviation", pattern, names))
        for name in fitting:
            dimension = dimensions[name]
            if text.strip() == "0":
                value = 0.0
            elif dimension is None:
                value = _share(text)
            else:
                value = parse(text, dimension.name)
            found = replace(found, **{name: value})
    return found


def _pairs(texts: Iterable[str], option: str) -> list[tuple[str, str]]:
    pairs = []
    for text in texts:
        name, equals, value = text.partition("=")
        if not name.strip() or not equals or not value.strip():
            raise ModelError(
                f"{option} is a name and a value, such as neck_own=\"2 um\", got '{text[:60]}'"
            )
        pairs.append((name.strip(), value.strip()))
    return pairs


def _share(text: str) -> float:
    words, percent = text.strip().removesuffix("%"), text.strip().endswith("%")
    try:
        return float(words) * (0.01 if percent else 1.0)
    except ValueError:
        raise ModelError(
            f"expected a share, such as \"0.5 %\" or 0.005, got '{text[:40]}'"
        ) from None


def _yield_share(text: str) -> float:
    share = _share(text)
    if 1.0 < share < 100.0 and not text.strip().endswith("%"):
        raise ModelError(
            f"--target-yield is a share, such as \"99 %\" or 0.99, got '{text.strip()[:40]}': "
            f'write "{share:g} %"'
        )
    return share


def _weight(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"the cost of {name} is a number, got '{text[:40]}'") from None
