"""Condensed bodies: what mechanics demands of each, and a whole stage against one mesh of it.

Evidence (Finite elements): superelements (`plane`): ratio 0.003 %, frequencies 0.01 %, stress 0.4
%; *consistency*

Evidence (Finite elements): rigid bodies on leaves (beam with shear) 0.4 %; a leg with a corner
(Castigliano) 1.2 %
"""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
from netgen.meshing import Element1D, Element2D, FaceDescriptor, Mesh, MeshPoint, Pnt

from flexstage.base.arrays import Array
from flexstage.base.errors import HingeError, ModelError, StageError
from flexstage.elasticity import Continuum
from flexstage.elasticity.shapes import METRE
from flexstage.export.drawing.sheet import drawing_svg
from flexstage.fem import mesh as plane_meshes
from flexstage.fem.condensation import Condensed, PrescribedDisplacement, condensed_with_shapes
from flexstage.fem.coupling import join, lowest
from flexstage.fem.geometry import (
    StageFaces,
    either,
    exactly,
    neck_edge,
    notch_region,
    patch_edge,
    stage_faces,
)
from flexstage.fem.layered_plate import LayeredPlate, factorised
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.model import StageModel
from flexstage.fem.necks import IN_PLANE, layered_stress, neck_points, neck_stress
from flexstage.fem.substructure import Placed, Substructure, cut_free
from flexstage.fem.superelement import SuperelementModel, superelement_model
from flexstage.fem.whole_stage import common_validity, plane_model, solid_model
from flexstage.hinges import Leaf, Parabolic, Profile, compliance
from flexstage.hinges.hinge_spring import ROOT_REACH
from flexstage.hinges.registry import with_neck_thickness
from flexstage.lumped import lumped_system
from flexstage.quantities.material import Material, material
from flexstage.report.study import _provenance
from flexstage.stage import Bench, Body, Circle, Hinge, Loop, Probe, Screw, Stage, check
from flexstage.stage.contour import root_reaches, short_halves
from flexstage.stage.designs import design
from flexstage.studies.explore.deviations import Scatter
from flexstage.studies.explore.manufactured_samples import process_of
from flexstage.system import (
    analyse_axis,
    modes,
    probe_stiffness,
    static_forces,
    static_loads,
)
from flexstage.system.thermal import why_no_drift
from tests.drawing_stages import NOTCHES
from tests.hinged_bars import hinged_bars

# Fine enough that the two meshes of one stage differ by less than the tolerances below.
FINE = MeshSettings(order=5, neck_size=0.5, grading=0.4)
COARSE = MeshSettings(order=2, neck_size=1.5)


@pytest.fixture(scope="module")
def bars() -> SuperelementModel:
    return superelement_model(hinged_bars(), FINE, cache=False)


@pytest.fixture(scope="module")
def whole() -> StageModel:
    return plane_model(hinged_bars(), FINE)


@pytest.fixture(scope="module")
def finer() -> StageModel:
    """The same, finer: on the other mesh the stress of a load is 2 % off at the fillet."""
    return plane_model(hinged_bars(), replace(FINE, neck_size=0.3), modes=1)


@pytest.fixture(scope="module")
def lying(bars: SuperelementModel) -> tuple[Placed, Condensed]:
    """The body with two necks and the patch of a drive."""
    return bars.placed[1], bars.condensed[1]


def rigid_coordinates(placed: Placed) -> np.ndarray:
    """Interface motions of a body that moves as one: x, y, and a turn about its reference."""
    rows = []
    for neck in placed.part.necks:
        c, s, (x, y) = np.cos(neck.direction), np.sin(neck.direction), neck.at
        turn = [0.0, 0.0, 0.5 * neck.profile.neck_thickness]
        rows += [[c, s, s * x - c * y], turn, [-s, c, c * x + s * y]]
    for patch in placed.part.patches:
        c, s, (x, y) = np.cos(patch.direction), np.sin(patch.direction), patch.at
        rows.append([c, s, s * x - c * y])
    return np.array(rows)


def test_rigid_motion_takes_no_force(lying: tuple[Placed, Condensed]) -> None:
    placed, body = lying
    m = body.interfaces
    rigid = rigid_coordinates(placed)
    stiffness = body.stiffness[:m, :m]
    # the sum of products that cancel, each of the size of the row: rounding of a solve leaves 1e-9
    size = np.abs(stiffness) @ np.abs(rigid)
    assert np.abs(stiffness @ rigid).max() < 1e-9 * size.max()
    scaled = stiffness / np.sqrt(np.outer(np.diag(stiffness), np.diag(stiffness)))
    values = np.linalg.eigvalsh(scaled)
    assert np.abs(values[:3]).max() < 1e-9
    assert values[3] > 1e-6


def test_rigid_motion_has_the_mass_of_the_body(lying: tuple[Placed, Condensed]) -> None:
    placed, body = lying
    m = body.interfaces
    rigid = rigid_coordinates(placed)
    mass, x, y, inertia = body.inertia
    expected = mass * np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [-y, x, x**2 + y**2]])
    expected[2, 2] += inertia
    found = rigid.T @ body.mass[:m, :m] @ rigid
    # the integrals of the outline are exact, those on the mesh to 2e-7 at its curved edges
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * mass * abs(x))
    motion = body.motion[:, :m] @ rigid
    np.testing.assert_allclose(motion, [[1, 0, -y], [0, 1, x], [0, 0, 1]], atol=1e-9)


def test_stress_is_that_of_the_forces_on_the_own_neck(bars: SuperelementModel) -> None:
    """Of half notches alone, against all of the body, at the ends of the necks.

    Hinges of two directions, bodies on either side of them. Gravity acts within the notches too.
    """
    assert bars.system.stress is not None
    at = np.cumsum([0, *(c.neck.size for c in bars.condensed)])
    for state, near in (
        (static_forces(bars.system, {"push": 40.0}), 4e-3),
        (static_loads(bars.system, {"gravity y": 1.0}), 1e-2),
    ):
        own = bars.system.stress.components(state.q)
        joined = bars.basis @ state.q
        for i, (placed, (where, share)) in enumerate(
            zip(bars.placed, bars.joint.shares, strict=True)
        ):
            part = placed.part
            body, plate, basis = condensed_with_shapes(part)
            points = neck_points(plate.plane.mesh, part.stage())
            u = basis @ (share @ joined[where])
            modulus = bars.stage.material.youngs_modulus / 1e11
            expected = modulus * layered_stress(plate, points, u[:, None])[0, :, :, 0]
            found = own[at[i] : at[i + 1], IN_PLANE]
            for k, neck in enumerate(part.necks):
                mine, theirs = body.neck == k, points.owner == k
                aside = 0.5 * neck.profile.neck_thickness
                for side in (-1, 1):
                    x = neck.at[0] - side * aside * math.sin(neck.direction)
                    y = neck.at[1] + side * aside * math.cos(neck.direction)
                    there = np.hypot(points.position[:, 0] - x, points.position[:, 1] - y) < 1e-9
                    here = mine & (body.seam == side)
                    assert here.sum() == 1
                    np.testing.assert_allclose(
                        found[here][0],
                        expected[theirs & there].mean(axis=0),
                        atol=near * np.abs(own).max(),
                    )


def test_matrices_are_symmetric_and_positive(bars: SuperelementModel) -> None:
    for body in bars.condensed:
        np.testing.assert_allclose(body.stiffness, body.stiffness.T, atol=0.0, rtol=1e-9)
        values = np.linalg.eigvalsh(body.mass / np.sqrt(np.outer(*[np.diag(body.mass)] * 2)))
        # a reading that follows the mean motion is a load that others make up
        assert values.min() > -1e-13
    joint = bars.joint
    for matrix in (joint.K, joint.M):
        scaled = matrix / np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
        assert np.linalg.eigvalsh(scaled).min() > 1e-12


@pytest.fixture(scope="module")
def small(lying: tuple[Placed, Condensed]) -> tuple[PrescribedDisplacement, np.ndarray, np.ndarray]:
    """A floating body on a coarse mesh with its dense stiffness and mass."""
    part = replace(lying[0].part, mesh=COARSE)
    continuum, plate = floating(part)
    rows, direction = [], (0.8, 0.6)
    for name, arm in (("0", ng.y / METRE), ("1", ng.x / METRE)):
        edge = exactly(neck_edge(name))
        unit = [ng.CoefficientFunction(d) for d in ((1.0, 0.0), (0.0, 1.0))]
        rows += [continuum.mean(edge, c) for c in unit]
        rows.append(continuum.mean(edge, (arm - 0.001) * (unit[0] + unit[1])))
    rows.append(continuum.mean(exactly(patch_edge("0", 0)), direction))
    u, v = continuum.space.TnT()
    energy = continuum.lame * ng.div(u) * ng.div(v)
    energy += (
        2.0 * continuum.shear_modulus * ng.InnerProduct(ng.Sym(ng.Grad(u)), ng.Sym(ng.Grad(v)))
    )
    form = ng.BilinearForm(continuum.space)
    form += part.thickness * energy * ng.dx
    form.Assemble()
    i, j, values = (np.asarray(a) for a in form.mat.COO())
    stiffness = np.zeros((continuum.size, continuum.size))
    stiffness[i, j] = values
    # the same unknowns in another order and of another size
    turn = in_plane(plate, np.eye(plate.size))
    stiffness, mass = (turn.T @ m for m in (stiffness @ turn, continuum.mass_times(turn)))
    np.testing.assert_allclose(
        plate.stiffness.toarray(), stiffness, atol=1e-12 * np.abs(stiffness).max()
    )
    body = PrescribedDisplacement(plate, np.array([plate.mean(row) for row in rows]), floating=True)
    return body, stiffness, mass


def floating(part: Substructure) -> tuple[Continuum, LayeredPlate]:
    """A body as a continuum in its plane, and as a plate with one function of z."""
    plate = condensed_with_shapes(part)[1]
    necks = enumerate(part.necks)
    strain = either(notch_region(str(i), n.which) for i, n in necks if n.plane == "strain")
    mesh, order = plate.plane.mesh, plate.plane.order
    continuum = Continuum(
        mesh, part.material(), order=order, thickness=part.thickness, strain=strain
    )
    return continuum, plate


def in_plane(plate: LayeredPlate, u: np.ndarray) -> np.ndarray:
    """Return displacements of a plate with one function of z as a continuum has them."""
    return plate.expanded(u).reshape(2 * plate.plane.width, -1) / np.sqrt(plate.through.thickness)


def test_condensed_stiffness_of_a_floating_body(
    small: tuple[PrescribedDisplacement, np.ndarray, np.ndarray],
) -> None:
    """K_c = (P Kt^-1 P^T)^-1 - D with Kt = K + P^T D P, for any D that holds the body."""
    body, stiffness, _ = small
    P = body.P.toarray()
    shapes, condensed = body.interface_shapes()
    # a spring on each interface, about as stiff as the body there
    springs = np.diag(np.diag(condensed))
    held = stiffness + P.T @ springs @ P
    expected = np.linalg.inv(P @ np.linalg.solve(held, P.T)) - springs
    # the dense solve of a matrix whose pivots span nine decades
    np.testing.assert_allclose(condensed, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(P @ shapes, np.eye(len(P)), atol=1e-9)


def test_modes_with_held_interfaces(
    small: tuple[PrescribedDisplacement, np.ndarray, np.ndarray],
) -> None:
    """Against the dense eigenproblem on all displacements that move no interface."""
    body, stiffness, mass = small
    free = scipy.linalg.null_space(body.P.toarray())
    expected = scipy.linalg.eigh(
        free.T @ stiffness @ free, free.T @ mass @ free, eigvals_only=True, subset_by_index=(0, 2)
    )
    squares, shapes = body.modes(3)
    # the iteration ends when squares of frequencies move by 1e-5 in a step
    np.testing.assert_allclose(squares, expected, rtol=3e-5)
    np.testing.assert_allclose(shapes.T @ mass @ shapes, np.eye(3), atol=1e-9)
    assert np.abs(body.P @ shapes).max() < 1e-9 * abs(body.P).max() * np.abs(shapes).max()


def test_response_to_loads_with_held_interfaces(
    small: tuple[PrescribedDisplacement, np.ndarray, np.ndarray],
) -> None:
    body, stiffness, _ = small
    loads = np.random.default_rng(3).standard_normal((body.part.size, 2))
    free = scipy.linalg.null_space(body.P.toarray())
    expected = free @ np.linalg.solve(free.T @ stiffness @ free, free.T @ loads)
    found = body.fixed_response(loads)
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_stress_of_many_displacements_at_once(lying: tuple[Placed, Condensed]) -> None:
    part = lying[0].part
    continuum, plate = floating(part)
    points = neck_points(continuum.mesh, part.stage())
    chosen = condensed_with_shapes(part)[2][:, [0, 2, 4]]
    expected = neck_stress(continuum, points, in_plane(plate, chosen))
    found = layered_stress(plate, points, chosen)[0]
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found, expected[:, IN_PLANE], atol=1e-9 * scale)
    assert np.abs(expected[:, 2]).max() > 0.1 * scale  # a notch in plane strain is among them


# ---------------------------------------------------------------------- a stage against its mesh


def test_statics_of_hinged_bars(
    bars: SuperelementModel, whole: StageModel, finer: StageModel
) -> None:
    """What is left is the shape of the traction in the necks: 1e-6 of displacements, measured."""
    assert len(bars.joint.coordinates) > 6
    for load in ("push", *(p.name for p in whole.system.loads)):
        if load == "push":
            mine, other, fine = (
                static_forces(m.system, {load: 31.0}) for m in (bars, whole, finer)
            )
        else:
            assert bars.system.load(load).unit == whole.system.load(load).unit
            mine, other, fine = (static_loads(m.system, {load: 1.7}) for m in (bars, whole, finer))
        for name in ("tip",) if load == "push" else ("tip", "between"):
            assert mine.readings[name] == pytest.approx(other.readings[name], rel=3e-5)
        assert mine.drive_displacement["push"] == pytest.approx(
            other.drive_displacement["push"], rel=3e-5
        )
        largest = np.abs(list(other.body_motion.values())).max(axis=0)
        for body, motion in other.body_motion.items():
            assert np.abs(np.subtract(mine.body_motion[body], motion) / largest).max() < 3e-5
        # 'second' carries nothing of the push
        for hinge in () if not other.hinge_stress else ("first", "second")[: 1 + (load != "push")]:
            assert mine.hinge_stress[hinge] == pytest.approx(fine.hinge_stress[hinge], rel=3e-3)
    for probe in ("tip", "between"):  # forces inside the bodies
        mine, other = (probe_stiffness(m.system, probe) for m in (bars, whole))
        # a force at a point: its own place gives way with the logarithm of the element size
        assert mine == pytest.approx(other, rel=1e-3)


def test_stress_on_the_usual_mesh(finer: StageModel) -> None:
    """Measured: within 0.4 %; the fillet of 'second' is shorter than its neck is thick."""
    usual = superelement_model(hinged_bars(), cache=False).system
    for load in ("gravity x", "gravity y"):
        mine, other = (static_loads(s, {load: 1.0}) for s in (usual, finer.system))
        for hinge in ("first", "second"):
            assert mine.hinge_stress[hinge] == pytest.approx(other.hinge_stress[hinge], rel=1e-2)


def test_frequencies_of_hinged_bars(bars: SuperelementModel, whole: StageModel) -> None:
    mine, other = (modes(m.system, count=5).frequency_hz for m in (bars, whole))
    np.testing.assert_allclose(mine[:2], other[:2], rtol=1e-5)
    # three modes of each body stand in for all: upper bounds, 0.1 and 0.35 % high where measured
    assert np.all(mine[2:] > other[2:] * (1.0 - 1e-5))
    np.testing.assert_allclose(mine[2:], other[2:], rtol=5e-3)
    more = superelement_model(hinged_bars(), FINE, modes=12, cache=False)
    np.testing.assert_allclose(modes(more.system, count=5).frequency_hz[2:], other[2:], rtol=7e-4)


def test_a_frame_that_gives_way_under_its_drive(bars: SuperelementModel) -> None:
    """The drive stands on the block, 9 mm beside its own line."""
    mine = superelement_model(hinged_bars(), FINE, supports="elastic", cache=False)
    other = plane_model(hinged_bars(), FINE, supports="elastic", modes=1)
    for load in ({"push": 1.0}, {"push": -3.0}):
        a, b = static_forces(mine.system, load), static_forces(other.system, load)
        assert a.drive_displacement == pytest.approx(b.drive_displacement, rel=1e-5)
        assert a.body_motion["block"] == pytest.approx(b.body_motion["block"], rel=1e-4)
        assert a.readings["tip"] == pytest.approx(b.readings["tip"], rel=1e-5)
    at_rest = static_forces(bars.system, {"push": 1.0}).drive_displacement["push"]
    moved = static_forces(mine.system, {"push": 1.0}).drive_displacement["push"]
    assert abs(moved / at_rest - 1.0) > 1e-3


def test_what_rides_on_a_body(whole: StageModel) -> None:
    bare = superelement_model(hinged_bars(extra=False), FINE, cache=False)
    other = plane_model(hinged_bars(extra=False), FINE, modes=2)
    mine, theirs = (modes(m.system, count=2).frequency_hz for m in (bare, other))
    np.testing.assert_allclose(mine, theirs, rtol=1e-5)
    assert mine[0] > 1.1 * modes(whole.system, count=1).frequency_hz[0]


def test_another_material_and_thickness_need_no_new_mesh() -> None:
    stage = hinged_bars()
    material = replace(
        stage.material, youngs_modulus=61.3e9, density=4120.0, thermal_expansion=9.9e-6
    )
    other = replace(stage, thickness=6.2e-3, material=material)
    keys = [[p.part.key() for p in cut_free(s, FINE, modes=2)] for s in (stage, other)]
    assert keys[0] == keys[1]
    mine, theirs = superelement_model(other, FINE, cache=False), plane_model(other, FINE, modes=2)
    a, b = (modes(m.system, count=2).frequency_hz for m in (mine, theirs))
    np.testing.assert_allclose(a, b, rtol=1e-5)
    for load in ("gravity x", "temperature", "temperature gradient y"):
        a, b = (static_loads(m.system, {load: 1.0}) for m in (mine, theirs))
        assert a.readings["tip"] == pytest.approx(b.readings["tip"], rel=3e-5)
    a, b = (static_forces(m.system, {"push": 5.0}) for m in (mine, theirs))
    assert a.hinge_stress["first"] == pytest.approx(b.hinge_stress["first"], rel=3e-3)


def test_a_body_on_no_hinge_is_refused() -> None:
    stage = hinged_bars()
    loose = Body(name="loose", outline=Loop(((0.03, 0.0), (0.04, 0.0), (0.04, 0.01))))
    with pytest.raises(ModelError, match="'loose' has no hinge and is not fixed"):
        superelement_model(replace(stage, bodies=(*stage.bodies, loose)), cache=False)


def test_what_hangs_by_nothing_is_one_sentence() -> None:
    held = [[2.7, -1.1, 0.0], [-1.1, 3.9, 0.0], [0.0, 0.0, 0.0]]
    with pytest.raises(ModelError, match=r"stiffness of a body is singular, .* thin walls"):
        factorised(scipy.sparse.csc_matrix(held))


def test_two_drives_at_one_place() -> None:
    stage = hinged_bars()
    first = stage.drives[0]
    again = Screw(
        name="again", pushes="lying", reacts="block", at=first.at, direction=first.direction,
        patch_half_width=first.patch_half_width, pitch=5e-4, smallest_step=1e-7, travel=1e-4,
    )  # fmt: skip
    model = superelement_model(replace(stage, drives=(first, again)), cache=False)
    assert model.system.drive("again").vector == pytest.approx(model.system.drive("push").vector)
    # inside the body, where each presses on a disc of its own
    inside = [replace(d, at=((7e-3, 0.4e-3), d.at[1])) for d in (first, again)]
    inside[1] = replace(inside[1], direction=first.direction + 1e-7)
    with pytest.raises(ModelError, match="same place"):
        superelement_model(replace(stage, drives=tuple(inside)), cache=False)


def test_two_halves_meet_at_the_ends_of_their_neck(bars: SuperelementModel) -> None:
    stress = bars.system.stress
    assert stress is not None
    assert stress.point is not None
    body = np.repeat(np.arange(3), [c.neck.size for c in bars.condensed])
    shared = [p for p in np.unique(stress.point) if len(set(body[stress.point == p])) > 1]
    # two ends of two necks
    assert len(shared) == 4
    owners = [set(stress.owner[stress.point == p].tolist()) for p in shared]
    assert sorted(map(tuple, owners)) == [(0,), (0,), (1,), (1,)]
    for p, owner in zip(shared, owners, strict=True):
        bodies = {0: {0, 1}, 1: {1, 2}}[owner.pop()]
        assert set(body[stress.point == p].tolist()) == bodies


def test_shape_of_a_triangle() -> None:
    """4 sqrt(3) A / (a^2 + b^2 + c^2), which is 1 of an equilateral triangle."""
    made = Mesh(dim=2)
    corners = [made.Add(MeshPoint(Pnt(x, y, 0.0))) for x, y in ((0, 0), (3, 0), (0.5, 2))]
    made.SetMaterial(1, "plate")
    made.Add(FaceDescriptor(surfnr=1, bc=1))
    made.Add(Element2D(1, corners))
    for first, second in ((0, 1), (1, 2), (2, 0)):
        made.Add(Element1D([corners[first], corners[second]], index=1))
    expected = 4.0 * np.sqrt(3.0) * 3.0 / (9.0 + 10.25 + 4.25)
    np.testing.assert_allclose(plane_meshes.shapes(ng.Mesh(made)), [expected], rtol=1e-12)


@pytest.mark.parametrize(
    ("worst", "chosen", "tries"),
    [([0.4], 0, 1), ([0.03, 0.2], 1, 2), ([0.03, -0.2, 0.12, 0.05, 0.1, 0.0], 2, 6)],
)
def test_slivers_are_meshed_again(
    worst: list[float], chosen: int, tries: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[int] = []
    monkeypatch.setattr(
        plane_meshes, "plane_mesh", lambda _s, _f, _m, sizes: told.append(len(sizes)) or len(told)
    )
    monkeypatch.setattr(plane_meshes, "shapes", lambda made: np.array([0.5, worst[made - 1], 0.9]))
    monkeypatch.setattr(plane_meshes, "_graded", lambda _mesh, slivers: list(slivers))
    stage = hinged_bars()
    assert plane_meshes.mesh_without_slivers(stage, stage_faces(stage), COARSE) == chosen + 1
    # each mesh is told of the slivers of all before it
    assert told == list(range(tries))


def test_sizes_along_a_sliver_grow_to_its_far_corner() -> None:
    made = Mesh(dim=2)
    corners = [made.Add(MeshPoint(Pnt(x, y, 0.0))) for x, y in ((0, 0), (8, 0.2), (0, 0.4))]
    made.SetMaterial(1, "plate")
    made.Add(FaceDescriptor(surfnr=1, bc=1))
    made.Add(Element2D(1, corners))
    sizes = plane_meshes._graded(ng.Mesh(made), np.array([0]))
    x = np.array([place[0] for place, _ in sizes])
    assert np.all(np.diff(x) > 0.0)
    assert x[0] == pytest.approx(0.4)
    assert 8.0 / 1.5 < x[-1] < 8.0
    assert [place[1] for place, _ in sizes] == pytest.approx([0.2] * len(x))
    assert [size for _, size in sizes] == pytest.approx((0.4 + 0.35 * x).tolist())


def test_elements_are_small_where_corners_point_into_bodies() -> None:
    corner = Loop(
        ((0.0, 0.0), (0.0, 40e-3), (9e-3, 40e-3), (9e-3, 9e-3), (40e-3, 9e-3), (40e-3, 0.0))
    )
    opening = Loop(((2e-3, 2e-3), (5e-3, 2e-3), (5e-3, 4e-3)))
    bent = Loop(((12e-3, 3e-3), (15e-3, 3e-3)), (1.0, 1.0))
    stage = hinged_bars()
    body = replace(
        stage.bodies[0], outline=corner, holes=(opening, bent, Circle((30e-3, 4e-3), 1e-3))
    )
    other = replace(stage, bodies=(body, *stage.bodies[1:]), hinges=stage.hinges[1:])
    faces = stage_faces(replace(other, hinges=(), drives=(), probes=(), axes=()), ["block"])
    found = plane_meshes.corner_sizes(stage=other, faces=faces)
    places = np.array(sorted(place for place, _ in found))
    np.testing.assert_allclose(places, [(2.0, 2.0), (5.0, 2.0), (5.0, 4.0), (9.0, 9.0)])
    assert [size for _, size in found] == pytest.approx([0.1 * 6.0] * 4)


def plate_with_holes(scale: float, width: float, hole: tuple[float, float, float]) -> StageFaces:
    """Return a plate of 40 mm by `width`, with a round hole (x, y, radius) and a slot [mm]."""
    stage = hinged_bars()

    def scaled(*points: tuple[float, float]) -> tuple[tuple[float, float], ...]:
        return tuple((1e-3 * scale * x, 1e-3 * scale * y) for x, y in points)

    x, y, radius = hole
    body = replace(
        stage.bodies[0],
        outline=Loop(scaled((0.0, 0.0), (40.0, 0.0), (40.0, width), (0.0, width))),
        holes=(
            Circle(*scaled((x, y)), 1e-3 * scale * radius),
            Loop(scaled((5.0, 5.0), (15.0, 5.0), (15.0, 9.0), (5.0, 9.0)), (0.0, 1.0, 0.0, 0.2)),
        ),
        mounting_holes=(),
    )
    alone = replace(stage, bodies=(body, *stage.bodies[1:]))
    return stage_faces(replace(alone, hinges=(), drives=(), probes=(), axes=()), ["block"])


def test_a_mesh_moves_with_its_outline() -> None:
    before = plate_with_holes(1.0, 20.0, (30.0, 12.0, 4.0))
    settings = MeshSettings(order=4)
    mesh = plane_meshes.face_mesh(before.shape, 4e-3, settings)
    after = plate_with_holes(1.0, 22.0, (28.0, 13.0, 5.0))
    moved = plane_meshes.moved_mesh(mesh, before, after, settings)
    assert moved is not None
    assert moved.ne == mesh.ne
    # half of a disc on the right end of the slot; the bulge 0.2 is of an arc of 4 atan(0.2)
    angle = 4.0 * math.atan(0.2)
    left = 0.5 * (2.0 / math.sin(0.5 * angle)) ** 2 * (angle - math.sin(angle))
    slot = 40.0 + 0.5 * math.pi * 2.0**2 + left
    area = 40.0 * 22.0 - math.pi * 5.0**2 - slot
    assert ng.Integrate(1.0, moved, order=8) == pytest.approx(area, rel=1e-6)
    whole = ng.Integrate(ng.y, moved, order=8)
    of_hole, of_slot = 13.0 * math.pi * 5.0**2, 7.0 * slot
    assert whole == pytest.approx(40.0 * 22.0 * 11.0 - of_hole - of_slot, rel=1e-6)
    assert plane_meshes.shapes(moved).min() > 0.5 * plane_meshes.SLIVER


def test_a_moved_mesh_is_similar_where_its_outline_is() -> None:
    hole = (30.0, 12.0, 4.0)
    before, after = plate_with_holes(1.0, 20.0, hole), plate_with_holes(1.1, 20.0, hole)
    settings = MeshSettings(order=3)
    mesh = plane_meshes.face_mesh(before.shape, 4e-3, settings)
    moved = plane_meshes.moved_mesh(mesh, before, after, settings)
    places = [np.array([v.point for v in made.vertices]) for made in (mesh, moved)]
    np.testing.assert_allclose(places[1], 1.1 * places[0], atol=1e-9)
    assert ng.Integrate(1.0, moved) == pytest.approx(1.21 * ng.Integrate(1.0, mesh), rel=1e-9)


@pytest.mark.parametrize("sweep", [0.7, math.pi, 4.6])
def test_points_keep_their_share_of_an_arc(sweep: float) -> None:
    def arc(radius: float, start: float, angle: float, count: int) -> Array:
        at = np.linspace(start, start + angle, count)
        return np.column_stack((1.0 + radius * np.cos(at), radius * np.sin(at) - 2.0))

    moved = plane_meshes._moved_along(
        arc(2.0, 0.3, sweep, 3), arc(3.1, -0.4, 1.1 * sweep, 3), arc(2.0, 0.3, sweep, 9)
    )
    np.testing.assert_allclose(moved, arc(3.1, -0.4, 1.1 * sweep, 9), atol=1e-7)


def test_a_mesh_does_not_move_to_another_form() -> None:
    before = plate_with_holes(1.0, 20.0, (30.0, 12.0, 4.0))
    settings = MeshSettings(order=3)
    mesh = plane_meshes.face_mesh(before.shape, 4e-3, settings)
    # the hole cuts the edge of the plate, and one so far away turns elements over
    for hole in ((30.0, 19.0, 4.0), (20.0, 4.5, 4.0)):
        after = plate_with_holes(1.0, 20.0, hole)
        assert plane_meshes.moved_mesh(mesh, before, after, settings) is None


# ---------------------------------------------------------------------- the built-in stages


def test_parallelogram() -> None:
    stage = design("parallelogram")
    settings = MeshSettings(order=5, neck_size=0.8, grading=0.5)
    mine, other = superelement_model(stage, settings, cache=False), plane_model(stage, settings)
    a, b = (modes(m.system, count=2).frequency_hz for m in (mine, other))
    # 2e-6 and 8e-4, measured: the second mode bends the platform
    np.testing.assert_allclose(a, b, rtol=2e-3)
    assert a[0] == pytest.approx(b[0], rel=2e-5)
    axis = mine.system.axes[0]
    a, b = (analyse_axis(m.system, axis) for m in (mine, other))
    assert a.output_displacement == pytest.approx(b.output_displacement, rel=1e-6)
    assert a.input_stiffness == pytest.approx(b.input_stiffness, rel=2e-5)
    assert max(a.static.hinge_stress.values()) == pytest.approx(
        max(b.static.hinge_stress.values()), rel=3e-3
    )


@pytest.mark.slow
def test_the_piezo_stage_of_the_study() -> None:
    """At the usual mesh: what separates the two is how each happens to be meshed.

    The stress is that of all of the stage on a finer mesh: on the usual one it is 1.4 % high.
    """
    stage = design("vgtu-piezo")
    mine, other = superelement_model(stage, cache=False), plane_model(stage)
    finer = plane_model(stage, MeshSettings(order=5, neck_size=0.6))
    a, b = (modes(m.system, count=2).frequency_hz for m in (mine, other))
    np.testing.assert_allclose(a, b, rtol=5e-4)
    for axis in mine.system.axes:
        a, b = (analyse_axis(m.system, axis) for m in (mine, other))
        assert a.output_displacement == pytest.approx(b.output_displacement, rel=2e-4)
        assert a.input_stiffness == pytest.approx(b.input_stiffness, rel=1e-3)
        stress = max(analyse_axis(finer.system, axis).static.hinge_stress.values())
        assert max(a.static.hinge_stress.values()) == pytest.approx(stress, rel=1e-2)


def test_bodies_in_space_are_found_in_the_cache(tmp_path: Path) -> None:
    """Both motions of each body are kept, and read give the same bits."""
    settings = MeshSettings(order=2, neck_size=2.0)
    stage = hinged_bars()
    first = superelement_model(stage, settings, space=True, cache=tmp_path)
    again = superelement_model(stage, settings, space=True, cache=tmp_path)
    assert first.newly_condensed == tuple(b.name for b in stage.bodies)
    assert again.newly_condensed == ()
    np.testing.assert_array_equal(first.system.K, again.system.K)
    # motion in the plane and out of it know nothing of each other
    names = np.array(["out of plane" in n for n in first.joint.coordinates])
    assert 0 < names.sum() < names.size
    assert not first.joint.K[np.ix_(names, ~names)].any()


@pytest.mark.parametrize("count", [6, 16], ids=["by iteration", "densely"])
def test_lowest_modes_and_responses_of_a_joined_stage(count: int) -> None:
    """Against the whole eigenproblem, and statics of all coordinates."""
    coarse = MeshSettings(order=2, neck_size=2.0)
    model = superelement_model(design("parallelogram"), coarse, space=True, cache=False)
    each = len(model.stage.bodies)
    joint = join(model.stage, model.placed[:each], model.condensed[:each])
    # fewer than a tenth of the coordinates are iterated for
    assert (len(joint.K) < 10 * count) == (count == 16)
    omega, basis, is_mode = lowest(joint, count)
    size = 1.0 / np.sqrt(np.diag(joint.M))
    scaled = joint.K * np.outer(size, size), joint.M * np.outer(size, size)
    expected = 1.0 / scipy.linalg.eigh(scaled[1], scaled[0], eigvals_only=True)[::-1]
    np.testing.assert_allclose(omega[:count] ** 2, expected[:count], rtol=1e-9)
    assert is_mode.tolist() == [True] * count + [False] * (omega.size - count)
    np.testing.assert_allclose(basis.T @ joint.M @ basis, np.eye(omega.size), atol=1e-9)
    stiffness = basis.T @ joint.K @ basis / np.outer(omega, omega)
    np.testing.assert_allclose(stiffness, np.eye(omega.size), atol=1e-7)
    forces = np.array([*joint.ports.drives.values(), *joint.ports.probes.values()]).T
    response = np.linalg.solve(joint.K, forces)
    found = basis @ ((basis.T @ forces) / omega[:, None] ** 2)
    np.testing.assert_allclose(found, response, rtol=1e-6, atol=1e-8 * np.abs(response).max())


@pytest.mark.parametrize("count", [2, 16], ids=["by iteration", "densely"])
@pytest.mark.parametrize("what", ["no mass", "no stiffness"])
def test_a_stage_without_frequencies_is_refused(
    bars: SuperelementModel, what: str, count: int
) -> None:
    ((K, M),) = ((K.copy(), M.copy()) for K, M in bars.joint.blocks)
    matrix = M if what == "no mass" else K
    matrix[4] = matrix[:, 4] = 0.0
    with pytest.raises(ModelError, match="no mass or is not attached"):
        lowest(replace(bars.joint, blocks=((K, M),)), count)


def test_in_space_there_is_no_plane_state() -> None:
    with pytest.raises(ModelError, match="no plane state, got 'strain'"):
        superelement_model(hinged_bars(), space=True, plane="strain", cache=False)


# --------------------------------------------------------------- bodies of another material

STEEL = material("Stainless steel 304")
ALUMINIUM = material("Al 7075-T6")
LEAF = Leaf(neck_thickness=0.5e-3, leaf_length=15e-3, notch_depth=2e-3)
APART = 28e-3  # of the two leaves


def leaf_guide(
    platform: Material | None = None, *, rigid: bool = False, profile: Profile = LEAF
) -> Stage:
    """A platform of 40 x 15 mm on two leaves, symmetric about x = 0."""

    def box(low: float, high: float) -> Loop:
        return Loop(((-20e-3, low), (20e-3, low), (20e-3, high), (-20e-3, high)))

    length = profile.length
    return Stage(
        name="guide",
        thickness=5e-3,
        material=ALUMINIUM,
        bodies=(
            Body(name="base", outline=box(-20e-3, 0.0), fixed=True, rigid=rigid),
            Body(
                name="platform",
                outline=box(length, length + 15e-3),
                material=platform,
                rigid=rigid,
            ),
        ),
        hinges=tuple(
            Hinge(
                name=name,
                bodies=("base", "platform"),
                at=(x, 0.5 * length),
                direction=0.5 * math.pi,
                profile=profile,
            )
            for name, x in (("left", -0.5 * APART), ("right", 0.5 * APART))
        ),
        probes=tuple(
            Probe(name=name, body="platform", at=(x, length + 7.5e-3), direction=0.0)
            for name, x in (("left", -20e-3), ("right", 20e-3))
        ),
    )


def _hertz(stage: Stage, count: int = 3) -> np.ndarray:
    return modes(superelement_model(stage, plane="stress", cache=False).system).frequency_hz[:count]


def test_rigid_bodies_leave_the_lumped_model() -> None:
    rigid = leaf_guide(rigid=True)
    found = _hertz(rigid)
    for method in ("wedge", "timoshenko"):
        lumped = modes(lumped_system(rigid, method=method, plane="stress")).frequency_hz
        np.testing.assert_allclose(lumped[:3], found, rtol=4e-3)
    # two clamped and guided leaves, 12 E I/L^3 each, less their shear; 13/35 of them move along
    e, nu, b, t = ALUMINIUM.youngs_modulus, ALUMINIUM.poissons_ratio, 5e-3, LEAF.neck_thickness
    length = LEAF.length
    stiffness = 2.0 * e * b * (t / length) ** 3 / (1.0 + 2.4 * (1.0 + nu) * (t / length) ** 2)
    mass = ALUMINIUM.density * b * (40e-3 * 15e-3 + 26.0 / 35.0 * length * t)
    expected = math.sqrt(stiffness / mass) / (2.0 * math.pi)
    assert found[0] == pytest.approx(expected, rel=4e-3)
    # elastic bodies give way at the roots: the model knows the difference
    assert _hertz(leaf_guide())[0] < 0.98 * found[0]


def test_a_platform_of_steel_is_heavier_by_its_density() -> None:
    moving = [
        m.density * 40e-3 * 15e-3 + ALUMINIUM.density * 26.0 / 35.0 * LEAF.length * 0.5e-3
        for m in (STEEL, ALUMINIUM)
    ]
    steel, plain = (_hertz(leaf_guide(m, rigid=True))[0] for m in (STEEL, None))
    assert steel / plain == pytest.approx(math.sqrt(moving[1] / moving[0]), rel=2e-4)


def test_a_material_of_the_same_figures_changes_nothing() -> None:
    plain = superelement_model(hinged_bars(), cache=False)
    alike = replace(plain.stage.material, name="alike")
    named = tuple(replace(b, material=alike) for b in plain.stage.bodies)
    other = superelement_model(replace(plain.stage, bodies=named), cache=False)
    pair = [modes(m.system).frequency_hz[:4] for m in (plain, other)]
    np.testing.assert_allclose(*pair, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("notch", NOTCHES)
def test_regions_reach_to_the_root_of_every_profile(notch: str) -> None:
    plain = leaf_guide(profile=NOTCHES[notch])
    alike = replace(ALUMINIUM, name="alike")
    named = tuple(replace(b, material=alike) for b in plain.bodies)
    # as far as usual meshes of the two differ at sharp ends of one-sided notches
    np.testing.assert_allclose(_hertz(replace(plain, bodies=named)), _hertz(plain), rtol=4e-3)


@pytest.mark.parametrize("rigid", [False, True])
def test_other_bodies_in_one_mesh_of_the_stage(rigid: bool) -> None:
    stage = leaf_guide(STEEL, rigid=rigid)
    whole = plane_model(stage, plane="stress").system
    np.testing.assert_allclose(modes(whole).frequency_hz[:3], _hertz(stage), rtol=1e-3)
    condensed = superelement_model(stage, plane="stress", cache=False).system
    for system in (whole, condensed):
        sides = static_loads(system, {"temperature": 1.0}).readings
        expected = (STEEL.thermal_expansion or 0.0) * 40e-3
        assert sides["right"] - sides["left"] == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_other_bodies_in_space() -> None:
    stage = leaf_guide(STEEL, rigid=True)
    settings = MeshSettings(order=3, neck_size=1.2, grading=0.75)
    flat = modes(superelement_model(stage, settings, space=True, cache=False).system)
    solid = modes(solid_model(stage, settings).system)
    np.testing.assert_allclose(flat.frequency_hz[:6], solid.frequency_hz[:6], rtol=3e-3)


def test_what_knows_no_other_bodies_says_so() -> None:
    stage = leaf_guide(STEEL)
    with pytest.raises(HingeError, match="choose the method 'wedge'"):
        lumped_system(stage, method="finite-element")
    with pytest.raises(ModelError, match="'platform' is rigid or of another"):
        process_of(stage, Scatter())
    system = superelement_model(stage, supports="elastic", cache=False).system
    assert any("platform: Stainless steel 304; half" in note for note in system.validity)
    assert "bodies expand differently" in why_no_drift(stage, system)


def test_a_body_that_does_not_expand_omits_heat_alone() -> None:
    unknown = replace(STEEL, thermal_expansion=None)
    stage = replace(
        leaf_guide(unknown), bench=Bench(base=11.5e-6, film_coefficient=6.0, base_change=1.0)
    )
    system = plane_model(stage, plane="stress").system
    np.testing.assert_allclose(modes(system).frequency_hz[:3], _hertz(stage), rtol=1e-3)
    assert all(body.thermal is None for body in system.bodies)


def test_a_half_notch_that_ends_early_is_said() -> None:
    # y = d (x / l)^2, whose slope 2 d x / l^2 is 5 at x / l = 5 l / (2 d)
    steep = Parabolic(neck_thickness=0.5e-3, half_length=1e-3, notch_depth=4e-3)
    expected = 5.0 * steep.half_length / (2.0 * steep.notch_depth)
    guide = leaf_guide(rigid=True, profile=steep)
    assert short_halves(guide) == pytest.approx({"left": expected, "right": expected}, abs=0.02)
    early = [issue for issue in check(guide) if issue.code == "early-root"]
    assert [issue.what for issue in early] == [("left",), ("right",)]
    assert f"{100.0 * short_halves(guide)['left']:.0f} % of half" in early[0].message
    said = [n for n in common_validity(guide, "") if "left from" in n and "right from" in n]
    assert len(said) == 1
    for stage in (leaf_guide(profile=steep), leaf_guide(rigid=True)):
        assert not short_halves(stage)


def test_the_drawing_refers_to_its_notes_for_materials() -> None:
    drawn = drawing_svg(leaf_guide(STEEL)).decode()
    assert "Al 7075-T6, see notes" in drawn
    assert "platform: Stainless steel 304" in drawn
    assert "see notes" not in drawing_svg(leaf_guide()).decode()


def test_a_study_gives_the_source_of_every_material() -> None:
    study: Any = SimpleNamespace(stage=leaf_guide(STEEL), analyses={}, read=())
    (found,) = _provenance(study)
    for m in (ALUMINIUM, STEEL):
        assert f"{m.name}: {m.source}" in repr(found)


def test_nothing_relates_to_an_expansion_of_nothing() -> None:
    stage = leaf_guide(STEEL)
    stage = replace(stage, material=replace(ALUMINIUM, thermal_expansion=0.0))
    with pytest.raises(StageError, match=r"'platform' expands .* write 1e-12 1/K"):
        superelement_model(stage, cache=False)


# --------------------------------------------------------------- leaves without a step


def bent_leg(up: float, across: float) -> Stage:
    """A leg from a rigid base up to a corner, and across to a rigid end, 0.5 mm thick."""
    t, h = 0.5e-3, 0.25e-3

    def box(x0: float, y0: float, x1: float, y1: float) -> Loop:
        return Loop(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))

    def leaf(length: float) -> Leaf:
        return Leaf(neck_thickness=t, leaf_length=length, notch_depth=0.0)

    tip = (h + across, up + h)
    return Stage(
        name="leg",
        thickness=5e-3,
        material=ALUMINIUM,
        bodies=(
            Body(name="base", outline=box(-10e-3, -10e-3, 10e-3, 0.0), fixed=True, rigid=True),
            Body(name="corner", outline=box(-h, up, h, up + t)),
            Body(
                name="end",
                outline=box(tip[0], tip[1] - 5e-3, tip[0] + 10e-3, tip[1] + 5e-3),
                rigid=True,
            ),
        ),
        hinges=(
            Hinge(
                name="up",
                bodies=("base", "corner"),
                at=(0.0, 0.5 * up),
                direction=0.5 * math.pi,
                profile=leaf(up),
            ),
            Hinge(
                name="across",
                bodies=("corner", "end"),
                at=(h + 0.5 * across, up + h),
                direction=0.0,
                profile=leaf(across),
            ),
        ),
        probes=tuple(
            Probe(name=name, body="end", at=tip, direction=angle)
            for name, angle in (("x", 0.0), ("y", 0.5 * math.pi))
        ),
    )


def test_a_leg_with_a_corner() -> None:
    stage = bent_leg(12e-3, 9e-3)
    assert check(stage) == ()
    # Castigliano's theorem for the middle lines, with shear 6/5 V/GA and axial force
    a, b, t, h = 12.25e-3, 9.25e-3, 0.5e-3, 5e-3
    e, nu = ALUMINIUM.youngs_modulus, ALUMINIUM.poissons_ratio
    bending, axial, shear = 12.0 / (e * h * t**3), 1.0 / (e * h * t), 2.4 * (1.0 + nu) / (e * h * t)
    compliance = {
        "x": bending * a**3 / 3.0 + axial * b + shear * a,
        "y": bending * (b**2 * a + b**3 / 3.0) + axial * a + shear * b,
    }
    lumped = lumped_system(stage, plane="stress")
    meshed = superelement_model(stage, plane="stress", cache=False).system
    for probe, expected in compliance.items():
        assert 1.0 / probe_stiffness(lumped, probe) == pytest.approx(expected, rel=1e-6)
        # the corner itself is stiffer than its middle lines
        assert 1.0 / probe_stiffness(meshed, probe) == pytest.approx(expected, rel=1.2e-2)
    first = modes(plane_model(stage, plane="stress").system).frequency_hz[:3]
    np.testing.assert_allclose(modes(meshed).frequency_hz[:3], first, rtol=1e-3)


def test_leaves_meet_in_the_middle_of_a_corner_and_not_in_a_strip() -> None:
    stage = bent_leg(12e-3, 9e-3)
    up, across = stage.hinges
    assert root_reaches(stage, up) == pytest.approx((ROOT_REACH, 0.5))
    assert root_reaches(stage, across) == pytest.approx((0.5, ROOT_REACH))
    # of another thickness, the leaf around the corner has its middle elsewhere
    corner = Loop(((-0.25e-3, 12e-3), (0.25e-3, 12e-3), (0.25e-3, 12.4e-3), (-0.25e-3, 12.4e-3)))
    thin = Leaf(neck_thickness=0.4e-3, leaf_length=9e-3, notch_depth=0.0)
    bodies = (stage.bodies[0], replace(stage.bodies[1], outline=corner), stage.bodies[2])
    thinner = replace(across, at=(4.75e-3, 12.2e-3), profile=thin)
    uneven = replace(stage, bodies=bodies, hinges=(up, thinner))
    assert root_reaches(uneven, up)[1] == pytest.approx(0.4)
    assert root_reaches(uneven, thinner)[0] == pytest.approx(0.625)
    # a small step changes little
    flat = probe_stiffness(lumped_system(stage), "x")
    shallow = tuple(replace(h, profile=replace(h.profile, notch_depth=1e-9)) for h in stage.hinges)
    stepped = lumped_system(replace(stage, hinges=shallow))
    assert probe_stiffness(stepped, "x") == pytest.approx(flat, rel=1e-5)
    # straight on, the body between two leaves is a strip as behind any other hinge
    on = replace(across, at=(0.0, 18.5e-3), direction=0.5 * math.pi, profile=up.profile)
    end = replace(stage.bodies[2], outline=Loop(((-5e-3, 0.0245), (5e-3, 0.0245), (0.0, 0.03))))
    straight = replace(stage, bodies=(*stage.bodies[:2], end), hinges=(up, on))
    assert root_reaches(straight, up) == (ROOT_REACH, ROOT_REACH)


@pytest.mark.parametrize(("method", "error"), [("wedge", 1e-12), ("finite-element", 2e-3)])
def test_a_leaf_that_reaches_into_corners_is_a_longer_beam(method: str, error: float) -> None:
    t, length, nu = 0.5e-3, 9e-3, 0.33
    leaf = Leaf(neck_thickness=t, leaf_length=length, notch_depth=0.0)
    found = compliance(
        leaf,
        1.0,
        nu,
        1.0,
        method=method,
        plane="stress",
        root_widths=(t, t),
        root_reaches=(0.5, 0.7),
    ).matrix
    ends = 0.5 * length + np.array([0.5, 0.7]) * t
    turn, sway = 12.0 * np.sum(ends) / t**3, 4.0 * np.sum(ends**3) / t**3
    assert found[2, 2] == pytest.approx(turn, rel=error)
    assert found[0, 0] == pytest.approx(np.sum(ends) / t, rel=error)
    assert found[1, 1] == pytest.approx(sway + 2.4 * (1.0 + nu) * np.sum(ends) / t, rel=error)


def test_a_leaf_on_wide_bodies_ends_as_they_do() -> None:
    guide = leaf_guide()
    flush = tuple(replace(h, profile=replace(LEAF, notch_depth=0.0)) for h in guide.hinges)
    np.testing.assert_allclose(_hertz(replace(guide, hinges=flush)), _hertz(guide), rtol=1e-3)
    thicker = with_neck_thickness(flush[0].profile, 0.51e-3)
    assert (thicker.depth, thicker.root_height) == (0.0, 0.51e-3)
