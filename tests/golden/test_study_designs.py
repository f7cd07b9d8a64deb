"""The two stages of the study equal the reconstruction that was fitted to its published figures.

Golden: the reference files are the frozen result of that fit; the parametric form must give the
same outlines, notches and ports, or every figure that was computed from them would be of another
stage.
"""

import math
from typing import Any

import pytest

from flexstage.hinges import RightCircular
from flexstage.stage import Circle, Loop, Stage
from flexstage.stage.designs import design
from flexstage.stage.mass import mass_properties
from tests.reference_stages import reference_json

# The files are written in millimetres with at most six decimals, so to 1e-9 m; sums of decimals in
# floating point differ by less than 1e-15 m.
TOLERANCE = 1e-9

Corner = tuple[float, float]


@pytest.fixture(scope="module", params=["mechanical", "piezo"])
def pair(request: pytest.FixtureRequest) -> tuple[Stage, dict[str, Any]]:
    """Return a built stage and the file that holds its reconstruction."""
    return design(f"vgtu-{request.param}"), reference_json(request.param)


def metres(values: list[float]) -> tuple[float, ...]:
    return tuple(v * 1e-3 for v in values)


def is_same_polygon(found: tuple[Corner, ...], wanted: list[list[float]]) -> bool:
    """Compare corner by corner, whatever the starting corner and the way round."""
    corners = [metres(c) for c in wanted]
    n = len(corners)
    if len(found) != n:
        return False
    for way in (corners, corners[::-1]):
        for start in range(n):
            turned = way[start:] + way[:start]
            if all(math.dist(a, b) < TOLERANCE for a, b in zip(found, turned, strict=True)):
                return True
    return False


def test_the_comparison_of_polygons_can_fail() -> None:
    square = [[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 2.0]]
    turned = [square[2], square[1], square[0], square[3]]
    crossed = [square[0], square[2], square[1], square[3]]
    loop = tuple((x * 1e-3, y * 1e-3) for x, y in square)
    assert is_same_polygon(loop, turned)
    assert not is_same_polygon(loop, crossed)
    assert not is_same_polygon(loop, [*square[:3], [0.0, 2.00001]])


def test_bodies(pair: tuple[Stage, dict[str, Any]]) -> None:
    stage, wanted = pair
    assert [b.name for b in stage.bodies] == list(wanted["bodies"])
    for body in stage.bodies:
        loops = wanted["bodies"][body.name]["loops"]
        openings = [h for h in body.holes if isinstance(h, Loop)]
        assert len(openings) == len(loops) - 1, body.name
        for found, loop in zip((body.outline, *openings), loops, strict=True):
            assert found.bulges == ()
            assert is_same_polygon(found.points, loop), body.name


def test_circular_holes(pair: tuple[Stage, dict[str, Any]]) -> None:
    stage, wanted = pair
    for body in stage.bodies:
        circles = [*(h for h in body.holes if isinstance(h, Circle)), *body.mounting_holes]
        found = sorted((*c.centre, c.radius) for c in circles)
        expected = sorted(metres(h) for h in wanted["bodies"][body.name]["circular_holes"])
        assert len(found) == len(expected), body.name
        for a, b in zip(found, expected, strict=True):
            assert a == pytest.approx(b, rel=0, abs=TOLERANCE), body.name
    # bolts hold the frame; the hole in the platform is no bolt's
    assert len(stage.body("G").mounting_holes) == 9
    assert [type(h) for h in stage.body("PY").holes] == [Circle]


def test_hinges(pair: tuple[Stage, dict[str, Any]]) -> None:
    stage, wanted = pair
    assert len(stage.hinges) == len(wanted["hinges"]) == 32
    at = {h.bodies: h for h in stage.hinges}
    assert len(at) == 32
    for row in wanted["hinges"]:
        hinge = at[row["a"], row["b"]]
        assert math.dist(hinge.at, metres(row["c"])) < TOLERANCE
        turn = hinge.direction - math.radians(row["angle_deg"])
        assert abs(math.remainder(turn, 2.0 * math.pi)) < 1e-12
        assert isinstance(hinge.profile, RightCircular)
        assert not hinge.profile.one_sided
        assert hinge.profile.neck_thickness == pytest.approx(row["neck"] * 1e-3, abs=TOLERANCE)
        assert hinge.profile.radius == pytest.approx(row["radius"] * 1e-3, abs=TOLERANCE)
        tag = hinge.name.split("-")[0].rstrip("01")
        assert tag == row["tag"]


def test_drives(pair: tuple[Stage, dict[str, Any]]) -> None:
    stage, wanted = pair
    assert len(stage.drives) == len(wanted["ports"])
    for drive, port in zip(stage.drives, wanted["ports"], strict=True):
        assert (drive.pushes, drive.reacts) == (port["pushes"], port["reacts"])
        for found, expected in zip(drive.at, port["at"], strict=True):
            assert math.dist(found, metres(expected)) < TOLERANCE
        heading = (math.cos(drive.direction), math.sin(drive.direction))
        assert heading == pytest.approx(port["direction"], abs=1e-12)
        assert drive.patch_half_width == pytest.approx(port["half_width"] * 1e-3, abs=TOLERANCE)


def test_plate(pair: tuple[Stage, dict[str, Any]]) -> None:
    stage, wanted = pair
    assert [b.name for b in stage.bodies if b.fixed] == [wanted["fixed"]]
    assert stage.thickness == pytest.approx(wanted["thickness"] * 1e-3)
    plate = wanted["material"]
    assert stage.material.name == plate["name"]
    assert stage.material.youngs_modulus == pytest.approx(plate["E_MPa"] * 1e6)
    assert stage.material.poissons_ratio == pytest.approx(plate["nu"])
    assert stage.material.density == pytest.approx(plate["rho_t_mm3"] * 1e12)


def test_probes_read_the_platform_at_its_aperture(pair: tuple[Stage, dict[str, Any]]) -> None:
    stage, wanted = pair
    centre = metres(wanted["bodies"]["PY"]["circular_holes"][0][:2])
    for name, direction in (("x", 0.0), ("y", math.pi / 2.0)):
        axis = stage.axis(name)
        probe = stage.probe(axis.probe)
        assert probe.body == "PY"
        assert probe.relative_to is None
        assert math.dist(probe.at, centre) < TOLERANCE
        assert probe.direction == pytest.approx(direction)
        assert stage.drive(axis.drive).direction == pytest.approx(direction)


def excess(stage: Stage, name: str) -> float:
    """Return the mass [g] by which a body with 16 chords for each quarter circle is too heavy."""
    chords = 0.25 * math.pi - 8.0 * math.sin(math.pi / 32.0)
    body = stage.body(name)
    circles = [*(h for h in body.holes if isinstance(h, Circle)), *body.mounting_holes]
    notches = [h.profile.depth for h in stage.hinges if name in h.bodies]
    quarters = 4.0 * sum(c.radius**2 for c in circles) + 2.0 * sum(r**2 for r in notches)
    return quarters * chords * stage.thickness * stage.material.density * 1e3


# The masses were printed to 1e-4 g, of polygons with 16 chords for each quarter circle.
GRAMS = 1e-4


def test_masses_and_centres(pair: tuple[Stage, dict[str, Any]]) -> None:
    stage, wanted = pair
    for name, found in mass_properties(stage).items():
        row = wanted["bodies"][name]
        grams = found.mass * 1e3 + excess(stage, name)
        assert grams == pytest.approx(row["mass_g"], rel=0, abs=GRAMS), name
        # the chords move the centre of the y platform of the piezo stage by 1.3 um
        centre = [c * 1e3 for c in found.centre]
        assert centre == pytest.approx(row["cg"], rel=0, abs=2e-3), name


#: Masses [g] of the reconstruction, with half notches and bolt holes: they hold the geometry where
#: the reference folder is absent. A few bodies, in whose outlines every dimension has a part.
MASSES = {
    "vgtu-mechanical": {
        "xLu": 8.0685, "xKu": 1.3191, "xG0u": 1.2041, "xin": 3.6121, "yLu": 8.4592, "yKu": 1.5442,
        "yG0u": 1.1883, "yin": 3.2330, "PX": 234.0759, "PY": 75.0087, "G": 409.4349,
    },
    "vgtu-piezo": {
        "xLu": 6.0905, "xKu": 0.4851, "xG0u": 0.9835, "xin": 14.3339, "yLu": 5.4670, "yKu": 0.4514,
        "yG0u": 0.7383, "yin": 12.1590, "PX": 310.8694, "PY": 51.9983, "G": 604.4022,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", MASSES)
def test_masses_without_the_reference_folder(name: str) -> None:
    stage = design(name)
    found = mass_properties(stage)
    for body, grams in MASSES[name].items():
        corrected = found[body].mass * 1e3 + excess(stage, body)
        assert corrected == pytest.approx(grams, rel=0, abs=GRAMS), body
