"""Stages whose dimensions are hidden, and found again from a few of their figures."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from flexstage.base.errors import FlexstageError
from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.stage.designs import DESIGNS, StageTemplate
from flexstage.studies.explore import Ensemble, Family, Figure, FreeDimension, Observation, evaluate
from flexstage.studies.explore.ensemble import model_error
from flexstage.studies.explore.prepare import free_variables
from flexstage.studies.explore.reconstruct import dimension_of, reconstruct
from flexstage.studies.explore.variables import variables_of
from flexstage.studies.models import analyse_model

#: Hidden dimensions of the bridge, and one standard deviation of what is known of them before.
HIDDEN = (
    "link_offset=25 %",
    "link_length=20 %",
    "notch.neck_thickness=20 %",
    "notch.radius=20 %",
    "guide.notch.neck_thickness=20 %",
)
#: What the study gives of each axis.
STUDY = ("output_displacement", "natural_frequency_hz", "max_stress")
GIVEN = tuple(Figure(quantity=q, axis="y") for q in STUDY)
#: Figures that nobody gives.
PREDICTED = ("input_stiffness", "output_stiffness", "effective_mass", "gravity_sag", "moving_mass")
#: Built-in designs of one plate.
ONE_PLATE = tuple(name for name in DESIGNS if name != "stacked-xy")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """A hidden stage, and what was found of it."""

    coordinates: np.ndarray
    """True dimensions, in standard deviations of what is known before, shape (5,)."""
    truth: dict[Figure, float]
    """True figures."""
    ensemble: Ensemble
    """What was found."""

    @property
    def squares(self) -> np.ndarray:
        """Squares of what each dimension is off, in standard deviations that are left, (5,)."""
        variances = np.diag(self.ensemble.posterior.covariance)
        return (self.coordinates - self.ensemble.coordinates) ** 2 / variances

    @property
    def distance(self) -> float:
        """Square of what all dimensions are off together: chi-squared of as many degrees."""
        median = np.array([d.median for d in self.ensemble.dimensions])
        sigma = np.array([d.sigma for d in self.ensemble.dimensions])
        return self.ensemble.distance(median * np.exp(sigma * self.coordinates))

    @property
    def inside(self) -> bool:
        """True if the 95 % region of all dimensions together has the stage."""
        return self.distance <= chi2.ppf(0.95, self.coordinates.size)

    def dimensions_held(self) -> dict[str, bool]:
        """Return whether the 95 % range of each dimension has the truth."""
        names = [d.name for d in self.ensemble.dimensions]
        median = np.array([d.median for d in self.ensemble.dimensions])
        sigma = np.array([d.sigma for d in self.ensemble.dimensions])
        truths = dict(zip(names, median * np.exp(sigma * self.coordinates), strict=True))
        return {
            row.dimension.name: bool(row.low <= truths[row.dimension.name] <= row.high)
            for row in self.ensemble.dimension_rows()
        }

    def figures_held(self) -> dict[str, bool]:
        """Return whether the 95 % range of each predicted figure has the truth."""
        return {
            row.figure.name: bool(row.low <= self.truth[row.figure] <= row.high)
            for row in self.ensemble.figure_rows()
            if row.kind == "predicted" and row.figure in self.truth and not row.zero
        }


def bridge_dimensions() -> tuple[StageTemplate, list[FreeDimension]]:
    """Return the bridge and its hidden dimensions."""
    template = StageTemplate.of("bridge")
    return template, [dimension_of(v) for v in variables_of(template, HIDDEN)]


def cases(count: int, *, seed: int, model: str = "lumped", members: int = 0) -> Iterator[Case]:
    """Yield hidden bridges, found from three figures with the noise that is stated for them."""
    template, dimensions = bridge_dimensions()
    figures = tuple(Figure(quantity=q, axis="y") for q in PREDICTED[:-1])
    figures = (*GIVEN, *figures, Figure(quantity=PREDICTED[-1], axis=WHOLE_STAGE))
    generator = np.random.default_rng(seed)
    for _ in range(count):
        yield _case(template, dimensions, figures, generator, model, members, seed)


def case_of_design(k: int, *, seed: int, model: str = "superelement") -> Case:
    """Return a hidden stage of the k-th design in turn, found from the figures of the study.

    Five of its dimensions are drawn, known to 20 % before. All figures of the model are compared.
    """
    # each is the same whatever was drawn before
    generator = np.random.default_rng([seed, k])
    template = StageTemplate.of(ONE_PLATE[k % len(ONE_PLATE)])
    free = free_variables(template)
    chosen = generator.choice(len(free), size=len(HIDDEN), replace=False)
    dimensions = [dimension_of(free[i]) for i in sorted(chosen.tolist())]
    rows = analyse_model(template.stage(), model).characteristics
    figures = tuple(Figure(quantity=row.quantity, axis=row.axis) for row in rows)
    return _case(template, dimensions, figures, generator, model, 0, seed)


def _case(
    template: StageTemplate,
    dimensions: Sequence[FreeDimension],
    figures: Sequence[Figure],
    generator: np.random.Generator,
    model: str,
    members: int,
    seed: int,
) -> Case:
    family = Family(template=template, variables=tuple(d.variable for d in dimensions))
    median = np.array([d.median for d in dimensions])
    sigma = np.array([d.sigma for d in dimensions])
    given = [figure for figure in figures if figure.quantity in STUDY]
    z, values = _feasible(family, median, sigma, figures, generator, model)
    truth = dict(zip(figures, values.tolist(), strict=True))
    true = np.array([truth[figure] for figure in given])
    # the model errs in other figures too
    truth |= {
        figure: value * math.exp(model_error(figure) * generator.standard_normal())
        for figure, value in truth.items()
        if figure not in given
    }
    noise = np.array([model_error(figure) for figure in given])
    seen = true * np.exp(noise * generator.standard_normal(len(given)))
    observations = [
        Observation(figure=f, value=v) for f, v in zip(given, seen.tolist(), strict=True)
    ]
    found = reconstruct(template, observations, dimensions, model=model, members=members, seed=seed)
    return Case(coordinates=z, truth=truth, ensemble=found)


def _feasible(
    family: Family,
    median: np.ndarray,
    sigma: np.ndarray,
    figures: Sequence[Figure],
    generator: np.random.Generator,
    model: str,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinates of a stage that can be built, and its figures."""
    while True:
        z = generator.standard_normal(median.size)
        point = median * np.exp(sigma * z)
        try:
            family.stage(point)
        except FlexstageError:
            continue
        evaluation = evaluate(family, point[None], figures, model)
        if not evaluation.faults[0]:
            return z, evaluation.values[0]
