"""A part of a plate with functions through its thickness, against states that are known exactly."""

from collections.abc import Callable
from dataclasses import replace

import ngsolve as ng
import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.elasticity import face
from flexstage.fem.layered_plate import REFERENCE, LayeredPlate
from flexstage.fem.mesh import MeshSettings, face_mesh
from flexstage.fem.plane_integrals import FrontalFactor, PlaneIntegrals, factorised
from flexstage.fem.through_thickness import ThroughThickness

# a block with generic sides, away from the origin
LENGTH, WIDTH, THICKNESS = 23e-3, 7e-3, 9e-3
CORNER = (3e-3, -4e-3)
NU = 0.31
MATERIAL = replace(REFERENCE, poissons_ratio=NU)
E, ALPHA = MATERIAL.youngs_modulus, MATERIAL.thermal_expansion or 0.0

Field = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, ...]]


def plate(*, out_of_plane: bool, size: float = 2.0) -> LayeredPlate:
    x, y = CORNER
    shape = face(((x, y), (x + LENGTH, y), (x + LENGTH, y + WIDTH), (x, y + WIDTH)))
    shape.name = "block"
    through = ThroughThickness(thickness=THICKNESS, layer=1.1e-3, out_of_plane=out_of_plane)
    mesh = face_mesh(shape, THICKNESS, MeshSettings(order=3, size=size))
    # one end is a notch, so that fields of notches alone take part
    notch = ("none", (x, y), 8e-3)
    return LayeredPlate(PlaneIntegrals(mesh, order=3, fixed=""), MATERIAL, through, [notch])


@pytest.fixture(scope="module", params=[False, True], ids=["in plane", "out of plane"])
def part(request: pytest.FixtureRequest) -> LayeredPlate:
    return plate(out_of_plane=request.param)


def unknowns(part: LayeredPlate, field: Field) -> np.ndarray:
    """Unknowns of a displacement that is a polynomial of degree 2 at most along the plane."""
    z, weights = part.through.rule
    space = ng.H1(part.plane.mesh, order=part.plane.order)
    # fit the field at every depth on the scalar space, then take it apart by the functions
    found = np.zeros((len(part.through.components), part.plane.width))
    terms = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
    shapes = []
    for p, q in terms:
        function = ng.GridFunction(space)
        function.Set((ng.x / 1e3) ** p * (ng.y / 1e3) ** q, bonus_intorder=4)
        shapes.append(function.vec.FV().NumPy().copy())
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-1.0, 1.0, (2, 12))
    table = np.column_stack([x**p * y**q for p, q in terms])
    for depth, weight, k in zip(z, weights, range(z.size), strict=True):
        values = field(x, y, np.full_like(x, depth))
        for i, (direction, kind, number) in enumerate(part.through.components):
            factors = np.linalg.lstsq(table, values[direction] + 0.0 * x, rcond=None)[0]
            own = part.through.functions[kind].values[number][k]
            found[i] += weight * own * (factors @ np.array(shapes))
    return part.gathered(found)


def test_rigid_motions_strain_nothing_and_weigh_what_they_must(part: LayeredPlate) -> None:
    rigid = part.rigid
    stiffness = part.stiffness
    forces = abs(stiffness) @ np.abs(rigid)
    assert np.abs(stiffness @ rigid).max() < 1e-10 * forces.max()
    mass = rigid.T @ part.mass_times(rigid)
    whole = MATERIAL.density * LENGTH * WIDTH * THICKNESS
    cx, cy = CORNER[0] + LENGTH / 2.0, CORNER[1] + WIDTH / 2.0
    x2, y2, z2 = LENGTH**2 / 12.0 + cx**2, WIDTH**2 / 12.0 + cy**2, THICKNESS**2 / 12.0
    if part.through.out_of_plane:
        expected = [[1.0, cy, -cx], [cy, y2 + z2, -cx * cy], [-cx, -cx * cy, x2 + z2]]
    else:
        expected = [[1.0, 0.0, -cy], [0.0, 1.0, cx], [-cy, cx, x2 + y2]]
    np.testing.assert_allclose(mass, whole * np.array(expected), rtol=1e-9, atol=1e-12 * whole)


def test_the_mean_motion_is_that_of_a_rigid_motion(part: LayeredPlate) -> None:
    np.testing.assert_allclose(part.motion(".*", (0.0, 0.0)) @ part.rigid, np.eye(3), atol=1e-11)


def pulled(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    return x, -NU * y, -NU * z


def bent_in_plane(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    v = y - CORNER[1] - WIDTH / 2.0
    return -x * v, x**2 / 2.0 + NU * (v**2 - z**2) / 2.0, NU * v * z


def bent_out_of_plane(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    return -x * z, NU * y * z, x**2 / 2.0 + NU * (z**2 - y**2) / 2.0


@pytest.mark.parametrize(
    ("field", "out_of_plane", "energy"),
    [
        (pulled, False, E * LENGTH * WIDTH * THICKNESS),
        (bent_in_plane, False, E * LENGTH * THICKNESS * WIDTH**3 / 12.0),
        (bent_out_of_plane, True, E * LENGTH * WIDTH * THICKNESS**3 / 12.0),
    ],
)
def test_bars_are_pulled_and_bent_exactly(field: Field, out_of_plane: bool, energy: float) -> None:
    """Saint-Venant's solutions: E A L and E I L at unit strain and unit curvature."""
    part = plate(out_of_plane=out_of_plane)
    u = unknowns(part, field)
    assert u @ (part.stiffness @ u) == pytest.approx(energy, rel=1e-9)


def warm(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    return x, y, z


def warmer_at_one_end(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    return (x**2 - y**2 - z**2) / 2.0, x * y, x * z


def warmer_at_one_face(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    return x * z, y * z, (z**2 - x**2 - y**2) / 2.0


@pytest.mark.parametrize(
    ("field", "temperature", "power"),
    [(warm, 1.0, 0), (warmer_at_one_end, ng.x / 1e3, 0), (warmer_at_one_face, 1.0, 1)],
)
def test_linear_temperatures_move_and_stress_nothing(
    field: Field, temperature: float | ng.CoefficientFunction, power: int
) -> None:
    """A field of temperature that is linear in space strains a free body without stress."""
    part = plate(out_of_plane=power == 1)
    found = part.stiffness @ (ALPHA * unknowns(part, field))
    expected = part.thermal(temperature, power)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("out_of_plane", [False, True])
def test_elimination_in_the_order_of_the_unknowns_fills_little(out_of_plane: bool) -> None:
    """Against minimum degree on all unknowns, not on the scalar space alone."""
    part = plate(out_of_plane=out_of_plane, size=0.14)
    loose = np.setdiff1d(np.arange(part.size), part.pins)
    stiffness = part.stiffness[loose][:, loose]
    own, other = (factorised(stiffness, ordered=ordered) for ordered in (True, False))
    assert own.L.nnz < 1.2 * other.L.nnz


def test_solutions_by_dense_fronts_meet_the_stiffness(part: LayeredPlate) -> None:
    """Where notches have fields that bodies have not; of a plate that three springs hold."""
    stiffness, loads = part.stiffness, np.random.default_rng(2).normal(size=(part.size, 3))
    for pin in part.pins:
        stiffness[pin, pin] *= 10.0
    factor = part.factorised(part.pins, 10.0)
    assert isinstance(factor, FrontalFactor)
    found = factor.solve(loads)
    forces = abs(stiffness) @ np.abs(found)
    assert np.abs(stiffness @ found - loads).max() < 1e-13 * forces.max()


def test_a_plate_that_is_not_stiff_everywhere_is_refused(part: LayeredPlate) -> None:
    with pytest.raises(ModelError, match=r"stiffness of a body is singular, .* thin walls"):
        part.factorised(part.pins, 0.0)
