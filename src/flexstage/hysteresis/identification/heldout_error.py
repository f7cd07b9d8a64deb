"""How far an error on held-out cycles may differ by chance."""

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from flexstage.arrays import Array
from flexstage.hysteresis.identification.families.family import Data
from flexstage.hysteresis.identification.families.folds import folds_of

#: Blocks of neighbouring cycles that are left out in turn, at most.
_BLOCKS = 10


def rms_standard_error(errors: Sequence[Array], data: Data) -> float | None:
    """Return the standard error of a root mean square, by its scatter between cycles.

    Errors of a model are alike in neighbouring cycles: the jackknife leaves out blocks of them in
    turn (H. R. Kuensch, Ann. Statist. 17 (1989) 1217). Rows that are not in use are not counted;
    None of fewer than two cycles.
    """
    blocks = folds_of(data, _BLOCKS, runs=1)
    if len(blocks) < 2:
        return None
    parts = [np.concatenate([e[b] for e, b in zip(errors, block, strict=True)]) for block in blocks]
    squares = np.array([float(np.sum(part**2)) for part in parts])
    sizes = np.array([part.size for part in parts])
    without = np.sqrt((squares.sum() - squares) / (sizes.sum() - sizes))
    many = without.size
    return _few(many) * float(np.sqrt((many - 1) * np.var(without)))


def another_stretch(rms: float, error: float, stretches: Array) -> float:
    """Return the standard error of what another stretch of cycles of the drive will show.

    The error of the rms is by the scatter between held-out cycles; `stretches` are the rms of
    stretches that were held out as a whole. These differ by more than their cycles do by chance,
    and extrapolating to one leaves more.
    """
    apart = _few(stretches.size) * float(np.std(stretches, ddof=1))
    further = float(np.sqrt(np.mean(stretches**2))) - rms
    return float(np.sqrt(error**2 + apart**2 + further**2))


def _few(many: int) -> float:
    """Factor by which twice an error of few parts covers what the distribution of Student does."""
    return float(stdtrit(many - 1, 0.975)) / 1.96
