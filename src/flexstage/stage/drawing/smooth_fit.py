"""Profiles that are neither lines nor arcs, by a fit of their formulas to the drawing."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import HingeError
from flexstage.hinges import (
    Elliptical,
    Hyperbolic,
    Parabolic,
    PowerFunction,
    Profile,
    RightCircular,
)
from flexstage.stage.drawing.notch import NeckFrame, Sides, quarter
from flexstage.stage.drawing.strokes import DrawnStroke, Pair, rounded


@dataclass(frozen=True, slots=True)
class _FitRules:
    """Limits of the fits."""

    corner: float = math.radians(40.0)
    """A corner that turns more than this ends a smooth side [rad]."""
    tangent: float = 0.05
    """Largest angle between an arc and a line of the same curve [rad]."""
    chord: float = 0.5e-6
    """Largest distance of chords between points on arcs from these [m]."""
    long: float = 2.5
    """A line that is longer than the curve before it by this factor belongs to a body [1]."""
    fewest: int = 9
    """Fewest points of a side that is fitted."""
    most: int = 160
    """Most points of a side that is fitted."""
    steps: tuple[int, int] = (12, 60)
    """Steps until a fit is near, and in all."""
    near: float = 1e-2
    """Largest distance of a fit that is near, in sizes of the notch."""


_RULES = _FitRules()


class Chains(NamedTuple):
    """The two sides of a neck, each in the direction of its contour, up to a corner."""

    right: Array
    """Points of the right side, shape (n, 2) [m]."""
    left: Array
    """Points of the left side [m]."""
    straight: tuple[bool, bool]
    """True where the right, or the left, side is one straight line."""


def smooth_fits(sides: Sides) -> Iterator[tuple[Sides, NeckFrame, Profile]]:
    """Propose the smooth profiles that come nearest to the drawing."""
    for shorter in (0, 1):
        chains = chains_of(sides, shorter)
        if chains.straight == (True, True):
            return
        if chains.straight[1]:
            yield from _one_sided(sides.turned(), chains_of(sides.turned(), shorter))
        elif chains.straight[0]:
            yield from _one_sided(sides, chains)
        else:
            yield from _two_sided(sides, chains)


def chains_of(sides: Sides, shorter: int = 0) -> Chains:
    """Return the smooth run of each side about the neck, shorter by some pieces at its ends."""
    chains, straight = [], []
    for left in (False, True):
        halves = [_run(sides, left, ahead, shorter) for ahead in (left, not left)]
        # backwards along the contour, then forwards; the piece at the neck is in both
        back = [s.reversed() for s in reversed(halves[0])]
        strokes = [*back, *halves[1][1:]]
        points = [p for s in strokes for p in s.points(_RULES.chord)]
        chains.append(np.array(points))
        straight.append(len(strokes) == 1 and not strokes[0].curve.bulge)
    return Chains(chains[0], chains[1], (straight[0], straight[1]))


def _run(sides: Sides, left: bool, ahead: bool, shorter: int) -> list[DrawnStroke]:
    run: list[DrawnStroke] = []
    for stroke in sides.walk(left, ahead):
        if run:
            before, onward = run[-1].curve, stroke.curve.direction(0.0)
            straight = not stroke.curve.bulge and not stroke.trace
            if _turn(before.direction(1.0), onward) > (
                _RULES.tangent if straight and before.bulge else _RULES.corner
            ):
                break
            # but at the bottom, which may be flat
            leans = _turn(run[0].curve.direction(0.0), onward) > _RULES.tangent
            if straight and leans and stroke.curve.length > _RULES.long * before.length:
                break
        run.append(stroke)
    return run[: max(1, len(run) - shorter)]


def _turn(u: Pair, v: Pair) -> float:
    """Angle between two directions [rad]."""
    return abs(math.atan2(u[0] * v[1] - u[1] * v[0], u[0] * v[0] + u[1] * v[1]))


def nearest_frame(chains: Chains) -> tuple[NeckFrame, float] | None:
    """Return the axes by the nearest points of the two sides, and the thickness there [m]."""
    from scipy.spatial import KDTree

    right, left = chains.right, chains.left
    if chains.straight[0]:
        p, q = _foot(right, left)
    elif chains.straight[1]:
        q, p = _foot(left, right)
    else:
        away, near = KDTree(left).query(right)
        k = int(np.argmin(away))
        p, q = right[k], left[int(np.asarray(near)[k])]
    (dx, dy) = (q - p).tolist()
    thickness = math.hypot(dx, dy)
    if thickness == 0.0:
        return None
    x, y = (0.5 * (p + q)).tolist()
    return NeckFrame((x, y), math.atan2(-dx, dy)), thickness


def _foot(line: Array, others: Array) -> tuple[Array, Array]:
    """Return the nearest point of a line, and that of the others."""
    along = (line[-1] - line[0]) / np.hypot(*(line[-1] - line[0]))
    off = others - line[0]
    away = np.abs(off @ np.array([-along[1], along[0]]))
    k = int(np.argmin(away))
    return line[0] + along * float(off[k] @ along), others[k]


class _Formula(NamedTuple):
    """The formula of a profile, with lengths in sizes of the notch."""

    residual: Callable[[Any, Array, Array, float], Array]
    """Distances from the formula, by its parameters, of points at distances along the hinge and
    depths, with a thickness of the neck.
    """
    guesses: Callable[[float, float], list[list[float]]]
    """Initial parameters, by the largest distance and the largest depth of the points."""
    dimensions: Callable[[Any, float, float], dict[str, float]]
    """Dimensions of the profile, by parameters, distance of the end and thickness of the neck."""
    profile: type[Profile]
    """Class of the profile."""


@dataclass(frozen=True, slots=True)
class _Fit:
    """A formula with fitted axes and parameters, in sizes of the notch."""

    formula: _Formula
    axes: list[float]
    """Position (and, of two curved sides, direction) of the hinge; thickness of the neck last."""
    parameters: list[float]

    @property
    def thickness(self) -> float:
        """Thickness of the neck."""
        return self.axes[-1]


def _ellipse(p: Any, x: Array, d: Array, _t: float) -> Array:
    a, b = p
    value = (x / a) ** 2 + ((d - b) / b) ** 2 - 1.0
    return value / (2.0 * np.hypot(x / a**2, (d - b) / b**2))


def _power(p: Any, x: Array, d: Array, _t: float) -> Array:
    k, n = math.exp(min(p[0], 50.0)), p[1]
    x = np.maximum(np.abs(x), 1e-12)
    return (d - k * x**n) / np.hypot(1.0, n * k * x ** (n - 1.0))


def _parabola(p: Any, x: Array, d: Array, _t: float) -> Array:
    return (d - p[0] * x**2) / np.hypot(1.0, 2.0 * p[0] * x)


def _hyperbola(p: Any, x: Array, d: Array, t: float) -> Array:
    y = np.sqrt(0.25 * t**2 + (p[0] * x) ** 2)
    return (d + 0.5 * t - y) / np.hypot(1.0, p[0] ** 2 * x / y)


_FORMULAS = (
    _Formula(
        _ellipse,
        lambda x, d: [[x, d]],
        lambda p, _end, _t: {"half_length": abs(p[0]), "notch_depth": abs(p[1])},
        Elliptical,
    ),
    _Formula(
        _parabola,
        lambda x, d: [[d / x**2]],
        lambda p, end, _t: {"half_length": end, "notch_depth": p[0] * end**2},
        Parabolic,
    ),
    _Formula(
        _hyperbola,
        lambda x, d: [[d / x]],
        lambda p, end, t: {
            "half_length": end,
            "notch_depth": math.sqrt(0.25 * t**2 + (p[0] * end) ** 2) - 0.5 * t,
        },
        Hyperbolic,
    ),
    _Formula(
        _power,
        lambda x, d: [[math.log(d / x**n), n] for n in (3.0, 6.0)],
        lambda p, end, _t: {
            "half_length": end,
            "notch_depth": math.exp(p[0] + p[1] * math.log(end)),
            "exponent": p[1],
        },
        PowerFunction,
    ),
)


def _two_sided(sides: Sides, chains: Chains) -> Iterator[tuple[Sides, NeckFrame, Profile]]:
    begin = nearest_frame(chains)
    if begin is None or min(len(chains.right), len(chains.left)) < _RULES.fewest:
        return
    frame, thickness = begin

    def in_axes(axes: Any) -> tuple[Array, Array, float]:
        """Return distances and depths of all points, in sizes of the notch, and the thickness."""
        x0, y0, turn, neck = axes
        c, s = math.cos(turn), math.sin(turn)
        distances, depths = [], []
        for points, sign in ((right, -1.0), (left, 1.0)):
            x, y = points[:, 0] - x0, points[:, 1] - y0
            distances.append(c * x + s * y)
            depths.append(sign * (c * y - s * x) - 0.5 * neck)
        return np.concatenate(distances), np.concatenate(depths), neck

    local = (frame.local(chains.right), frame.local(chains.left))
    size = float(np.max(np.abs(np.vstack(local)[:, 0])))
    right, left = _thinned(local[0]) / size, _thinned(local[1]) / size
    start = [0.0, 0.0, 0.0, thickness / size]
    for fit in _near_fits(in_axes, start):
        x, y, turn, _ = fit.axes
        c, s = math.cos(frame.direction), math.sin(frame.direction)
        at = frame.at[0] + size * (c * x - s * y), frame.at[1] + size * (s * x + c * y)
        fitted = NeckFrame(at, frame.direction + turn)
        yield from _profile_of_fit(fit, sides, chains, fitted, size, one_sided=False)


def _one_sided(sides: Sides, chains: Chains) -> Iterator[tuple[Sides, NeckFrame, Profile]]:
    """Propose profiles with the straight side on the right."""
    begin = nearest_frame(chains)
    if begin is None or len(chains.left) < _RULES.fewest:
        return
    frame, thickness = begin
    along = chains.right[-1] - chains.right[0]
    frame = NeckFrame(frame.at, math.atan2(along[1], along[0]))
    points = frame.local(chains.left)
    size = float(np.max(np.abs(points[:, 0])))
    points = _thinned(points) / size
    bottom = -0.5 * thickness / size

    def in_axes(axes: Any) -> tuple[Array, Array, float]:
        x0, neck = axes
        return points[:, 0] - x0, points[:, 1] - bottom - neck, neck

    for fit in _near_fits(in_axes, [0.0, thickness / size]):
        x, neck = fit.axes
        at = frame.plane(size * x, size * (bottom + 0.5 * neck))
        fitted = NeckFrame(at, frame.direction)
        yield from _profile_of_fit(fit, sides, chains, fitted, size, one_sided=True)


def _thinned(points: Array) -> Array:
    """Return the number of points that a fit needs, evenly selected."""
    if len(points) <= _RULES.most:
        return points
    return points[np.unique(np.linspace(0, len(points) - 1, _RULES.most).round().astype(int))]


def _near_fits(
    in_axes: Callable[[Any], tuple[Array, Array, float]], start: list[float]
) -> Iterator[_Fit]:
    """Fit each formula, from initial axes; yield those that are near the drawing."""
    x, d, _ = in_axes(start)
    reach, deepest = float(np.max(np.abs(x))), float(np.max(d))
    if deepest <= 0.0:
        return
    count = len(start)
    for formula in _FORMULAS:
        best = None
        for guess in formula.guesses(reach, deepest):

            def residual(v: Array, formula: _Formula = formula) -> Array:
                x, d, t = in_axes(v[:count])
                with np.errstate(all="ignore"):
                    r = formula.residual(v[count:], x, d, t)
                return np.where(np.abs(r) < 1.0, r, 1.0)

            solution = _fitted(residual, np.array([*start, *guess]))
            worst = float(np.max(np.abs(residual(solution))))
            if best is None or worst < best[0]:
                best = (worst, solution)
        if best is not None and best[0] < _RULES.near:
            yield _Fit(formula, best[1][:count].tolist(), best[1][count:].tolist())


def _fitted(residual: Callable[[Array], Array], start: Array) -> Array:
    """Return the parameters of the smallest squares of a residual.

    Damped Gauss-Newton steps (K. Levenberg, Quart. Appl. Math. 2 (1944) 164; D. W. Marquardt, J.
    Soc. Indust. Appl. Math. 11 (1963) 431); a fit that is not near after the first steps is
    abandoned.
    """
    x, r = start, residual(start)
    damping = 1e-3
    for step in range(_RULES.steps[1]):
        if step == _RULES.steps[0] and float(np.max(np.abs(r))) > _RULES.near:
            break
        moves = 1e-7 * np.maximum(np.abs(x), 1e-2)
        columns = [
            (residual(x + m * e) - r) / m for m, e in zip(moves, np.eye(len(x)), strict=True)
        ]
        jacobian = np.column_stack(columns)
        normal, slope = jacobian.T @ jacobian, jacobian.T @ r
        scale = np.diag(np.maximum(np.diag(normal), 1e-12))
        while damping < 1e6:
            trial = x - np.linalg.solve(normal + damping * scale, slope)
            after = residual(trial)
            if float(after @ after) < float(r @ r):
                break
            damping *= 10.0
        else:
            break
        moved = float(np.max(np.abs(trial - x)))
        x, r, damping = trial, after, max(0.1 * damping, 1e-14)
        if moved < 1e-13:
            break
    return x


def _profile_of_fit(
    fit: _Fit, sides: Sides, chains: Chains, frame: NeckFrame, size: float, *, one_sided: bool
) -> Iterator[tuple[Sides, NeckFrame, Profile]]:
    """Yield the profile of a fit, if there is one; it ends with the shortest side."""
    kind, p, tolerance = fit.formula.profile, fit.parameters, sides.part.tolerance
    neck = fit.thickness * size
    ends = []
    for points, left in ((chains.right, False), (chains.left, True)):
        if one_sided and not left:
            continue
        for ahead in (False, True):
            ends.append(float(np.max(quarter(frame, 0.5 * neck, points, left, ahead)[:, 0])))
    reach = min(ends)
    if max(ends) - reach < tolerance:
        reach = sum(ends) / len(ends)
    if not neck > 0.0 or (kind is not Elliptical and not p[0] > -50.0):
        return
    try:
        dimensions = fit.formula.dimensions(p, reach / size, fit.thickness)
        profile = kind(
            neck_thickness=rounded(neck),
            one_sided=one_sided,
            **{
                name: round(value, 7) if name == "exponent" else rounded(value * size)
                for name, value in dimensions.items()
            },
        )
    except (HingeError, OverflowError, ValueError):
        return  # dimensions that no notch of this kind has
    if (
        isinstance(profile, Elliptical)
        and abs(profile.half_length - profile.notch_depth) < tolerance
    ):
        radius = rounded(0.5 * (profile.half_length + profile.notch_depth))
        profile = RightCircular(neck_thickness=rounded(neck), one_sided=one_sided, radius=radius)
    yield sides, frame, profile
