"""Random deviations of manufactured stages: standard normal numbers for batches of samples.

A number depends on its seed, kind and sample alone: not on the number of samples, the batches, or
the other kinds of deviations.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Literal, get_type_hints

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.quantities.units import Dimension
from flexstage.stage import PiezoStack, Stage
from flexstage.virtual.imperfections import Scatter


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of deviation: a field of `Scatter` with its random numbers."""

    name: str
    """The field of `Scatter`."""
    stream: int
    """Key of its random numbers; unique and permanent."""
    label: str
    """Name in tables."""
    of: Literal["stage", "hinge", "drive"]
    """Objects with independent numbers."""
    each: int = 1
    """Number of numbers of each object."""


#: All kinds; a new one needs a new stream, so that the numbers of the others do not change.
KINDS: tuple[Kind, ...] = (
    Kind(name="neck_common", stream=1, label="all necks (wire offset)", of="stage"),
    Kind(name="neck_own", stream=2, label="each neck", of="hinge"),
    Kind(name="radius", stream=3, label="radius of each notch", of="hinge"),
    Kind(name="position", stream=4, label="position of each notch", of="hinge", each=2),
    Kind(name="thickness", stream=5, label="thickness of the plate", of="stage"),
    Kind(name="modulus", stream=6, label="Young's modulus", of="stage"),
    Kind(name="density", stream=7, label="density", of="stage"),
    Kind(name="temperature", stream=8, label="temperature", of="stage"),
    Kind(name="stroke", stream=9, label="stroke of each stack", of="drive"),
    Kind(name="drive", stream=10, label="actuator lateral offset", of="drive"),
)
#: Names in tables, by the field of `Scatter`.
LABELS: Mapping[str, str] = {kind.name: kind.label for kind in KINDS}


def scatter_dimensions() -> dict[str, Dimension | None]:
    """Return the dimension of every field of a scatter; None for a share."""
    hints = get_type_hints(Scatter, include_extras=True)
    return {
        f.name: next(
            (d for d in getattr(hints[f.name], "__metadata__", ()) if isinstance(d, Dimension)),
            None,
        )
        for f in fields(Scatter)
    }


def parts(stage: Stage, kinds: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Return kind, and hinge or drive, of each column of `draw`, in the order of `KINDS`.

    The kind is a field of `Scatter`; the name is empty for deviations of the whole stage.
    """
    owners = {
        "stage": ("",),
        "hinge": tuple(h.name for h in stage.hinges),
        "drive": tuple(d.name for d in stage.drives),
    }
    return tuple(
        (kind.name, owner)
        for kind in KINDS
        if kind.name in kinds
        for owner in owners[kind.of]
        for _ in range(kind.each)
    )


def active_kinds(stage: Stage, scatter: Scatter) -> tuple[str, ...]:
    """Return the kinds that apply to a stage and whose scatter is not zero."""
    inapplicable = {
        "neck_common": not stage.hinges,
        "neck_own": not stage.hinges,
        "radius": not stage.hinges,
        "position": not stage.hinges,
        "temperature": stage.material.thermal_expansion is None,
        "stroke": not any(isinstance(drive, PiezoStack) for drive in stage.drives),
        "drive": not stage.drives,
    }
    return tuple(
        kind.name
        for kind in KINDS
        if getattr(scatter, kind.name) > 0.0 and not inapplicable.get(kind.name, False)
    )


def draw(
    stage: Stage, kinds: tuple[str, ...], start: int, stop: int, *, seed: int
) -> dict[str, Array]:
    """Return standard normal numbers of samples from `start` to before `stop`.

    They are by kind, shape (samples, objects, numbers of each). A counter-based generator (Philox
    4x64: J. K. Salmon et al., Proc. SC11 (2011)) has seed and kind as its key and the sample as its
    counter; the inverse normal distribution transforms its output.

    Raises
    ------
    ModelError
        The seed is negative or has more than 64 bits.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> stage = design("parallelogram")
    >>> many, few = (draw(stage, ("neck_own",), 0, n, seed=3)["neck_own"] for n in (1000, 5))
    >>> many.shape, bool((many[:5] == few).all())
    ((1000, 4, 1), True)
    """
    if not 0 <= seed < 2**64:
        raise ModelError(f"a seed must lie between 0 and 2**64 - 1, got {seed}")
    owners = {"stage": 1, "hinge": len(stage.hinges), "drive": len(stage.drives)}
    return {
        kind.name: _normal(seed, kind.stream, start, stop, owners[kind.of] * kind.each).reshape(
            stop - start, owners[kind.of], kind.each
        )
        for kind in KINDS
        if kind.name in kinds
    }


def _normal(seed: int, stream: int, start: int, stop: int, count: int) -> Array:
    from scipy.special import ndtri

    if count == 0:
        return np.zeros((stop - start, 0))
    block = 4  # random words of one step of the counter
    blocks = -(-count // block)
    generator = np.random.Philox(key=seed + (stream << 64), counter=start * blocks)
    words = generator.random_raw((stop - start) * blocks * block)
    # the centre of one of 2^53 intervals between 0 and 1, which excludes both ends
    uniform = ((words >> np.uint64(11)) + 0.5) * 2.0**-53
    return ndtri(uniform.reshape(stop - start, -1)[:, :count])


def flat(numbers: Mapping[str, Array]) -> Array:
    """Return the numbers of each sample as a row, in the order of `parts`."""
    return np.concatenate([n.reshape(len(n), -1) for n in numbers.values()], axis=1)
