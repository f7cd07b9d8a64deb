"""Stages, parts and leaves of others: what they print, and what flexstage computes.

``python -m tests.published_stages`` computes all of them anew and writes the tables of
docs/explanation/published-stages.md; with a folder it writes them there. Dimensions and printed
figures are typed from the named sources; nothing else of these is here. CPU times are typed as
well, and not measured anew. Lengths are in millimetres where the source has another unit: with the
same stress, displacements scale with it.
"""

import csv
import inspect
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import ngsolve as ng
import numpy as np
from netgen import meshing, occ

from examples.published import parts
from flexstage.base.arrays import Array
from flexstage.elasticity import Continuum
from flexstage.elasticity.loaded import follow_load, von_mises
from flexstage.elasticity.shapes import face
from flexstage.fem import plane_model
from flexstage.fem.geometry import patches
from flexstage.fem.part import Part
from flexstage.fem.part_analysis import Bodies
from flexstage.fem.part_mesh import PartMesh
from flexstage.fem.stage_system import body_path, drive_vector
from flexstage.hinges import (
    Leaf,
    RightCircular,
    closed_form_compliance,
    closed_forms,
    compliance,
)
from flexstage.lumped import Mechanism, RigidBody, Sight, SpringHinge, equilibrium, nonlinear
from flexstage.lumped.leaf import leaf_beam
from flexstage.quantities.material import Material
from flexstage.stage import Stage, read_stage
from flexstage.system import analyse

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "explanation"
STAGES = ROOT / "examples" / "published"
FIGURES, SOURCES = "published-figures.csv", "published-sources.csv"
MM = 1e-3
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A printed figure, and the name of the computed one."""

    what: str
    """Quantity, and its unit in brackets."""
    printed: float
    """The figure of the source."""
    key: str
    """Name of our figure in what the case computes."""
    why: str = ""
    """Cause of a difference of more than 3 %."""
    explained: str = ""
    """Name of our figure with that cause taken over; empty where the difference stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A stage, part or leaf of others."""

    name: str
    """What it is."""
    group: str
    """Who published it."""
    source: str
    """Where, and under which licence."""
    method: str
    """How the printed figures came about."""
    obstacle: str
    """What could not be described."""
    compute: Callable[[], dict[str, float]]
    """Our figures by name."""
    rows: tuple[Row, ...]
    """The printed figures."""
    seconds: float
    """Time of the computation on one core."""
    cpu: float
    """Measured CPU time of all figures, on one core of an Intel Xeon [s]; not measured anew."""
    file: str = ""
    """Its stage file, of those in `STAGES`."""
    shape: Callable[[], object] | None = None
    """Its shape, of those in ``examples/published/parts.py``."""


# ------------------------------------------------------------------------------------ tools


def isotropic(modulus: float, poisson: float, density: float = 1000.0) -> Material:
    """Return a material of the three figures of a source."""
    return Material(
        name="as published", youngs_modulus=modulus, poissons_ratio=poisson, density=density
    )


def solid(
    part: Part, material: Material, *, order: int, size: float, curvature: float = 1.0
) -> Continuum:
    """Return a part that is held at its face ``fixed``, in elements of a size [mm]."""
    mesh = PartMesh(order=order, thin=0.0, size=size * MM, grading=0.9, curvature=curvature)
    return Continuum(part.mesh(mesh), material, order=order, fixed="fixed")


def frequencies(continuum: Continuum, count: int) -> list[float]:
    """Return the lowest natural frequencies [Hz]."""
    return [float(w) / (2.0 * math.pi) for w in continuum.modes(count)[0]]


def edges_named(shape: occ.TopoDS_Shape, name: Callable[[float, float], str]) -> occ.TopoDS_Shape:
    """Name the edges of a plane face by their middles [mm]."""
    for edge in shape.edges:
        edge.name = name(edge.center.x, edge.center.y) or "free"
    return shape


def plane_mesh(shape: occ.TopoDS_Shape, size: float, order: int, **options: object) -> ng.Mesh:
    """Mesh a plane face with elements of a size [mm]."""
    mesh = ng.Mesh(occ.OCCGeometry(shape, dim=2).GenerateMesh(maxh=size, **options))
    return mesh.Curve(order)


def stretches(*pieces: tuple[float, float, int]) -> Array:
    """Return the levels of a grid: each piece from, to, and its number of elements."""
    levels = [np.linspace(a, b, n + 1)[:-1] for a, b, n in pieces]
    return np.concatenate([*levels, [pieces[-1][1]]])


def bricks(
    levels: Sequence[Array],
    kept: Callable[[int, int, int], bool],
    name: Callable[[int, int, int], str],
    at: Callable[[float, float, float], tuple[float, float, float]] = lambda x, y, z: (x, y, z),
) -> ng.Mesh:
    """Mesh a grid with eight-node bricks.

    `kept` says which of them exist; `name` gives the boundary of a face of column i, j, ``fixed``,
    ``loaded`` or ``free``, by the number of the face: 0 and 1 across x, 2 and 3 across y.
    """
    mesh, points = meshing.Mesh(dim=3), {}
    counts = [len(level) - 1 for level in levels]
    cells = {index for index in np.ndindex(*counts) if kept(*index)}

    def point(index: tuple[int, ...]) -> object:
        if index not in points:
            place = at(*(float(level[i]) for level, i in zip(levels, index, strict=True)))
            points[index] = mesh.Add(meshing.MeshPoint(meshing.Pnt(*place)))
        return points[index]

    def corner(cell: tuple[int, ...], *steps: int) -> object:
        return point(tuple(i + s for i, s in zip(cell, steps, strict=True)))

    square = ((0, 0), (1, 0), (1, 1), (0, 1))
    names = ("free", "fixed", "loaded")
    for number, text in enumerate(names, 1):
        mesh.Add(meshing.FaceDescriptor(surfnr=number, domin=1, bc=number))
        mesh.SetBCName(number - 1, text)
    mesh.SetMaterial(1, "body")
    for cell in sorted(cells):
        nodes = [corner(cell, a, b, c) for c in (0, 1) for a, b in square]
        mesh.Add(meshing.Element3D(1, nodes))
        for number in range(6):
            axis, far = divmod(number, 2)
            step = 1 if far else -1
            if tuple(i + step * (k == axis) for k, i in enumerate(cell)) in cells:
                continue
            others = [k for k in range(3) if k != axis]
            quad = []
            for pair in square:
                steps = [0, 0, 0]
                steps[axis] = far
                for k, s in zip(others, pair, strict=True):
                    steps[k] = s
                quad.append(corner(cell, *steps))
            if far == (axis == 1):
                quad.reverse()
            mesh.Add(meshing.Element2D(1 + names.index(name(*cell[:2], number)), quad))
    return ng.Mesh(mesh)


def published_stage(name: str) -> Stage:
    """Read one of the stage files."""
    return read_stage(STAGES / f"{name}.yaml")


def pushed(stage: Stage) -> float:
    """Return the motion of the probe of a stage by its plane model [m]."""
    model = plane_model(stage)
    return analyse(stage, model.system).axes[0].output_displacement


# ------------------------------------------------------------------- two-leaf parallelogram


def two_leaves() -> dict[str, float]:
    """Compute the parallelogram by its stage file, and as solids with a stiff stage."""
    length, unit = 0.25, 1750.0
    stage = published_stage("two-leaf-parallelogram")
    model = plane_model(stage)
    plane, drive = model.problems[0].continuum, stage.drives[0]
    row = drive_vector(plane, stage, drive, patches(drive, stage.bodies))
    path = follow_load(plane, unit * row, (1e-3, 20.0))
    flat = body_path(plane, stage, "stage", (length, 0.0), path.displacement)
    plane.release()
    leaves = [parts.box((0.0, 250.0), (y - 2.5, y + 2.5), (-25.0, 25.0)) for y in (-75.0, 75.0)]
    block = parts.box((250.0, 300.0), (-77.5, 77.5), (-25.0, 25.0))
    shapes = [*leaves, block]
    for shape, name in zip(shapes, ("lower", "upper", "stage"), strict=True):
        shape.name = name
    part = Part.from_shape(parts.held(occ.Glue(shapes), lambda x, *_: abs(x) < 1e-9))
    steel = isotropic(210e9, 0.3)
    of = {"lower": steel, "upper": steel, "stage": isotropic(5000e9, 0.3)}
    mesh = part.mesh(PartMesh(order=4, thin=0.0, size=0.05, grading=0.9))
    body = Bodies(mesh, of, order=4, fixed="fixed")
    _, motion = body.rigid_motion("stage", (length, 0.0, 0.0))
    corners = [body.point((length, y, 0.0), X) for y in (-0.0775, 0.0775)]
    rotation = (corners[1] - corners[0]) / 0.155
    found = follow_load(body, unit * motion[1], (1e-3, 1.0, 5.0, 20.0)).displacement
    figures = {
        "stiffness, plane": 1e-3 * unit * 1e-3 / float(flat[0, 1]),
        "across at 20, plane": float(flat[1, 1]) / length,
        "stiffness": 1e-3 * unit * 1e-3 / float(motion[1] @ found[0]),
    }
    for load, u in zip((1, 5, 20), found[1:], strict=True):
        figures[f"across at {load}"] = float(motion[1] @ u) / length
        figures[f"along at {load}"] = float(motion[0] @ u) / length
        # the source reads two nodes, where the roots of the leaves dent the stage
        figures[f"rotation at {load}"] = -float(rotation @ u)
        figures[f"mean rotation at {load}"] = float(motion[5] @ u)
    # pressed together with 5 E I/L^2, 10 E I/L^2 across, and turned by a couple of 3 E I/L
    loaded = unit * (10.0 * motion[1] - 5.0 * motion[0] + 3.0 * length * motion[5])
    u = follow_load(body, loaded, (0.25, 0.5, 0.75, 1.0)).displacement[-1]
    for name, row in zip(("along", "across", "mean rotation"), motion[[0, 1, 5]], strict=True):
        scale = 1.0 if name == "mean rotation" else length
        figures[f"{name}, all loads"] = float(row @ u) / scale
    return figures


# ------------------------------------------------------------------------------ micro-mirrors

STEEL = isotropic(200e9, 0.3, 7850.0)


def eight_wires() -> dict[str, float]:
    """Compute the modes of the mirror, of polysilicon and of the steel of the solved file."""
    part = Part.from_shape(parts.eight_wire_mirror())
    mesh = part.mesh(PartMesh(order=3, thin=3.0))
    figures = {}
    for name, material in (
        ("polysilicon", isotropic(169e9, 0.23, 2330.0)),
        ("steel", STEEL),
    ):
        continuum = Continuum(mesh, material, order=3, fixed="fixed")
        for mode, value in enumerate(frequencies(continuum, 6), 1):
            figures[f"mode {mode}, {name}"] = value
    return figures


def four_blades() -> dict[str, float]:
    """Compute the modes of the mirror on blades, and with flat tetrahedra."""
    silicon = isotropic(130e9, 0.3, 2330.0)
    pieces = stretches((-1.5, -0.5, 3), (-0.5, 0.5, 3), (0.5, 1.5, 3))
    mesh = bricks(
        (pieces, pieces, np.array([0.0, 0.01, 0.19, 0.2])),
        lambda i, j, k: 3 <= j < 6 if k == 2 else 3 <= i < 6 and (k == 0 or 3 <= j < 6),
        lambda i, j, number: (
            "fixed"
            if (i, number) in ((0, 0), (8, 1)) or (j, number) in ((0, 2), (8, 3))
            else "free"
        ),
    )
    fine = Continuum(mesh, silicon, order=5, fixed="fixed")
    coarse = solid(Part.from_shape(parts.four_blade_mirror()), silicon, order=2, size=0.11)
    return {
        f"mode {mode}{words}": value
        for words, body in (("", fine), (", coarse", coarse))
        for mode, value in enumerate(frequencies(body, 2), 1)
    }


# ------------------------------------------------------------------- wooden stages and beams

PINE = isotropic(10e9, 0.37, 550.0)
#: Weight of pine where a metre of the source is a millimetre here, with the same stress [N/m^3].
WEIGHT = (0.0, -550.0 * 9.81 * 1e3, 0.0)


def block_on_leaves(
    block: tuple[parts.Point, parts.Point],
    leaves: Sequence[parts.Point],
    ends: parts.Point,
    z: float,
) -> Part:
    """Return a block with leaves to both sides, held exactly at their ends [mm]."""
    (left, right), y = block
    shapes = [parts.box((left, right), y, (0.0, z))]
    for x in ((ends[0], left), (right, ends[1])):
        shapes += [parts.box(x, leaf, (0.0, z)) for leaf in leaves]
    glued = parts.held(occ.Glue(shapes), lambda x, *_: x < ends[0] + 1e-6 or x > ends[1] - 1e-6)
    return Part.from_shape(glued)


def four_leaves() -> dict[str, float]:
    """Compute the larger wooden stage: stage file, exact clamps, and the bricks of the source."""
    part = block_on_leaves(
        ((0.0, 15.0), (5.0, 22.0)), ((5.0, 6.0), (21.0, 22.0)), (-15.0, 30.0), 5.0
    )
    body = Continuum(part.mesh(PartMesh(order=3)), PINE, order=3, fixed="fixed")
    loaded = part.boundary(part.face_at((7.5 * MM, 5.0 * MM, 2.5 * MM)))
    mesh = bricks(
        (
            stretches((-15.0, 0.0, 35), (0.0, 15.0, 35), (15.0, 30.0, 35)),
            stretches((5.0, 6.0, 4), (6.0, 21.0, 29), (21.0, 22.0, 4)),
            stretches((0.0, 5.0, 11)),
        ),
        lambda i, j, _: 35 <= i < 70 or not 4 <= j < 33,
        lambda i, j, number: (
            "fixed" if (i, number) in ((0, 0), (104, 1)) else
            "loaded" if j == 0 and number == 2 and 35 <= i < 70 else "free"
        ),
    )  # fmt: skip
    theirs = Continuum(mesh, PINE, order=1, fixed="fixed")
    figures = {"stage file": 1e3 * pushed(published_stage("four-leaf-stage"))}
    for name, continuum, boundary in (("clamped", body, loaded), ("bricks", theirs, "loaded")):
        node = continuum.point((7.28571 * MM, 5.0 * MM + 1e-9, 2.72727 * MM), Y)
        figures[name] = 1e3 * float(node @ continuum.solve(30.0 * continuum.mean(boundary, Y)))
    return figures


def small_four_leaves() -> dict[str, float]:
    """Compute the smaller wooden stage likewise, under its weight and under the load."""
    part = block_on_leaves(
        ((10.0, 20.0), (0.0, 12.0)), ((0.0, 1.0), (11.0, 12.0)), (0.0, 30.0), 1.0
    )
    body = Continuum(part.mesh(PartMesh(order=3)), PINE, order=3, fixed="fixed")
    loaded = part.boundary(part.face_at((15.0 * MM, 12.0 * MM, 0.5 * MM)))
    mesh = bricks(
        (
            stretches((0.0, 10.0, 20), (10.0, 20.0, 20), (20.0, 30.0, 20)),
            stretches((0.0, 1.0, 2), (1.0, 11.0, 20), (11.0, 12.0, 2)),
            stretches((0.0, 1.0, 2)),
        ),
        lambda i, j, _: 20 <= i < 40 or not 2 <= j < 22,
        lambda i, j, number: (
            "fixed" if (i, number) in ((0, 0), (59, 1)) else
            "loaded" if j == 23 and number == 3 and 20 <= i < 40 else "free"
        ),
    )  # fmt: skip
    theirs = Continuum(mesh, PINE, order=1, fixed="fixed")
    figures = {"stage file": 1e3 * pushed(published_stage("small-four-leaf-stage"))}
    for name, continuum, boundary in (("clamped", body, loaded), ("bricks", theirs, "loaded")):
        row = continuum.mean(boundary, (0.0, -1.0, 0.0))
        node = continuum.point((15.0 * MM, 12.0 * MM - 1e-9, 0.5 * MM), Y)
        weight = continuum.force(".*", WEIGHT)
        for words, force in (("weight", 4e-3), ("load", 4.0)):
            figures[f"{words}, {name}"] = -1e3 * float(node @ continuum.solve(force * row + weight))
    # both results have the weight, and the smaller one a thousandth of the load
    figures["load alone, bricks"] = (figures["load, bricks"] - figures["weight, bricks"]) / 0.999
    return figures


def notched() -> dict[str, float]:
    """Compute the notched beam, and with the bricks of the source."""
    part = Part.from_shape(parts.notched_beam())
    body = Continuum(part.mesh(PartMesh(order=4, thin=0.8)), PINE, order=4, fixed="fixed")

    def around(x: float, y: float, z: float) -> tuple[float, float, float]:
        if not 0.0 < x < 1.0:
            return x, y, z
        low = 0.5 - 0.5 * math.cos(math.pi * x), 0.5 * math.sin(math.pi * x)
        return low[0] + (x - low[0]) * y, low[1] + (1.0 - low[1]) * y, z

    mesh = bricks(
        (
            stretches((-5.0, 0.0, 25), (0.0, 1.0, 5), (1.0, 20.0, 95)),
            *[stretches((0.0, 1.0, 5))] * 2,
        ),
        lambda *_: True,
        lambda i, _, number: {(0, 0): "fixed", (124, 1): "loaded"}.get((i, number), "free"),
        around,
    )
    theirs = Continuum(mesh, PINE, order=1, fixed="fixed")
    figures = {}
    end = part.boundary(part.select("x", "max"))
    for name, continuum, boundary in (("tip", body, end), ("tip, bricks", theirs, "loaded")):
        row = continuum.mean(boundary, (0.0, -1.0, 0.0))
        load = 0.4 * row + continuum.force(".*", WEIGHT)
        figures[name] = 1e3 * float(row @ continuum.solve(load))
    return figures


# ----------------------------------------------------------------------- gripper and hot arm

_GRIPPER = (
    (4.0, 1.0), (3.6, 1.0), (3.6, 1.8), (3.8, 1.8), (3.8, 2.2), (3.2, 2.2), (3.2, 6.0), (4.0, 6.0),
    (4.0, 7.0), (3.0, 7.0), (3.0, 2.2), (2.2, 2.2), (2.2, 7.0), (3.0, 8.0), (3.0, 9.0), (2.8, 9.0),
    (2.8, 8.0), (1.8, 7.0), (1.8, 1.8), (3.4, 1.8), (3.4, 1.0), (1.0, 1.0), (1.0, 7.0), (0.7, 7.0),
    (0.0, 6.0), (0.0, 0.0), (4.0, 0.0),
)  # fmt: skip
_FILLETS = (1, 2, 5, 10, 19, 20)
_ARM = (
    (0.0, 0.0), (0.0, 0.1), (0.1, 0.1), (0.1, 0.03), (1.9, 0.03), (1.9, -0.16), (0.4, -0.16),
    (0.4, -0.06), (0.1, -0.06), (0.1, -0.13), (0.0, -0.13), (0.0, -0.03), (1.87, -0.03),
    (1.87, 0.0),
)  # fmt: skip


def gripper_outline(radius: float = 0.2) -> tuple[list[parts.Point], list[float]]:
    """Return corners [m] and bulges of half the gripper, with fillets at some right angles."""
    corners, bulges = [], []
    for k, here in enumerate(_GRIPPER):
        if k not in _FILLETS:
            corners.append(here)
            bulges.append(0.0)
            continue
        p = np.array(here)
        u, v = (
            (np.array(q) - p) / math.dist(q, here)
            for q in (_GRIPPER[k - 1], _GRIPPER[(k + 1) % len(_GRIPPER)])
        )
        corners += [tuple(p + radius * u), tuple(p + radius * v)]
        bulges += [math.copysign(math.tan(math.pi / 8.0), u[1] * v[0] - u[0] * v[1]), 0.0]
    return [(x * MM, y * MM) for x, y in corners], bulges


def gripper() -> dict[str, float]:
    """Compute the gripper, and with bilinear elements of the size in the source."""

    def name(x: float, y: float) -> str:
        if abs(y) < 1e-9:
            return "base"
        if abs(y - 7.0) < 1e-9 and 3.0 < x < 4.0:
            return "pushed"
        return "middle" if abs(x - 4.0) < 1e-9 and not 1.01 < y < 6.0 else ""

    shape = edges_named(face(*gripper_outline()), name)
    figures = {}
    for words, mesh, order in (
        ("", plane_mesh(shape, 0.1, 5, grading=0.3), 5),
        (", bilinear", plane_mesh(shape, 0.05, 1, quad_dominated=True), 1),
    ):
        body = Continuum(
            mesh, isotropic(140e9, 0.23), order=order, thickness=MM, fixed="base",
            fixed_components={"x": "middle"},
        )  # fmt: skip
        row = body.mean("pushed", Y)
        u = body.solve(row)
        u *= 20e-6 / float(row @ u)
        tip = [float(body.point((2.80001 * MM, 8.99999 * MM), d) @ u) for d in (X, Y)]
        stress = von_mises(body.stress(u))
        if order == 1:  # the source averages in nodes
            smooth = ng.GridFunction(ng.H1(mesh, order=1))
            smooth.Set(stress)
            largest = float(np.max(smooth.vec.FV().NumPy()))
        else:
            points = mesh.MapToAllElements(ng.IntegrationRule(ng.ET.TRIG, 8), ng.VOL)
            largest = float(np.max(stress(points)))
        figures[f"tip{words}"] = 1e3 * math.hypot(*tip)
        figures[f"stress{words}"] = 1e-6 * largest
    return figures


def arm_outline() -> tuple[list[parts.Point], list[float]]:
    """Return corners [m] of the arm, without bulges."""
    return [(x * MM, y * MM) for x, y in _ARM], []


def arm() -> dict[str, float]:
    """Compute the arm on two beams, and with bilinear elements of the size in the source."""
    shape = edges_named(face(*arm_outline()), lambda x, _: "fixed" if abs(x) < 1e-9 else "")
    figures = {}
    for words, mesh, order in (
        ("tip", plane_mesh(shape, 0.05, 4, grading=0.3), 4),
        ("tip, bilinear", plane_mesh(shape, 0.02, 1, quad_dominated=True), 1),
    ):
        body = Continuum(mesh, isotropic(127e9, 0.26), order=order, thickness=1e-9, fixed="fixed")
        rows = [body.point((1.9 * MM - 1e-9, -0.16 * MM + 1e-9), d) for d in (X, Y)]
        u = body.solve(-3e-9 * rows[1])
        figures[words] = 1e6 * math.hypot(*(float(row @ u) for row in rows))
    return figures


# --------------------------------------------------------------------------- accelerometer


def accelerometer_bricks(along: int, through: int, wide: int) -> ng.Mesh:
    """Mesh the accelerometer with bricks.

    They are one across a beam, and as many along it, through the plate and over its wings as given.
    """
    beam = [(-265.0, -16.0, along), (-16.0, -11.0, 1), (-11.0, 11.0, 2), (11.0, 16.0, 1)]
    x = stretches(
        (-330.0, -270.0, 2), (-270.0, -265.0, 1), *beam, (16.0, 265.0, along), (265.0, 270.0, 1),
        (270.0, 330.0, 2),
    )  # fmt: skip
    y = stretches(
        (-325.0, -25.0, wide), (-25.0, -15.0, 1), (-15.0, -6.25, 1), (-6.25, 6.25, 1),
        (6.25, 15.0, 1), (15.0, 25.0, 1), (25.0, 435.0, wide),
    )  # fmt: skip

    def middle(i: int, j: int) -> tuple[float, float]:
        return 0.5 * abs(x[i] + x[i + 1]), 0.5 * (y[j] + y[j + 1])

    def kept(i: int, j: int, _: int) -> bool:
        across, up = middle(i, j)
        return (
            across > 270.0 or abs(up) > 25.0 or abs(up) < 1.0 or (across < 11.0 and abs(up) < 15.0)
        )

    def name(i: int, j: int, number: int) -> str:
        across, up = middle(i, j)
        return "fixed" if number == 4 and across < 11.0 and abs(up) < 15.0 else "free"

    def at(u: float, v: float, w: float) -> tuple[float, float, float]:
        half = np.interp(abs(u), [11.0, 16.0, 265.0, 270.0], [6.25, 1.3, 1.3, 6.25])
        return u, v * float(half) / 6.25 if abs(v) < 7.0 else v, w

    return bricks((x, y, stretches((0.0, 15.0, through))), kept, name, at)


def accelerometer() -> dict[str, float]:
    """Compute the accelerometer by E, then by G of the source, and with few bricks."""
    modulus, shear = 152.9e9, 79.6e9
    fine, coarse = accelerometer_bricks(6, 1, 2), accelerometer_bricks(17, 6, 6)
    figures = {}
    for words, mesh, poisson, order in (
        ("", fine, 0.2, 4),
        (", shear", fine, modulus / (2.0 * shear) - 1.0, 4),
        (", bricks", coarse, modulus / (2.0 * shear) - 1.0, 1),
    ):
        body = Continuum(mesh, isotropic(modulus, poisson, 2330.0), order=order, fixed="fixed")
        for mode, value in enumerate(frequencies(body, 5), 1):
            figures[f"mode {mode}{words}"] = 1e3 * value  # micrometres are millimetres here
        u = body.solve(body.force(".*", (0.0, 0.0, 2.0 * 9.8 * 2330.0)))
        tip = body.point((329.9 * MM, 434.9 * MM, 7.5 * MM), Z)
        figures[f"deflection{words}"] = float(tip @ u)
    return figures


# ---------------------------------------------------------------------- wires, leaves, rods


def wire() -> dict[str, float]:
    """Compute five pairs of modes of the copper wire."""
    density = 0.5 * 8.02e-3 / (math.pi * (0.5 * 1.948 * MM) ** 2 * 0.1515)
    copper = isotropic(2.0 * 66.2e9, 0.0, density)
    body = solid(Part.from_shape(parts.copper_wire()), copper, order=3, size=10.0)
    return {f"mode {n}": f for n, f in enumerate(frequencies(body, 10)[::2], 1)}


def leaf_far() -> dict[str, float]:
    """Compute a cantilever leaf of length 100 t under four times E I/L^2 across its end."""
    shape = edges_named(
        occ.Rectangle(10.0, 0.1).Face(),
        lambda x, _: {0.0: "clamp", 10.0: "tip"}.get(round(x, 6), ""),
    )
    body = Continuum(
        plane_mesh(shape, 0.5, 1), isotropic(1.2e6, 0.0), order=4, thickness=MM, fixed="clamp"
    )
    rows = [body.mean("tip", d) for d in (X, Y)]
    found = follow_load(body, 4e-6 * rows[1], (0.05, 0.25, 0.5, 1.0)).displacement
    figures = {}
    for share, u in zip((0.05, 0.5, 1.0), found[[0, 2, 3]], strict=True):
        figures[f"across at {share:g}"] = 1e3 * float(rows[1] @ u)
        figures[f"along at {share:g}"] = -1e3 * float(rows[0] @ u)
    return figures


def crossed_leaves(n: float) -> tuple[Array, Array, Array]:
    """Turn two leaves that cross in their middles, n times as high as wide, by 1.1 rad.

    Returns the rotations, and moment and stress there in the units of the source.
    """
    width, thickness, depth, modulus, poisson = 40.0, 0.2, 10.0, 200e3, 0.3
    height, length = n * width, math.hypot(n, 1.0) * width
    leaf = Leaf(neck_thickness=thickness, leaf_length=length, notch_depth=thickness)
    stiffness = compliance(leaf, modulus, poisson, depth, method="timoshenko", plane="stress")
    turn = math.atan2(height, width)
    hinges = tuple(
        SpringHinge(
            name=f"{direction:.1f}",
            bodies=(0, 1),
            at=(0.0, 0.0),
            direction=direction,
            stiffness=stiffness.stiffness,
            leaf=leaf_beam(leaf, modulus, poisson, depth),
        )
        for direction in (turn, math.pi - turn)
    )
    drives = tuple(
        Sight(name=name, bodies=(0, 1), points=((x, 0.0), (x, 0.0)), direction=0.5 * math.pi)
        for name, x in (("up", length), ("down", -length))
    )
    bodies = tuple(
        RigidBody(name=name, centre=(0.0, 0.0), mass=1.0, inertia=1.0, fixed=name == "base")
        for name in ("base", "arm")
    )
    model = nonlinear(Mechanism(name="pivot", bodies=bodies, hinges=hinges, drives=drives))
    bending = modulus * depth * thickness**3 / 12.0
    turned, moment, stress, state = [], [], [], None
    while not turned or turned[-1] < 1.1:
        # forces keep their direction: the couple falls as the arm turns
        push = 0.04 * (len(turned) + 1) * bending / length**2
        state = equilibrium(model, {}, forces={"up": push, "down": -push}, start=state)
        angle = float(state.q[2])
        sections = model.leaves.section_forces(state.leaves)
        axial, across = np.abs(np.moveaxis(sections, -1, 0))
        turned.append(angle)
        moment.append(2.0 * push * length * math.cos(angle) * 2.0 * length / bending)
        surface = axial / (depth * thickness) + 6.0 * across / (depth * thickness**2)
        stress.append(float(surface.max()) * 2.0 * height / (modulus * thickness))
    return np.array(turned), np.array(moment), np.array(stress)


def cross_axis_pivots() -> dict[str, float]:
    """Compute coefficients of stiffness and stress as the source fits them, at 22 rotations."""
    figures, at = {}, 0.05 * np.arange(1.0, 23.0)
    for n in (0.5, 1.0, 2.0, 4.0):
        turned, moment, stress = crossed_leaves(n)
        each = np.interp(at, turned, moment) / at
        # the sum of relative errors is least at one of the rotations
        errors = np.abs(1.0 - each[:, None] / each).sum(axis=1)
        figures[f"stiffness {n:g}"] = float(each[np.argmin(errors)])
        figures[f"stress {n:g}"] = float(np.interp(at, turned, stress) @ at / (at @ at))
    return figures


def _ring(shape: occ.TopoDS_Shape, poisson: float, size: float) -> tuple[Continuum, list[Array]]:
    """Return a part of a ring, and the mean motion of its free end along x, y and z."""
    part = Part.from_shape(shape)
    end = [f.name for f in part.faces if f.normal and abs(f.normal[2]) < 0.1 and f.name != "fixed"]
    body = solid(part, isotropic(1e7, poisson), order=4, size=size, curvature=0.5)
    return body, [body.mean(part.boundary(end), d) for d in (X, Y, Z)]


def quarter_circle() -> dict[str, float]:
    """Compute the curved leaf under a unit force in its plane and across it."""
    body, rows = _ring(parts.quarter_circle_leaf(), 0.25, 0.5)
    return {
        name: 1e3 * float(row @ body.solve(1e-6 * row))
        for name, row in (("in its plane", rows[1]), ("across it", rows[2]))
    }


def eighth_circle() -> dict[str, float]:
    """Compute the curved rod under a large force across its plane."""
    body, rows = _ring(parts.eighth_circle_rod(), 0.0, 10.0)
    u = follow_load(body, 600e-6 * rows[2], (0.1, 0.25, 0.5, 0.75, 1.0)).displacement[-1]
    names = ("outwards", "along", "across")
    return {name: 1e3 * float(row @ u) for name, row in zip(names, rows, strict=True)}


# ----------------------------------------------------------------------------------- hinges


def notches() -> dict[str, float]:
    """Compute circular notches by `wedge` and by the formulas whose errors are printed."""
    figures = {}
    for ratio in (0.05, 0.2, 0.8):
        notch = RightCircular(neck_thickness=ratio, radius=1.0)
        matrix = compliance(notch, 1.0, 0.33, 1.0, plane="stress").matrix
        figures |= {
            f"rotation at {ratio:g}": float(matrix[2, 2]),
            f"stretch at {ratio:g}": float(matrix[0, 0]),
            f"across at {ratio:g}": float(matrix[1, 1]),
        }
        for form in closed_forms(notch):
            if form.quantity == "rotation":
                value = closed_form_compliance(form, notch, 1.0, 0.33, 1.0, plane="stress")
                figures[f"{form.name} at {ratio:g}"] = float(value)
    return figures


# ------------------------------------------------------------------------------------ tables

_BRICKS = "their bricks of eight nodes are too stiff in bending; with their mesh"
_ROOTS = "roots bend in the walls of the stage file; exact clamps"
_BLADES = "their quadratic tetrahedra are flat; with such ones of 0.11 mm (inferred)"
_BEAMS = (
    "orthotropic, in linear bricks there; with their shear modulus, one brick across and 17 "
    "(inferred) along a beam"
)

CASES: tuple[Case, ...] = (
    Case(
        name="two-leaf parallelogram",
        group="H.-J. Su, B. Survey",
        source="github.com/haijunsu-osu/parallelogram_model_comparison, MIT",
        method="CalculiX, quadratic tetrahedra of 10 mm, large displacement",
        obstacle="rigid stage and exact clamps in a stage file (`Bodies` has them)",
        compute=two_leaves,
        file="two-leaf-parallelogram",
        seconds=25.0,
        cpu=20.0,
        rows=(
            Row(
                what="stiffness by the stage file [N/mm]",
                printed=174.66,
                key="stiffness, plane",
                why="wall and stage bend at the roots; clamped, with their stage of 5000 GPa",
                explained="stiffness",
            ),
            Row(
                what="motion across at 20 E I/L^2, stage file [L]",
                printed=0.559876,
                key="across at 20, plane",
                why="bodies bend at the roots; clamped, with their stiff stage",
                explained="across at 20",
            ),
            Row(what="motion across at 1 E I/L^2 [L]", printed=0.0400768, key="across at 1"),
            Row(what="sag at 1 E I/L^2 [L]", printed=-0.00097028, key="along at 1"),
            Row(
                what="rotation at 1 E I/L^2 [rad]",
                printed=1.0278064e-4,
                key="mean rotation at 1",
                why="they read two corners, which the leaves dent; there",
                explained="rotation at 1",
            ),
            Row(what="sag at 5 E I/L^2 [L]", printed=-0.02284664, key="along at 5"),
            Row(what="sag at 20 E I/L^2 [L]", printed=-0.215222, key="along at 20"),
            Row(
                what="rotation at 20 E I/L^2 [rad]",
                printed=0.0345972837,
                key="mean rotation at 20",
            ),
            Row(
                what="motion across under 10, pressed by 5 E I/L^2, turned by 3 E I/L [L]",
                printed=0.439428,
                key="across, all loads",
            ),
            Row(what="sag under these [L]", printed=-0.1269844, key="along, all loads"),
            Row(
                what="rotation under these [rad]",
                printed=0.021431003,
                key="mean rotation, all loads",
            ),
        ),
    ),
    Case(
        name="mirror on eight wires",
        group="S. A. Nalkande",
        source=(
            "github.com/Sanskar201/design-and-analysis-of-a-flexure-based-micro-mirror, no licence"
        ),
        method="Ansys, 772 quadratic tetrahedra",
        obstacle="no plate: drawn as a part",
        compute=eight_wires,
        shape=parts.eight_wire_mirror,
        seconds=10.0,
        cpu=3.7,
        rows=(
            Row(
                what="mode 1, polysilicon as stated [Hz]",
                printed=12579.2,
                key="mode 1, polysilicon",
                why="the solved file has structural steel; of steel",
                explained="mode 1, steel",
            ),
            Row(what="mode 2, steel [Hz]", printed=52878.9, key="mode 2, steel"),
            Row(what="mode 4, steel [Hz]", printed=146812.4, key="mode 4, steel"),
            Row(what="mode 6, steel [Hz]", printed=173512.2, key="mode 6, steel"),
        ),
    ),
    Case(
        name="mirror on four blades",
        group="P. Sivakumar",
        source="github.com/premkumar22siva/C294A_Micromirror_Design, no licence",
        method="Ansys, tetrahedra",
        obstacle="no plate: drawn as a part; material and mesh of their elements are not printed",
        compute=four_blades,
        shape=parts.four_blade_mirror,
        seconds=30.0,
        cpu=12.0,
        rows=(
            Row(
                what="mode 1 [Hz]",
                printed=7536.7,
                key="mode 1",
                why=_BLADES,
                explained="mode 1, coarse",
            ),
            Row(
                what="mode 2 [Hz]",
                printed=89025.0,
                key="mode 2",
                why=_BLADES,
                explained="mode 2, coarse",
            ),
        ),
    ),
    Case(
        name="block on four leaves",
        group="amanabt",
        source="github.com/amanabt/flexural_stage, GPL-3.0",
        method="Elmer, bricks of eight nodes",
        obstacle="exact clamps in a stage file",
        compute=four_leaves,
        file="four-leaf-stage",
        seconds=40.0,
        cpu=17.0,
        rows=(
            Row(
                what="motion by the stage file [mm]",
                printed=0.490506,
                key="stage file",
                why=_ROOTS,
                explained="clamped",
            ),
            Row(
                what="motion [mm]", printed=0.490506, key="clamped", why=_BRICKS, explained="bricks"
            ),
        ),
    ),
    Case(
        name="notched beam",
        group="amanabt",
        source="the same",
        method="Elmer, bricks of eight nodes",
        obstacle="weight along the plane in a stage file",
        compute=notched,
        shape=parts.notched_beam,
        seconds=7.0,
        cpu=2.1,
        rows=(
            Row(
                what="motion of the tip [mm]",
                printed=3.517177,
                key="tip",
                why=_BRICKS,
                explained="tip, bricks",
            ),
        ),
    ),
    Case(
        name="smaller block on four leaves",
        group="mohithadira",
        source="github.com/mohithadira/flexural_stage, GPL-3.0",
        method="Elmer, bricks of eight nodes",
        obstacle="exact clamps in a stage file",
        compute=small_four_leaves,
        file="small-four-leaf-stage",
        seconds=7.0,
        cpu=2.6,
        rows=(
            Row(
                what="motion by the stage file [mm]",
                printed=0.1015167,
                key="stage file",
                why="roots bend in the walls, and their bricks are too stiff; with their mesh",
                explained="load alone, bricks",
            ),
            Row(
                what="sag under its weight [mm]",
                printed=0.0190736,
                key="weight, clamped",
                why=_BRICKS,
                explained="weight, bricks",
            ),
            Row(
                what="motion and sag [mm]",
                printed=0.1204888,
                key="load, clamped",
                why=_BRICKS,
                explained="load, bricks",
            ),
        ),
    ),
    Case(
        name="gripper",
        group="Zahorack",
        source="github.com/Zahorack/fem-ansys, no licence",
        method="Ansys, bilinear plane elements of 50 um",
        obstacle="imposed motion of an edge in a stage file",
        compute=gripper,
        seconds=12.0,
        cpu=4.1,
        rows=(
            Row(what="motion of the tip for 20 um [mm]", printed=0.270, key="tip"),
            Row(
                what="largest stress [MPa]",
                printed=952.0,
                key="stress",
                why="mean of bilinear elements in a node there; likewise",
                explained="stress, bilinear",
            ),
        ),
    ),
    Case(
        name="arm on two beams",
        group="Zahorack",
        source="the same",
        method="Ansys, bilinear plane elements of 20 um",
        obstacle="clamps without a body in a stage file",
        compute=arm,
        seconds=1.0,
        cpu=0.2,
        rows=(
            Row(
                what="motion of the tip [um]",
                printed=1.84122,
                key="tip",
                why="stands; bilinear elements of their size, some triangles: {tip, bilinear:.4f}",
            ),
        ),
    ),
    Case(
        name="torsion accelerometer",
        group="V. Kolchuzhin",
        source="github.com/Kolchuzhin/APDL_scripts, no licence",
        method="Ansys, linear bricks",
        obstacle="orthotropic silicon; taper of a leaf in a stage file",
        compute=accelerometer,
        shape=parts.torsion_accelerometer,
        seconds=30.0,
        cpu=10.0,
        rows=(
            Row(
                what="mode 1, torsion of the beams [Hz]",
                printed=1238.3,
                key="mode 1",
                why="orthotropic there; with their shear modulus",
                explained="mode 1, shear",
            ),
            *(
                Row(
                    what=f"mode {mode} [Hz]",
                    printed=printed,
                    key=f"mode {mode}",
                    why=_BEAMS,
                    explained=f"mode {mode}, bricks",
                )
                for mode, printed in ((2, 5830.9), (3, 10818.0), (4, 15779.0), (5, 19143.0))
            ),
            Row(
                what="deflection at 2 g [um]",
                printed=0.153946,
                key="deflection",
                why=_BEAMS,
                explained="deflection, bricks",
            ),
        ),
    ),
    Case(
        name="cantilever leaf far bent",
        group="K. Y. Sze, X. H. Liu, S. H. Lo",
        source="Finite Elem. Anal. Des. 40 (2004) 1551, as typed in github.com/smdogroup/tacs",
        method="Abaqus, shells S4R",
        obstacle="a leaf without a second body",
        compute=leaf_far,
        seconds=1.0,
        cpu=0.2,
        rows=(
            Row(what="motion across at 0.2 E I/L^2 [L/10]", printed=0.663, key="across at 0.05"),
            Row(what="motion across at 4 E I/L^2 [L/10]", printed=6.698, key="across at 1"),
            Row(what="sag at 2 E I/L^2 [L/10]", printed=1.604, key="along at 0.5"),
            Row(what="sag at 4 E I/L^2 [L/10]", printed=3.286, key="along at 1"),
        ),
    ),
    Case(
        name="cross-axis pivot",
        group="B. D. Jensen, L. L. Howell",
        source="Mech. Mach. Theory 37 (2002) 461, equations 16 and 29 for n = height over width",
        method="Ansys, elastic beams, large displacement",
        obstacle="leaves that cross, which no single plate has",
        compute=cross_axis_pivots,
        seconds=2.0,
        cpu=1.9,
        rows=(
            Row(what="stiffness to 1.1 rad, n 0.5 [EI/2L]", printed=4.6532, key="stiffness 0.5"),
            Row(what="stiffness to 1.1 rad, n 1 [EI/2L]", printed=4.3079, key="stiffness 1"),
            Row(what="stiffness to 1.1 rad, n 4 [EI/2L]", printed=4.0244, key="stiffness 4"),
            Row(
                what="stress to 1.1 rad, n 0.5 [E t/2r]",
                printed=0.70862,
                key="stress 0.5",
                why="stands: how its line over the rotation is fitted is not stated",
            ),
            Row(what="stress to 1.1 rad, n 1 [E t/2r]", printed=0.96513, key="stress 1"),
            Row(what="stress to 1.1 rad, n 4 [E t/2r]", printed=1.0691, key="stress 4"),
        ),
    ),
    Case(
        name="copper wire",
        group="Seamplex",
        source="github.com/seamplex/feenox, GPL-3.0, examples/modal.md",
        method="FeenoX, hexahedra",
        obstacle="a round wire in a stage file",
        compute=wire,
        shape=parts.copper_wire,
        seconds=15.0,
        cpu=5.0,
        rows=tuple(
            Row(what=f"mode {n} [Hz]", printed=printed, key=f"mode {n}")
            for n, printed in ((1, 45.84), (3, 803.4), (5, 2596.0))
        ),
    ),
    Case(
        name="curved leaf",
        group="R. H. MacNeal, R. L. Harder",
        source="Finite Elem. Anal. Des. 1 (1985) 3, as typed by P. Krysl (FAESOR)",
        method="closed form; quadratic bricks, converged",
        obstacle="a curved leaf in a stage file",
        compute=quarter_circle,
        shape=parts.quarter_circle_leaf,
        seconds=6.0,
        cpu=0.8,
        rows=(
            Row(what="in its plane, closed form [in/lbf]", printed=0.08734, key="in its plane"),
            Row(what="in its plane, bricks [in/lbf]", printed=0.088519352, key="in its plane"),
            Row(what="across it, closed form [in/lbf]", printed=0.5022, key="across it"),
            Row(what="across it, bricks [in/lbf]", printed=0.498301637, key="across it"),
        ),
    ),
    Case(
        name="curved rod far bent",
        group="Kynema (NREL)",
        source="github.com/kynema/kynema, curved.rst; rod of K.-J. Bathe, S. Bolourchi (1979)",
        method="spectral beam element",
        obstacle="bending out of the plane with large displacement in a stage file",
        compute=eighth_circle,
        shape=parts.eighth_circle_rod,
        seconds=10.0,
        cpu=3.7,
        rows=(
            Row(what="motion across [in]", printed=53.57763, key="across"),
            Row(what="along the clamped end [in]", printed=-23.64597, key="along"),
            Row(what="outwards [in]", printed=13.7208, key="outwards"),
        ),
    ),
    Case(
        name="circular notch",
        group="notch table",
        source="tests/reference/circular-notch.csv",
        method="plane finite elements, blocks of one radius",
        obstacle="none",
        compute=notches,
        seconds=0.1,
        cpu=0.1,
        rows=(
            Row(what="rotation, t/R 0.05 [12/(E b R^2)]", printed=25625.0, key="rotation at 0.05"),
            Row(what="rotation, t/R 0.8", printed=27.743, key="rotation at 0.8"),
            Row(
                what="stretch, t/R 0.8",
                printed=2.268,
                key="stretch at 0.8",
                why="stands: end blocks of one radius (at t/R 0.2 longer ones give 1.9 % more)",
            ),
            Row(
                what="rotation by Paros and Weisbord, t/R 0.2",
                printed=829.26 * (1.0 - 0.072),
                key="Paros and Weisbord 1965 at 0.2",
            ),
            Row(
                what="rotation by Schotborgh, t/R 0.8",
                printed=27.743 * 1.057,
                key="Schotborgh et al. 2005 at 0.8",
            ),
        ),
    ),
)


class Elsewhere:
    """Figures of a comparison that another test makes, with its page."""

    group = "T. Dehaeze"
    source = "github.com/tdehaeze/stewart-simscape, MIT"
    method = "Ansys super-elements"
    page = "ansys-comparison.md"
    obstacle = "materials, interfaces and a pocket are not stated"
    #: Stage, quantity, Ansys, flexstage, why.
    rows = (
        ("joint with notches", "axial stiffness [N/um]", 93.955, 94.00, ""),
        ("joint with notches", "bending stiffness [N m/rad]", 4.8322, 4.853, ""),
        ("joint with notches", "torsion, rigid interfaces [N m/rad]", 260.18, 297.86,
         "mean interfaces: 262.65 (+0.9 %)"),
        ("joint with leaves", "torsion [N m/rad]", 235.8, 244.6, "order 4: 241.2 (+2.3 %)"),
        ("joint with leaves", "shear [N/um]", 11.43, 12.87, "stands: interface faces unknown"),
        ("amplified actuator", "ratio, pocket straight [1]", 5.075, 5.618,
         "pocket unknown; sloped: 5.062 (-0.2 %)"),
        ("amplified actuator", "output stiffness, pocket straight [N/um]", 1.753, 1.486,
         "pocket unknown; sloped: 1.974 (+12.6 %)"),
    )  # fmt: skip


def difference(computed: float, printed: float) -> float:
    """Return the difference of a figure from a printed one [%]."""
    return 100.0 * (computed - printed) / abs(printed)


def digits(value: float) -> str:
    """Write a figure with five significant digits."""
    return f"{value:#.5g}".rstrip(".")


@cache
def computed(name: str) -> Mapping[str, float]:
    """Return our figures of a case, by its name."""
    return next(case for case in CASES if case.name == name).compute()


def line(case: Case, row: Row, figures: Mapping[str, float]) -> list[str]:
    """Write a row of the table."""
    value = figures[row.key]
    why = row.why.format_map(figures)
    if row.explained:
        other = figures[row.explained]
        why += f": {digits(other)} ({difference(other, row.printed):+.1f} %)"
    return [
        f"{case.name} ({case.group})",
        row.what,
        digits(row.printed),
        digits(value),
        f"{difference(value, row.printed):+.1f}",
        why,
    ]


def figure_lines() -> list[list[str]]:
    """Return the rows of the table of figures, the largest difference first."""
    lines = [line(case, row, computed(case.name)) for case in CASES for row in case.rows]
    for name, what, ansys, ours, why in Elsewhere.rows:
        cells = [f"{name} ({Elsewhere.group})", what, digits(ansys), digits(ours)]
        lines.append([*cells, f"{difference(ours, ansys):+.1f}", why])
    return sorted(lines, key=lambda cells: -abs(float(cells[4])))


def code_lines(text: str) -> int:
    """Return the number of lines that are neither empty nor comments."""
    return sum(
        bool(line.strip()) and not line.lstrip().startswith("#") for line in text.splitlines()
    )


def described(case: Case) -> str:
    """Return what it takes to describe a case and to get its first figure."""
    if case.file:
        lines = code_lines((STAGES / f"{case.file}.yaml").read_text("utf-8"))
        return f"{lines} lines of YAML, `analyse`"
    if case.shape is not None:
        return f"{code_lines(inspect.getsource(case.shape))} lines of Python, `part`"
    return f"{code_lines(inspect.getsource(case.compute))} lines of Python"


def source_lines() -> list[list[str]]:
    """Return the rows of the table of sources."""
    rows = [
        [c.name, c.group, c.source, c.method, described(c), f"{c.cpu:g}", c.obstacle] for c in CASES
    ]
    e = Elsewhere
    other = [
        "joints, amplified actuator",
        e.group,
        e.source,
        e.method,
        "another page",
        "",
        e.obstacle,
    ]
    return [*rows, other]


def main(folder: Path) -> None:
    """Write both tables."""
    folder.mkdir(parents=True, exist_ok=True)
    for file, lines in ((FIGURES, figure_lines()), (SOURCES, source_lines())):
        with (folder / file).open("w", encoding="utf-8", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerows(lines)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else FOLDER)
