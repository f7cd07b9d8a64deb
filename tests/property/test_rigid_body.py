"""Rigid-body fits: against quaternions, frame invariance, round trips, coverage.

Evidence (Measuring and centring): rigid motion (quaternions, Horn): $10^{-9}$

Evidence (Coverage of 95 % intervals): rigid motion, sensors (white), 300 repetitions: 92 to 98 %
required, *simulated*
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.motion.reach import PARAMETERS, rigid_motion, travel_frame

SPHERES = np.array(
    [[0.0, 0.0, 0.0], [82e-3, 6e-3, 1e-3], [11e-3, 61e-3, 7e-3], [70e-3, 55e-3, -4e-3]]
)

seeds = st.integers(0, 2**32 - 1)


def rotation(roll: float, pitch: float, yaw: float) -> Array:
    (a, b), (c, d), (e, f) = ((np.cos(v), np.sin(v)) for v in (roll, pitch, yaw))
    Rx = np.array([[1, 0, 0], [0, a, -b], [0, b, a]])
    Ry = np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]])
    Rz = np.array([[e, -f, 0], [f, e, 0], [0, 0, 1]])
    return Rz @ Ry @ Rx


def by_quaternion(a: Array, b: Array) -> tuple[Array, Array]:
    """Horn (1987): the quaternion is the eigenvector of a matrix of four by four."""
    p, q = a - a.mean(0), b - b.mean(0)
    S = np.einsum("ki,kj->ij", p, q)
    d = np.array([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]])
    N = np.zeros((4, 4))
    N[0, 0], N[0, 1:], N[1:, 0] = np.trace(S), d, d
    N[1:, 1:] = S + S.T - np.trace(S) * np.eye(3)
    s, x, y, z = np.linalg.eigh(N)[1][:, -1]
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R = np.eye(3) + 2.0 * s * K + 2.0 * K @ K
    return R, b.mean(0) - R @ a.mean(0)


@given(seed=seeds, count=st.integers(3, 7), plane=st.booleans())
def test_the_fit_equals_the_quaternion_solution(seed: int, count: int, plane: bool) -> None:
    random = np.random.default_rng(seed)
    a = random.normal(size=(count, 3)) * [1.0, 0.6, 0.0 if plane else 0.3]
    R = rotation(*random.uniform(-1.2, 1.2, 3))
    b = a @ R.T + random.normal(size=3) + 0.05 * random.normal(size=a.shape)
    found = rigid_motion(a, b, about=(0.0, 0.0, 0.0))
    R_q, t_q = by_quaternion(a, b)
    assert found.rotation == pytest.approx(R_q, abs=1e-9)
    assert found.translation == pytest.approx(t_q, abs=1e-9)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0, abs=1e-12)


def test_mirrored_points_still_give_a_rotation() -> None:
    mirrored = SPHERES * [1.0, 1.0, -1.0]
    found = rigid_motion(SPHERES, mirrored)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0, abs=1e-12)
    R, _ = by_quaternion(SPHERES, mirrored)
    assert found.rotation == pytest.approx(R, abs=1e-9)
    assert np.abs(found.residuals).max() > 1e-3


@settings(max_examples=40, deadline=None)
@given(
    angles=st.tuples(*[st.floats(-0.9, 0.9)] * 3),
    shift=st.tuples(*[st.floats(-1e-3, 1e-3)] * 3),
)
def test_a_motion_comes_back(angles: tuple, shift: tuple) -> None:
    R, about = rotation(*angles), np.array([13e-3, -4e-3, 9e-3])
    moved = (SPHERES - about) @ R.T + about + shift
    found = rigid_motion(SPHERES, moved, about=about)
    assert found.angles == pytest.approx(angles, abs=1e-12)
    assert found.translation == pytest.approx(shift, abs=1e-15)


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_poses_together_equal_poses_one_by_one(seed: int) -> None:
    random = np.random.default_rng(seed)
    poses = SPHERES + 1e-6 * random.normal(size=(3, 2, 4, 3))
    together = rigid_motion(SPHERES, poses)
    alone = rigid_motion(SPHERES, poses[2, 1])
    assert together.angles[2, 1] == pytest.approx(alone.angles, abs=1e-14)
    assert together.residuals[2, 1] == pytest.approx(alone.residuals, abs=1e-14)
    # the noise is that of all poses
    share = np.sum(together.residuals**2) / 6.0 / np.sum(alone.residuals**2)
    assert together.covariance[2, 1] == pytest.approx(share * alone.covariance, rel=1e-9)
    assert together.estimate("yaw", (2, 1)).value == pytest.approx(alone.estimate("yaw").value)


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_the_frame_does_not_matter(seed: int) -> None:
    random = np.random.default_rng(seed)
    moved = SPHERES + 2e-6 * random.normal(size=(4, 3))
    frame = travel_frame(random.normal(size=3), random.normal(size=3))
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    a = rigid_motion(SPHERES, moved)
    b = rigid_motion(SPHERES @ frame.T, moved @ frame.T)
    assert b.rotation == pytest.approx(frame @ a.rotation @ frame.T, abs=1e-12)
    assert b.translation == pytest.approx(frame @ a.translation, abs=1e-15)
    assert np.sum(b.residuals**2) == pytest.approx(np.sum(a.residuals**2), rel=1e-6)


def test_the_covariance_is_that_of_repeated_noise() -> None:
    noise = 1e-6 * np.random.default_rng(21).normal(size=(4000, 4, 3))
    R = rotation(0.1, -0.2, 0.4)
    found = rigid_motion(SPHERES, SPHERES @ R.T + noise, about=(0.02, 0.0, 0.0))
    turns = np.stack(
        [(D - np.swapaxes(D, -1, -2))[..., i, j] / 2.0 for D in [found.rotation @ R.T]
         for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1)  # fmt: skip
    six = np.concatenate([found.translation, turns], axis=-1)
    expected, sample = found.covariance[0], np.cov(six.T)
    size = np.sqrt(np.diag(expected))
    assert sample / np.outer(size, size) == pytest.approx(expected / np.outer(size, size), abs=0.09)


@pytest.mark.parametrize("poses", [1, 8])
def test_intervals_cover(poses: int) -> None:
    noise, held, count = 0.3e-6, 0, 300
    R = rotation(12e-6, -40e-6, 25e-6)
    truth = np.concatenate([(R - np.eye(3)) @ SPHERES.mean(0) + 3e-6, (12e-6, -40e-6, 25e-6)])
    for seed in range(count):
        random = np.random.default_rng([3, seed])
        reference = SPHERES + noise * random.normal(size=(4, 3))
        moved = SPHERES @ R.T + 3e-6 + noise * random.normal(size=(poses, 4, 3))
        found = rigid_motion(reference, moved)
        number = seed % 6
        estimate = found.estimate(PARAMETERS[number], 0)  # type: ignore[arg-type]
        held += estimate.covers(float(truth[number]))
    assert 0.925 <= held / count <= 0.98


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: rigid_motion(SPHERES[:2], SPHERES[:2]), RecordError, "three points"),
        (lambda: rigid_motion(SPHERES, SPHERES[:3]), RecordError, "same number"),
        (lambda: rigid_motion(SPHERES, SPHERES * np.nan), RecordError, "finite"),
        (
            lambda: rigid_motion(np.outer(range(4), [1.0, 2.0, 3.0]), SPHERES),
            RecordError,
            "on a line",
        ),
        (lambda: rigid_motion(SPHERES, SPHERES).estimate("tilt"), ModelError, "pitch"),  # type: ignore[arg-type]
        (lambda: travel_frame((0, 0, 2), (0, 0, 1)), ModelError, "parallel"),
    ],
)
def test_bad_input_is_one_sentence(call, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
