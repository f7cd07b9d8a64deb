"""Results of jobs: as plain data, as a data frame, as a picture."""

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
    """The request; None for a result without one."""

    def data(self) -> dict[str, Any]:
        """Return the result as plain data, in SI units."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return the output of the command with ``--json``: result and ``request``.

        The request has the fields that differ from their defaults, in SI units.
        """
        request = {} if self.request is None else {"request": recorded(self.request)}
        return self.data() | request

    def to_frame(self) -> "pandas.DataFrame":
        """Return the table of the result as a data frame, in SI units; needs pandas.

        Nested values of `to_dict` become columns such as ``frequency_hz.value``.
        """
        table = self.data()[self.table_key]
        if not isinstance(table, Mapping):
            rows = [_flat(row) for row in table]
            names = dict.fromkeys(name for row in rows for name in row)
            table = {name: [row.get(name) for row in rows] for name in names}
        return data_frame(table)

    def plot(self, view: str = "", **options: Any) -> "Figure":
        """Return the figure of the result, that of ``--figure``; some have other views by name."""
        # figures are above all rooms with results: imported on use
        return import_module("flexstage.report.page").plotted(self, view, **options)


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of plain data with nested keys joined by dots."""
    flat: dict[str, Any] = {}
    for key, value in row.items():
        within = _flat(value) if isinstance(value, Mapping) else None
        flat |= {key: value} if within is None else {f"{key}.{k}": v for k, v in within.items()}
    return flat
