"""Motion in time on seats: against the linear stage, equilibria, and explicit steps of all masses.

Evidence (Stages, tolerances, designs): drives that lift off, explicit steps of all coordinates
(velocity Verlet, 0.5 us): contact force over 3 ms 1.5e-4 of its largest value
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from flexstage.base.errors import ModelError
from flexstage.lumped import lumped_system
from flexstage.stage.seat import BallSeat, TipSeat
from flexstage.system.mechanical import ModalDamping
from flexstage.system.response import time_response
from flexstage.system.seated_drives import static_drives
from flexstage.system.seated_response import seated_response
from tests.analytic.test_seats import stage

BALL = BallSeat(radius=10e-3, contact_modulus=115.4e9)


def ramp(time: np.ndarray, duration: float, end: float) -> np.ndarray:
    return end * (0.5 - 0.5 * np.cos(np.pi * np.clip(time / duration, 0.0, 1.0)))


def test_joined_drives_move_as_the_linear_stage() -> None:
    joined = stage(TipSeat(axial_stiffness=3e7))
    system = replace(lumped_system(joined), damping=ModalDamping(ratio=0.0))
    t = np.linspace(0.0, 3e-3, 601)
    w = ramp(t, 1e-3, 20e-6)
    ours = seated_response(joined, system, t, {"x": w})
    assert not ours.lifted("x")  # a joint that pulls, at a force that does
    exact = time_response(system, t, {"x": w}).readings["x"]
    assert np.max(np.abs(ours.readings["x"] - exact)) < 2e-5 * np.max(np.abs(exact))


def test_a_slow_motion_follows_the_equilibria() -> None:
    seated = stage(BALL, preload=20.0)
    # the other drive rests, joined
    x, y = seated.drives
    seated = replace(seated, drives=(x, replace(y, seats=(), preload=None)))
    system = lumped_system(seated)
    t = np.linspace(0.0, 0.015, 51)
    w = ramp(t, 0.015, 38e-6)
    ours = seated_response(seated, system, t, {"x": w})
    for i in (15, 30, 50):
        state = static_drives(seated, system, {"x": float(w[i])})
        assert ours.readings["x"][i] == pytest.approx(state.static.readings["x"], rel=2e-3)
        assert ours.contact_force["x"][i] == pytest.approx(
            state.drives["x"].contact_force, rel=5e-3
        )
    assert not ours.lifted("x")


def test_a_fast_return_lifts_the_drive_off() -> None:
    seated = stage(BALL, preload=20.0)
    system = replace(lumped_system(seated), damping=ModalDamping(ratio=0.0))
    t = np.linspace(0.0, 3e-3, 601)
    w = ramp(t, 0.4e-3, 15e-6) - ramp(t - 0.8e-3, 0.4e-3, 15e-6)
    ours = seated_response(seated, system, t, {"x": w})
    assert ours.lifted("x")

    # all masses, in small explicit steps, with the law of the contact written out
    step = 0.5e-6
    K, inverse = system.K, np.linalg.inv(system.M)
    d = np.column_stack([system.drive(n).vector for n in "xy"])

    def force(free: float) -> float:
        def excess(f: float) -> float:
            depth = (9.0 * (20.0 + f) ** 2 / (16.0 * 10e-3 * 115.4e9**2)) ** (1.0 / 3.0)
            return f / 50e6 + depth - at_rest - free

        at_rest = 0.0
        at_rest = excess(0.0) + free
        return -20.0 if excess(-20.0) >= 0.0 else brentq(excess, -20.0, 5e3, xtol=1e-9)

    q, v, force_x = np.zeros(system.order), np.zeros(system.order), []
    acceleration = np.zeros(system.order)
    for i in range(round(3e-3 / step) + 1):
        now = np.array([np.interp(i * step, t, w), 0.0])
        pushed = np.array([force(x) for x in now - d.T @ q])
        if i % 10 == 0:
            force_x.append(pushed[0] + 20.0)
        acceleration = inverse @ (d @ pushed - K @ q)
        v = v + step * acceleration
        q = q + step * v
    difference = ours.contact_force["x"] - force_x
    assert np.max(np.abs(difference)) < 1.5e-4 * np.max(force_x)
    open_since = t[np.argmax(ours.contact_force["x"] <= 0.0)]
    assert open_since == pytest.approx(t[np.argmax(np.array(force_x) <= 0.0)], abs=10e-6)


def test_wrong_inputs_are_refused() -> None:
    seated = stage(BALL, preload=20.0)
    system = lumped_system(seated)
    with pytest.raises(ModelError, match="times must rise"):
        seated_response(seated, system, [0.0, 0.0], {"x": [0.0, 0.0]})
    with pytest.raises(ModelError, match="must have shape"):
        seated_response(seated, system, [0.0, 1.0], {"x": [0.0]})
