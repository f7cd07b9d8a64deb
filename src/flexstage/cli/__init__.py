"""The command line: one file for each command, and the exit status of each outcome.

Status 0: done. 1: the work failed. 2: bad input, with one sentence on stderr and no traceback.
"""

import os
import re
import sys
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Annotated, cast

import typer

from flexstage.base.errors import NO_FINITE_ELEMENTS, FlexstageError
from flexstage.base.version import __version__
from flexstage.cli.analyse import analyse
from flexstage.cli.budget import budget
from flexstage.cli.calibrate import calibrate
from flexstage.cli.centre import centre
from flexstage.cli.characterise import characterise
from flexstage.cli.check import check
from flexstage.cli.command import CliCommand, CliGroup
from flexstage.cli.compensate import compensate
from flexstage.cli.equations import equations
from flexstage.cli.excite import excite
from flexstage.cli.export import export
from flexstage.cli.frf import frf
from flexstage.cli.hinges import hinges
from flexstage.cli.identify import identify
from flexstage.cli.import_ import import_
from flexstage.cli.new import new
from flexstage.cli.optimise import optimise
from flexstage.cli.output import print_json
from flexstage.cli.part import part
from flexstage.cli.predict import predict
from flexstage.cli.reconstruct import reconstruct
from flexstage.cli.records import records
from flexstage.cli.run import run
from flexstage.cli.runs import runs
from flexstage.cli.scale import scale
from flexstage.cli.sensitivity import sensitivity
from flexstage.cli.serve import serve
from flexstage.cli.settle import settle
from flexstage.cli.show import show
from flexstage.cli.study import study
from flexstage.cli.sweep import sweep
from flexstage.cli.tolerance import tolerance
from flexstage.cli.tune import tune
from flexstage.cli.twin import twin
from flexstage.cli.uncertainty import uncertainty

__all__ = ["app", "main"]

_INTERRUPTED = 130
#: Extras for developers.
_DEVELOPER_EXTRAS = ("dev", "docs", "verify")
_FIRST_COMMANDS = """
  flexstage serve    open the front panel in a browser
  flexstage new      list the built-in designs
  flexstage --help   list all commands
"""

# Threads of OpenBLAS spin while they wait, and so do those of the finite elements: with both, an
# analysis takes twice as long. NumPy reads this variable when it is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: The commands. Their modules import heavy libraries only when a command runs.
app = typer.Typer(
    name="flexstage",
    cls=CliGroup,
    help="Design, verify, identify and drive flexure-based micropositioning stages.",
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
_SECTIONS: dict[str, tuple[Callable[..., None], ...]] = {
    "Design": (
        *(new, import_, check, show, analyse, budget, study, hinges, equations, part, export),
    ),
    "Explore": (sensitivity, sweep, optimise, tolerance, reconstruct),
    "Drives": (excite, identify, predict, compensate, tune, settle),
    "Measurements": (records, frf, characterise, uncertainty, scale, centre, calibrate),
    "Bench": (twin, run),
    "Front panel": (serve,),
}
for _section, _commands in _SECTIONS.items():
    for _command in _commands:
        _name = _command.__name__.strip("_")
        app.command(_name, cls=CliCommand, rich_help_panel=_section)(_command)
app.add_typer(runs, rich_help_panel="Bench")


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose", help="With --version: also the versions of Python, platform and libraries."
        ),
    ] = False,
) -> None:
    """Design, verify, identify and drive flexure-based micropositioning stages."""
    if version:
        typer.echo(f"flexstage {__version__}")
        if verbose:
            _print_environment()
        raise typer.Exit
    if verbose:
        raise typer.BadParameter("--verbose needs --version")
    if context.invoked_subcommand is None:
        _offer_panel(context)


def _print_environment() -> None:
    """Print the environment for a bug report: Python, platform, and version of each library."""
    import platform
    from importlib import metadata

    typer.echo(f"Python {platform.python_version()}, {platform.platform()}")
    for requirement in sorted(metadata.requires("flexstage") or (), key=str.lower):
        name, _, condition = requirement.partition(";")
        name = re.split(r"[\s<>=!~\[(]", name.strip(), maxsplit=1)[0]
        try:
            number = metadata.version(name)
        except metadata.PackageNotFoundError:
            number = "not installed"
        extra = re.search(r"extra == ['\"]([\w-]+)", condition)
        if extra is None or (extra[1] not in _DEVELOPER_EXTRAS and number != "not installed"):
            typer.echo(f"{name} {number}")


def _offer_panel(context: typer.Context) -> None:
    """Offer the front panel at a terminal; else print the help and the command of the panel."""
    # the import itself takes a second
    has_panel = find_spec("nicegui") is not None
    if has_panel and sys.stdin.isatty() and sys.stdout.isatty():
        typer.echo(f"{context.command.help}\n{_FIRST_COMMANDS}")
        if typer.confirm("Open the front panel?", default=True):
            serve()
        return
    install = "" if has_panel else 'pip install "flexstage[web]", then '
    typer.echo(f"{context.get_help()}\n\nThe front panel, in a browser: {install}flexstage serve")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line, and end the process with the status of the outcome.

    The arguments default to those of the process. Always raises SystemExit: 0 done, 1 the work
    failed, 2 bad input, 130 interrupted.
    """
    sys.exit(_run(None if arguments is None else list(arguments)))


def _run(arguments: list[str] | None) -> int:
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # a terminal that cannot show a letter shows a question mark instead
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]
    words = sys.argv[1:] if arguments is None else arguments
    # also of a command line that cannot be parsed, whose error is an object then
    if words[:1] == ["help"]:
        arguments = [*words[1:], "--help"]
    as_json = "--json" in words[: words.index("--") if "--" in words else None]
    if any("\0" in word for word in words):
        message = "an argument contains a NUL character, which no text or path can contain"
        return _fail("UsageError", message, 2, as_json)
    # every misuse of the command line is one of these, whichever library parses it
    misuse = cast(type[Exception], typer.BadParameter.__mro__[2])
    try:
        status = app(arguments, prog_name="flexstage", standalone_mode=False)
    except misuse as error:
        return _fail("UsageError", _usage(error), 2, as_json)
    except FlexstageError as error:
        status = 2 if isinstance(error, ValueError) else 1
        return _fail(type(error).__name__, str(error), status, as_json)
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in ("ngsolve", "netgen"):
            raise
        return _fail("ModelError", NO_FINITE_ELEMENTS, 2, as_json)
    except OSError as error:
        # a broken pipe has no reader for the object
        has_reader = as_json and not isinstance(error, BrokenPipeError)
        return _fail(type(error).__name__, _file_error(error), 1, has_reader)
    except (KeyboardInterrupt, typer.Abort):
        return _fail("KeyboardInterrupt", "interrupted", _INTERRUPTED, as_json)
    if status == _INTERRUPTED:
        return _fail("KeyboardInterrupt", "interrupted", _INTERRUPTED, as_json)
    return status if isinstance(status, int) else 0


def _fail(kind: str, message: str, status: int, as_json: bool) -> int:
    """Print one sentence about the error, and an object where the reader is a program."""
    sentence = " ".join(message.split())
    if as_json:
        print_json({"error": {"kind": kind, "message": sentence, "status": status}})
    sys.stderr.write(f"flexstage: {sentence}\n")
    return status


def _usage(error: Exception) -> str:
    message = error.format_message() if hasattr(error, "format_message") else str(error)  # type: ignore[attr-defined]
    command = getattr(getattr(error, "ctx", None), "command_path", "flexstage")
    message = message.removesuffix(".")
    if "extra argument" in message and command.endswith(" hinges"):
        message += ": name the profile by --profile"
    return f"{message}{' See' if message.endswith('?') else '; see'} '{command} --help'"


def _file_error(error: OSError) -> str:
    where = f" '{error.filename}'" if error.filename else ""
    return f"cannot read or write{where}: {error.strerror or error}"
