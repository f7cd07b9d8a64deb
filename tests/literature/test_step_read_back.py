"""STEP files of stages: read back by Gmsh, which did not write them, and by the text alone.

Evidence (Exported files): STEP in gmsh (areas and masses): $10^{-9}$; necks 1 nm
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from flexstage.base.errors import StageError
from flexstage.export.step import step_files
from flexstage.hinges import Elliptical, Leaf, Profile, RightCircular
from flexstage.quantities.material import material
from flexstage.stage import Body, Circle, Hinge, Loop, Stage, mass_properties
from flexstage.stage.contour import body_contour
from tests.drawing_stages import PLATES, quick
from tests.peers.gmsh_grid import started

NANOMETRE = 1e-6  # in millimetres, the unit of the files


def beam(profile: Profile, *, angle: float = 0.0, name: str = "beam") -> Stage:
    """Two blocks and one hinge between them, turned, off the origin; a hole in one block."""
    half, height = 0.5 * profile.length, profile.root_height + 0.3e-3
    c, s = math.cos(angle), math.sin(angle)

    def at(x: float, y: float) -> tuple[float, float]:
        return 3e-3 + c * x - s * y, -7e-3 + s * x + c * y

    def block(x0: float, x1: float) -> Loop:
        return Loop(
            tuple(at(x, y) for x, y in ((x0, -height), (x1, -height), (x1, height), (x0, height)))
        )

    return Stage(
        name=name,
        thickness=6.2e-3,
        material=material("Al 7075-T6"),
        bodies=(
            Body(name="base", outline=block(-half - 11e-3, -half), fixed=True),
            Body(
                name="arm",
                outline=block(half, half + 13e-3),
                holes=(Circle(at(half + 6e-3, 0.1e-3), 0.7e-3),),
            ),
        ),
        hinges=(
            Hinge(
                name="neck a", bodies=("base", "arm"), at=at(0.0, 0.0), direction=angle,
                profile=profile,
            ),
        ),
    )  # fmt: skip


BENT = beam(RightCircular(radius=1.7e-3, neck_thickness=0.41e-3), angle=0.6)
FLAT = beam(
    Leaf(leaf_length=5.3e-3, neck_thickness=0.29e-3, notch_depth=1.1e-3), angle=-0.35, name="leaf"
)
STAGES = [*PLATES.values(), BENT, FLAT]
ALL = pytest.mark.parametrize("stage", [quick(s.name, s) for s in STAGES])


# ------------------------------------------------------- the text, by the words of the format


@dataclass(frozen=True, eq=False)
class Surface:
    """A face of the file: a point of its surface, its axis or normal, its radius if a cylinder."""

    name: str
    point: np.ndarray
    direction: np.ndarray
    radius: float | None

    def from_line(self, x: float, y: float) -> float:
        """Distance of a line along z from the plane, or from the axis of the cylinder."""
        away = np.array([x, y, 0.0]) - self.point
        if self.radius is None:
            return abs(float(away @ self.direction))
        return float(np.linalg.norm(away - (away @ self.direction) * self.direction))


class StepText:
    """Entities of a STEP file by their numbers."""

    def __init__(self, content: bytes) -> None:
        # a line may be broken between any two words
        text = re.sub(r"\n *", "", content.decode("ascii"))
        self.header, data = text.split("DATA;")
        pattern = r"#(\d+) = (\w*)\s*\(((?:[^';]|'(?:[^']|'')*')*)\);"
        self.entities = {int(n): (kind, body) for n, kind, body in re.findall(pattern, data)}

    def kind(self, name: str) -> list[tuple[int, str]]:
        return [(n, body) for n, (kind, body) in self.entities.items() if kind == name]

    def numbers(self, entity: int) -> np.ndarray:
        words = re.findall(r"-?[\d.]+(?:E[+-]?\d+)?", self.entities[entity][1].split("',", 1)[1])
        return np.array([float(word) for word in words])

    def surfaces(self) -> list[Surface]:
        found = []
        for _, body in self.kind("ADVANCED_FACE"):
            match = re.fullmatch(r"'((?:[^']|'')*)',\(.*\),#(\d+),\.[TF]\.", body)
            assert match is not None
            kind, placed = self.entities[int(match[2])]
            assert kind in ("PLANE", "CYLINDRICAL_SURFACE")
            words = placed.split(",")
            axes = self.entities[int(words[1][1:])][1].split(",")
            radius = float(words[2]) if kind == "CYLINDRICAL_SURFACE" else None
            point, direction = (self.numbers(int(w[1:])) for w in axes[1:3])
            found.append(Surface(match[1], point, direction, radius))
        return found


@pytest.fixture(scope="module")
def gmsh() -> Iterator[ModuleType]:
    found = started()
    found.option.setNumber("General.Terminal", 0)
    yield found
    found.finalize()


class _Written(dict[str, bytes]):
    """Files by name, each written when it is first asked for."""

    def __missing__(self, name: str) -> bytes:
        (stage,) = (s for s in STAGES if f"{s.name}.step" == name)
        self |= step_files(stage)
        return self[name]


@pytest.fixture(scope="module")
def written() -> dict[str, bytes]:
    return _Written()


@ALL
def test_every_neck_is_as_thick_as_described(stage: Stage, written: dict[str, bytes]) -> None:
    surfaces = StepText(written[f"{stage.name}.step"]).surfaces()
    for hinge in stage.hinges:
        sides = [s for s in surfaces if s.name.startswith(f"{hinge.name} neck ")]
        assert len(sides) == 2
        x, y = (1e3 * c for c in hinge.at)
        radii = [s.radius for s in sides if s.radius is not None]
        if isinstance(hinge.profile, RightCircular):
            # of two cylinders the gap is the distance of the axes less both radii
            assert radii == pytest.approx(2 * [1e3 * hinge.profile.radius], abs=NANOMETRE)
            gap = float(np.linalg.norm((sides[0].point - sides[1].point)[:2])) - sum(radii)
            for side, radius in zip(sides, radii, strict=True):
                assert abs(side.direction[2]) == pytest.approx(1.0, abs=1e-12)
                assert side.from_line(x, y) - radius == pytest.approx(gap / 2, abs=NANOMETRE)
        else:
            assert not radii
            gap = sum(s.from_line(x, y) for s in sides)
            # directions have 12 digits; over the length of the leaf the gap changes by 1e-11 of it
            aside = np.cross(sides[0].direction, sides[1].direction)
            assert np.linalg.norm(aside) < 1e-11
        assert gap == pytest.approx(1e3 * hinge.profile.neck_thickness, abs=NANOMETRE)


@ALL
def test_file_is_one_solid_of_planes_and_cylinders_in_millimetres(
    stage: Stage, written: dict[str, bytes]
) -> None:
    text = StepText(written[f"{stage.name}.step"])
    assert len(text.kind("MANIFOLD_SOLID_BREP")) == 1
    assert len(text.kind("CLOSED_SHELL")) == 1
    surfaces = text.surfaces()
    holes = [
        h for b in stage.bodies for h in (*b.holes, *b.mounting_holes) if isinstance(h, Circle)
    ]
    for hole in holes:
        fitting = [
            s for s in surfaces
            if s.radius is not None
            and s.from_line(*(1e3 * c for c in hole.centre)) < NANOMETRE
            and abs(s.radius - 1e3 * hole.radius) < NANOMETRE
        ]  # fmt: skip
        assert len(fitting) == 1  # one face, and no seam between two halves
    flat = [s for s in surfaces if s.radius is None and abs(s.direction[2]) > 0.5]
    half = 0.5e3 * stage.thickness
    assert sorted(s.point[2] for s in flat) == pytest.approx([-half, half], abs=NANOMETRE)
    data = written[f"{stage.name}.step"].decode().split("DATA;")[1]
    assert "LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.)" in data
    assert "SI_UNIT($,.RADIAN.)" in data
    assert data.count("LENGTH_UNIT()") == 1
    assert f"PRODUCT('{stage.name}'" in data
    assert "flexstage" in text.header


def test_two_faces_of_one_plane_or_cylinder_never_meet(written: dict[str, bytes]) -> None:
    """Seams between bodies and notches are gone: faces that share an edge differ in surface."""
    text = StepText(written["vgtu-piezo.step"])
    edges: dict[str, list[Surface]] = {}
    for (_, body), surface in zip(text.kind("ADVANCED_FACE"), text.surfaces(), strict=True):
        for bound in re.findall(r"#(\d+)", body.split("(")[1].split(")")[0]):
            loop = text.entities[int(text.entities[int(bound)][1].split("#")[1].split(",")[0])][1]
            for oriented in re.findall(r"#(\d+)", loop):
                edge = text.entities[int(oriented)][1].split("#")[1].split(",")[0]
                edges.setdefault(edge, []).append(surface)
    assert all(len(pair) == 2 for pair in edges.values())  # closed: an edge belongs to two faces
    # a whole hole is one face, which meets itself where its cylinder closes
    pairs = [(a, b) for a, b in edges.values() if a is not b]
    assert len(edges) - len(pairs) == 10
    for a, b in pairs:
        alike = (
            (a.radius is None) == (b.radius is None)
            and abs(abs(a.direction @ b.direction) - 1.0) < 1e-9
            and (
                abs((a.point - b.point) @ a.direction) < NANOMETRE
                if a.radius is None or b.radius is None
                else abs(a.radius - b.radius) < NANOMETRE
                and b.from_line(a.point[0], a.point[1]) < NANOMETRE
            )
        )
        assert not alike


def test_other_profiles_enclose_the_area_of_their_contours(
    gmsh: ModuleType, tmp_path: Path
) -> None:
    """An ellipse is the chain of arcs that the models take; a notch may be one-sided."""
    ellipse = Elliptical(half_length=2.3e-3, notch_depth=0.9e-3, neck_thickness=0.37e-3)
    for stage in (beam(ellipse, angle=1.1), beam(replace(ellipse, one_sided=True), angle=0.2)):
        path = tmp_path / "plate.step"
        path.write_bytes(step_files(stage)["beam.step"])
        area = sum(body_contour(stage, b)[0].integrals().area for b in stage.bodies)
        area -= math.pi * 0.7e-3**2
        gmsh.clear()
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        gmsh.model.occ.importShapes(str(path))
        ((_, tag),) = gmsh.model.occ.getEntities(3)
        # arcs that nearly agree must not be taken for one: that would move 1e-7 of it and more
        assert gmsh.model.occ.getMass(3, tag) == pytest.approx(area * stage.thickness, rel=1e-9)
        # the two arcs that meet at a neck are of one circle, and one face
        arcs = 2 * ellipse.sides * (len(ellipse.contour()) - 1) - ellipse.sides
        # and of each block three edges and two beside the root; a side that is not cut is one more
        one_sided = stage.hinges[0].profile.one_sided
        around = arcs // 2 + 11 if one_sided else arcs + 10
        assert len(StepText(path.read_bytes()).surfaces()) == around + 3  # hole, below, above


def test_body_that_hangs_on_nothing_is_a_solid_of_its_own(gmsh: ModuleType, tmp_path: Path) -> None:
    base, arm = BENT.bodies
    block = Loop(((0.05, 0.01), (0.0613, 0.01), (0.0613, 0.0172), (0.05, 0.0172)))
    cases = {
        3: replace(BENT, bodies=(base, arm, Body(name="anvil", outline=block, fixed=True))),
        1: replace(BENT, bodies=(arm,), hinges=()),
    }
    for stage in cases.values():
        path = tmp_path / "plate.step"
        path.write_bytes(step_files(stage)["beam.step"])
        gmsh.clear()
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        gmsh.model.occ.importShapes(str(path))
        found = [gmsh.model.occ.getMass(*solid) for solid in gmsh.model.occ.getEntities(3)]
        assert len(found) == (2 if len(stage.bodies) == 3 else 1)
        mass = sum(m.mass for m in mass_properties(stage).values())
        assert sum(found) == pytest.approx(mass / stage.material.density, rel=1e-9)


def test_same_stage_gives_the_same_bytes() -> None:
    assert step_files(BENT) == step_files(BENT)


def test_names_that_step_writes_otherwise_stay_readable() -> None:
    odd = replace(BENT, name="bäm 'x' \\ 1", title="Größe µ")
    ((name, content),) = step_files(odd).items()
    assert name == "bäm--x----1.step"
    text = content.decode("ascii")
    assert r"PRODUCT('b\X2\00E4\X0\m ''x'' \\ 1'" in text
    assert r"'Gr\X2\00F600DF\X0\e \X2\00B5\X0\'" in text
    assert StepText(content).kind("MANIFOLD_SOLID_BREP")


def test_overlap_and_pieces_are_refused() -> None:
    base, arm = BENT.bodies
    over = replace(arm, name="third")
    with pytest.raises(StageError, match=r"overlap.*flexstage check"):
        step_files(replace(BENT, bodies=(base, arm, over)))
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = arm.outline.points
    slit = Loop(
        (
            (0.4 * x0 + 0.6 * x1 + (x1 - x2) * 0.1, 0.4 * y0 + 0.6 * y1 + (y1 - y2) * 0.1),
            (0.3 * x0 + 0.7 * x1 + (x1 - x2) * 0.1, 0.3 * y0 + 0.7 * y1 + (y1 - y2) * 0.1),
            (0.3 * x3 + 0.7 * x2 - (x1 - x2) * 0.1, 0.3 * y3 + 0.7 * y2 - (y1 - y2) * 0.1),
            (0.4 * x3 + 0.6 * x2 - (x1 - x2) * 0.1, 0.4 * y3 + 0.6 * y2 - (y1 - y2) * 0.1),
        )
    )
    with pytest.raises(StageError, match="body 'arm' is in 2 pieces"):
        step_files(replace(BENT, bodies=(base, replace(arm, holes=(slit,)))))


# ------------------------------------------------------------------ another reader


@ALL
def test_gmsh_finds_the_volume_and_the_centre_of_the_description(
    stage: Stage, written: dict[str, bytes], gmsh: ModuleType, tmp_path: Path
) -> None:
    path = tmp_path / "plate.step"
    path.write_bytes(written[f"{stage.name}.step"])
    gmsh.clear()
    gmsh.option.setString("Geometry.OCCTargetUnit", "M")
    gmsh.model.occ.importShapes(str(path))
    gmsh.model.occ.synchronize()
    ((dimension, tag),) = gmsh.model.getEntities(3)
    bare = replace(stage, bodies=tuple(replace(b, extra_masses=()) for b in stage.bodies))
    bodies = mass_properties(bare).values()
    mass = sum(b.mass for b in bodies)
    volume = gmsh.model.occ.getMass(dimension, tag)
    # its integrals over faces of arcs are to 1e-10; a notch 1 nm too wide would be 1e-8 at least
    assert volume == pytest.approx(mass / stage.material.density, rel=1e-9)
    centre = [sum(b.mass * b.centre[i] for b in bodies) / mass for i in (0, 1)]
    assert gmsh.model.occ.getCenterOfMass(dimension, tag) == pytest.approx(
        (*centre, 0.0), abs=1e-10
    )
    # the two sides are as large as the outlines say
    areas = [
        gmsh.model.occ.getMass(2, face)
        for _, face in gmsh.model.getEntities(2)
        if gmsh.model.getType(2, face) == "Plane"
        and abs(gmsh.model.getNormal(face, [0.1, 0.1])[2]) > 0.5
    ]
    assert areas == pytest.approx(2 * [volume / stage.thickness], rel=1e-9)
    outlines = np.concatenate([b.outline.polyline() for b in stage.bodies])
    low, high = outlines.min(axis=0), outlines.max(axis=0)
    box = np.array(gmsh.model.occ.getBoundingBox(dimension, tag)).reshape(2, 3)
    half = 0.5 * stage.thickness
    # Gmsh widens its boxes by the tolerance of the shape, 1e-7 mm, and a little more
    assert box == pytest.approx(np.array([[*low, -half], [*high, half]]), abs=2e-7)
