"""Pictures of finite-element models: what they are drawn from, and the numbers in them."""

import base64
import re
from dataclasses import replace
from typing import Any

import ngsolve as ng
import numpy as np
import pytest

from flexstage.elasticity.shapes import METRE
from flexstage.fem import MeshSettings, Refinement, StageModel
from flexstage.fem.geometry import MOUNTING
from flexstage.fem.sampling import Sampler
from flexstage.fem.whole_stage import RefinementStep
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Picture, Pictures
from flexstage.report import report_html
from flexstage.report.figures.fields import changes, draw_convergence, draw_fe_modes, out_of_plane
from flexstage.report.figures.hinges import draw_neck_stress, worst_necks
from flexstage.report.figures.style import encode
from flexstage.report.study import study_section
from flexstage.stage.designs import design
from flexstage.studies import ModelRun, Study
from flexstage.system import Analysis
from flexstage.system.stress_map import StressMap
from tests import meshed_stages
from tests.studies import sections_of
from tests.undrawn import without_figures

STAGE = design("parallelogram")


@pytest.fixture(scope="module")
def plane() -> StageModel:
    return meshed_stages.plane(MeshSettings(order=3))


@pytest.fixture(scope="module")
def solid() -> StageModel:
    return meshed_stages.coarse_solid()


@pytest.fixture(scope="module")
def plane_analysis(plane: StageModel) -> Analysis:
    return meshed_stages.analysed(plane)


@pytest.fixture(scope="module")
def solid_analysis(solid: StageModel) -> Analysis:
    return meshed_stages.analysed(solid)


def _size(model: StageModel) -> float:
    mesh = model.problems[0].continuum.mesh
    return float(ng.Integrate(ng.CoefficientFunction(1.0), mesh)) / METRE**mesh.dim


# ------------------------------------------------------------------ sampling


def test_cells_have_the_area_of_the_mesh_and_twice_the_volume_of_its_half(
    plane: StageModel, solid: StageModel
) -> None:
    # a chord of a quarter of an element of 0.8 necks on an arc of 4 necks leaves out 1e-3 of the
    # little that is curved
    assert Sampler(model=plane).area == pytest.approx(_size(plane), rel=1e-4)
    middle, whole = Sampler(model=solid), Sampler(model=solid, divisions=2, extent="whole")
    assert middle.area * STAGE.thickness == pytest.approx(2.0 * _size(solid), rel=1e-3)
    assert whole.area == pytest.approx(2.0 * _size(solid), rel=1e-3)


def test_more_divisions_come_nearer_to_the_curved_area(plane: StageModel) -> None:
    errors = [abs(Sampler(model=plane, divisions=n).area / _size(plane) - 1.0) for n in (2, 4, 8)]
    # the sagitta of a chord falls with the square of its length
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("name", ["plane", "solid"])
def test_the_outline_encloses_the_triangles(name: str, request: pytest.FixtureRequest) -> None:
    sampler = Sampler(model=request.getfixturevalue(name), divisions=3)
    points = sampler.read(np.zeros(sampler.model.system.order), stress=False).points
    enclosed = 0.0
    for loop in sampler.outline:
        x, y = points[loop, 0], points[loop, 1]
        enclosed += 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    # Green's theorem on the same corners, so equal but for rounding; a lost edge would show
    assert enclosed == pytest.approx(sampler.area, rel=1e-9)
    # the outer line, two mounting holes, and the window between the legs
    assert len(sampler.outline) == 4
    assert all(len(set(loop.tolist())) == len(loop) for loop in sampler.outline)


def test_displacement_and_stress_are_those_of_the_continuum(
    plane: StageModel, plane_analysis: Analysis
) -> None:
    q = plane_analysis.axes[0].static.q
    sample = Sampler(model=plane, divisions=3).read(q)
    half = plane.problems[0]
    mesh = half.continuum.mesh
    platform = next(b for b in STAGE.bodies if b.name == "platform")
    corner = max(platform.outline.points, key=lambda p: p[0] + p[1])
    k = int(np.argmin(np.hypot(*(sample.points[:, :2] - corner).T)))
    assert sample.points[k, :2] == pytest.approx(corner, abs=1e-6)
    expected = [half.continuum.point(corner, d) @ (half.basis @ q) for d in ((1, 0), (0, 1))]
    assert sample.displacement[k, :2] == pytest.approx(expected, rel=1e-9)
    assert not sample.displacement[:, 2].any()
    # a corner that one element has inside of it is averaged with nothing
    vertices = np.array([v.point for v in mesh.vertices])
    triangle = [v.nr for v in mesh[ng.ElementId(ng.VOL, 7)].vertices]
    inside = vertices[triangle].mean(axis=0) / METRE
    k = int(np.argmin(np.hypot(*(sample.points[:, :2] - inside).T)))
    x, y = sample.points[k, :2] * METRE
    stress = half.continuum.stress(half.basis @ q)
    six = [stress[i, j](mesh(x, y)) for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
    assert sample.stress is not None
    assert sample.stress[k] == pytest.approx(six, rel=1e-6, abs=1e-9 * np.abs(six).max())


def test_a_held_edge_stays(solid: StageModel, solid_analysis: Analysis) -> None:
    sampler = Sampler(model=solid, divisions=2)
    sample = sampler.read(solid_analysis.axes[0].static.q)
    held = sampler.mesh.MapToAllElements(
        {ng.ET.QUAD: ng.IntegrationRule(points=[(0.0, 0.0, 0.0)], weights=[1.0])},
        sampler.mesh.Boundaries(MOUNTING),
    )
    position = np.asarray(ng.CoefficientFunction((ng.x, ng.y))(held)) / METRE
    for at in position:
        k = int(np.argmin(np.hypot(*(sample.points[:, :2] - at).T)))
        assert sample.magnitude[k] == 0.0
    assert sample.magnitude.max() > 0.9 * solid_analysis.axes[0].output_displacement


def test_the_other_half_of_the_thickness_is_the_mirror_image(
    solid: StageModel, solid_analysis: Analysis
) -> None:
    sampler = Sampler(model=solid, divisions=1, extent="whole")
    found = solid_analysis.modes["removed"]
    lifted = [out_of_plane(solid, found.shapes[:, k]) for k in range(2)]
    assert lifted == [False, True]
    for k, signs in ((0, (1, 1, -1)), (1, (-1, -1, 1))):
        sample = sampler.read(found.shapes[:, k])
        key = np.round(sample.points * 1e8).astype(int)
        below = {tuple(p): i for i, p in enumerate(key.tolist())}
        other = [below[x, y, -z] for x, y, z in key.tolist()]
        moved = sample.displacement
        assert moved[other] == pytest.approx(moved * signs, abs=1e-9 * np.abs(moved).max())
        assert sample.stress is not None
        even, odd = (1.0, -1.0) if k == 0 else (-1.0, 1.0)
        mirror = np.array([even, even, even, odd, odd, even])
        size = np.abs(sample.stress).max()
        assert sample.stress[other] == pytest.approx(sample.stress * mirror, abs=1e-9 * size)
    # a wedge looks outwards with its first face: its volume is reckoned with a sign
    assert sampler.area > 0.0


def test_seams_keep_the_regions_apart(plane: StageModel, plane_analysis: Analysis) -> None:
    q = plane_analysis.axes[0].static.q
    whole, apart = (Sampler(model=plane, divisions=2, seams=s).read(q) for s in (False, True))
    assert whole.cells.shape == apart.cells.shape
    assert len(np.unique(np.round(whole.points * 1e9), axis=0)) == len(whole.points)
    assert len(np.unique(np.round(apart.points * 1e9), axis=0)) == len(whole.points)
    assert len(apart.points) > len(whole.points)
    assert apart.stress is not None
    # in plane stress nothing acts through the thickness, up to the very edge of the region
    sampler = Sampler(model=plane)
    bodies = np.isin(
        apart.region, [i for i, name in enumerate(sampler.regions) if name.startswith("body")]
    )
    assert not apart.stress[np.unique(apart.cells[bodies]), 2].any()
    assert np.abs(apart.stress[:, 2]).max() > 1e6


# ------------------------------------------------------------------ figures


def _words(figure: Any) -> list[str]:
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    return [t for t in titles if t] + [axes.get_ylabel() for axes in figure.axes]


@pytest.mark.parametrize("name", ["plane", "solid"])
def test_the_worst_neck_carries_the_stress_of_the_analysis(
    name: str, request: pytest.FixtureRequest
) -> None:
    model = request.getfixturevalue(name)
    analysis = request.getfixturevalue(f"{name}_analysis")
    (neck,) = worst_necks(analysis, "x")
    assert neck.count == 4
    assert neck.stress == max(analysis.hinge_stress["x"].values())
    q = analysis.axes[0].static.q
    at, stress = Sampler(model=model).neck_peak(q, neck.hinge.name)
    assert stress == pytest.approx(neck.stress, rel=1e-12)
    # bending: on the surface near the neck, half of its thickness from its middle
    distance = np.hypot(*(at[:2] - neck.hinge.at))
    assert distance == pytest.approx(0.5 * neck.hinge.profile.neck_thickness, rel=0.2)
    words = _words(draw_neck_stress(model, analysis, "x"))
    assert "von Mises stress [MPa]" in words
    assert any(f"{number(neck.stress * 1e-6)} MPa at (" in w for w in words)
    assert any(f"{neck.hinge.name} · {neck.number}, 3 more equal" in w for w in words)
    # the picture itself is as high there, but for elements that touch the point alone
    sample = Sampler(model=model).read(q)
    near = np.linalg.norm(sample.points[:, :2] - at[:2], axis=1).argmin()
    assert sample.von_mises[near] == pytest.approx(neck.stress, rel=0.1)


def test_necks_of_another_stress_have_their_own_picture(plane_analysis: Analysis) -> None:
    axis = plane_analysis.axes[0]
    names = [h.name for h in STAGE.hinges]
    values = np.array([[90e6], [101e6], [60e6], [0.3e6]])
    stress = StressMap(hinges=tuple(names), matrix=values, owner=np.arange(4))
    static = replace(axis.static, q=np.ones(1), stress=stress)
    changed = replace(plane_analysis, axes=(replace(axis, static=static),))
    necks = worst_necks(changed, "x")
    # one that bears less than a hundredth of the largest is left out
    assert [n.hinge.name for n in necks] == [names[1], names[0], names[2]]
    assert [n.number for n in necks] == [2, 1, 3]
    assert [n.count for n in necks] == [1, 1, 1]
    assert len(worst_necks(changed, "x", most=2)) == 2
    still = replace(static, q=np.zeros(1))
    assert not worst_necks(replace(changed, axes=(replace(axis, static=still),)), "x")


def test_modes_carry_their_frequency_and_their_kind(
    solid: StageModel, solid_analysis: Analysis
) -> None:
    titles = [t for t in _words(draw_fe_modes(solid, solid_analysis)) if t.startswith("mode")]
    found = solid_analysis.modes["removed"]
    assert len(titles) == 6
    for k, title in enumerate(titles):
        expected = f"mode {k + 1} · {number(float(found.frequency_hz[k]))} Hz · drives removed"
        assert title.startswith(expected)
        # the lower half of the plate moves as the upper one does, out of the plane
        sample = Sampler(model=solid, divisions=1, extent="whole").read(
            found.shapes[:, k], stress=False
        )
        x, _, z = np.abs(sample.displacement).max(axis=0)
        assert title.endswith("· out of plane") == (z > x)


def test_bodies_that_move_alike_have_one_colour(
    plane: StageModel, plane_analysis: Analysis
) -> None:
    svg = encode(draw_fe_modes(plane, plane_analysis, most=1), "svg").decode()
    pictures = re.findall(r'base64,\s*([^"]+)"', svg)
    assert len(pictures) == 1
    from matplotlib import colormaps, image

    png = base64.b64decode(pictures[0])
    assert len(png) < 150_000
    import io

    pixels = image.imread(io.BytesIO(png))
    # the base rests, the platform goes furthest: the two ends of the scale, and hardly more
    assert pixels.shape[2] == 4
    for end in (0.0, 1.0):
        colour = np.array(colormaps["viridis"](end))
        same = np.abs(pixels - colour).max(axis=2) < 0.02
        assert same.mean() > 0.1


def _refinement(model: StageModel, analysis: Analysis) -> Refinement:
    values = [
        {("natural_frequency_hz", "x"): f, ("max_stress", "x"): s, ("gravity_sag", "x"): 1.0}
        for f, s in ((202.0, 80e6), (200.2, 99e6), (200.0, 100e6))
    ]
    steps = tuple(
        RefinementStep(settings=MeshSettings(order=p), unknowns=n, seconds=1.0, values=v)
        for p, n, v in zip((3, 4, 5), (4_000, 9_000, 20_000), values, strict=True)
    )
    return Refinement(
        model=model, analysis=analysis, steps=steps, quantity="natural_frequency_hz", accuracy=2e-3
    )


def test_convergence_draws_the_changes_of_each_mesh(
    plane: StageModel, plane_analysis: Analysis
) -> None:
    found = _refinement(plane, plane_analysis)
    unknowns, difference = changes(found, "natural_frequency_hz", "x")
    assert unknowns.tolist() == [4_000, 9_000]
    assert difference == pytest.approx([0.01, 0.001], rel=1e-9)
    figure = draw_convergence(found)
    assert [t for t in _words(figure) if t][:2] == ["Natural frequency", "Largest stress"]
    for axes, expected in zip(figure.axes, ([0.01, 0.001], [0.2, 0.01]), strict=True):
        line = next(line for line in axes.lines if line.get_label() == "axis x")
        assert np.asarray(line.get_ydata(), dtype=float) == pytest.approx(expected, rel=1e-9)
        asked = [line for line in axes.lines if set(np.ravel(line.get_ydata())) == {2e-3}]
        assert len(asked) == 1
    text = encode(figure, "svg").decode()
    assert "requested: 0.2 %" in text


# ------------------------------------------------------------------ the report


def test_pictures_are_of_the_model_with_a_mesh_that_leaves_the_least_out(
    plane: StageModel,
    plane_analysis: Analysis,
    solid: StageModel,
    solid_analysis: Analysis,
) -> None:
    """Condensed bodies in space have no mesh: what is drawn then is of the plane, and says so."""
    runs = {
        "plane": ModelRun(analysis=plane_analysis, mesh=plane),
        "superelement-3d": ModelRun(analysis=solid_analysis),
        "solid": ModelRun(analysis=solid_analysis, mesh=solid),
    }
    flat = "Lowest modes in the plane, drives removed; model plane,"
    whole = "Lowest modes, drives removed; model solid,"
    for names, modes, stress in (
        (("plane", "superelement-3d"), flat, "holes."),
        (tuple(runs), whole, "holes, middle plane."),
    ):
        chosen = {name: runs[name] for name in names}
        analyses = {name: run.analysis for name, run in chosen.items()}
        study = Study(stage=STAGE, analyses=analyses, variants={}, paths={}, runs=chosen)
        (picture,) = study_section(study, "fem-modes").content
        assert isinstance(picture, Picture)
        assert picture.caption.startswith(modes)
        *_, pictures = study_section(study, "fem-stress").content
        assert isinstance(pictures, Pictures)
        (picture,) = pictures.pictures
        assert picture.caption.endswith(stress)


@pytest.mark.slow
def test_sections_of_meshes_are_there_where_a_mesh_is(
    plane: StageModel, plane_analysis: Analysis
) -> None:
    run = ModelRun(analysis=plane_analysis, mesh=plane)
    study = Study(
        stage=STAGE, analyses={"plane": plane_analysis}, variants={}, paths={}, runs={"plane": run}
    )
    bare = replace(study, runs={"plane": replace(run, mesh=None)})
    of_meshes = ("fem-stress", "fem-modes", "convergence")
    assert not any(study_section(bare, key).content for key in of_meshes)
    shown = [key for key in of_meshes if study_section(study, key).content]
    assert shown == ["fem-stress", "fem-modes"]
    refined = replace(run, refinement=_refinement(plane, plane_analysis))
    fine = replace(study, runs={"plane": refined})
    page = without_figures(report_html, fine)
    assert all(f'id="{key}"' in page for key in of_meshes)
    assert page.index('id="hinges"') < page.index('id="stress"') < page.index('id="fem-stress"')
    unknowns = f"{plane.unknowns:,}".replace(",", "\u00a0")
    assert f"elements of order 3, {unknowns} unknowns" in page
    assert "held at their mounting holes" in page
    # the pictures of these sections alone; those of every report are in tests/system/test_report.py
    page = sections_of(fine, *of_meshes)
    names = re.findall(r'\bid="([^"]+)"', page)
    assert len(names) == len(set(names)), "an id stands twice in the page"
    assert set(re.findall(r'(?:href="|url\()#([^")]+)', page)) <= set(names)
    pictures = re.findall(r"base64,([^\"']+)", page)
    assert len(pictures) > 6
    assert max(map(len, pictures)) < 150_000
    assert "http://" not in page
    assert "https://" not in page
