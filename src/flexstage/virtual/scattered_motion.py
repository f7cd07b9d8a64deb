"""Motion beside the axis of hundreds of stages as they come from the machine, all at once.

The lumped model in space: rigid bodies with six coordinates, each notch a spring in its plane and
out of it, its neck, place and direction a little off.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hinges import compliance
from flexstage.hinges.compliance import out_of_plane_compliance
from flexstage.hinges.registry import with_neck_thickness
from flexstage.lumped import hinge_springs, mechanism
from flexstage.lumped.assemble import HingeSpring
from flexstage.lumped.rigid_bodies import Mechanism, Sight
from flexstage.stage import Axis, Stage
from flexstage.stage.model import only_drive
from flexstage.virtual.imperfections import Scatter

# Step of the difference quotient of a hinge's stiffness by its neck, as part of the neck.
_STEP = 1e-3
#: Where the motion in the plane and that out of it stand among the six of a hinge.
_IN_PLANE, _OUT_OF_PLANE = (0, 1, 5), (2, 3, 4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deviations:
    """How far stages are off from their drawing; hinges and drives in the order of the stage."""

    neck: Array
    """Thickness of each neck [m], shape (samples, hinges)."""
    position: Array
    """Place of each notch along x and y [m], shape (samples, hinges, 2)."""
    lean: Array
    """Rotation of each notch's axis about x and y [rad], shape (samples, hinges, 2)."""
    drive: Array
    """Line of each drive, to its left and along the normal [m], shape (samples, drives, 2)."""


def draw_deviations(
    stage: Stage, scatter: Scatter, samples: int, *, seed: int = 0, stream: int = 0
) -> Deviations:
    """Draw how far stages are off; sample i is the same however many there are.

    Parts of one product that are made apart take streams of their own.
    """
    if samples < 1:
        raise ModelError(f"there must be at least 1 sample, got {samples}")
    h, d = len(stage.hinges), len(stage.drives)
    drawn = np.empty((samples, 1 + 5 * h + 2 * d))
    for i in range(samples):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream, i)))
        drawn[i] = rng.standard_normal(drawn.shape[1])
    common, own, position, lean, drive = np.split(drawn, np.cumsum([1, h, 2 * h, 2 * h]), axis=1)
    return Deviations(
        neck=scatter.neck_common * common + scatter.neck_own * own,
        position=scatter.position * position.reshape(samples, h, 2),
        lean=scatter.lean * lean.reshape(samples, h, 2),
        drive=scatter.drive * drive.reshape(samples, d, 2),
    )


def motion_rates(stage: Stage, deviations: Deviations | None = None) -> dict[str, Array]:
    r"""Return how the point of each probe moves for each metre that it goes along its axis.

    Every stage is a set of rigid bodies with six coordinates, joined at the displaced necks by
    springs whose axes lean as the notches do:
    :math:`K = \sum_h B_h^T k_h(t_h) B_h`, :math:`K q = d`, and the motion :math:`P q` of the probed
    body at the probe, over its part along the axis. In its plane, without deviations, it is the
    model of `flexstage.lumped.lumped_system`.

    Parameters
    ----------
    stage : Stage
        The stage, whose axes have a drive each; the other drives are removed.
    deviations : Deviations, optional
        How far each sample is off; none where not given.

    Returns
    -------
    dict of str to numpy.ndarray
        By axis: displacement along the axis (1), to its left and along the normal [m/m], and
        rotation about these three, roll, pitch and yaw [rad/m]; shape (samples, 6).

    Raises
    ------
    ModelError
        The stage has no axis, or one that several drives move or that is a rotation, or it can move
        without deforming a hinge.

    Notes
    -----
    Validity: small displacements of rigid bodies; stiffness of a neck to first order in its
    thickness. Masses, and what outlines are off by, do not matter at rest.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> rates = motion_rates(design("parallelogram"))["x"]
    >>> print(f"{rates[0, 5] * 200e-6 * 1e6:.2f} urad over 200 um")
    -3.19 urad over 200 um
    """
    if not stage.axes:
        raise ModelError(f"stage '{stage.name}' names no axis: there is no motion to follow")
    off = deviations or _none(stage)
    model = mechanism(stage)
    K = _stiffness(stage, model, off)
    drives = {d.name: i for i, d in enumerate(model.drives)}
    forces = np.stack(
        [
            _sight_row(model, model.drives[i], off.drive[:, i])[:, 0]
            for i in (drives[drive_of(axis)] for axis in stage.axes)
        ],
        axis=-1,
    )
    # a unit diagonal makes metres and radians comparable
    scale = 1.0 / np.sqrt(np.einsum("sii->si", K))
    K *= scale[:, :, None] * scale[:, None, :]
    try:
        q = scale[:, :, None] * np.linalg.solve(K, scale[:, :, None] * forces)
    except np.linalg.LinAlgError as error:
        raise ModelError(
            f"stage '{stage.name}' can move without deforming a hinge: fix a body or add a hinge"
        ) from error
    rates = {}
    for k, axis in enumerate(stage.axes):
        row = _sight_row(model, model.probe(axis.probe), np.zeros((1, 2)))[0]
        moved = q[:, :, k] @ row.T
        rates[axis.name] = moved / moved[:, :1]
    return rates


def drive_of(axis: Axis) -> str:
    """Return the one drive that moves an axis; refuse an axis that several move."""
    return only_drive(axis.name, axis.moved_by, ModelError)


def _none(stage: Stage) -> Deviations:
    h, d = len(stage.hinges), len(stage.drives)
    return Deviations(
        neck=np.zeros((1, h)),
        position=np.zeros((1, h, 2)),
        lean=np.zeros((1, h, 2)),
        drive=np.zeros((1, d, 2)),
    )


def _stiffness(stage: Stage, model: Mechanism, off: Deviations) -> Array:
    """Stiffness of every sample, shape (samples, n, n)."""
    samples = off.neck.shape[0]
    n = 6 * len(model.free)
    K = np.zeros((samples, n, n))
    for i, (spring, hinge) in enumerate(zip(hinge_springs(stage), model.hinges, strict=True)):
        whole, slope = _spring(stage, spring)
        k = whole + slope * off.neck[:, i, None, None]
        at = np.zeros((samples, 3))
        at[:, :2] = hinge.at + off.position[:, i]
        turned = _leaning(off.lean[:, i]) @ _axes(hinge.direction)
        b = _difference(model, hinge.bodies, at, turned)
        columns = np.flatnonzero(b.any(axis=(0, 1)))
        b = b[:, :, columns]
        K[:, columns[:, None], columns] += np.swapaxes(b, 1, 2) @ k @ b
    return K


def _spring(stage: Stage, spring: HingeSpring) -> tuple[Array, Array]:
    """Stiffness of a hinge for its six motions, and its derivative by the neck, shape (6, 6)."""
    hinge, material = spring.hinge, stage.material
    elastic = (material.youngs_modulus, material.poissons_ratio, stage.thickness)
    neck = hinge.profile.neck_thickness
    found = []
    for part in (-_STEP, _STEP):
        profile = with_neck_thickness(hinge.profile, (1.0 + part) * neck)
        in_plane = compliance(
            profile,
            *elastic,
            method=spring.method,
            plane=spring.plane,
            root_widths=spring.root_widths,
        )
        k = np.zeros((6, 6))
        k[np.ix_(_IN_PLANE, _IN_PLANE)] = in_plane.stiffness
        k[_OUT_OF_PLANE, _OUT_OF_PLANE] = 1.0 / out_of_plane_compliance(profile, *elastic)
        found.append(k)
    slope = (found[1] - found[0]) / (2.0 * _STEP * neck)
    whole = 0.5 * (found[0] + found[1])
    whole[np.ix_(_IN_PLANE, _IN_PLANE)] = spring.stiffness
    return whole, slope


def _axes(direction: float) -> Array:
    """Axes along, across and normal as columns, shape (3, 3)."""
    c, s = np.cos(direction), np.sin(direction)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _leaning(lean: Array) -> Array:
    """Rotations by small angles about x and y, to their third order; shape (samples, 3, 3)."""
    turn = _cross(np.concatenate((lean, np.zeros((len(lean), 1))), axis=1))
    return np.eye(3) + turn + 0.5 * turn @ turn


def _cross(v: Array) -> Array:
    """Matrices of a cross product from the left, shape (..., 3, 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


def _difference(model: Mechanism, bodies: tuple[int, int], at: Array, axes: Array) -> Array:
    """Motion of body b against body a at a point, in given axes, shape (samples, 6, n)."""
    column = {body: 6 * k for k, body in enumerate(model.free)}
    out = np.zeros((len(at), 6, 6 * len(column)))
    back = np.swapaxes(np.broadcast_to(axes, (len(at), 3, 3)), 1, 2)
    for body, sign in zip(bodies, (-1.0, 1.0), strict=True):
        if (first := column.get(body)) is None:
            continue
        arm = at - [*model.bodies[body].centre, 0.0]
        out[:, :3, first : first + 3] += sign * back
        out[:, :3, first + 3 : first + 6] -= sign * back @ _cross(arm)
        out[:, 3:, first + 3 : first + 6] += sign * back
    return out


def _sight_row(model: Mechanism, sight: Sight, off: Array) -> Array:
    """Motion of b against a at a drive's or probe's point on b, shape (samples, 6, n).

    Push and reaction share one line; `off` is how far it is to the left, and along the normal.
    """
    if sight.direction is None:
        raise ModelError(
            f"'{sight.name}' reads a rotation, which is no motion along an axis: name a probe that "
            "reads a displacement"
        )
    axes = _axes(sight.direction)
    at = np.array([*sight.points[1], 0.0]) + off @ axes[:, 1:].T
    return _difference(model, sight.bodies, at, axes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorMotion:
    """Motion of a body along an axis, with the motions beside it, of many samples.

    Axes: 1 along, 2 to its left, 3 along the normal of the plate.
    """

    along: Array
    """Travel [m], shape (k,)."""
    displacement: Array
    """Displacement of a point beside the travel [m], shape (samples, k, 3)."""
    rotation: Array
    """Roll, pitch and yaw: rotation about the three axes [rad], shape (samples, k, 3)."""

    def at(self, offset: tuple[float, float, float]) -> "ErrorMotion":
        r"""Return the motion of another point of the body: the Abbe offset in all its directions.

        :math:`u' = u + \theta\times r` (J. B. Bryan, Precision Engineering 1 (1979) 129: what holds
        for a displacement holds for straightness as well).

        Examples
        --------
        >>> tilting = ErrorMotion(along=np.array([1e-4]), displacement=np.zeros((1, 1, 3)),
        ...                       rotation=np.array([[[3e-6, 0.0, 0.0]]]))
        >>> above = tilting.at((0.0, 0.0, 20e-3))  # 3 urad of roll, 20 mm above
        >>> print(f"{above.displacement[0, 0, 1] * 1e9:.0f} nm")
        -60 nm
        """
        moved = np.cross(self.rotation, np.array(offset))
        return replace(self, displacement=self.displacement + moved)

    def with_assembly(self, squareness: Array, tilt: Array) -> "ErrorMotion":
        """Return the motion of a guide that was mounted askew.

        Turned in its plane and tilted out of it by angles of each sample [rad], shape (samples,).
        """
        askew = np.zeros_like(self.displacement)
        askew[..., 1] = squareness[:, None] * self.along
        askew[..., 2] = tilt[:, None] * self.along
        return replace(self, displacement=self.displacement + askew)


def error_motion(
    along: Array, across: Array, yaw: Array, rates: Array, mean: Mapping[str, float] | None = None
) -> ErrorMotion:
    """Join the motion of the stage as drawn with what scatter adds to it.

    Parameters
    ----------
    along, across, yaw : numpy.ndarray
        Path of the stage as drawn [m, m, rad], shape (k,).
    rates : numpy.ndarray
        What each sample adds for each metre, as `motion_rates` gives it, shape (samples, 6).
    mean : mapping, optional
        What all of them add for each metre: ``across`` [m/m] and ``yaw`` [rad/m].
    """
    added = mean or {}
    motion = rates[:, None, :] * along[None, :, None]
    displacement, rotation = motion[..., :3].copy(), motion[..., 3:].copy()
    displacement[..., 0] = 0.0
    displacement[..., 1] += across + added.get("across", 0.0) * along
    rotation[..., 2] += yaw + added.get("yaw", 0.0) * along
    return ErrorMotion(along=along, displacement=displacement, rotation=rotation)
