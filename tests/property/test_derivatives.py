"""Analytic derivatives of every figure against differences of whole analyses, on every topology."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import eigh

from flexstage.base.errors import FlexstageError, ModelError
from flexstage.lumped import (
    assemble_batch,
    lumped_system,
    parameter_tangents,
    stage_arrays,
    system_tangents,
)
from flexstage.stage import Stage
from flexstage.stage.designs import DESIGNS, StageTemplate, design
from flexstage.studies.explore.family import Family, jacobian
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.variables import every_variable
from flexstage.system import analyse, characteristic_derivatives, modes
from flexstage.system.characteristics import MODES_SEARCHED, axis_states, every_characteristic
from tests.varied_stages import rounding, tangents_of_necks, varied

# What is asked for, of the derivative or of the figure over the parameter, whichever is larger.
_ASKED = 1e-6
# Rounding of a single analysis where stiff directions cancel in soft modes: a part of frequencies,
# and more of the shapes of modes 1 % apart, as three-rrr has them. Differences divide it by a step.
_LOST = {"natural_frequency_hz": 1e-10, "effective_mass": 2e-9}
# Derivatives from the two sides that differ by more than this are a kink, or a jump.
_KINK = 1e-4
_CENTRAL = {1: 8.0, -1: -8.0, 2: -1.0, -2: 1.0}
_AHEAD = {0: -25.0, 1: 48.0, 2: -36.0, 3: 16.0, 4: -3.0}
_BEHIND = {-k: -w for k, w in _AHEAD.items()}


def _figures(stage: Stage) -> dict[tuple[str, str], float]:
    """The characteristics of an analysis, without its responses."""
    system = lumped_system(stage)
    removed = modes(system, count=MODES_SEARCHED)
    rows = every_characteristic(stage, system, axis_states(stage, system), removed)
    return {(row.quantity, row.axis): row.value for row in rows}


class _Differences:
    """Fourth-order differences of whole analyses about a value, for several steps."""

    def __init__(self, build: Callable[[float], Stage], value: float, steps: list[float]) -> None:
        self.build, self.value, self.steps = build, value, steps
        self.known: dict[float, dict[tuple[str, str], float]] = {}
        self.weights = next(w for w in (_CENTRAL, _BEHIND, _AHEAD) if self._reaches(w))

    def _reaches(self, weights: dict[int, float]) -> bool:
        try:
            for k in weights:
                self.at(k, self.steps[0])
        except FlexstageError:
            return False
        return True

    def at(self, k: int, step: float) -> dict[tuple[str, str], float]:
        x = self.value + k * step
        if x not in self.known:
            self.known[x] = _figures(self.build(x))
        return self.known[x]

    def slope(self, key: tuple[str, str], step: float) -> float:
        return sum(w * self.at(k, step)[key] for k, w in self.weights.items()) / (12.0 * step)

    def sides(self, key: tuple[str, str]) -> tuple[float, float]:
        """Second-order derivatives to either side."""
        h = self.steps[-1]
        f = {k: self.at(k, h)[key] for k in (0, 1, -1, 2, -2)}
        ahead = (4.0 * f[1] - f[2] - 3.0 * f[0]) / (2.0 * h)
        return ahead, -(4.0 * f[-1] - f[-2] - 3.0 * f[0]) / (2.0 * h)


def _compare(
    found: dict[tuple[str, str], float], by: _Differences, scale: float, at: str
) -> tuple[int, int]:
    """Compare derivatives by one parameter, and count figures that differences do and do not show.

    Of all steps those two beside each other that agree best are where neither the fourth power of
    the step nor the rounding of an analysis over it counts; where even they differ by more than
    is asked for, nothing is said.
    """
    figures = by.at(0, by.steps[0])
    shown = open_ = 0
    assert set(found) == set(figures)
    for key, slope in found.items():
        size = max(abs(figures[key]) / scale, abs(slope))
        noise = (rounding(key[0]) + _LOST.get(key[0], 0.0) * abs(figures[key])) / by.steps[-1]
        allowed = _ASKED * size + noise
        if by.weights is _CENTRAL:
            sides = by.sides(key)
            if abs(sides[0] - sides[1]) > _KINK * size + 8.0 * noise:
                # the largest of two, of which either may be active, or two modes that swap
                open_ += 1
                continue
        slopes = [by.slope(key, step) for step in by.steps]
        spread = [abs(a - b) for a, b in pairwise(slopes)]
        best = int(np.argmin(spread))
        if spread[best] > allowed:
            open_ += 1
            continue
        shown += 1
        assert slope == pytest.approx(slopes[best + 1], rel=0.0, abs=allowed), (at, key)
    return shown, open_


def _every_parameter(name: str, chosen: slice) -> None:
    template = StageTemplate.of(name)
    shown = open_ = 0
    variables = every_variable(template)[chosen]
    assert variables
    for variable in variables:
        family = Family(template=template, variables=(variable,))

        def build(x: float, family: Family = family) -> Stage:
            return family.stage(np.array([x]))

        tangents = parameter_tangents(build, variable.usual, name=variable.name)
        slopes = characteristic_derivatives(*system_tangents(tangents))
        one = {key: float(value[0]) for key, value in slopes.items()}
        scale = abs(variable.usual)
        by = _Differences(build, variable.usual, [1e-3 * scale, 5e-4 * scale, 2.5e-4 * scale])
        a, b = _compare(one, by, scale, variable.name)
        shown, open_ = shown + a, open_ + b
    assert open_ <= 0.05 * (shown + open_)


@pytest.mark.parametrize(
    ("name", "chosen"),
    [
        ("vgtu-piezo", slice(3, 40, 14)),
        ("three-rrr", slice(0, 20, 5)),
        ("gantry", slice(0, None, 3)),
        ("scott-russell", slice(0, 22, 6)),
        ("cartwheel", slice(1, 15, 4)),
    ],
)
def test_derivatives_by_parameters_of_a_design(name: str, chosen: slice) -> None:
    # gantry: two modes of one frequency; three-rrr: three drives move every axis
    _every_parameter(name, chosen)


@pytest.mark.slow
@pytest.mark.parametrize("name", DESIGNS)
def test_derivatives_by_parameters_of_every_design(name: str) -> None:
    # every second one: of two axes that are made alike, and of necks and lengths in turn
    _every_parameter(name, slice(None, None, 2))


def _every_hinge(name: str, chosen: slice) -> None:
    stage = varied(design(name), 3)
    arrays = stage_arrays([stage])
    shown = open_ = 0

    def one(
        build: Callable[[float], Stage], value: float, step: float | None = None
    ) -> dict[tuple[str, str], float]:
        tangents = parameter_tangents(build, value, step=step, arrays=arrays)
        slopes = characteristic_derivatives(*system_tangents(tangents))
        return {key: float(slope[0]) for key, slope in slopes.items()}

    def put(i: int, **changed: object) -> Stage:
        hinges = list(stage.hinges)
        hinges[i] = replace(hinges[i], **changed)
        return replace(stage, hinges=tuple(hinges))

    for i in range(len(stage.hinges))[chosen]:
        hinge = stage.hinges[i]
        (x, y), profile = hinge.at, hinge.profile
        neck, length = profile.neck_thickness, profile.length
        # on their edges the roots are found to a micrometre
        ways = {
            "neck_thickness": (
                lambda t, i=i, p=profile: put(i, profile=replace(p, neck_thickness=t)),
                neck,
                neck,
                [4e-4 * neck, 2e-4 * neck],
            ),
            "x": (lambda x, i=i, y=y: put(i, at=(x, y)), x, length, [4e-7, 2e-7]),
            "y": (lambda y, i=i, x=x: put(i, at=(x, y)), y, length, [4e-7, 2e-7]),
            "direction": (
                lambda a, i=i: put(i, direction=a),
                hinge.direction,
                1.0,
                [1e-4, 5e-5],
            ),
        }
        for parameter, (build, value, scale, steps) in ways.items():
            a, b = _compare(
                one(build, value, None if parameter == "neck_thickness" else steps[1]),
                _Differences(build, value, steps),
                scale,
                f"{hinge.name}.{parameter}",
            )
            shown, open_ = shown + a, open_ + b
    for parameter in ("thickness", "youngs_modulus", "density"):
        of_stage = parameter == "thickness"
        value = stage.thickness if of_stage else getattr(stage.material, parameter)

        def build(v: float, parameter: str = parameter, of_stage: bool = of_stage) -> Stage:
            if of_stage:
                return replace(stage, thickness=v)
            return replace(stage, material=replace(stage.material, **{parameter: v}))

        by = _Differences(build, value, [1e-3 * value, 5e-4 * value])
        a, b = _compare(one(build, value), by, value, parameter)
        shown, open_ = shown + a, open_ + b
    assert open_ <= 0.25 * (shown + open_)


@pytest.mark.parametrize(
    ("name", "chosen"), [("vgtu-piezo", slice(5, 6)), ("bridge", slice(1, 12, 5))]
)
def test_derivatives_by_what_a_hinge_is_on_its_own(name: str, chosen: slice) -> None:
    _every_hinge(name, chosen)


@pytest.mark.slow
@pytest.mark.parametrize("name", DESIGNS)
def test_derivatives_by_what_hinges_of_every_design_are_on_their_own(name: str) -> None:
    _every_hinge(name, slice(None, None, 6))


def test_of_two_modes_of_one_frequency_any_mixture_gives_the_same(monkeypatch) -> None:
    stage = design("gantry")
    modes = analyse(stage, lumped_system(stage)).modes["removed"].frequency_hz
    assert modes[0] == pytest.approx(modes[1], rel=1e-9)
    batch, slopes = system_tangents(tangents_of_necks(stage))
    keys = [(name, axis) for name in ("natural_frequency_hz", "effective_mass") for axis in "xy"]
    found = characteristic_derivatives(batch, slopes, keys)

    def mixed(*matrices, **options):
        values, shapes = eigh(*matrices, **options)
        c, s = np.cos(0.4), np.sin(0.4)
        shapes[:, :2] = shapes[:, :2] @ np.array([[c, -s], [s, c]])
        return values, shapes

    monkeypatch.setattr("flexstage.system.derivatives.eigh", mixed)
    again = characteristic_derivatives(batch, slopes, keys)
    for key in keys:
        size = np.abs(found[key]).max()
        np.testing.assert_allclose(again[key], found[key], rtol=1e-6, atol=1e-8 * size)


def test_derivatives_are_those_of_one_stage_and_of_figures_that_are_known() -> None:
    stage = design("parallelogram")
    batch, slopes = system_tangents(tangents_of_necks(stage))
    with pytest.raises(ModelError, match="those of one stage, got 2 samples"):
        characteristic_derivatives(assemble_batch(stage_arrays([stage, stage])), slopes)
    with pytest.raises(ModelError, match="does not give stroke of x"):
        characteristic_derivatives(batch, slopes, [("stroke", "x")])
    with pytest.raises(ModelError, match="step of parameter 'neck' must be positive"):
        parameter_tangents(lambda _: stage, 0.0, name="neck")


def test_a_search_is_given_the_analytic_slopes() -> None:
    template = StageTemplate.of("three-rrr")
    family = Family(template=template, variables=every_variable(template)[:4])
    keys = ("natural_frequency_hz", "theta"), ("max_stress", "stage"), ("condition_number", "stage")
    # the narrowest slot is no figure of the batch: it comes by differences
    figures = [Figure(quantity=q, axis=a) for q, a in (*keys, ("smallest_slot", "stage"))]
    values, slopes = jacobian(family, family.usual, figures)
    assert np.isfinite(slopes).all()
    for j, variable in enumerate(family.variables):

        def build(x: float, j: int = j) -> Stage:
            return family.stage(np.where(np.arange(4) == j, x, family.usual))

        tangents = parameter_tangents(build, variable.usual)
        found = characteristic_derivatives(*system_tangents(tangents), keys)
        for k, key in enumerate(keys):
            size = max(abs(values[k] / variable.usual), abs(found[key][0]))
            assert slopes[k, j] == pytest.approx(found[key][0], rel=0.0, abs=1e-7 * size)
