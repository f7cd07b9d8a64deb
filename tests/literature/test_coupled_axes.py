"""Coupled axes against the kinematics of ideal mechanisms, and areas by other formulas."""

import math
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from flexstage.base.errors import ModelError
from flexstage.hinges import RightCircular
from flexstage.lumped import lumped_system
from flexstage.stage import Stage
from flexstage.system import MechanicalSystem
from flexstage.system.characteristics import decoupled_axis, stress_anywhere
from flexstage.system.coupled_axes import (
    CoupledAxes,
    box_section,
    coupled_axes,
    polygon_area,
    zonogon_outline,
    zonotope_volume,
)
from flexstage.system.mechanical import AxisPort, DrivePort, ProbePort
from tests.parallel_stage import ARM, AWRY, CRANK, EDGE, NOTCH, three_legs


def ideal_legs(angles: tuple[float, ...], stage: Any) -> np.ndarray:
    """Jacobian of the same mechanism with pins for notches, by loops of vectors.

    A push w turns crank k by w / ARM, so that its end moves by -w CRANK / ARM along the link; the
    link keeps its length. The platform's motion (v, omega) about the origin moves the link's
    other end c by v + omega z x c, of which the part along the link is the same.
    """
    rows, right = [], []
    for angle in angles:
        u = np.array([math.cos(angle), math.sin(angle)])
        aside = np.array([-u[1], u[0]])
        c = (EDGE + NOTCH.radius) * u + CRANK * aside
        rows.append([*u, c[0] * u[1] - c[1] * u[0]])
        right.append(-CRANK / ARM)
    motion = np.linalg.solve(np.array(rows), np.diag(right))
    readings = []
    for probe in stage.probes:
        x, y = probe.at
        c, s, turn = probe.row
        readings.append([c, s, s * x - c * y + turn])
    return np.array(readings) @ motion


@pytest.mark.parametrize("angles", [AWRY, tuple(math.radians(a) for a in (-31.0, 95.0, 214.0))])
def test_three_legs_are_their_kinematics_as_necks_get_thin(angles: tuple[float, ...]):
    """A circular notch bends over the length sqrt(t r): its error is of the order of t r / L^2.

    With necks of 0.05 mm 0.8 % are left; extrapolated to none, 0.1 %.
    """
    stage = three_legs(angles)
    want = ideal_legs(angles, stage)
    size = np.abs(want).max(axis=1, keepdims=True)
    found = []
    for neck in (0.1e-3, 0.05e-3):
        thin = RightCircular(radius=NOTCH.radius, neck_thickness=neck)
        hinges = tuple(replace(h, profile=thin) for h in stage.hinges)
        made = replace(stage, hinges=hinges)
        found.append(coupled_axes(made, lumped_system(made, method="euler-bernoulli")).jacobian)
    assert np.abs((found[1] - want) / size).max() < 8e-3
    assert np.abs((2.0 * found[1] - found[0] - want) / size).max() < 1e-3


def plate(
    drives: np.ndarray, probes: np.ndarray, strokes: np.ndarray, *, stiffness: float | None = None
) -> tuple[MechanicalSystem, Stage]:
    """A rigid plate on soft springs: rows of its motion x, y, theta for drives and probes."""
    rng = np.random.default_rng(5)
    soft = rng.normal(size=(3, 3))
    names = [f"d{i}" for i in range(len(drives))]
    system = MechanicalSystem(
        name="plate",
        model="lumped",
        M=np.diag((0.31, 0.31, 7e-5)),
        K=soft @ soft.T + 0.5 * np.eye(3),
        coordinates=("x [m]", "y [m]", "theta [rad]"),
        drives=tuple(
            DrivePort(name=n, vector=v, stiffness=stiffness, stroke=float(s))
            for n, v, s in zip(names, drives, strokes, strict=True)
        ),
        probes=tuple(
            ProbePort(name=f"p{i}", vector=v, unit="rad" if v[2] == 1.0 else "m")
            for i, v in enumerate(probes)
        ),
        axes=tuple(
            AxisPort(name=f"a{i}", drives=tuple(names), probe=f"p{i}") for i in range(len(probes))
        ),
    )
    return system, three_legs()


PROBES = np.array([[1.0, 0.0, -2e-3], [0.0, 1.0, 5e-3], [0.0, 0.0, 1.0]])
DRIVES = np.array(
    [[math.cos(a), math.sin(a), r] for a, r in ((0.2, 21e-3), (2.3, 17e-3), (4.1, 24e-3))]
)
STROKES = np.array([9e-6, 13e-6, 7e-6])


def found_plate(**choices: Any) -> tuple[MechanicalSystem, CoupledAxes]:
    system, stage = plate(DRIVES, PROBES, STROKES, **choices)
    return system, coupled_axes(stage, system, length=19e-3)


def test_a_plate_that_its_drives_hold():
    """Its motion is D w for all w, whatever the springs: J = P D^-1, and W = D P^-1."""
    _, found = found_plate()
    want = PROBES @ np.linalg.inv(DRIVES)
    assert found.jacobian == pytest.approx(want, rel=1e-9)
    assert found.decoupling == pytest.approx(np.linalg.inv(want), rel=1e-9)
    # a drive of no axis holds as well
    system, stage = plate(DRIVES, PROBES, STROKES)
    two = tuple(replace(a, drives=("d0", "d2")) for a in system.axes[:2])
    part = coupled_axes(stage, replace(system, axes=two))
    assert part.jacobian == pytest.approx(want[:2, [0, 2]], rel=1e-9)
    # stacks hold as well as screws: it is their elongation that is given
    assert found_plate(stiffness=3e6)[1].jacobian == pytest.approx(want, rel=1e-9)


def test_forces_hold_nothing():
    """Beside a stack that holds its length, a force pushes the springs: its column is theirs.

    The state under a force f along b with a held is that of K with the Lagrange multiplier of a; it
    goes both ways, so that the stroke is F over the stiffness that b then sees, to either side.
    """
    system, stage = plate(DRIVES, PROBES, STROKES)
    a, b = system.drives[:2]
    push = replace(b, stiffness=0.0, stroke=None, largest_force=0.7)
    axes = tuple(replace(axis, drives=("d0", "d1")) for axis in system.axes[:2])
    found = coupled_axes(stage, replace(system, drives=(a, push), axes=axes))
    saddle = np.block([[system.K, a.vector[:, None]], [a.vector[None], np.zeros((1, 1))]])
    pushed = np.linalg.solve(saddle, np.r_[push.vector, 0.0])[:3]
    seen = push.vector @ pushed
    assert found.jacobian[:, 1] == pytest.approx(PROBES[:2] @ pushed / seen, rel=1e-9)
    assert found.strokes[1] == pytest.approx([-0.7 * seen, 0.7 * seen], rel=1e-9)
    # the stack alone moves its line, and the force gives way to it
    alone = np.linalg.solve(system.K, a.vector)
    want = PROBES[:2] @ alone / (a.vector @ alone)
    assert found.jacobian[:, 0] == pytest.approx(want, rel=1e-9)


def test_conditioning_is_that_of_the_eigenvalues():
    """Singular values by the characteristic polynomial of J J^T, rotations times the length."""
    _, found = found_plate()
    scaled = np.diag((1.0, 1.0, 19e-3)) @ PROBES @ np.linalg.inv(DRIVES)
    G = scaled @ scaled.T
    minors = sum(np.linalg.det(np.delete(np.delete(G, i, 0), i, 1)) for i in range(3))
    squares = np.sort(np.roots([1.0, -np.trace(G), minors, -np.linalg.det(G)]).real)
    assert found.condition_number == pytest.approx(math.sqrt(squares[2] / squares[0]), rel=1e-9)
    assert found.manipulability == pytest.approx(abs(np.linalg.det(scaled)), rel=1e-9)
    isotropy = np.linalg.det(G) ** (1.0 / 3.0) / (np.trace(G) / 3.0)
    assert found.isotropy == pytest.approx(isotropy, rel=1e-9)


def test_an_isotropic_plate():
    """Three drives at 120 degrees about a point have one length that makes all singular values one.

    Then d w / d (x, y) = sqrt(3/2) in every direction, and r sqrt(3) / L of the rotation: isotropic
    where L = r sqrt(2).
    """
    r = 23e-3
    drives = np.array(
        [[math.cos(a), math.sin(a), r] for a in (0.4, 0.4 + math.tau / 3, 0.4 + 2 * math.tau / 3)]
    )
    probes = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    system, stage = plate(drives, probes, STROKES)
    found = coupled_axes(stage, system, length=r * math.sqrt(2.0))
    assert found.singular_values == pytest.approx(math.sqrt(2.0 / 3.0))
    assert found.condition_number == pytest.approx(1.0)
    assert found.isotropy == pytest.approx(1.0)
    longer = coupled_axes(stage, system, length=2.0 * r * math.sqrt(2.0))
    assert longer.condition_number == pytest.approx(2.0)


def test_one_axis_alone_keeps_every_drive_within_its_stroke():
    """The longest chord of the workspace along an axis: the first drive at its end ends it."""
    system, found = found_plate()
    W = np.linalg.inv(PROBES @ np.linalg.inv(DRIVES))
    for i, name in enumerate(found.names):
        state = decoupled_axis(system, found, name)
        want = min(s / abs(w) for s, w in zip(STROKES, W[:, i], strict=True))
        assert state.output_displacement == pytest.approx(want, rel=1e-9)
        others = [state.static.readings[a.probe] for a in found.axes if a.name != name]
        assert np.abs(others).max() < 1e-12 * abs(want)
        sizes = np.abs(list(state.drives.values()))
        assert (sizes <= STROKES * (1.0 + 1e-9)).all()
        # one of them is at the end of its stroke
        assert np.max(sizes / STROKES) == pytest.approx(1.0, rel=1e-9)
        # the forces are those that the springs need: they do the work that is stored
        q = state.static.q
        work = sum(f * state.drives[n] for n, f in state.static.drive_force.items())
        assert work == pytest.approx(q @ system.K @ q, rel=1e-9)


def test_two_drives_side_by_side_move_a_beam_as_far_as_the_shorter_one():
    """A gantry without an axis of rotation: x is the mean of both, and they need not go alike.

    x = (w1 + w2) / 2 and y = w3 are reached alone by w1 = s1, w2 = s2, so that the longest motion
    is the mean of the strokes, where the least sum of squares would leave 2 (s2 - s1) / 2 unused.
    """
    drives = np.array([[1.0, 0.0, 31e-3], [1.0, 0.0, -31e-3], [0.0, 1.0, 0.0]])
    probes = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    system, stage = plate(drives, probes, np.array([9e-6, 14e-6, 11e-6]))
    found = coupled_axes(stage, system)
    assert found.jacobian == pytest.approx(np.array([[0.5, 0.5, 0.0], [0.0, 0.0, 1.0]]), abs=1e-12)
    assert found.decoupling == pytest.approx(np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    x, y = (decoupled_axis(system, found, a).output_displacement for a in found.names)
    assert (x, y) == pytest.approx((11.5e-6, 11e-6))


def test_drives_that_cannot_move_axes_apart_are_refused():
    drives = np.array([[1.0, 0.0, 31e-3], [1.0, 0.0, -31e-3]])
    probes = np.array([[1.0, 0.0, 0.0], [0.3, 0.0, 0.0]])
    system, stage = plate(drives, probes, STROKES[:2])
    found = coupled_axes(stage, system)
    assert not found.independent
    assert found.condition_number == math.inf
    assert found.isotropy == pytest.approx(0.0, abs=1e-8)
    with pytest.raises(ModelError, match="cannot move the axes a0, a1 one by one"):
        _ = found.decoupling


def test_the_workspace_of_three_drives():
    """Corners, section and projection against the convex hull of all ends of all strokes."""
    _, found = found_plate()
    J = PROBES @ np.linalg.inv(DRIVES)
    corners = np.array([J @ w for w in product(*((0.0, s) for s in STROKES))])
    reached = found.workspace
    assert reached is not None
    assert reached.volume == pytest.approx(abs(np.linalg.det(J)) * np.prod(STROKES), rel=1e-9)
    size = np.abs(corners).max(axis=0)
    hull = ConvexHull(corners / size)
    assert reached.volume == pytest.approx(hull.volume * np.prod(size), rel=1e-9)
    flat = ConvexHull(corners[:, :2] * 1e6)
    assert reached.projected_area == pytest.approx(flat.volume * 1e-12, rel=1e-9)
    assert polygon_area(reached.projection) == pytest.approx(reached.projected_area, rel=1e-9)
    assert reached.projection.mean(axis=0) == pytest.approx(J[:2] @ STROKES / 2.0, rel=1e-9)
    # of a box with three sides: the slice at one angle, integrated over the angles, is the volume
    angles = np.linspace(*sorted((corners[:, 2].min(), corners[:, 2].max())), 4001)
    slices = [polygon_area(reached.section(float(a))) for a in angles]
    assert np.trapezoid(slices, angles) == pytest.approx(reached.volume, rel=1e-6)
    assert max(slices) == pytest.approx(reached.area, rel=1e-5)
    # drives that only push: at no rotation there is one point, where none is elongated
    assert len(reached.section(0.0)) <= 2
    assert not reached.section(2.0 * angles[-1]).size


def test_stress_anywhere_is_at_an_end_of_every_stroke():
    stage = three_legs()
    system = lumped_system(stage)
    found = coupled_axes(stage, system)
    worst = stress_anywhere(system, found)
    rng = np.random.default_rng(11)
    tried = [
        system.stress.largest(found.shapes @ (found.strokes[:, 1] * w))
        for w in rng.random((300, 3))
    ]
    for hinge, most in worst.items():
        assert max(t[hinge] for t in tried) <= most
        assert max(t[hinge] for t in tried) > 0.6 * most


segments = st.lists(
    st.tuples(*(st.floats(-9.0, 9.0).map(lambda v: round(v, 3)) for _ in range(3))),
    min_size=3,
    max_size=5,
)


@given(segments, st.floats(-0.45, 0.45))
def test_sums_of_segments_against_hulls(columns: list[tuple[float, ...]], level: float):
    """Volume, outline and sections of any sum of segments, those of the hull of its 2^d corners."""
    g = np.array(columns).T
    corners = np.array([g @ s for s in product((-0.5, 0.5), repeat=g.shape[1])])
    if abs(zonotope_volume(g)) < 1.0 or np.linalg.matrix_rank(g[:2], tol=1e-2) < 2:
        return
    hull = ConvexHull(corners)
    assert zonotope_volume(g) == pytest.approx(hull.volume, rel=1e-9)
    outline = zonogon_outline(g[:2])
    assert outline.mean(axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert polygon_area(outline) == pytest.approx(ConvexHull(corners[:, :2]).volume, rel=1e-9)
    # a point of the section is within all faces of the hull, and its corners are on one of them
    height = level * float(np.abs(g[2]).sum())
    for x, y in box_section(g, height):
        gap = hull.equations[:, :3] @ np.array([x, y, height]) + hull.equations[:, 3]
        assert gap.max() == pytest.approx(0.0, abs=1e-7)
