"""Measured and simulated data: records, the files they come from, and what is wrong with them."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.records.curves import (
        curves_in_columns,
        curves_in_records,
        curves_in_rows,
        from_branches,
    )
    from flexstage.records.quality import (
        Saturation,
        constant_columns,
        difference_noise,
        noise_estimate,
        quantisation_step,
        saturation,
    )
    from flexstage.records.read import FORMATS, read_record
    from flexstage.records.record import Channel, Record, column_number
    from flexstage.records.require import require_live, require_unclipped, require_unit
    from flexstage.records.responses import responses_in_columns
    from flexstage.records.sampling import (
        LARGEST_STEP,
        LARGEST_UNEVEN_STEP,
        evened,
        require_complete,
        require_rising,
        require_uniform,
        resampled,
        selected,
        step_uncertainty,
        time_jitter,
    )
    from flexstage.records.write import record_bytes, write_record

__all__ = [
    "FORMATS",
    "LARGEST_STEP",
    "LARGEST_UNEVEN_STEP",
    "Channel",
    "Record",
    "Saturation",
    "column_number",
    "constant_columns",
    "curves_in_columns",
    "curves_in_records",
    "curves_in_rows",
    "difference_noise",
    "evened",
    "from_branches",
    "noise_estimate",
    "quantisation_step",
    "read_record",
    "record_bytes",
    "require_complete",
    "require_live",
    "require_rising",
    "require_unclipped",
    "require_uniform",
    "require_unit",
    "resampled",
    "responses_in_columns",
    "saturation",
    "selected",
    "step_uncertainty",
    "time_jitter",
    "write_record",
]

import_on_use(__name__)
