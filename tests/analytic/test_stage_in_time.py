"""The whole piezo stage, 60 coordinates: responses of its modes against its full matrices.

Evidence (Stages, tolerances, designs): time response of 60 coordinates (Runge–Kutta of order 8):
$10^{-7}$; frequency response (dynamic stiffness): $10^{-9}$
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexstage.base.arrays import Array
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.system import (
    LossFactor,
    MechanicalSystem,
    ModalDamping,
    RayleighDamping,
    frequency_response,
    modes,
    state_space,
    time_response,
)


@pytest.fixture(scope="module")
def stage() -> MechanicalSystem:
    return lumped_system(design("vgtu-piezo"))


def in_place(system: MechanicalSystem) -> tuple[Array, Array]:
    """Stiffness with the stacks, and the forces of a metre of each one's free displacement."""
    gains = np.array([d.stiffness * d.vector for d in system.drives if d.stiffness])
    springs = sum(d.stiffness * np.outer(d.vector, d.vector) for d in system.drives if d.stiffness)
    return system.K + springs, gains.T


# beta = 6e-6 s damps the first mode by 2 % and the highest, at 129 kHz, beyond critical
@pytest.mark.parametrize("beta", [2e-9, 6e-6])
def test_time_response_is_that_of_an_integrator(stage: MechanicalSystem, beta: float) -> None:
    alpha = 5.0
    system = stage.with_damping(RayleighDamping(alpha=alpha, beta=beta))
    highest = modes(system, drives="in place", count=None).damping_ratio[-1]
    assert (highest > 1.0) == (beta > 1e-6)
    k, gains = in_place(system)
    c = alpha * system.M + beta * k
    inverse = 1.0 / np.diag(system.M)
    t = np.array([0.0, 1e-4, 3e-4, 3.5e-4, 8e-4])
    u = np.array([[0.0, 1.0, 3.0, 2.5, -1.0], [0.0, -1.0, 1.0, 1.0, 2.0]]) * 1e-6
    n = system.order

    def rates(time: float, state: Array) -> Array:
        force = gains @ [np.interp(time, t, row) for row in u]
        return np.r_[state[n:], inverse * (force - k @ state[:n] - c @ state[n:])]

    found = time_response(system, t, {"x": u[0], "y": u[1]})
    state = np.zeros(2 * n)
    scale = np.abs(found.q).max(axis=0)
    for i in range(1, t.size):
        # from corner to corner, so that the integrator sees a smooth input
        run = solve_ivp(rates, t[i - 1 : i + 1], state, method="DOP853", rtol=1e-9, atol=1e-15)
        state = run.y[:, -1]
        # 1e-15 m of the integrator's own, in thousands of steps, against micrometres
        assert np.all(np.abs(state[:n] - found.q[i]) < 1e-7 * scale.max())


def test_frequency_response_is_that_of_the_full_matrices(stage: MechanicalSystem) -> None:
    alpha, beta = 5.0, 1e-6
    system = stage.with_damping(RayleighDamping(alpha=alpha, beta=beta))
    k, gains = in_place(system)
    f = np.array([1.0, 210.0, 909.0, 1500.0, 5200.0])
    full = []
    for w in 2.0 * np.pi * f:
        dynamic = k - w**2 * system.M + 1j * w * (alpha * system.M + beta * k)
        full.append(np.linalg.solve(dynamic, gains))
    form = state_space(system)
    for i, drive in enumerate(system.drives):
        for j, probe in enumerate(system.probes):
            wanted = np.array([probe.vector @ x[:, i] for x in full])
            found = frequency_response(system, f, drive.name, probe.name, drives="in place").value
            # the other axis' response is a rounding of this one's
            size = np.abs([system.probes[i].vector @ x[:, i] for x in full]).max()
            assert np.abs(found - wanted).max() < 1e-9 * size
            s = 2j * np.pi * f
            by_state = [
                (form.C @ np.linalg.solve(x * np.eye(form.A.shape[0]) - form.A, form.B))[j, i]
                for x in s
            ]
            assert np.abs(by_state - wanted).max() < 1e-9 * size


def test_a_rigid_drive_beside_a_soft_one(stage: MechanicalSystem) -> None:
    x, y = stage.drives
    assert y.stiffness is not None
    system = replace(stage, drives=(replace(x, stiffness=None), y), damping=ModalDamping(ratio=0.0))
    k = stage.K + y.stiffness * np.outer(y.vector, y.vector)
    f = np.array([1.0, 905.0, 2100.0])
    found = frequency_response(system, f, "x", "x", drives="in place").value
    n = stage.order
    for frequency, value in zip(f, found, strict=True):
        dynamic = k - (2.0 * np.pi * frequency) ** 2 * stage.M
        saddle = np.block([[dynamic, -x.vector[:, None]], [x.vector[None], np.zeros((1, 1))]])
        q = np.linalg.solve(saddle, np.r_[np.zeros(n), 1.0])[:n]
        assert value == pytest.approx(stage.probe("x").vector @ q, rel=1e-8)


def test_stacks_in_place_have_no_part_in_the_loss_of_the_hinges(stage: MechanicalSystem) -> None:
    eta = 0.02
    system = stage.with_damping(LossFactor(eta=eta))
    found = modes(system, drives="in place")
    for i, phi in enumerate(found.shapes.T):
        lost, stacks = (
            phi @ stage.K @ phi,
            sum(d.stiffness * (d.vector @ phi) ** 2 for d in stage.drives if d.stiffness),
        )
        assert found.damping_ratio[i] == pytest.approx(0.5 * eta * lost / (lost + stacks), rel=1e-9)
    # the stacks carry much of the first mode
    assert found.damping_ratio[0] < 0.7 * 0.5 * eta
    bare = modes(system, drives="removed").damping_ratio
    assert bare == pytest.approx(np.full(6, 0.5 * eta), rel=1e-6)
