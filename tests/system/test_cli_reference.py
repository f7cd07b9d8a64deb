"""The page of the manual on the command line holds every command, option and default."""

import re
import subprocess
import sys

from flexstage.cli import app
from flexstage.cli.command import command_line_page
from tests.system.test_cli_json import commands


def test_every_command_and_option_is_there() -> None:
    page = command_line_page(app)
    for name, command in commands().items():
        head = f"### flexstage {name}\n"
        assert page.count(head) == 1
        section = page.split(head)[1].split("\n### ")[0].split("\n## ")[0]
        assert f"flexstage {name} [OPTIONS]" in section
        rows = [line for line in section.splitlines() if line.startswith("| `-")]
        for parameter in command.params:
            if parameter.param_type_name == "option":
                row = next(
                    r for r in rows if re.search(rf"{parameter.opts[0]}(?![\w-])", r.split("|")[1])
                )
                assert parameter.help.split()[0].replace("|", "\\|") in row
                plain = isinstance(parameter.default, int | str) and not parameter.is_flag
                assert not (plain and parameter.default) or f": {parameter.default}" in row


def test_every_row_has_the_columns_of_its_table() -> None:
    width = 0
    for line in command_line_page(app).splitlines():
        if not line.startswith("|"):
            continue
        bars = line.replace("\\|", "").count("|")
        if set(line) == {"|", "-"}:
            width = bars
        elif "| meaning |" not in line:
            assert bars == width, line


def test_the_page_leaves_the_help_of_commands_as_it_is() -> None:
    # in a process where nothing has asked for help before
    program = (
        "from flexstage.cli import app, main; from flexstage.cli.command import command_line_page; "
        "command_line_page(app); main(['hinges', '-h'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("Usage: flexstage hinges ")
