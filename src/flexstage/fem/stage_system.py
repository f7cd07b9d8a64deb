"""A stage as a mechanical system, with drives, probes and loads on its mesh."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Literal

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.elasticity import AttachedMass, Continuum
from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import (
    DrivePatch,
    body_region,
    either,
    exactly,
    notch_region,
    outer_region,
    patch_edge,
)
from flexstage.fem.layered_plate import UncheckedMaterial
from flexstage.hinges import Profile
from flexstage.quantities.material import Material
from flexstage.stage import Drive, Hinge, Probe, Stage
from flexstage.stage.outline import Point
from flexstage.system import MechanicalSystem
from flexstage.system.mechanical import (
    AxisPort,
    BodyPort,
    LoadPort,
    ProbePort,
    drive_port,
)
from flexstage.system.stress_map import StressMap
from flexstage.system.thermal_transient import heats

# a notch of constant thickness is a leaf from this many of its thicknesses on
_LEAF = 4.0

#: Supports: whether the fixed bodies are compliant under the drives that react on them.
Supports = Literal["rigid", "elastic"]


#: Modulus of a rigid body over that of its material. With a tenth of it the first five frequencies
#: of a parallelogram of rigid bodies are up to 1e-4 lower, with ten times as much 1e-5 higher.
RIGID = 1e5


def region_materials(stage: Stage) -> dict[str, Material]:
    """Return the materials of bodies that are rigid or of another one, by the names of regions."""
    materials: dict[str, Material] = {}
    for body in stage.other_bodies:
        figures = {f.name: getattr(stage.material_of(body), f.name) for f in fields(Material)}
        figures["youngs_modulus"] *= RIGID if body.rigid else 1.0
        materials[body_region(body.name)] = UncheckedMaterial(**figures)
    return materials


def body_regions(stage: Stage, body: str) -> str:
    """Return the expression of the regions of a body with its half notches."""
    return _regions(stage, body, stage.hinges)


def rigid_regions(stage: Stage, body: str) -> str:
    """Return the expression of the regions of a body that move as one.

    A half notch bends at its neck alone and moves with its body; half of a leaf does not.
    """
    return _regions(stage, body, (h for h in stage.hinges if not _is_leaf(h.profile)))


def _is_leaf(profile: Profile) -> bool:
    return profile.flat_length > _LEAF * profile.neck_thickness


def _regions(stage: Stage, body: str, hinges: Iterable[Hinge]) -> str:
    regions = [body_region(body)]
    for hinge in hinges:
        for i in (0, 1):
            if hinge.bodies[i] == body:
                regions += [notch_region(hinge.name, i), outer_region(hinge.name, i)]
    return either(regions)


def body_motion(continuum: Continuum, stage: Stage, body: str, at: tuple[float, float]) -> Array:
    """Return displacement and rotation of a body in the plane, about a point.

    x, y [m] and rotation [rad], shape (3, n): the rigid motion nearest to the body's. The middle
    plane is at z = 0.
    """
    centre = at if continuum.dimension == 2 else (*at, 0.0)
    _, motion = continuum.rigid_motion(rigid_regions(stage, body), centre)
    return motion if continuum.dimension == 2 else motion[[0, 1, 5]]


def body_path(
    continuum: Continuum, stage: Stage, body: str, at: tuple[float, float], u: Array
) -> Array:
    r"""Return displacement and rotation of a body about a point for rotations of any size.

    The mean displacement s of the middle of the body is that of a rigid motion; the rotation that
    fits :math:`(R - I) r` best is the sine of the angle.

    x, y [m] and rotation [rad], shape (k, 3), of displacements of a plane mesh, shape (k, n).
    """
    middle, rows = continuum.rigid_motion(rigid_regions(stage, body))
    x, y, sine = (u @ rows.T).T
    angle = np.arcsin(sine)
    arm, less = (at[0] - middle[0], at[1] - middle[1]), np.cos(angle) - 1.0
    moved = (x + less * arm[0] - sine * arm[1], y + sine * arm[0] + less * arm[1], angle)
    return np.stack(moved, axis=1)


def _patch_vector(
    continuum: Continuum,
    stage: Stage,
    patch: DrivePatch,
    direction: tuple[float, float],
    reach: float,
) -> Array:
    """Return the mean displacement of a patch along a direction."""
    if patch.ends is not None:
        return continuum.mean(exactly(patch_edge(patch.drive, patch.which)), direction)
    # no edge to push on: a disc about the point, with a weight that fades towards its rim
    r2 = sum((c - METRE * p) ** 2 for c, p in zip((ng.x, ng.y), patch.at, strict=True))
    weight = ng.IfPos((METRE * reach) ** 2 - r2, 1.0 - r2 / (METRE * reach) ** 2, 0.0)
    region = exactly(body_region(patch.body))
    where = continuum.mesh.Materials(region)
    v = continuum.space.TestFunction()
    pushed = direction[0] * v[0] + direction[1] * v[1]
    form = ng.LinearForm(continuum.space)
    form += weight * pushed * ng.dx(region, bonus_intorder=6)
    form.Assemble()
    # what the same points of integration make of a shift by one, so that the body as a whole is
    # read without error, however coarse its elements are compared with the disc
    shift = ng.GridFunction(continuum.space)
    shift.Set(ng.CF((*direction, 0.0)[: continuum.dimension]), definedon=where)
    total = float(ng.InnerProduct(form.vec, shift.vec))
    if total <= 0.0:
        raise ModelError(
            f"drive '{patch.drive}' acts at {patch.at} m, where body '{patch.body}' has no "
            "material: put the point on its edge"
        )
    return form.vec.FV().NumPy() / total


def drive_vector(
    continuum: Continuum,
    stage: Stage,
    drive: Drive,
    patches: Iterable[DrivePatch],
    supports: Supports = "rigid",
) -> Array:
    r"""Return the elongation of a drive, :math:`d^T (\bar u_{push} - \bar u_{react})`.

    The bars are means over the patches. Where the reacting patch is off the line of action, it is
    transferred there by the rotation of its body, as force and reaction share one line.

    Shape (n,). `patches` may be those of all drives; with `supports` ``rigid`` a drive that reacts
    on a fixed body reacts on the ground, with ``elastic`` that body is compliant.
    """
    along = (math.cos(drive.direction), math.sin(drive.direction))
    aside = (-along[1], along[0])
    total = np.zeros(continuum.size)
    for patch in patches:
        grounded = supports == "rigid" and stage.body(patch.body).fixed
        if patch.drive != drive.name or grounded:
            continue
        sign = 1.0 if patch.which == 0 else -1.0
        total += sign * _patch_vector(continuum, stage, patch, along, drive.patch_half_width)
        offset = sum(c * (p - q) for c, p, q in zip(aside, patch.at, drive.at[0], strict=True))
        if patch.which == 1 and abs(offset) > 1e-9:
            turn = body_motion(continuum, stage, patch.body, patch.at)[2]
            # a turn moves the point on the line by -aside * offset more than the patch, along it
            total += sign * offset * turn
    return total


def probe_vector(continuum: Continuum, stage: Stage, probe: Probe) -> Array:
    """Return the reading of a probe.

    It is the displacement of the point that it names. Where the body has no material there, such as
    in its aperture, the point follows the mean motion of the body; so does a rotation.
    """
    reading = _reading(continuum, stage, probe.body, probe)
    if probe.relative_to is not None:
        reading = reading - _reading(continuum, stage, probe.relative_to, probe)
    return reading


def _reading(continuum: Continuum, stage: Stage, body: str, probe: Probe) -> Array:
    mesh, at = continuum.mesh, probe.at
    place = tuple(METRE * c for c in at) + (0.0,) * (continuum.dimension - 2)
    if probe.direction is not None and mesh.Contains(*place):
        element = ng.ElementId(ng.VOL, mesh(*place).nr)
        in_body = mesh.Materials(body_regions(stage, body)).Mask()
        if in_body[mesh[element].index]:
            return continuum.point((*at, 0.0)[: continuum.dimension], probe.along)
    return np.array(probe.row) @ body_motion(continuum, stage, body, at)


def attached_masses(continuum: Continuum, stage: Stage) -> list[AttachedMass]:
    """Return the masses mounted on the bodies of a stage.

    Each follows the mean motion of its body.
    """
    riders = []
    for body in stage.bodies:
        if body.fixed:
            continue
        for extra in body.extra_masses:
            motion = body_motion(continuum, stage, body.name, extra.at)
            inertia = np.array([extra.mass, extra.mass, extra.inertia])
            if continuum.dimension == 3:
                _, body_motion_rows = continuum.rigid_motion(
                    rigid_regions(stage, body.name), (*extra.at, 0.0)
                )
                # how it is spread out of the plane is not described: it counts as a point there
                motion = body_motion_rows[[0, 1, 2, 5]]
                inertia = np.array([extra.mass, extra.mass, extra.mass, extra.inertia])
            riders.append(AttachedMass(motion=motion, inertia=inertia))
    return riders


_LIFTED = " out of plane"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ports:
    """Drives, probes, bodies and loads in the coordinates of a stage, by name."""

    drives: Mapping[str, Array]
    """Elongation of each drive, shape (n,)."""
    probes: Mapping[str, Array]
    """Reading of each probe, shape (n,); out of the plane those of `lifted_probes`."""
    bodies: Mapping[str, tuple[Point, Array]]
    """Centre [m] of each body and its motion there, shape (3, n)."""
    loads: Mapping[str, tuple[Array, str]]
    """Force on the coordinates, shape (n,), and unit of each load."""
    heated: Mapping[str, Array] = field(default_factory=dict)
    """Force on the coordinates for one kelvin of each body, shape (n,), where heat flows."""
    turned: tuple[str, ...] = ()
    """Bodies whose rotation is exact under such forces: those that probes read."""

    @property
    def static_vectors(self) -> list[Array]:
        """Rows whose static responses are exact."""
        return [
            *self.drives.values(),
            *self.probes.values(),
            *(v for v, _ in self.loads.values()),
            *(self.bodies[name][1][2] for name in self.turned),
        ]

    def changed(self, change: Callable[[Array], Array]) -> "Ports":
        """Return them in other coordinates; `change` transforms rows."""
        return Ports(
            drives={name: change(v) for name, v in self.drives.items()},
            probes={name: change(v) for name, v in self.probes.items()},
            bodies={name: (at, change(rows)) for name, (at, rows) in self.bodies.items()},
            loads={name: (change(v), unit) for name, (v, unit) in self.loads.items()},
            heated={name: change(v) for name, v in self.heated.items()},
            turned=self.turned,
        )


def side_by_side(parts: Sequence[Ports], sizes: Sequence[int]) -> Ports:
    """Combine the ports of decoupled motions with their numbers of coordinates.

    Drives and bodies, also heated ones, are those of the first.
    """
    ends = np.cumsum(sizes)
    wider = [
        ports.changed(
            lambda rows, before=end - size, after=ends[-1] - end: np.pad(
                rows, [(0, 0)] * (rows.ndim - 1) + [(before, after)]
            )
        )
        for ports, size, end in zip(parts, sizes, ends.tolist(), strict=True)
    ]
    return Ports(
        drives=wider[0].drives,
        probes={name: v for ports in wider for name, v in ports.probes.items()},
        bodies=wider[0].bodies,
        loads={name: v for ports in wider for name, v in ports.loads.items()},
        heated=wider[0].heated,
        turned=wider[0].turned,
    )


def coordinate_names(omega: Array, is_mode: NDArray[np.bool_], out_of_plane: bool) -> list[str]:
    """Return the names of coordinates that are modes or static responses."""
    where = "out of plane, " if out_of_plane else ""
    return [
        f"{where}{'mode' if m else 'static response'} {i + 1} ({w / (2.0 * math.pi):.5g} Hz) "
        "[kg^0.5 m]"
        for i, (w, m) in enumerate(zip(omega, is_mode, strict=True))
    ]


def turned_bodies(stage: Stage) -> tuple[str, ...]:
    """Return the bodies that probes read, of a stage where heat flows; else none."""
    return tuple(dict.fromkeys(p.body for p in stage.probes)) if heats(stage) else ()


def lifted_probes(stage: Stage) -> dict[str, tuple[str, Point]]:
    """Return the readings out of the plane by name: of each measured body, at its first probe."""
    readings: dict[str, tuple[str, Point]] = {}
    for probe in stage.probes:
        readings.setdefault(f"{probe.body}{_LIFTED}", (probe.body, probe.at))
    return readings


def stage_system(
    stage: Stage,
    ports: Ports,
    coordinates: tuple[Array, Array, tuple[str, ...]],
    stress: StressMap,
    notes: tuple[tuple[str, ...], Mapping[str, str]],
) -> MechanicalSystem:
    """Return the system of a stage in coordinates with their mass, stiffness and names.

    `notes` are the limits of validity, and the settings that change its figures.
    """
    mass, stiffness, names = coordinates
    validity, settings = notes
    readings = [
        ProbePort(name=p.name, vector=ports.probes[p.name], unit=p.unit, body=p.body)
        for p in stage.probes
    ]
    lifted = [
        ProbePort(name=name, vector=ports.probes[name], body=body)
        for name, (body, _) in lifted_probes(stage).items()
        if name in ports.probes
    ]
    bodies = tuple(
        BodyPort(name=name, centre=centre, matrix=motion, thermal=ports.heated.get(name))
        for name, (centre, motion) in ports.bodies.items()
    )
    return MechanicalSystem(
        name=stage.name,
        model=settings["model"],
        M=mass,
        K=stiffness,
        coordinates=names,
        drives=tuple(drive_port(d, ports.drives[d.name], bodies) for d in stage.drives),
        probes=(*readings, *lifted),
        bodies=bodies,
        stress=stress,
        loads=tuple(
            LoadPort(name=name, vector=vector, unit=unit)
            for name, (vector, unit) in ports.loads.items()
        ),
        axes=tuple(AxisPort(name=a.name, drives=a.moved_by, probe=a.probe) for a in stage.axes),
        validity=validity,
        settings=settings,
    )
