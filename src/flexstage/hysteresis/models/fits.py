"""How each hysteresis model is fitted: the linear parameters, and those that are searched for."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    FitResult,
    LinearFit,
    equations,
    folds_of,
)
from flexstage.hysteresis.identification.nonlinear_fit import RefinedFit, SearchedFit, roughness
from flexstage.hysteresis.identification.projection import Normal, residual_square
from flexstage.hysteresis.models.asymmetric_bouc_wen.law import AsymmetricBoucWen
from flexstage.hysteresis.models.bouc_wen.law import BoucWen
from flexstage.hysteresis.models.bouc_wen_common import BoucWenModel
from flexstage.hysteresis.models.dahl.law import Dahl
from flexstage.hysteresis.models.duhem.law import Duhem, duhem_columns
from flexstage.hysteresis.models.generalised_bouc_wen.law import GeneralisedBoucWen
from flexstage.hysteresis.models.line.law import Line
from flexstage.hysteresis.models.maxwell_slip.law import GeneralisedMaxwellSlip
from flexstage.hysteresis.models.modified_prandtl_ishlinskii.law import ModifiedPrandtlIshlinskii
from flexstage.hysteresis.models.play_sum import play_columns
from flexstage.hysteresis.models.prandtl_ishlinskii.law import PrandtlIshlinskii
from flexstage.hysteresis.models.preisach.law import Preisach, preisach_columns


class LineFit(LinearFit):
    """A slope; the offset is fitted with every model."""

    law = Line
    size = 1

    def columns(self, section: RecordSection, data: FitData) -> Iterator[Array]:
        yield section.u[:, None]

    def build(self, coefficients: Array, data: FitData) -> Line:
        return Line(gain=float(coefficients[0]))


#: Number of plays.
_PLAYS = 20
#: Smallest slope, over the mean slope, of plays that other fits begin with, and of a line behind
#: plays: both must have an inverse.
_FLATTEST = 0.05


def _thresholds(data: FitData) -> Array:
    """Thresholds of plays over the range that the input determines.

    Small loops need more of them than large ones, so their distance grows; none is zero.
    """
    # a play of more than half of the range moves once, on the way out of rest
    share = np.arange(1, _PLAYS + 1) / (_PLAYS + 1)
    return 0.5 * data.input_scale * share**1.5


class PrandtlIshlinskiiFit(LinearFit):
    """Weights of plays that are not negative."""

    law = PrandtlIshlinskii
    size = 1 + _PLAYS
    automatic = False

    def columns(self, section: RecordSection, data: FitData) -> Iterator[Array]:
        yield np.column_stack((section.u, play_columns(section.u, _thresholds(data))))

    def build(self, coefficients: Array, data: FitData) -> PrandtlIshlinskii:
        return PrandtlIshlinskii(
            gain=float(coefficients[0]), thresholds=_thresholds(data), weights=coefficients[1:]
        )


def _start(fit: RefinedFit, data: FitData, count: int) -> tuple[PrandtlIshlinskii, Array]:
    """Return plays, and kinks of a line behind them: uniform over their output, and not at zero.

    Those of the first fit are kept, so that the kinks stay where they are when cycles are held out.
    """
    key = f"{fit.kind} start"
    if key not in data.memo:
        plays = PrandtlIshlinskiiFit().fit(data).model
        ends = [plays.simulate(s.u).values[s.warm_up :] for s in data.sections]
        low, high = min(e.min() for e in ends), max(e.max() for e in ends)
        kinks = np.linspace(low, high, count + 2)[1:-1]
        least = 0.05 * (high - low) / (count + 1)
        data.memo[key] = plays, np.where(np.abs(kinks) < least, least, kinks)
    return data.memo[key]


#: Places where the line behind the plays may bend.
_LINE_KINKS = 8
#: Weight of the penalty on second differences.
_SMOOTHING = 3e-4


class ModifiedPrandtlIshlinskiiFit(RefinedFit):
    """Plays, and the slopes of the line behind them; begun from plays alone.

    Parameters: gain, weights of plays, then slopes of the line. The penalty is on second
    differences of weights and of slopes.
    """

    law = ModifiedPrandtlIshlinskii
    size = 1 + _PLAYS + _LINE_KINKS
    penalty = _SMOOTHING * roughness(1, _PLAYS, _LINE_KINKS + 1)

    def begin(self, data: FitData) -> Array:
        model, kinks = _start(self, data, _LINE_KINKS)
        return np.concatenate(([model.gain], model.weights, np.ones(kinks.size + 1)))

    def bounds(self, data: FitData) -> tuple[Array, Array]:
        slope = data.stroke / data.input_scale
        low = np.zeros(2 + _PLAYS + _LINE_KINKS)
        low[0] = 1e-3 * slope
        low[1 + _PLAYS :] = _FLATTEST
        scale = np.full(low.size, slope)
        scale[1 + _PLAYS :] = 1.0
        return low, scale

    def build(self, parameters: Array, data: FitData) -> ModifiedPrandtlIshlinskii:
        start, kinks = _start(self, data, _LINE_KINKS)
        gain, weights = parameters[0], parameters[1 : 1 + _PLAYS]
        slopes = parameters[1 + _PLAYS :]
        about_zero = slopes[int(np.searchsorted(kinks, 0.0))]
        change = np.diff(slopes) / about_zero
        return ModifiedPrandtlIshlinskii(
            gain=gain * about_zero,
            thresholds=start.thresholds,
            weights=weights * about_zero,
            dead_zones=kinks * about_zero,
            dead_zone_weights=np.where(kinks > 0.0, change, -change),
        )

    def changes(self, p: Array, scale: Array, section: RecordSection, data: FitData) -> Array:
        # in closed form: with v the sum of the plays and S the line behind them, S(v) changes by
        # S'(v) with what a play adds to v, and by the way from 0 to v within an interval with its
        # slope
        start, kinks = _start(self, data, _LINE_KINKS)
        slopes = p[1 + _PLAYS :]
        columns = play_columns(section.u, start.thresholds)
        v = p[0] * section.u + columns @ p[1 : 1 + _PLAYS]
        ends = np.concatenate(([-np.inf], kinks, [np.inf]))
        derivatives = np.empty((section.u.size, p.size), order="F")
        slope = slopes[np.searchsorted(kinks, v)]
        derivatives[:, 0] = slope * section.u
        derivatives[:, 1 : 1 + _PLAYS] = slope[:, None] * columns
        for j, (low, high) in enumerate(itertools.pairwise(ends), start=1 + _PLAYS):
            derivatives[:, j] = np.clip(v, low, high) - np.clip(0.0, low, high)
        return derivatives * scale


#: Kinks of the spring; there are as many elements as plays.
_SPRING_KINKS = 6


class GeneralisedMaxwellSlipFit(RefinedFit):
    """Springs, sliders and a bent spring; begun from the exact inverse of plays alone.

    Parameters: stiffness, those of the elements, then the kinks of the spring. The penalty is on
    second differences of stiffnesses and of kinks.
    """

    law = GeneralisedMaxwellSlip
    size = 1 + _PLAYS + _SPRING_KINKS
    penalty = _SMOOTHING * roughness(1, _PLAYS, _SPRING_KINKS)

    def begin(self, data: FitData) -> Array:
        gain, _, weights = self._inverse(data)
        # a play is the displacement less a stop, so that negative plays are stops and a spring
        return np.concatenate(([gain + weights.sum()], -weights, np.zeros(_SPRING_KINKS)))

    def bounds(self, data: FitData) -> tuple[Array, Array]:
        slope = data.input_scale / data.stroke
        low = np.zeros(self.size)
        low[0] = 1e-3 * slope
        low[1 + _PLAYS :] = -np.inf
        return low, np.full(self.size, slope)

    def build(self, parameters: Array, data: FitData) -> GeneralisedMaxwellSlip:
        _, thresholds, _ = self._inverse(data)
        return GeneralisedMaxwellSlip(
            stiffness=float(parameters[0]),
            thresholds=thresholds,
            element_stiffness=parameters[1 : 1 + _PLAYS],
            dead_zones=_start(self, data, _SPRING_KINKS)[1],
            dead_zone_weights=parameters[1 + _PLAYS :],
        )

    def changes(self, p: Array, scale: Array, section: RecordSection, data: FitData) -> Array:
        # in closed form: the voltage is given, so that what a parameter adds to it the displacement
        # y takes away again, by the slope of all springs at y less that of the sliders that slide;
        # those that stick keep the change that they had where they last slid
        model = self.build(p, data)
        y = model.simulate(section.u).values
        sliders = play_columns(y, model.thresholds)
        beyond = y[:, None] - model.dead_zones
        beyond = np.where(beyond * np.sign(model.dead_zones) > 0.0, beyond, 0.0)
        slope = model.stiffness + (beyond != 0.0) @ model.dead_zone_weights
        derivatives = np.column_stack((y, y[:, None] - sliders, beyond))
        _given_voltage(derivatives, sliders, slope, model.element_stiffness)
        return derivatives * scale

    def _inverse(self, data: FitData) -> tuple[float, Array, Array]:
        """Return the inverse of the plays of the start."""
        plays, _ = _start(self, data, _SPRING_KINKS)
        # plays that stand still after a turn, as where noise of the input or a delay blunts it,
        # have no inverse; some slope there is enough to begin with
        least = _FLATTEST * data.stroke / data.input_scale
        return replace(plays, gain=max(plays.gain, least)).inverse_plays()


@compiled
def _given_voltage(derivatives: Array, sliders: Array, slope: Array, stiffness: Array) -> None:
    """Turn changes of the voltage at given displacements into those of the displacement."""
    sticking = np.zeros((sliders.shape[1], derivatives.shape[1]))
    before = np.zeros(sliders.shape[1])
    for n in range(derivatives.shape[0]):
        now, total = derivatives[n], slope[n]
        for i in range(before.size):
            if sliders[n, i] == before[i]:
                total += stiffness[i]
                for q in range(now.size):
                    now[q] -= stiffness[i] * sticking[i, q]
        for q in range(now.size):
            now[q] /= -total
        for i in range(before.size):
            if sliders[n, i] != before[i]:
                before[i] = sliders[n, i]
                sticking[i] = now


#: Candidate weights of the penalty on second differences of the density, from little to much noise.
_DENSITY_SMOOTHING = (3e-8, 3e-7, 3e-6, 3e-5)
#: Parts of the cycles that are held out in turn to choose the weight.
_PARTS = 4


class PreisachFit(LinearFit):
    """A density of relays on a grid of thresholds and means, smooth and not negative.

    Means are intervals of the plays' outputs. `smoothing` is the weight of the penalty on second
    differences of the density; None for the weight that best predicts held-out cycles.
    """

    law = Preisach

    def __init__(
        self, thresholds: int = 16, means: int = 16, smoothing: float | None = None
    ) -> None:
        self._thresholds, self._means, self._given = thresholds, means, smoothing
        self.size = thresholds * means
        self.floored = means  # those of threshold zero

    def _grid(self, data: FitData) -> tuple[Array, Array]:
        low, high = data.input_range
        # a play of more than half of the range moves once, on the way out of rest
        thresholds = 0.5 * (high - low) * np.arange(self._thresholds) / self._thresholds
        return thresholds, np.linspace(low, high, self._means + 1)

    def columns(self, section: RecordSection, data: FitData) -> Iterator[Array]:
        thresholds, knots = self._grid(data)
        for threshold in thresholds:
            yield preisach_columns(section.u, [threshold], knots)

    def build(self, coefficients: Array, data: FitData) -> Preisach:
        thresholds, knots = self._grid(data)
        slopes = coefficients.reshape(self._thresholds, self._means)
        return Preisach(thresholds=thresholds, knots=knots, slopes=slopes)

    def smoothing(self, data: FitData, moving: NDArray[np.bool_]) -> Array:
        # second differences along thresholds and along means; the first threshold, zero, is a gain
        # without memory and no neighbour of the others
        m, p = self._thresholds, self._means
        along = np.kron(np.eye(m), np.diff(np.eye(p), 2, axis=0))
        skip = np.zeros((m - 1, m))
        skip[:, 1:] = np.eye(m - 1)
        across = np.kron(np.diff(skip, 2, axis=0), np.eye(p))
        rows = np.concatenate((along, across))
        # densities without samples are no neighbours of the others
        rows = rows[~np.any((rows != 0.0) & ~moving, axis=1)]
        return self._weight(data) * (rows.T @ rows)

    def fit(self, data: FitData, start: Array | None = None) -> FitResult:
        key = f"{self.kind} smoothing"
        if self._given is None and key not in data.memo:
            data.memo[key] = [np.array(self._best_weight(data))]
        return super().fit(data, start)

    def _weight(self, data: FitData) -> float:
        if self._given is not None:
            return self._given
        weight = data.memo.get(f"{self.kind} smoothing")
        return _DENSITY_SMOOTHING[2] if weight is None else float(weight[0])

    def _best_weight(self, data: FitData) -> float:
        behind, _ = self.moving(data)
        # one run each: a density must also be valid slightly outside the fitted cycles
        folds = folds_of(data, _PARTS, runs=1)
        if len(folds) < 2:
            return _DENSITY_SMOOTHING[2]
        parts = [equations(behind, data.with_use(fold)) for fold in folds]
        total = equations(behind, data, self.kind)
        squares = {w: self._held_out(w, total, parts, data) for w in _DENSITY_SMOOTHING}
        best = min(_DENSITY_SMOOTHING, key=lambda w: squares[w].sum())
        # the smoothest that is equally good within the scatter between parts
        for weight in sorted(_DENSITY_SMOOTHING, reverse=True):
            worse = squares[weight] - squares[best]
            if worse.mean() <= worse.std(ddof=1) / np.sqrt(worse.size):
                return weight
        return best

    def _held_out(self, weight: float, total: Normal, parts: list[Normal], data: FitData) -> Array:
        """Mean square residual of each part, fitted to the others."""
        method = PreisachFit(self._thresholds, self._means, weight)
        squares = []
        for part in parts:
            if part.count in (0, total.count):
                continue
            # with the nuisance coefficients of the fitted parts, as in use
            solution = method.solution(total - part, data)
            squares.append(residual_square(part, solution) / part.count)
        return np.array(squares)


#: Range of the slope of friction over its limit, times the range of the input, in powers of ten.
_FRICTION = (-0.5, 2.5)


class DahlFit(SearchedFit):
    """One parameter is searched for: the model is linear in its gain and in friction."""

    law = Dahl
    size = 3
    automatic = False
    grid = (16,)

    def columns(self, section: RecordSection, place: Array, data: FitData) -> Array:
        unit = Dahl(gain=0.0, stiffness=1.0, limit=_limit(place, data.input_scale))
        return np.column_stack((section.u, unit.simulate(section.u).values))

    def build(self, place: Array, coefficients: Array, data: FitData) -> Dahl:
        stiffness = _at_least(coefficients[1], data)
        limit = stiffness * _limit(place, data.input_scale)
        return Dahl(gain=float(coefficients[0]), stiffness=stiffness, limit=limit)


def _limit(place: Array, scale: float) -> float:
    """Limit of friction of unit slope, in the unit of the input."""
    return float(scale / 10.0 ** _within(_FRICTION, place[0]))


def _within(limits: tuple[float, float], share: float) -> float:
    """Return the value at a share of a range of search."""
    return float(limits[0] + share * (limits[1] - limits[0]))


def _at_least(coefficient: float, data: FitData) -> float:
    """Return a slope above zero, however small its coefficient is."""
    return max(float(coefficient), 1e-12 * data.stroke / data.input_scale)


#: Range of alpha times the range of the input, in powers of ten.
_RATE = (-0.5, 2.0)
#: Coefficients of f and of g.
_CURVE, _TANGENT = 4, 2
#: Penalty on the square of the constant of f. After the initial movement its effect is that of the
#: offset, and without a penalty both grow to many strokes of opposite sign.
_CONSTANT = 3e-9


class DuhemFit(SearchedFit):
    """One parameter, alpha, is searched for: the output is linear in those of f and g."""

    law = Duhem
    size = 1 + _CURVE + _TANGENT
    automatic = False
    grid = (16,)
    free = np.ones(_CURVE + _TANGENT, dtype=bool)
    penalty = np.diag([_CONSTANT, *[0.0] * (_CURVE + _TANGENT - 1)])

    def columns(self, section: RecordSection, place: Array, data: FitData) -> Array:
        return duhem_columns(section.u, _rate(place, data), _CURVE, _TANGENT)

    def build(self, place: Array, coefficients: Array, data: FitData) -> Duhem:
        low, high = data.input_range
        return Duhem(
            rate=_rate(place, data),
            anhysteretic=coefficients[:_CURVE],
            tangent=coefficients[_CURVE:],
            input_range=(min(low, 0.0), max(high, 0.0)),
        )


def _rate(place: Array, data: FitData) -> float:
    return float(10.0 ** _within(_RATE, place[0]) / data.input_scale)


#: Range of (beta + gamma) times the range of the input, in powers of ten, ...
_STIFFNESS = (-1.0, 2.5)
#: ... and of (beta - gamma) / (beta + gamma).
_RATIO = (-0.95, 5.0)


def shape_at(place: Array, scale: float) -> tuple[float, float]:
    """Return beta and gamma [per unit of the input] of a place, for a part of unit gain."""
    total, ratio = 10.0 ** _within(_STIFFNESS, place[0]) / scale, _within(_RATIO, place[1])
    return 0.5 * total * (1.0 + ratio), 0.5 * total * (1.0 - ratio)


class BoucWenFit(SearchedFit):
    """Two parameters are searched for: a Bouc-Wen model is linear in its two gains.

    Put h = A g; then g' = u' - beta |u'| g - gamma u' |g|. With beta and gamma given, the output
    d u - A g is linear in d and A. The exponent is 1: records of piezo drives do not determine it.
    """

    law = BoucWen
    size = 4
    grid = (8, 6)

    def columns(self, section: RecordSection, place: Array, data: FitData) -> Array:
        beta, gamma = shape_at(place, data.input_scale)
        unit = BoucWen(gain=0.0, hysteresis_gain=1.0, beta=beta, gamma=gamma)
        return np.column_stack((section.u, unit.simulate(section.u).values))

    def build(self, place: Array, coefficients: Array, data: FitData) -> BoucWenModel:
        beta, gamma = shape_at(place, data.input_scale)
        gain = _at_least(coefficients[1], data)
        return BoucWen(gain=float(coefficients[0]), hysteresis_gain=gain, beta=beta, gamma=gamma)


class AsymmetricBoucWenFit(BoucWenFit):
    """Two parameters are searched for: the model is linear in its cubic and its gain."""

    law = AsymmetricBoucWen
    size = 6
    automatic = False
    free = np.array([False, True, True, False])

    def columns(self, section: RecordSection, place: Array, data: FitData) -> Array:
        u, h = super().columns(section, place, data).T
        return np.column_stack((u, u**2, u**3, h))

    def build(self, place: Array, coefficients: Array, data: FitData) -> BoucWenModel:
        beta, gamma = shape_at(place, data.input_scale)
        low, high = data.input_range
        return AsymmetricBoucWen(
            gain=float(coefficients[0]),
            quadratic=float(coefficients[1]),
            cubic=float(coefficients[2]),
            hysteresis_gain=_at_least(coefficients[3], data),
            beta=beta,
            gamma=gamma,
            lowest_input=min(low, 0.0),
            highest_input=max(high, 0.0),
        )


#: Signs of the rate, and of the input about the centre, in the four regions of loading.
_BY_RATE = np.array([-1.0, -1.0, 1.0, 1.0])
_BY_SIDE = np.array([-1.0, 1.0, -1.0, 1.0])
#: Least value of the shape function where loaded, times the range of the input.
_LEAST = 0.01
#: Largest value of the shape function where unloaded, over the least one where loaded.
_BELOW = 0.99


class GeneralisedBoucWenFit(RefinedFit):
    """Two gains and the shape function, bounded; begun from the best Bouc-Wen model.

    The shape is searched for as its values in the four loading regions, which are kept above zero,
    and two differences between unloading regions: so the hysteretic part cannot grow without limit
    on an input that it was not fitted to.
    """

    law = GeneralisedBoucWen
    size = 8
    automatic = False

    def begin(self, data: FitData) -> Array:
        # the two gains, the shape function where loaded, two differences
        key = f"{self.kind} start"
        if key not in data.memo:
            plain = BoucWenFit().fit(data).model
            assert isinstance(plain, BoucWen)
            # gamma sgn(x h) comes next to the gamma of Bouc-Wen, which has no place in the shape
            loaded = plain.beta + plain.gamma * _BY_SIDE * _BY_RATE
            gains = [plain.gain, plain.hysteresis_gain]
            data.memo[key] = [np.array([*gains, *loaded, -plain.gamma, 0.0])]
        return data.memo[key][0].copy()

    def bounds(self, data: FitData) -> tuple[Array, Array]:
        slope = data.stroke / data.input_scale
        low = np.full(8, -np.inf)
        low[:2] = 0.0, 1e-6 * slope
        low[2:6] = _LEAST / data.input_scale
        scale = np.full(8, 10.0 / data.input_scale)
        scale[:2] = slope
        return low, scale

    def build(self, parameters: Array, data: FitData) -> GeneralisedBoucWen:
        low, high = data.input_range
        return GeneralisedBoucWen(
            gain=float(parameters[0]),
            hysteresis_gain=float(parameters[1]),
            shape=_bounded(parameters[2:6], *parameters[6:]),
            centre=0.5 * (low + high),
        )


def _bounded(loaded: Array, by_both: float, by_rate: float) -> tuple[float, ...]:
    """Six numbers of a shape that is positive where loaded, and smaller where unloaded."""
    rate, side = _BY_RATE, _BY_SIDE
    mean, by_side = float(np.mean(loaded)), float(np.mean(loaded * side))
    # where unloaded, psi is by_side * side - mean + change; h comes no further than A / psi loaded
    change = by_both * side * rate + by_rate * rate
    room = _BELOW * float(np.min(loaded)) + mean - by_side * side
    share = 1.0 / max(1.0, float(np.max(change / room)))
    both, alone = float(np.mean(loaded * side * rate)), float(np.mean(loaded * rate))
    return (
        mean,
        0.5 * (both + share * by_both),
        0.5 * (both - share * by_both),
        0.5 * (alone + share * by_rate),
        0.5 * (alone - share * by_rate),
        by_side,
    )
