"""What finite elements refuse, in one sentence, before they take the memory or the minutes."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError, StageError
from flexstage.elasticity import resources
from flexstage.fem import MeshSettings, plane_model, solid_model, superelement_model
from flexstage.fem.geometry import exactly
from flexstage.hinges import Leaf
from flexstage.stage import Body, Circle, Loop, Stage
from flexstage.stage.designs import design

STAGE = design("parallelogram")


@pytest.mark.parametrize("make", [plane_model, solid_model])
def test_a_mesh_that_does_not_fit_is_refused_before_it_is_made(
    make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("flexstage.fem.mesh.OCCGeometry")
    with pytest.raises(ModelError, match=r"needs about \d+ GB for its factorisation, \d+ GB are"):
        make(STAGE, MeshSettings(order=8, size=0.01))


def test_a_mesh_that_turns_out_too_large_is_refused_before_it_is_factorised(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # the coarse bound lets it pass, the true number of unknowns does not
    monkeypatch.setattr(resources, "memory_available", lambda: 6e6)
    with pytest.raises(ModelError, match="take a lower order or larger elements"):
        plane_model(STAGE, MeshSettings(order=4, size=2.0))


def test_a_mesh_that_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def __init__(self, *_: object, **__: object) -> None: ...

        def GenerateMesh(self, *_: object) -> None:  # the mesher's name
            raise RuntimeError("stop surface meshing")

    monkeypatch.setattr("flexstage.fem.mesh.OCCGeometry", Broken)
    with pytest.raises(ModelError, match=r"could not mesh the part \(stop surface meshing\)"):
        plane_model(STAGE)


def test_a_corner_without_a_radius_is_said() -> None:
    leaf = Leaf(neck_thickness=0.5e-3, leaf_length=4e-3, notch_depth=2e-3)
    bent = replace(STAGE, hinges=tuple(replace(h, profile=leaf) for h in STAGE.hinges))
    for make in (plane_model, superelement_model):
        said = make(bent, MeshSettings(order=2)).system.validity
        assert any("grows with the mesh" in sentence for sentence in said)
        said = make(STAGE, MeshSettings(order=2)).system.validity
        assert not any("grows with the mesh" in sentence for sentence in said)


def test_nothing_held() -> None:
    loose = replace(STAGE, bodies=tuple(replace(b, fixed=False) for b in STAGE.bodies))
    with pytest.raises(StageError, match="no body of stage 'parallelogram' is fixed"):
        plane_model(loose)
    block = Body(name="block", outline=Loop(((0.1, 0.1), (0.11, 0.1), (0.11, 0.12))))
    with pytest.raises(StageError, match="body 'block' is connected to no fixed body"):
        solid_model(replace(STAGE, bodies=(*STAGE.bodies, block)))


def test_bodies_that_overlap() -> None:
    base = STAGE.body("base")
    leg = STAGE.body("left-leg")
    wide = replace(leg, outline=leg.outline.mapped(lambda p: (p[0], p[1])))
    lump = Body(name="lump", outline=base.outline, fixed=True)
    with pytest.raises(StageError, match="overlap"):
        plane_model(replace(STAGE, bodies=(*STAGE.bodies, lump)))
    assert wide == leg  # a copy alone is no overlap


def test_a_body_in_pieces() -> None:
    base = STAGE.body("base")
    # a hole as high as the base, and right through it
    low = min(p[1] for p in base.outline.points)
    cut = Loop(((0.0, low - 1e-3), (1e-3, low - 1e-3), (1e-3, 1e-3), (0.0, 1e-3)))
    broken = replace(base, holes=(cut,))
    bodies = tuple(broken if b.name == "base" else b for b in STAGE.bodies)
    with pytest.raises(StageError, match="body 'base' is in 2 pieces"):
        plane_model(replace(STAGE, bodies=bodies))


def test_a_fixed_body_that_is_all_root_has_nothing_to_be_held_by() -> None:
    base = replace(STAGE.body("base"), mounting_holes=())
    held = replace(STAGE, bodies=tuple(base if b.name == "base" else b for b in STAGE.bodies))
    # without holes it is held by its edges away from the notches, and says so
    assert (
        "away from the notches" in plane_model(held, MeshSettings(order=2)).system.settings["held"]
    )


def test_a_slot_of_a_twentieth_of_a_millimetre_is_meshed() -> None:
    def slotted(width: float) -> Stage:
        base = STAGE.body("base")
        slot = Loop(((-0.005, -0.008), (0.005, -0.008), (0.005, -0.008 + width),
                     (-0.005, -0.008 + width)))  # fmt: skip
        cut = replace(base, holes=(*base.holes, slot))
        return replace(STAGE, bodies=tuple(cut if b.name == "base" else b for b in STAGE.bodies))

    thin, wide = (
        plane_model(slotted(w), MeshSettings(order=3, neck_size=1.5)) for w in (0.05e-3, 1e-3)
    )
    f = [m.system.K[0, 0] ** 0.5 for m in (thin, wide)]
    assert f[0] == pytest.approx(f[1], rel=5e-3)


def test_names_from_stage_files_are_no_expressions() -> None:
    odd = "x+ (left) [1]*.^$\\|?"
    renamed = tuple(replace(b, name=odd) if b.name == "left-leg" else b for b in STAGE.bodies)
    hinges = tuple(
        replace(
            h,
            name=f"{h.name}.*|{odd}",
            bodies=(
                odd if h.bodies[0] == "left-leg" else h.bodies[0],
                odd if h.bodies[1] == "left-leg" else h.bodies[1],
            ),
        )
        for h in STAGE.hinges
    )
    mesh = MeshSettings(order=2, neck_size=2.0)
    same = plane_model(replace(STAGE, bodies=renamed, hinges=hinges), mesh)
    plain = plane_model(STAGE, mesh)
    assert np.abs(same.system.K - plain.system.K).max() < 1e-9 * plain.system.K.max()
    assert exactly("a.b") == r"a\.b"


def test_a_hole_beside_the_mounting_holes_holds_nothing() -> None:
    base = STAGE.body("base")
    free = replace(base, holes=(*base.holes, Circle((0.0, -0.0075), 2e-3)))
    bodies = tuple(free if b.name == "base" else b for b in STAGE.bodies)
    model = plane_model(replace(STAGE, bodies=bodies), MeshSettings(order=3))
    continuum = model.problems[0].continuum
    around = 2.0 * 3.14159265 * sum(h.radius for h in base.mounting_holes)
    assert continuum.measure(boundary="mounting") == pytest.approx(around, rel=1e-3)
