"""Identities that hold for any mechanical system."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.base.errors import ModelError
from flexstage.system import (
    MechanicalSystem,
    ModalDamping,
    drive_stiffness,
    frequency_response,
    modes,
    state_space,
    static_displacements,
    static_forces,
    time_response,
)
from flexstage.system.mechanical import DrivePort, ProbePort


def random_system(seed: int, n: int = 7) -> MechanicalSystem:
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, n, n))
    return MechanicalSystem(
        name="random",
        model="lumped",
        M=0.02 * (a @ a.T + n * np.eye(n)),
        K=3e4 * (b @ b.T + 0.5 * np.eye(n)),
        coordinates=tuple(f"q{i}" for i in range(n)),
        drives=(
            DrivePort(name="a", vector=rng.normal(size=n), stiffness=2e4, stroke=1e-5),
            DrivePort(name="b", vector=rng.normal(size=n), stiffness=None, stroke=2e-5),
        ),
        probes=(ProbePort(name="p", vector=rng.normal(size=n)),),
        damping=ModalDamping(ratio=0.03),
    )


seeds = st.integers(0, 10_000)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_reciprocity(seed: int) -> None:
    system = random_system(seed)
    by_a = static_forces(system, {"a": 1.0}).drive_displacement["b"]
    by_b = static_forces(system, {"b": 1.0}).drive_displacement["a"]
    assert by_a == pytest.approx(by_b, rel=1e-9)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_locked_drives_do_not_move_and_stiffen(seed: int) -> None:
    system = random_system(seed)
    locked = modes(system, drives="locked", count=None)
    for d in system.drives:
        assert np.abs(d.vector @ locked.shapes).max() < 1e-8 * np.abs(locked.shapes).max()
    removed = modes(system, drives="removed", count=None)
    in_place = modes(system, drives="in place", count=None)
    # Rayleigh: added stiffness and constraints never lower a frequency
    assert np.all(in_place.omega >= removed.omega[: in_place.omega.size] * (1 - 1e-9))
    assert np.all(locked.omega >= in_place.omega[: locked.omega.size] * (1 - 1e-9))


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_zero_frequency_is_the_static_response(seed: int) -> None:
    system = random_system(seed)
    response = frequency_response(system, 0.0, "a", "p").value[0]
    assert response == pytest.approx(static_forces(system, {"a": 1.0}).readings["p"], rel=1e-9)
    # an imposed displacement of the rigid drive, with the other drive's spring in place
    imposed = frequency_response(system, 0.0, "b", "p", drives="in place").value[0]
    static = static_displacements(system, {"b": 1.0}, others="in place").readings["p"]
    assert imposed == pytest.approx(static, rel=1e-8)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_imposed_displacement_gives_the_drive_stiffness(seed: int) -> None:
    system = random_system(seed)
    force = drive_stiffness(system, "a") * 3e-6
    by_force = static_forces(system, {"a": force})
    by_length = static_displacements(system, {"a": 3e-6})
    assert by_force.q == pytest.approx(by_length.q, rel=1e-8, abs=1e-14)


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_a_rigid_drive_is_the_limit_of_a_stiff_one(seed: int) -> None:
    from dataclasses import replace

    system = random_system(seed)
    stiff = replace(system.drives[1], stiffness=1e13)
    limit = replace(system, drives=(system.drives[0], stiff), damping=ModalDamping(ratio=0.0))
    rigid = replace(system, damping=ModalDamping(ratio=0.0))
    f = 0.37 * modes(rigid, drives="in place").frequency_hz[0]
    a = frequency_response(limit, f, "b", "p", drives="in place").value
    b = frequency_response(rigid, f, "b", "p", drives="in place").value
    # 1e-5: the stiff spring is 1e7 to 1e8 times stiffer than the system; 1e-6: what its rounding
    # leaves of a response of order 1 that happens to be near a zero
    assert a == pytest.approx(b, rel=1e-5, abs=1e-6)


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_a_split_step_gives_the_same_motion(seed: int) -> None:
    system = random_system(seed)
    rng = np.random.default_rng(seed + 1)
    t = np.linspace(0.0, 0.05, 30)
    u = rng.normal(size=t.size)
    fine = np.sort(np.concatenate((t, rng.uniform(0.0, 0.05, 200))))
    coarse_run = time_response(system, t, {"a": u}, drives="removed")
    fine_run = time_response(system, fine, {"a": np.interp(fine, t, u)}, drives="removed")
    again = fine_run.q[np.searchsorted(fine, t)]
    assert again == pytest.approx(coarse_run.q, abs=1e-10 * np.abs(coarse_run.q).max())


def test_truncated_state_space_keeps_the_static_gain() -> None:
    from dataclasses import replace

    system = random_system(5)
    system = replace(system, drives=system.drives[:1])
    form = state_space(system, drives="removed", count=2)
    gain = form.D - form.C @ np.linalg.solve(form.A, form.B)
    assert gain[0, 0] == pytest.approx(static_forces(system, {"a": 1.0}).readings["p"], rel=1e-9)


def test_python_control_gets_the_same_system() -> None:
    pytest.importorskip("control", reason="python-control is an optional dependency")
    from dataclasses import replace

    system = random_system(5)
    system = replace(system, drives=system.drives[:1])
    made = state_space(system).to_control()
    f = 21.0
    expected = frequency_response(system, f, "a", "p", drives="in place").value[0]
    assert complex(made(2j * np.pi * f)) == pytest.approx(expected, rel=1e-9)


def test_a_mechanism_is_refused_in_words() -> None:
    from dataclasses import replace

    system = random_system(1)
    v = np.ones(7)
    projector = np.eye(7) - np.outer(v, v) / 7
    loose = replace(system, K=projector @ system.K @ projector)
    with pytest.raises(ModelError, match="without deforming a hinge"):
        static_forces(loose, {"a": 1.0})
    assert modes(loose).frequency_hz[0] < 1e-3


def test_displacements_that_exclude_each_other_are_refused_in_words() -> None:
    from dataclasses import replace

    system = random_system(2)
    a, b = system.drives
    for vector in (-2.0 * a.vector, 0.0 * a.vector):
        twice = replace(system, drives=(a, replace(b, vector=vector)))
        with pytest.raises(ModelError, match="cannot be imposed"):
            static_displacements(twice, {"a": 1e-6, "b": 1e-6})
        with pytest.raises(ModelError, match="cannot be imposed"):
            static_displacements(twice, {"b": 1e-6}, others="locked")
