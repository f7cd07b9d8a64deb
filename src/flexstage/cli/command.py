"""Help of the commands, and their reference for the manual."""

from collections.abc import Iterator
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from flexstage.cli.options import request_texts


class CliCommand(TyperCommand):
    """A command: a usage line as manuals have it, options in sections."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _with_help(super().get_params(ctx), self.callback)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        # optional arguments are in brackets
        return ["[OPTIONS]", *(_in_usage(p) for p in arguments(self.get_params(ctx)))]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is None:
                continue
            if parameter.param_type_name == "argument":
                sections.setdefault("Arguments", []).append((name_of(parameter), record[1]))
            else:
                section = getattr(parameter, "rich_help_panel", None) or "Options"
                sections.setdefault(section, []).append(record)
        for name, rows in sections.items():
            with formatter.section(name):
                formatter.write_dl(rows)


class CliGroup(TyperGroup):
    """The program, or a command with subcommands: the help lists them with whole sentences."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _with_help(super().get_params(ctx), self.callback)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        # the first paragraph of the help of each
        sections: dict[str, list[tuple[str, str]]] = {}
        for name, command in self.commands.items():
            sentence = " ".join((command.help or "").split("\n\n")[0].split())
            sections.setdefault(section_of(command), []).append((name, sentence))
        width = max(map(len, self.commands))
        for title, rows in sections.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), sentence) for name, sentence in rows])


def _with_help(parameters: list[Any], command: Any) -> list[Any]:
    texts = request_texts(command)
    for parameter in parameters:
        if getattr(parameter, "help", None) is None and parameter.name in texts:
            vars(parameter)["help"] = texts[parameter.name]
    return parameters


def arguments(parameters: list[Any]) -> list[Any]:
    """Return the arguments among parameters."""
    return [p for p in parameters if p.param_type_name == "argument"]


def section_of(command: Any) -> str:
    """Return the section of the help that a command is listed in."""
    section = getattr(command, "rich_help_panel", None)
    # an unset section is a placeholder of the library, not a text
    return section if isinstance(section, str) else "Commands"


def name_of(argument: Any) -> str:
    """Return the name of an argument in the help, in capitals."""
    name = argument.metavar or argument.name.upper()
    return name.removeprefix("[").removesuffix("]")


def _in_usage(argument: Any) -> str:
    return name_of(argument) if argument.required else f"[{name_of(argument)}]"


_HEAD = """\
# The command line

All commands with their options and defaults. `flexstage COMMAND --help` (or `-h`) prints the same
text. `flexstage --install-completion` lets the shell complete commands, options, designs and files.

**Values.** A quantity is a number with its unit, such as `"0.5 mm"`, `"2 kHz"` or `"1 mrad"`. If
the text of an option names a unit, a bare number has that unit. A range is `LOW:HIGH`. Several
values are separated by commas. `NAME=VALUE,...` sets the parts that the text of the option lists,
such as `skip=3,decimal=,`. `STAGE` is a stage file or the name of a built-in design. `COLUMN` is
the number of a column, from 0, or its name. If the file does not state the unit, append it:
`"2 um"`. Put a name that contains commas in quotes: `'"x, raw",2'`.

**Files.** `--out FILE` writes a single file, `--folder FOLDER` several files, `--figure FILE` a
picture of the result. Files are written completely or not at all. A path that cannot be written is
refused before the work begins.

**JSON.** With `--json` a command prints one JSON object on standard output. It contains the result
in SI units, and under `request` the options that differ from their defaults. After an error it is
`{"error": {"kind": ..., "message": ..., "status": ...}}`, where `kind` is the class of the error in
Python (`UsageError` for an invalid command line).

**Tables.** They fit the width of the terminal, or `COLUMNS` in a file or pipe (else 140). If a
table is too wide, values common to all rows are printed once above it, and minor columns are
omitted and named. A value that fails its criterion, such as a safety factor below 1, is followed by
the word *fails*.

**Exit status.** 0: done. 1: the work failed, or a file could not be read or written. 2: invalid
input. 130: interrupted. The reason is printed as one sentence on standard error.

**Progress.** On a terminal a bar shows the progress. Otherwise standard error gets a line when a
long step begins, and one every ten seconds. `--quiet` (`-q`) of every command suppresses them.
"""


def command_line_page(app: typer.Typer) -> str:
    """Return the reference as Markdown: commands in the order of the help."""
    root: Any = typer.main.get_command(app)
    parts = [_HEAD]
    sections: dict[str, list[Any]] = {}
    for command in root.commands.values():
        sections.setdefault(section_of(command), []).append(command)
    # with the settings of the command, which keeps the parameters that are made here
    context = typer.Context(root, info_name="flexstage", **root.context_settings)
    for title, commands in sections.items():
        parts.append(f"## {title}\n")
        for command in commands:
            parts += _command(command, context)
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
            is_argument = arguments([parameter])
            name = name_of(parameter) if is_argument else record[0]
            rows["argument" if is_argument else "option"].append((name, record[1]))
    for kind, records in rows.items():
        if records:
            yield "\n".join((f"| {kind} | meaning |", "|---|---|", *map(_row, records), ""))
    for inner in getattr(command, "commands", {}).values():
        yield from _command(inner, context)


def _row(record: tuple[str, str]) -> str:
    name, meaning = (text.replace("|", "\\|").replace("\n", " ") for text in record)
    return f"| `{name}` | {meaning.replace('<', '&lt;').replace('*', chr(92) + '*')} |"
