"""Travel and pose of a stage: stroke of an axis, workspace of two, motion as a rigid body."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.motion.curve_fit import fit_motion_curve
from flexstage.measure.motion.cycles import MotionCycles, spread_estimate
from flexstage.measure.motion.motion_curve import MotionCurve, curve_loop_width
from flexstage.quantities.estimate import Estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stroke:
    """Stroke of an axis, and its repeatability."""

    stroke: Estimate
    """From the lower to the upper end of the command, averaged over both runs and all cycles [m].
    """
    of_cycles: Array
    """Of each cycle [m], shape (c,)."""
    repeatability: Estimate
    """Standard deviation of the stroke from cycle to cycle [m]."""
    end_repeatability: tuple[Estimate, Estimate]
    """Standard deviations of the position at the lower and at the upper end from cycle to cycle,
    without drift [m].
    """
    gain: Estimate
    """Slope of the least-squares line of position over command [m/V, or 1 of a displacement]."""
    loop_width: Estimate
    """Largest distance of the forward from the backward run at equal command [m]."""
    drift_rate: Estimate | None
    """Drift rate of the position [m/s]; None if it was not fitted."""
    curve: MotionCurve
    """Position over command, the source of these results."""


def stroke(
    command: ArrayLike,
    position: ArrayLike,
    time: ArrayLike,
    *,
    cycles: MotionCycles | None = None,
    drift: bool = True,
    command_unit: str = "m",
) -> Stroke:
    """Find the stroke of an axis, with hysteresis and drift separated.

    The position is fitted as a curve over the command (`fit_motion_curve`), forward and backward,
    and the stroke is the difference of its ends. So it is no largest value, which noise would
    enlarge.

    Parameters
    ----------
    command : array_like
        Command in cycles over the stroke: triangle, sine or staircase [V or m], shape (n,).
    position : array_like
        Measured position along the axis [m], shape (n,).
    time : array_like
        Time, rising [s], shape (n,).
    cycles : MotionCycles, optional
        Cycles of the command; found where not given.
    drift : bool
        Whether to take a linear drift off; it needs three cycles.
    command_unit : str
        Unit of the command.

    Returns
    -------
    Stroke
        The figures.

    Validity
    --------
    The spread from cycle to cycle holds the noise of the sensor as well, averaged as the curve
    does. The position at an end includes offsets that differ from cycle to cycle; the stroke does
    not.

    Raises
    ------
    RecordError
        The columns do not belong together, or there are too few cycles.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 400.0
    >>> c, s = np.cos(2.0 * np.pi * t), np.sin(2.0 * np.pi * t)
    >>> noise = 3e-9 * np.random.default_rng(2).standard_normal(t.size)
    >>> position = -31e-6 * c - 0.8e-6 * s * abs(s) + 1e-8 * t + noise
    >>> found = stroke(60.0 - 60.0 * c, position, t, command_unit="V")
    >>> print(f"{1e6 * found.stroke.value:.2f} um, loop {1e6 * found.loop_width.value:.2f} um")
    62.00 um, loop 1.60 um
    """
    curve = fit_motion_curve(
        command, position, time, cycles=cycles, drift=drift, position_unit=command_unit
    )
    ends = curve.rows([curve.basis.low, curve.basis.high], "mean")
    across = ends[1] - ends[0]
    of_cycles = curve.each_cycle(across)
    lost = 2 if drift else 1
    at_ends = tuple(
        spread_estimate(
            curve.each_cycle(end) - end @ curve.coefficients.ravel(),
            unit="m",
            degrees_of_freedom=curve.cycles - lost,
            note="without drift" if drift else "",
        )
        for end in ends
    )
    return Stroke(
        stroke=curve.of_coefficients(across, reach=2.0**0.5),
        of_cycles=of_cycles,
        repeatability=spread_estimate(of_cycles, unit="m", note="from cycle to cycle, with noise"),
        end_repeatability=(at_ends[0], at_ends[1]),
        gain=curve.slope(),
        loop_width=curve_loop_width(curve),
        drift_rate=curve.drift_rate,
        curve=curve,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Workspace:
    """What a stage of two axes reaches.

    Corners are in the order low x and low y, high x and low y, high x and high y, low x and high y.
    """

    corners: Array
    """Mean corners [m], shape (4, 2)."""
    area: Estimate
    """Area between the corners [m^2]."""
    stroke_x: tuple[Estimate, Estimate]
    """Distance from corner to corner along x, at low and at high y [m]."""
    stroke_y: tuple[Estimate, Estimate]
    """The same along y, at low and at high x [m]."""
    diagonals: tuple[Estimate, Estimate]
    """From low x, low y to high x, high y, and from high x, low y to low x, high y [m]."""
    squareness: Estimate
    """Angle from the mean direction of the x sides to that of the y sides, less a right angle
    [rad].
    """
    repeatability: Estimate
    """Standard deviation of a coordinate of a corner from round to round, of all corners [m]."""
    rounds: int
    """How many times each corner was reached."""


def workspace(corners: ArrayLike) -> Workspace:
    r"""Find the figures of a workspace from its corners, reached several times.

    The area is :math:`\frac12 \sum_i (x_i y_{i+1} - x_{i+1} y_i)` (the surveyor's formula, Meister
    1769). Every figure is taken of the mean corners, and its uncertainty from what the rounds give
    it by its derivative: the rounds are independent observations, whatever their corners have in
    common.

    Parameters
    ----------
    corners : array_like
        The four corners in the order that `Workspace` has, for each round, shape (r, 4, 2) [m].

    Returns
    -------
    Workspace
        The figures.

    Validity
    --------
    A drift from round to round counts as scatter, and enters the repeatability; of lengths, angles
    and the area it cancels as far as it shifts a round as a whole.

    Raises
    ------
    RecordError
        There are fewer than two rounds, a corner is not finite, or they are not in that order.

    Examples
    --------
    >>> one = np.array([[0.0, 0.0], [63.0, 0.4], [63.1, 61.0], [0.2, 60.5]]) * 1e-6
    >>> found = workspace([one, one + 1e-9 * np.arange(8.0).reshape(4, 2)])
    >>> print(f"{1e12 * found.area.value:.1f} um^2, {1e3 * found.squareness.value:.2f} mrad")
    3811.7 um^2, -9.66 mrad
    """
    points = np.asarray(corners, dtype=np.float64)
    if points.ndim != 3 or points.shape[1:] != (4, 2) or points.shape[0] < 2:
        raise RecordError(
            "a workspace needs two rounds of four corners at least, as an array of shape (rounds, "
            f"4, 2), got {points.shape}"
        )
    if not np.isfinite(points).all():
        raise RecordError("the corners of a workspace must be finite")
    mean = points.mean(axis=0)
    _require_order(mean)
    rounds = points.shape[0]

    def estimate(figure: Callable[[Array], Array], unit: str) -> Estimate:
        return _figure(figure, points, unit)

    def distance(i: int, j: int) -> Estimate:
        return estimate(lambda p: np.linalg.norm(p[..., j, :] - p[..., i, :], axis=-1), "m")

    return Workspace(
        corners=mean,
        area=estimate(_area, "m^2"),
        stroke_x=(distance(0, 1), distance(3, 2)),
        stroke_y=(distance(0, 3), distance(1, 2)),
        diagonals=(distance(0, 2), distance(1, 3)),
        squareness=estimate(_squareness, "rad"),
        repeatability=spread_estimate(
            points - mean,
            unit="m",
            degrees_of_freedom=8 * (rounds - 1),
            note="a coordinate of a corner",
        ),
        rounds=rounds,
    )


def _area(points: Array) -> Array:
    x, y = points[..., 0], points[..., 1]
    return 0.5 * np.sum(x * np.roll(y, -1, axis=-1) - np.roll(x, -1, axis=-1) * y, axis=-1)


def _squareness(c: Array) -> Array:
    along = c[..., 1, :] - c[..., 0, :] + c[..., 2, :] - c[..., 3, :]
    up = c[..., 3, :] - c[..., 0, :] + c[..., 2, :] - c[..., 1, :]
    cross = along[..., 0] * up[..., 1] - along[..., 1] * up[..., 0]
    return np.arctan2(cross, np.sum(along * up, axis=-1)) - 0.5 * np.pi


def _figure(figure: Callable[[Array], Array], points: Array, unit: str) -> Estimate:
    """Return a figure of the mean corners, with what the rounds differ in it to first order."""
    mean = points.mean(axis=0)
    value = float(figure(mean))
    step = 1e-4 * float(np.ptp(mean, axis=0).max())
    derivative = np.empty_like(mean)
    for i in np.ndindex(*mean.shape):
        moved = np.stack((mean, mean))
        moved[(0, *i)] += step
        moved[(1, *i)] -= step
        above, below = figure(moved)
        derivative[i] = (above - below) / (2.0 * step)
    each = np.tensordot(points - mean, derivative, axes=2)
    rounds = points.shape[0]
    uncertainty = math.sqrt(float(each @ each) / (rounds * (rounds - 1)))
    return Estimate.of(
        value, uncertainty, unit, source="repeatability", degrees_of_freedom=rounds - 1
    )


def _require_order(corners: Array) -> None:
    steps = np.roll(corners, -1, axis=0) - corners
    following = np.roll(steps, -1, axis=0)
    turns = steps[:, 0] * following[:, 1] - steps[:, 1] * following[:, 0]
    if not (np.all(turns > 0.0) and steps[0, 0] > 0.0 and steps[1, 1] > 0.0):
        raise RecordError(
            "the corners must go around from low x and low y to high x, then to high y, "
            f"counterclockwise, got {np.array2string(corners, precision=4, separator=', ')}"
        )


#: The six parameters of a rigid motion, in the order of its covariance.
PARAMETERS: tuple[str, ...] = ("along", "across", "vertical", "roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidMotion:
    """Poses of a rigid body, relative to a reference.

    A point at a in the reference goes to ``about + translation + R (a - about)``, with R the matrix
    of roll about the axis of travel, then pitch about the horizontal across it, then yaw about the
    vertical: ``R = Rz(yaw) Ry(pitch) Rx(roll)``.
    """

    translation: Array
    """Displacement of the point `about`: along, across, vertical [m], shape (..., 3)."""
    rotation: Array
    """R [1], shape (..., 3, 3)."""
    angles: Array
    """Roll, pitch, yaw [rad], shape (..., 3)."""
    about: Array
    """The point that `translation` is of, in the reference [m], shape (3,)."""
    covariance: Array
    """Covariance of the translation and of a further small turn about the three axes, in the order
    of `PARAMETERS` [m^2, m rad, rad^2], shape (..., 6, 6).
    """
    residuals: Array
    """Measured less fitted points [m], shape (..., k, 3)."""
    degrees_of_freedom: float
    """Of the uncertainty."""

    def estimate(
        self,
        parameter: Literal["along", "across", "vertical", "roll", "pitch", "yaw"],
        pose: int | tuple[int, ...] = (),
    ) -> Estimate:
        """Return one parameter of one pose with its uncertainty."""
        if parameter not in PARAMETERS:
            raise ModelError(f"a pose has {', '.join(PARAMETERS)}, got {parameter!r}")
        number = PARAMETERS.index(parameter)
        value = np.concatenate([self.translation, self.angles], axis=-1)[pose][number]
        variance = self.covariance[pose][number, number]
        return Estimate.of(
            float(value),
            float(np.sqrt(max(variance, 0.0))),
            "m" if number < 3 else "rad",
            source="noise of the points",
            degrees_of_freedom=self.degrees_of_freedom,
        )


def travel_frame(travel: ArrayLike, vertical: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """Return the right-handed frame of a motion, whose axes give pitch, roll and yaw their meaning.

    Its rows are along (the axis of roll), across (of pitch) and vertical (of yaw, made square to
    travel); ``points @ frame.T`` are points in it.

    Examples
    --------
    >>> travel_frame((0.0, 2.0, 0.0))[1] + 0.0
    array([-1.,  0.,  0.])
    """
    along, up = np.asarray(travel, dtype=np.float64), np.asarray(vertical, dtype=np.float64)
    across = np.cross(up, along)
    sizes = np.linalg.norm(along) * np.linalg.norm(up)
    if not np.linalg.norm(across) > 1e-9 * sizes:
        raise ModelError("travel and vertical must be two different directions, not 0 or parallel")
    along, across = along / np.linalg.norm(along), across / np.linalg.norm(across)
    return np.stack([along, across, np.cross(along, across)])


def rigid_motion(
    reference: ArrayLike, points: ArrayLike, *, about: ArrayLike | None = None
) -> RigidMotion:
    """Return the rigid motions that carry reference points to measured ones, by least squares.

    With U S V^T the singular values of the covariance of measured and reference points,
    ``R = U diag(1, 1, det U V^T) V^T`` (Kabsch, 1976, Acta Crystallographica A32; Umeyama, 1991,
    IEEE Transactions on Pattern Analysis and Machine Intelligence 13, for the sign). The noise of
    the points, the same in every direction, is found from the residuals of all poses together, and
    carried on to the six parameters to first order.

    Parameters
    ----------
    reference : array_like
        The points in the reference pose, in a frame whose first axis is along travel and whose
        third is vertical (`travel_frame`) [m], shape (k, 3), k three or more.
    points : array_like
        The same points in each pose [m], shape (..., k, 3).
    about : array_like, optional
        The point whose displacement is the translation [m], shape (3,); the mean of the reference
        where not given.

    Returns
    -------
    RigidMotion
        The poses.

    Validity
    --------
    The body is rigid and the points keep their order. Uncertainty is of first order in noise over
    distance between the points. The reference counts as measured once, as noisy as a pose, and
    shared by all: m poses have 4 m / (m + 3) times 3 k - 6 degrees of freedom, and not m times.

    Raises
    ------
    RecordError
        There are fewer than three points, they lie on a line, or one is not finite.

    Examples
    --------
    >>> spheres = np.array([[0.0, 0.0, 0.0], [80e-3, 5e-3, 0.0], [10e-3, 60e-3, 7e-3]])
    >>> yaw = 12e-6
    >>> moved = spheres + [40e-6, 0.0, 0.0] + yaw * np.cross([0.0, 0.0, 1.0], spheres)
    >>> noise = 0.1e-6 * np.random.default_rng(1).standard_normal((8, 3, 3))
    >>> motion = rigid_motion(spheres, moved + noise, about=(0.0, 0.0, 0.0))
    >>> found = motion.estimate("yaw", 0)
    >>> print(f"{1e6 * found.value:.2f} urad +- {1e6 * found.expanded:.2f} urad")
    12.25 urad +- 2.05 urad
    """
    a, b = np.asarray(reference, dtype=np.float64), np.asarray(points, dtype=np.float64)
    if a.ndim != 2 or a.shape[1:] != (3,) or len(a) < 3 or b.shape[-2:] != a.shape:
        raise RecordError(
            "a rigid motion needs at least three points in space, the same number in each pose as "
            f"in the reference, got shapes {a.shape} and {b.shape}"
        )
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise RecordError("the points of a body must be finite: omit unknown points")
    extent = np.linalg.svd(a - a.mean(0), compute_uv=False)
    # share of the extent of points below which they count as lying on a line
    on_a_line = 1e-9
    if not extent[1] > on_a_line * extent[0]:
        raise RecordError(
            "the reference points are on a line, so that the rotation about it is unknown: add a "
            "point off this line"
        )
    R, t = _kabsch(a, b)
    residuals = b - t[..., None, :] - a @ np.swapaxes(R, -1, -2)
    centre = a.mean(0) if about is None else np.asarray(about, dtype=np.float64)
    # normal matrix for a small further translation and turn
    arm = (a - centre) @ np.swapaxes(R, -1, -2)
    J = np.concatenate([np.broadcast_to(np.eye(3), (*arm.shape, 3)), -_cross(arm)], axis=-1)
    normal = np.einsum("...kia,...kib->...ab", J, J)
    # lengths and angles differ by the size of the body: without its unit the matrix is even
    size = np.sqrt(np.diagonal(normal, axis1=-2, axis2=-1))
    scale = size[..., :, None] * size[..., None, :]
    poses, redundancy = residuals[..., 0, 0].size, 3 * len(a) - 6
    variance = float(np.sum(residuals**2)) / (redundancy * poses)
    return RigidMotion(
        translation=t + R @ centre - centre,
        rotation=R,
        angles=_angles(R),
        about=centre,
        covariance=variance * np.linalg.inv(normal / scale) / scale,
        residuals=residuals,
        degrees_of_freedom=redundancy * 4.0 * poses / (poses + 3.0),
    )


def _kabsch(a: Array, b: Array) -> tuple[Array, Array]:
    mean_a, mean_b = a.mean(0), b.mean(-2)
    H = np.einsum("...ki,kj->...ij", b - mean_b[..., None, :], a - mean_a)
    U, _, Vt = np.linalg.svd(H)
    U[..., :, 2] *= np.linalg.det(U @ Vt)[..., None]
    R = U @ Vt
    return R, mean_b - R @ mean_a


def _cross(v: Array) -> Array:
    """Matrix of the cross product: ``_cross(v) @ u`` is v x u."""
    z = np.zeros(v.shape[:-1])
    x, y, w = v[..., 0], v[..., 1], v[..., 2]
    return np.stack([z, -w, y, w, z, -x, -y, x, z], axis=-1).reshape((*v.shape, 3))


def _angles(R: Array) -> Array:
    roll = np.arctan2(R[..., 2, 1], R[..., 2, 2])
    pitch = np.arctan2(-R[..., 2, 0], np.hypot(R[..., 0, 0], R[..., 1, 0]))
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    return np.stack([roll, pitch, yaw], axis=-1)
