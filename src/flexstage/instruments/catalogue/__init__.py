"""The catalogue of runs, calibrations and models, on SQLite or PostgreSQL."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.instruments.catalogue.address import default_catalogue
    from flexstage.instruments.catalogue.catalogue import Catalogue
    from flexstage.instruments.catalogue.entries import (
        CalibrationEntry,
        ModelEntry,
        RunEntry,
        RunStatus,
        StageEntry,
    )
    from flexstage.instruments.catalogue.folder import Entered, enter_folder, folder_entries

__all__ = [
    "CalibrationEntry",
    "Catalogue",
    "Entered",
    "ModelEntry",
    "RunEntry",
    "RunStatus",
    "StageEntry",
    "default_catalogue",
    "enter_folder",
    "folder_entries",
]

import_on_use(__name__)
