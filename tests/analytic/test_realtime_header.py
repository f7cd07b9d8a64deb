"""The header for real-time targets compiles, and steps as the model does.

Evidence (Exported files): C header (sanitisers, optimisation levels, C++): same bits
"""

import csv
import ctypes
import functools
import io
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from flexstage.export.realtime import (
    amalgamated,
    command_span,
    operations,
    realtime_files,
    rounding_bound,
)
from flexstage.hysteresis import DynamicModel, LogCreep, PrandtlIshlinskii, Sensor, dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from tests.c_compiler import OPTIMISED, compile_program, compiler, load_library, write_files

_STAGES = {name: design(name) for name in ("vgtu-piezo", "vgtu-mechanical")}
_SYSTEMS = {name: lumped_system(stage) for name, stage in _STAGES.items()}
_NAMES = pytest.mark.parametrize("name", list(_STAGES))


@functools.cache
def _usual(name: str) -> DynamicModel:
    """The model of most tests: its files are made once."""
    return _model(name)


@functools.cache
def _files(model: DynamicModel, name: str, precision: str = "double") -> dict[str, bytes]:
    return realtime_files(model, name=name, precision=precision)  # type: ignore[arg-type]


def _model(name: str, **choices) -> DynamicModel:
    if name == "vgtu-piezo":
        choices = {
            "creep": LogCreep(rate_per_decade=0.017),
            "bandwidth": 1900.0,
            "current": 0.2,
            "sensors": {"x": Sensor(gain=1.01, offset=3e-8, bandwidth_hz=4100.0)},
        } | choices
    return dynamic_model(_STAGES[name], _SYSTEMS[name], **choices)


def _commands(model: DynamicModel, count: int, seed: int = 5) -> np.ndarray:
    """Smooth loops with steps and rests, exact in single precision too."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) * model.step
    made = np.empty((count, len(model.drives)))
    for j in range(made.shape[1]):
        levels = np.repeat(rng.uniform(0.1, 0.3, size=count // 40 + 1), 40)[:count]
        made[:, j] = 0.35 + levels + 0.3 * np.sin(2.0 * np.pi * (11.0 + 8.0 * j) * t)
    for j, drive in enumerate(model.drives):
        low, high = command_span(model, drive)
        made[:, j] = low + (high - low) * made[:, j]
    return made.astype(np.float32).astype(np.float64)


def _wrapper(prefix: str) -> str:
    """A library around a header; commands and readings pass as double."""
    big = prefix.upper()
    return f"""
#include "{prefix}.h"
static {prefix}_stage {prefix}_instance;
double {prefix}_check(void);
int {prefix}_run(long count, const double *commands, double *readings);
double {prefix}_check(void) {{ return (double){prefix}_self_test(&{prefix}_instance); }}
int {prefix}_run(long count, const double *commands, double *readings)
{{
    {prefix}_real u[{big}_DRIVES], y[{big}_PROBES];
    long i;
    int j;
    {prefix}_init(&{prefix}_instance);
    for (i = 0; i < count; i++) {{
        for (j = 0; j < {big}_DRIVES; j++)
            u[j] = ({prefix}_real)commands[i * {big}_DRIVES + j];
        if ({prefix}_step(&{prefix}_instance, u, y))
            return 1;
        for (j = 0; j < {big}_PROBES; j++)
            readings[i * {big}_PROBES + j] = (double)y[j];
    }}
    return 0;
}}
"""


def _run(library: ctypes.CDLL, prefix: str, commands: np.ndarray, probes: int) -> np.ndarray:
    u = np.ascontiguousarray(commands)
    y = np.empty((len(u), probes))
    pointer = ctypes.POINTER(ctypes.c_double)
    run = getattr(library, f"{prefix}_run")
    run.argtypes = (ctypes.c_long, pointer, pointer)
    assert run(len(u), u.ctypes.data_as(pointer), y.ctypes.data_as(pointer)) == 0
    return y


def _stepped(model: DynamicModel, commands: np.ndarray) -> np.ndarray:
    state = model.settled()
    out = np.empty((len(commands), len(model.probes)))
    for i in range(len(commands)):
        u = {d.name: commands[i : i + 1, j] for j, d in enumerate(model.drives)}
        found = model.simulate(u, state)
        state = found.state
        out[i] = [found.readings[p.name][0] for p in model.probes]
    return out


def _in_both_precisions(tmp_path: Path, model: DynamicModel) -> ctypes.CDLL:
    files = _files(model, "st") | _files(model, "sf", "single")
    return load_library(tmp_path, _wrapper("st") + _wrapper("sf"), files=files, flags=OPTIMISED)


@_NAMES
def test_double_precision_gives_the_readings_bit_for_bit(name: str, tmp_path: Path) -> None:
    model = _usual(name)
    commands = _commands(model, 250)
    library = _in_both_precisions(tmp_path, model)
    found = _run(library, "st", commands, len(model.probes))
    wanted = _stepped(model, commands)
    assert np.ptp(wanted[:, 0]) > 8e-6
    assert np.array_equal(found, wanted)


@pytest.mark.slow
def test_every_optimisation_gives_the_same_bits(tmp_path: Path) -> None:
    model = _model("vgtu-piezo", keep_modes=9)
    files, commands = _files(model, "st"), _commands(model, 500)
    exact = "-ffp-contract=off"
    found = [
        _run(load_library(tmp_path, _wrapper("st"), files=files, flags=flags), "st", commands, 2)
        for flags in (("-O0", exact), ("-O2", exact), ("-O3", "-march=native", exact))
    ]
    assert np.array_equal(found[0], found[1])
    assert np.array_equal(found[0], found[2])


@pytest.mark.parametrize(
    ("name", "creep"),
    [
        pytest.param("vgtu-piezo", 0.0, marks=pytest.mark.slow),
        ("vgtu-piezo", 0.017),
        ("vgtu-mechanical", 0.0),
    ],
)
def test_single_precision_stays_within_its_bound_for_ten_seconds(
    name: str, creep: float, tmp_path: Path
) -> None:
    usual = name == "vgtu-mechanical" or creep == 0.017
    model = _usual(name) if usual else _model(name, creep=LogCreep(rate_per_decade=creep))
    library = _in_both_precisions(tmp_path, model)
    commands = _commands(model, 100_000)
    double = _run(library, "st", commands, 2)
    error = np.abs(_run(library, "sf", commands, 2) - double).max(axis=0)
    bound = rounding_bound(model)
    assert np.all(error < bound)
    # the bound is one: no more than some thousand times what is seen, and small beside the stroke
    assert np.all(error > 1e-5 * bound)
    assert np.all(bound < 1e-3 * np.ptp(double, axis=0).max())
    # measured: 1.3e-6 of the stroke; lags that lost what they add would be at 1e-5
    assert np.all(error < 3e-6 * np.ptp(double, axis=0).max())


@pytest.mark.slow
def test_slow_creep_is_not_lost_in_single_precision(tmp_path: Path) -> None:
    """A lag that moves by some units of its last digit in a step."""
    creep = LogCreep(rate_per_decade=0.2, shortest=30.0, longest=300.0, per_decade=1)
    model = _model("vgtu-piezo", keep_modes=1, creep=creep, sensors={})
    library = _in_both_precisions(tmp_path, model)
    commands = np.full((800_000, 2), 97.0)
    found, wanted = (_run(library, p, commands, 2)[[1000, -1], 0] for p in ("sf", "st"))
    crept = wanted[1] - wanted[0]
    assert crept > 0.05 * wanted[0]
    # measured 2e-5, some units of the last digit of the reading; 5e-4 if nothing were carried
    assert found[1] - found[0] == pytest.approx(crept, rel=1e-4)


@pytest.mark.slow
def test_a_slow_ramp_of_hysteresis_rounds_in_every_step(tmp_path: Path) -> None:
    model = _model("vgtu-piezo", keep_modes=2, creep=None, sensors={})
    files = _files(model, "st") | _files(model, "sf", "single")
    library = load_library(tmp_path, _wrapper("st") + _wrapper("sf"), files=files, flags=OPTIMISED)
    steps = 300_000
    up = np.linspace(0.0, 120.0, steps).astype(np.float32).astype(np.float64)
    commands = np.column_stack((up, 0.0 * up))
    error = np.abs(
        _run(library, "sf", commands, 2)[:, 0] - _run(library, "st", commands, 2)[:, 0]
    ).max()
    law = model.drives[0].hysteresis
    assert law is not None
    h = law.simulate(up).state[1]
    reach = float(model.probe_shapes[0] @ model.drives[0].modal_gain)
    said = steps * 2.0**-25 * h * reach
    # more than the modes alone allow in the end, less than what the header says
    assert error < said
    assert error > 0.003 * said
    text = " ".join(files["sf.h"].decode()[:9000].replace("*", " ").split())
    assert "N steps in one direction cause a relative error of up to N u/2" in text
    assert "N steps" not in files["st.h"].decode()[:9000]


def test_the_bound_grows_as_damping_falls_and_with_the_step() -> None:
    model = _model("vgtu-piezo", keep_modes=3)
    from dataclasses import replace

    light = replace(model, damping_ratio=model.damping_ratio / 10.0)
    short = replace(model, step=model.step / 10.0)
    bound = rounding_bound(model)[1]
    assert 5.0 < rounding_bound(light)[1] / bound < 10.5
    assert 5.0 < rounding_bound(short)[1] / bound < 10.5
    over = replace(model, damping_ratio=np.full(3, 50.0))
    # 50 - sqrt(50^2 - 1) is 0.01, the ratio of the others
    assert model.damping_ratio == pytest.approx([0.01] * 3)
    assert rounding_bound(over)[1] == pytest.approx(bound, rel=1e-3)
    assert np.isinf(rounding_bound(replace(model, damping_ratio=np.zeros(3)))[1])


@pytest.mark.parametrize(
    ("language", "precision"),
    [
        ("c99", "double"),
        pytest.param("c++17", "single", marks=pytest.mark.slow),
        pytest.param("c99", "single", marks=pytest.mark.slow),
        pytest.param("c11", "double", marks=pytest.mark.slow),
        pytest.param("c++11", "single", marks=pytest.mark.slow),
        pytest.param("c++17", "double", marks=pytest.mark.slow),
    ],
)
def test_it_compiles_without_a_warning(
    language: str, precision: Literal["double", "single"], tmp_path: Path
) -> None:
    model = _model("vgtu-piezo", keep_modes=4)
    files = realtime_files(model, name="st", precision=precision)
    plus = "g++" if "++" in language else "gcc"
    flags = (f"-std={language}", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wundef", "-Werror")
    # no number is in the other precision without saying so
    flags += ("-Wconversion", "-Wdouble-promotion")
    example = files["st_example.c"].decode()
    program = compile_program(
        tmp_path, example, files=files, strict=flags, with_compiler=plus, flags=OPTIMISED
    )
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    rows = list(csv.reader(io.StringIO(done.stdout)))
    assert rows[0] == [
        "time [s]", "command x [V]", "command y [V]", "reading x [m]", "reading y [m]",
    ]  # fmt: skip
    table = np.array(rows[1:], dtype=float)
    assert len(table) == 1000
    assert np.ptp(table[:, 3]) > 3e-5
    assert "largest deviation" in done.stderr


@pytest.mark.slow
def test_two_stages_stand_in_one_program(tmp_path: Path) -> None:
    models = {"one": _usual("vgtu-piezo"), "two": _usual("vgtu-mechanical")}
    files: dict[str, bytes] = {}
    for prefix, model in models.items():
        files |= realtime_files(model, name=prefix, precision="double")
    files |= realtime_files(models["one"], name="three", precision="single")
    source = _wrapper("one") + _wrapper("two") + _wrapper("three")
    library = load_library(tmp_path, source, files=files)
    for prefix, limit in (("one", 0.0), ("two", 0.0), ("three", 1e-5)):
        check = getattr(library, f"{prefix}_check")
        check.restype = ctypes.c_double
        assert check() <= limit
    for header in ("one.h", "three.h"):
        assert not re.search(r"\b(fs|FS)_", files[header].decode())


@pytest.mark.slow
def test_the_self_test_finds_a_changed_number_and_a_step_that_fails(tmp_path: Path) -> None:
    model = _model("vgtu-piezo", keep_modes=5)
    made: dict[str, bytes] = {}
    for prefix in ("off", "no"):
        files = realtime_files(model, name=prefix)
        text, big = files[f"{prefix}.h"].decode(), prefix.upper()
        start = rf"{prefix}_data_transition\[4\]\[{big}_MODES\] = \{{\s*\{{([^,]+),"
        numbers = re.search(start, text)
        assert numbers is not None
        value = str(float(numbers[1]) * 1.001) if prefix == "off" else "INFINITY"
        broken = text.replace(numbers[1], value, 1)
        assert broken != text
        made |= files | {f"{prefix}.h": broken.encode()}
    library = load_library(tmp_path, _wrapper("off") + _wrapper("no"), files=made)
    library.off_check.restype = library.no_check.restype = ctypes.c_double
    assert 1e-5 < library.off_check() < 1.0
    assert library.no_check() == np.inf


def test_the_table_holds_what_the_self_test_steps_through() -> None:
    model = _usual("vgtu-mechanical")
    files = realtime_files(model)
    rows = list(csv.reader(io.StringIO(files["vgtu_mechanical_check.csv"].decode())))
    assert rows[0] == [
        "time [s]", "command x [m]", "command y [m]", "reading x [m]", "reading y [m]",
    ]  # fmt: skip
    table = np.array(rows[1:], dtype=float)
    assert table.shape == (200, 5)
    assert table[:, 0] == pytest.approx(model.step * np.arange(1, 201), rel=1e-12)
    assert np.array_equal(table[:, 3:], _stepped(model, table[:, 1:3]))
    # every command is one in single precision, so that both precisions see the same
    assert np.array_equal(table[:, 1:3], table[:, 1:3].astype(np.float32))
    header = files["vgtu_mechanical.h"].decode()
    for value in table[[3, 77, 199], 3]:
        assert repr(float(value)) in header


def test_the_example_follows_commands_from_its_input(tmp_path: Path) -> None:
    model = _usual("vgtu-piezo")
    files = _files(model, "st")
    program = compile_program(tmp_path, files["st_example.c"].decode(), files=files)
    commands = _commands(model, 50)
    given = "\n".join(f"{a:.17g}, {b:.17g}" for a, b in commands)
    done = subprocess.run([program, "-"], input=given, capture_output=True, text=True, check=True)
    table = np.array(list(csv.reader(io.StringIO(done.stdout)))[1:], dtype=float)
    wanted = model.simulate({"x": commands[:, 0], "y": commands[:, 1]}).readings
    assert table[:, 1:3] == pytest.approx(commands, rel=1e-8)
    # nine digits are printed
    assert table[:, 3] == pytest.approx(wanted["x"], rel=1e-8)
    short = subprocess.run([program, "-"], input="1.0", capture_output=True, text=True, check=False)
    assert (short.returncode, "expected 2 numbers" in short.stderr) == (1, True)


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The object file of a stage, with its stack and its calls beside it."""

    @functools.cache
    def made(name: str) -> Path:
        folder = tmp_path_factory.mktemp(name)
        write_files(folder, _files(_usual(name), "st"))
        (folder / "one.c").write_text(_wrapper("st"))
        flags = ["-std=c99", "-O2", "-fno-inline", "-fstack-usage", "-fcallgraph-info"]
        command = [compiler(), *flags, "-c", "one.c", "-o", "one.o"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        return folder / "one.o"

    return made


@_NAMES
def test_it_calls_nothing_but_libm(name: str, objects: Callable[[str], Path]) -> None:
    if shutil.which("nm") is None:
        pytest.skip("nm is not installed")
    listing = subprocess.run(
        ["nm", "--undefined-only", str(objects(name))],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    called = {line.split()[-1] for line in listing.splitlines()}
    plain = {"_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail", "memcpy", "memset", "memmove"}
    libm = {
        "tan",
        "tanh",
        "atan",
        "atanh",
        "exp",
        "expm1",
        "log",
        "log1p",
        "sin",
        "cos",
        "sincos",
        "sqrt",
        "pow",
        "ceil",
        "rint",
    }
    assert called <= plain | libm | {"floor", "fabs"}
    assert called & libm


@_NAMES
def test_its_stack_is_bounded(name: str, objects: Callable[[str], Path]) -> None:
    text = objects(name).with_suffix(".su").read_text()
    rows = [line.split("\t") for line in text.splitlines()]
    assert {kind for _, _, kind in rows} == {"static"}
    used = {place.rsplit(":", 1)[-1]: int(size) for place, size, _ in rows}
    assert any(name.startswith("st_drive_step") for name in used)
    # all functions at once, and without recursion no more than that can be in use
    k = _usual(name).omega.size
    assert sum(used.values()) < 8 * 12 * k + 6000


def test_no_function_calls_itself(objects: Callable[[str], Path]) -> None:
    text = objects("vgtu-piezo").with_suffix(".ci").read_text()
    edges: dict[str, set[str]] = {}
    for a, b in re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text):
        edges.setdefault(a, set()).add(b)
    assert any("st_step" in a for a in edges)

    def reach(start: str) -> set[str]:
        seen, todo = set(), list(edges.get(start, ()))
        while todo:
            at = todo.pop()
            if at not in seen:
                seen.add(at)
                todo += edges.get(at, ())
        return seen

    assert not [a for a in edges if a in reach(a)]


def test_it_opens_with_what_an_engineer_needs() -> None:
    model = _usual("vgtu-piezo")
    text = realtime_files(model)["vgtu_piezo.h"].decode()
    comment = text[: text.index("*/")]
    assert "[0] x [V], piezo: 0 to 120 V, amplifier 1900 Hz, hysteresis bouc-wen" in comment
    assert "[0] x [m], sensor: gain 1.01, offset 3e-08, 4100 Hz" in comment
    assert "[1] y [m], true motion" in comment
    assert "0.0001 s (10000 Hz)" in comment
    assert "flexstage 0." in comment
    assert f"about {operations(model)} additions" in comment
    assert "bit for bit" in comment
    for note in model.notes:
        assert note[:30] in " ".join(comment.replace("*", " ").split())
    assert max(map(len, comment.splitlines())) <= 99
    single = realtime_files(model, precision="single")["vgtu_piezo.h"].decode()
    assert "single precision. Accumulated rounding errors" in single
    assert f"x {rounding_bound(model)[0]:.2g} m" in single


@pytest.mark.slow
def test_operations_are_counted_about_right(tmp_path: Path) -> None:
    """Count them with a type that counts."""
    model = _usual("vgtu-piezo")
    text = _files(model, "st")["st.h"].decode()
    text = text.replace("typedef double st_real;", "", 1)
    counter = """
#include <cmath>
#include <cstdio>
static long operations = 0;
struct st_real {
    double x;
    st_real(double v = 0.0) : x(v) {}
    explicit operator int() const { return (int)x; }
    st_real operator-() const { return st_real(-x); }
};
#define OP(o) static inline st_real operator o(st_real a, st_real b) \\
    { operations++; return st_real(a.x o b.x); } \\
    static inline st_real &operator o##=(st_real &a, st_real b) { return a = a o b; }
OP(+) OP(-) OP(*) OP(/)
#define IS(o) static inline bool operator o(st_real a, st_real b) { return a.x o b.x; }
IS(<) IS(>) IS(<=) IS(>=) IS(==) IS(!=)
#define CALL(f) static inline st_real f(st_real a) { return st_real(std::f(a.x)); }
CALL(exp) CALL(expm1) CALL(log) CALL(log1p) CALL(sqrt) CALL(sin) CALL(cos)
CALL(tan) CALL(tanh) CALL(atan) CALL(atanh) CALL(fabs) CALL(ceil) CALL(floor) CALL(rint)
static inline st_real pow(st_real a, st_real b) { return st_real(std::pow(a.x, b.x)); }
"""
    main = """
int main()
{
    static st_stage s;
    st_real u[2], y[2];
    st_init(&s);
    long most = 0, all = 0;
    for (int i = 0; i < 2000; i++) {
        u[0] = 60.0 - 50.0 * std::cos(6.283 * 11e-4 * i);
        u[1] = 55.0 - 40.0 * std::cos(6.283 * 17e-4 * i);
        operations = 0;
        st_step(&s, u, y);
        all += operations;
        most = operations > most ? operations : most;
    }
    std::printf("%ld %ld", all / 2000, most);
    return 0;
}
"""
    program = compile_program(
        tmp_path,
        counter + text + main,
        with_compiler="g++",
        strict=("-std=c++17",),
        flags=("-O1",),
    )
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    usual, most = map(int, done.stdout.split())
    assert operations(model) == pytest.approx(usual, rel=0.05)
    # a step in which a loop turns sends every mode through two pieces
    assert most < 4 * usual


def test_hysteresis_without_closed_form_is_stepped_too(tmp_path: Path) -> None:
    play = PrandtlIshlinskii(
        gain=1.1e-7,
        thresholds=np.array([4.0, 9.0, 31.0]),
        weights=np.array([2.1e-7, 0.6e-7, 0.4e-7]),
    )
    model = _model("vgtu-piezo", hysteresis={"x": play}, keep_modes=7)
    library = load_library(tmp_path, _wrapper("st"), files=_files(model, "st"))
    commands = _commands(model, 150)
    found = _run(library, "st", commands, 2)
    assert found == pytest.approx(_stepped(model, commands), rel=1e-11, abs=1e-17)


def test_names_that_would_spoil_the_code_are_harmless(tmp_path: Path) -> None:
    from dataclasses import replace

    model = _model("vgtu-mechanical", keep_modes=2)
    model = replace(
        model,
        name='9 */ "stage" \\ %s ä',
        title="a title */ with\nlines and µm",
        notes=("a note with /* in it",),
    )
    files = realtime_files(model)
    prefix = "stage_9_stage_s"
    assert list(files) == [f"{prefix}.h", f"{prefix}_example.c", f"{prefix}_check.csv"]
    example = files[f"{prefix}_example.c"].decode()
    program = compile_program(tmp_path, example, files=files)
    subprocess.run([program], capture_output=True, check=True)


def test_single_precision_holds_its_numbers_in_single_precision() -> None:
    files = _files(_usual("vgtu-piezo"), "st", "single")
    text = files["st.h"].decode()
    arrays = re.findall(r"static const st_real \w+(?:\[\w+\])+ = (\{.*?\});", text, re.DOTALL)
    numbers = re.findall(r"[\d.]+(?:e[+-]?\d+)?f?", "".join(arrays))
    assert len(numbers) > 3000
    assert all(n.endswith("f") for n in numbers)
    sizes = np.abs(np.array([float(n[:-1]) for n in numbers]))
    assert np.all((sizes == 0.0) | (sizes >= 1.1754943e-38))


def test_an_include_that_is_not_before_it_is_refused() -> None:
    with pytest.raises(ValueError, match=r"a\.h includes b\.h, which is not before it"):
        amalgamated({"a.h": b'#include "b.h"\n'})
