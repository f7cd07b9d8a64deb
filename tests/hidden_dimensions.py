"""Stages whose dimensions are hidden, and found again from a few of their figures."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flexstage.base.errors import FlexstageError
from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore import Ensemble, Family, Figure, FreeDimension, Observation, evaluate
from flexstage.studies.explore.ensemble import model_error
from flexstage.studies.explore.reconstruct import dimension_of, reconstruct
from flexstage.studies.explore.variables import variables_of

#: Hidden dimensions of the bridge, and one standard deviation of what is known of them before.
HIDDEN = (
    "link_offset=25 %",
    "link_length=20 %",
    "notch.neck_thickness=20 %",
    "notch.radius=20 %",
    "guide.notch.neck_thickness=20 %",
)
GIVEN = tuple(
    Figure(quantity=q, axis="y")
    for q in ("output_displacement", "natural_frequency_hz", "max_stress")
)
#: Figures that nobody gives.
PREDICTED = ("input_stiffness", "output_stiffness", "effective_mass", "gravity_sag", "moving_mass")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """A hidden stage, and what was found of it."""

    coordinates: np.ndarray
    """True dimensions, in standard deviations of what is known before, shape (5,)."""
    truth: dict[Figure, float]
    """True figures."""
    ensemble: Ensemble
    """What was found."""

    def held(self) -> dict[str, bool]:
        """Return whether the 95 % range of each dimension and predicted figure has the truth."""
        names = [d.name for d in self.ensemble.dimensions]
        median = np.array([d.median for d in self.ensemble.dimensions])
        sigma = np.array([d.sigma for d in self.ensemble.dimensions])
        truths = dict(zip(names, median * np.exp(sigma * self.coordinates), strict=True))
        held = {
            row.dimension.name: row.low <= truths[row.dimension.name] <= row.high
            for row in self.ensemble.dimension_rows()
        }
        for row in self.ensemble.figure_rows():
            if row.figure.quantity in PREDICTED:
                held[row.figure.name] = row.low <= self.truth[row.figure] <= row.high
        return held


def bridge_dimensions() -> tuple[StageTemplate, list[FreeDimension]]:
    """Return the bridge and its hidden dimensions."""
    template = StageTemplate.of("bridge")
    return template, [dimension_of(v) for v in variables_of(template, HIDDEN)]


def cases(count: int, *, seed: int, model: str = "lumped", members: int = 0) -> Iterator[Case]:
    """Yield hidden bridges, found from three figures with the noise that is stated for them."""
    template, dimensions = bridge_dimensions()
    family = Family(template=template, variables=tuple(d.variable for d in dimensions))
    median = np.array([d.median for d in dimensions])
    sigma = np.array([d.sigma for d in dimensions])
    generator = np.random.default_rng(seed)
    noise = np.array([model_error(figure) for figure in GIVEN])
    for _ in range(count):
        z = _feasible(family, median, sigma, generator)
        point = median * np.exp(sigma * z)
        figures = tuple(Figure(quantity=q, axis="y") for q in PREDICTED[:-1])
        figures = (*GIVEN, *figures, Figure(quantity=PREDICTED[-1], axis=WHOLE_STAGE))
        truth = dict(
            zip(figures, evaluate(family, point[None], figures, model).values[0], strict=True)
        )
        true = np.array([truth[figure] for figure in GIVEN])
        # the model errs in other figures too
        truth |= {
            figure: value * math.exp(model_error(figure) * generator.standard_normal())
            for figure, value in truth.items()
            if figure not in GIVEN
        }
        seen = true * np.exp(noise * generator.standard_normal(len(GIVEN)))
        given = [Observation(figure=f, value=v) for f, v in zip(GIVEN, seen.tolist(), strict=True)]
        found = reconstruct(template, given, dimensions, model=model, members=members, seed=seed)
        yield Case(coordinates=z, truth=truth, ensemble=found)


def _feasible(
    family: Family, median: np.ndarray, sigma: np.ndarray, generator: np.random.Generator
) -> np.ndarray:
    while True:
        z = generator.standard_normal(median.size)
        try:
            family.stage(median * np.exp(sigma * z))
        except FlexstageError:
            continue
        return z
