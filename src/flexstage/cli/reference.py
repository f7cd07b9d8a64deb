"""The reference of the command line for the manual, from the commands themselves."""

from collections.abc import Iterator
from typing import Any

import typer

from flexstage.cli.command import FORMER_OPTIONS, arguments, name_of, section_of

_HEAD = """\
# The command line

Every command, with its options and their defaults. `flexstage COMMAND --help` (or `-h`) prints
the same. `flexstage --install-completion` makes the shell complete commands, options, designs and
files.

**Values.** A quantity is a number with its unit, such as `"0.5 mm"`, `"2 kHz"` or `"1 mrad"`;
where the text of an option names a unit, a bare number has that one. A range is `LOW:HIGH`.
Several values are separated by commas. `STAGE` is a stage file or the name of a built-in design;
`COLUMN` is the number of a column, from 0, or its name.

**Files.** `--out FILE` writes the one file that a command makes, `--folder FOLDER` several files,
`--figure FILE` a picture of the result. Files are complete or not there; a place that takes no
file is refused before the work.

**JSON.** With `--json` a command prints one JSON object on standard output: its result in SI
units, or `{"error": {"kind": ..., "message": ..., "status": ...}}`, where `kind` is the class of
the error in Python (`UsageError` for a command line that is wrong).

**Exit status.** 0: done. 1: the work failed, or a file could not be read or written. 2: wrong
input. 130: interrupted. The reason is one sentence on standard error.

**Progress.** A bar on a terminal; else a line where a long part of the work begins and one every
ten seconds, on standard error. `--quiet` (`-q`) prints none.
"""


def command_line_page() -> str:
    """Return the reference as Markdown: commands in the order of the help, and former options."""
    from flexstage.cli import app

    root: Any = typer.main.get_command(app)
    parts = [_HEAD]
    sections: dict[str, list[Any]] = {}
    for command in root.commands.values():
        sections.setdefault(section_of(command), []).append(command)
    context = typer.Context(root, info_name="flexstage")
    for title, commands in sections.items():
        parts.append(f"## {title}\n")
        for command in commands:
            parts += _command(command, context)
    parts.append(_former(root))
    return "\n".join(parts)


def _command(command: Any, parent: Any) -> Iterator[str]:
    context = typer.Context(command, info_name=command.name, parent=parent)
    yield f"### flexstage {context.command_path.removeprefix('flexstage ')}\n"
    pieces = " ".join((context.command_path, *command.collect_usage_pieces(context)))
    yield f"```text\n{pieces}\n```\n"
    yield from (
        " ".join(paragraph.split()) + "\n" for paragraph in (command.help or "").split("\n\n")
    )
    rows: dict[str, list[tuple[str, str]]] = {"argument": [], "option": []}
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None and parameter.name != "help":
            own = arguments([parameter])
            name = name_of(parameter) if own else record[0]
            rows["argument" if own else "option"].append((name, record[1]))
    for kind, found in rows.items():
        if found:
            yield "\n".join((f"| {kind} | meaning |", "|---|---|", *map(_row, found), ""))
    for inner in getattr(command, "commands", {}).values():
        yield from _command(inner, context)


def _row(record: tuple[str, str]) -> str:
    name, meaning = (text.replace("|", "\\|").replace("\n", " ") for text in record)
    return f"| `{name}` | {meaning.replace('<', '&lt;').replace('*', chr(92) + '*')} |"


def _former(root: Any) -> str:
    lines = [
        "## Former names of options\n",
        "They still work, and are not listed by the help.\n",
        "| command | former | today |",
        "|---|---|---|",
    ]
    within = {
        inner: f"{command.name} {inner}"
        for command in root.commands.values()
        for inner in getattr(command, "commands", {})
    }
    for name, names in FORMER_OPTIONS.items():
        command = within.get(name, name)
        lines += [f"| {command} | `{old}` | `{new}` |" for old, new in names.items()]
    return "\n".join(lines) + "\n"
