"""The help: whole lines, usage as manuals write it, suggestions, completion."""

import io
import os
import subprocess
import sys

import pytest

from flexstage.cli import main
from tests.system.test_cli_json import commands

SECTIONS = ("Design", "Drives", "Measurements", "Bench")


def said(capsys: pytest.CaptureFixture[str], *words: str, status: int = 0) -> str:
    with pytest.raises(SystemExit) as end:
        main(words)
    assert int(end.value.code or 0) == status
    printed = capsys.readouterr()
    return printed.out if status == 0 else printed.err


def test_every_command_is_listed_on_one_whole_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    listed = said(capsys)
    assert [line for line in listed.splitlines() if line.removesuffix(":") in SECTIONS] == [
        f"{name}:" for name in SECTIONS
    ]
    for name, command in commands().items():
        parent, _, own = name.rpartition(" ")
        text = listed if not parent else said(capsys, parent, "--help")
        sentence = " ".join(command.help.split("\n\n")[0].split())
        assert sentence.endswith(".")
        lines = [line.split(maxsplit=1) for line in text.splitlines()]
        assert [own, sentence] in lines


class Terminal(io.StringIO):
    """What a person types at a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The calls of the command that serves the front panel."""
    calls: list[str] = []
    monkeypatch.setattr("flexstage.cli.serve", lambda: calls.append("served"))
    return calls


@pytest.mark.parametrize(
    ("installed", "last"),
    [
        (True, "The front panel, in a browser: flexstage serve"),
        (
            False,
            'The front panel, in a browser: pip install "flexstage[web]", then flexstage serve',
        ),
    ],
)
def test_without_a_command_it_prints_the_help_and_how_to_get_the_panel(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    served: list[str],
    installed: bool,
    last: str,
) -> None:
    monkeypatch.setattr("flexstage.cli.find_spec", lambda name: name if installed else None)
    monkeypatch.setattr(sys, "stdin", Terminal("y\n"))
    printed = said(capsys)
    assert printed.startswith("Usage: flexstage [OPTIONS] COMMAND")
    assert printed.splitlines()[-1] == last
    assert not served


@pytest.mark.parametrize(("typed", "opens"), [("\n", True), ("y\n", True), ("n\n", False)])
def test_without_a_command_a_terminal_is_offered_the_panel(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    served: list[str],
    typed: str,
    opens: bool,
) -> None:
    monkeypatch.setattr("flexstage.cli.find_spec", lambda name: name)
    monkeypatch.setattr(sys, "stdin", Terminal(typed))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    printed = said(capsys)
    assert "flexstage --help   list all commands" in printed
    assert "Open the front panel? [Y/n]" in printed
    assert len(printed.splitlines()) < 10
    assert served == ["served"] * opens


@pytest.mark.parametrize(
    ("command", "usage"),
    [
        ("analyse", "analyse [OPTIONS] STAGE"),
        ("excite", "excite [OPTIONS] [STAGE]"),
        ("new", "new [OPTIONS] [DESIGN]"),
        ("records", "records [OPTIONS] FILE..."),
        ("characterise", "characterise [OPTIONS] [FILE...]"),
        ("predict", "predict [OPTIONS] MODEL RECORD..."),
        ("hinges", "hinges [OPTIONS]"),
        ("runs add", "runs add [OPTIONS] FOLDER..."),
        ("runs", "runs [OPTIONS] COMMAND [ARGS]..."),
    ],
)
def test_usage_is_written_as_in_manuals(
    capsys: pytest.CaptureFixture[str], command: str, usage: str
) -> None:
    text = said(capsys, *command.split(), "-h")
    assert text.splitlines()[0] == f"Usage: flexstage {usage}"


def test_no_type_of_the_language_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    for command in commands():
        text = said(capsys, *command.split(), "--help")
        for word in ("<str>", "<path>", "<int", "<float", "list["):
            assert word not in text, command


@pytest.mark.parametrize(
    ("words", "suggested"),
    [
        (["analysse"], "Did you mean 'analyse'? See 'flexstage --help'"),
        (["runs", "recove"], "Did you mean 'recover'? See 'flexstage runs --help'"),
        (["analyse", "--mdoel", "x"], "--model"),
    ],
)
def test_a_misspelt_word_is_suggested(
    capsys: pytest.CaptureFixture[str], words: list[str], suggested: str
) -> None:
    assert suggested in said(capsys, *words, status=2)


@pytest.mark.parametrize(
    ("typed", "offered"),
    [("ana", ["analyse"]), ("analyse --mo", ["--model"]), ("check vgtu", ["vgtu-mechanical"])],
)
def test_the_shell_completes(typed: str, offered: list[str]) -> None:
    words = f"flexstage {typed}"
    environment = os.environ | {
        "_FLEXSTAGE_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(words.count(" ")),
    }
    done = subprocess.run(
        [sys.executable, "-m", "flexstage"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.stdout.split()[: len(offered)] == offered
