"""How loops over samples are compiled."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a function with Numba, and keep what was compiled beside its file.

    Floating-point arithmetic stays as it is written: results must not depend on the machine.
    """
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy")(function))
