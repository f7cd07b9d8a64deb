"""What the blocks of a Simulink model read: numbers by name."""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexstage import __version__
from flexstage.export.simulink.matlab_text import identifier
from flexstage.hysteresis.model import Array

_HEADER = 116  # bytes of text at the start of a .mat file, level 5
# Names that stand for something in expressions of MATLAB.
_TAKEN = frozenset(("ans", "diag", "eps", "i", "inf", "j", "max", "min", "nan", "pi", "zeros"))


class Variables:
    """Matrices by names that MATLAB takes, with what they mean."""

    __slots__ = ("_meanings", "_values")

    def __init__(self) -> None:
        self._values: dict[str, Array] = {}
        self._meanings: dict[str, str] = {}

    def add(self, wanted: str, value: ArrayLike, meaning: str) -> str:
        """Add a number or a matrix and return its name; a number follows one that is taken."""
        # room for a sign of order behind the name, and for names of files made of it
        name = base = identifier(wanted, longest=58)
        count = 1
        while name.lower() in {*_TAKEN, *(known.lower() for known in self._values)}:
            count += 1
            name = f"{base}_{count}"
        self._values[name] = np.atleast_2d(np.asarray(value, dtype=np.float64))
        self._meanings[name] = meaning
        return name

    @property
    def values(self) -> Mapping[str, Array]:
        """The values by name."""
        return dict(self._values)

    @property
    def meanings(self) -> Mapping[str, str]:
        """What they are, by name."""
        return dict(self._meanings)

    def mat_file(self) -> bytes:
        """Return them as `mat_file` does."""
        return mat_file(self._values)


def mat_file(variables: Mapping[str, Any]) -> bytes:
    """Return a .mat file, level 5; a dict becomes a struct, the same variables the same bytes."""
    from scipy.io import savemat

    made = io.BytesIO()
    savemat(made, dict(variables), long_field_names=True, oned_as="column")
    # a date would make every file another one
    text = f"MATLAB 5.0 MAT-file, written by flexstage {__version__}"
    return text.ljust(_HEADER).encode("ascii")[:_HEADER] + made.getvalue()[_HEADER:]
