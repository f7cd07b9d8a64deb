"""Local search on problems whose optimum and multipliers are published or have a closed form."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from flexstage.studies.explore.optimise.local_search import (
    MARGIN,
    Iterate,
    bounded_step,
    find_boundary,
    local_search,
    smallest_quadratic,
)
from flexstage.studies.explore.optimise.optimum import balance
from flexstage.studies.explore.optimise.problem import Correction

Function = Callable[[np.ndarray], float]
INF = np.inf


class Textbook:
    """A problem of functions, its variables from 0 to 1 between their bounds."""

    def __init__(
        self,
        objective: Function,
        constraints: Sequence[Function],
        limits: tuple[Sequence[float], Sequence[float]],
        bounds: tuple[Sequence[float], Sequence[float]],
        possible: Callable[[np.ndarray], bool] = lambda x: True,
    ) -> None:
        self.functions = (objective, *constraints)
        self.low, self.high = (np.array(limit, dtype=float) for limit in limits)
        self.least, most = (np.array(bound, dtype=float) for bound in bounds)
        self.width = most - self.least
        self._possible = possible

    def point(self, u: np.ndarray) -> np.ndarray:
        return self.least + u * self.width

    def values(self, points: np.ndarray) -> np.ndarray:
        none = np.full(len(self.functions), np.nan)
        found = [
            np.array([f(x) for f in self.functions]) if self._possible(x) else none
            for x in map(self.point, points)
        ]
        return np.array(found)

    def slopes(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        step = 1e-6 * np.eye(len(point))
        above, below = self.values(point + step), self.values(point - step)
        # to one side where the other is impossible
        here = self.values(point[None])[0]
        above = np.where(np.isnan(above), 2.0 * here - below, above)
        below = np.where(np.isnan(below), 2.0 * here - above, below)
        return here, ((above - below) / 2e-6).T

    def possible(self, points: np.ndarray) -> np.ndarray:
        return np.array([self._possible(self.point(p)) for p in points])


# Hock, Schittkowski (1981), Test Examples for Nonlinear Programming Codes, Lecture Notes in
# Economics and Mathematical Systems 187: number, functions, start, published optimum.
HS43 = Textbook(
    lambda x: (
        x[0] ** 2
        + x[1] ** 2
        + 2 * x[2] ** 2
        + x[3] ** 2
        - 5 * x[0]
        - 5 * x[1]
        - 21 * x[2]
        + 7 * x[3]
    ),
    (
        lambda x: 8 - x @ x - x[0] + x[1] - x[2] + x[3],
        lambda x: 10 - x[0] ** 2 - 2 * x[1] ** 2 - x[2] ** 2 - 2 * x[3] ** 2 + x[0] + x[3],
        lambda x: 5 - 2 * x[0] ** 2 - x[1] ** 2 - x[2] ** 2 - 2 * x[0] + x[1] + x[3],
    ),
    ([0.0] * 3, [INF] * 3),
    ([-4.0] * 4, [5.0] * 4),
)
HS71 = Textbook(
    lambda x: x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2],
    (lambda x: float(np.prod(x)), lambda x: float(x @ x)),
    ([25.0, 40.0], [INF, 40.0]),
    ([1.0] * 4, [5.0] * 4),
)
HS100 = Textbook(
    lambda x: (
        (x[0] - 10) ** 2
        + 5 * (x[1] - 12) ** 2
        + x[2] ** 4
        + 3 * (x[3] - 11) ** 2
        + 10 * x[4] ** 6
        + 7 * x[5] ** 2
        + x[6] ** 4
        - 4 * x[5] * x[6]
        - 10 * x[5]
        - 8 * x[6]
    ),
    (
        lambda x: 127 - 2 * x[0] ** 2 - 3 * x[1] ** 4 - x[2] - 4 * x[3] ** 2 - 5 * x[4],
        lambda x: 282 - 7 * x[0] - 3 * x[1] - 10 * x[2] ** 2 - x[3] + x[4],
        lambda x: 196 - 23 * x[0] - x[1] ** 2 - 6 * x[5] ** 2 + 8 * x[6],
        lambda x: (
            -4 * x[0] ** 2 - x[1] ** 2 + 3 * x[0] * x[1] - 2 * x[2] ** 2 - 5 * x[5] + 11 * x[6]
        ),
    ),
    ([0.0] * 4, [INF] * 4),
    ([-10.0] * 7, [11.0] * 7),
)
ONE, TWO, FOUR = np.array([1.0]), np.array([2.0]), np.array([4.0])


@pytest.mark.parametrize(
    ("program", "start", "optimum", "best"),
    [
        (HS43, [0.0] * 4, [0.0, 1.0, 2.0, -1.0], -44.0),
        (HS71, [1.0, 5.0, 5.0, 1.0], [1.0, 4.7429994, 3.8211503, 1.3794082], 17.0140173),
        (
            HS100,
            [1.0, 2.0, 0.0, 4.0, 0.0, 1.0, 1.0],
            [2.330499, 1.951372, -0.4775414, 4.365726, -0.6244870, 1.038131, 1.594227],
            680.6300573,
        ),
    ],
    ids=["HS43", "HS71", "HS100"],
)
def test_published_optimum(
    program: Textbook, start: list[float], optimum: list[float], best: float
) -> None:
    found = local_search(program, (np.array(start) - program.least) / program.width, tolerance=1e-9)
    assert found is not None
    assert found.converged
    assert found.feasible
    assert found.values[0] == pytest.approx(best, rel=1e-7)
    assert program.point(found.point) == pytest.approx(np.array(optimum), abs=2e-4)


def test_published_multipliers() -> None:
    # HS43: 1, 0, 2; HS71 as solvers print them: 0.5522937 of the product, -0.1614686 of the sum
    for program, start, active, published in (
        (HS43, [0.5, 0.4, 0.6, 0.3], [1, 3], [1.0, 2.0]),
        (HS71, [0.1, 0.9, 0.8, 0.2], [1, 2], [0.5522937, -0.1614686]),
    ):
        found = local_search(program, np.array(start), tolerance=1e-10)
        assert found is not None
        slopes = found.slopes / program.width
        bound = -np.eye(4)[found.point < 1e-6]
        normals = np.vstack([-slopes[active], slopes[active], bound])
        multipliers, left = balance(slopes[0], normals)
        assert multipliers[:2] - multipliers[2:4] == pytest.approx(published, abs=2e-4)
        assert left < 1e-4


def test_multiplier_is_what_a_moved_limit_gives() -> None:
    """The optimum of HS43 with its first limit moved by 0.01, against its multiplier of 1."""
    moved = Textbook(
        HS43.functions[0],
        HS43.functions[1:],
        ([-0.01, 0.0, 0.0], [INF] * 3),
        ([-4.0] * 4, [5.0] * 4),
    )
    found = local_search(moved, np.array([0.45, 0.5, 0.6, 0.4]), tolerance=1e-10)
    assert found is not None
    assert (found.values[0] + 44.0) / 0.01 == pytest.approx(-1.0, rel=0.01)


def test_nearest_point_on_an_equation() -> None:
    """The point nearest to the start on x y = 0.3, by the known curvature of the distance."""
    start = np.array([0.2, 0.9])
    program = Textbook(
        lambda x: 0.5 * float(np.sum((x - start) ** 2)),
        (lambda x: float(x[0] * x[1]),),
        ([0.3], [0.3]),
        ([0.0] * 2, [1.0] * 2),
    )
    found = local_search(program, start, curvature=np.eye(2), tolerance=1e-10)
    assert found is not None
    x, y = found.point
    assert x * y == pytest.approx(0.3, abs=1e-7)
    # the way there is along the gradient (y, x)
    assert (x - 0.2) * x == pytest.approx((y - 0.9) * y, abs=1e-5)


def test_plane_walls_are_found_and_kept() -> None:
    program = Textbook(
        lambda x: -1.3 * x[0] - x[1],
        (),
        ([], []),
        ([0.0] * 3, [1.0] * 3),
        lambda x: 3 * x[0] + 4 * x[1] + 0.5 * x[2] <= 3.5 and x[0] - 0.2 * x[1] <= 0.6,
    )
    found = local_search(program, np.array([0.2, 0.15, 0.4]))
    assert found is not None
    # the corner of both walls, at x[2] = 0: x = 0.6 + 0.2 y, 3 x + 4 y = 3.5
    y = 1.7 / 4.6
    assert found.point == pytest.approx([0.6 + 0.2 * y, y, 0.0], abs=5 * MARGIN)
    normals = sorted(tuple(np.round(wall.normal, 2)) for wall in found.boundaries)
    assert normals == [(0.6, 0.8, 0.1), (0.98, -0.2, 0.0)]


def test_a_start_in_the_corner_of_two_walls_goes_on() -> None:
    """What lies beyond a corner tells neither wall from the other: it is left first."""
    program = Textbook(
        lambda x: -x[0] - 1.1 * x[2],
        (),
        ([], []),
        ([0.0] * 4, [1.0] * 4),
        lambda x: 3 * x[0] - x[1] <= 0.7 + 1e-9 and 4 * x[2] - x[3] <= 0.9 + 1e-9,
    )
    # both described as small as they may be, as two links that have their least length
    found = local_search(program, np.array([0.4, 0.5, 0.35, 0.5]))
    assert found is not None
    assert found.converged
    # it slides along both until their other variables end
    assert found.point == pytest.approx([1.7 / 3.0, 1.0, 1.9 / 4.0, 1.0], abs=5 * MARGIN)
    assert len(found.boundaries) == 2


def test_wall_is_no_limit_that_gives_way() -> None:
    """An equation that only impossible points meet: the search ends at the wall, in few steps."""
    program = Textbook(
        lambda x: 0.5 * float(np.sum((x - 0.8) ** 2)),
        (lambda x: float(x[0] + 0.3 * x[1]),),
        ([0.2], [0.2]),
        ([0.0] * 2, [1.0] * 2),
        lambda x: x[0] + 0.1 * x[1] >= 0.4,
    )
    path: list[Iterate] = []
    start = np.array([0.8, 0.8])
    found = local_search(program, start, curvature=np.eye(2), on_iterate=path.append)
    assert found is not None
    assert len(found.boundaries) == 1
    assert len(path) < 15
    # along the wall the equation is missed least at x[1] = 0
    assert found.point == pytest.approx([0.4, 0.0], abs=5 * MARGIN)


def test_curved_wall_is_followed() -> None:
    program = Textbook(
        lambda x: float(np.sum((x - 1.0) ** 2)),
        (),
        ([], []),
        ([0.0] * 2, [1.0] * 2),
        lambda x: x @ x <= 1.0,
    )
    found = local_search(program, np.array([0.2, 0.3]))
    assert found is not None
    assert found.values[0] == pytest.approx(2.0 * (1.0 - 0.5**0.5) ** 2, abs=3e-4)


def test_contradicting_limits_are_missed_by_the_least() -> None:
    program = Textbook(
        lambda x: x[0],
        (lambda x: x[0] ** 2 + x[1], lambda x: x[0] ** 2 + x[1]),
        ([0.5, 0.9], [0.5, 0.9]),
        ([0.0] * 2, [1.0] * 2),
    )
    found = local_search(program, np.array([0.2, 0.3]))
    assert found is not None
    assert not found.feasible
    assert found.violation == pytest.approx(0.4, abs=1e-6)


def test_impossible_start_is_none() -> None:
    program = Textbook(lambda x: x[0], (), ([], []), ([0.0], [1.0]), lambda x: False)
    assert local_search(program, np.array([0.5])) is None


def test_quadratic_step_against_another_solver() -> None:
    """Random convex steps against SciPy's SLSQP."""
    from scipy.optimize import minimize

    random = np.random.default_rng(7)
    for _ in range(20):
        d, m = 6, 9
        root = random.normal(size=(d, d))
        B, g = root @ root.T + 0.1 * np.eye(d), random.normal(size=d)
        G, h = random.normal(size=(m, d)), -random.uniform(0.0, 1.0, m)
        found = smallest_quadratic(B, g, G, h)
        assert found is not None
        peer = minimize(
            lambda p, B=B, g=g: 0.5 * p @ B @ p + g @ p,
            np.zeros(d),
            jac=lambda p, B=B, g=g: B @ p + g,
            constraints={
                "type": "ineq",
                "fun": lambda p, G=G, h=h: G @ p - h,
                "jac": lambda p, G=G: G,
            },
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert found.step == pytest.approx(peer.x, abs=1e-6)
        assert B @ found.step + g == pytest.approx(G.T @ found.multipliers, abs=1e-8)
    assert (
        smallest_quadratic(np.eye(1), ONE, np.array([[1.0], [-1.0]]), np.array([1.0, 1.0])) is None
    )


def test_step_gives_way_where_limits_contradict() -> None:
    """p = 1 and p = 2 at once: about half-way, and no multipliers to believe."""
    A, limit = np.array([[1.0], [1.0]]), np.array([1.0, 2.0])
    found = bounded_step(np.eye(1), ONE, A, limit, limit, -FOUR, FOUR)
    assert found is not None
    assert found.step == pytest.approx([1.5], abs=0.16)
    assert found.relaxed


def test_limit_that_no_step_moves() -> None:
    """A row of zeros, kept or not: it changes nothing of the step."""
    for limit, reached in ((-0.5, 0.3), (0.5, 0.27)):
        low = np.array([0.3, limit])
        A = np.array([[1.0, 0.5], [0.0, 0.0]])
        high = np.full(2, INF)
        box = np.full(2, 0.7)
        found = bounded_step(np.eye(2), np.zeros(2), A, low, high, -box, box)
        assert found is not None
        assert found.step == pytest.approx(reached * A[0] / (A[0] @ A[0]), abs=1e-6)


def test_correction_is_exact_at_its_points_and_learns_a_slope() -> None:
    """A fine model that is a power law times the coarse one, along one direction."""
    a, b = np.array([0.4, 0.3]), np.array([0.5, 0.35])
    coarse = {1: np.array([120.0, -1e-15]), 2: np.array([131.0, 2e-15])}
    fine = {1: np.array([110.0, 0.02]), 2: np.array([126.0, 0.03])}
    first = Correction.none(2, 2).updated(a, coarse[1], fine[1])
    second = first.updated(b, coarse[2], fine[2])
    assert first.at_points(a[None], coarse[1][None])[0] == pytest.approx(fine[1])
    for at, n in ((a, 1), (b, 2)):
        assert second.at_points(at[None], coarse[n][None])[0] == pytest.approx(fine[n])
    slopes = np.array([[3.0, -2.0], [0.1, 0.2]])
    values, corrected = second.of_slopes(b, coarse[2], slopes)
    step = 1e-6
    for j, way in enumerate(np.eye(2)):
        ahead = second.at_points((b + step * way)[None], (coarse[2] + step * slopes[:, j])[None])[0]
        assert corrected[:, j] == pytest.approx((ahead - values) / step, rel=1e-4)


def test_wall_across_no_single_variable_is_none() -> None:
    inside, step = np.array([0.2, 0.2]), np.array([0.5, 0.5])
    assert find_boundary(lambda x: np.ones(len(x), dtype=bool), inside, 1e-8 * step) is None
