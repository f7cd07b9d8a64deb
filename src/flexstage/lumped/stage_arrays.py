r"""What the lumped model of many stages of one topology is made of.

Masses, where hinges and drives are, what hinges are as springs, with a leading axis of samples. It
comes from stages, or from anything that changes these numbers.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.lumped.assemble import cached_stress_rows, hinge_springs
from flexstage.short_repr import short_repr
from flexstage.stage import Force, Stage, mass_properties
from flexstage.stage.mass import outer_size
from flexstage.system.batch import arrays_of
from flexstage.system.characteristics import pulsating_limit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageArrays:
    """What the lumped model is made of, of many stages of one topology.

    An array that is the same for all samples may have a leading axis of 1.
    """

    stage: Stage
    """The nominal stage: names, and what is decided once for all samples."""
    method: str
    """How the stiffness of hinges is found, of the nominal stage."""
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
    drive_at: Array
    """Pushed point of each drive [m], shape (S, d, 2)."""
    drive_direction: Array
    """Direction of each drive [rad], shape (S, d)."""
    drive_stiffness: Array
    """Stiffness of each drive [N/m]; infinite if rigid, 0 for a pure force; shape (S, d)."""
    stroke: Array
    """Largest free displacement of each drive [m]; not a number for a force; shape (S, d)."""
    smallest_displacement: Array
    """Smallest commanded change of each drive [m]; not a number where unknown; shape (S, d)."""
    largest_force: Array
    """Largest force of each drive that is a pure force [N]; else not a number; shape (S, d)."""
    probe_at: Array
    """Point of each probe [m], shape (S, p, 2)."""
    probe_direction: Array
    """Direction of each probe [rad]; not used of a rotation; shape (S, p)."""
    strength: Array
    """Yield strength, and the largest pulsating stress that fatigue allows [Pa]; not a number where
    unknown; shape (S, 2).
    """
    size: Array
    """Width, height and thickness of the plate [m], shape (S, 3)."""

    __repr__ = short_repr

    @property
    def samples(self) -> int:
        """Number of samples S."""
        return max(x.shape[0] for x in arrays_of(self).values())

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
    """Return what the lumped model is made of, of stages of one topology.

    Parameters
    ----------
    stages : Sequence of Stage
        The stages: the same names of bodies, hinges, drives, probes and axes, joined alike.
    method : str
        How the hinges' stiffness is found, as in `flexstage.lumped.lumped_system`.
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose for each hinge by width against neck.
    nominal : Stage, optional
        The stage by which is decided what all samples have in common; the first where not given.

    Returns
    -------
    StageArrays
        Arrays with a leading axis of samples.

    Raises
    ------
    ModelError
        There is no stage, or one has another topology than the nominal one.
    StageError
        A hinge does not grow from its bodies.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> stage_arrays([design("vgtu-piezo")]).hinge_stiffness.shape
    (1, 32, 3, 3)
    """
    if not stages:
        raise ModelError("a batch needs at least one stage, got none")
    nominal = stages[0] if nominal is None else nominal
    found = []
    for stage in stages:
        require_topology(nominal, stage)
        found.append(described(stage, method, plane))
    owners = {owner for owner, _ in found}
    if len(owners) > 1:
        raise ModelError(
            f"a hinge of '{nominal.name}' has a flat part in some stages of a batch and none in "
            "others, so that its stress is read at other places: analyse these one by one"
        )
    columns = zip(*(values for _, values in found), strict=True)
    return StageArrays(
        stage=nominal,
        method=method,
        plane=plane,
        stress_owner=owners.pop(),
        **dict(zip(FIELDS, (np.stack(column) for column in columns), strict=True)),
    )


#: The arrays of `StageArrays`, in the order of `described`.
FIELDS = (
    "mass",
    "inertia",
    "centre",
    "hinge_at",
    "hinge_direction",
    "hinge_stiffness",
    "stress_rows",
    "drive_at",
    "drive_direction",
    "drive_stiffness",
    "stroke",
    "smallest_displacement",
    "largest_force",
    "probe_at",
    "probe_direction",
    "strength",
    "size",
)


def require_topology(nominal: Stage, stage: Stage) -> None:
    """Refuse a stage that is not joined as the nominal one is."""
    if stage is not nominal and _topology(stage) != _topology(nominal):
        raise ModelError(
            f"stage '{stage.name}' is not of the topology of '{nominal.name}': a batch needs the "
            "same bodies, hinges, drives, probes and axes, joined alike"
        )


def _topology(stage: Stage) -> tuple[object, ...]:
    return (
        tuple((b.name, b.fixed) for b in stage.bodies),
        tuple((h.name, h.bodies) for h in stage.hinges),
        tuple((d.name, type(d), d.pushes, d.reacts, d.spring is None) for d in stage.drives),
        tuple((p.name, p.body, p.relative_to, p.unit) for p in stage.probes),
        stage.axes,
    )


def described(
    stage: Stage,
    method: str,
    plane: PlaneState | Literal["auto"],
    planes: Sequence[PlaneState] | None = None,
) -> tuple[tuple[int, ...], tuple[Array, ...]]:
    """Owner of each place of stress, and the arrays of `FIELDS` of one stage.

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
        found = [math.nan if v is None else v for v in values]
        return np.array(found, dtype=np.float64).reshape(-1, *shape)

    drives = stage.drives
    return owner, (
        numbers([m.mass for m in masses]),
        numbers([m.inertia for m in masses]),
        numbers([v for m in masses for v in m.centre], 2),
        numbers([v for h in stage.hinges for v in h.at], 2),
        numbers([h.direction for h in stage.hinges]),
        np.array([s.stiffness for s in springs]).reshape(-1, 3, 3),
        np.concatenate([np.zeros((0, 3)), *rows]),
        numbers([v for d in drives for v in d.at[0]], 2),
        numbers([d.direction for d in drives]),
        numbers([math.inf if d.spring is None else d.spring for d in drives]),
        numbers([d.stroke for d in drives]),
        numbers([d.smallest_displacement for d in drives]),
        numbers([d.largest_force if isinstance(d, Force) else None for d in drives]),
        numbers([v for p in stage.probes for v in p.at], 2),
        numbers([p.direction or 0.0 for p in stage.probes]),
        numbers([stage.material.yield_strength, pulsating_limit(stage.material)]),
        numbers(outer_size(stage)),
    )
