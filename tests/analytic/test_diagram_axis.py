"""Two masses for an axis keep what they promise, and a diagram says what it leaves out."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.export.diagram.graph import DiagramBuilder, diagram_state_space, identifier
from flexstage.export.diagram.stage_diagram import axis_chain, stage_diagram
from flexstage.hysteresis import dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.system import MechanicalSystem, modes
from flexstage.system.mechanical import AxisPort, DrivePort, ProbePort
from tests.mechanisms import without_drive_chains

_AXIS = AxisPort(name="x", drives=("stack",), probe="gauge")


def two_masses(stiffness: float | None) -> MechanicalSystem:
    """Return the chain itself as a system: every size of it is known."""
    i, k_in, k_t, m_in, m_out = 1.83, 4.7e5, 3.9e6, 0.037, 0.29
    return MechanicalSystem(
        name="chain",
        model="lumped",
        M=np.diag([m_in, m_out]),
        K=np.array([[k_in + k_t * i**2, -k_t * i], [-k_t * i, k_t]]),
        coordinates=("d [m]", "p [m]"),
        drives=(DrivePort(name="stack", vector=np.array([1.0, 0.0]), stiffness=stiffness),),
        probes=(ProbePort(name="gauge", vector=np.array([0.0, 1.0])),),
        axes=(_AXIS,),
    )


def test_a_stage_of_two_masses_is_found_again() -> None:
    found = axis_chain(two_masses(1.7e7), _AXIS, pushed_mass=9.9)
    got = (
        found.ratio, found.input_stiffness, found.transmission_stiffness, found.input_mass,
        found.output_mass,
    )  # fmt: skip
    np.testing.assert_allclose(got, (1.83, 4.7e5, 3.9e6, 0.037, 0.29), rtol=1e-9)


def test_two_masses_behind_an_imposed_displacement_are_found_again() -> None:
    found = axis_chain(two_masses(None), _AXIS, pushed_mass=0.037)
    got = (
        found.ratio, found.input_stiffness, found.transmission_stiffness, found.input_mass,
        found.output_mass,
    )  # fmt: skip
    np.testing.assert_allclose(got, (1.83, 4.7e5, 3.9e6, 0.037, 0.29), rtol=1e-9)
    assert found.frequency_hz == pytest.approx(np.sqrt(3.9e6 / 0.29) / (2.0 * np.pi), rel=1e-12)


def test_a_probe_that_moves_with_the_drive_leaves_one_mass() -> None:
    system = two_masses(1.7e7)
    one = replace(system, probes=(ProbePort(name="gauge", vector=np.array([0.6, 0.0])),))
    found = axis_chain(one, _AXIS, pushed_mass=0.1)
    omega = 2.0 * np.pi * found.frequency_hz
    assert np.min(np.abs(modes(one, drives="in place", count=2).omega / omega - 1.0)) < 1e-12
    assert found.output_mass == 0.0
    assert found.ratio == pytest.approx(0.6, rel=1e-12)
    assert (found.input_stiffness + 1.7e7) / found.input_mass == pytest.approx(omega**2, rel=1e-9)


def test_a_drive_that_does_not_move_the_probe_is_refused() -> None:
    deaf = replace(
        two_masses(1.7e7), probes=(ProbePort(name="gauge", vector=np.array([0.0, 0.0])),)
    )
    with pytest.raises(ModelError, match="does not move probe 'gauge'"):
        axis_chain(deaf, _AXIS, pushed_mass=0.1)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_an_axis_keeps_its_statics_and_its_first_mode(axis: str) -> None:
    stage = design("vgtu-piezo")
    system = lumped_system(stage)
    drawn = stage_diagram(stage, axis=axis)
    space = diagram_state_space(without_drive_chains(drawn))
    whole = diagram_state_space(without_drive_chains(stage_diagram(stage)))
    static = (space.D - space.C @ np.linalg.solve(space.A, space.B)).item()
    at = ("x", "y").index(axis)
    wanted = (whole.D - whole.C @ np.linalg.solve(whole.A, whole.B))[at, at]
    assert static == pytest.approx(wanted, rel=1e-9)
    found = modes(system, drives="in place", count=2)
    pole = min(np.linalg.eigvals(space.A), key=abs)
    assert abs(pole) == pytest.approx(found.omega[at], rel=1e-9)
    assert -pole.real / abs(pole) == pytest.approx(0.01, rel=1e-6)
    # at its resonance it answers as the stage does: other modes add less than 2 % there
    s = 1j * found.omega[at]

    def value(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> complex:
        return complex((c @ np.linalg.solve(s * np.eye(len(a)) - a, b)).item())

    near = value(whole.A, whole.B[:, [at]], whole.C[[at]])
    assert abs(value(space.A, space.B, space.C) / near - 1.0) < 0.02


@pytest.mark.parametrize("axis", ["x", "y"])
def test_an_axis_of_screws_keeps_its_ratio_and_its_mode(axis: str) -> None:
    stage = design("vgtu-mechanical")
    drawn = stage_diagram(stage, axis=axis)
    space = diagram_state_space(drawn)
    static = (space.D - space.C @ np.linalg.solve(space.A, space.B)).item()
    chain = axis_chain(
        lumped_system(stage), next(a for a in lumped_system(stage).axes if a.name == axis),
        pushed_mass=0.003,
    )  # fmt: skip
    # the spring that stands in gives way by its own share, the input stiffness over it
    assert static == pytest.approx(chain.ratio, rel=2e-4)
    pole = min(np.linalg.eigvals(space.A), key=abs)
    assert abs(pole) / (2.0 * np.pi) == pytest.approx(chain.frequency_hz, rel=3e-3)


def test_an_axis_on_one_body_is_one_mass() -> None:
    drawn = stage_diagram(design("parallelogram"), axis="x")
    assert [b.name for b in drawn.blocks if b.kind == "integrator"] == [
        "input_rate",
        "input_motion",
    ]
    omega = modes(lumped_system(design("parallelogram")), drives="removed", count=1).omega[0]
    inverse = drawn.block("input_inverse_mass").matrix
    stiffness = drawn.block("input_spring").matrix
    assert inverse is not None
    assert stiffness is not None
    assert (inverse * stiffness).item() == pytest.approx(omega**2, rel=1e-9)


def test_an_unknown_axis_is_refused() -> None:
    with pytest.raises(ModelError, match=r"no axis 'z': its axes are x, y"):
        stage_diagram(design("vgtu-piezo"), axis="z")


def test_names_are_unlike_each_other_and_short() -> None:
    builder = DiagramBuilder()
    made = [
        builder.group(n, title="", kind="body").name for n in ("a-b", "a b", "a_b", "7", "ü" * 3)
    ]
    assert made == ["a_b", "a_b_2", "a_b_3", "n7", "n"]
    assert len(identifier("leg" * 40)) == 48


def test_a_sum_of_nothing_is_refused() -> None:
    builder = DiagramBuilder()
    builder.add("f", "sum", "+", "forces on nothing [N]")
    with pytest.raises(ModelError, match="sum 'f' has no terms"):
        builder.diagram("empty", ())


def test_a_diagram_says_what_it_leaves_out() -> None:
    stage = design("vgtu-piezo")
    usual = stage_diagram(stage).notes
    assert any("not measured" in n for n in usual)
    plain = stage_diagram(
        stage, model=dynamic_model(stage, lumped_system(stage), hysteresis="none")
    )
    assert any("without hysteresis" in n for n in plain.notes)
    assert not any("not measured" in n for n in plain.notes)
    assert any("Two masses" in n for n in stage_diagram(stage, axis="y").notes)
