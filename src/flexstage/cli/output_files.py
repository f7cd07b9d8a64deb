"""Where commands write: options of paths, refused before the work, and files written whole."""

import errno
from pathlib import Path
from typing import Any

import typer

_IMAGES = (".svg", ".png", ".pdf")
_AS_PICTURE = "(.svg, .png or .pdf)"


def file_option(help: str) -> Any:
    """Return the option `--out`: the one file that a command writes.

    Its path is refused before the work where no file can be written there.
    """
    return typer.Option("--out", parser=_file, metavar="FILE", help=help)


def figure_option(help: str) -> Any:
    """Return the option `--figure`: a picture of the result.

    Its path is refused before the work as that of `file_option`, and where its ending is that of no
    picture.
    """
    return typer.Option("--figure", parser=_figure, metavar="FILE", help=f"{help} {_AS_PICTURE}")


def folder_option(help: str) -> Any:
    """Return the option `--folder`: where a command writes several files.

    Its path is refused before the work where no folder can be.
    """
    return typer.Option("--folder", parser=_folder, metavar="FOLDER", help=help)


def output_path(text: str | Path) -> Path:
    """Return the path that a word names.

    An empty text is refused, as of a variable of the shell that is not set: the working directory
    would be meant instead. A default of an option is handed on in the same way.
    """
    if not str(text).strip():
        raise typer.BadParameter("expected a path, got an empty text")
    if "\0" in str(text):
        raise typer.BadParameter(f"expected a path, got {text!r}: no path holds a NUL character")
    return Path(text)


def writable(path: Path) -> Path:
    """Return the path of a file, refusing it before the work where none can be written there."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "it is a folder: name a file in it", str(path))
    _folder(path.parent)
    return path


def _file(text: str | Path) -> Path:
    return writable(output_path(text))


def _figure(text: str | Path) -> Path:
    path = output_path(text)
    if path.suffix.lower() not in _IMAGES:
        raise typer.BadParameter(
            f"the name must end in one of {', '.join(_IMAGES)}, which says the format, got "
            f"'{path.name}'"
        )
    return writable(path)


def _folder(text: str | Path) -> Path:
    from flexstage.files.write import require_writable

    path = output_path(text)
    require_writable(path)
    return path


def name_for_files(name: str) -> str:
    """Return a name that a directory can have.

    What is special to some system becomes a dash, and none begins it, where programs take it for an
    option.

    Examples
    --------
    >>> name_for_files("a/b: c")
    'a-b--c'
    """
    kept = "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip(".").lstrip("-.")
    # no system takes a name of more than 255 bytes, and endings are put behind it
    return kept[:60].encode()[:180].decode(errors="ignore") or "stage"


def write_file(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    from flexstage.files.write import write_files

    write_files(path.parent, {path.name: content})
