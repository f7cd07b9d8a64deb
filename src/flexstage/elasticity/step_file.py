"""Reads STEP files by the geometry kernel, and says what is wrong with those that it cannot."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from flexstage.errors import StageError

if TYPE_CHECKING:
    from netgen.occ import TopoDS_Shape


def load_step(path: Path) -> "TopoDS_Shape":
    """Return the shapes of a STEP file, in millimetres."""
    from netgen.meshing import NgException
    from netgen.occ import OCCGeometry

    if not path.is_file():
        raise StageError(f"there is no STEP file '{path}'")
    data = path.read_bytes()
    if not data.lstrip().startswith(b"ISO-10303-21;"):
        raise StageError(
            f"'{path}' is not a STEP file: one starts with 'ISO-10303-21;', this with "
            f"{data.lstrip()[:16]!r}"
        )
    if b"END-ISO-10303-21" not in data[-4096:]:
        raise StageError(
            f"'{path}' ends before its last line 'END-ISO-10303-21;': it was not copied or "
            "exported whole"
        )
    with tempfile.TemporaryDirectory() as folder:
        # the kernel goes by the suffix, in lower case, and takes the path as plain letters
        copy = Path(folder) / "part.step"
        shutil.copyfile(path, copy)
        try:
            with _silent():
                return OCCGeometry(str(copy)).shape
        except (NgException, RuntimeError) as error:
            raise StageError(
                f"the geometry kernel cannot read the STEP file '{path}' ({str(error).strip()}): "
                "export it again as AP203 or AP214"
            ) from error


@contextmanager
def _silent() -> Iterator[None]:
    """Keep the words of the geometry kernel, which it writes past Python, off standard output."""
    try:
        kept = os.dup(1)
    except OSError:  # there is none
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)
