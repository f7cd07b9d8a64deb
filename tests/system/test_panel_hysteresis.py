"""The view Hysteresis: what the commands find and write, in a page."""

import asyncio
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flexstage.base.errors import ModelError, RecordError
from flexstage.cli import main
from flexstage.hysteresis.inversion import reading_in_proportion
from flexstage.hysteresis.requests import (
    AmplifierLimits,
    CompensateRequest,
    IdentifyRequest,
    KnownChain,
)
from flexstage.records import read_record
from flexstage.records.read_options import DriveColumns, ReadOptions
from flexstage.virtual.stack import virtual_stack
from flexstage.web.hysteresis.requests import DesiredMotion, FileSelection
from flexstage.web.hysteresis.state import HysteresisState, MeasuredFiles, OpenModel
from flexstage.web.hysteresis.work import (
    FilePreview,
    IdentifiedModel,
    command,
    default_motion,
    example_record,
    identify_drive,
    open_model_file,
    predict_files,
    read_contents,
    validation_example,
    waveform,
)
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import Task
from tests.panel import looked_at, simulated

RATE = 200.0
#: A known chain: what is looked for is the hysteresis alone, which is quick.
SEARCH = IdentifyRequest(model=("dahl", "prandtl-ishlinskii"), known=KnownChain(delay=0.0))


def drive_file(folder: Path) -> Path:
    """Write a record of a virtual stack, of falling cycles, without units, names or times."""
    t = np.arange(1400) / RATE
    u = 55.0 * (1.0 - np.clip(1.25 - t / t[-1], 0.2, 1.0) * np.cos(2.0 * np.pi * 1.25 * t))
    y = 1e6 * virtual_stack((0.0, 120.0), 38e-6, 0.12).simulate(u).values - 17.2
    y += np.random.default_rng(8).normal(0.0, 0.02, t.size)
    path = folder / "drive.dat"
    np.savetxt(path, np.column_stack((u, np.full(t.size, -3.0), y)), delimiter="\t")
    return path


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FileSelection, IdentifiedModel]:
    path = drive_file(tmp_path_factory.mktemp("drive"))
    reading = FileSelection(
        files=(str(path),),
        columns=DriveColumns(input=(0,), output=(2,)),
        input_unit="V",
        output_unit="um",
        options=ReadOptions(sample_rate=200.0),
    )
    return path, reading, identify_drive(reading, SEARCH, "loop")


def said_by(capsys: Any, *words: object) -> dict[str, Any]:
    """What a command says as JSON."""
    with pytest.raises(SystemExit) as ended:
        main([*(str(word) for word in words), "--json"])
    assert ended.value.code == 0
    return json.loads(capsys.readouterr().out)


def test_it_is_what_the_commands_find_and_write(
    capsys: Any, tmp_path: Path, drive: tuple[Path, FileSelection, IdentifiedModel]
) -> None:
    path, reading, made = drive
    read = ["--sample-rate", "200", "--input", "0 V", "--output", "2 um"]
    model = tmp_path / "m.yaml"
    told = said_by(
        capsys, "identify", path, *read, "--known", "delay=0 s",
        "--model", "dahl,prandtl-ishlinskii", "--out", model,
    )  # fmt: skip
    found = made.identification
    assert told["model"] == found.kind
    assert told["heldout_rms_percent"] == found.heldout_rms_percent
    assert [c["heldout_rms_percent"] for c in told["candidates"]] == [
        c.heldout_rms_percent for c in found.candidates
    ]
    assert told["warnings"] == list(found.warnings)
    by_command, _ = open_model_file(model)
    (tmp_path / "page.yaml").write_text(made.text, encoding="utf-8")
    by_page, _ = open_model_file(tmp_path / "page.yaml")
    assert by_page.errors == by_command.errors
    assert by_page.provenance["records"] == by_command.provenance["records"]
    mine, theirs = (file.model.hysteresis.parameters() for file in (by_page, by_command))
    np.testing.assert_equal(mine, theirs)

    wanted = tmp_path / "wanted.csv"
    t = np.arange(800) / RATE
    np.savetxt(wanted, 12.0 - 9.0 * np.cos(2.5 * np.pi * t), header="wanted (um)", comments="")
    told = said_by(
        capsys, "compensate", model, "--reference", wanted, "--relative", "--sample-rate", 200,
        "--amplifier", "slew=300 V/s", "--out", tmp_path / "command.npz",
        "--figure", tmp_path / "c.svg",
    )  # fmt: skip
    file = FileSelection(
        files=(str(wanted),),
        columns=DriveColumns(output=(0,)),
        options=ReadOptions(sample_rate=200.0),
    )
    asked = CompensateRequest(relative=True, amplifier=AmplifierLimits(slew=300.0))
    motion = DesiredMotion(shape="file", file=file, request=asked)
    follows, notes = command(made.file.model, motion)
    assert told["predicted_rms_error"] == follows.rms_error
    assert sorted(told["notes"]) == sorted([*made.file.notes, *notes])
    (tmp_path / "mine.npz").write_bytes(waveform(follows, made.file.model, "npz"))
    assert "predicted − desired".encode() in (tmp_path / "c.svg").read_bytes()
    for name in ("command", "predicted"):
        own, other = (read_record(tmp_path / f).channel(name) for f in ("mine.npz", "command.npz"))
        np.testing.assert_array_equal(own.values, other.values)

    told = said_by(capsys, "predict", model, path, "--input", 0, "--output", 2, *read)
    (again,) = predict_files(made.file, reading, "auto", "p").predictions
    assert told["records"][0]["as_predicted_rms_percent"] == again.as_predicted_rms_percent
    # after another record, and a motion after it
    copy = tmp_path / "before.csv"
    copy.write_bytes(path.read_bytes() + b"\n")
    before = replace(reading, files=(str(copy),))
    told = said_by(
        capsys, "predict", model, path, "--input", 0, "--output", 2, *read, "--after", copy
    )
    (again,) = predict_files(made.file, reading, before, "p").predictions
    assert told["records"][0]["as_predicted_rms_percent"] == again.as_predicted_rms_percent
    assert again.warm_up == 0
    after, notes = command(made.file.model, replace(motion, before=before))
    assert any("before.csv" in note for note in notes)
    assert np.abs(after.command - follows.command).max() > 0.1


def test_columns_are_found_where_the_file_leaves_no_doubt(tmp_path: Path) -> None:
    path = drive_file(tmp_path)
    plain, (found,), _ = read_contents(FileSelection(files=(str(path),)))
    # the column between them stands still
    assert (plain.text("input"), plain.text("output"), found["over"]) == ("0", "2", "point")
    assert "Sample rate" in MeasuredFiles(plain, FilePreview(plain, (found,), "")).missing()
    rated, (found,), _ = read_contents(plain.changed("sample_rate", "0.2 kHz"))
    assert found["sample_rate_hz"] == pytest.approx(200.0)
    assert MeasuredFiles(rated, FilePreview(rated, (found,), "")).missing() == ""
    swapped = tmp_path / "swapped.csv"
    swapped.write_text("Time,x (um),drive (V)\n0,1,0\n1,2,5\n2,3,8\n", encoding="utf-8")
    by_unit = read_contents(FileSelection(files=(str(swapped),)))[0]
    assert [by_unit.text(name) for name in ("input", "output", "time")] == ["2", "1", "0"]
    chosen = read_contents(FileSelection(files=(str(swapped),)).changed("input", "1"))[0]
    assert (chosen.text("input"), chosen.text("output")) == ("1", "")


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("two.csv", b"0,1\n", "needs at least two samples"),
        ("words.csv", b"to be or not to be\nthat is the question\n", "words.csv"),
        ("binary.dat", bytes(range(256)) * 40, "binary.dat"),
        ("cut.h5", b"\x89HDF\r\n\x1a\n\0\0", "cut.h5"),
        ("empty.csv", b"", "empty.csv"),
    ],
)
def test_a_file_that_is_none_is_refused_in_a_sentence(
    tmp_path: Path, name: str, content: bytes, told: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RecordError, match=told):
        read_contents(FileSelection(files=(str(path),)))


def test_what_cannot_be_identified_is_said_in_a_sentence(
    tmp_path: Path, drive: tuple[Path, FileSelection, IdentifiedModel]
) -> None:
    _, reading, _ = drive
    with pytest.raises(RecordError, match="sample rate"):
        identify_drive(reading.changed("sample_rate", ""), SEARCH, "a")
    with pytest.raises(RecordError, match="no column '9 um'"):
        identify_drive(reading.changed("output", "9"), SEARCH, "a")
    gap = tmp_path / "nan.csv"
    gap.write_text("u (V),y (um)\n0,1\n1,nan\n2,3\n", encoding="utf-8")
    with pytest.raises(RecordError, match="NaN"):
        identify_drive(replace(reading.changed("output", "1"), files=(str(gap),)), SEARCH, "a")


def test_a_motion_is_followed_within_what_the_drive_reaches(
    drive: tuple[Path, FileSelection, IdentifiedModel],
) -> None:
    model = drive[2].file.model
    low, high = model.validity.output_range  # type: ignore[union-attr]
    motion = default_motion(DesiredMotion(), model, RATE)
    assert motion.centre == pytest.approx(0.5 * (low + high))
    assert (motion.sample_rate_hz, motion.rate_hz) == (RATE, 1.25)
    for periods, samples in ((3, 480), (0, 160)):
        made, _ = command(model, replace(motion, periods=periods, shape="triangle"))
        assert made.command.size == samples
        assert np.ptp(made.requested) == pytest.approx(0.8 * (high - low), rel=1e-3)
        assert made.largest_error < 1e-3 * (high - low)
    plain = reading_in_proportion(model, made, endless=True) - made.requested
    # an eighth of the stroke is the width of the loop
    assert 0.01 < np.sqrt(np.mean(plain**2)) / (high - low) < 0.12
    with pytest.raises(ModelError, match="amplitude must be positive"):
        command(model, replace(motion, amplitude=-1e-6))
    with pytest.raises(ModelError, match="more than 1000000 samples"):
        command(model, replace(motion, rate_hz=1e-5))
    lowest = model.validity.input_range[0]  # type: ignore[union-attr]
    narrowed = replace(motion, request=CompensateRequest(voltage=(lowest, 60.0)))
    narrow, notes = command(model, narrowed)
    assert narrow.command.max() <= 60.0
    assert any("limits changed" in note for note in notes)


def test_the_example_and_its_other_record_are_of_one_drive(tmp_path: Path) -> None:
    first, other = (read_record(f(tmp_path)) for f in (example_record, validation_example))
    ranges = [np.ptp(record.channel("position").values[400:]) for record in (first, other)]
    assert ranges[1] == pytest.approx(ranges[0], rel=0.02)
    assert 30e-6 < ranges[0] < 45e-6


async def come(condition: Callable[[], Any], seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        await asyncio.sleep(0.02)


def test_a_wrong_file_loses_nothing(
    tmp_path: Path, drive: tuple[Path, FileSelection, IdentifiedModel]
) -> None:
    path, _, _ = drive

    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        (session,) = panel.access._sessions.values()
        state = session.state(HysteresisState)

        def alerts() -> list[str]:
            return [e.text for e in user.find(ui.label).elements if "error" in e.classes]

        state.source.open(
            FileSelection(files=(str(path),), columns=DriveColumns(input=(0,), output=(2,)))
        )
        await user.open("/hysteresis")
        await come(lambda: state.source.preview)
        (rate,) = (e for e in user.find(ui.input).elements if e.label == "Sample rate")
        rate.value = "fast"
        await come(alerts)
        assert "'fast'" in alerts()[0]
        (unit,) = (e for e in user.find(ui.input).elements if e.label == "Input unit")
        unit.value = "V"
        await come(lambda: state.source.selection.input_unit == "V")
        await asyncio.sleep(0.3)
        assert (rate.value, "'fast'" in alerts()[0]) == ("fast", True)  # it is still to be mended
        assert state.source.missing()
        rate.value = "200 Hz"
        await come(lambda: not alerts() and not state.source.missing())
        wrong = panel.folder("hysteresis/some-one") / "wrong.csv"
        wrong.write_bytes(b"\0" * 400)
        state.source.open(FileSelection(files=(str(wrong),)))
        await user.open("/hysteresis")
        await come(alerts)
        assert alerts()[0].startswith("'wrong.csv'")
        user.find("Back to drive.dat").click()
        await come(lambda: not alerts())
        assert state.source.selection.options.rate == 200.0

    simulated(tmp_path, look)


def test_limits_of_a_command_are_those_of_the_request(
    tmp_path: Path, drive: tuple[Path, FileSelection, IdentifiedModel]
) -> None:
    _, _, made = drive

    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        (session,) = panel.access._sessions.values()
        state = session.state(HysteresisState)
        state.step = "compensate"
        state.open_model(OpenModel(name="drive", file=made.file, text=made.text))
        await user.open("/hysteresis")

        def give(label: str, value: Any) -> None:
            fields = (e for kind in (ui.number, ui.input) for e in user.find(kind).elements)
            fields = (e for e in fields if e.props["label"] == label)
            min(fields, key=lambda e: e.id).value = value  # that of the step before the next one

        give("Voltage", "2:60")
        await come(lambda: state.motion.request.voltage == (2.0, 60.0))
        give("Amplifier", "slew=900 V/s")
        await come(lambda: state.motion.request.amplifier.slew == 900.0)
        give("Reference bandwidth [Hz]", 30.0)
        await come(lambda: state.motion.request.reference_bandwidth == 30.0)
        (after,) = (e for e in user.find(ui.select).elements if "conditioned" in e.options)
        after.value = "moved"
        await come(lambda: state.motion.request.after == 30.0)
        give("Moved for [s] (empty: infinite)", 12.0)
        await come(lambda: state.motion.request.after == 12.0)
        give("Voltage", "60:2")  # which is refused
        await asyncio.sleep(0.3)
        assert state.motion.request.voltage == (2.0, 60.0)
        give("Voltage", "")
        await come(lambda: state.motion.request.voltage is None)

    simulated(tmp_path, look)


def test_two_pages_of_one_browser_show_the_same_result(tmp_path: Path) -> None:
    """After a reload the former page lives on for seconds, and can take or start work first."""

    async def look(user: Any, panel: Any) -> None:
        await user.open("/hysteresis")
        jobs: dict[str, BackgroundJob] = {}
        seen: list[tuple[str, Any]] = []
        ends: list[tuple[BackgroundJob, Callable[[BackgroundJob], None]]] = []

        def task(name: str) -> Task:
            page = SimpleNamespace(
                watch=lambda job, end: ends.append((job, end)),
                session=SimpleNamespace(id=""),
                panel=SimpleNamespace(
                    jobs=SimpleNamespace(start=lambda *a, **_: BackgroundJob(a[0]))
                ),
            )
            return Task(
                page, jobs, "command", user.client.content,
                lambda result: seen.append((name, result)),
                elsewhere=lambda: seen.append((name, "elsewhere")),
            )  # fmt: skip

        def end(job: BackgroundJob, result: Any) -> None:
            job._end("done", result)
            for watched in [e for e in ends if e[0] is job]:
                ends.remove(watched)
                watched[1](job)

        with user.client.content:
            former, present = task("former"), task("present")
            former.start("first", print)
            present.attach()
            first = jobs["command"]
            end(first, 1)
            assert seen == [("former", 1), ("present", "elsewhere")]
            present.start("second", print)
            former.attach()
            second = jobs["command"]
            former.start("third", print)  # in place of the second, which the present page watches
            assert second._cancel.is_set()
            second._end("cancelled")
            present._take_result(second)
            end(jobs["command"], 3)
            assert seen[2:] == [("former", 3), ("present", "elsewhere")]

    simulated(tmp_path, look)


@pytest.mark.slow
def test_from_a_record_to_the_waveform_in_a_browser(tmp_path: Path) -> None:
    with looked_at(tmp_path) as look:
        page = look.page
        page.get_by_role("link", name="Hysteresis").click()
        page.get_by_role("button", name="Identify").wait_for()
        look.shot("hysteresis-first")
        page.get_by_role("button", name="Load example").first.click()
        page.get_by_text("example.csv: 5992 samples").wait_for()
        look.shot("hysteresis-record")
        assert not look.grave_faults()
        page.get_by_role("button", name="Identify").click()
        page.get_by_text("identifying example.csv").first.wait_for()
        # long work is found again after a reload
        page.reload()
        page.get_by_text("describes the record").wait_for()
        # of all models those that are tried unasked
        for name, rows in {"maxwell-slip": 1, "generalised-bouc-wen": 0}.items():
            assert page.get_by_role("row", name=name).count() == rows
        look.require_sound("hysteresis-model")
        with page.expect_download() as waiting:
            page.get_by_role("button", name="Download the model").click()
        model = tmp_path / "model.yaml"
        waiting.value.save_as(model)
        assert (open_model_file(model)[0].errors["heldout_95"] or 1.0) < 0.3
        page.get_by_role("tab", name="3 Compensate").click()
        page.locator(".stretched:not(.stale)").get_by_text("Predicted error").first.wait_for()
        page.get_by_label("Amplitude ± [µm]").fill("12")
        page.keyboard.press("Tab")
        page.get_by_role("button", name="Triangle").click()
        page.locator(".stretched:not(.stale)").get_by_text("99.2 V").first.wait_for()
        look.require_sound("hysteresis-command")
        with page.expect_download() as waiting:
            page.get_by_role("button", name="Download the waveform").click()
        waveform_file = tmp_path / "waveform.csv"
        waiting.value.save_as(waveform_file)
        record = read_record(waveform_file)
        assert np.ptp(record.channel("reference").values) == pytest.approx(24e-6, rel=1e-3)
        assert (tmp_path / "files" / "hysteresis" / "example-triangle.csv").exists()
        page.get_by_role("tab", name="4 Validate").click()
        page.get_by_role("button", name="Load example").click()
        page.get_by_role("button", name="Validate").click()
        page.get_by_text("Band of the model").wait_for()
        look.shot("hysteresis-prediction")
        assert not look.grave_faults()
        # a file that is no record is refused in a sentence, and what was read before is at hand
        page.get_by_role("tab", name="1 Record").click()
        (tmp_path / "wrong.csv").write_bytes(b"\0" * 400)
        page.locator("input[type=file]").first.set_input_files(tmp_path / "wrong.csv")
        page.get_by_role("alert").filter(has_text="wrong.csv").wait_for()
        page.get_by_role("button", name="Back to example.csv").click()
        page.get_by_text("example.csv: 5992 samples").wait_for()
        assert not look.complaints
