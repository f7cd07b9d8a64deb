"""The rooms import downwards only, and a class name is that of one class."""

import re
from collections import defaultdict
from pathlib import Path

import pytest
from importlinter import cli

ROOT = Path(__file__).parents[2]


def test_imports_never_go_up(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(ROOT)
    status = cli.lint_imports(config_filename="pyproject.toml", no_cache=True)
    assert status == cli.EXIT_STATUS_SUCCESS, capsys.readouterr().out


def test_no_two_classes_have_one_name() -> None:
    where = defaultdict(set)
    for file in (ROOT / "src" / "flexstage").rglob("*.py"):
        for name in re.findall(r"^class ([A-Za-z]\w*)", file.read_text("utf-8"), re.MULTILINE):
            where[name].add(file.relative_to(ROOT).as_posix())
    assert len(where) > 500
    assert {name: files for name, files in where.items() if len(files) > 1} == {}


@pytest.mark.parametrize(
    "page", sorted((ROOT / "docs" / "contributing").glob("*.md")), ids=lambda page: page.name
)
def test_pages_for_contributors_name_files_that_exist(page: Path) -> None:
    named = re.findall(r"`([\w.-]+/[\w./-]*)`", page.read_text("utf-8"))
    package = ROOT / "src" / "flexstage"
    assert [n for n in named if not (package / n).exists() and not (ROOT / n).exists()] == []
