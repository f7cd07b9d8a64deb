"""Hysteresis in C: against integrators and definitions, in single precision, under sanitizers."""

import itertools
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexstage.hysteresis import BoucWen, Dahl, Duhem
from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.models.registry import hysteresis_code
from flexstage.hysteresis.models.source_code import source_file
from tests.c_compiler import OPTIMISED, compile_program, load_library
from tests.c_hysteresis import CASES, Array, Compiled, bouc_wen, headers, prandtl, program, walk

TURNS = np.array([0.0, 83.7, -21.3, 97.1, 40.4, 61.9, -17.8])
STROKE = 60e-6


def integrated(slope, turns: Array) -> Array:
    """Outputs at turning points, of dy/du = slope(u, y, direction), by an integrator."""
    y, found = 0.0, []
    for start, end in itertools.pairwise(turns):
        s = np.sign(end - start)
        # In units of 1 um, so that the tolerances of the integrator are met.
        done = solve_ivp(
            lambda u, y, s=s: slope(u, y[0] * 1e-6, s) * 1e6,
            (start, end), [y], method="DOP853", rtol=1e-11, atol=1e-12,
        )  # fmt: skip
        y = float(done.y[0, -1])
        found.append(y * 1e-6)
    return np.array(found)


@pytest.mark.parametrize("n", [1.0, 1.4, 2.0, 3.7])
def test_bouc_wen_agrees_with_an_integrator(n: float) -> None:
    m: BoucWen = bouc_wen(n)

    def slope(u: float, h: float, s: float) -> float:
        return m.hysteresis_gain - (m.gamma + m.beta * np.sign(s * h)) * abs(h) ** n

    expected = m.gain * TURNS[1:] - integrated(slope, TURNS)
    # The kink at h = 0 costs the integrator some digits.
    np.testing.assert_allclose(Compiled(m).moves(TURNS[1:]), expected, rtol=0.0, atol=1e-9 * STROKE)


@pytest.mark.parametrize("i", [1.0, 1.4, 2.0])
def test_dahl_agrees_with_an_integrator(i: float) -> None:
    m = Dahl(gain=0.593e-6, stiffness=0.251e-6, limit=5.3e-6, exponent=i)

    def slope(u: float, F: float, s: float) -> float:
        e = 1.0 - s * F / m.limit
        return m.stiffness * abs(e) ** i * np.sign(e)

    expected = m.gain * TURNS[1:] - integrated(slope, TURNS)
    np.testing.assert_allclose(Compiled(m).moves(TURNS[1:]), expected, rtol=0.0, atol=1e-9 * STROKE)


def test_duhem_agrees_with_an_integrator() -> None:
    m = CASES["duhem curved"]
    assert isinstance(m, Duhem)
    f, g = np.polynomial.Polynomial(m.anhysteretic), np.polynomial.Polynomial(m.tangent)

    def slope(u: float, y: float, s: float) -> float:
        return s * m.rate * (f(u) - y) + g(u)

    expected = integrated(slope, TURNS)
    np.testing.assert_allclose(Compiled(m).moves(TURNS[1:]), expected, rtol=0.0, atol=1e-9 * STROKE)


def test_prandtl_ishlinskii_is_its_definition() -> None:
    m = prandtl(4, 23)
    p, expected = np.zeros(23), []
    for u in walk(31, 500):
        p = np.maximum(u - m.thresholds, np.minimum(u + m.thresholds, p))
        expected.append(m.gain * u + m.weights @ p)
    found = Compiled(m).moves(walk(31, 500))
    # The sum is taken in another order: 24 roundings of the largest part.
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=24 * 2.3e-16 * 2 * STROKE)


def along(pieces: Array, share: Array) -> Array:
    """Values of pieces at shares of their line."""
    at = np.searchsorted(pieces[:, 0], share, side="right") - 1
    start, constant, slope, amplitude, rate = pieces.astype(np.float64)[at].T
    since = share - start
    return constant + slope * since + amplitude * np.exp(-rate * since)


@pytest.mark.parametrize("name", [n for n in CASES if hysteresis_code(CASES[n]).pieces])
def test_pieces_are_the_output_between_their_ends(name: str) -> None:
    rng = np.random.default_rng(37)
    compiled, between = Compiled(CASES[name]), Compiled(CASES[name])
    for u in walk(41, 150):
        last = compiled.memory.copy()
        _, pieces, _ = compiled.line(u)
        share = np.sort(rng.random(8))
        between.memory[:] = last
        expected = between.moves(last[0] + (u - last[0]) * share)
        # Short pieces with small rates are met by their derivatives, to 2e-11 of their rise.
        np.testing.assert_allclose(along(pieces, share), expected, rtol=0.0, atol=2e-11 * STROKE)


# ----------------------------------------------------------------------------- single precision


def in_double(model: HysteresisModel, u: Array) -> Array:
    return Compiled(model).moves(u.astype(np.float64))


@pytest.mark.parametrize("name", CASES)
def test_single_precision_gives_the_double_result_within_half_a_millionth_of_the_stroke(
    name: str,
) -> None:
    # Parameters, input and output are rounded by 6e-8 each, of at most twice the stroke. So is h in
    # each step, but it forgets as it saturates, after some dozens of volts. Measured: 0.8 to 3e-7.
    u = walk(43, 10_000).astype(np.float32)
    expected = in_double(CASES[name], u)
    error = np.abs(Compiled(CASES[name], single=True).moves(u) - expected).max()
    assert error < 5e-7 * np.ptp(expected)


@pytest.mark.parametrize("name", [n for n in CASES if hysteresis_code(CASES[n]).pieces])
def test_pieces_in_single_precision_follow_those_in_double(name: str) -> None:
    rng = np.random.default_rng(61)
    single, double = Compiled(CASES[name], single=True), Compiled(CASES[name])
    worst = 0.0
    for u in walk(47, 300).astype(np.float32).tolist():
        share = np.append(np.sort(rng.random(5)), 1.0)
        found, expected = single.line(u), double.line(u)
        assert found[0] > 0
        difference = along(found[1], share) - along(expected[1], share)
        worst = max(worst, float(np.abs(difference).max()), abs(found[2] - expected[2]))
    # As above, and one rounding of the largest output for each piece. Measured: 1.1 to 3.1e-7.
    assert worst < 6e-7 * STROKE


def test_slow_steps_lose_digits_in_single_precision_with_memory_of_h_only() -> None:
    # From 100 V downwards by 10 uV, which is 1.3 units in the last place there, over 3 V.
    u = (100.0 - 1e-5 * np.arange(300_000)).astype(np.float32)

    def error(model: HysteresisModel) -> float:
        expected = in_double(model, u)
        return float(np.abs(Compiled(model, single=True).moves(u) - expected).max()) / STROKE

    assert error(CASES["preisach 6 x 5"]) < 2e-7
    assert error(CASES["maxwell-slip bent"]) < 4e-7
    # What the header says: 3e-8 h/(A du) of the slope, here 6 %, so up to 0.06 A 3 V, 7e-4.
    assert 2e-5 < error(CASES["bouc-wen n=1"]) < 7e-4
    # and for Duhem 3e-8 y/du of its slope.
    assert 1e-3 < error(CASES["duhem curved"]) < 3.0 * 3e-8 * 60e-6 / 1e-5 / STROKE


# -------------------------------------------------------------------------- compiler, sanitizers


def every_header() -> dict[str, bytes]:
    needed: dict[str, bytes] = {}
    for model in CASES.values():
        needed |= headers(hysteresis_code(model))
    return needed


def test_all_models_stand_side_by_side_without_a_warning(tmp_path: Path) -> None:
    kinds = {hysteresis_code(model).header for model in CASES.values()}
    source = "".join(f'#include "{name}"\n' for name in sorted(kinds)) + "int fs_none;\n"
    more = ("-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Wcast-qual", "-Wundef")
    for precision in ((), ("-DFS_SINGLE",)):
        flags = (*OPTIMISED, *more, *precision)
        load_library(tmp_path, source, files=every_header(), flags=flags)


def test_headers_say_all_that_they_include_and_no_more() -> None:
    for model in CASES.values():
        names = hysteresis_code(model).headers
        for place, name in enumerate(names):
            text = source_file(name).decode()
            included = {x.split('"')[1] for x in text.splitlines() if x.startswith('#include "')}
            assert included <= set(names[:place])


@pytest.mark.parametrize("flags", [("-O1",), ("-O3", "-march=native")], ids=" ".join)
def test_bits_do_not_depend_on_optimisation(flags: tuple[str, ...], tmp_path: Path) -> None:
    u = walk(53, 2000)
    for number, name in enumerate(("bouc-wen n=1.4", "generalised-bouc-wen n=1", "duhem curved")):
        compiled, other = Compiled(CASES[name]), Compiled(CASES[name])
        other.library = load_library(
            tmp_path / str(number),
            program(other.code),
            files=headers(other.code),
            flags=(*flags, "-ffp-contract=off"),
        )
        np.testing.assert_array_equal(other.moves(u), compiled.moves(u), err_msg=name)


SANITIZED = """
static void sanitized{number}(void)
{{
    static const double p[] = {{{parameters}}};
    static fs_real q[{size}], memory[{memory}], y[INPUTS], v[INPUTS];
    int i;
    for (i = 0; i < {size}; i++)
        q[i] = (fs_real)p[i];
    for (i = 0; i < INPUTS; i++)
        v[i] = (fs_real)u[i];
    moves{number}(q, memory, v, INPUTS, y);
    {lines}
    for (i = 0; i < INPUTS; i++)
        printf("%.17g\\n", (double)y[i]);
}}
"""


@pytest.mark.parametrize("precision", ["double", pytest.param("single", marks=pytest.mark.slow)])
def test_sanitizers_find_nothing(precision: str, tmp_path: Path) -> None:
    """One program of all kinds, as each of them by itself costs as much as ten."""
    names = ["bouc-wen n=1", "bouc-wen n=3.7", "asymmetric-bouc-wen n=1.7",
             "generalised-bouc-wen n=1", "dahl i=0.6", "duhem curved", "duhem straight",
             "prandtl-ishlinskii 23", "modified-prandtl-ishlinskii", "maxwell-slip bent",
             "preisach 31 x 12"]  # fmt: skip
    # huge steps and an input that is no number, too
    inputs = [*walk(59, 400).tolist(), 1e4, -1e4, 1e9, -1e9, 33.3]
    count = len(inputs) + 2
    given = ", ".join(["NAN", "INFINITY", *(f"{x:.17g}" for x in inputs)])
    parts = [f"#define INPUTS {count}\n#include <math.h>\n#include <stdio.h>\n"]
    parts.append(f"static const double u[] = {{{given}}};\n")
    for number, name in enumerate(names):
        code = hysteresis_code(CASES[name])
        stepped = re.sub(r"\b(moves|lines?)(?=\()", rf"\g<1>{number}", program(code))
        parts.append(stepped)
        parts.append(
            SANITIZED.format(
                number=number,
                parameters=", ".join(f"{x:.17g}" for x in code.parameters),
                size=code.parameters.size,
                memory=code.memory,
                lines=f"lines{number}(q, memory, v, INPUTS, y, {code.pieces});"
                if code.pieces
                else "",
            )
        )
    calls = "".join(f"sanitized{number}(); " for number in range(len(names)))
    parts.append(f"int main(void)\n{{\n    {calls}\n    return 0;\n}}\n")
    flags = ["-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    # Overflow of a number that is far too large for single precision is not to be found.
    flags += ["-fsanitize=float-cast-overflow"]
    binary = compile_program(
        tmp_path,
        "".join(parts),
        files=every_header(),
        flags=(*flags, *(["-DFS_SINGLE"] if precision == "single" else [])),
    )
    done = subprocess.run([binary], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    table = np.array([float(x) for x in done.stdout.split()]).reshape(len(names), count)
    for name, values in zip(names, table, strict=True):
        assert not np.isfinite(values[:2]).any(), name
        assert np.isfinite(values[2:402]).all(), name
