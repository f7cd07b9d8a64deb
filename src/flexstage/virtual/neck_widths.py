"""Measured thicknesses of necks: bias and scatter of the process that cut them."""

import csv
import re
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import FlexstageError, ModelError
from flexstage.files.nodes import read_text
from flexstage.hinges.registry import with_neck_thickness
from flexstage.quantities.units import parse, readable
from flexstage.stage import Stage
from flexstage.virtual.imperfections import Scatter

_COLUMNS = "hinge,measured [um] or drawn [um],measured [um], and part for several parts"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NeckWidths:
    """Deviations of the necks of one or more parts from the drawing."""

    deviations: tuple[Array, ...]
    """Measured less drawn thickness of each neck, by part [m]."""
    source: str
    """The file."""

    @property
    def count(self) -> int:
        """Number of measured necks."""
        return sum(part.size for part in self.deviations)

    @property
    def bias(self) -> float:
        """Mean deviation of the parts; negative where necks are thinner than drawn [m]."""
        return float(np.mean([part.mean() for part in self.deviations]))

    @property
    def individual(self) -> float:
        """Standard deviation of necks about the mean of their part [m]."""
        degrees = self.count - len(self.deviations)
        squares = sum(float(np.sum((part - part.mean()) ** 2)) for part in self.deviations)
        return float(np.sqrt(squares / degrees))

    @property
    def common(self) -> float:
        """Standard deviation of what all necks of a part share [m].

        Of one part, that of its mean; of several, the scatter of their means, and that of the bias.
        """
        means = np.array([part.mean() for part in self.deviations])
        within = self.individual**2 * float(np.mean([1.0 / part.size for part in self.deviations]))
        if means.size == 1:
            return within**0.5
        between = max(float(np.var(means, ddof=1)) - within, 0.0)
        return float(np.sqrt(between * (1.0 + 1.0 / means.size) + within / means.size))

    def scattered(self, scatter: Scatter) -> Scatter:
        """Return a process with the measured scatter of necks."""
        return replace(scatter, neck_common=self.common, neck_own=self.individual)

    def biased(self, stage: Stage) -> Stage:
        """Return the stage with the measured bias of its necks.

        Raises
        ------
        ModelError
            A neck is not thicker than the bias.
        """
        hinges = []
        for hinge in stage.hinges:
            thickness = hinge.profile.neck_thickness + self.bias
            if thickness <= 0.0:
                raise ModelError(
                    f"{self.source}: necks are thinner than drawn by {readable('m', -self.bias)}, "
                    f"which leaves nothing of hinge '{hinge.name}'"
                )
            hinges.append(replace(hinge, profile=with_neck_thickness(hinge.profile, thickness)))
        return replace(stage, hinges=tuple(hinges))

    def note(self, bias: str = "to which the nominal figures refer") -> str:
        """Return a sentence on bias and scatter, with a clause on the use of the bias."""
        parts = len(self.deviations)
        which = "of one part, for which this holds" if parts == 1 else f"of {parts} parts"
        words = "thinner" if self.bias < 0.0 else "thicker"
        return (
            f"{self.count} necks were measured, {which}: {readable('m', abs(self.bias))} {words} "
            f"than drawn, {bias}; standard deviations "
            f"{readable('m', self.common)} in common and {readable('m', self.individual)} each "
            f"({self.source})"
        )


def measured_necks(file: str | None, stage: Stage) -> NeckWidths | None:
    """Return the measured necks of an option ``--widths``; None without one."""
    return None if file is None else read_neck_widths(Path(file), stage)


def read_neck_widths(path: Path, stage: Stage) -> NeckWidths:
    """Read a table of measured necks.

    Parameters
    ----------
    path : Path
        Text with commas: a header, and a row for each neck. The column ``measured`` is required,
        with ``drawn`` or with ``hinge``, the name of a hinge of the stage; ``part`` tells parts
        apart. Units stand in the header, such as ``measured [um]``, or with the values.
    stage : Stage
        The stage, whose necks have the drawn thickness.

    Returns
    -------
    NeckWidths
        The deviations.

    Raises
    ------
    ModelError
        A column or a value is missing, or fewer than two necks of each part were measured.
    """
    try:
        rows = list(csv.reader(read_text(path, "table of necks", ModelError).splitlines()))
    except csv.Error as error:
        raise ModelError(f"{path}: no table with commas: {error}") from None
    heads = [re.fullmatch(r"\s*(\w+)\s*(?:\[(.+)\])?\s*", head) for head in (rows or [[]])[0]]
    names = [head[1].lower() if head else "" for head in heads]
    if "measured" not in names or not {"drawn", "hinge"} & set(names):
        raise ModelError(f"{path}: the header must have the columns {_COLUMNS}, got {rows[:1]}")
    by_hinge = {h.name: h.profile.neck_thickness for h in stage.hinges}
    parts: defaultdict[str, list[float]] = defaultdict(list)
    for number, cells in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in cells):
            continue
        texts = dict(zip(names, (cell.strip() for cell in cells), strict=False))
        units = {n: h[2] for n, h in zip(names, heads, strict=True) if h is not None and h[2]}
        try:
            measured = _length(texts["measured"], units.get("measured"))
            if "drawn" in texts:
                nominal = _length(texts["drawn"], units.get("drawn"))
            else:
                nominal = by_hinge[texts["hinge"]]
        except KeyError as error:
            raise ModelError(
                f"{path}, line {number}: {error.args[0]!r} is missing, or no hinge of the stage"
            ) from None
        except FlexstageError as error:
            raise ModelError(f"{path}, line {number}: {error}") from error
        if not 0.0 < measured < 2.0 * nominal:
            raise ModelError(
                f"{path}, line {number}: a measured neck of {readable('m', measured)} where "
                f"{readable('m', nominal)} are drawn: check the unit"
            )
        parts[texts.get("part", "")].append(measured - nominal)
    for name, values in (parts or {"": []}).items():
        if len(values) < 2:
            part = f" of part '{name}'" if name else ""
            raise ModelError(f"{path}: at least two necks{part} must be measured")
    return NeckWidths(
        deviations=tuple(np.array(values) for values in parts.values()), source=path.name
    )


def _length(text: str, unit: str | None) -> float:
    return parse(f"{text} {unit}" if unit else text, "length")
