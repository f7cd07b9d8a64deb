"""Dimensions and figures inferred from a few figures: closed forms, brute force, hidden truths.

Evidence (Stages, tolerances, designs): spread after one more measurement, as predicted, against
another fit (integration): 1e-4

Evidence (Coverage of 95 % intervals): dimensions and figures of a reconstructed bridge, 200 hidden
ones: 93 to 98 % required, *simulated*
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from flexstage.base.errors import ModelError
from flexstage.measure.posterior import Posterior, most_probable
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore import Ensemble, Figure, Observation, dimension_of, reconstruct
from flexstage.studies.explore.ensemble import MODEL_ERROR
from flexstage.studies.explore.prepare import ready_reconstruct
from flexstage.studies.explore.requests import ReconstructRequest
from flexstage.studies.explore.variables import variables_of
from flexstage.studies.explore.workers import Workers
from tests.hidden_dimensions import cases
from tests.tiers import sizes

#: Standard deviation of the logarithm of a dimension of 20 %.
SIGMA = 0.5 * math.log(1.2 / 0.8)
STAGE = "parallelogram"
NECK = "leg.notch.neck_thickness"


class Linear:
    """Residuals of a linear model."""

    bent = False

    def __init__(self, matrix: np.ndarray, y: np.ndarray) -> None:
        self.matrix, self.y, self.size = matrix, y, matrix.shape[1]

    def residual(self, x):
        return self.y - self.matrix @ x

    residual_or_refused = residual

    def jacobian(self, x):
        del x
        return self.matrix


def found(given: dict[str, tuple[float, float]], free: tuple[str, ...], **settings) -> Ensemble:
    """Reconstruct the guide by the lumped model; an axis of its own for each figure."""
    template = StageTemplate.of(STAGE)
    figures = {"mass": "stage", "natural_frequency_hz": "x", "input_stiffness": "x"}
    values = [
        Observation(figure=Figure(quantity=q, axis=figures[q]), value=v, uncertainty=u)
        for q, (v, u) in given.items()
    ]
    dimensions = [dimension_of(v) for v in variables_of(template, free)]
    return reconstruct(template, values, dimensions, model="lumped", **settings)


def figures_of(ensemble: Ensemble) -> dict[str, float]:
    return dict(zip((f.name for f in ensemble.figures), ensemble.described.tolist(), strict=True))


def test_a_linear_model_has_the_posterior_of_a_kalman_filter():
    generator = np.random.default_rng(3)
    matrix, y = generator.normal(size=(4, 9)), generator.normal(size=4)
    gain = matrix.T @ np.linalg.inv(matrix @ matrix.T + np.eye(4))
    x, *_ = most_probable(Linear(matrix, y))
    posterior = Posterior.of(matrix)
    np.testing.assert_allclose(x, gain @ y, rtol=1e-9)
    np.testing.assert_allclose(posterior.covariance, np.eye(9) - gain @ matrix, atol=1e-12)
    s = np.linalg.svd(matrix, compute_uv=False)
    assert posterior.informed == pytest.approx(float((s**2 / (1.0 + s**2)).sum()), rel=1e-12)
    wanted, candidates = generator.normal(size=9), generator.normal(size=(3, 9))
    noise = np.array([0.1, 1.0, 1e-3])
    left = posterior.remaining(wanted, candidates, noise)
    for row, sigma, part in zip(candidates, noise, left, strict=True):
        more = Posterior.of(np.vstack([matrix, row / sigma]))
        ratio = more.spread(wanted[None])[0] / posterior.spread(wanted[None])[0]
        assert part == pytest.approx(ratio, rel=1e-6)


@pytest.mark.parametrize("share", [0.0, 0.02])
def test_thickness_from_mass_is_the_product_of_two_normal_distributions(share):
    # the mass of a plate is in proportion to its thickness
    described = StageTemplate.of(STAGE).stage()
    mass = sum(row.value for row in _characteristics(described) if row.quantity == "mass")
    seen = 1.15 * mass
    ensemble = found({"mass": (seen, share * seen)}, ("thickness=20 %",), members=0)
    noise = math.hypot(share, MODEL_ERROR)
    weights = np.array([1.0 / SIGMA**2, 1.0 / noise**2])
    spread = weights.sum() ** -0.5
    (row,) = ensemble.dimension_rows()
    middle = weights[1] * math.log(1.15) / weights.sum()
    assert math.log(row.median / row.dimension.median) == pytest.approx(middle, rel=1e-6)
    assert row.remaining == pytest.approx(spread / SIGMA, rel=1e-6)
    assert ensemble.learned["thickness"] == pytest.approx(1.0 - (spread / SIGMA) ** 2, rel=1e-6)
    assert math.log(row.high / row.low) == pytest.approx(2.0 * 1.959964 * spread, rel=1e-5)
    given = ensemble.figure("mass")
    assert given.kind == "given"
    assert math.log(given.median / mass) == pytest.approx(middle, rel=1e-6)


def _characteristics(stage):
    from flexstage.studies.models import analyse_model

    return analyse_model(stage, "lumped").characteristics


FREE = (f"{NECK}=20 %", "thickness=20 %", "leg.bar_length=15 %")


def test_the_best_next_measurement_narrows_as_much_as_it_says():
    free = FREE
    before = found({"natural_frequency_hz": (200.0, 1.0)}, free, members=0)
    wanted, candidate = "input_stiffness.x", "mass"
    mass = before.figure(candidate).median
    noise = 0.1 * mass
    (said,) = before.next(wanted, {candidate: math.hypot(noise, MODEL_ERROR * mass)})
    given = {"natural_frequency_hz": (200.0, 1.0), "mass": (mass, noise)}
    after = found(given, free, members=0)
    ratio = after.figure(wanted).laplace / before.figure(wanted).laplace
    assert 0.2 < said.remaining < 0.99
    assert ratio == pytest.approx(said.remaining, rel=1e-4)
    ranked = before.next(wanted)
    assert [m.remaining for m in ranked] == sorted(m.remaining for m in ranked)
    assert wanted not in {m.name for m in ranked}


def test_a_measured_dimension_narrows_as_much_as_it_says():
    given = {"natural_frequency_hz": (200.0, 1.0)}
    before = found(given, FREE, members=0)
    wanted, name, noise = "max_stress.x", "leg.bar_length", 0.5e-3
    (said,) = before.next(wanted, {name: noise})
    row = next(r for r in before.dimension_rows() if r.dimension.name == name)
    # what was known before, and the measurement, are one normal distribution
    weights = np.array([row.dimension.sigma**-2, (noise / row.median) ** -2])
    logarithms = np.array([math.log(row.dimension.median), math.log(row.median)])
    both = replace(
        row.dimension,
        median=math.exp(float(weights @ logarithms / weights.sum())),
        sigma=float(weights.sum() ** -0.5),
    )
    dimensions = [both if d.name == name else d for d in before.dimensions]
    after = reconstruct(before.template, before.observations, dimensions, model="lumped", members=0)
    ratio = after.figure(wanted).laplace / before.figure(wanted).laplace
    assert said.remaining < 0.9
    assert ratio == pytest.approx(said.remaining, rel=1e-4)


def test_thickness_is_not_learned_from_ratio_frequency_and_stress():
    free = ("thickness=12 %", "x.leg_neck=20 %", "x.lever_arm_output=20 %")
    request = ReconstructRequest(free=free, model="lumped", members=0)
    ensemble = ready_reconstruct(request, StageTemplate.of("vgtu-piezo"))(Workers(1))
    assert {o.figure.quantity for o in ensemble.observations} == {
        *("output_displacement", "max_stress", "natural_frequency_hz"),
    }
    assert ensemble.learned["thickness"] < 1e-6
    assert ensemble.learned["x.lever_arm_output"] > 0.9
    # the mass keeps the spread of the thickness, 12 %
    assert ensemble.figure("mass").laplace > 0.119


def test_members_agree_with_the_observation_ofs_and_are_repeatable():
    given = {"natural_frequency_hz": (200.0, 2.0)}
    free = (f"{NECK}=20 %", "leg.bar_length=20 %", "thickness=20 %", "leg_spacing=20 %")
    ensemble = found(given, free, members=25)
    again = found(given, free, members=40)
    np.testing.assert_array_equal(again.points[:25], ensemble.points)
    of = {f.name: i for i, f in enumerate(ensemble.figures)}
    frequency = ensemble.values[:, of["natural_frequency.x"]]
    spread = math.hypot(2.0, MODEL_ERROR * 200.0)
    assert np.abs(frequency - 200.0).max() < 4.0 * spread
    assert frequency.std() == pytest.approx(spread, rel=0.5)
    # the frequency does not know the thickness, which keeps its spread
    thickness = np.log(again.points[:, free.index("thickness=20 %")])
    assert thickness.std(ddof=1) == pytest.approx(SIGMA, rel=0.35)
    for member, values in zip(ensemble.members[:3], ensemble.values, strict=False):
        rows = {(r.quantity, r.axis): r.value for r in _characteristics(member)}
        assert rows["natural_frequency_hz", "x"] == pytest.approx(
            values[of["natural_frequency.x"]], rel=1e-9
        )


def test_no_member_begins_after_the_time_is_up():
    free = (f"{NECK}=20 %", "thickness=20 %")
    ensemble = found({"natural_frequency_hz": (200.0, 2.0)}, free, members=5, seconds=0.0)
    assert len(ensemble.points) == 0
    assert ensemble.requested == 5
    assert {row.by for row in ensemble.figure_rows()} == {"Laplace"}


def covered(count: int, seed: int, model: str, members: int) -> np.ndarray:
    """Return whether each range of each case has the truth, shape (count, 10)."""
    held = [case.held() for case in cases(count, seed=seed, model=model, members=members)]
    return np.array([list(of.values()) for of in held])


def test_hidden_dimensions_are_within_their_ranges():
    held = covered(12, 7, "lumped", 0)
    # ranges of one bridge go together: each of the ten is counted by itself
    least = binom.ppf(0.00135, 12, 0.95)
    assert held.sum(axis=0).min() >= least
    assert held.mean() >= 0.9


@pytest.mark.parametrize(
    ("count", "model", "members"),
    sizes(slow=(16, "lumped", 40), evidence=(200, "lumped", 60)),
)
def test_as_many_hidden_bridges_are_within_their_ranges_as_stated(count, model, members):
    held = covered(count, 11, model, members)
    error = 3.0 * math.sqrt(0.05 * 0.95 / count)
    assert 0.95 - error < held.mean() < 0.985 + error
    assert held.mean(axis=0).min() > 0.95 - 1.5 * error


@pytest.mark.parametrize("count", sizes(slow=(3,), evidence=(40,)))
def test_hidden_bridges_of_finite_elements_are_within_their_ranges(count):
    held = covered(count, 12, "superelement", 0)
    assert held.sum(axis=0).min() >= binom.ppf(0.00135, count, 0.95)
    # the ten ranges of a bridge go together: they count as one
    assert held.mean() > 0.95 - 3.0 * math.sqrt(0.05 * 0.95 / count)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"match": ("mass = 0 g",)}, "mass = 0 needs an uncertainty"),
        ({"match": ("mass <= 50 g",)}, "needs a figure and its value"),
        ({"match": ("mass = 50 g", "mass = 51 g")}, "mass is given twice"),
        ({}, "no published finite-element values of parallelogram"),
        ({"match": ("thermal_drift.x = 1 nm/K",)}, "there is no figure"),
        ({"match": ("mass = 50 g",), "free": ("nothing=20 %",)}, "has no parameter 'nothing'"),
        ({"match": ("mass = 50 g",), "members": -1}, "members must be a whole number from 0"),
    ],
)
def test_bad_input_is_refused_with_a_reason(words, said):
    with pytest.raises(ModelError, match=said):
        ready_reconstruct(ReconstructRequest(model="lumped", **words), StageTemplate.of(STAGE))


def test_a_range_over_zero_has_no_logarithm():
    (variable,) = variables_of(StageTemplate.of(STAGE), ["thickness=20 %"])
    with pytest.raises(ModelError, match="contains 0"):
        dimension_of(replace(variable, low=-1e-3))
