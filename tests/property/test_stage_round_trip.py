"""A stage that is written and read again is the same to the last bit."""

import os
import stat
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st

from flexstage.base.errors import StageError
from flexstage.base.provenance import content_hash
from flexstage.files.encoder import yaml_text
from flexstage.stage import Stage
from flexstage.stage.file import STAGE_FILE, read_stage, stage_from_text, stage_to_text, write_stage
from tests.reference_stages import NAMES, reference_stage
from tests.strategies import drives, profiles, seats, stages


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(stages())
def test_round_trip(stage: Stage) -> None:
    for shared in (False, True):
        again = stage_from_text(stage_to_text(stage, shared=shared))
        assert again == stage
        # the hash tells -0.0 from 0.0, which equality alone does not
        assert content_hash(again) == content_hash(stage)


@pytest.mark.parametrize("name", NAMES)
def test_round_trip_of_the_reference_stages(name: str) -> None:
    stage = reference_stage(name).stage
    assert content_hash(stage_from_text(stage_to_text(stage))) == content_hash(stage)


def kinds_of(strategy: st.SearchStrategy[object]) -> set[type]:
    seen: set[type] = set()

    @settings(phases=[Phase.generate], max_examples=300, deadline=None)
    @given(strategy)
    def look(value: object) -> None:
        seen.add(type(value))

    look()
    return seen


@pytest.mark.slow
def test_every_kind_is_in_the_strategies() -> None:
    for family, strategy in zip(
        STAGE_FILE.families, (drives("d", ["a", "b"]), seats(), profiles()), strict=True
    ):
        assert kinds_of(strategy) == set(STAGE_FILE.families[family].values())


@given(st.text(max_size=200))
@example("a: !!binary x")
@example("'")
@settings(max_examples=200, deadline=None)
def test_no_text_ends_in_anything_but_a_stage_error(text: str) -> None:
    with pytest.raises(StageError):
        stage_from_text(text)


def test_a_file_is_replaced_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = reference_stage("piezo").stage
    path = tmp_path / "stage.yaml"
    write_stage(stage, path)
    assert read_stage(path) == stage
    path.chmod(0o640)
    before = path.read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StageError, match="cannot be written: No space left"):
        write_stage(reference_stage("mechanical").stage, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    monkeypatch.undo()
    write_stage(reference_stage("mechanical").stage, path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    with pytest.raises(StageError, match="cannot be written"):
        write_stage(stage, tmp_path / "nowhere" / "stage.yaml")


def test_what_stands_deep_is_written_on_one_line() -> None:
    deep = {"a": {"b": {"c": 1, "d": {"e": 2, "f": [3, 4]}}}}
    assert yaml_text(deep) == "a:\n  b:\n    c: 1\n    d: {e: 2, f: [3, 4]}\n"
