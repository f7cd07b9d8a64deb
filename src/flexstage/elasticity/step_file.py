"""STEP files by the geometry kernel, with messages on unreadable ones."""

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexstage.base.errors import FlexstageError, StageError
from flexstage.elasticity.own_process import BrokenDownError, in_own_process

# Measured on files of 0.1 to 0.27 MB: 0.5 to 3 s, and 0.17 GB.
_SECONDS = (30.0, 20.0)  # computing time that a file may take, and more for each megabyte [s]
_MEMORY = (3e9, 5e8)  # memory that it may take, and more for each megabyte [byte]
_MEND = "export it again as AP203 or AP214"


def in_step_file(path: Path, work: Callable[..., Any], *more: Any) -> Any:
    """Return the result of a function of a module for the shapes of a STEP file.

    It is called with a shape in millimetres, and `more`, in a process of its own: on a damaged file
    the geometry kernel may end its process, and on its shapes too.
    """
    if not path.is_file():
        raise StageError(f"there is no STEP file '{path}'")
    data = path.read_bytes()
    if not data.lstrip().startswith(b"ISO-10303-21;"):
        raise StageError(
            f"'{path}' is not a STEP file: it must start with 'ISO-10303-21;', but starts with "
            f"{data.lstrip()[:16]!r}"
        )
    if b"END-ISO-10303-21" not in data[-4096:]:
        raise StageError(
            f"'{path}' ends before its last line 'END-ISO-10303-21;': the file is incomplete"
        )
    seconds, memory = (base + each * len(data) / 1e6 for base, each in (_SECONDS, _MEMORY))
    try:
        return in_own_process(_result_of, path, work, *more, seconds=seconds, memory=memory)
    except BrokenDownError as error:
        raise StageError(
            f"the geometry kernel {error} on the STEP file '{path}': the file is damaged, or has "
            f"content that the kernel does not support; {_MEND}"
        ) from None


def _result_of(path: Path, work: Callable[..., Any], *more: Any) -> Any:
    from netgen.meshing import NgException
    from netgen.occ import OCCGeometry

    with tempfile.TemporaryDirectory() as folder:
        # the kernel goes by the suffix, in lower case, and takes the path as plain letters
        copy = Path(folder) / "part.step"
        shutil.copyfile(path, copy)
        try:
            return work(OCCGeometry(str(copy)).shape, *more)
        except FlexstageError:
            raise
        except (NgException, RuntimeError, ArithmeticError, ValueError) as error:
            raise StageError(
                f"the geometry kernel cannot read the STEP file '{path}' "
                f"({str(error).strip() or type(error).__name__}): {_MEND}"
            ) from None
