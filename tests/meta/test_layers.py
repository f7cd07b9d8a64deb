"""Imports go downwards and never in a circle, and a class name is that of one class."""

import re
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest
from importlinter import cli

ROOT = Path(__file__).parents[2]


def test_imports_never_go_up(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(ROOT)
    status = cli.lint_imports(config_filename="pyproject.toml", no_cache=True)
    assert status == cli.EXIT_STATUS_SUCCESS, capsys.readouterr().out


def require_no_circle(package: str) -> int:
    """Refuse modules that import each other, be it in a function or for types; count imports."""
    graph = grimp.build_graph(package, cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    TopologicalSorter(imports).prepare()
    return sum(map(len, imports.values()))


def test_no_modules_import_each_other_not_even_for_types() -> None:
    assert require_no_circle("flexstage") > 3000


@pytest.mark.parametrize("circle", [True, False])
def test_a_circle_is_seen_through_functions_types_and_the_face(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, circle: bool
) -> None:
    package = f"circle_{circle}".lower()
    files = {
        "__init__": f"from {package}.a import f",
        "a": f"def f():\n    from {package} import b",
        "b": f"from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from {package}.c import x",
        "c": f"from {package} import {'version' if circle else 'd'}",
        "d": "",
    }
    (tmp_path / package).mkdir()
    for name, text in files.items():
        (tmp_path / package / f"{name}.py").write_text(text, "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    if not circle:
        assert require_no_circle(package) == 4
        return
    with pytest.raises(CycleError) as told:
        require_no_circle(package)
    assert set(told.value.args[1]) == {package, *(f"{package}.{name}" for name in "abc")}


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
