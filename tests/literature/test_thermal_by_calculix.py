"""The piezo stage, warmed on a steel base with its stacks in place, in CalculiX.

There the stacks are a second material, meshed with the plate, and the base moves the bolts.

Evidence (The two stages of the study): thermal drift with stacks in place, steel base (CalculiX,
22 000 triangles, two materials; stacks of fibres along the drive): displacement 0.3 %, yaw 1.5 %;
bodies of three materials: tilt by temperature, displacement 0.3 %, frequency 0.2 %
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from netgen.occ import Glue

from flexstage.base.arrays import Array
from flexstage.elasticity.shapes import face
from flexstage.fem.geometry import MOUNTING, StageFaces, body_region, stage_faces
from flexstage.fem.superelement import superelement_model
from flexstage.quantities.material import Material, material
from flexstage.stage import Bench, Drive, Probe, Stage
from flexstage.stage.designs import design
from flexstage.system import modes, static_loads, thermal_drift
from tests.peers import calculix
from tests.peers.gmsh_grid import plane_grid
from tests.peers.grids import Grid
from tests.peers.stage_grid import read_by

pytestmark = pytest.mark.slow
STACK = Material(
    name="stack", youngs_modulus=30e9, poissons_ratio=0.3, density=7.7e3, thermal_expansion=-3.5e-6
)
BASE = 11.5e-6


@pytest.fixture(autouse=True)
def _ccx() -> None:
    calculix.needed()


def filled(stage: Stage, faces: StageFaces) -> object:
    """Glue a stack between the patches of each drive; edges keep their names."""

    def stack(drive: Drive) -> object:
        (a, b), (c, d) = (p.ends for p in faces.patches if p.drive == drive.name and p.ends)
        made = face((a, b, c, d) if math.dist(b, c) < math.dist(b, d) else (a, b, d, c))
        made.name = f"stack {drive.name}"
        return made

    def at(edge: object) -> tuple[float, float]:
        centre = edge.center
        return round(centre.x, 3), round(centre.y, 3)

    names = {at(edge): edge.name for edge in faces.shape.edges if edge.name}
    glued = Glue([*faces.shape.faces, *map(stack, stage.drives)])
    for edge in glued.edges:
        if at(edge) in names:
            edge.name = names[at(edge)]
    return glued


def motion(stage: Stage, probe: Probe, grid: Grid, u: Array) -> tuple[float, float]:
    """Return reading [m] and rotation [rad] of the rigid motion nearest to that of the body."""
    own = grid.elements[read_by(stage, probe, grid)]
    a, b, c = (grid.nodes[own[:, k]] for k in range(3))
    double = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    # middles of edges with a third of the area each: exact for squares
    root, nodes = np.sqrt(np.repeat(np.abs(double), 6)), own[:, 3:].ravel()
    x, y = (grid.nodes[nodes] - probe.at).T
    rows = np.zeros((2 * nodes.size, 3))
    rows[0::2, 0], rows[1::2, 1], rows[0::2, 2], rows[1::2, 2] = 1.0, 1.0, -y, x
    found = np.linalg.lstsq(rows * root[:, None], u[nodes].ravel() * root, rcond=None)[0]
    return float(np.dot(probe.row[:2], found[:2])), float(found[2])


@pytest.mark.parametrize("fibres", [True, False])
def test_stacks_of_a_second_material(*, fibres: bool) -> None:
    plain = design("vgtu-piezo")
    spring = STACK.youngs_modulus * 6e-3 * plain.thickness / 36e-3
    drives = (replace(d, stiffness=spring, thermal_expansion=-3.5e-6) for d in plain.drives)
    stage = replace(plain, drives=tuple(drives))
    system = superelement_model(stage, supports="elastic", plane="stress").system
    ours = thermal_drift(stage, system, Bench(base=BASE))
    outline = filled(stage, stage_faces(stage))
    grid = plane_grid(stage, outline, neck_size=0.5, size=15e-3)
    job = calculix.Job(
        grid=grid,
        kind="CPS6",
        material=stage.material,
        thickness=stage.thickness,
        held={"xy": np.unique(grid.sides[MOUNTING])},
        others={f"stack {name}": (STACK, name if fibres else "") for name in "xy"},
        base=BASE,
    )
    u = calculix.solve(job).displacements[0] - BASE * grid.nodes
    for probe in stage.probes:
        reading, turn = motion(stage, probe, grid, u)
        if fibres:
            assert reading == pytest.approx(ours.readings[probe.name], rel=3e-3)
            assert turn == pytest.approx(ours.rotations[probe.body], rel=0.015)
        else:
            # a stack that is glued over its whole ends hinders their expansion across it
            assert 1.03 < reading / ours.readings[probe.name] < 1.06


def test_bodies_of_other_materials() -> None:
    # legs of two materials tilt a platform of a third one
    plain = design("parallelogram")
    own = {"left-leg": material("Stainless steel 304"), "platform": material("Invar 36")}
    bodies = tuple(replace(b, material=own.get(b.name), extra_masses=()) for b in plain.bodies)
    stage = replace(plain, bodies=bodies)
    grid = plane_grid(stage, stage_faces(stage).shape, neck_size=0.4, size=5e-3)
    job = calculix.Job(
        grid=grid,
        kind="CPS6",
        material=stage.material,
        thickness=stage.thickness,
        held={"xy": np.unique(grid.sides[MOUNTING])},
        others={body_region(name): (of, "") for name, of in own.items()},
        base=0.0,
        modes=1,
    )
    theirs = calculix.solve(job)
    system = superelement_model(stage, plane="stress").system
    assert modes(system).frequency_hz[0] == pytest.approx(theirs.frequencies[0], rel=2e-3)
    answer = static_loads(system, {"temperature": 1.0})
    [probe] = stage.probes
    reading, turn = motion(stage, probe, grid, theirs.displacements[0])
    assert abs(turn) > 1e-6
    assert answer.body_motion["platform"][2] == pytest.approx(turn, rel=3e-3)
    assert answer.readings[probe.name] == pytest.approx(reading, rel=3e-3, abs=2e-9)
