"""The Python in the README and in the manual runs, and the sessions print what they show.

Blocks of one file share their names and run in order, in an empty folder. A block of any language
whose first line is ``# file: NAME`` is written to that file there, for the blocks that follow.
"""

import doctest
import re
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from flexstage.hinges import PROFILES
from flexstage.hysteresis import MODELS

ROOT = Path(__file__).parents[2]
GENERATED = ROOT / "docs" / "reference" / "api"
PAGES = [
    page
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if page.is_file() and GENERATED not in page.parents
]
FENCE = re.compile(
    r"^(?P<indent> *)(?P<ticks>`{3,}|~{3,}|:{3,})(?P<info>[^\n`]*)\n"
    r"(?P<code>.*?)^(?P=indent)(?P=ticks) *$",
    re.MULTILINE | re.DOTALL,
)
#: Pages that compute for seconds; the snippets of the others run by default.
LONG = {
    f"docs/{name}.md"
    for name in (
        "explanation/drives-on-the-bench", "explanation/identification", "how-to/control",
        "how-to/drive-a-controller", "how-to/equations", "how-to/finite-elements",
        "how-to/frequency-response", "how-to/own-models", "how-to/python",
        "how-to/update-model", "how-to/write-a-plan", "tutorials/piezo-hysteresis",
    )
}  # fmt: skip
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


class Block(NamedTuple):
    """One fenced block: its language, its code, and the line before its first."""

    language: str
    code: str
    line: int


def blocks(text: str) -> list[Block]:
    """Find the fenced blocks of a page."""
    found = []
    for match in FENCE.finditer(text):
        words = match["info"].replace("{code-block}", "").replace("{code}", "").split()
        indent = len(match["indent"])
        code = "".join(line[indent:] or "\n" for line in match["code"].splitlines(keepends=True))
        line = text[: match.start("code")].count("\n")
        found.append(Block(words[0] if words else "", code, line))
    return found


def run(text: str, name: str) -> int:
    """Run the Python of a page in the present folder; return how many blocks were run."""
    names: dict[str, Any] = {"__name__": "__snippet__"}
    count = 0
    for block in blocks(text):
        header = re.match(r"(?:#|//|<!--) file: (\S+)", block.code)
        if header:
            Path(header[1]).write_text(block.code, encoding="utf-8")
        if block.language not in {"python", "pycon"}:
            continue
        count += 1
        if ">>> " in block.code:
            session(block, names, name)
        else:
            # Empty lines in front make a traceback point at the line of the page.
            exec(compile("\n" * block.line + block.code, name, "exec"), names)
    return count


def session(block: Block, names: dict[str, Any], name: str) -> None:
    """Check what an interactive session prints."""
    test = doctest.DocTestParser().get_doctest(block.code, names, name, name, block.line)
    test.globs = names
    said: list[str] = []
    result = doctest.DocTestRunner(optionflags=FLAGS).run(test, out=said.append, clear_globs=False)
    assert result.failed == 0, "".join(said)


def name_of(page: Path) -> str:
    """Path of a page in the project."""
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=name, marks=[pytest.mark.slow] if name in LONG else [])
        for page, name in ((page, name_of(page)) for page in PAGES)
    ],
)
def test_snippets_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.syspath_prepend(tmp_path)  # for files that a page imports
    known = [(registry, dict(registry)) for registry in (MODELS, PROFILES)]
    try:
        run(page.read_text("utf-8"), name_of(page))
    finally:
        for registry, before in known:  # what a page adds is of that page
            for kind in registry.keys() - before.keys():
                del registry[kind]


def test_the_runner_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = """
```yaml
# file: a.yaml
a: 1
```
  ```python
  from pathlib import Path
  text = Path("a.yaml").read_text()
  ```
```python
>>> text.count("a: 1")
1
```
```console
$ not python
```
"""
    assert run(page, "page.md") == 2
    with pytest.raises(AssertionError, match="Expected"):
        run(page.replace("\n1\n", "\n2\n"), "page.md")
    with pytest.raises(ZeroDivisionError):
        run("```python\n1 / 0\n```\n", "page.md")
