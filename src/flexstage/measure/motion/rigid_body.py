"""Motion of a rigid body from several of its points."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.quantities.estimate import Estimate

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
        raise RecordError("the points of a body must be finite: leave out those that are not known")
    extent = np.linalg.svd(a - a.mean(0), compute_uv=False)
    # share of the extent of points below which they count as lying on a line
    on_a_line = 1e-9
    if not extent[1] > on_a_line * extent[0]:
        raise RecordError(
            "the reference points lie on a line, so that the rotation about it stays unknown: add "
            "a point beside it"
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
