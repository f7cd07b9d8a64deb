"""A mass on a spring: everything the system room says of it has a closed form."""

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.system import (
    LossFactor,
    MechanicalSystem,
    ModalDamping,
    RayleighDamping,
    drive_stiffness,
    frequency_response,
    modes,
    probe_stiffness,
    state_space,
    static_displacements,
    static_forces,
    time_response,
)
from flexstage.system.mechanical import DrivePort, ProbePort

MASS, STIFFNESS, SPRING, ZETA = 0.37, 5.3e4, 2.1e4, 0.023
OMEGA = np.sqrt(STIFFNESS / MASS)


def system(spring: float | None = SPRING, damping=None) -> MechanicalSystem:
    return MechanicalSystem(
        name="mass",
        model="lumped",
        M=np.array([[MASS]]),
        K=np.array([[STIFFNESS]]),
        coordinates=("x [m]",),
        drives=(DrivePort(name="d", vector=np.array([2.0]), stiffness=spring, stroke=1e-4),),
        probes=(ProbePort(name="p", vector=np.array([3.0])),),
        damping=damping or ModalDamping(ratio=ZETA),
    )


def test_static_force_and_displacement() -> None:
    # a drive with a lever of 2: its force acts doubled, and it sees a quarter of the stiffness
    assert static_forces(system(), {"d": 7.0}).readings["p"] == pytest.approx(
        3 * 2 * 7.0 / STIFFNESS, rel=1e-13
    )
    imposed = static_displacements(system(), {"d": 1e-5})
    assert imposed.readings["p"] == pytest.approx(3 * 1e-5 / 2, rel=1e-13)
    assert imposed.drive_force["d"] == pytest.approx(STIFFNESS * 1e-5 / 4, rel=1e-13)
    assert drive_stiffness(system(), "d") == pytest.approx(STIFFNESS / 4, rel=1e-13)
    assert probe_stiffness(system(), "p", drives="in place") == pytest.approx(
        (STIFFNESS + 4 * SPRING) / 9, rel=1e-13
    )


def test_frequencies_in_every_condition_of_the_drive() -> None:
    removed = modes(system(), drives="removed")
    assert removed.omega[0] == pytest.approx(OMEGA, rel=1e-13)
    in_place = modes(system(), drives="in place")
    assert in_place.omega[0] == pytest.approx(np.sqrt((STIFFNESS + 4 * SPRING) / MASS), rel=1e-13)
    # held at its length, nothing is left to move; a rigid drive in place is the same
    assert modes(system(), drives="locked").omega.size == 0
    assert modes(system(spring=None), drives="in place").omega.size == 0
    with pytest.raises(ModelError, match="expected removed, in place or locked"):
        modes(system(), drives="gone")  # type: ignore[arg-type]


def test_damping_ratios() -> None:
    rayleigh = modes(system(damping=RayleighDamping(alpha=3.0, beta=2e-5)))
    assert rayleigh.damping_ratio[0] == pytest.approx((3.0 / OMEGA + 2e-5 * OMEGA) / 2, rel=1e-12)
    loss = modes(system(damping=LossFactor(eta=0.004)), drives="in place")
    share = STIFFNESS / (STIFFNESS + 4 * SPRING)
    assert loss.damping_ratio[0] == pytest.approx(0.002 * share, rel=1e-12)


def test_frequency_response() -> None:
    f = np.array([0.0, 13.0, OMEGA / 2 / np.pi, 400.0])
    w = 2 * np.pi * f
    expected = 6.0 / (STIFFNESS - MASS * w**2 + 2j * ZETA * OMEGA * MASS * w)
    response = frequency_response(system(), f, "d", "p")
    assert response.value == pytest.approx(expected, rel=1e-12)
    assert response.unit == "m/N"
    total = STIFFNESS + 4 * SPRING
    own = np.sqrt(total / MASS)
    placed = frequency_response(system(), f, "d", "p", drives="in place")
    assert placed.value == pytest.approx(
        6 * SPRING / (total - MASS * w**2 + 2j * ZETA * own * MASS * w), rel=1e-12
    )
    # a rigid drive imposes its displacement at every frequency
    rigid = frequency_response(system(spring=None), f, "d", "p", drives="in place")
    assert rigid.value == pytest.approx(np.full(4, 1.5), rel=1e-12)


def test_step_response_is_exact_for_any_step() -> None:
    wd = OMEGA * np.sqrt(1 - ZETA**2)
    for count in (3, 40, 1001):
        t = np.linspace(0.0, 0.05, count)
        response = time_response(system(), t, {"d": np.full(count, 5.0)}, drives="removed")
        a = ZETA * OMEGA
        exact = 1 - np.exp(-a * t) * (np.cos(wd * t) + a / wd * np.sin(wd * t))
        # 1e-12: rounding of a thousand steps
        assert response.readings["p"] == pytest.approx(
            3 * 2 * 5.0 / STIFFNESS * exact, abs=1e-12 * 30.0 / STIFFNESS
        )


def test_ramp_response_of_uneven_steps() -> None:
    t = np.concatenate(([0.0], np.cumsum(np.random.default_rng(3).uniform(1e-5, 2e-3, 80))))
    rate = 40.0
    response = time_response(
        system(damping=ModalDamping(ratio=0.0)), t, {"d": rate * t}, drives="removed"
    )
    exact = 2 * rate / STIFFNESS * (t - np.sin(OMEGA * t) / OMEGA)
    assert response.q[:, 0] == pytest.approx(exact, abs=1e-12 * np.abs(exact).max())
    assert response.velocity[:, 0] == pytest.approx(
        2 * rate / STIFFNESS * (1 - np.cos(OMEGA * t)), abs=1e-12 * 4 * rate / STIFFNESS
    )


def test_very_small_steps_keep_their_digits() -> None:
    # omega h is 4e-6 here, where the closed form of the second integral would cancel
    t = np.arange(2001) * 1e-8
    response = time_response(
        system(damping=ModalDamping(ratio=0.0)), t, {"d": np.ones(t.size)}, drives="removed"
    )
    exact = 2 / STIFFNESS * 2 * np.sin(OMEGA * t / 2) ** 2
    assert response.q[1:, 0] == pytest.approx(exact[1:], rel=1e-9)


def test_free_motion_from_initial_state() -> None:
    t = np.linspace(0.0, 0.1, 77)
    response = time_response(
        system(damping=ModalDamping(ratio=0.0)),
        t,
        {},
        drives="removed",
        q0=[2e-6],
        velocity0=[-3e-4],
    )
    exact = 2e-6 * np.cos(OMEGA * t) - 3e-4 / OMEGA * np.sin(OMEGA * t)
    assert response.q[:, 0] == pytest.approx(exact, abs=1e-17)


def test_state_space_has_the_same_response() -> None:
    form = state_space(system())
    s = 2j * np.pi * 31.0
    value = form.C @ np.linalg.solve(s * np.eye(2) - form.A, form.B) + form.D
    expected = frequency_response(system(), 31.0, "d", "p", drives="in place").value
    assert value.ravel() == pytest.approx(expected, rel=1e-12)
    assert form.inputs == ("d [m]",)


def test_what_cannot_be_asked() -> None:
    with pytest.raises(ModelError, match="times"):
        time_response(system(), [0.0, 0.0], {})
    with pytest.raises(ModelError, match="shape"):
        time_response(system(), [0.0, 1.0], {"d": [1.0]})
    with pytest.raises(ModelError, match="rigid"):
        time_response(system(spring=None), [0.0, 1.0], {"d": [1.0, 1.0]})
    with pytest.raises(ModelError, match="no drive 'z'"):
        static_forces(system(), {"z": 1.0})
    with pytest.raises(ModelError, match="damping ratio"):
        ModalDamping(ratio=1.5)
