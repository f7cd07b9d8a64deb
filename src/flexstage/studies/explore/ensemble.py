"""Result of a reconstruction: figures with ranges, dimensions, and what to measure next."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.provenance import Provenance
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.measure.posterior import Posterior
from flexstage.quantities.quantity import number
from flexstage.stage import Stage
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.family import Family, evaluate
from flexstage.studies.explore.figures import Figure, Requirement, figure_of
from flexstage.studies.explore.variables import Variable

#: Error of a superelement model from mesh to mesh, as a share of a figure [1].
MODEL_ERROR = 5e-3
#: The same of a stress, and of safety factors that follow from it [1].
STRESS_ERROR = 1e-2
_STRESS = ("max_stress", "safety_factor", "fatigue_safety")
# what follows from the drawing alone, without a mesh
_EXACT = (
    "input_displacement",
    "mass",
    "moving_mass",
    "width",
    "height",
    "thickness",
    "smallest_neck",
    "smallest_slot",
    "smallest_wall",
    "output_wall",
)
#: Assumed noise of a further measurement: a caliper [m], an autocollimator [rad], a capacitive
#: sensor of 10 nm over a stroke of 0.1 mm [1] and over one kelvin [m/K].
CALIPER, AUTOCOLLIMATOR, ACROSS, DRIFT = 1e-4, 1e-6, 1e-4, 1e-8
_NOISE = {
    "parasitic_rotation": AUTOCOLLIMATOR,
    "cross_coupling": ACROSS,
    "thermal_drift": DRIFT,
    "width": CALIPER,
    "height": CALIPER,
    "thickness": CALIPER,
}
# figures that a bench measures; others follow from them, or cannot be measured
_MEASURABLE = (
    *_NOISE,
    "output_displacement",
    "natural_frequency_hz",
    "input_stiffness",
    "output_stiffness",
    "mass",
)
_NORMAL = 1.959963984540054
#: Difference of standard deviations or medians, over Laplace's standard deviation, beyond which the
#: ensemble replaces Laplace's approximation [1].
DISAGREEMENT = 0.3
#: The same in sampling errors, which 1.25/sqrt(n) is for the median of n members: chance exceeds it
#: in some 1 % of figures.
CHANCE = 2.5
#: Fewest members whose standard deviation counts: it is known to 11 %.
FEWEST_MEMBERS = 40
#: Standard deviation from mesh to mesh of a figure that an ideal stage does not have, and its least
#: value with a range, in parts of the assumed noise of a measurement: it is 0.14 for the drift of
#: linked parallelograms; symmetric bridges turn by up to 0.05.
_MESH = 0.2

Kind = Literal["given", "predicted"]
Origin = Literal["Laplace", "ensemble"]
#: What ended the members early: nothing, the time, refused draws, or Ctrl-C.
Stop = Literal["", "time", "draws", "interrupted"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """A published or measured figure."""

    figure: Figure
    """The figure."""
    value: float
    """Its value, in the unit of the figure."""
    uncertainty: float = 0.0
    """Standard uncertainty of the value, in its unit; that of the model is added. One of 0 is that
    of `noise_of` for a figure without an error of the model, such as the mass.
    """

    def __post_init__(self) -> None:
        if not (math.isfinite(self.value) and 0.0 <= self.uncertainty < math.inf):
            raise ModelError(
                f"{self.figure.name} needs a finite value and an uncertainty of 0 or more, got "
                f"{self.value!r} and {self.uncertainty!r}"
            )
        if not self.spread > 0.0:
            raise ModelError(
                f"{self.figure.name} = 0 needs an uncertainty, such as +- "
                f"{self.figure.text(noise_of(self.figure, 0.0))}"
            )

    @property
    def logarithmic(self) -> bool:
        """True if the logarithm of the figure is taken to be normal."""
        return self.value > 0.0 and self.figure.display.zero == 0.0

    @property
    def spread(self) -> float:
        """Standard deviation of value and model together, of the logarithm if that is normal."""
        error = model_error(self.figure)
        exact = not self.uncertainty and not error
        uncertainty = noise_of(self.figure, self.value) if exact else self.uncertainty
        both = math.hypot(uncertainty, error * self.value)
        return both / self.value if self.logarithmic else both


def observation_of(target: Requirement) -> Observation:
    """Return the given figure of a value with a tolerance, its standard uncertainty."""
    assert target.low is not None
    assert target.high is not None
    return Observation(
        figure=target.figure,
        value=0.5 * (target.low + target.high),
        uncertainty=0.5 * (target.high - target.low),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeDimension:
    """A free dimension, log-normal before."""

    variable: Variable
    """The dimension."""
    median: float
    """Median before [SI]."""
    sigma: float
    """Standard deviation of its logarithm before [1]."""

    @property
    def name(self) -> str:
        """Name of the dimension."""
        return self.variable.name


@dataclass(frozen=True, slots=True, kw_only=True)
class NextMeasurement:
    """A further measurement, and what it leaves of the spread of a figure."""

    name: str
    """Name of the measured figure or dimension."""
    noise: float
    """Standard uncertainty of the measurement, in its unit, without that of the model."""
    noise_text: str
    """The same with its unit."""
    remaining: float
    """Standard deviation of the wanted figure after it, over that before [1]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ranges:
    """A median and a 95 % range, of a figure or a dimension."""

    median: float
    """Median."""
    low: float
    """Lower end of the 95 % range, of a predicted figure with the error of the model; NaN for one
    that is zero but for the mesh.
    """
    high: float
    """Upper end of the 95 % range, likewise."""
    by: Origin
    """Origin of median and range."""
    before: float
    """Standard deviation before, of the logarithm of a figure if that is normal."""
    laplace: float
    """Standard deviation by Laplace's approximation, likewise."""
    ensemble: float | None
    """Standard deviation of the members, likewise; None with few members."""

    @property
    def remaining(self) -> float:
        """Standard deviation after over that before, by the origin of the range [1]."""
        after = self.laplace if self.ensemble is None or self.by == "Laplace" else self.ensemble
        return after / self.before

    @property
    def ends(self) -> Array:
        """Median and both ends of the range, shape (3,)."""
        return np.array([self.median, self.low, self.high])


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureRow(_Ranges):
    """A figure with its range, in its unit."""

    figure: Figure
    """The figure."""
    kind: Kind
    """``given``, or ``predicted`` from the given ones."""
    described: float
    """Value of the described stage."""
    best: float
    """Value of the most probable stage."""

    @property
    def zero(self) -> bool:
        """True for a figure that is zero but for the mesh, which has no range."""
        return math.isnan(self.low)

    @property
    def agreement(self) -> float | None:
        """Standard deviation of the members over Laplace's one [1]; None without either."""
        if self.ensemble is None or not self.laplace:
            return None
        return self.ensemble / self.laplace


@dataclass(frozen=True, slots=True, kw_only=True)
class DimensionRow(_Ranges):
    """A dimension before and after [SI]; standard deviations are in those before."""

    dimension: FreeDimension
    """The dimension and what is known before."""


def _ranges(middle: float, spread: float, of_members: Array, before: float = 1.0) -> _Ranges:
    """Return the range by Laplace's approximation, or by members that disagree with it."""
    members = of_members[np.isfinite(of_members)]
    ends = [middle, middle - _NORMAL * spread, middle + _NORMAL * spread]
    by: Origin = "Laplace"
    deviation = None if len(members) < FEWEST_MEMBERS else float(members.std(ddof=1))
    if deviation is not None:
        # by positions p (n + 1), so that of few members as many further ones are within as of many
        of_them = np.quantile(members, [0.5, 0.025, 0.975], method="weibull").tolist()
        apart = max(abs(deviation - spread), abs(of_them[0] - middle))
        if apart > disagreement(len(members)) * spread:
            ends, by = of_them, "ensemble"
    median, low, high = ends
    return _Ranges(
        median=median, low=low, high=high, by=by, before=before, laplace=spread, ensemble=deviation
    )


def _with_ends(ranges: _Ranges, ends: Array) -> dict[str, Any]:
    """Return the fields of a range with another median and other ends."""
    median, low, high = ends.tolist()
    values = {f.name: getattr(ranges, f.name) for f in fields(_Ranges)}
    return values | {"median": median, "low": low, "high": high}


def disagreement(members: int) -> float:
    """Return the difference beyond which so many members replace Laplace's approximation [1].

    Examples
    --------
    >>> disagreement(400), round(disagreement(40), 2)
    (0.3, 0.49)
    """
    return max(DISAGREEMENT, CHANCE * 1.25 / math.sqrt(members))


def _widened(ends: Array, error: float) -> Array:
    """Return median and ends of a range with a further standard error of the figure."""
    away = np.hypot(ends - ends[0], [0.0, _NORMAL * error, _NORMAL * error])
    return ends[0] + np.array([0.0, -1.0, 1.0]) * away


def model_error(figure: Figure) -> float:
    """Return the relative error of a superelement model by its mesh [1]; 0 without a mesh."""
    if figure.quantity in _EXACT:
        return 0.0
    return STRESS_ERROR if figure.quantity in _STRESS else MODEL_ERROR


def _mesh_alone(figure: Figure) -> float:
    """Return the scatter by the mesh of a figure that may be zero, in its unit; 0 of others."""
    return _MESH * _NOISE.get(figure.quantity, 0.0) if figure.display.zero else 0.0


def noise_of(figure: Figure, value: float) -> float:
    """Return the assumed noise of a measurement of a figure, in its unit."""
    return _NOISE.get(figure.quantity, MODEL_ERROR * abs(value))


def _noise_text(noise: float, factor: float, unit: str) -> str:
    return f"{number(noise * factor, 2)} {unit}".strip()


def scaled(values: Array, logarithmic: NDArray[np.bool_]) -> Array:
    """Return values, or their logarithms where these are normal; NaN without one.

    Examples
    --------
    >>> scaled(np.array([1.0, 2.0]), np.array([True, False])).tolist()
    [0.0, 2.0]
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(logarithmic, np.log(np.where(logarithmic, values, 1.0)), values)


def unscaled(values: Array, logarithmic: NDArray[np.bool_]) -> Array:
    """Return values of their logarithms, where these are normal: the inverse of `scaled`."""
    return np.where(logarithmic, np.exp(np.where(logarithmic, values, 0.0)), values)


def rows_of(slopes: Array, values: Array, logarithmic: NDArray[np.bool_]) -> Array:
    """Return derivatives of `scaled` values for those of the values, shape (f, p)."""
    return slopes / np.where(logarithmic, values, 1.0)[:, None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ensemble(Result):
    """Stages that agree with given figures, and the ranges of their other figures."""

    table_key: ClassVar[str] = "figures"

    template: StageTemplate
    """The described stage."""
    model: str
    """Model of the figures."""
    observations: tuple[Observation, ...]
    """Given figures."""
    dimensions: tuple[FreeDimension, ...]
    """Free dimensions, and what is known of them before."""
    figures: tuple[Figure, ...]
    """All figures of the model."""
    described: Array
    """Figures of the described stage, in their units, shape (f,)."""
    logarithmic: NDArray[np.bool_]
    """True for figures whose logarithm is taken to be normal, shape (f,)."""
    coordinates: Array
    """Most probable coordinates z of the dimensions, shape (p,)."""
    best: Array
    """Dimensions of the most probable stage [SI], shape (p,)."""
    best_values: Array
    """Its figures, in their units, shape (f,)."""
    middle: Array
    """Figures, or their logarithms, at `coordinates`, shape (f,)."""
    rows: Array
    """Derivatives of figures, or of their logarithms, by the coordinates, shape (f, p)."""
    posterior: Posterior
    """Covariance of the coordinates, by Laplace's approximation."""
    points: Array
    """Dimensions of the members [SI], shape (members, p)."""
    values: Array
    """Figures of the members, in their units, shape (members, f)."""
    requested: int
    """Number of members that were asked for."""
    seed: int
    """Random seed."""
    stopped: Stop
    """Reason for fewer members than asked for."""
    refused: Mapping[str, int]
    """Refused draws: ``impossible`` ones, and those ``off`` the given figures by the model."""
    seconds: Mapping[str, float]
    """Time of ``laplace`` and of the ``members`` [s]."""
    provenance: Provenance
    """Origin of the result."""

    __repr__ = short_repr

    @property
    def family(self) -> Family:
        """The stages over their free dimensions."""
        variables = tuple(d.variable for d in self.dimensions)
        return Family(template=self.template, variables=variables)

    @property
    def members(self) -> tuple[Stage, ...]:
        """The stages of the ensemble."""
        return tuple(self.family.stage(point) for point in self.points)

    @property
    def stage(self) -> Stage:
        """The most probable stage."""
        return self.family.stage(self.best)

    @property
    def learned(self) -> dict[str, float]:
        """Part of the variance of each dimension that the given figures took away [1]."""
        learned = self.posterior.learned.tolist()
        return {d.name: part for d, part in zip(self.dimensions, learned, strict=True)}

    @property
    def informed(self) -> float:
        """Number of directions of the dimensions that the given figures inform."""
        return self.posterior.informed

    @property
    def best_coordinates(self) -> Array:
        """Coordinates of the most probable stage, shape (p,).

        Limits of the geometry set them apart from `coordinates`, which do not know them.
        """
        return self._coordinates(self.best)

    def _coordinates(self, points: Array) -> Array:
        median = np.array([d.median for d in self.dimensions])
        return np.log(points / median) / np.array([d.sigma for d in self.dimensions])

    @property
    def residuals(self) -> Array:
        """Most probable stage less given figures, in standard deviations of these, shape (n,)."""
        at = [self.figures.index(o.figure) for o in self.observations]
        return self._residuals(self.best_values[at])

    def _residuals(self, values: Array) -> Array:
        logarithmic = np.array([o.logarithmic for o in self.observations])
        observed = scaled(np.array([o.value for o in self.observations]), logarithmic)
        spread = np.array([o.spread for o in self.observations])
        return np.nan_to_num((scaled(values, logarithmic) - observed) / spread, nan=math.inf)

    @property
    def chi_squared(self) -> float:
        """Squares of `residuals` and of the coordinates of the most probable stage.

        Of the chi-squared distribution with as many degrees of freedom as there are given figures,
        where form and prior hold and the model is linear.
        """
        return float((self.residuals**2).sum() + (self.best_coordinates**2).sum())

    @property
    def probability(self) -> float:
        """Probability of a chi-squared as large as this, if form and prior are right [1]."""
        from scipy.special import chdtrc

        return float(chdtrc(len(self.observations), self.chi_squared))

    def distance(self, point: Array) -> float:
        r"""Return the distance of a stage from the most probable one, squared.

        .. math:: d = \chi^2(z) - \chi^2(\hat z), \quad
                  \chi^2(z) = \sum_k \left(\frac{f_k(z) - y_k}{s_k}\right)^2 + z^T z

        with the given figures y (or their logarithms), their spread s, the figures f of the stage
        by the model itself, and its coordinates z (`chi_squared`).

        Parameters
        ----------
        point : array
            Its dimensions, in the order of `dimensions` [SI], shape (p,).

        Returns
        -------
        float
            The distance [1], infinite for a stage that cannot be built. Stages up to the 95 %
            quantile of the chi-squared distribution with p degrees of freedom are the 95 % region.

        Notes
        -----
        Validity: exact for a linear model, as the ellipsoid of the covariance is. Where figures
        bend over what is left of the dimensions, the region follows them and the ellipsoid does
        not (A. Tarantola, Inverse Problem Theory, SIAM 2005, section 3.3). Limits of the geometry
        are not known to it.
        """
        figures = [o.figure for o in self.observations]
        values = evaluate(self.family, point[None], figures, self.model).values[0]
        z = self._coordinates(point)
        return float((self._residuals(values) ** 2).sum() + z @ z - self.chi_squared)

    def figure_rows(self) -> tuple[FigureRow, ...]:
        """Return all figures that the dimensions change, with their ranges."""
        observed = {o.figure for o in self.observations}
        spread, before = self.posterior.spread(self.rows), np.linalg.norm(self.rows, axis=1)
        of_members = scaled(self.values, self.logarithmic)
        rows = []
        for i in np.flatnonzero(self.varying).tolist():
            figure, middle = self.figures[i], float(self.middle[i])
            kind: Kind = "given" if figure in observed else "predicted"
            ranges = _ranges(middle, float(spread[i]), of_members[:, i], float(before[i]))
            size = 1.0 if self.logarithmic[i] else abs(middle)
            error = math.hypot(model_error(figure) * size, _mesh_alone(figure))
            ends = ranges.ends if kind == "given" else _widened(ranges.ends, error)
            if self.zeros[i]:
                ends = np.array([0.0, math.nan, math.nan])
            rows.append(
                FigureRow(
                    figure=figure,
                    kind=kind,
                    described=float(self.described[i]),
                    best=float(self.best_values[i]),
                    **_with_ends(ranges, unscaled(ends, self.logarithmic[i : i + 1])),
                )
            )
        return tuple(rows)

    @property
    def varying(self) -> NDArray[np.bool_]:
        """True for figures that the free dimensions change by more than rounding, shape (f,)."""
        pairs = zip(self.figures, self.middle.tolist(), strict=True)
        least = [max(figure.display.zero, 1e-9 * abs(middle)) for figure, middle in pairs]
        return np.linalg.norm(self.rows, axis=1) > np.array(least)

    @property
    def zeros(self) -> NDArray[np.bool_]:
        """True for predicted figures that are zero but for the mesh, by symmetry, shape (f,)."""
        observed = {o.figure for o in self.observations}
        least = [0.0 if f in observed else _mesh_alone(f) for f in self.figures]
        # moved meshes are less symmetric than others: members count together, by their rms
        square = np.sum(np.nan_to_num(self.values) ** 2, axis=0) / max(len(self.values), 1)
        every = np.vstack([self.described, self.best_values, np.sqrt(square)])
        return np.nan_to_num(np.abs(every)).max(axis=0) < np.array(least)

    def figure(self, name: str) -> FigureRow:
        """Return one figure with its range, by a name such as ``cross_coupling.x``."""
        figure = figure_of(name, {f.key for f in self.figures})
        for row in self.figure_rows():
            if row.figure == figure:
                return row
        raise ModelError(f"no free dimension changes {figure.name}")

    def dimension_rows(self) -> tuple[DimensionRow, ...]:
        """Return all dimensions before and after, the most informed ones first."""
        spread = np.sqrt(np.diag(self.posterior.covariance))
        median = np.array([d.median for d in self.dimensions])
        sigma = np.array([d.sigma for d in self.dimensions])
        of_members = self._coordinates(self.points)
        rows = []
        for i in np.argsort(spread).tolist():
            ranges = _ranges(float(self.coordinates[i]), float(spread[i]), of_members[:, i])
            ends = median[i] * np.exp(sigma[i] * ranges.ends)
            # a negative dimension has its larger end first
            ends[1:].sort()
            rows.append(DimensionRow(dimension=self.dimensions[i], **_with_ends(ranges, ends)))
        return tuple(rows)

    def next(
        self, figure: str, candidates: Mapping[str, float] | None = None
    ) -> tuple[NextMeasurement, ...]:
        """Rank further measurements by what they leave of the spread of a figure, best first.

        Parameters
        ----------
        figure : str
            Name of the figure to narrow, such as ``cross_coupling.x``.
        candidates : mapping, optional
            Standard uncertainty of each possible measurement, by the name of its figure or
            dimension, in the unit of the figure or SI, to which the error of the model is added;
            default: all figures that a bench measures and all dimensions, with the assumed noise
            of this module.

        Returns
        -------
        tuple of NextMeasurement
            The measurements, by Laplace's approximation.

        Raises
        ------
        ModelError
            There is no such figure or dimension, or nothing changes the figure.
        """
        known = {f.key for f in self.figures}
        target = self.figures.index(figure_of(figure, known))
        usual = self._candidates() if candidates is None else dict(candidates)
        rows, noises, texts, names = [], [], [], []
        for name, noise in usual.items():
            row, total, text = self._candidate(name, noise)
            rows.append(row)
            noises.append(total)
            texts.append(text)
            names.append(name)
        if not self.varying[target]:
            raise ModelError(f"no free dimension changes {figure}")
        if self.zeros[target]:
            raise ModelError(f"{figure} is zero but for the mesh: no measurement narrows it")
        remaining = self.posterior.remaining(
            self.rows[target], np.array(rows).reshape(-1, len(self.dimensions)), np.array(noises)
        )
        return tuple(
            NextMeasurement(
                name=names[k],
                noise=list(usual.values())[k],
                noise_text=texts[k],
                remaining=float(remaining[k]),
            )
            for k in np.argsort(remaining, kind="stable").tolist()
            if names[k] != self.figures[target].name
        )

    def _candidates(self) -> dict[str, float]:
        observed = {o.figure for o in self.observations}
        values = unscaled(self.middle, self.logarithmic)
        figures = {
            f.name: noise_of(f, value)
            for f, value, changes in zip(
                self.figures, values.tolist(), (self.varying & ~self.zeros).tolist(), strict=True
            )
            if f.quantity in _MEASURABLE and f not in observed and changes
        }
        lengths = {d.name: CALIPER for d in self.dimensions if d.variable.dimension == "length"}
        # a dimension may be a figure as well, such as the thickness
        return lengths | figures

    def _candidate(self, name: str, noise: float) -> tuple[Array, float, str]:
        """Return derivatives of a candidate, its noise with that of the model, and its noise."""
        for i, dimension in enumerate(self.dimensions):
            if dimension.name == name:
                row = np.zeros(len(self.dimensions))
                row[i] = dimension.sigma
                value = dimension.median * math.exp(dimension.sigma * self.coordinates[i])
                variable = dimension.variable
                return row, noise / abs(value), _noise_text(noise, variable.factor, variable.unit)
        figure = figure_of(name, {f.key for f in self.figures})
        i = self.figures.index(figure)
        value = float(unscaled(self.middle[i : i + 1], self.logarithmic[i : i + 1])[0])
        text = _noise_text(noise, figure.display.factor, figure.display.shown_unit)
        total = math.hypot(noise, model_error(figure) * value)
        return self.rows[i], total / value if self.logarithmic[i] else total, text

    @property
    def text(self) -> str:
        """Stage file of the most probable stage."""
        return self._text(self.best, "reconstructed", "most probable dimensions")

    def member_text(self, number: int) -> str:
        """Return the stage file of a member, by its number from 0."""
        what = f"member {number + 1} of {len(self.points)}"
        return self._text(self.points[number], f"member-{number + 1}", what)

    def _text(self, point: Array, ending: str, what: str) -> str:
        stage = self.template.stage()
        # names have 80 characters at most
        name = f"{stage.name[: 79 - len(ending)]}-{ending}"
        title = f"{(stage.title or stage.name).rstrip('. ')}, reconstructed: {what}"
        return self.family.text(point, name, title)

    def data(self) -> dict[str, Any]:
        names = [d.name for d in self.dimensions]
        return {
            "stage": self.template.source,
            **picked(self, "model", "informed", "chi_squared", "probability"),
            "given": [
                {
                    **picked(o, "figure=figure.name", "unit=figure.display.unit"),
                    **picked(o, "value", "uncertainty", "spread", "logarithmic"),
                    "residual": residual,
                }
                for o, residual in zip(self.observations, plain(self.residuals), strict=True)
            ],
            "figures": [
                {
                    **picked(row, "figure=figure.name", "unit=figure.display.unit"),
                    **picked(row, "kind", "described", "best", "median", "low", "high", "by"),
                    "logarithmic": bool(self.logarithmic[self.figures.index(row.figure)]),
                    **picked(row, "before", "laplace", "ensemble", "agreement", "remaining"),
                    "zero": row.zero,
                    "next": [] if row.zero else [plain(n) for n in self.next(row.figure.name)[:3]],
                }
                for row in self.figure_rows()
            ],
            "dimensions": [
                {
                    **picked(row, "name=dimension.name", "unit=dimension.variable.si_unit"),
                    "before": picked(row.dimension, "median", "sigma"),
                    **picked(
                        row, "median", "low", "high", "by", "laplace", "ensemble", "remaining"
                    ),
                    "learned": self.learned[row.dimension.name],
                }
                for row in self.dimension_rows()
            ],
            "best": dict(zip(names, plain(self.best), strict=True)),
            "members": [
                {
                    "dimensions": dict(zip(names, plain(point), strict=True)),
                    "figures": dict(
                        zip((f.name for f in self.figures), plain(values), strict=True)
                    ),
                }
                for point, values in zip(self.points, self.values, strict=True)
            ],
            **picked(self, "requested", "stopped", "refused", "seconds", "seed", "provenance"),
        }
