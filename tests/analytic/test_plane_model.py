"""A meshed stage as a system: exact statics, loads that add up, drives wherever they push."""

import math
from dataclasses import replace

import ngsolve as ng
import numpy as np
import pytest

from flexstage.base.errors import ConvergenceError, StageError
from flexstage.elasticity.shapes import METRE
from flexstage.fem import (
    MeshSettings,
    StageModel,
    plane_model,
    solid_model,
    superelement_model,
)
from flexstage.fem.geometry import patches, stage_faces
from flexstage.fem.stage_system import body_motion, body_path, drive_vector, probe_vector
from flexstage.fem.superelement import with_estimates
from flexstage.fem.whole_stage import refine
from flexstage.hinges import AsDrawn, CornerFilleted, Leaf, Profile
from flexstage.lumped import lumped_system
from flexstage.stage import Body, Circle, ExtraMass, Hinge, Loop, Probe, Stage, check
from flexstage.stage.contour import has_sharp_root
from flexstage.stage.designs import design
from flexstage.system import analyse, load_readings, modes, static_displacements, static_forces
from flexstage.system.characteristics import NO_LIMIT

STAGE = design("parallelogram")
MESH = MeshSettings(order=3, neck_size=1.5)


@pytest.fixture(scope="module")
def model() -> StageModel:
    return plane_model(STAGE, MESH)


def _changed(stage: Stage, body: str, **changes: object) -> Stage:
    bodies = tuple(replace(b, **changes) if b.name == body else b for b in stage.bodies)
    return replace(stage, bodies=bodies)


def test_statics_are_those_of_the_mesh(model: StageModel) -> None:
    half = model.problems[0]
    row = drive_vector(
        half.continuum, STAGE, STAGE.drives[0], patches(STAGE.drives[0], STAGE.bodies)
    )
    whole = half.continuum.solve(row)
    found = static_forces(model.system, {"x": 3.0})
    assert found.drive_displacement["x"] == pytest.approx(3.0 * float(row @ whole), rel=1e-9)
    read = probe_vector(half.continuum, STAGE, STAGE.probes[0])
    assert found.readings["x"] == pytest.approx(3.0 * float(read @ whole), rel=1e-9)
    assert half.basis @ found.q == pytest.approx(3.0 * whole, abs=1e-9 * np.abs(whole).max())
    # the first coordinates are modes: K phi = omega^2 M phi with unit modal mass
    shape = half.basis[:, 0]
    assert shape @ half.continuum.mass_times(shape) == pytest.approx(1.0, rel=1e-6)


@pytest.mark.slow
def test_a_drive_in_place_needs_no_more_modes() -> None:
    stage = design("vgtu-piezo")
    few, many = (
        plane_model(stage, MeshSettings(order=2, neck_size=2.0), modes=n).system for n in (8, 24)
    )
    for condition in ("in place", "locked"):
        a, b = (modes(s, drives=condition, count=4).frequency_hz for s in (few, many))
        # from above, as any projection; locked drives ask most of it
        assert np.all(a >= b * (1.0 - 1e-9))
        assert a == pytest.approx(b, rel=5e-3)


def test_weight_moves_a_stage_as_its_masses_do(model: StageModel) -> None:
    ours = load_readings(model.system)["gravity x"]["x"]
    rigid = load_readings(lumped_system(STAGE))["gravity x"]["x"]
    # the guide is 2 % softer where its bodies are not rigid
    assert ours == pytest.approx(rigid, rel=0.03)
    heavy = _changed(STAGE, "platform", extra_masses=(ExtraMass(mass=0.3, at=(0.0, 0.04)),))
    loaded = plane_model(heavy, MESH)
    more = load_readings(loaded.system)["gravity x"]["x"]
    k = 9.80665 * 0.3 / (more - ours)
    along = analyse(STAGE, model.system).axes[0].input_stiffness
    assert k == pytest.approx(along, rel=0.01)
    f = [modes(m.system, count=1).frequency_hz[0] for m in (model, loaded)]
    rigid_f = [modes(lumped_system(s), count=1).frequency_hz[0] for s in (STAGE, heavy)]
    assert f[1] / f[0] == pytest.approx(rigid_f[1] / rigid_f[0], rel=2e-3)


def test_a_stage_grows_with_its_temperature() -> None:
    low, high = (0.003, 0.036), (0.003, 0.046)
    up = tuple(
        Probe(name=name, body="platform", at=at, direction=math.pi / 2)
        for name, at in (("low", low), ("high", high))
    )
    stage = replace(STAGE, probes=(*STAGE.probes, *up))
    found = load_readings(plane_model(stage, MESH).system)
    alpha = stage.material.thermal_expansion
    assert alpha is not None
    grown = found["temperature"]["high"] - found["temperature"]["low"]
    # nothing strains the platform, so it grows freely
    assert grown == pytest.approx(alpha * (high[1] - low[1]), rel=1e-3)
    # a gradient about the middle of the stage grows it by its local temperature
    local = found["temperature gradient y"]["high"] - found["temperature gradient y"]["low"]
    faces = stage_faces(stage)
    mass = sum(f.mass for f in faces.shape.faces)
    middle = sum(f.mass * f.center.y for f in faces.shape.faces) / mass / METRE
    expected = alpha * ((high[1] - middle) ** 2 - (low[1] - middle) ** 2) / 2.0
    assert local == pytest.approx(expected, rel=0.02)


def test_a_drive_that_pushes_where_no_edge_is(model: StageModel) -> None:
    drive = STAGE.drives[0]
    inside = (drive.at[0][0] + 4e-3, drive.at[0][1] + 0.7e-3)
    moved = replace(STAGE, drives=(replace(drive, at=(inside, drive.at[1])),))
    found = analyse(moved, plane_model(moved, MESH).system).axes[0]
    edge = analyse(STAGE, model.system).axes[0]
    assert found.output_displacement == pytest.approx(edge.output_displacement, rel=2e-3)
    assert found.input_stiffness == pytest.approx(edge.input_stiffness, rel=5e-3)
    nowhere = replace(STAGE, drives=(replace(drive, at=((0.0, 0.02), drive.at[1])),))
    with pytest.raises(ValueError, match="has no material"):
        plane_model(nowhere, MESH)


def test_turning_both_bodies_stretches_no_drive(model: StageModel) -> None:
    """Also where the reacting patch lies beside the line of action."""
    continuum = model.problems[0].continuum
    drive = STAGE.drives[0]
    beside = replace(drive, at=(drive.at[0], (drive.at[1][0], drive.at[1][1] - 3e-3)))
    stage = replace(STAGE, drives=(beside,))
    faces = stage_faces(stage)
    other = plane_model(stage, MESH).problems[0].continuum
    turn = ng.GridFunction(other.space)
    turn.Set(ng.CoefficientFunction((-ng.y / METRE, ng.x / METRE)))
    row = drive_vector(other, stage, beside, faces.patches, "elastic")
    assert abs(float(row @ turn.vec.FV().NumPy())) < 1e-9
    shift = ng.GridFunction(other.space)
    shift.Set(ng.CoefficientFunction((0.4, -1.3)))
    assert abs(float(row @ shift.vec.FV().NumPy())) < 1e-9
    assert continuum.size > 0


def test_a_probe_over_an_aperture_rides_on_its_body() -> None:
    centre = (0.004, 0.0405)
    holed = _changed(STAGE, "platform", holes=(Circle(centre, 2.5e-3),))
    probe = Probe(name="x", body="platform", at=centre, direction=0.3)
    stage = replace(holed, probes=(probe,))
    found = plane_model(stage, MESH)
    state = static_displacements(found.system, {"x": 1e-4})
    x, y, turn = state.body_motion["platform"]
    body = next(b for b in found.system.bodies if b.name == "platform")
    dx, dy = centre[0] - body.centre[0], centre[1] - body.centre[1]
    by_hand = math.cos(0.3) * (x - turn * dy) + math.sin(0.3) * (y + turn * dx)
    assert state.readings["x"] == pytest.approx(by_hand, rel=1e-9)
    # a rigid platform: beside the hole a point reads the same
    beside = replace(probe, at=(centre[0] + 4e-3, centre[1]), direction=0.0)
    near = plane_model(replace(holed, probes=(beside,)), MESH)
    reading = static_displacements(near.system, {"x": 1e-4}).readings["x"]
    assert reading == pytest.approx(x - turn * dy, rel=1e-3)


def test_bodies_move_as_their_mean(model: StageModel) -> None:
    half = model.problems[0]
    field = ng.GridFunction(half.continuum.space)
    field.Set(ng.CoefficientFunction((0.2 - 0.7 * ng.y / METRE, -0.1 + 0.7 * ng.x / METRE)))
    at = (0.011, -0.003)
    motion = body_motion(half.continuum, STAGE, "right-leg", at)
    found = motion @ field.vec.FV().NumPy()
    assert found == pytest.approx([0.2 - 0.7 * at[1], -0.1 + 0.7 * at[0], 0.7], rel=1e-9)


def test_two_drives_on_one_edge_are_refused() -> None:
    drive = STAGE.drives[0]
    with pytest.raises(StageError, match="act on the same stretch of edge of body"):
        plane_model(replace(STAGE, drives=(drive, replace(drive, name="again"))), MESH)


@pytest.mark.slow
def test_in_space_a_stage_lies_between_plane_stress_and_plane_strain() -> None:
    mesh = MeshSettings(order=3, neck_size=1.5)
    space = solid_model(STAGE, mesh, modes=(3, 3))
    stress, strain = (plane_model(STAGE, mesh, plane=p) for p in ("stress", "strain"))
    f, low, high = (modes(m.system, count=1).frequency_hz[0] for m in (space, stress, strain))
    assert low < f < high * 1.001
    # half of the plate stands for the whole: masses and stiffness are those of the whole
    pushed = [static_forces(m.system, {"x": 1.0}).readings["x"] for m in (space, strain)]
    assert pushed[0] == pytest.approx(pushed[1], rel=0.02)
    drop = load_readings(space.system)
    named = [[load.name for load in m.system.loads] for m in (strain, space)]
    temperature = ["temperature", "temperature gradient x", "temperature gradient y"]
    assert named[0] == ["gravity x", "gravity y", *temperature]
    assert named[1] == [*named[0], "gravity z", "temperature gradient z"]
    assert drop["gravity x"]["platform out of plane"] == 0.0
    weight = [load_readings(m.system)["gravity x"]["x"] for m in (space, strain)]
    assert weight[0] == pytest.approx(weight[1], rel=0.02)
    # down, against the stiffness out of the plane: between half of the weight and all of it
    row = {r.quantity: r.value for r in analyse(STAGE, space.system).characteristics}
    mass = sum(p.mass for p in _masses().values())
    sag = drop["gravity z"]["platform out of plane"] * row["out_of_plane_stiffness"]
    assert 0.5 * mass * 9.80665 < sag < mass * 9.80665


def _masses() -> dict:
    from flexstage.stage import mass_properties

    return {n: p for n, p in mass_properties(STAGE).items() if n != "base"}


def test_a_leaf_does_not_turn_the_body_that_it_grows_from() -> None:
    """Half a leaf hangs on each body and bends; counted in, it would turn the platform 16-fold."""
    stage = design("double-parallelogram")
    rigid, found = (
        analyse(stage, system).axes[0].static.body_motion
        for system in (lumped_system(stage), superelement_model(stage, MESH, cache=False).system)
    )
    # platform and base give way under the moments of the leaves, which is 5 of 24 urad
    assert found["platform"][2] == pytest.approx(rigid["platform"][2], rel=0.3)
    assert abs(found["base"][2]) < 0.1 * rigid["platform"][2]
    whole = analyse(stage, plane_model(stage, MESH).system).axes[0].static.body_motion
    assert whole["platform"] == pytest.approx(found["platform"], rel=1e-3, abs=1e-8)


def test_a_body_that_turns_far_is_read_where_it_is(model: StageModel) -> None:
    continuum = model.problems[0].continuum
    angle, shift, at = 0.31, (1.7e-3, -0.9e-3), (0.013, 0.052)
    c, s = math.cos(angle), math.sin(angle)
    x, y = ng.x / METRE, ng.y / METRE
    field = ng.GridFunction(continuum.space)
    field.Set(
        ng.CoefficientFunction((shift[0] + (c - 1.0) * x - s * y, shift[1] + s * x + (c - 1.0) * y))
    )
    u = np.asarray(field.vec.FV().NumPy())[None]
    expected = (
        shift[0] + (c - 1.0) * at[0] - s * at[1],
        shift[1] + s * at[0] + (c - 1.0) * at[1],
        angle,
    )
    found = body_path(continuum, STAGE, "platform", at, u)
    # the space gives nothing where the base is held, and the platform is not
    assert found[0] == pytest.approx(expected, rel=1e-9)
    small = body_motion(continuum, STAGE, "platform", at) @ u[0]
    assert small != pytest.approx(expected, rel=1e-2)


def test_a_frame_without_holes_holds_no_leaf() -> None:
    """Leaves on a frame that is held at its edges bend over all of their length.

    Held besides at the line where the region of a notch ends, 0.8 of the way to the root, they were
    11 % higher in frequency. Against the frame on its bolts, which gives way by 0.014 %.
    """
    stage = design("double-parallelogram")
    assert min(h.profile.length for h in stage.hinges) > 10.0 * max(
        h.profile.root_height for h in stage.hinges
    )
    edges = replace(stage, bodies=tuple(replace(b, mounting_holes=()) for b in stage.bodies))
    bolts, held = (
        modes(plane_model(s, MESH, modes=2).system).frequency_hz[:2] for s in (stage, edges)
    )
    np.testing.assert_allclose(held, bolts, rtol=3e-4)


# ------------------------------------------------------------------------- sharp roots

_SHARP = Leaf(neck_thickness=0.5e-3, leaf_length=4e-3, notch_depth=2e-3)
_QUARTER = math.tan(math.pi / 8.0)
_ROUND = CornerFilleted(neck_thickness=0.5e-3, notch_length=4e-3, fillet_radius=0.5e-3)


def _of(profile: Profile) -> Stage:
    return replace(STAGE, hinges=tuple(replace(h, profile=profile) for h in STAGE.hinges))


@pytest.mark.parametrize(("profile", "grows"), [(_SHARP, True), (_ROUND, False)])
def test_stress_at_a_sharp_root_is_not_presented_as_converged(
    profile: Profile, grows: bool
) -> None:
    """M. L. Williams, J. Appl. Mech. 19 (1952) 526: the stress at a corner has no bound."""
    values = []
    for size in (1.0, 0.25):
        model = plane_model(_of(profile), MeshSettings(order=2, neck_size=size))
        result = analyse(model.stage, model.system)
        (row,) = result.characteristics.select("max_stress", "x")
        values.append(row.value)
        assert (NO_LIMIT in row.note) is grows
        assert row.uncertainty is None or not grows
        assert any("sharp root of" in line for line in result.validity) is grows
    assert (values[1] > 1.3 * values[0]) is grows


def test_no_mesh_converges_to_the_stress_at_a_sharp_root() -> None:
    def build(settings: MeshSettings) -> StageModel:
        return plane_model(_of(_SHARP), settings)

    meshes = [MeshSettings(order=2, neck_size=size) for size in (1.5, 1.0)]
    with pytest.raises(ConvergenceError, match="without a limit at a sharp root"):
        refine(build, meshes, accuracy=0.9, quantity="max_stress")
    # what was the change of the stress from mesh to mesh is no uncertainty
    found = refine(build, meshes, accuracy=0.9).analysis.characteristics
    (stress,) = found.select("max_stress", "x")
    (frequency,) = found.select("natural_frequency_hz", "x")
    assert stress.uncertainty is None
    assert frequency.uncertainty is not None


@pytest.mark.slow
def test_condensed_bodies_give_no_uncertainty_of_the_stress_at_a_sharp_root() -> None:
    for profile, sharp in ((_SHARP, True), (_ROUND, False)):
        model = superelement_model(_of(profile), MeshSettings(order=2), cache=False)
        found = with_estimates(analyse(model.stage, model.system), model, cache=False)
        (row,) = found.characteristics.select("max_stress", "x")
        assert (row.uncertainty is None) is sharp


def test_which_roots_are_sharp() -> None:
    flush = replace(_SHARP, notch_depth=0.0)
    stepped = AsDrawn(neck_thickness=0.5e-3, distances=(2e-3, 2e-3), depths=(0.0, 2e-3))
    deep = AsDrawn(neck_thickness=0.5e-3, distances=(2e-3, 2e-3), depths=(1e-3, 2e-3))
    for profile, sharp in (
        *((p, True) for p in (_SHARP, flush, stepped)),
        *((p, False) for p in (_ROUND, deep, STAGE.hinges[0].profile)),
    ):
        stage = _of(profile)
        assert {has_sharp_root(stage, h) for h in stage.hinges} == {sharp}, profile


@pytest.mark.parametrize("rounded", [False, True])
def test_fillets_of_a_body_round_the_root_of_a_leaf_without_steps(rounded: bool) -> None:
    half, r, wide = 0.25e-3, 1e-3, 5e-3
    below = ((wide, -wide), (-wide, -wide))
    if rounded:
        points = ((half, 0.0), (half + r, -r), (wide, -r), *below, (-wide, -r), (-half - r, -r))
        outline = Loop((*points, (-half, 0.0)), (_QUARTER, *[0.0] * 5, _QUARTER, 0.0))
    else:
        outline = Loop(((wide, 0.0), *below, (-wide, 0.0)))
    end = outline.mapped(lambda p: (-p[0], 10e-3 - p[1]))
    leaf = Hinge(
        name="leaf",
        bodies=("base", "end"),
        at=(0.0, 5e-3),
        direction=0.5 * math.pi,
        profile=Leaf(neck_thickness=2.0 * half, leaf_length=10e-3, notch_depth=0.0),
    )
    stage = Stage(
        name="leaf",
        thickness=5e-3,
        material=STAGE.material,
        bodies=(Body(name="base", outline=outline, fixed=True), Body(name="end", outline=end)),
        hinges=(leaf,),
    )
    assert not [i for i in check(stage) if i.severity == "error"]
    assert has_sharp_root(stage, leaf) is not rounded


def test_strips_that_meet_in_a_corner_have_sharp_roots() -> None:
    """A leg with a corner, whose inner side is sharp where the leaves meet."""
    t = 0.5e-3

    def leaf(name: str, bodies: tuple[str, str], at: tuple[float, float], turn: float) -> Hinge:
        profile = Leaf(neck_thickness=t, leaf_length=5e-3, notch_depth=0.0)
        return Hinge(name=name, bodies=bodies, at=at, direction=turn, profile=profile)

    def square(x: float, y: float) -> Loop:
        return Loop(((x, y), (x + t, y), (x + t, y + t), (x, y + t)))

    stage = Stage(
        name="leg",
        thickness=5e-3,
        material=STAGE.material,
        bodies=(
            Body(name="foot", outline=square(0.0, -5.5e-3), fixed=True),
            Body(name="corner", outline=square(0.0, 0.0)),
            Body(name="tip", outline=square(5.5e-3, 0.0)),
        ),
        hinges=(
            leaf("up", ("foot", "corner"), (0.5 * t, -2.5e-3), 0.5 * math.pi),
            leaf("across", ("corner", "tip"), (3e-3, 0.5 * t), 0.0),
        ),
    )
    assert [has_sharp_root(stage, h) for h in stage.hinges] == [True, True]
    # without the leaf around the corner, nothing turns outward
    assert not has_sharp_root(replace(stage, hinges=stage.hinges[:1]), stage.hinges[0])
