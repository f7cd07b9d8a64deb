"""Characteristics as tables for other programs: CSV, Excel, LaTeX."""

from flexstage.export.tables.files import table_files
from flexstage.export.tables.shown import Shown, shown

__all__ = ["Shown", "shown", "table_files"]
