"""The first-order form of a stage whose drives impose their displacement."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.system import (
    LossFactor,
    MechanicalSystem,
    ModalDamping,
    frequency_response,
    modes,
    state_space,
)
from flexstage.system.response import imposed_shape

_SCREWS = lumped_system(design("vgtu-mechanical"))


def _mixed() -> MechanicalSystem:
    """A stage with a rigid drive beside a soft one and a pure force."""
    x, y = _SCREWS.drives
    pushed = 0.7 * x.vector - 1.3 * y.vector + np.linspace(-0.4, 0.9, x.vector.size)
    return replace(
        _SCREWS,
        drives=(
            replace(x, stiffness=None),
            replace(y, stiffness=3.1e7),
            replace(x, name="f", vector=pushed, stiffness=0.0),
        ),
        damping=LossFactor(eta=0.07),
    )


@pytest.mark.parametrize("system", [_SCREWS, _mixed()], ids=["screws", "mixed"])
def test_an_imposed_displacement_answers_as_in_frequency(system: MechanicalSystem) -> None:
    form = state_space(system)
    assert [name.split(" ")[1] for name in form.inputs] == ["[m]", "[m]", "[N]"][
        : len(system.drives)
    ]
    f = np.array([0.3, 61.0, 417.0, 1902.0, 23000.0])
    for i, drive in enumerate(system.drives):
        column = (
            np.array(
                [
                    form.C @ np.linalg.solve(2j * np.pi * g * np.eye(len(form.A)) - form.A, form.B)
                    for g in f
                ]
            )[:, :, i]
            + form.D[:, i]
        )
        wanted = np.array(
            [
                frequency_response(system, f, drive.name, p.name, drives="in place").value
                for p in system.probes
            ]
        ).T
        # one axis answers the other's drive with a rounding: both are held to the larger one
        scale = np.abs(wanted).max(axis=1, keepdims=True)
        assert np.all(np.abs(column - wanted) < 1e-9 * scale)


def test_the_form_follows_the_equations_of_motion_of_a_moving_support() -> None:
    """Coordinates whose ends are moved, integrated as they are: M q'' + C q' + K q = V f."""
    system = replace(_mixed(), damping=ModalDamping(ratio=0.037))
    found = modes(system, drives="in place", count=None)
    x = system.drives[0]
    shape = imposed_shape(system, x)
    assert x.vector @ shape == pytest.approx(1.0, rel=1e-12)
    # the held modes about the moving shape: r'' + 2 zeta omega r' + omega^2 r = -g w''
    keep = 3
    omega, zeta = found.omega[:keep], found.damping_ratio[:keep]
    g = (found.shapes.T @ system.M @ shape)[:keep]
    turn = 2.0 * np.pi * 83.0

    def relative(t: float, r: np.ndarray) -> np.ndarray:
        push = g * 4.1e-5 * turn**2 * np.sin(turn * t)
        return np.r_[r[keep:], push - 2.0 * zeta * omega * r[keep:] - omega**2 * r[:keep]]

    form = state_space(system, count=keep)

    def absolute(t: float, s: np.ndarray) -> np.ndarray:
        return form.A @ s + form.B[:, 0] * 4.1e-5 * np.sin(turn * t)

    end = 0.021
    start = np.zeros(2 * keep)
    start[keep:] = -g * 4.1e-5 * turn  # the support starts at a run, the coordinates at rest
    settings = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-17}
    r = solve_ivp(relative, (0.0, end), start, **settings).y[:, -1]
    s = solve_ivp(absolute, (0.0, end), np.zeros(2 * keep), **settings).y[:, -1]
    w = 4.1e-5 * np.sin(turn * end)
    probe = system.probe("x").vector
    wanted = probe @ shape * w + probe @ found.shapes[:, :keep] @ r[:keep]
    reading = (form.C @ s + form.D[:, 0] * w)[0]
    # the integrator's tolerance, over some hundred steps
    assert reading == pytest.approx(wanted, rel=1e-8)


def test_modes_left_out_of_an_imposed_displacement_are_kept_at_rest() -> None:
    full, few = state_space(_SCREWS), state_space(_SCREWS, count=4)

    def gain(form):
        return form.D - form.C @ np.linalg.solve(form.A, form.B)

    assert gain(few) == pytest.approx(gain(full), rel=1e-9, abs=1e-12)
    shapes = np.column_stack([imposed_shape(_SCREWS, d) for d in _SCREWS.drives])
    static = np.array([p.vector for p in _SCREWS.probes]) @ shapes
    assert gain(full) == pytest.approx(static, rel=1e-9, abs=1e-12)
