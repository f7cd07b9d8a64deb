"""How commands show their help, and the options that had another name before."""

from collections.abc import Mapping
from typing import Any

from typer.core import TyperCommand, TyperGroup

#: Former names of options by command, and the present ones: they still work, and are not listed.
FORMER_OPTIONS: Mapping[str, Mapping[str, str]] = {
    "analyse": {"--out": "--folder"},
    "study": {
        "--out": "--folder",
        "--models": "--model",
        "--hysteresis": "--identification",
        "--no-hysteresis": "--no-identification",
    },
    "hinges": {"--angle": "--half-angle"},
    "equations": {"--format": "--to"},
    "export": {"--out": "--folder", "--step": "--time-step", "--modes": "--keep-modes"},
    "excite": {
        "--rates": "--loop-rates",
        "--hold": "--hold-time",
        "--resonance": "--multisine",
        "--no-resonance": "--no-multisine",
    },
    "identify": {
        "--model": "--hysteresis-model",
        "--damping": "--damping-ratio",
        "--test": "--test-record",
    },
    "compensate": {
        "--unit": "--reference-unit",
        "--limits": "--voltage",
        "--band": "--reference-bandwidth",
    },
    "characterise": {
        "--out": "--folder",
        "--models": "--model",
        "--unit": "--column-unit",
        "--virtual": "--virtual-seed",
    },
    "frf": {"--modes": "--fit-modes", "--delay": "--fit-delay", "--lag": "--fit-lag"},
    "run": {"--out": "--folder", "--steps": "--only"},
    "twin": {"--rate": "--servo-rate"},
    "runs": {"--kind": "--test", "--serial": "--serial-number"},
    "calibrations": {"--serial": "--serial-number", "--at": "--valid-at"},
}


class CliCommand(TyperCommand):
    """A command: a usage line as manuals have it, options in sections, former names understood."""

    def make_parser(self, ctx: Any) -> Any:
        return _with_former_names(super().make_parser(ctx), self.name)

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

    def make_parser(self, ctx: Any) -> Any:
        return _with_former_names(super().make_parser(ctx), self.name)

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


def _with_former_names(parser: Any, command: str | None) -> Any:
    # the parser knows a value from an option: a word that is a value stays as it is
    for former, name in FORMER_OPTIONS.get(command or "", {}).items():
        parser._long_opt[former] = parser._long_opt[name]
    return parser


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
