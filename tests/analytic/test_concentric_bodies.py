"""Bodies that share their centre, in space: a platform within a frame, by symmetry."""

import ngsolve as ng
import numpy as np
import pytest
from netgen.occ import Box, OCCGeometry

from flexstage.designs import design
from flexstage.errors import ModelError
from flexstage.fem import MeshSettings, mesh, solid_model
from flexstage.fem.geometry import stage_faces
from flexstage.stage import Stage, mass_properties, stage_from_text

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

    def tetrahedra(shape, dimension, largest, grading):
        sizes.append(largest)
        return ng.Mesh(OCCGeometry(Box((0, 0, 0), (1, 1, 1))).GenerateMesh(maxh=1))

    monkeypatch.setattr(mesh, "_generate", tetrahedra)
    with pytest.raises(ModelError, match=r"at three sizes .*superelements"):
        solid_model(design("parallelogram"), MeshSettings(order=2))
    assert len(set(sizes)) == 3
