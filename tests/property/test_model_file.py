"""The file of a drive model: the same numbers back, and one sentence about anything else."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.base.errors import ModelError
from flexstage.hysteresis import (
    MODELS,
    AsymmetricBoucWen,
    BoucWen,
    Dahl,
    Duhem,
    GeneralisedBoucWen,
    GeneralisedMaxwellSlip,
    Line,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    Preisach,
)
from flexstage.hysteresis.chain.creep import CreepSpectrum, LogCreep
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.drive_model import DriveModel, ValidityRange
from flexstage.hysteresis.model_file import ModelFile, model_text, read_model_text
from tests.hysteresis_vectors import of_kind

FEW = settings(max_examples=12, deadline=None)
slopes = st.floats(1e-9, 1e-5)
rates = st.floats(1e-3, 2e-1)


def rising(count, largest=90.0):
    steps = st.lists(st.floats(0.1, largest / count), min_size=count, max_size=count)
    return steps.map(np.cumsum)


def numbers(count, least=0.0, most=1e-6):
    return st.lists(st.floats(least, most), min_size=count, max_size=count).map(np.array)


BUILDS = {
    **{kind: st.sampled_from([v.model for v in of_kind(kind)]) for kind in MODELS},
    "bouc-wen": st.builds(
        BoucWen,
        gain=slopes,
        hysteresis_gain=slopes,
        beta=rates,
        gamma=st.floats(-0.1, 0.1),
        exponent=st.sampled_from([1.0, 1.7, 2.0]),
    ),
    "asymmetric-bouc-wen": st.builds(
        AsymmetricBoucWen,
        gain=slopes,
        quadratic=st.floats(-1e-12, 1e-12),
        cubic=st.floats(-1e-15, 1e-15),
        hysteresis_gain=slopes,
        beta=rates,
        gamma=st.floats(-0.1, 0.1),
        lowest_input=st.floats(-20.0, -1.0),
        highest_input=st.floats(90.0, 150.0),
    ),
    "generalised-bouc-wen": st.builds(
        GeneralisedBoucWen,
        gain=slopes,
        hysteresis_gain=slopes,
        shape=st.tuples(*[st.floats(-0.05, 0.05)] * 6),
        centre=st.floats(-3.0, 60.0),
    ),
    "line": st.builds(Line, gain=slopes),
    "dahl": st.builds(Dahl, gain=slopes, stiffness=slopes, limit=st.floats(1e-7, 1e-4)),
    "duhem": st.builds(
        Duhem,
        rate=rates,
        anhysteretic=numbers(3, -1e-6),
        tangent=numbers(2, -1e-7),
        input_range=st.tuples(st.floats(-9.0, 0.0), st.floats(80.0, 130.0)),
    ),
    "prandtl-ishlinskii": st.builds(
        PrandtlIshlinskii, gain=slopes, thresholds=rising(4), weights=numbers(4)
    ),
    "modified-prandtl-ishlinskii": st.builds(
        ModifiedPrandtlIshlinskii,
        gain=slopes,
        thresholds=rising(3),
        weights=numbers(3),
        dead_zones=rising(2).map(lambda x: 1e-6 * x),
        dead_zone_weights=numbers(2, 0.0, 0.3),
    ),
    "maxwell-slip": st.builds(
        GeneralisedMaxwellSlip,
        stiffness=st.floats(1e5, 1e7),
        thresholds=rising(3).map(lambda x: 1e-7 * x),
        element_stiffness=numbers(3, 1e3, 1e6),
        dead_zones=rising(2).map(lambda x: 1e-6 * x),
        dead_zone_weights=numbers(2, 0.0, 1e3),
    ),
    "preisach": st.builds(
        Preisach,
        thresholds=rising(3).map(lambda x: x - x[0]),
        knots=rising(4),
        slopes=numbers(9).map(lambda x: x.reshape(3, 3)),
    ),
}

chains = st.fixed_dictionaries(
    {
        "creep": st.none()
        | st.builds(
            LogCreep,
            rate_per_decade=st.floats(0.0, 0.1),
            shortest=st.floats(1e-3, 1.0),
            longest=st.floats(20.0, 1e5),
            per_decade=st.integers(1, 3),
        )
        | st.builds(
            CreepSpectrum,
            times=st.tuples(st.floats(1e-3, 1.0), st.floats(2.0, 1e4)),
            weights=st.tuples(st.floats(1e-6, 2.0), st.floats(0.0, 0.3)),
        ),
        "modes": st.none()
        | st.builds(
            StageModes,
            frequency_hz=st.tuples(st.floats(50.0, 900.0)),
            damping_ratio=st.tuples(st.floats(1e-3, 0.2)),
            share=st.just((1.0,)),
        ),
        "lag": st.none() | st.builds(Lag, delay=st.floats(0.0, 0.1)),
        "offset": st.floats(-1e3, 1e3),
        "sign": st.sampled_from([1.0, -1.0]),
        "output_unit": st.sampled_from(["m", "", "rad", "µm/°"]),
        "validity": st.none()
        | st.builds(
            ValidityRange,
            input_range=st.tuples(st.floats(-30.0, 0.0), st.floats(1.0, 150.0)),
            output_range=st.just((-1.5e-5, 2.3e-5)),
            rate_range_hz=st.just((0.1, 9.7)),
            temperature=st.none() | st.just((293.0, 295.5)),
        ),
    }
)


def same(one, other):
    """Whether two trees of fields hold the same bits."""
    if dataclasses.is_dataclass(one):
        return type(one) is type(other) and all(
            same(getattr(one, f.name), getattr(other, f.name)) for f in dataclasses.fields(one)
        )
    if one is None or isinstance(one, str):
        return one == other
    first, second = np.asarray(one, dtype=np.float64), np.asarray(other, dtype=np.float64)
    return first.shape == second.shape and first.tobytes() == second.tobytes()


def test_every_model_is_built_here():
    assert set(BUILDS) == set(MODELS)


@pytest.mark.parametrize("kind", BUILDS)
@FEW
@given(data=st.data())
def test_a_text_holds_the_same_bits(kind, data):
    drive = DriveModel(hysteresis=data.draw(BUILDS[kind]), **data.draw(chains))
    text = model_text(ModelFile(model=drive, warnings=("one: rate #only",), errors={"rms": 0.12}))
    back = read_model_text(text)
    assert back.warnings == ("one: rate #only",)
    assert back.errors == {"rms": 0.12}
    assert same(drive, back.model)
    assert model_text(back) == text


def test_texts_that_look_like_numbers_stay_texts():
    texts = {"hash": "12345e67", "serial": "007", "when": "2026-11-23", "is": "yes", "none": "~"}
    drive = DriveModel(hysteresis=Dahl(gain=0.1, stiffness=0.2, limit=0.3), start=np.inf)
    back = read_model_text(model_text(ModelFile(model=drive, provenance=texts)))
    assert back.provenance == texts
    assert back.model.start == np.inf
    assert back.warnings == ()


def test_a_delay_of_more_steps_than_memory_holds_is_refused():
    drive = DriveModel(hysteresis=Dahl(gain=0.1, stiffness=0.2, limit=0.3), lag=Lag(delay=3e8))
    with pytest.raises(ModelError, match=r"delay of 3e\+08 s is more than 10,000,000 steps"):
        drive.simulate([0.0, 1.0, 2.0], 1e-4)


def test_the_same_bits_check_sees_a_last_bit():
    one = Dahl(gain=0.1, stiffness=0.2, limit=0.3)
    assert same(one, Dahl(gain=0.1, stiffness=0.2, limit=0.3))
    assert not same(one, Dahl(gain=np.nextafter(0.1, 1.0), stiffness=0.2, limit=0.3))


DRIVE = DriveModel(
    hysteresis=Preisach(
        thresholds=np.array([0.0, 13.0]),
        knots=np.array([0.0, 50.0, 117.0]),
        slopes=np.array([[2.1e-7, 2.3e-7], [1.1e-7, 0.7e-7]]),
    ),
    creep=LogCreep(rate_per_decade=0.012),
    lag=Lag(delay=0.0047),
    offset=-3.1e-6,
    validity=ValidityRange(
        input_range=(0.0, 117.0), output_range=(0.0, 3e-5), rate_range_hz=(0.7, 8.0)
    ),
)
TEXT = model_text(ModelFile(model=DRIVE, provenance={"records": [{"file": "a.csv"}]}))


def replaced(old, new):
    assert TEXT.count(old) == 1, old
    return TEXT.replace(old, new)


def test_a_number_changed_by_hand_is_said():
    edited = read_model_text(replaced("offset: -3.1e-06", "offset: -3.2e-06"))
    assert edited.model.offset == -3.2e-6
    assert edited.warnings == ("the file was changed since it was written",)
    # comments and another spelling of the same numbers change nothing
    spelled = "# ours\n" + replaced("offset: -3.1e-06", "offset:   -0.0000031")
    assert read_model_text(spelled).warnings == ()
    assert read_model_text(TEXT).warnings == ()


def test_what_may_be_left_out_may_be_left_out():
    cut = TEXT[: TEXT.index("start:")].replace(", offset: -3.1e-06, sign: 1.0", "")
    back = read_model_text(cut).model
    assert (back.offset, back.sign, back.start, back.validity) == (0.0, 1.0, "rested", None)
    assert same(back.creep, DRIVE.creep)
    assert same(back.hysteresis, DRIVE.hysteresis)
    empty = cut + "validity:\nwarnings:\nerrors_percent_of_stroke:\nprovenance:\n"
    assert read_model_text(empty).warnings == ("the file was changed since it was written",)


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(20)
)
HOSTILE = {
    "nothing": ("", "is empty, expected a model file"),
    "a text": ("hello", "flexstage-drive-model"),
    "a list": ("- 1\n- 2\n", "flexstage-drive-model"),
    "a number": ("3.7", "flexstage-drive-model"),
    "another file": ("name: stage\nbodies: []\n", "flexstage-drive-model"),
    "no yaml": ("a: [1, 2\nb: }", "not YAML"),
    "tabs": ("a:\n\t- 1\n", "not YAML"),
    "two documents": (TEXT + "---\n" + TEXT, "a second document"),
    "control characters": ("flexstage-drive-model: 1\x00\x07", "not YAML"),
    "python object": ("!!python/object/apply:os.system ['true']", "tags"),
    "python tuple": (TEXT + "x: !!python/tuple [1, 2]\n", "tags"),
    "unknown tag": (TEXT + "x: !secret 5\n", "tags such as '!secret'"),
    "tagged bool": (TEXT + "x: !!bool foo\n", "tags"),
    "tagged time": (TEXT + "x: !!timestamp\n", "tags"),
    "tagged int of nothing": (TEXT + "x: !!int\n", "tags"),
    "tagged float of nothing": (TEXT + "x: !!float ''\n", "tags"),
    "bomb": (TEXT + BOMB, "anchors"),
    "bomb in the warnings": (BOMB + TEXT.replace("warnings: []", "warnings: *t"), "anchors"),
    "loop": (TEXT + "x: &x [*x]\n", "anchors"),
    "alias": (TEXT + "x: *y\n", "aliases"),
    "twice the same": (TEXT + "chain: {}\n", "'chain' is given twice"),
    "deep": (TEXT + "x: " + "[" * 100_000 + "\n", "nested"),
    "deep and closed": (TEXT + "x: " + "[" * 3000 + "]" * 3000 + "\n", "nested"),
    "long": ("#" * 1_000_001, "larger than 1 MB"),
    "many digits": (TEXT + f"x: {'7' * 4300}\n", "more than 60 digits"),
    "thirteenth month": (replaced("delay: 0.0047", "delay: 2024-13-41"), "got '2024-13-41'"),
    "beyond 64 bits": (replaced("per_decade: 2", f"per_decade: {2**70}"), "1 to 100 lags"),
    "creep of 1e300 s": (
        replaced("longest: 1000.0", "longest: 1e300"),
        "between 1e-12 and 1e+09 s",
    ),
    "delay of 1e300 s": (replaced("delay: 0.0047", "delay: 1e300"), "between 0 and 1e+09 s"),
    "version 2": (replaced("flexstage-drive-model: 1", "flexstage-drive-model: 2"), "newer"),
    "version 0": (replaced("flexstage-drive-model: 1", "flexstage-drive-model: 0"), "version 0"),
    "version yes": (replaced("flexstage-drive-model: 1", "flexstage-drive-model: yes"), "version"),
    "version text": (replaced("flexstage-drive-model: 1", "flexstage-drive-model: '1'"), "version"),
    "no hysteresis": (replaced("hysteresis:", "hysteresi:"), "mean 'hysteresis'?"),
    "no chain": (replaced("chain:", "chains:"), "mean 'chain'?"),
    "no output": (replaced("\noutput:", "\noutputs:"), "mean 'output'?"),
    "unknown model": (replaced("model: preisach", "model: ising"), "unknown model 'ising'"),
    "no model": (replaced("model: preisach", "modle_x: preisach"), "'model' is missing (one of"),
    "a list as model": (
        replaced("model: preisach", "model: [preisach]"),
        "expected one of asymmetric-bouc-wen, ",
    ),
    "another model": (
        replaced("model: preisach", "model: dahl"),
        "unknown key 'thresholds' (known: model, gain",
    ),
    "unknown key": (replaced("delay: 0.0047", "delay: 0.0047, dely: 1.0"), "did you mean 'delay'?"),
    "missing key": (replaced("rate_per_decade: 0.012, ", ""), "'rate_per_decade' is missing"),
    "text for a number": (
        replaced("delay: 0.0047", "delay: soon"),
        "chain.lag.delay: expected a number",
    ),
    "yes for a number": (
        replaced("delay: 0.0047", "delay: yes"),
        "expected a number without a unit, got 'yes'",
    ),
    "nan": (replaced("delay: 0.0047", "delay: .nan"), "nan"),
    "negative delay": (replaced("delay: 0.0047", "delay: -0.1"), "-0.1"),
    "infinite offset": (replaced("offset: -3.1e-06", "offset: .inf"), "finite offset"),
    "text offset": (replaced("offset: -3.1e-06", "offset: low"), "low"),
    "sign": (replaced("sign: 1.0", "sign: 0.5"), "expected a sign of 1 or -1"),
    "text for an element": (
        replaced("lag: {time_constant: 0.0, delay: 0.0047}", "lag: soon"),
        "expected a mapping of names to values, got 'soon'",
    ),
    "unit": (replaced("{unit: V}", "{unit: [V]}"), "input.unit: expected a text"),
    "nan in an array": (replaced("1.1e-07", ".nan"), "finite"),
    "text in an array": (replaced("1.1e-07", "high"), "slopes[1][0]: expected a number"),
    "number for an array": (
        replaced("[0.0, 13.0]", "13.0"),
        "hysteresis.thresholds: expected a list of numbers",
    ),
    "ragged": (replaced("[1.1e-07, 7.0e-08]", "[1.1e-07]"), "rows of one length"),
    "no lag": (replaced("  lag: {time_constant: 0.0, delay: 0.0047}\n", ""), "'lag' is missing"),
    "huge integer": (replaced("delay: 0.0047", f"delay: {'9' * 59}"), "delay"),
    "range": (replaced("input_range: [0.0, 117.0]", "input_range: [117.0, 0.0]"), "rising"),
    "infinite range": (replaced("input_range: [0.0, 117.0]", "input_range: [0.0, .inf]"), "finite"),
    "range of one": (replaced("input_range: [0.0, 117.0]", "input_range: [0.0]"), "two"),
    "no range": (replaced("input_range", "input_rang"), "did you mean 'input_range'?"),
    "another section": (TEXT + "zebra: 1\n", "unknown key 'zebra'"),
    "number for a unit": (replaced("{unit: V}", "{unit: 7}"), "write it in quotes"),
    "start": (replaced("start: rested", "start: resting"), "seconds of motion, got 'resting'"),
    "warnings": (replaced("warnings: []", "warnings: 5"), "list of texts"),
    "warnings of lists": (
        replaced("warnings: []", "warnings: [[1]]"),
        "warnings[0]: expected a text",
    ),
    "provenance": (TEXT[: TEXT.index("provenance:")] + "provenance: 7\n", "provenance"),
    "errors": (replaced("errors_percent_of_stroke: {}", "errors_percent_of_stroke: 3"), "errors"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_get_one_sentence(name):
    text, said = HOSTILE[name]
    with pytest.raises(ModelError) as refused:
        read_model_text(text, "'m.yaml'")
    sentence = str(refused.value)
    assert said in sentence
    assert sentence.startswith("'m.yaml'")
    assert len(sentence) < 600


def test_a_text_cut_anywhere_is_refused_or_said():
    for end in range(0, len(TEXT), 17):
        try:
            back = read_model_text(TEXT[:end])
        except ModelError:
            continue
        assert back.warnings == ("the file was changed since it was written",)
