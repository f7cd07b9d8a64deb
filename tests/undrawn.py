"""Figures that are made and not drawn, for tests that look at the words or numbers of a page.

Drawing is most of the time that a page takes. Figures are still laid out by the functions of the
report; only their bytes are those of an empty picture.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import BinaryIO, TypeVar

import pytest
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

_EMPTY = {
    "svg": b'<?xml version="1.0"?>\n<svg xmlns="http://www.w3.org/2000/svg" version="1.1"></svg>',
    "png": b"\x89PNG\r\n\x1a\n",
    "pdf": b"%PDF-1.4\n",
}
_Made = TypeVar("_Made")


def _save(figure: Figure, file: BinaryIO, *, format: str, **_settings: object) -> None:
    file.write(_EMPTY[format])


def _save_svg(canvas: FigureCanvasSVG, file: BinaryIO, **_settings: object) -> None:
    file.write(_EMPTY["svg"])


@contextmanager
def undrawn() -> Iterator[None]:
    """Leave every figure empty that is written in here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", _save)
        patch.setattr(FigureCanvasSVG, "print_svg", _save_svg)
        patch.setattr(ConstrainedLayoutEngine, "execute", lambda *_: None)
        yield


def without_figures(write: Callable[..., _Made], *arguments: object) -> _Made:
    """What `write` gives where no figure is drawn."""
    with undrawn():
        return write(*arguments)
