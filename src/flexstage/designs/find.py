"""A stage by what a person calls it: the name of a built-in design, or a stage file."""

import difflib
import os
from pathlib import Path

from flexstage.designs.registry import DESIGNS, build, design
from flexstage.errors import StageError
from flexstage.stage import Stage


def find_stage(source: str | os.PathLike[str]) -> Stage:
    """Return a built-in stage, or read one from a stage file.

    Parameters
    ----------
    source : str or os.PathLike
        Name of a built-in design, or path of a stage file.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    StageError
        There is neither such a design nor such a file, or the file is no stage.

    Examples
    --------
    >>> find_stage("vgtu-piezo").name
    'vgtu-piezo'
    """
    text = os.fspath(source)
    if text.casefold() in DESIGNS:
        return design(text)
    path = Path(text)
    if not text or not _exists(path):
        # a file that lies there, by another ending or a letter less, before a design of such a name
        beside = _files_beside(path)
        near = difflib.get_close_matches(path.name, beside, n=1, cutoff=0.7)
        near = [str(path.with_name(near[0]))] if near else near
        near = near or difflib.get_close_matches(text.casefold(), DESIGNS, n=1, cutoff=0.4)
        hint = f"did you mean '{near[0]}'?" if near else f"the designs are {', '.join(DESIGNS)}"
        raise StageError(f"no built-in design and no file is called '{text[:200]}': {hint}")
    from flexstage.stage.file import read_stage

    return read_stage(path, designs=build)


def _files_beside(path: Path) -> list[str]:
    """Names of the stage files in the folder that a path is in."""
    try:
        return [p.name for p in path.parent.iterdir() if p.suffix in (".yaml", ".yml")]
    except (OSError, ValueError):  # no such folder, or a name that none can have
        return []


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name that is too long for any file
        return False
