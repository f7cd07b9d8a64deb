"""Bodies that share their centre, in space: a platform within a frame, by symmetry."""

import ngsolve as ng
import numpy as np
import pytest
from netgen.occ import Box, OCCGeometry

from flexstage.base.errors import ModelError
from flexstage.fem import MeshSettings, mesh, plane_model, solid_model
from flexstage.fem.geometry import stage_faces
from flexstage.stage import Stage, mass_properties, stage_from_text
from flexstage.stage.designs import design
from flexstage.system import analyse
from tests.parallel_stage import EVEN, three_legs

FRAME = """
flexstage: 1
length_unit: mm
name: four arms
thickness: 4 mm
material: Al 7075-T6
bodies:
  frame:
    fixed: true
    outline: [[-40, -40], [40, -40], [40, 40], [-40, 40]]
    holes: [[[-32, -32], [32, -32], [32, 32], [-32, 32]]]
  platform: {outline: [[-9, -9], [9, -9], [9, 9], [-9, 9]]}
  right: {outline: [[13, -3], [28, -3], [28, 3], [13, 3]]}
  upper: {outline: [[3, 13], [3, 28], [-3, 28], [-3, 13]]}
  left: {outline: [[-13, 3], [-28, 3], [-28, -3], [-13, -3]]}
  lower: {outline: [[-3, -13], [-3, -28], [3, -28], [3, -13]]}
drives:
  along x: {kind: force, pushes: platform, reacts: frame, at: [[-9, 6], [-32, 6]],
            direction: 0 deg, largest_force: 10 N}
  along y: {kind: force, pushes: platform, reacts: frame, at: [[6, -9], [6, -32]],
            direction: 90 deg, largest_force: 10 N}
probes:
  x: {body: platform, at: [9, 0], direction: 0 deg}
  y: {body: platform, at: [0, 9], direction: 90 deg}
axes:
  x: {drive: along x, probe: x}
  y: {drive: along y, probe: y}
hinges:
"""
SIDES = {"right": (1, 0), "upper": (0, 1), "left": (-1, 0), "lower": (0, -1)}


def four_arms() -> Stage:
    notch = "profile: {kind: circular, neck_thickness: 1, radius: 2}"
    rows = [
        f"  {name} {end}: {{bodies: [{a or name}, {b or name}], at: [{c * r}, {s * r}], "
        f"direction: {np.degrees(np.arctan2(s, c)):g} deg, {notch}}}"
        for name, (c, s) in SIDES.items()
        for end, a, b, r in (("root", "", "frame", 30), ("head", "platform", "", 11))
    ]
    return stage_from_text(FRAME + "\n".join(rows))


@pytest.mark.slow
def test_a_platform_in_the_middle_of_its_frame_is_meshed_in_space():
    """Every face of the plate finds the one above it: half the plate is filled with prisms."""
    stage = four_arms()
    whole = mass_properties(stage)
    assert whole["frame"].centre == pytest.approx(whole["platform"].centre, abs=1e-9)
    made = mesh.prism_mesh(stage, stage_faces(stage), MeshSettings(order=2, neck_size=2.0))
    mass = sum(body.mass for body in whole.values())
    half = 1e9 * mass / stage.material.density / 2.0
    assert ng.Integrate(1.0, made) == pytest.approx(half, rel=1e-4)


@pytest.mark.slow
def test_a_plate_without_prisms_is_tried_at_other_sizes_and_refused_with_a_way_out(monkeypatch):
    sizes = []

    def tetrahedra(shape, dimension, largest, grading, sizes_at):
        sizes.append(largest)
        return ng.Mesh(OCCGeometry(Box((0, 0, 0), (1, 1, 1))).GenerateMesh(maxh=1))

    monkeypatch.setattr(mesh, "_generate", tetrahedra)
    with pytest.raises(ModelError, match=r"at three sizes .*superelements"):
        solid_model(design("parallelogram"), MeshSettings(order=2))
    assert len(set(sizes)) == 3


def test_a_ring_about_a_post_is_meshed_in_space():
    """The platform of a mechanism of three legs shares its centre with the post in its hole.

    Each solid has its own two level faces, so that every one is filled with prisms: their volume is
    that of half the plate.
    """
    stage = three_legs(EVEN)
    whole = mass_properties(stage)
    centre = whole["post"].centre
    assert whole["platform"].centre == pytest.approx(centre, abs=1e-9)
    made = mesh.prism_mesh(stage, stage_faces(stage), MeshSettings(order=2, neck_size=3.0))
    assert {str(e.type) for e in made.Elements(ng.VOL)} == {"ET.PRISM"}
    half = 1e9 * sum(body.mass for body in whole.values()) / stage.material.density / 2.0
    assert ng.Integrate(1.0, made) == pytest.approx(half, rel=1e-3)
    middle = ng.Integrate(1.0, made, definedon=made.Boundaries(mesh.MIDDLE))
    assert middle == pytest.approx(half / (0.5e3 * stage.thickness), rel=1e-3)


@pytest.mark.slow
def test_a_mechanism_of_three_legs_in_space_and_in_its_plane():
    """The solid model against plane strain at the notches, on one coarse mesh of order 3.

    Plates 12 necks wide are nearly in plane strain: the Jacobian, which is geometry, agrees within
    0.3 %; what is stiffness within 1.5 %, as the ends of the necks are free in space.
    """
    stage, settings = three_legs(EVEN), MeshSettings(order=3, neck_size=1.5)
    plane = analyse(stage, plane_model(stage, settings, modes=4).system)
    solid = analyse(stage, solid_model(stage, settings, modes=(4, 3)).system)
    assert solid.coupling.jacobian == pytest.approx(plane.coupling.jacobian, rel=3e-3)
    for quantity, axis, limit in (
        ("output_displacement", "x", 2e-3),
        ("rotation_stroke", "theta", 3e-3),
        ("natural_frequency_hz", "x", 0.015),
        ("natural_frequency_hz", "theta", 0.015),
        ("rotational_stiffness", "theta", 0.015),
    ):
        a, b = (found.characteristics.value(quantity, axis) for found in (solid, plane))
        assert a == pytest.approx(b, rel=limit)
        assert a < b or quantity in ("output_displacement", "rotation_stroke")
