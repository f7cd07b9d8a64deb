"""Hysteresis in C against the models of flexstage: the same numbers, bit for bit.

Evidence (Exported files): hysteresis in C (Python; DOP853 of `scipy`): same bits; $10^{-9}$
"""

import re

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.hysteresis import MODELS, BoucWen, Dahl
from flexstage.hysteresis.chain.element import values_at_samples
from flexstage.hysteresis.model import Array, HysteresisModel
from flexstage.hysteresis.models.registry import hysteresis_code
from tests.c_hysteresis import (
    CASES,
    Compiled,
    asymmetric,
    bouc_wen,
    duhem,
    generalised,
    maxwell,
    modified,
    prandtl,
    preisach,
    table,
    walk,
)

CLOSED = [name for name, model in CASES.items() if hysteresis_code(model).pieces]


def stepped(model: HysteresisModel, u: Array, state: Array) -> tuple[Array, Array]:
    """Outputs and last state of a model in Python, one sample at a time."""
    values = np.empty_like(u)
    for i in range(u.size):
        response = model.simulate(u[i : i + 1], state)
        values[i], state = response.values[0], response.state
    return values, state


def inputs(model: HysteresisModel, seed: int, count: int) -> Array:
    u = walk(seed, count)
    # Back at no voltage at all, a Maxwell-slip model in Python refuses the rounding of its state.
    return np.where(np.abs(u) < 1e-3, 0.37, u) if model.kind == "maxwell-slip" else u


def test_every_kind_of_model_has_code_and_a_case() -> None:
    assert {model.kind for model in CASES.values()} == set(MODELS)


def test_a_model_of_an_unknown_kind_is_refused_by_name() -> None:
    class Other(BoucWen):
        kind = "other"

    with pytest.raises(
        ModelError, match="no C code for hysteresis of the kind 'other': use one of"
    ):
        hysteresis_code(Other(gain=1.0, hysteresis_gain=0.3, beta=0.1, gamma=0.02))


@pytest.mark.parametrize("name", CASES)
def test_outputs_and_memory_are_those_of_python_bit_for_bit(name: str) -> None:
    # Both take exponentials and logarithms from the C library of this machine.
    model, compiled = CASES[name], Compiled(CASES[name])
    u = inputs(model, 11, 1000)
    expected, state = stepped(model, u, model.initial_state())
    np.testing.assert_array_equal(compiled.moves(u), expected)
    np.testing.assert_array_equal(compiled.memory, state)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_outputs_and_memory_are_those_of_python_on_long_walks(name: str) -> None:
    model, compiled = CASES[name], Compiled(CASES[name])
    state = model.initial_state()
    for seed in (12, 13):
        # whole numbers, too: plays stop on knots, inputs turn where they turned before
        u = inputs(model, seed, 10_000)
        u = np.where(np.arange(u.size) % 7 < 4, np.round(u), u) if seed == 13 else u
        if model.kind == "preisach":
            # at once, plays that stop on knots differ by rounding from those of single samples
            expected, state = stepped(model, u, state)
        else:
            response = model.simulate(u, state)
            expected, state = response.values, response.state
        np.testing.assert_array_equal(compiled.moves(u), expected)
        np.testing.assert_array_equal(compiled.memory, state)


@pytest.mark.parametrize("name", CLOSED)
def test_pieces_are_those_of_python_bit_for_bit(name: str) -> None:
    model, compiled = CASES[name], Compiled(CASES[name])
    state = model.initial_state()
    most = 0
    for u in inputs(model, 17, 300).tolist():
        expected = model.segments(np.array([state[0], u]), state)
        assert expected is not None
        count, pieces, value = compiled.line(u)
        np.testing.assert_array_equal(pieces, table(expected))
        np.testing.assert_array_equal(compiled.memory, expected.state)
        assert value == values_at_samples(expected)[-1]
        state, most = expected.state, max(most, count)
    assert most <= compiled.code.pieces


@pytest.mark.parametrize("name", CLOSED)
def test_lines_and_moves_lead_to_the_same_outputs(name: str) -> None:
    by_lines, by_moves = Compiled(CASES[name]), Compiled(CASES[name])
    u = inputs(CASES[name], 19, 5000)
    expected = by_moves.moves(u)
    # Pieces are added up along a line: some roundings of the largest output for each knot.
    tolerance = 1e-14 * np.abs(expected).max()
    np.testing.assert_allclose(by_lines.lines(u), expected, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("name", [n for n in CASES if n not in CLOSED])
def test_models_without_closed_form_have_no_pieces_in_python_either(name: str) -> None:
    assert CASES[name].segments([1.0, 7.0]) is None


@pytest.mark.parametrize(
    "model", [preisach(8, 31, 12), prandtl(4, 23), generalised(1.0), bouc_wen(1.0)]
)
def test_room_for_the_largest_number_of_pieces_is_needed_and_enough(model) -> None:
    compiled = Compiled(model)
    # Far down, then far up: every play starts, and passes every knot; h passes zero, u the centre.
    compiled.line(-3e3)
    before = compiled.memory.copy()
    most = compiled.line(3e3)[0]
    # The centre and h = 0 can be passed in one step, but not h = 0 on both sides of the centre.
    spare = 1 if model.kind == "generalised-bouc-wen" else 0
    plays = model.thresholds[:1] == 0.0 if model.kind == "preisach" else np.zeros(1, bool)
    # A play without a gap moves at once: it does not start a piece of its own.
    assert most == compiled.code.pieces - spare - int(plays[0])
    compiled.memory[:] = before
    assert compiled.line(3e3, room=most - 1)[0] == -1
    np.testing.assert_array_equal(compiled.memory, before)


def test_room_for_every_kink_after_plays_is_needed() -> None:
    model = modified(7, 6)
    compiled = Compiled(model)
    compiled.line(-130.0)
    before = compiled.memory.copy()
    # 6 plays that start, and 5 knots that are passed once: the bound holds for falling sums, too.
    assert compiled.code.pieces == 7 * 6
    assert compiled.line(3e3, room=41)[0] == -1
    np.testing.assert_array_equal(compiled.memory, before)
    assert compiled.line(3e3)[0] == 1 + 6 + 5


def test_more_plays_than_there_is_room_for_are_refused_and_not_written() -> None:
    model = prandtl(9, 300)
    compiled = Compiled(model)
    assert compiled.line(40.0)[0] == -1
    # Moves need no room.
    u = inputs(model, 23, 300)
    np.testing.assert_array_equal(compiled.moves(u), stepped(model, u, model.initial_state())[0])


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("u", [np.nan, np.inf, -np.inf])
def test_an_input_that_is_not_finite_gives_no_number_and_leaves_the_memory(
    name: str, u: float
) -> None:
    compiled = Compiled(CASES[name])
    compiled.moves(np.array([50.0, 31.0]))
    before = compiled.memory.copy()
    assert not np.isfinite(compiled.moves(np.array([u]))[0])
    if compiled.code.pieces:
        assert compiled.line(u)[0] == -1
    np.testing.assert_array_equal(compiled.memory, before)


RUNAWAYS = {
    "bouc-wen": bouc_wen(1.0, -0.61, 0.02),
    "bouc-wen n=2": bouc_wen(2.0, -0.61, 0.02),
    "bouc-wen n=1.7": bouc_wen(1.7, -0.61, 0.02),
    "bouc-wen n=3.3": bouc_wen(3.3, 0.02, -0.61),
}


@pytest.mark.parametrize("name", RUNAWAYS)
def test_what_runs_away_in_python_is_not_finite_in_c(name: str) -> None:
    model, compiled = RUNAWAYS[name], Compiled(RUNAWAYS[name])
    u = 2e3 * np.sin(np.arange(200) * 0.7)
    y = compiled.moves(u)
    first = int(np.argmin(np.isfinite(y)))
    assert not np.isfinite(y[first])
    expected, state = stepped(model, u[:first], model.initial_state())
    np.testing.assert_array_equal(y[:first], expected)
    with pytest.raises(ModelError, match="without limit"):
        model.simulate(u[first : first + 1], state)
    if compiled.code.pieces:
        compiled.memory[:] = state
        assert compiled.line(float(u[first]))[0] == -1
        np.testing.assert_array_equal(compiled.memory, state)


@pytest.mark.parametrize("name", CASES)
def test_tunable_parameters_stand_where_they_say_and_belong_to_the_model(name: str) -> None:
    model, code = CASES[name], hysteresis_code(CASES[name])
    fields = {re.sub(r"\[.*", "", p.name) for p in code.tunable}
    given = {name for name in model.parameters() if np.size(getattr(model, name))}
    # Limits of the input are no part of the output.
    assert fields == given - {"input_range", "lowest_input", "highest_input"}
    for p in code.tunable:
        if p.index is not None:
            assert code.parameters[p.index] == p.value
    assert code.memory == model.initial_state().size


def changed(model: HysteresisModel, name: str, factor: float) -> HysteresisModel:
    """Return a model with one parameter, or one element of it, multiplied."""
    field, _, place = name.partition("[")
    fields = dict(model.parameters())
    if place:
        values = np.array(fields[field], dtype=np.float64)
        values[int(place[:-1])] *= factor
        fields[field] = tuple(values.tolist()) if isinstance(fields[field], tuple) else values
    else:
        fields[field] = fields[field] * factor  # type: ignore[operator]
    return type(model)(**fields)


@pytest.mark.parametrize("name", CASES)
def test_a_parameter_tuned_in_c_gives_the_model_with_that_parameter(name: str) -> None:
    model = CASES[name]
    u = inputs(model, 29, 60)
    for p in hysteresis_code(model).tunable:
        if p.index is None:
            continue
        compiled, other = Compiled(model), changed(model, p.name, 1.17)
        compiled.parameters[p.index] *= 1.17
        np.testing.assert_array_equal(
            compiled.moves(u), stepped(other, u, other.initial_state())[0], err_msg=p.name
        )


def test_units_of_parameters_follow_the_exponent() -> None:
    def units(model: HysteresisModel) -> dict[str, str]:
        return {p.name: p.unit for p in hysteresis_code(model).tunable}

    assert units(bouc_wen(1.0))["beta"] == "1/V"
    # h' = A u' - beta |u'| |h|^(n-1) h: beta in 1/V for n = 1, else per metre to the power n - 1.
    assert units(bouc_wen(2.0))["beta"] == "1/(V m)"
    assert units(bouc_wen(1.5))["gamma"] == "1/(V m^0.5)"
    assert units(asymmetric(1.0))["cubic"] == "m/V^3"
    assert units(duhem([1e-6, 4e-7, 1e-9], [3e-7, 1e-10]))["anhysteretic[0]"] == "m"
    assert units(duhem([1e-6, 4e-7, 1e-9], [3e-7, 1e-10]))["anhysteretic[2]"] == "m/V^2"
    assert units(duhem([1e-6, 4e-7, 1e-9], [3e-7, 1e-10]))["tangent[1]"] == "m/V^2"
    assert units(maxwell(6, 3, bent=True))["element_stiffness[1]"] == "V/m"
    assert units(modified(7, 3))["dead_zones[2]"] == "m"


def test_a_closed_form_keeps_its_form_whatever_is_tuned() -> None:
    # A curved f has no exponential pieces, a Dahl exponent other than 1 has none either.
    places = {p.name: p.index for p in hysteresis_code(duhem([0.0, 4e-7, 0.0], [3e-7])).tunable}
    assert places["anhysteretic[2]"] is None
    assert places["anhysteretic[1]"] == 2
    straight = Dahl(gain=0.6e-6, stiffness=0.2e-6, limit=5e-6)
    bent = Dahl(gain=0.6e-6, stiffness=0.2e-6, limit=5e-6, exponent=1.2)
    assert [hysteresis_code(m).tunable[-1].index for m in (straight, bent)] == [None, 3]
