"""A request and the command line that asks for the same say one thing."""

import contextlib
import json
import math
import shlex
from dataclasses import MISSING, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexstage.base.errors import FlexstageError, ModelError, RecordError
from flexstage.centring.requests import CentreRequest
from flexstage.cli.options import from_docstring
from flexstage.experiments.requests import CharacteriseRequest, SensorUncertainty
from flexstage.files.decoder import read_json
from flexstage.files.format import Format
from flexstage.files.ranges import POSITIVE, PositiveFrequency, Range, Written
from flexstage.files.request import (
    Request,
    command_line,
    option_words,
    request_fields,
    request_groups,
    request_of,
)
from flexstage.files.schema import field_texts
from flexstage.hinges.requests import HingesRequest
from flexstage.hysteresis.requests import (
    AmplifierLimits,
    CompensateRequest,
    ExciteRequest,
    IdentifyRequest,
    KnownChain,
    PredictRequest,
)
from flexstage.instruments.requests import RunsRequest, TwinRequest
from flexstage.measure.requests import FrfRequest, UncertaintyRequest
from flexstage.quantities.units import DIMENSIONS, Length
from flexstage.records.read_options import DriveColumns, ReadOptions, TextLayout
from flexstage.stage.bench import Bench
from flexstage.studies.explore.requests import (
    OptimiseRequest,
    ReconstructRequest,
    SensitivityRequest,
    SweepRequest,
    ToleranceRequest,
)
from flexstage.studies.requests import AnalyseRequest, BudgetRequest, ModelOptions, StudyRequest
from flexstage.system.requests import EquationsRequest

#: One of each request, with values that are not the usual ones.
EXAMPLES: tuple[Request, ...] = (
    AnalyseRequest(
        model=("lumped", "solid"),
        options=ModelOptions(bench=Bench(base=11.5e-6, holder=1.3e-6, holder_length=-0.06)),
    ),
    BudgetRequest(environment=Path("floor.yaml"), loop=("100 Hz", "tune"), exposure=0.013,
                  duration=2.5, wanted_rms=3e-9),
    CentreRequest(
        error=("e", 2), angle=0, heads=(0.0, 1.25), radius=0.0517, kind="drum", orders=(2, 3),
        sign=-1, stage_at=((1e-6, 0.0), (-2.5e-6, 3e-5)), mounting_angle=0.3, outliers=False,
    ),
    CharacteriseRequest(
        axis="y", test="spheres", column=("along=2",), commands=(0.0, 5e-6),
        sensor=SensorUncertainty(calibration=1.3e-3),
        reading=ReadOptions(rows=(3, 70)),
    ),
    CompensateRequest(
        relative=True, voltage=(-3.0, 117.5), after=7.5,
        amplifier=AmplifierLimits(current=0.05, capacitance=6.4e-6),
    ),
    DriveColumns(input=("1 mV",), branches=("up, raw", "down")),
    EquationsRequest(),
    ExciteRequest(voltage=(0.5, 99.0), rates=(0.3, 3.7), multisine=False, seed=4),
    FrfRequest(
        input=("f",), output=("a", 3), band=(12.5, 900.0), fit=("delay", "complex"),
        near=(75.0, 90.5), window="exponential 5 %", excitation="hammer",
    ),
    HingesRequest(),
    IdentifyRequest(
        model=("dahl", "duhem"), train=(None, 900),
        known=KnownChain(delay=3.1e-3, creep=0.012, resonance=813.0),
        zero="drift",
    ),
    OptimiseRequest(maximise=("mass",), over=("neck=20 %",), start="middle", confirm="plane"),
    ReconstructRequest(match=("mass = 50 g",), free=("neck=20 %",), members=7, time_limit=33.0),
    PredictRequest(after="walk 1.csv,walk 2.csv"),
    ReadOptions(
        sample_rate=(200.0, 12.5), time="t", resample=(None,),
        text=TextLayout(skip=2, delimiter="\t", decimal=","),
    ),
    RunsRequest(),
    SensitivityRequest(of=("mass",), hinges=True, per=3.3e-6),
    StudyRequest(parts=("virtual", "traditional")),
    SweepRequest(over=("neck=0.3..0.8 mm/6",), plan="sobol", samples=70, indices=True),
    ToleranceRequest(samples=77, scatter=("*=0",), target_yield=0.973, follow_necks=True),
    TwinRequest(servo_rate=12.5e3, amplifier="charge", axes=("X", "Y"), address=("::1", 0)),
    UncertaintyRequest(),
)  # fmt: skip
REQUESTS = tuple(type(example) for example in EXAMPLES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Load(Request):
    """What is one value of another."""

    one_value: ClassVar[bool] = True

    mass: Annotated[float, DIMENSIONS["mass"], POSITIVE] | None = None
    """How heavy."""
    on: tuple[str, ...] = ()
    """On what."""
    sign: str = "."
    """Its sign."""
    held: bool = False
    """Whether it is held."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnRequest(Request):
    """Everything that a field can be."""

    by: Annotated[Length, POSITIVE] | None = None
    """How far."""
    times: Annotated[int, Range(low=1, high=9)] = 3
    """How often."""
    share: Annotated[float, Range(low=0.0, high=1.0)] = 0.25
    """Which part."""
    band: Annotated[tuple[float, float], DIMENSIONS["frequency"], Written(bare="Hz")] | None = None
    """Between what."""
    way: Literal["left", "right"] = "left"
    """Which way."""
    of: tuple[str, ...] = ()
    """Of what."""
    at: Annotated[tuple[Length, ...], Written("LENGTHS", commas=True)] = ()
    """Where."""
    back: bool = False
    """Whether back."""
    stop: bool = True
    """Whether it stops."""
    near: Annotated[tuple[PositiveFrequency, ...], Written("LIST", commas=True)] = ()
    """Near what."""
    load: Load = Load()
    """What it carries."""
    how: ReadOptions = ReadOptions()
    """How files are read."""


def read_back(words: list[str], kind: type[Request]) -> Request:
    """Return the request that a command makes of words, without the command line's own parser."""
    found: dict[str, Any] = {}
    fields = {f.option: f for f in request_fields(kind).values()}
    groups = dict(request_groups(kind))
    left = list(words)
    rest: list[str] = []
    while left:
        option = left.pop(0)
        name = option.replace("--no-", "--", 1) if option not in fields else option
        field = fields.get(name)
        if field is None:
            rest += [option, left.pop(0)]
        elif field.value is bool:
            found[field.name] = option == name
        elif field.repeated:
            found[field.name] = (*found.get(field.name, ()), field.read(left.pop(0)))
        else:
            found[field.name] = field.read(left.pop(0))
    for name, group in groups.items():
        own = {f.option for f in request_fields(group).values()}
        pairs = list(zip(rest[::2], rest[1::2], strict=True))
        words = [word for pair in pairs if pair[0] in own for word in pair]
        found[name] = read_back(words, group)
    return kind(**found)


lengths = st.floats(1e-9, 10.0)
words = st.text(st.characters(categories=["L", "N"]), min_size=1)


@given(
    st.builds(
        TurnRequest,
        by=st.none() | lengths,
        times=st.integers(1, 9),
        share=st.floats(0.0, 1.0),
        band=st.none() | st.tuples(st.floats(0.0, 9.0), st.floats(9.5, 1e5)),
        way=st.sampled_from(["left", "right"]),
        of=st.lists(words, max_size=3).map(tuple),
        at=st.lists(lengths, max_size=3).map(tuple),
        back=st.booleans(),
        stop=st.booleans(),
        load=st.builds(
            Load,
            mass=st.none() | lengths,
            sign=st.sampled_from([".", ",", ";", "x"]),
            held=st.booleans(),
        ),
        how=st.builds(
            ReadOptions,
            sample_rate=st.lists(st.floats(1e-3, 1e6), max_size=2).map(tuple),
            rows=st.none() | st.tuples(st.none() | st.integers(0, 9), st.integers(10, 99)),
            time=st.none() | st.integers(0, 9),
            resample=st.sampled_from([(), (None,), (12.5, None)]),
            text=st.builds(
                TextLayout,
                delimiter=st.sampled_from([None, ",", ";", "tab", " ", "|"]),
                decimal=st.sampled_from([None, ".", ","]),
            ),
        ),
    )
)
def test_a_command_line_asks_for_the_same(request_: TurnRequest) -> None:
    said = command_line(request_, "plate")
    assert shlex.split(said)[:3] == ["flexstage", "turn", "plate"]
    assert read_back(option_words(request_), TurnRequest) == request_


@pytest.mark.parametrize("request_", EXAMPLES, ids=lambda one: type(one).__name__)
def test_each_is_read_back_from_its_command_line(request_: Request) -> None:
    assert read_back(option_words(request_), type(request_)) == request_


def test_what_is_as_usual_is_not_said() -> None:
    for kind in REQUESTS:
        if all(f.default is not MISSING for f in request_fields(kind).values()):
            assert option_words(kind()) == [], kind


@pytest.mark.parametrize("kind", REQUESTS, ids=lambda kind: kind.__name__)
def test_every_field_has_a_text_and_its_default_is_one_that_is_read(kind: type[Request]) -> None:
    texts = field_texts(kind)
    for name, field in request_fields(kind).items():
        assert texts[name].endswith("."), name
        assert field.metavar
        if field.value is bool or field.default in (None, (), MISSING):
            continue
        back = [field.read(text) for text in field.texts(field.default)]
        assert (tuple(back) if field.repeated else back[0]) == field.default


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("by", "3", "has no unit"),
        ("by", "0 mm", "must be above 0 m, got '0 mm'"),
        ("by", "3 Hz", "is not a unit of length"),
        ("times", "10", "a whole number from 1 to 9, got '10'"),
        ("times", "2.5", "expected a whole number, got '2.5'"),
        ("share", "30", "must be from 0 to 1, got '30'; write \"30 %\""),
        ("share", "much", "expected a share"),
        ("share", "nan", "finite"),
        ("band", "200", 'must be a range LOW:HIGH, such as "10 Hz:20 Hz"'),
        ("band", "800:200", "must rise"),
        ("way", "lefd", "must be left or right, got 'lefd'; did you mean 'left'"),
        ("at", "1 mm,2", "has no unit"),
    ],
)
def test_a_text_that_is_no_value(name: str, text: str, said: str) -> None:
    with pytest.raises(FlexstageError) as error:
        request_fields(TurnRequest)[name].read(text)
    assert said in str(error.value)


def test_texts_are_read_in_any_of_their_forms() -> None:
    fields = request_fields(TurnRequest)
    assert fields["band"].read("0.2 kHz..800") == (200.0, 800.0)
    assert fields["share"].read("30 %") == pytest.approx(0.3)
    assert fields["at"].read("1 mm, 2 um") == (1e-3, 2e-6)
    assert fields["near"].read("3 Hz,0.2 kHz") == (3.0, 200.0)  # what is written outside counts
    assert fields["near"].metavar == "LIST"


@pytest.mark.parametrize("kind", REQUESTS, ids=lambda kind: kind.__name__)
def test_nothing_that_is_given_ends_in_another_error(kind: type[Request]) -> None:
    (example,) = (one for one in EXAMPLES if type(one) is kind)
    texts = ("", "nan", "inf", "-1", ",", ":", "2:1", ";", "%", "1 mm", "9" * 400, "1e999", "\0")
    values = (None, True, 3, 2.5, "x", (), (1,), (2, 1), [1], {"a": 1}, math.nan, b"x", 10**400)
    for name, field in request_fields(kind).items():
        for text in texts if field.value is not bool else ():
            with contextlib.suppress(FlexstageError):
                value = field.read(text)
                replace(example, **{name: (value,) if field.repeated else value})
        for value in values:
            with contextlib.suppress(FlexstageError):
                option_words(request_of(kind, example, {name: value}))


def test_a_program_gives_values_or_the_texts_of_options() -> None:
    made = request_of(TurnRequest, None, {"by": "2 mm", "of": "mass", "at": 1e-3, "band": "1:2"})
    assert made == TurnRequest(by=2e-3, of=("mass",), at=(1e-3,), band=(1.0, 2.0))
    assert request_of(TurnRequest, made, {"times": 5}).by == 2e-3
    assert request_of(TurnRequest, made, {"by": None, "band": None}) == TurnRequest(
        of=("mass",), at=(1e-3,)
    )
    assert request_of(CentreRequest, None, {"error": "e", "heads": "0,90"}).heads == (
        0.0,
        pytest.approx(math.pi / 2.0),
    )
    scatter = request_of(ToleranceRequest, None, {"scatter": {"neck_own": "1 um"}}).scatter
    assert scatter == ("neck_own=1 um",)
    with pytest.raises(ModelError, match=r"unknown option 'tims'.*did you mean 'times'"):
        request_of(TurnRequest, None, {"tims": 2})
    load = Load(mass=0.2, sign=",", held=True)
    assert request_of(TurnRequest, None, {"load": "sign=,, mass=200 g, held=yes"}).load == load
    assert (
        request_of(TurnRequest, None, {"load": {"mass": "0.2 kg", "sign": ",", "held": True}}).load
        == load
    )
    for text, said in (
        ("200 g", "must be NAME=VALUE of mass, on, sign, held, got '200 g'"),
        ("mas=200 g", "unknown name 'mas'.*did you mean 'mass'"),
        ("mass=2 mm", "mass .*mm"),
        ("mass=-2 g", "mass must be above 0"),
        ("held=true", "held must be yes or no, got 'true'"),
    ):
        with pytest.raises(ModelError, match=f"load: {said}"):
            request_of(TurnRequest, None, {"load": text})
    with pytest.raises(ModelError, match="times must be a whole number from 1 to 9, got 10"):
        TurnRequest(times=10)
    for wrong in (
        {"times": 2.5}, {"times": "many"}, {"by": True}, {"by": (1.0,)}, {"share": math.nan},
        {"band": (2.0, 1.0)}, {"band": (1.0,)}, {"back": "no"}, {"way": "lefd"}, {"of": "mass"},
        {"at": (0.1, "far")}, {"times": None},
    ):  # fmt: skip
        with pytest.raises(ModelError, match=f"{next(iter(wrong))} must be "):
            TurnRequest(**wrong)
    assert repr(TurnRequest(times=4.0).times) == "4"
    with pytest.raises(ModelError, match="over must be a text, got 3"):
        request_of(SweepRequest, None, {"over": 3})
    with pytest.raises(RecordError, match="sample_rate: expected a frequency"):
        request_of(ReadOptions, None, {"sample_rate": "fast"})
    with pytest.raises(RecordError, match="unknown option 'rate'"):
        request_of(ReadOptions, None, {"rate": 2})


@pytest.mark.parametrize(("text", "share"), [("0 %", 0.0), ("1.5%", 0.015), ("0.25", 0.25)])
def test_a_file_may_give_shares_in_per_cent(text: str, share: float) -> None:
    form = Format(noun="turn", error=ModelError)
    said = text if text.endswith("%") else float(text)
    assert read_json(TurnRequest, json.dumps({"share": said}), "turn", form).share == share
    with pytest.raises(ModelError, match=r"expected a number from 0 to 1.*got '130 %'"):
        read_json(TurnRequest, '{"share": "130 %"}', "turn", form)


def test_options_of_a_command_make_the_request() -> None:
    got: list[TurnRequest] = []

    @from_docstring
    def turn(*, request: TurnRequest) -> None:
        """Turn."""
        got.append(request)

    defaults = dict.fromkeys((*request_fields(TurnRequest), *request_fields(ReadOptions)))
    turn(**{**defaults, "of": ["a", "b"], "times": 4, "back": True, "stop": False, "quiet": True})
    assert got == [TurnRequest(of=("a", "b"), times=4, back=True, stop=False)]
