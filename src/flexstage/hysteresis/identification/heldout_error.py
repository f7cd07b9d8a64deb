"""How far an error on held-out cycles may differ by chance."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from flexstage.hysteresis.identification.families.family import Data
from flexstage.hysteresis.identification.families.folds import folds_of

__all__ = ["rms_standard_error"]

Array = NDArray[np.float64]

#: Blocks of neighbouring cycles that are left out in turn, at most.
_BLOCKS = 10


def rms_standard_error(errors: Sequence[Array], data: Data) -> float | None:
    """Return the standard error of a root mean square, by its scatter between cycles.

    Errors of a model are alike in neighbouring cycles: the jackknife leaves out blocks of them in
    turn (H. R. Kuensch, Ann. Statist. 17 (1989) 1217).

    Parameters
    ----------
    errors : sequence of numpy.ndarray
        Errors at the rows of each section, shape (r,).
    data : Data
        The data; rows that are not in use are not counted.

    Returns
    -------
    float or None
        The standard error, in the unit of the errors; None of fewer than two cycles.
    """
    blocks = folds_of(data, _BLOCKS, runs=1)
    if len(blocks) < 2:
        return None
    parts = [np.concatenate([e[b] for e, b in zip(errors, block, strict=True)]) for block in blocks]
    squares = np.array([float(np.sum(part**2)) for part in parts])
    sizes = np.array([part.size for part in parts])
    without = np.sqrt((squares.sum() - squares) / (sizes.sum() - sizes))
    many = without.size
    # few blocks: the factor makes twice the error cover what the distribution of Student does
    few = float(stdtrit(many - 1, 0.975)) / 1.96
    return few * float(np.sqrt((many - 1) * np.var(without)))
