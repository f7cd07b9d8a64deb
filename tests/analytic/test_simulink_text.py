"""Scripts for Simulink as text: what MATLAB reads, names, refusals, and the files as a whole."""

import io
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat

from flexstage.base.errors import ModelError
from flexstage.export.diagram.graph import Block, Diagram, SignalLine
from flexstage.export.diagram.stage_diagram import stage_diagram
from flexstage.export.simulink.chains import hysteresis_function
from flexstage.export.simulink.files import simulink_files
from flexstage.export.simulink.matlab_text import (
    Variables,
    comment,
    identifier,
    identifiers,
    literal,
    mat_file,
    plain,
    quoted,
)
from flexstage.hysteresis import (
    BoucWen,
    HysteresisModel,
    LogCreep,
    Sensor,
    dynamic_model,
)
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design

LOOP = BoucWen(gain=0.593e-6, hysteresis_gain=0.441e-6, beta=0.05, gamma=0.03)
STRING = re.compile(r"'(?:[^'\n]|'')*'")


def bare(script: str) -> list[str]:
    """Lines of a script without strings and comments."""
    return [STRING.sub("''", line).split("%")[0] for line in script.splitlines()]


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    stage = design("vgtu-piezo")
    model = dynamic_model(
        stage,
        lumped_system(stage),
        creep=LogCreep(rate_per_decade=0.013),
        bandwidth=900.0,
        current=0.1,
        sensors={"x": Sensor(gain=1.1, offset=1e-7, quantisation=1e-9, mains_amplitude=2e-9)},
    )
    return simulink_files(stage_diagram(stage, model=model), name="stage", model=model)


def test_files_are_what_is_promised(files: dict[str, bytes]) -> None:
    assert sorted(files) == [
        "README.txt", "stage_build.m", "stage_data.mat", "stage_hysteresis_d_x.m",
        "stage_hysteresis_d_y.m",
    ]  # fmt: skip
    readme = files["README.txt"].decode("ascii")
    assert "straight lines between samples" not in " ".join(readme.split())
    for said in ("sim('stage')", "not tested in MATLAB or Simulink", "half a sample", "at rest"):
        assert said in " ".join(readme.split()), said
    variables = loadmat(io.BytesIO(files["stage_data.mat"]))
    for name in (n for n in variables if not n.startswith("__")):
        assert re.search(rf"^  {name} +\d+ x \d+ ", readme, re.MULTILINE), name


def test_scripts_are_ascii_and_have_no_words_that_only_octave_knows(
    files: dict[str, bytes],
) -> None:
    for name in (n for n in files if n.endswith(".m")):
        script = files[name].decode("ascii")
        for line in bare(script):
            assert not re.search(r'["#!]|\+=|-=|\*=|\+\+|\bend[a-z]|\bprintf\b|\*\*', line), line
            assert len(line) < 4096
        words = " ".join(bare(script))
        opened = re.findall(r"\b(?:function|if|for|while|try|switch)\b", words)
        # the index of a last element is no end of a block
        closed = re.findall(r"(?<![(:,] )(?<![(:])\bend\b(?!\s*[-)+])", words)
        assert len(opened) == len(closed), name


def test_calls_are_those_of_every_release(files: dict[str, bytes]) -> None:
    script = " ".join(bare(files["stage_build.m"].decode()))
    own = set(re.findall(r"function (?:\w+ = )?(\w+)\(", script))
    called = set(re.findall(r"\b([A-Za-z]\w*)\(", script)) - own
    assert called <= {
        "add_block", "add_line", "set_param", "get_param", "new_system", "open_system",
        "save_system", "close_system", "load_system", "bdIsLoaded", "fullfile", "fileparts",
        "mfilename", "exist", "error", "warning", "rethrow", "load", "fieldnames", "numel",
        "assignin", "numbers", "names", "isempty", "find", "fileread",
    }  # fmt: skip
    assert max(map(len, own)) <= 63


def test_same_input_gives_the_same_bytes(files: dict[str, bytes]) -> None:
    diagram = stage_diagram(design("parallelogram"))
    first = simulink_files(diagram, name="twice")
    assert first == simulink_files(diagram, name="twice")
    assert b"flexstage" in first["twice_data.mat"][:116]


@given(st.text(max_size=60))
def test_any_text_becomes_a_string_a_comment_and_a_name(text: str) -> None:
    made = quoted(text)
    assert STRING.fullmatch(made)
    assert made.isascii()
    assert all(line.startswith("%") for line in comment(text).splitlines())
    assert re.fullmatch(r"[A-Za-z]\w{0,62}", identifier(text), re.ASCII)


@given(st.lists(st.text(max_size=80), max_size=8, unique=True))
def test_names_are_unlike_each_other(texts: list[str]) -> None:
    made = identifiers(texts, longest=20)
    assert list(made) == texts
    assert len({name.lower() for name in made.values()}) == len(texts)
    assert all(len(name) <= 20 for name in made.values())


def test_greek_letters_and_powers_stay_readable() -> None:
    assert plain("αM⁻¹ [m²/µs] ×2, 10⁻⁶, Kᵀ, é") == "alphaM^-1 [m^2/us] x2, 10^-6, K^T, e"


@given(st.floats(allow_nan=False))
def test_numbers_are_read_back_to_the_last_bit(value: float) -> None:
    text = literal(value)
    assert float(text.replace("Inf", "inf")) == value


def test_variables_keep_clear_of_names_of_matlab_and_of_each_other() -> None:
    made = Variables()
    assert made.add("pi", 3.0, "three") != "pi"
    names = [made.add(n, [[1.0]], "one") for n in ("k", "K", "k", "2k", "end", "a" * 90)]
    assert len({n.lower() for n in names}) == 6
    assert all(re.fullmatch(r"[A-Za-z]\w{0,62}", n) for n in names)
    back = loadmat(io.BytesIO(mat_file(made.values)))
    assert back[names[-1]].item() == 1.0


def one(kind: str = "gain", **more: object) -> Diagram:
    described = {"matrix": np.array([[2.0]])} if kind == "gain" else {}
    block = Block(name="b", kind=kind, label="b", meaning="b", **(described | more))  # type: ignore[arg-type]
    width = block.width
    ends = (
        Block(name="u", kind="input", label="u", meaning="u", width=width),
        Block(name="y", kind="output", label="y", meaning="y", width=width),
    )
    lines = (SignalLine(source="u", target="b"), SignalLine(source="b", target="y"))
    return Diagram(title="one", blocks=(*ends, block), lines=lines)


@pytest.mark.parametrize("name", ["2x", "a-b", "end", "", "x" * 31, "é"])
def test_names_that_matlab_does_not_take_are_refused(name: str) -> None:
    with pytest.raises(ModelError, match=r"use '[A-Za-z]\w*'"):
        simulink_files(one(), name=name)


def test_bad_times_are_refused() -> None:
    for bad in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(ModelError, match="sample time must be positive"):
            simulink_files(one(), name="x", sample_time=bad)
        with pytest.raises(ModelError, match="duration must be positive"):
            simulink_files(one(), name="x", duration=bad)


def test_a_diagram_without_ends_is_refused() -> None:
    with pytest.raises(ModelError, match="needs an input and an output"):
        simulink_files(Diagram(title="none", blocks=(), lines=()), name="x")


def test_a_diagram_of_another_stage_is_refused() -> None:
    stage = design("vgtu-piezo")
    model = dynamic_model(stage, lumped_system(stage))
    with pytest.raises(ModelError, match="give a diagram and a model of the same stage"):
        simulink_files(one(), name="x", model=model)


class Unknown(BoucWen):
    """A model that nobody has written in MATLAB."""

    kind = "unknown"


def test_a_hysteresis_without_a_form_in_matlab_is_refused() -> None:
    model: HysteresisModel = Unknown(gain=1.0, hysteresis_gain=0.5, beta=0.1, gamma=0.1)
    with pytest.raises(ModelError, match="no Simulink code for the model 'unknown'"):
        hysteresis_function(model, "h")
    with pytest.raises(ModelError, match="name of a function"):
        hysteresis_function(LOOP, "no name")


def test_long_names_of_outputs_stay_apart() -> None:
    ends = [f"{'a' * 60}{i}" for i in range(2)]
    blocks = (
        Block(name="u", kind="input", label="u", meaning="u"),
        *(Block(name=n, kind="output", label=n, meaning=n) for n in ends),
    )
    lines = tuple(SignalLine(source="u", target=n) for n in ends)
    diagram = Diagram(title="two", blocks=blocks, lines=lines)
    script = simulink_files(diagram, name="x" * 30)["x" * 30 + "_build.m"].decode()
    kept = re.findall(r"'VariableName', '(x+_a\w*)'", script)
    assert len(set(kept)) == 2
    assert max(map(len, kept)) <= 63


def test_a_sum_of_one_input_does_not_add_up_its_column() -> None:
    # a Sum block with one input adds the numbers of a column: a gain stands in its place
    script = simulink_files(one("sum", width=3, signs=(-1,)), name="x")["x_build.m"].decode()
    assert "Math Operations/Sum" not in script
    assert re.search(r"/b'\], \.\.\.\n.*\n    'Gain', '-1', \.\.\.", script)


def test_a_function_is_written_once_for_diagram_and_modes(files: dict[str, bytes]) -> None:
    script = files["stage_build.m"].decode()
    for axis in "xy":
        assert script.count(f"fullfile(here, 'stage_hysteresis_d_{axis}.m')") == 2


def test_modes_hold_the_linear_part_of_the_model() -> None:
    from flexstage.export.control_object import linear_part

    stage = design("parallelogram")
    model = dynamic_model(stage, lumped_system(stage))
    made = simulink_files(stage_diagram(stage, model=model), name="p", model=model)
    data, form = loadmat(io.BytesIO(made["p_data.mat"])), linear_part(model)
    for letter in "ABCD":
        assert np.array_equal(data[f"modes_{letter}"], getattr(form, letter)), letter
