"""A body of a plate in space condensed to its necks: motion in its plane, or out of it."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import ngsolve as ng
import numpy as np

from flexstage.arrays import Array
from flexstage.elasticity import Continuum
from flexstage.elasticity.shapes import METRE
from flexstage.errors import ModelError
from flexstage.fem.condensation import (
    Condensed,
    reactions,
    reading_row,
)
from flexstage.fem.constrained import Constrained
from flexstage.fem.geometry import MOUNTING, StageFaces, exactly, notch_region, stage_faces
from flexstage.fem.half_notch import REACH, neck_tractions, stress_of_necks
from flexstage.fem.layered_plate import LayeredPlate, PlaneIntegrals
from flexstage.fem.mesh import MESHER, sound_mesh
from flexstage.fem.neck_rows import edge_means
from flexstage.fem.notch_tractions import motion_rows, neck_motions
from flexstage.fem.ports import drive_vector, rigid_regions
from flexstage.fem.substructure import BODY, CutNeck, Substructure
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.stage import MassProperties, mass_properties

#: Loads inside a body out of its plane: force and moments on its mean motion, one kelvin by metre.
LOADS_OUT_OF_PLANE = ("z", "rotation x", "rotation y", "temperature gradient z")


def neck_coordinates(*, out_of_plane: bool) -> tuple[str, ...]:
    """Name the motions of a neck, in order: each is a mean over its width and its thickness."""
    plane, across = (("z", "z^3"), ("1", "z^2")) if out_of_plane else (("1", "z^2"), ("z",))
    return (
        *(f"{motion} by {k}" for k in plane for motion in ("along", "rotation")),
        *(f"across by {k}" for k in plane),
        *(f"{motion} by {k}" for k in across for motion in ("through the plate", "slope of it")),
    )


def condense_plate(part: Substructure) -> Condensed:
    r"""Condense a body of a plate to the motions of its necks, as `Substructure.through` has it.

    The motions are those of a beam, each with the lowest functions through the thickness: along and
    across the hinge, the rotation, the displacement through the plate and its slope over the neck.
    With the tractions that do work with them go others without resultant, of higher powers over
    the neck and of the other functions, so that the neck stays plane where it must: of the
    flexibility F of the half notch alone, held in its body,
    :math:`\lambda_e = -F_{ee}^{-1} F_{er}\lambda_r`.

    The matrices are for the `REFERENCE` material and the thickness of the part.
    """
    ready = _prepared(part)
    body = Constrained(ready.plate, ready.rows, [], floating=not part.held)
    basis, K, interfaces = body.reduced(ready.loads, part.modes)
    mass = basis.T @ ready.plate.mass_times(basis)
    loads = ready.loads @ basis
    return Condensed(
        stiffness=K,
        mass=0.5 * (mass + mass.T),
        loads=loads,
        reactions=reactions(K, mass, loads, interfaces),
        **stress_of_necks(part)._asdict(),
        interfaces=interfaces,
        inertia=(ready.properties.mass, *ready.properties.centre, ready.properties.inertia),
        elements=int(ready.plate.plane.mesh.ne),
        unknowns=ready.plate.size,
        held=ready.held,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Ready:
    """A body on its mesh, before anything is factorised."""

    plate: LayeredPlate
    rows: Array
    """Motions of its interfaces, shape (m, n)."""
    loads: Array
    """Loads inside it, shape (l, n)."""
    properties: MassProperties
    """Its mass."""
    held: str
    """What holds it, in words."""


@lru_cache(maxsize=2)
def _meshed(part: Substructure) -> tuple[StageFaces, PlaneIntegrals, list[Array]]:
    """Mesh a body, for both its motions: its faces, integrals over its plane, means over necks."""
    faces = stage_faces(part.stage(), [BODY])
    mesh = sound_mesh(part.stage(), faces, part.mesh)
    plane = PlaneIntegrals(mesh, order=part.mesh.order, held=MOUNTING if part.held else "")
    return faces, plane, edge_means(mesh, part.mesh.order, part.necks)


def _prepared(part: Substructure) -> _Ready:
    through = part.through
    if through is None:
        raise ModelError("a body in a plane has no functions through its thickness")
    mixes = [_neck_mix(part, through, n) for n in part.necks]
    with MESHER:
        stage = part.stage()
        faces, plane, means = _meshed(replace(part, through=None, readings=(), modes=0))
        plate = LayeredPlate(
            plane,
            part.material(),
            through,
            notches=[
                (
                    exactly(notch_region(str(i), n.which)),
                    n.at,
                    n.profile.length / 2.0 + REACH * n.profile.root_height,
                )
                for i, n in enumerate(part.necks)
            ],
        )
        rows = [np.zeros((0, plate.size))]
        rows += [_neck_rows(plate, *own) for own in zip(part.necks, means, mixes, strict=True)]
        # the thickness of the part is one for its mesh; it weighs as much as it is thick
        properties = mass_properties(replace(stage, thickness=through.thickness))[BODY]
        motion = plate.motion(rigid_regions(stage, BODY), properties.centre)
        if through.out_of_plane:
            loads = [*motion, plate.thermal(1.0, 1)]
        else:
            flat = Continuum(
                plane.mesh, part.material(), order=plane.order, thickness=through.thickness
            )
            rows += [
                plate.mean(drive_vector(flat, stage, drive, faces.patches, "elastic"))[None]
                for drive in stage.drives
            ]
            loads = [
                *motion,
                *(plate.thermal(c, 0) for c in (1.0, ng.x / METRE, ng.y / METRE)),
                *(
                    reading_row(flat, r, properties.centre, motion, plate.middle)
                    for r in part.readings
                ),
            ]
        return _Ready(
            plate=plate,
            rows=np.concatenate(rows),
            loads=np.array(loads),
            properties=properties,
            held=faces.held,
        )


def _neck_mix(part: Substructure, through: ThroughThickness, neck: CutNeck) -> Array:
    """Return what makes up each motion of a neck, of `neck_motions`, shape (k, m)."""
    mix = neck_tractions(neck.profile, through, part.mesh, part.poissons_ratio, part.mesh.order)
    return np.hstack((np.eye(len(mix)), mix))


def _neck_rows(plate: LayeredPlate, neck: CutNeck, means: Array, mix: Array) -> Array:
    """Return the motions of a neck as `neck_coordinates` has them, shape (k, n)."""
    passed, rest, _, _ = neck_motions(plate.through, plate.plane.order)
    direction = math.cos(neck.direction), math.sin(neck.direction)
    return motion_rows(plate, means, (*passed, *rest), direction, mix)
