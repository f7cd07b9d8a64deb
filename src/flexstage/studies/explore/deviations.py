"""What the stages of a lot are off by: standard normal numbers, drawn for a whole batch at once.

A number belongs to its seed, kind and sample, and to nothing else: not to how many samples there
are, how they are divided into batches, or which other kinds are drawn.
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
    """A way in which stages differ: a field of `Scatter`, and how many numbers it takes."""

    name: str
    """The field of `Scatter`."""
    stream: int
    """Key of its random numbers; never that of another, nor changed."""
    label: str
    """What it is called in tables."""
    of: Literal["stage", "hinge", "drive"]
    """What has numbers of its own."""
    each: int = 1
    """How many numbers each has."""


#: Every kind; a new one takes a stream that none has had, and so leaves the others as they were.
KINDS: tuple[Kind, ...] = (
    Kind(name="neck_common", stream=1, label="all necks alike (wire offset)", of="stage"),
    Kind(name="neck_own", stream=2, label="each neck", of="hinge"),
    Kind(name="radius", stream=3, label="radius of each notch", of="hinge"),
    Kind(name="position", stream=4, label="position of each notch", of="hinge", each=2),
    Kind(name="thickness", stream=5, label="thickness of the plate", of="stage"),
    Kind(name="modulus", stream=6, label="Young's modulus", of="stage"),
    Kind(name="density", stream=7, label="density", of="stage"),
    Kind(name="temperature", stream=8, label="temperature", of="stage"),
    Kind(name="stroke", stream=9, label="stroke of each stack", of="drive"),
    Kind(name="drive", stream=10, label="line of each drive", of="drive"),
)
#: What each is called in tables, by the field of `Scatter`.
LABELS: Mapping[str, str] = {kind.name: kind.label for kind in KINDS}


def scatter_dimensions() -> dict[str, Dimension | None]:
    """Return the dimension of every field of a scatter; None of a share."""
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

    The kind is the field of `Scatter` that it is multiplied by; the name is empty for what is of
    the whole stage.
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


def drawn_kinds(stage: Stage, scatter: Scatter) -> tuple[str, ...]:
    """Return the kinds that a stage can have, and whose scatter is not zero."""
    nothing = {
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
        if getattr(scatter, kind.name) > 0.0 and not nothing.get(kind.name, False)
    )


def draw(
    stage: Stage, kinds: tuple[str, ...], start: int, stop: int, *, seed: int
) -> dict[str, Array]:
    """Draw standard normal numbers of samples from `start` to before `stop`.

    By kind, shape (samples, owners, numbers of each). The words of a counter-based generator
    (Philox 4x64: J. K. Salmon et al., Proc. SC11 (2011)), whose key is seed and kind and whose
    counter is the sample, go through the inverse of the normal distribution.

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
    words_of_step = 4  # that one step of the counter gives
    blocks = -(-count // words_of_step)
    generator = np.random.Philox(key=seed + (stream << 64), counter=start * blocks)
    words = generator.random_raw((stop - start) * blocks * words_of_step)
    # the middle of each of 2^53 parts of 0 to 1, so that neither end is met
    uniform = ((words >> np.uint64(11)) + 0.5) * 2.0**-53
    return ndtri(uniform.reshape(stop - start, -1)[:, :count])


def flat(numbers: Mapping[str, Array]) -> Array:
    """Return the numbers of each sample in one row, in the order of `parts`."""
    return np.concatenate([n.reshape(len(n), -1) for n in numbers.values()], axis=1)
