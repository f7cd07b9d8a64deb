"""Measured and simulated data: records, their file formats, and checks of their quality."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.records.drives import (
        curves_in_rows,
    )
    from flexstage.records.quality import (
        Saturation,
        saturation,
    )
    from flexstage.records.read import FORMATS, read_record
    from flexstage.records.record import Channel, Record
    from flexstage.records.responses import responses_in_columns
    from flexstage.records.sampling import resample_uniform, resampled, step_uncertainty
    from flexstage.records.write import write_record

__all__ = [
    "FORMATS",
    "Channel",
    "Record",
    "Saturation",
    "curves_in_rows",
    "read_record",
    "resample_uniform",
    "resampled",
    "responses_in_columns",
    "saturation",
    "step_uncertainty",
    "write_record",
]

import_on_use(__name__)
