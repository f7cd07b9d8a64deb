"""What a job returns, and how that shows itself: as plain data, as a data frame, as a picture."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

from flexstage.base.lazy import data_frame
from flexstage.files.request import Request, recorded

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """Base of the results of jobs."""

    table_key: ClassVar[str] = ""
    """Key of `to_dict` whose rows, or columns, make the data frame."""

    request: Request | None = None
    """What was asked for; None of a result that no request led to."""

    def data(self) -> dict[str, Any]:
        """Return what was found as plain data, in SI units."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return what the command prints with ``--json``: what was found, and what was asked.

        That is ``request``: the fields that differ from the usual, in SI units.
        """
        asked = {} if self.request is None else {"request": recorded(self.request)}
        return self.data() | asked

    def to_frame(self) -> "pandas.DataFrame":
        """Return the table of the result as a data frame, in SI units; needs pandas.

        What is within a value of `to_dict` has a column of its own, such as ``frequency_hz.value``.
        """
        found = self.data()[self.table_key]
        if not isinstance(found, Mapping):
            rows = [_flat(row) for row in found]
            names = dict.fromkeys(name for row in rows for name in row)
            found = {name: [row.get(name) for row in rows] for name in names}
        return data_frame(found)

    def plot(self, view: str = "", **options: Any) -> "Figure":
        """Draw the result, as the command does with ``--figure``; some have other views by name."""
        # figures stand above all rooms that have results: what draws is loaded where one is wanted
        return import_module("flexstage.report.page").plotted(self, view, **options)


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of plain data without mappings in it: their keys are joined by dots."""
    flat: dict[str, Any] = {}
    for key, value in row.items():
        within = _flat(value) if isinstance(value, Mapping) else None
        flat |= {key: value} if within is None else {f"{key}.{k}": v for k, v in within.items()}
    return flat
