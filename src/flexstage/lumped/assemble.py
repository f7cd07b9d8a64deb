"""The lumped model of a stage: rigid bodies joined by springs, straight from the description.

To first order: the motion of the two sides of each hinge, and the forces of the springs.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hinges import HingeCompliance, Profile, compliance, stress_rows
from flexstage.hinges.hinge_spring import (
    PLANE_RULE,
    ROOT_REACH,
    PlaneState,
    held_leaf_stiffening,
)
from flexstage.stage import (
    Drive,
    Hinge,
    MassProperties,
    Probe,
    Stage,
    mass_properties,
)
from flexstage.stage.contour import hinge_root, root_reach
from flexstage.system import Damping, MechanicalSystem
from flexstage.system.mechanical import (
    DEFAULT_DAMPING,
    STANDARD_GRAVITY,
    AxisPort,
    BodyPort,
    LoadPort,
    ProbePort,
    drive_port,
)
from flexstage.system.stress_map import StressMap


class BodyCoordinates:
    """Place of the coordinates of each body among those of the stage.

    A free body has three coordinates: the displacement x, y of its centre of mass [m] and its
    rotation [rad]. A fixed body has none.

    `centres` of mass are given for every body [m], `free` in order.
    """

    __slots__ = ("centres", "first", "free", "order")

    def __init__(self, centres: Mapping[str, tuple[float, float]], free: tuple[str, ...]) -> None:
        self.centres = dict(centres)
        self.free = free
        self.first = {name: 3 * i for i, name in enumerate(free)}
        self.order = 3 * len(free)

    def names(self) -> tuple[str, ...]:
        """Return a name with a unit for every coordinate, such as ``body.rotation [rad]``."""
        parts = (".x [m]", ".y [m]", ".rotation [rad]")
        return tuple(name + part for name in self.free for part in parts)


def point_matrix(layout: BodyCoordinates, body: str, at: tuple[float, float]) -> Array:
    """Return the motion of a point of a body for each coordinate.

    Displacement x, y and rotation, shape (3, n); zero for a fixed body.
    """
    matrix = np.zeros((3, layout.order))
    first = layout.first.get(body)
    if first is not None:
        cx, cy = layout.centres[body]
        matrix[0, first] = matrix[1, first + 1] = matrix[2, first + 2] = 1.0
        matrix[0, first + 2] = -(at[1] - cy)
        matrix[1, first + 2] = at[0] - cx
    return matrix


def hinge_matrix(layout: BodyCoordinates, hinge: Hinge) -> Array:
    """Return the deformation of a hinge for each coordinate.

    Motion of body b against body a at the neck, in the hinge's axes: along, across, rotation; shape
    (3, n).
    """
    a, b = hinge.bodies
    relative = point_matrix(layout, b, hinge.at) - point_matrix(layout, a, hinge.at)
    c, s = math.cos(hinge.direction), math.sin(hinge.direction)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ relative


#: Methods of hinge stiffness that include the roots in the bodies.
WITH_ROOTS = ("wedge", "finite-element")
# a flat part of so many necks is a leaf
_LEAF = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HingeSpring:
    """A hinge of the lumped model."""

    hinge: Hinge
    """The hinge."""
    stiffness: Array
    """Stiffness about the neck in the hinge's axes (along, across, rotation), shape (3, 3)."""
    method: str
    """Method of the stiffness."""
    plane: PlaneState
    """``stress`` or ``strain``."""
    root_widths: tuple[float, float] | None
    """Widths of the two bodies behind the roots [m]; None without the roots."""
    root_reaches: tuple[float, float]
    """How far the roots reach into the two bodies, in heights of the root [1]."""
    bodies: tuple[tuple[float, float], tuple[float, float]] | None
    """Young's modulus [Pa] and Poisson's ratio of them; None where they are those of the plate."""


@lru_cache(maxsize=64)
def _masses(stage: Stage) -> dict[str, MassProperties]:
    return mass_properties(stage)


@lru_cache(maxsize=4096)
def cached_compliance(
    profile: Profile,
    elastic: tuple[float, float],
    width: float,
    method: str,
    plane: PlaneState | Literal["auto"],
    roots: tuple[float, float] | None,
    bodies: tuple[tuple[float, float], tuple[float, float]] | None = None,
    reaches: tuple[float, float] = (ROOT_REACH, ROOT_REACH),
) -> HingeCompliance:
    """Return the compliance of a notch, of which a stage has dozens."""
    return compliance(
        profile,
        *elastic,
        width,
        method=method,
        plane=plane,
        root_widths=roots,
        bodies=bodies,
        root_reaches=reaches,
    )


@lru_cache(maxsize=4096)
def cached_stress_rows(profile: Profile, width: float, poisson: float, plane: PlaneState) -> Array:
    """Return the rows of stress of a notch, of which a stage has dozens."""
    return stress_rows(profile, width, poisson, plane)


def hinge_springs(
    stage: Stage,
    *,
    method: str = "wedge",
    plane: PlaneState | Literal["auto"] = "auto",
) -> tuple[HingeSpring, ...]:
    """Return the spring of every hinge.

    Parameters
    ----------
    stage : Stage
        The stage.
    method : str
        ``wedge`` or ``finite-element`` (with the roots in the bodies), ``timoshenko`` or
        ``euler-bernoulli`` (without).
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width against neck.

    Returns
    -------
    tuple of HingeSpring
        In the order of the stage.

    Raises
    ------
    HingeError
        The method is unknown.
    StageError
        A hinge is not attached to its bodies.
    """
    return _springs(stage, method, plane)


# A description is immutable, so what follows from its geometry alone is found once for each stage.
@lru_cache(maxsize=64)
def _springs(
    stage: Stage, method: str, plane: PlaneState | Literal["auto"]
) -> tuple[HingeSpring, ...]:
    elastic = (stage.material.youngs_modulus, stage.material.poissons_ratio)
    others = {
        b.name: (math.inf if b.rigid else m.youngs_modulus, m.poissons_ratio)
        for b in stage.other_bodies
        for m in [stage.material_of(b)]
    }
    springs = []
    for hinge in stage.hinges:
        roots, reaches = None, (ROOT_REACH, ROOT_REACH)
        if method in WITH_ROOTS:
            a, b = hinge_root(stage, hinge, 0), hinge_root(stage, hinge, 1)
            roots = a.width, b.width
            reaches = root_reach(stage, hinge, a), root_reach(stage, hinge, b)
        of_a, of_b = (others.get(name, elastic) for name in hinge.bodies)
        bodies = None if of_a == of_b == elastic or roots is None else (of_a, of_b)
        notch = cached_compliance(
            hinge.profile, elastic, stage.thickness, method, plane, roots, bodies, reaches
        )
        springs.append(
            HingeSpring(
                hinge=hinge,
                stiffness=notch.stiffness,
                method=method,
                plane=notch.plane,
                root_widths=roots,
                root_reaches=reaches,
                bodies=bodies,
            )
        )
    return tuple(springs)


def layout_of(stage: Stage) -> BodyCoordinates:
    """Return the coordinates of the lumped model of a stage.

    Three for each free body, in the order of the stage.
    """
    properties = _masses(stage)
    return BodyCoordinates(
        {name: p.centre for name, p in properties.items()},
        tuple(b.name for b in stage.bodies if not b.fixed),
    )


def lumped_system(
    stage: Stage,
    *,
    method: str = "wedge",
    plane: PlaneState | Literal["auto"] = "auto",
    damping: Damping = DEFAULT_DAMPING,
) -> MechanicalSystem:
    r"""Return the lumped model of a stage: rigid bodies joined by three-degree-of-freedom hinges.

    Kinetic energy :math:`T = \tfrac12\sum m(\dot x^2+\dot y^2)+J\dot\theta^2`, potential energy
    :math:`V = \tfrac12\sum e^T k e` with the deformation e of each hinge, and Lagrange's equations
    give M and K; see `flexstage.lumped.symbolic` for the same in symbols.

    Parameters
    ----------
    stage : Stage
        The stage.
    method : str
        Method of hinge stiffness: ``wedge`` or ``finite-element`` (with the roots in the
        bodies), ``timoshenko`` or ``euler-bernoulli``.
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width against neck.
    damping : ModalDamping or RayleighDamping or LossFactor
        Damping; 1 % in every mode where not given, which is an assumption.

    Returns
    -------
    MechanicalSystem
        The model, drives removed.

    Raises
    ------
    StageError
        A hinge is not attached to its bodies.
    ModelError
        Every body is fixed.

    Notes
    -----
    Validity: small displacements; bodies count as rigid, so ratios are 2.5 to 4.5 % too large and
    motion across the axis is far too small, where platforms, levers or input blocks bend; first
    frequencies are 1 to 2.5 % above finite elements. Out-of-plane motion is not modelled.
    """
    properties = _masses(stage)
    free = tuple(b.name for b in stage.bodies if not b.fixed)
    if not free:
        raise ModelError(f"every body of stage '{stage.name}' is fixed: nothing can move")
    layout = BodyCoordinates({name: p.centre for name, p in properties.items()}, free)
    mass = np.concatenate([(p.mass, p.mass, p.inertia) for p in map(properties.__getitem__, free)])

    springs = hinge_springs(stage, method=method, plane=plane)
    stiffness = np.zeros((layout.order, layout.order))
    rows, owner = [], []
    for i, spring in enumerate(springs):
        b = hinge_matrix(layout, spring.hinge)
        # only the coordinates of the two bodies take part
        at = np.flatnonzero(b.any(axis=0))
        part = b[:, at]
        force = spring.stiffness @ part
        stiffness[np.ix_(at, at)] += part.T @ force
        profile, nu = spring.hinge.profile, stage.material.poissons_ratio
        stress = cached_stress_rows(profile, stage.thickness, nu, spring.plane)
        row = np.zeros((stress.shape[0], layout.order))
        row[:, at] = stress @ force
        rows.append(row)
        owner += [i] * stress.shape[0]
    bodies = tuple(
        BodyPort(name=n, centre=p.centre, matrix=point_matrix(layout, n, p.centre))
        for n, p in properties.items()
    )
    return MechanicalSystem(
        name=stage.name,
        model="lumped",
        M=np.diag(mass),
        K=0.5 * (stiffness + stiffness.T),
        coordinates=layout.names(),
        drives=tuple(drive_port(d, _elongation(layout, d), bodies) for d in stage.drives),
        probes=tuple(_probe_port(layout, p) for p in stage.probes),
        bodies=bodies,
        stress=StressMap(
            hinges=tuple(s.hinge.name for s in springs),
            matrix=np.concatenate(rows) if rows else np.zeros((0, layout.order)),
            owner=np.array(owner, dtype=np.intp),
        ),
        loads=tuple(
            LoadPort(name=f"gravity {axis}", vector=_weight(layout, mass, i), unit="g")
            for i, axis in enumerate("xy")
        ),
        axes=tuple(AxisPort(name=a.name, drives=a.moved_by, probe=a.probe) for a in stage.axes),
        damping=damping,
        validity=_validity(stage, springs, method, damping),
        settings={"model": "lumped", "method": method, "plane": _planes(springs)},
    )


def _weight(layout: BodyCoordinates, mass: Array, axis: int) -> Array:
    """Return the weight of the bodies along x or y."""
    weight = np.zeros(layout.order)
    weight[axis::3] = STANDARD_GRAVITY * mass[axis::3]
    return weight


def _along(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle), 0.0])


def _elongation(layout: BodyCoordinates, drive: Drive) -> Array:
    # Force and reaction share one line of action, through the pushed point and turning with the
    # body that the drive stands on. Taken at two separate points they would be a couple
    # out of nothing, and turning both bodies together would seem to stretch the drive.
    pushed = point_matrix(layout, drive.pushes, drive.at[0])
    stood = point_matrix(layout, drive.reacts, drive.at[0])
    return _along(drive.direction) @ (pushed - stood)


def _probe_port(layout: BodyCoordinates, probe: Probe) -> ProbePort:
    motion = point_matrix(layout, probe.body, probe.at)
    if probe.relative_to is not None:
        motion = motion - point_matrix(layout, probe.relative_to, probe.at)
    return ProbePort(
        name=probe.name, vector=np.array(probe.row) @ motion, unit=probe.unit, body=probe.body
    )


def _planes(springs: tuple[HingeSpring, ...]) -> str:
    return " and ".join(sorted({s.plane for s in springs}))


def _validity(
    stage: Stage, springs: tuple[HingeSpring, ...], method: str, damping: Damping
) -> tuple[str, ...]:
    notes = [
        "Lumped model: bodies are rigid. Compared with 3D finite elements of the study's stages, "
        "the transmission ratio is 2.5 to 4.5 % too large and the first frequencies are 1 to 2.5 % "
        "too high; cross-axis motion, which comes from bending of the platform, is far too small.",
        "Plane motion only: out-of-plane modes are not modelled.",
        f"Plane {_planes(springs)} at the notches ({PLANE_RULE}).",
        "Natural frequencies belong to the bare stage, drives removed, unless labelled otherwise.",
    ]
    nu = stage.material.poissons_ratio
    excess = [
        1.0 / (1.0 - nu**2) / held_leaf_stiffening(stage.thickness, profile.flat_length, nu) - 1.0
        for profile in (s.hinge.profile for s in springs if s.plane == "strain")
        if profile.flat_length > _LEAF * profile.neck_thickness
    ]
    if excess:
        notes.append(
            f"Leaves are up to {100.0 * max(excess):.0f} % too stiff in bending: they are in plane "
            "strain over their whole length, but only their ends hold their width."
        )
    if method not in WITH_ROOTS:
        notes.append(
            f"Hinges by {method} beam theory without their roots: 2 to 20 % too stiff in rotation."
        )
    if damping == DEFAULT_DAMPING:
        notes.append(
            "Damping of 1 % in every mode is an assumption: it sets the height of the resonances."
        )
    return (*notes, *stage.material_notes, *stage.own_notes)
