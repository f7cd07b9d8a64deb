"""A description of tests that is written and read again is the same to the last bit."""

import math
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexstage.base.errors import FlexstageError, StageError, UnitError
from flexstage.experiments.campaign.plan import (
    EXCITATIONS,
    KINDS,
    Campaign,
    Columns,
    Test,
    campaign_text,
    read_campaign,
)
from flexstage.quantities.sensor import SensorSpecification
from flexstage.records.read_options import ReadOptions, TextLayout
from tests.strategies import names, texts

#: Awkward numbers on purpose: many digits, tiny, and what reads as an integer.
shares = st.one_of(st.just(0.0), st.floats(1e-9, 0.4), st.sampled_from([1e-4, 0.1, 1e-05]))
sizes = st.one_of(st.just(0.0), st.floats(1e-15, 1e3, allow_subnormal=False))
columns = st.one_of(st.none(), names, st.integers(0, 40).map(str))
lists = st.lists(names, max_size=3).map(tuple)
written = st.builds(
    Columns,
    **dict.fromkeys(
        (
            "command", "along", "across", "vertical", "roll", "pitch", "yaw", "input", "corner",
            "x", "y",
        ),
        columns,
    ),
    output=lists,
    spheres=lists,
)  # fmt: skip
readings = st.builds(
    ReadOptions,
    sample_rate=st.lists(st.floats(1e-3, 1e9), max_size=2).map(tuple),
    time=st.none()
    | st.integers(0, 40)
    | names.filter(lambda n: n == n.strip() and not n.isdecimal()),
    format=st.none() | st.sampled_from(["text", "tdms", "cmm"]),
    dataset=st.none() | names,
    text=st.builds(
        TextLayout,
        delimiter=st.none() | st.sampled_from([",", ";", "\t", " ", "tab", "|"]),
        decimal=st.none() | st.sampled_from([".", ","]),
        skip=st.integers(0, 40),
    ),
)
instruments = st.builds(
    SensorSpecification,
    name=names,
    calibration=shares,
    nonlinearity=shares,
    alignment=shares,
    abbe_offset=st.one_of(st.just(1e-198), st.floats(-0.3, 0.3)),
    abbe_uncertainty=sizes,
    temperature_uncertainty=sizes,
    expansion=st.floats(-1e-5, 1e-4),
    length_of_loop=sizes,
    drift=sizes,
    resolution_step=sizes,
    time_base=shares,
)
bands = st.tuples(st.floats(0.0, 1e4), st.floats(1e-6, 1e4)).map(lambda b: (b[0], b[0] + b[1]))


@st.composite
def described(draw: st.DrawFn, name: str, sensors: list[str]) -> Test:
    sensor = st.none() | st.sampled_from(sensors) if sensors else st.none()
    return draw(
        st.builds(
            Test,
            name=st.just(name),
            test=st.sampled_from(sorted(KINDS)),
            axis=names,
            records=st.lists(names, min_size=1, max_size=3).map(tuple),
            columns=written,
            units=written,
            reading=readings,
            along=sensor,
            transverse=sensor,
            angle=sensor,
            excitation=st.sampled_from(EXCITATIONS),
            modes=st.none() | st.integers(1, 30),
            band=st.none() | bands.filter(lambda b: b[1] > b[0]),
            confidence=st.floats(0.5, 1.0, exclude_min=True, exclude_max=True),
            smallest_steps=st.booleans(),
            smallest_step=st.none() | st.floats(1e-12, 1e-3),
        )
    )


@st.composite
def campaigns(draw: st.DrawFn) -> Campaign:
    sensors = draw(st.lists(instruments, max_size=3, unique_by=lambda i: i.name))
    called = draw(st.lists(names, min_size=1, max_size=3, unique=True))
    listed = [draw(described(name, [s.name for s in sensors])) for name in called]
    return Campaign(
        stage=draw(st.just("") | names),
        origin=draw(st.sampled_from(["measured", "virtual"])),
        instruments=tuple(sensors),
        tests=tuple(listed),
        notes=tuple(draw(st.lists(texts, max_size=2))),
    )


def read(text: str, folder: Path) -> Campaign:
    path = folder / "campaign.yaml"
    path.write_bytes(text.encode())
    return read_campaign(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("campaigns")


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(campaign=campaigns())
def test_round_trip(campaign: Campaign, folder: Path) -> None:
    again = read(campaign_text(campaign), folder)
    assert again == campaign
    # repr tells -0.0 from 0.0 and shows all digits of a float
    assert repr(again) == repr(campaign)


def test_what_only_equals_the_usual_is_written(folder: Path) -> None:
    # -0.0 is the usual offset to a comparison, and another number
    probe = SensorSpecification(name="probe", abbe_offset=-0.0, drift=0.0)
    test = Test(name="t", test="hold", axis="x", records=("a",), along="probe")
    campaign = Campaign(instruments=(probe,), tests=(test,))
    text = campaign_text(campaign)
    assert "abbe_offset" in text
    assert "drift" not in text
    assert repr(read(text, folder)) == repr(campaign)


def test_quantities_keep_their_units(folder: Path) -> None:
    text = """
campaign: 1
instruments:
  probe: {alignment: 20 arcsec, abbe_offset: -3.7 mm, expansion: 23.1 um/m/K,
    resolution_step: 1.5 nm}
tests:
  loop:
    test: response
    axis: x
    records: [a.csv]
    columns: {input: 1, output: [2, tip]}
    units: {input: mN, output: [um]}
    reading: {sample_rate: 12.5 kHz, time: 0}
    band: [80 Hz, 1.3 kHz]
    smallest_step: 460 nm
"""
    found = read(text, folder)
    (probe,), (test,) = found.instruments, found.tests
    assert probe.alignment == pytest.approx(math.radians(20.0 / 3600.0), rel=1e-15)
    assert (probe.abbe_offset, probe.resolution_step) == (-3.7e-3, 1.5e-9)
    assert probe.expansion == pytest.approx(23.1e-6, rel=1e-15)
    assert (test.reading.rate, test.reading.time) == (12500.0, 0)
    assert (test.band, test.smallest_step) == ((80.0, 1300.0), 4.6e-7)
    # units of columns are kept as they are said: records are read with them
    assert (test.units.input, test.units.output) == ("mN", ("um",))
    assert (test.columns.input, test.columns.output) == ("1", ("2", "tip"))
    assert repr(read(campaign_text(found), folder)) == repr(found)


def test_what_is_as_usual_is_left_out() -> None:
    test = Test(name="t", test="hold", axis="x", records=("a",))
    text = campaign_text(Campaign(tests=(test,)))
    assert text.split() == [
        "campaign:", "1", "tests:", "t:", "axis:", "x", "test:", "hold", "records:", "[a]",
    ]  # fmt: skip


HEAD = "campaign: 1\ntests:\n  t:\n    test: hold\n    axis: x\n    records: [a.csv]\n"


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("tests: {}\n", 1, "begins with 'campaign: 1'"),
        ("- 1\n", 1, "begins with 'campaign: 1'"),
        ("campaign: 2\ntests: {}\n", 1, "version 2 is not known"),
        ("campaign: one\n", 1, "expected a number"),
        ("campaign: 1\n", 1, "'tests' is missing"),
        (HEAD.replace("hold", "holding"), 4, "unknown kind 'holding': choose from"),
        (HEAD.replace("    axis: x\n", ""), 4, "'axis' is missing"),
        (HEAD.replace("[a.csv]", "a.csv"), 6, "expected a list"),
        (HEAD.replace("[a.csv]", "[]"), 4, "names no record"),
        (HEAD + "    column: {along: 1}\n", 7, "unknown key 'column'.*did you mean 'columns'"),
        (HEAD + "    columns: {alon: 1}\n", 7, "unknown key 'alon'.*did you mean 'along'"),
        (HEAD + "    along: laser\n", 7, "the instrument 'laser' is not described"),
        (HEAD + "    band: [9 Hz, 4 Hz]\n", 4, "the band of test .* must rise"),
        (HEAD + "    band: [9 mm, 4 mm]\n", 7, "not a frequency|is a length|frequency"),
        (HEAD + "    band: [9 Hz]\n", 7, "2 values"),
        (HEAD + "    smallest_step: 0.4\n", 7, "has no unit"),
        (HEAD + "    smallest_steps: 1\n", 7, "true or false"),
        (HEAD + "    reading: {sample_rate: 3 um}\n", 7, "frequency"),
        (HEAD + "instruments:\n  g: {calibration: 0.1 %}\n", 8, "number without a unit"),
        (HEAD + "instruments:\n  g:\n    calibration: -1\n", 9, "instrument 'g': calibration"),
        (HEAD + "origin: guessed\n", 7, "expected one of measured, virtual"),
    ],
)
def test_mistakes_are_placed(folder: Path, text: str, line: int, said: str) -> None:
    with pytest.raises((StageError, UnitError, FlexstageError), match=said) as error:
        read(text, folder)
    where = f"{folder / 'campaign.yaml'}, line "
    assert str(error.value).startswith(where)
    assert int(str(error.value).removeprefix(where).partition(":")[0].partition(",")[0]) == line
    assert "\n" not in str(error.value)


def refused(text: str, folder: Path) -> None:
    path = folder / "any.yaml"
    path.write_bytes(text.encode("utf-8", "replace"))
    with pytest.raises(FlexstageError):
        read_campaign(path)


@given(text=st.text(max_size=120))
def test_no_text_ends_in_anything_but_an_error_of_ours(text: str, folder: Path) -> None:
    refused(text, folder)


@pytest.mark.parametrize(
    "text",
    [
        "campaign: 1\ntests: !!binary x",
        "campaign: .nan",
        "campaign: [1]",
        "campaign: 1\ntests: {t: 3}",
        "campaign: 1\ntests: {t: {along: [1]}}",
        "campaign: 1\ntests: []",
        "campaign: 1\ninstruments: 4\ntests: {}",
    ],
)
def test_wrong_shapes(text: str, folder: Path) -> None:
    refused(text, folder)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FlexstageError, match="nowhere"):
        read_campaign(tmp_path / "nowhere.yaml")
