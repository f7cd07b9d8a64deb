"""A body of a plate in space condensed to its necks: motion in its plane, or out of it."""

import math

import ngsolve as ng
import numpy as np
from scipy.sparse.linalg import splu

from flexstage.arrays import Array
from flexstage.elasticity import Continuum
from flexstage.elasticity.loaded import COMPONENTS
from flexstage.elasticity.shapes import METRE
from flexstage.fem.condensation import Condensed, reading_row, seam, slopes_at
from flexstage.fem.constrained import Constrained, edge_means, neck_weights
from flexstage.fem.geometry import MOUNTING, exactly, notch_region, stage_faces
from flexstage.fem.layered_plate import LayeredPlate
from flexstage.fem.mesh import sound_mesh
from flexstage.fem.necks import NeckPoints, neck_points
from flexstage.fem.ports import drive_vector, rigid_regions
from flexstage.fem.substructure import BODY, CutNeck, Substructure
from flexstage.stage import mass_properties

#: Loads inside a body out of its plane: force and moments on its mean motion, one kelvin by metre.
LOADS_OUT_OF_PLANE = ("z", "rotation x", "rotation y", "temperature gradient z")

# places through half of the thickness where the stress is looked for, in parts of it
_LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)


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

    The motions are those of a beam, each with the functions through the thickness that bodies have:
    along and across the hinge, the rotation, the displacement through the plate and its slope over
    the neck. With the tractions that do work with them go others without resultant, of higher
    powers over the neck and of the functions that notches alone have, so that the neck stays plane
    where it must: of the flexibility F of the half notch alone, held where it runs out,
    :math:`\lambda_e = -F_{ee}^{-1} F_{er}\lambda_r`.

    The matrices are for the `REFERENCE` material and the thickness of the part.
    """
    through = part.through
    assert through is not None
    stage, order = part.stage(), part.mesh.order
    faces = stage_faces(stage, [BODY])
    mesh = sound_mesh(stage, faces, part.mesh)
    plate = LayeredPlate(
        mesh,
        part.material(),
        through,
        order=order,
        held=MOUNTING if part.held else "",
        notches=[exactly(notch_region(str(i), n.which)) for i, n in enumerate(part.necks)],
    )
    means = edge_means(mesh, order, part.necks)
    rows = [np.zeros((0, plate.size))]
    rows += [_neck_rows(plate, *n) for n in enumerate(zip(part.necks, means, strict=True))]
    properties = mass_properties(stage)[BODY]
    motion = plate.motion(rigid_regions(stage, BODY), properties.centre)
    if through.out_of_plane:
        inner = [*motion, plate.thermal(1.0, 1)]
    else:
        flat = Continuum(mesh, part.material(), order=order, thickness=through.thickness)
        rows += [
            plate.mean(drive_vector(flat, stage, drive, faces.patches, "elastic"))[None]
            for drive in stage.drives
        ]
        inner = [
            *motion,
            *(plate.thermal(c, 0) for c in (1.0, ng.x / METRE, ng.y / METRE)),
            *(reading_row(flat, r, properties.centre, motion, plate.middle) for r in part.readings),
        ]
    body = Constrained(plate, np.concatenate(rows), [], floating=not part.held)
    loads = np.array(inner)
    basis, K, interfaces = body.reduced(loads, part.modes)
    mass = basis.T @ plate.mass_times(basis)
    points = neck_points(mesh, stage)
    ends, count = seam(part, points), int(points.point.max(initial=-1)) + 1
    levels = range(len(_LEVELS))
    return Condensed(
        stiffness=K,
        mass=0.5 * (mass + mass.T),
        loads=loads @ basis,
        stress=_surface_stress(plate, points, basis),
        neck=np.concatenate([points.owner.astype(np.int64) for _ in levels]),
        point=np.concatenate([points.point.astype(np.int64) + count * i for i in levels]),
        seam=np.concatenate([ends * (i + 1) for i in levels]),
        interfaces=interfaces,
        inertia=(properties.mass, *properties.centre, properties.inertia),
        elements=int(mesh.ne),
        unknowns=int(plate.free.sum()),
        held=faces.held,
    )


def _neck_rows(plate: LayeredPlate, number: int, own: tuple[CutNeck, Array]) -> Array:
    """Return the motions of a neck as `neck_coordinates` has them, shape (k, n)."""
    neck, means = own
    c, s = math.cos(neck.direction), math.sin(neck.direction)
    beam, normal, shear = (t @ means for t in neck_weights(len(means) - 1))
    turns = 2.0 / neck.profile.neck_thickness
    slope = -turns * beam[2]  # of the displacement through the plate over the neck
    functions = plate.through.functions
    in_plane, through = functions["plane"], functions["across"]
    width = plate.width
    field = {(d, k): i for i, (d, _, k) in enumerate(plate.through.components)}
    scale = plate.through.thickness**-0.5  # the first function is constant or linear

    def row(parts: list[tuple[int, float]], k: int, weights: Array) -> Array:
        found = np.zeros((len(field), width))
        for d, factor in parts:
            found[field[d, k]] = scale * factor * weights
        return found.reshape(-1)

    along, across, through_plate = [(0, c), (1, s)], [(0, -s), (1, c)], [(2, 1.0)]
    everywhere, extra = range(in_plane.in_bodies), range(in_plane.in_bodies, len(in_plane.values))
    pulled = [row(along, k, w) for k in everywhere for w in (beam[0], turns * beam[2])]
    sheared = [row(across, k, beam[1]) for k in everywhere]
    sheared += [
        row(through_plate, k, w) for k in range(through.in_bodies) for w in (beam[0], slope)
    ]
    pulled_more = [row(along, k, w) for k in (*everywhere, *extra) for w in normal]
    pulled_more += [row(along, k, w) for k in extra for w in (beam[0], turns * beam[2])]
    sheared_more = [row(across, k, w) for k in (*everywhere, *extra) for w in shear]
    sheared_more += [row(across, k, beam[1]) for k in extra]
    for k in range(len(through.values)):
        sheared_more += [row(through_plate, k, w) for w in normal]
        if k >= through.in_bodies:
            sheared_more += [row(through_plate, k, w) for w in (beam[0], slope)]
    rows = np.array([*pulled, *sheared, *pulled_more, *sheared_more])
    # the half notch alone
    inside = np.tile(plate.inside[number], len(field)) & plate.free
    kept = np.flatnonzero(inside[plate.free])
    local = rows[:, inside]
    factor = splu(
        plate.stiffness[kept][:, kept],
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    flexibility = local @ factor.solve(np.ascontiguousarray(local.T))
    main = len(pulled) + len(sheared)
    first, last = main + len(pulled_more), len(rows)
    shaped = rows[:main].copy()
    for motions, others in (
        (range(len(pulled)), range(main, first)),
        (range(len(pulled), main), range(first, last)),
    ):
        m, e = np.array(motions), np.array(others)
        mix = np.linalg.lstsq(flexibility[np.ix_(e, e)], flexibility[np.ix_(e, m)], rcond=1e-10)[0]
        shaped[m] -= mix.T @ rows[e]
    return shaped


def _surface_stress(plate: LayeredPlate, points: NeckPoints, basis: Array) -> Array:
    """Return the stress of displacements at the points of the notches, level by level.

    Components xx, yy, zz, yz, xz, xy [Pa], shape (m, 6, r).
    """
    r = basis.shape[1]
    if not len(points.places):
        return np.zeros((0, 6, r))
    through = plate.through
    parts = through.components
    fields = basis.reshape(len(parts), plate.width, r)
    values, slopes = slopes_at(points, plate.mesh, plate.order, fields)
    z = np.array(_LEVELS) * through.thickness / 2.0
    functions = through.values_at(z)
    gradient = np.zeros((z.size, len(values), 3, 3, r))  # of displacement i along j
    for i, (d, kind, k) in enumerate(parts):
        value, slope = (f[k][:, None, None] for f in functions[kind])
        gradient[:, :, d, 0] += value * slopes[None, :, i, :, 0]
        gradient[:, :, d, 1] += value * slopes[None, :, i, :, 1]
        gradient[:, :, d, 2] += slope * values[None, :, i]
    gradient = gradient.reshape(-1, 3, 3, r)
    modulus, poisson = plate.material.youngs_modulus, plate.material.poissons_ratio
    shear = modulus / (2.0 * (1.0 + poisson))
    lame = modulus * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    volume = lame * np.einsum("miir->mr", gradient)
    return np.stack(
        [
            (volume if i == j else 0.0) + shear * (gradient[:, i, j] + gradient[:, j, i])
            for i, j in COMPONENTS
        ],
        axis=1,
    )
