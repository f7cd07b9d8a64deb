"""Rigid-body fits: against quaternions, frame invariance, round trips, coverage."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import chdtrc

from flexstage.arrays import Array
from flexstage.errors import ModelError, RecordError
from flexstage.measure.motion.rigid_body import PARAMETERS, rigid_motion, travel_frame

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


def by_quaternion(a: Array, b: Array, weights: Array) -> tuple[Array, Array]:
    """Horn (1987): the quaternion is the eigenvector of a matrix of four by four."""
    w = weights / weights.sum()
    p, q = a - w @ a, b - w @ b
    S = np.einsum("k,ki,kj->ij", w, p, q)
    d = np.array([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]])
    N = np.zeros((4, 4))
    N[0, 0], N[0, 1:], N[1:, 0] = np.trace(S), d, d
    N[1:, 1:] = S + S.T - np.trace(S) * np.eye(3)
    s, x, y, z = np.linalg.eigh(N)[1][:, -1]
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R = np.eye(3) + 2.0 * s * K + 2.0 * K @ K
    return R, w @ b - R @ (w @ a)


@settings(max_examples=60, deadline=None)
@given(seed=seeds, count=st.integers(3, 7), plane=st.booleans())
def test_the_fit_equals_the_quaternion_solution(seed: int, count: int, plane: bool) -> None:
    random = np.random.default_rng(seed)
    a = random.normal(size=(count, 3)) * [1.0, 0.6, 0.0 if plane else 0.3]
    R = rotation(*random.uniform(-1.2, 1.2, 3))
    b = a @ R.T + random.normal(size=3) + 0.05 * random.normal(size=a.shape)
    weights = random.uniform(0.3, 3.0, count)
    found = rigid_motion(a, b, weights=weights, about=(0.0, 0.0, 0.0))
    R_q, t_q = by_quaternion(a, b, weights)
    assert found.rotation == pytest.approx(R_q, abs=1e-9)
    assert found.translation == pytest.approx(t_q, abs=1e-9)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0, abs=1e-12)


def test_mirrored_points_still_give_a_rotation() -> None:
    mirrored = SPHERES * [1.0, 1.0, -1.0]
    found = rigid_motion(SPHERES, mirrored, covariance=(1e-6) ** 2)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0, abs=1e-12)
    R, _ = by_quaternion(SPHERES, mirrored, np.ones(4))
    assert found.rotation == pytest.approx(R, abs=1e-9)
    assert chdtrc(found.redundancy, found.chi_squared) < 1e-12


@settings(max_examples=40, deadline=None)
@given(
    angles=st.tuples(*[st.floats(-0.9, 0.9)] * 3),
    shift=st.tuples(*[st.floats(-1e-3, 1e-3)] * 3),
    full=st.booleans(),
)
def test_a_motion_comes_back(angles: tuple, shift: tuple, full: bool) -> None:
    R, about = rotation(*angles), np.array([13e-3, -4e-3, 9e-3])
    moved = (SPHERES - about) @ R.T + about + shift
    c = np.diag([1.0, 4.0, 9.0]) * 1e-12 if full else None
    found = rigid_motion(SPHERES, moved, covariance=c, about=about)
    assert found.angles == pytest.approx(angles, abs=1e-12)
    assert found.translation == pytest.approx(shift, abs=1e-15)
    tool = np.array([0.2, 0.1, -0.3])
    displacement, _ = found.point(tool)
    assert displacement == pytest.approx(R @ (tool - about) + about + shift - tool, abs=1e-13)


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_poses_together_equal_poses_one_by_one(seed: int) -> None:
    random = np.random.default_rng(seed)
    poses = SPHERES + 1e-6 * random.normal(size=(3, 2, 4, 3))
    c = np.array([np.diag(random.uniform(0.5, 2.0, 3)) for _ in range(4)]) * 1e-12
    together = rigid_motion(SPHERES, poses, covariance=c)
    alone = rigid_motion(SPHERES, poses[2, 1], covariance=c)
    assert together.angles[2, 1] == pytest.approx(alone.angles, abs=1e-14)
    assert together.covariance[2, 1] == pytest.approx(alone.covariance, rel=1e-9)
    assert together.chi_squared[2, 1] == pytest.approx(float(alone.chi_squared), rel=1e-6)
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
    assert float(b.chi_squared) == pytest.approx(float(a.chi_squared), rel=1e-6)


def test_the_weighted_fit_is_the_least_of_its_chi_squared() -> None:
    random = np.random.default_rng(4)
    c = np.array([np.diag(random.uniform(0.2, 5.0, 3)) for _ in range(4)]) * 1e-12
    c += 0.1e-12
    moved = SPHERES @ rotation(0.02, -0.03, 0.3).T + 1e-6 * random.normal(size=(4, 3))
    found = rigid_motion(SPHERES, moved, covariance=c, about=(0.0, 0.0, 0.0))

    def chi(turn: Array, shift: Array) -> float:
        R = rotation(*turn) @ found.rotation
        rest = moved - SPHERES @ R.T - found.translation - shift
        return float(np.einsum("ki,kij,kj->", rest, np.linalg.inv(c), rest))

    least = chi(np.zeros(3), np.zeros(3))
    assert least == pytest.approx(float(found.chi_squared), rel=1e-6)
    for step in np.eye(3):
        for sign in (1.0, -1.0):
            assert chi(sign * 1e-7 * step, np.zeros(3)) > least
            assert chi(np.zeros(3), sign * 1e-9 * step) > least


def test_covariance_and_chi_squared_are_those_of_repeated_noise() -> None:
    random = np.random.default_rng(21)
    c = np.array([np.diag([1.0, 2.3, 0.4]) * s for s in (1.0, 2.0, 0.5, 1.7)]) * 1e-12
    c[:, 0, 1] = c[:, 1, 0] = 0.5e-12
    roots = np.linalg.cholesky(c)
    noise = np.einsum("kij,...kj->...ki", roots, random.normal(size=(4000, 4, 3)))
    R = rotation(0.1, -0.2, 0.4)
    found = rigid_motion(SPHERES, SPHERES @ R.T + noise, covariance=c, about=(0.02, 0.0, 0.0))
    turns = np.stack(
        [(D - np.swapaxes(D, -1, -2))[..., i, j] / 2.0 for D in [found.rotation @ R.T]
         for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1)  # fmt: skip
    six = np.concatenate([found.translation, turns], axis=-1)
    expected, sample = found.covariance[0], np.cov(six.T)
    size = np.sqrt(np.diag(expected))
    assert sample / np.outer(size, size) == pytest.approx(expected / np.outer(size, size), abs=0.09)
    p = chdtrc(found.redundancy, found.chi_squared)
    assert found.redundancy == 6
    for level in (0.05, 0.5, 0.95):
        assert np.mean(p < level) == pytest.approx(level, abs=0.03)
    tool = np.array([0.1, -0.05, 0.03])
    moved, spread = found.point(tool)
    assert np.cov(moved.T) == pytest.approx(spread[0], abs=0.06 * np.trace(spread[0]))


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("poses", [1, 8])
def test_intervals_cover(known: bool, poses: int) -> None:
    noise, held, count = 0.3e-6, 0, 300
    R = rotation(12e-6, -40e-6, 25e-6)
    truth = np.concatenate([(R - np.eye(3)) @ SPHERES.mean(0) + 3e-6, (12e-6, -40e-6, 25e-6)])
    for seed in range(count):
        random = np.random.default_rng([3, seed])
        reference = SPHERES + noise * random.normal(size=(4, 3))
        moved = SPHERES @ R.T + 3e-6 + noise * random.normal(size=(poses, 4, 3))
        found = rigid_motion(reference, moved, covariance=2.0 * noise**2 if known else None)
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
        (lambda: rigid_motion(SPHERES, SPHERES, covariance=-1.0), ModelError, "positive"),
        (lambda: rigid_motion(SPHERES, SPHERES, covariance=np.ones(4)), ModelError, "shape"),
        (lambda: rigid_motion(SPHERES, SPHERES, weights=[1, 1, 1, 0]), ModelError, "weights"),
        (
            lambda: rigid_motion(SPHERES, SPHERES, weights=[1] * 4, covariance=1),
            ModelError,
            "no weights",
        ),
        (lambda: rigid_motion(SPHERES, SPHERES).estimate("tilt"), ModelError, "pitch"),  # type: ignore[arg-type]
        (lambda: travel_frame((0, 0, 2), (0, 0, 1)), ModelError, "parallel"),
    ],
)
def test_bad_input_is_one_sentence(call, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
