r"""Data of the lumped models of many stages of one topology, and their derivatives.

Masses, positions of hinges and drives, and stiffness of hinges, with a leading axis of samples.
They come from stages, or from any function that changes these numbers. Where parameters change it,
the description (integrals over bodies, quadratures of notches) is differentiated by central
differences of fourth order; from there on everything is analytic (`system_tangents`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import FlexstageError, ModelError
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.lumped.assemble import (
    cached_stress_rows,
    hinge_springs,
)
from flexstage.stage import Force, Stage, mass_properties
from flexstage.stage.mass import outer_size
from flexstage.system.batch import StageNumbers, arrays_of
from flexstage.system.characteristics import pulsating_limit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StageArrays(StageNumbers):
    """Data of the lumped models of many stages of one topology."""

    method: str
    """Method of hinge stiffness, of the nominal stage."""
    plane: PlaneState | Literal["auto"]
    """Plane state of its hinges."""
    mass: Array
    """Mass of each body [kg], shape (S, b)."""
    inertia: Array
    """Moment of inertia of each body about its centre of mass [kg m^2], shape (S, b)."""
    centre: Array
    """Centre of mass of each body [m], shape (S, b, 2)."""
    hinge_at: Array
    """Centre of each neck [m], shape (S, h, 2)."""
    hinge_direction: Array
    """Direction of each hinge [rad], shape (S, h)."""
    hinge_stiffness: Array
    """Stiffness of each hinge about its neck in its own axes, shape (S, h, 3, 3)."""
    stress_rows: Array
    """Signed equivalent stress at each critical place for the forces (N, V, M) in the neck [1/m^2,
    1/m^2, 1/m^3], shape (S, r, 3).
    """
    stress_owner: tuple[int, ...]
    """The hinge of each place, as a number; r of them."""
    drive_direction: Array
    """Direction of each drive [rad], shape (S, d)."""
    probe_direction: Array
    """Direction of each probe [rad]; not used of a rotation; shape (S, p)."""

    def mapped(self, change: Callable[[Array], Any]) -> "StageArrays":
        """Return the same with every array changed, say into that of another library.

        Parameters
        ----------
        change : callable
            From an array to an array.

        Returns
        -------
        StageArrays
            The new arrays.
        """
        return replace(self, **{name: change(x) for name, x in arrays_of(self).items()})

    def part(self, start: int, stop: int) -> "StageArrays":
        """Return some samples, those from `start` to before `stop`.

        Parameters
        ----------
        start : int
            The first one.
        stop : int
            The one after the last.

        Returns
        -------
        StageArrays
            Their arrays.
        """
        stop = min(stop, self.samples)
        return self.mapped(lambda x: x if x.shape[0] == 1 else x[start:stop, ...])


def stage_arrays(
    stages: Sequence[Stage],
    *,
    method: str = "wedge",
    plane: PlaneState | Literal["auto"] = "auto",
    nominal: Stage | None = None,
) -> StageArrays:
    """Return the data of the lumped models of stages of one topology.

    Parameters
    ----------
    stages : Sequence of Stage
        The stages: the same names of bodies, hinges, drives, probes and axes, joined in the same
        way.
    method : str
        Method of hinge stiffness, as in `flexstage.lumped.lumped_system`.
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose for each hinge by width against neck.
    nominal : Stage, optional
        The stage that decides the properties common to all samples; the first where not given.

    Returns
    -------
    StageArrays
        Arrays with a leading axis of samples.

    Raises
    ------
    ModelError
        The sequence is empty, or a stage has another topology than the nominal one.
    StageError
        A hinge is not attached to its bodies.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> stage_arrays([design("vgtu-piezo")]).hinge_stiffness.shape
    (1, 32, 3, 3)
    """
    if not stages:
        raise ModelError("a batch needs at least one stage, got none")
    nominal = stages[0] if nominal is None else nominal
    rows = []
    for stage in stages:
        require_topology(nominal, stage)
        rows.append(described(stage, method, plane))
    owners = {owner for owner, _ in rows}
    if len(owners) > 1:
        raise ModelError(
            f"a hinge of '{nominal.name}' has a flat part in some stages of a batch and none in "
            "others, so that its stress is read at other places: analyse these one by one"
        )
    return StageArrays(
        stage=nominal,
        method=method,
        plane=plane,
        stress_owner=owners.pop(),
        **{field: np.stack([values[field] for _, values in rows]) for field in rows[0][1]},
    )


def require_topology(nominal: Stage, stage: Stage) -> None:
    """Refuse a stage of another topology than the nominal one."""
    if stage is not nominal and _topology(stage) != _topology(nominal):
        raise ModelError(
            f"stage '{stage.name}' is not of the topology of '{nominal.name}': a batch needs the "
            "same bodies, hinges, drives, probes and axes, joined in the same way"
        )


def _topology(stage: Stage) -> tuple[object, ...]:
    return (
        tuple((b.name, b.fixed) for b in stage.bodies),
        tuple((h.name, h.bodies) for h in stage.hinges),
        tuple(
            (d.name, type(d), d.pushes, d.reacts, d.mounted.stiffness is None) for d in stage.drives
        ),
        tuple((p.name, p.body, p.relative_to, p.unit) for p in stage.probes),
        stage.axes,
    )


def described(
    stage: Stage,
    method: str,
    plane: PlaneState | Literal["auto"],
    planes: Sequence[PlaneState] | None = None,
) -> tuple[tuple[int, ...], dict[str, Array]]:
    """Return the owner of each place of stress, and the arrays of one stage by field.

    With `planes` the hinges are in these plane states, whatever `plane` would choose.
    """
    masses = list(mass_properties(stage).values())
    springs = hinge_springs(stage, method=method, plane=plane)
    if planes is not None and [s.plane for s in springs] != list(planes):
        in_state = {p: hinge_springs(stage, method=method, plane=p) for p in set(planes)}
        springs = tuple(in_state[p][i] for i, p in enumerate(planes))
    nu = stage.material.poissons_ratio
    rows = [cached_stress_rows(s.hinge.profile, stage.thickness, nu, s.plane) for s in springs]
    owner = tuple(i for i, row in enumerate(rows) for _ in row)

    def numbers(values: Sequence[float | None], *shape: int) -> Array:
        numbers_or_nan = [math.nan if v is None else v for v in values]
        return np.array(numbers_or_nan, dtype=np.float64).reshape(-1, *shape)

    drives, mounted = stage.drives, [d.mounted for d in stage.drives]
    return owner, {
        "mass": numbers([m.mass for m in masses]),
        "inertia": numbers([m.inertia for m in masses]),
        "centre": numbers([v for m in masses for v in m.centre], 2),
        "hinge_at": numbers([v for h in stage.hinges for v in h.at], 2),
        "hinge_direction": numbers([h.direction for h in stage.hinges]),
        "hinge_stiffness": np.array([s.stiffness for s in springs]).reshape(-1, 3, 3),
        "stress_rows": np.concatenate([np.zeros((0, 3)), *rows]),
        "drive_at": numbers([v for d in drives for v in d.at[0]], 2),
        "drive_direction": numbers([d.direction for d in drives]),
        "drive_stiffness": numbers(
            [math.inf if m.stiffness is None else m.stiffness for m in mounted]
        ),
        "stroke": numbers([m.stroke for m in mounted]),
        "smallest_displacement": numbers([m.smallest_displacement for m in mounted]),
        "largest_force": numbers(
            [d.largest_force if isinstance(d, Force) else None for d in drives]
        ),
        "probe_at": numbers([v for p in stage.probes for v in p.at], 2),
        "probe_direction": numbers([p.direction or 0.0 for p in stage.probes]),
        "strength": numbers([stage.material.yield_strength, pulsating_limit(stage.material)]),
        "size": numbers(outer_size(stage)),
    }


# Steps of differences by their order, of the value that is changed. What fourth order leaves out is
# some hundred times the fourth power; what rounding adds is 1e-13 of the description over the step.
_STEPS = {2: 2e-5, 4: 5e-4}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageTangents:
    """Derivatives of the data of the lumped model of a stage, by parameters."""

    names: tuple[str, ...]
    """The parameters; p of them."""
    arrays: StageArrays
    """Data of the stage, one sample."""
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

        columns: dict[str, Any] = {field: column(field) for field in arrays_of(self.slopes)}
        return StageTangents(
            names=tuple(name for t in every for name in t.names),
            arrays=self.arrays,
            slopes=replace(self.slopes, **columns),
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
    r"""Return the derivatives of the data of the lumped model by a parameter.

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
        Data of the stage at `value`, where known.

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
    >>> from flexstage.stage.designs import design
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

    def values(k: int) -> dict[str, Array]:
        stage = build(value + k * h)
        require_topology(nominal, stage)
        owner, fields = described(stage, arrays.method, arrays.plane, planes)
        if owner != arrays.stress_owner:
            raise ModelError(
                f"a flat part of a hinge begins or ends near {value:.6g} of parameter '{name}': "
                "choose another value, or a shorter step"
            )
        for field in ("hinge_direction", "drive_direction", "probe_direction"):
            # as near to the nominal angle as whole turns allow
            turns = (fields[field] - getattr(arrays, field)[0]) / (2.0 * np.pi)
            fields[field] = fields[field] - 2.0 * np.pi * np.round(turns)
        return fields

    values_around, weights = _around(values, order)
    slopes: dict[str, Any] = {}
    for field in values_around[0]:
        with np.errstate(invalid="ignore"):
            parts = zip(weights, (part[field] for part in values_around), strict=True)
            slope = sum(w * x for w, x in parts) / h
        # what is infinite or unknown stays so
        slopes[field] = np.where(np.isfinite(slope), slope, 0.0)[None]
    return StageTangents(names=(name,), arrays=arrays, slopes=replace(arrays, **slopes))


# Weights of values so many steps away, by order: to both sides, and ahead of the value.
_CENTRAL = {2: {1: 0.5, -1: -0.5}, 4: {1: 8 / 12, -1: -8 / 12, 2: -1 / 12, -2: 1 / 12}}
_AHEAD = {
    2: {0: -1.5, 1: 2.0, 2: -0.5},
    4: {0: -25 / 12, 1: 48 / 12, 2: -36 / 12, 3: 16 / 12, 4: -3 / 12},
}


def _around(
    values: Callable[[int], dict[str, Array]], order: int
) -> tuple[list[dict[str, Array]], Array]:
    """Return values a few steps to both sides, or to one if the other has none, and weights."""
    ahead = _AHEAD[order]
    refused: list[FlexstageError] = []
    for weights in (_CENTRAL[order], {-k: -w for k, w in ahead.items()}, ahead):
        try:
            return [values(k) for k in weights], np.array(list(weights.values()))
        except FlexstageError as error:
            refused.append(error)
    raise refused[0]
