"""Error motions of many manufactured stages at once.

The lumped model in space: rigid bodies with six coordinates, each notch a spring in its plane and
out of it, with deviations of neck, position and direction.
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

# Relative step of the difference quotient of a hinge's stiffness by its neck.
_STEP = 1e-3
#: Indices of the motions in the plane and out of it among the six of a hinge.
_IN_PLANE, _OUT_OF_PLANE = (0, 1, 5), (2, 3, 4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deviations:
    """Deviations of stages from their drawing; hinges and drives in the order of the stage."""

    neck: Array
    """Error of the thickness of each neck [m], shape (samples, hinges)."""
    position: Array
    """Position error of each notch along x and y [m], shape (samples, hinges, 2)."""
    lean: Array
    """Tilt of the axis of each notch about x and y [rad], shape (samples, hinges, 2)."""
    drive: Array
    """Offset of the line of action of each drive, to its left and along the normal [m], shape
    (samples, drives, 2).
    """


def draw_deviations(
    stage: Stage, scatter: Scatter, samples: int, *, seed: int = 0, stream: int = 0
) -> Deviations:
    """Draw the deviations of stages; sample i does not depend on the number of samples.

    Parts of one product that are made independently use different streams.
    """
    if samples < 1:
        raise ModelError(f"the number of samples must be at least 1, got {samples}")
    h, d = len(stage.hinges), len(stage.drives)
    normal = np.empty((samples, 1 + 5 * h + 2 * d))
    for i in range(samples):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream, i)))
        normal[i] = rng.standard_normal(normal.shape[1])
    common, individual, position, lean, drive = np.split(
        normal, np.cumsum([1, h, 2 * h, 2 * h]), axis=1
    )
    return Deviations(
        neck=scatter.neck_common * common + scatter.neck_own * individual,
        position=scatter.position * position.reshape(samples, h, 2),
        lean=scatter.lean * lean.reshape(samples, h, 2),
        drive=scatter.drive * drive.reshape(samples, d, 2),
    )


def motion_rates(stage: Stage, deviations: Deviations | None = None) -> dict[str, Array]:
    r"""Return the error motions at each probe per metre along its axis.

    Every stage is a set of rigid bodies with six coordinates, joined at the displaced necks by
    springs whose axes lean as the notches do:
    :math:`K = \sum_h B_h^T k_h(t_h) B_h`, :math:`K q = d`, and the motion :math:`P q` of the probed
    body at the probe, divided by its component along the axis. In its plane, without deviations,
    this is the model of `flexstage.lumped.lumped_system`.

    Parameters
    ----------
    stage : Stage
        The stage, whose axes have a drive each; the other drives are removed.
    deviations : Deviations, optional
        Deviations of each sample; by default none.

    Returns
    -------
    dict of str to numpy.ndarray
        By axis: displacement along the axis (1), to its left and along the normal [m/m], and
        rotation about these three, roll, pitch and yaw [rad/m]; shape (samples, 6).

    Raises
    ------
    ModelError
        The stage has no axis, an axis has several drives or is a rotation, or the stage can move
        without deforming a hinge.

    Notes
    -----
    Validity: small displacements of rigid bodies; stiffness of a neck to first order in its
    thickness. Masses and errors of outlines have no effect at rest.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> rates = motion_rates(design("parallelogram"))["x"]
    >>> print(f"{rates[0, 5] * 200e-6 * 1e6:.2f} urad over 200 um")
    -3.19 urad over 200 um
    """
    if not stage.axes:
        raise ModelError(f"stage '{stage.name}' has no axis: there is no motion to compute")
    deviation = deviations or _none(stage)
    model = mechanism(stage)
    K = _stiffness(stage, model, deviation)
    drives = {d.name: i for i, d in enumerate(model.drives)}
    forces = np.stack(
        [
            _sight_row(model, model.drives[i], deviation.drive[:, i])[:, 0]
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
        motion = q[:, :, k] @ row.T
        rates[axis.name] = motion / motion[:, :1]
    return rates


def drive_of(axis: Axis) -> str:
    """Return the only drive of an axis; refuse an axis with several drives."""
    return only_drive(axis.name, axis.moved_by, ModelError)


def _none(stage: Stage) -> Deviations:
    h, d = len(stage.hinges), len(stage.drives)
    return Deviations(
        neck=np.zeros((1, h)),
        position=np.zeros((1, h, 2)),
        lean=np.zeros((1, h, 2)),
        drive=np.zeros((1, d, 2)),
    )


def _stiffness(stage: Stage, model: Mechanism, deviation: Deviations) -> Array:
    """Return the stiffness matrix of every sample, shape (samples, n, n)."""
    samples = deviation.neck.shape[0]
    n = 6 * len(model.free)
    K = np.zeros((samples, n, n))
    for i, (spring, hinge) in enumerate(zip(hinge_springs(stage), model.hinges, strict=True)):
        nominal, slope = _spring(stage, spring)
        k = nominal + slope * deviation.neck[:, i, None, None]
        at = np.zeros((samples, 3))
        at[:, :2] = hinge.at + deviation.position[:, i]
        axes = _leaning(deviation.lean[:, i]) @ _axes(hinge.direction)
        b = _difference(model, hinge.bodies, at, axes)
        columns = np.flatnonzero(b.any(axis=(0, 1)))
        b = b[:, :, columns]
        K[:, columns[:, None], columns] += np.swapaxes(b, 1, 2) @ k @ b
    return K


def _spring(stage: Stage, spring: HingeSpring) -> tuple[Array, Array]:
    """Return the stiffness of a hinge in six coordinates and its derivative by the neck."""
    hinge, material = spring.hinge, stage.material
    elastic = (material.youngs_modulus, material.poissons_ratio, stage.thickness)
    neck = hinge.profile.neck_thickness
    pair = []
    for part in (-_STEP, _STEP):
        profile = with_neck_thickness(hinge.profile, (1.0 + part) * neck)
        in_plane = compliance(
            profile,
            *elastic,
            method=spring.method,
            plane=spring.plane,
            root_widths=spring.root_widths,
            bodies=spring.bodies,
            root_reaches=spring.root_reaches,
        )
        k = np.zeros((6, 6))
        k[np.ix_(_IN_PLANE, _IN_PLANE)] = in_plane.stiffness
        k[_OUT_OF_PLANE, _OUT_OF_PLANE] = 1.0 / out_of_plane_compliance(profile, *elastic)
        pair.append(k)
    slope = (pair[1] - pair[0]) / (2.0 * _STEP * neck)
    middle = 0.5 * (pair[0] + pair[1])
    middle[np.ix_(_IN_PLANE, _IN_PLANE)] = spring.stiffness
    return middle, slope


def _axes(direction: float) -> Array:
    """Return the axes along, across and normal as columns, shape (3, 3)."""
    c, s = np.cos(direction), np.sin(direction)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _leaning(lean: Array) -> Array:
    """Return rotations by small angles about x and y, to third order, shape (samples, 3, 3)."""
    turn = _cross(np.concatenate((lean, np.zeros((len(lean), 1))), axis=1))
    return np.eye(3) + turn + 0.5 * turn @ turn


def _cross(v: Array) -> Array:
    """Return matrices of the cross product from the left, shape (..., 3, 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


def _difference(model: Mechanism, bodies: tuple[int, int], at: Array, axes: Array) -> Array:
    """Return the relative motion of two bodies at a point, in some axes, shape (samples, 6, n)."""
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
    """Return the relative motion at the point of a drive or probe, shape (samples, 6, n).

    Push and reaction share a line of action; `off` is its offset to the left and along the normal.
    """
    if sight.direction is None:
        raise ModelError(
            f"probe '{sight.name}' reads a rotation: the probe of an axis must read a displacement"
        )
    axes = _axes(sight.direction)
    at = np.array([*sight.points[1], 0.0]) + off @ axes[:, 1:].T
    return _difference(model, sight.bodies, at, axes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorMotion:
    """Motion of a body along an axis, with its error motions, of many samples.

    Axes: 1 along, 2 to its left, 3 along the normal of the plate.
    """

    along: Array
    """Travel [m], shape (k,)."""
    displacement: Array
    """Displacement of a point in addition to the travel [m], shape (samples, k, 3)."""
    rotation: Array
    """Roll, pitch and yaw: rotation about the three axes [rad], shape (samples, k, 3)."""

    def at(self, offset: tuple[float, float, float]) -> "ErrorMotion":
        r"""Return the motion of another point of the body: Abbe errors in all directions.

        :math:`u' = u + \theta\times r`, for displacement and straightness (J. B. Bryan, Precision
        Engineering 1 (1979) 129).

        Examples
        --------
        >>> tilting = ErrorMotion(along=np.array([1e-4]), displacement=np.zeros((1, 1, 3)),
        ...                       rotation=np.array([[[3e-6, 0.0, 0.0]]]))
        >>> above = tilting.at((0.0, 0.0, 20e-3))  # 3 urad of roll, 20 mm above
        >>> print(f"{above.displacement[0, 0, 1] * 1e9:.0f} nm")
        -60 nm
        """
        abbe = np.cross(self.rotation, np.array(offset))
        return replace(self, displacement=self.displacement + abbe)

    def with_assembly(self, squareness: Array, tilt: Array) -> "ErrorMotion":
        """Return the motion of a guide with mounting errors.

        It is turned in its plane and tilted out of it by angles of each sample [rad], shape
        (samples,).
        """
        offset = np.zeros_like(self.displacement)
        offset[..., 1] = squareness[:, None] * self.along
        offset[..., 2] = tilt[:, None] * self.along
        return replace(self, displacement=self.displacement + offset)


def error_motion(
    along: Array, across: Array, yaw: Array, rates: Array, mean: Mapping[str, float] | None = None
) -> ErrorMotion:
    """Return the motion of the nominal stage with the error motions by scatter.

    Parameters
    ----------
    along, across, yaw : numpy.ndarray
        Path of the nominal stage [m, m, rad], shape (k,).
    rates : numpy.ndarray
        Error motions of each sample per metre, from `motion_rates`, shape (samples, 6).
    mean : mapping, optional
        Error motions of all samples per metre: ``across`` [m/m] and ``yaw`` [rad/m].
    """
    added = mean or {}
    motion = rates[:, None, :] * along[None, :, None]
    displacement, rotation = motion[..., :3].copy(), motion[..., 3:].copy()
    displacement[..., 0] = 0.0
    displacement[..., 1] += across + added.get("across", 0.0) * along
    rotation[..., 2] += yaw + added.get("yaw", 0.0) * along
    return ErrorMotion(along=along, displacement=displacement, rotation=rotation)
