"""Rigid motion of everything costs no energy; the laws do not depend on where and how we look."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.lumped import Mechanism, SpringHinge, nonlinear
from tests.mechanisms import chain

angles = st.floats(-3.0, 3.0)
shifts = st.floats(-0.05, 0.05)


def rigid(source: Mechanism, q: np.ndarray, shift: tuple[float, float], turn: float) -> np.ndarray:
    """Move everything, on top of q, about the origin."""
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    out = q.reshape(-1, 3).copy()
    for k, i in enumerate(source.free):
        centre = np.array(source.bodies[i].centre)
        out[k, :2] = rotation @ (centre + out[k, :2]) + shift - centre
        out[k, 2] += turn
    return out.reshape(-1)


@given(angles, st.tuples(shifts, shifts))
@settings(max_examples=30, deadline=None)
def test_rigid_motion_of_a_free_mechanism_costs_nothing(
    turn: float, shift: tuple[float, float]
) -> None:
    source = chain(4, held=False)
    model = nonlinear(source)
    q = rigid(source, np.zeros(model.order), shift, turn)
    # energy is k x^2/2 with k to 1e8 N/m and x a rounding of 0.1 m, 1e-17 m
    assert model.potential_energy(q) < 1e-24
    assert np.abs(model.force(q)).max() < 1e-8


@given(angles, st.tuples(shifts, shifts), st.integers(0, 50))
@settings(max_examples=30, deadline=None)
def test_deformed_energy_does_not_see_rigid_motion(
    turn: float, shift: tuple[float, float], seed: int
) -> None:
    source = chain(3, held=False)
    model = nonlinear(source)
    random = np.random.default_rng(seed)
    q = random.normal(size=model.order) * np.tile([0.01, 0.01, 0.5], 3)
    moved = rigid(source, q, shift, turn)
    energy = model.potential_energy(q)
    assert abs(model.potential_energy(moved) - energy) < 1e-12 * energy
    # forces turn with it, moments do not
    force, turned = (model.force(x).reshape(-1, 3) for x in (q, moved))
    c, s = math.cos(turn), math.sin(turn)
    assert np.allclose(
        turned[:, :2], force[:, :2] @ np.array([[c, s], [-s, c]]), atol=1e-10 * np.abs(force).max()
    )
    assert np.allclose(turned[:, 2], force[:, 2], atol=1e-10 * np.abs(force).max())


def test_linear_stiffness_of_a_free_mechanism_has_three_rigid_motions() -> None:
    source = chain(4, held=False)
    model = nonlinear(source)
    stiffness = model.tangent(np.zeros(model.order))
    d = np.sqrt(np.diag(stiffness))
    values = np.linalg.eigvalsh(stiffness / np.outer(d, d))
    assert np.all(np.abs(values[:3]) < 1e-12)
    assert values[3] > 1e-6


def test_it_does_not_matter_which_body_is_called_a() -> None:
    source = chain(3)
    # seen from b, in axes turned by half a turn, the deformation (u, v, theta) is (u, v, -theta)
    flip = np.diag([1.0, 1.0, -1.0])

    def swapped(h: SpringHinge) -> SpringHinge:
        return replace(
            h,
            bodies=(h.bodies[1], h.bodies[0]),
            direction=h.direction + math.pi,
            stiffness=flip @ h.stiffness @ flip,
        )

    other = replace(source, hinges=tuple(map(swapped, source.hinges)))
    random = np.random.default_rng(7)
    q = random.normal(size=9) * np.tile([0.01, 0.01, 0.5], 3)
    energy = nonlinear(source).potential_energy(q)
    assert abs(nonlinear(other).potential_energy(q) - energy) < 1e-12 * energy
