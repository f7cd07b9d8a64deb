"""How commands show their help, and the reference for the manual."""

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
    """The program, or a command that has some of its own: they are listed in whole sentences."""

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
    """Return the arguments of some parameters."""
    return [p for p in parameters if p.param_type_name == "argument"]


def section_of(command: Any) -> str:
    """Return the section of the help that a command is listed in."""
    section = getattr(command, "rich_help_panel", None)
    # what is not set is a placeholder of the library, and no text
    return section if isinstance(section, str) else "Commands"


def name_of(argument: Any) -> str:
    """Return what an argument is called in the help, in capitals."""
    name = argument.metavar or argument.name.upper()
    return name.removeprefix("[").removesuffix("]")


def _in_usage(argument: Any) -> str:
    return name_of(argument) if argument.required else f"[{name_of(argument)}]"


_HEAD = """\
# The command line

Every command, with its options and their defaults. `flexstage COMMAND --help` (or `-h`) prints
the same. `flexstage --install-completion` makes the shell complete commands, options, designs and
files.

**Values.** A quantity is a number with its unit, such as `"0.5 mm"`, `"2 kHz"` or `"1 mrad"`;
where the text of an option names a unit, a bare number has that one. A range is `LOW:HIGH`.
Several values are separated by commas; `NAME=VALUE,...` are parts of one thing, which the text of
the option lists, such as `skip=3,decimal=,`. `STAGE` is a stage file or the name of a built-in
design; `COLUMN` is the number of a column, from 0, or its name, with its unit behind it where the
file does not say it, `"2 um"`. A name that holds commas stands in quotes, `'"x, raw",2'`.

**Files.** `--out FILE` writes the one file that a command makes, `--folder FOLDER` several files,
`--figure FILE` a picture of the result. Files are complete or not there; a place that takes no
file is refused before the work.

**JSON.** With `--json` a command prints one JSON object on standard output: its result in SI
units, which holds as `request` the options that differ from the usual, or
`{"error": {"kind": ..., "message": ..., "status": ...}}`, where `kind` is the class of the error in
Python (`UsageError` for a command line that is wrong).

**Tables.** They fit the width of the terminal, or `COLUMNS` in a file or pipe (else 140). Where
there is no room, what is alike in all rows is said once above, and lesser columns are left out by
name. A figure that fails its criterion, such as a safety factor below 1, is followed by the word
*fails*.

**Exit status.** 0: done. 1: the work failed, or a file could not be read or written. 2: wrong
input. 130: interrupted. The reason is one sentence on standard error.

**Progress.** A bar on a terminal; else a line where a long part of the work begins and one every
ten seconds, on standard error. `--quiet` (`-q`), which every command takes, prints none.
"""


def command_line_page(app: typer.Typer) -> str:
    """Return the reference as Markdown: commands in the order of the help."""
    root: Any = typer.main.get_command(app)
    parts = [_HEAD]
    sections: dict[str, list[Any]] = {}
    for command in root.commands.values():
        sections.setdefault(section_of(command), []).append(command)
    # with the settings of the command: what is made here of its parameters is kept by them
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
