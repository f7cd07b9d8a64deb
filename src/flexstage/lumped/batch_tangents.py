r"""How what the lumped model is made of changes with parameters, and its systems with that.

The description of a stage (integrals over bodies, quadratures of notches) is differentiated by
central differences of fourth order; from there on everything is analytic, by the product rule.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import FlexstageError, ModelError
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.lumped.assemble import (
    WITH_ROOTS,
    cached_compliance,
    cached_stress_rows,
    hinge_springs,
)
from flexstage.lumped.batch import (
    FIELDS,
    StageArrays,
    assemble_batch,
    described,
    require_topology,
    stage_arrays,
)
from flexstage.stage import Hinge, Stage, root_widths
from flexstage.stage.mass import body_mass
from flexstage.system.batch import SystemBatch, arrays_of
from flexstage.system.mechanical import STANDARD_GRAVITY

# Steps of differences by their order, of the value that is changed. What fourth order leaves out is
# some hundred times the fourth power; what rounding adds is 1e-13 of the description over the step.
_STEPS = {2: 2e-5, 4: 5e-4}
# Steps of hinges in place [m] and direction [rad]: twice as far they still grow from their edges.
_STEP_PLACE, _STEP_DIRECTION = 2e-7, 1e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageTangents:
    """Derivatives of what the lumped model of a stage is made of, by some parameters."""

    names: tuple[str, ...]
    """The parameters; p of them."""
    arrays: StageArrays
    """What it is made of, one sample."""
    slopes: StageArrays
    """The derivatives, with a leading axis of p; of 1 where they are zero."""

    def joined(self, *others: "StageTangents") -> "StageTangents":
        """Return these parameters and those of others, of the same stage.

        Parameters
        ----------
        *others : StageTangents
            The others.

        Returns
        -------
        StageTangents
            All of them.
        """
        every = (self, *others)

        def column(field: str) -> Array:
            parts = [(len(t.names), getattr(t.slopes, field)) for t in every]
            return np.concatenate([np.broadcast_to(x, (n, *x.shape[1:])) for n, x in parts])

        return StageTangents(
            names=tuple(name for t in every for name in t.names),
            arrays=self.arrays,
            slopes=replace(self.slopes, **{field: column(field) for field in FIELDS}),
        )


def parameter_tangents(
    build: Callable[[float], Stage],
    value: float,
    *,
    name: str = "parameter",
    step: float | None = None,
    order: Literal[2, 4] = 4,
    arrays: StageArrays | None = None,
) -> StageTangents:
    r"""Return the derivatives of what the lumped model is made of by a parameter.

    .. math:: f'(x) = \frac{8(f(x+h) - f(x-h)) - (f(x+2h) - f(x-2h))}{12 h} + O(h^4)

    of the description alone: no model is solved. Where it ends on one side, five values on the
    other one serve (B. Fornberg, Math. Comp. 51 (1988) 699, tables 1 and 3).

    Parameters
    ----------
    build : callable
        From a value of the parameter to a stage.
    value : float
        The value at which it is changed.
    name : str
        The name of the parameter.
    step : float, optional
        The step h; 1/2000 of the value where not given, of second order 1/50 000.
    order : int
        Order of the difference: 4, or 2 for half of the work and still some 1e-8 of the derivative.
    arrays : StageArrays, optional
        What the stage is made of at `value`, where it is known.

    Returns
    -------
    StageTangents
        The derivatives, by one parameter.

    Raises
    ------
    ModelError
        The step is zero, or the topology changes with the parameter.
    FlexstageError
        A stage cannot be built a few steps from the value, to neither side.

    Notes
    -----
    Validity: hinges stay in the plane state that they have at the value. Where the description has
    a kink there, as a root at the middle of its edge, it is the mean of both sides.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from flexstage.designs import design
    >>> stage = design("parallelogram")
    >>> found = parameter_tangents(lambda t: replace(stage, thickness=t), stage.thickness)
    >>> per_thickness = found.slopes.hinge_stiffness * stage.thickness
    >>> bool(np.allclose(per_thickness, found.arrays.hinge_stiffness))
    True
    """
    h = _STEPS[order] * abs(value) if step is None else step
    if not h > 0.0:
        raise ModelError(f"the step of parameter '{name}' must be positive, got {h!r}: give one")
    if arrays is None:
        arrays = stage_arrays([build(value)])
    nominal = arrays.stage
    planes: list[PlaneState] = [
        s.plane for s in hinge_springs(nominal, method=arrays.method, plane=arrays.plane)
    ]

    def values(k: int) -> tuple[Array, ...]:
        stage = build(value + k * h)
        require_topology(nominal, stage)
        owner, found = described(stage, arrays.method, arrays.plane, planes)
        if owner != arrays.stress_owner:
            raise ModelError(
                f"a flat part of a hinge begins or ends near {value:.6g} of parameter '{name}': "
                "choose another value, or a shorter step"
            )
        return tuple(
            _unwound(x, getattr(arrays, field)[0]) if field.endswith("direction") else x
            for field, x in zip(FIELDS, found, strict=True)
        )

    found, weights = _around(values, order)
    slopes = {
        field: _difference([part[i] for part in found], weights, h)[None]
        for i, field in enumerate(FIELDS)
    }
    return StageTangents(names=(name,), arrays=arrays, slopes=replace(arrays, **slopes))


# Weights of values so many steps away, by order: to both sides, and ahead of the value.
_CENTRAL = {2: {1: 0.5, -1: -0.5}, 4: {1: 8 / 12, -1: -8 / 12, 2: -1 / 12, -2: 1 / 12}}
_AHEAD = {
    2: {0: -1.5, 1: 2.0, 2: -0.5},
    4: {0: -25 / 12, 1: 48 / 12, 2: -36 / 12, 3: 16 / 12, 4: -3 / 12},
}


def _around(
    values: Callable[[int], tuple[Array, ...]], order: int
) -> tuple[list[tuple[Array, ...]], Array]:
    """Values some steps to both sides, or to one where there are none on the other; weights."""
    ahead = _AHEAD[order]
    refused: list[FlexstageError] = []
    for weights in (_CENTRAL[order], {-k: -w for k, w in ahead.items()}, ahead):
        try:
            return [values(k) for k in weights], np.array(list(weights.values()))
        except FlexstageError as error:
            refused.append(error)
    raise refused[0]


def _difference(values: Sequence[Array], weights: Array, h: float) -> Array:
    """Derivative from values some steps away."""
    with np.errstate(invalid="ignore"):
        slope = sum(w * x for w, x in zip(weights, values, strict=True)) / h
    # what is infinite or unknown stays so
    return np.where(np.isfinite(slope), slope, 0.0)


def _unwound(angle: Array, about: Array) -> Array:
    """Angles as near to others as whole turns allow."""
    return angle - 2.0 * np.pi * np.round((angle - about) / (2.0 * np.pi))


def hinge_tangents(stage: Stage, *, method: str = "wedge") -> StageTangents:
    """Return derivatives by what each hinge, the plate and its material are on their own.

    Parameters
    ----------
    stage : Stage
        The stage.
    method : str
        How the stiffness of hinges is found, as in `flexstage.lumped.lumped_system`.

    Returns
    -------
    StageTangents
        By the ``thickness`` of the plate [m], ``youngs_modulus`` [Pa] and ``density`` [kg/m^3],
        then by hinge ``NAME.neck_thickness`` [m], ``NAME.x`` and ``NAME.y`` of its place [m] and
        ``NAME.direction`` [rad].

    Notes
    -----
    Validity: outlines of bodies stay; the half notches, which belong to them, go with the hinge,
    and so does the width behind its roots.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> hinge_tangents(design("parallelogram")).names[:5]
    ('thickness', 'youngs_modulus', 'density', 'left-lower.neck_thickness', 'left-lower.x')
    """
    arrays = stage_arrays([stage], method=method)
    material = stage.material

    def of_material(name: str) -> StageTangents:
        return parameter_tangents(
            lambda v: replace(stage, material=replace(material, **{name: v})),
            getattr(material, name),
            name=name,
            arrays=arrays,
        )

    whole = parameter_tangents(
        lambda t: replace(stage, thickness=t), stage.thickness, name="thickness", arrays=arrays
    ).joined(of_material("youngs_modulus"), of_material("density"))
    springs = hinge_springs(stage, method=method)
    owner = np.array(arrays.stress_owner)
    bodies = {body.name: i for i, body in enumerate(stage.bodies)}
    elastic = material.youngs_modulus, material.poissons_ratio

    def changed(i: int, hinge: Hinge) -> tuple[Array, ...]:
        """What belongs to a hinge and to its two bodies."""
        plane = springs[i].plane
        roots = root_widths(stage, hinge) if method in WITH_ROOTS else None
        spring = cached_compliance(hinge.profile, elastic, stage.thickness, method, plane, roots)
        hinges = [*stage.hinges[:i], hinge, *stage.hinges[i + 1 :]]
        masses = [body_mass(stage, name, hinges) for name in hinge.bodies]
        return (
            spring.stiffness,
            cached_stress_rows(hinge.profile, stage.thickness, elastic[1], plane),
            np.array([m.mass for m in masses]),
            np.array([m.inertia for m in masses]),
            np.array([m.centre for m in masses]),
            np.array(hinge.at),
            np.array(hinge.direction),
        )

    names: list[str] = []
    central = np.array(list(_CENTRAL[4].values()))
    count = 4 * len(stage.hinges)
    slopes = {name: np.zeros((count, *x.shape[1:])) for name, x in arrays_of(arrays).items()}
    for i, hinge in enumerate(stage.hinges):
        joined = [bodies[name] for name in hinge.bodies]
        for parameter, step, change in _changes(hinge):
            p = len(names)
            names.append(f"{hinge.name}.{parameter}")
            parts = [changed(i, change(k * step)) for k in _CENTRAL[4]]
            slope = [_difference(values, central, step) for values in zip(*parts, strict=True)]
            slopes["hinge_stiffness"][p, i] = slope[0]
            slopes["stress_rows"][p, owner == i] = slope[1]
            slopes["mass"][p, joined] = slope[2]
            slopes["inertia"][p, joined] = slope[3]
            slopes["centre"][p, joined] = slope[4]
            slopes["hinge_at"][p, i] = slope[5]
            slopes["hinge_direction"][p, i] = slope[6]
    if not names:
        return whole
    return whole.joined(
        StageTangents(names=tuple(names), arrays=arrays, slopes=replace(arrays, **slopes))
    )


def _changes(hinge: Hinge) -> list[tuple[str, float, Callable[[float], Hinge]]]:
    """Parameters of a hinge, a step of each, and the hinge with it changed by so much."""
    profile, (x, y) = hinge.profile, hinge.at
    neck = profile.neck_thickness
    return [
        (
            "neck_thickness",
            _STEPS[4] * neck,
            lambda d: replace(hinge, profile=replace(profile, neck_thickness=neck + d)),
        ),
        ("x", _STEP_PLACE, lambda d: replace(hinge, at=(x + d, y))),
        ("y", _STEP_PLACE, lambda d: replace(hinge, at=(x, y + d))),
        ("direction", _STEP_DIRECTION, lambda d: replace(hinge, direction=hinge.direction + d)),
    ]


def system_tangents(tangents: StageTangents) -> tuple[SystemBatch, SystemBatch]:
    r"""Return the system of a stage, and its derivatives by the parameters.

    By the product rule of the assembly: with the deformation :math:`e = Bq` of a hinge,

    .. math::

        \dot K = \sum \dot B^T k B + B^T \dot k B + B^T k \dot B

    Parameters
    ----------
    tangents : StageTangents
        Derivatives of what it is made of.

    Returns
    -------
    tuple of SystemBatch
        The system, one sample; its derivatives, with a leading axis of the parameters.

    Raises
    ------
    ModelError
        Every body is fixed.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> system, slopes = system_tangents(hinge_tangents(design("parallelogram")))
    >>> system.stiffness.shape[0], slopes.stiffness.shape[0]
    (1, 19)
    """
    a, d, count = tangents.arrays, tangents.slopes, len(tangents.names)
    batch, stage = assemble_batch(a), a.stage
    every = {body.name: i for i, body in enumerate(stage.bodies)}
    moving = [i for i, body in enumerate(stage.bodies) if not body.fixed]

    def arms(at: Array, at_slope: Array, names: Sequence[str]) -> tuple[Array, Array]:
        bodies = [every[name] for name in names]
        return at - a.centre[:, bodies], at_slope - d.centre[:, bodies]

    stiffness = np.zeros((count, *batch.stiffness.shape[1:]))
    stress = np.zeros((count, *batch.stress.shape[1:]))
    if stage.hinges:
        sides = [
            arms(a.hinge_at, d.hinge_at, [h.bodies[side] for h in stage.hinges]) for side in (0, 1)
        ]
        b, b_slope = _deformations(a.hinge_direction, d.hinge_direction, sides)
        k, k_slope = a.hinge_stiffness, d.hinge_stiffness
        force, force_slope = k @ b, k_slope @ b + k @ b_slope
        part = _turned(b_slope) @ force + _turned(b) @ force_slope
        stiffness += _scattered(batch, stage, np.broadcast_to(part, (count, *part.shape[1:])))
        owner = list(a.stress_owner)
        if owner:
            rows, rows_slope = a.stress_rows[:, :, None, :], d.stress_rows[:, :, None, :]
            found = rows_slope @ force[:, owner] + rows @ force_slope[:, owner]
            stress += found.reshape(*found.shape[:2], 2, 3)
    drive = np.zeros((count, *batch.drive.shape[1:]))
    if stage.drives:
        for side, name in enumerate(("pushes", "reacts")):
            pair = arms(a.drive_at, d.drive_at, [getattr(x, name) for x in stage.drives])
            row = _row_slope(a.drive_direction, d.drive_direction, *pair)
            drive[:, :, side] += (1.0, -1.0)[side] * row
    probe = np.zeros((count, *batch.probe.shape[1:]))
    along = np.zeros((count, *batch.weight_direction.shape[1:]))
    for i, p in enumerate(stage.probes):
        if p.unit == "rad":
            continue
        phi, turn = a.probe_direction[:, i], d.probe_direction[:, i]
        along[:, i] = np.stack((-np.sin(phi) * turn, np.cos(phi) * turn), axis=-1)
        for side, name in enumerate((p.body, p.relative_to)):
            if name is not None:
                pair = arms(a.probe_at[:, [i]], d.probe_at[:, [i]], [name])
                row = _row_slope(phi[:, None], turn[:, None], *pair)
                probe[:, i, side] = (1.0, -1.0)[side] * row[:, 0]
    mass = np.stack((d.mass, d.mass, d.inertia), axis=-1)[:, moving]
    return batch, replace(
        batch,
        mass=mass.reshape(mass.shape[0], -1),
        stiffness=stiffness,
        drive=drive,
        probe=probe,
        stress=stress,
        weight=d.mass[:, moving] * STANDARD_GRAVITY,
        weight_direction=along,
        body_mass=d.mass,
        **{
            name: getattr(d, name)
            for name in (
                "drive_at",
                "probe_at",
                "drive_stiffness",
                "stroke",
                "smallest_displacement",
                "largest_force",
                "strength",
                "size",
            )
        },
    )


def _turned(x: Array) -> Array:
    return np.swapaxes(x, -1, -2)


def _deformations(
    angle: Array, turn: Array, sides: Sequence[tuple[Array, Array]]
) -> tuple[Array, Array]:
    """Deformation of each hinge for the coordinates of its bodies, and its derivatives.

    Shapes (1, h, 3, 6) and (p, h, 3, 6).
    """
    c, s = np.cos(angle), np.sin(angle)
    frame, frame_slope = np.zeros((*angle.shape, 3, 3)), np.zeros((*angle.shape, 3, 3))
    frame[..., 0, 0], frame[..., 0, 1], frame[..., 1, 0], frame[..., 1, 1] = c, s, -s, c
    frame[..., 2, 2] = 1.0
    frame_slope[..., :2, :2] = np.stack(
        (np.stack((-s, c), axis=-1), np.stack((-c, -s), axis=-1)), axis=-2
    )
    frame_slope = frame_slope * turn[..., None, None]
    value, slope = [], []
    for sign, (arm, arm_slope) in zip((-1.0, 1.0), sides, strict=True):
        point = np.zeros((*arm.shape[:2], 3, 3))
        point[..., 0, 0] = point[..., 1, 1] = point[..., 2, 2] = 1.0
        point[..., 0, 2], point[..., 1, 2] = -arm[..., 1], arm[..., 0]
        point_slope = np.zeros((*arm_slope.shape[:2], 3, 3))
        point_slope[..., 0, 2], point_slope[..., 1, 2] = -arm_slope[..., 1], arm_slope[..., 0]
        value.append(sign * (frame @ point))
        slope.append(sign * (frame_slope @ point + frame @ point_slope))
    return np.concatenate(value, axis=-1), np.concatenate(slope, axis=-1)


def _scattered(batch: SystemBatch, stage: Stage, part: Array) -> Array:
    """Add 6 x 6 parts of hinges, (p, h, 6, 6), to the blocks of a batch."""
    free = [body.name for body in stage.bodies if not body.fixed]
    number = {name: i for i, name in enumerate(free)}
    place = {at: i for i, at in enumerate(batch.blocks)}
    out = np.zeros((part.shape[0], len(place), 3, 3))
    for h, hinge in enumerate(stage.hinges):
        at = [number.get(name, -1) for name in hinge.bodies]
        for i in range(2):
            for j in range(2):
                # below the diagonal; both of a body with itself stand on it
                if min(at[i], at[j]) >= 0 and (at[i] > at[j] or i == j):
                    block = part[:, h, 3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
                    out[:, place[at[i], at[j]]] += block
    return out


def _row_slope(angle: Array, turn: Array, arm: Array, arm_slope: Array) -> Array:
    """Derivatives of the row (c, s, s X - c Y) for the coordinates of a body."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = arm[..., 0], arm[..., 1]
    moment = turn * (c * x + s * y) + s * arm_slope[..., 0] - c * arm_slope[..., 1]
    return np.stack(np.broadcast_arrays(-s * turn, c * turn, moment), axis=-1)
