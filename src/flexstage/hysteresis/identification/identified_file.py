"""What is kept of an identification in a model file."""

import dataclasses
from collections.abc import Sequence

from flexstage.hysteresis.identification.identify import Identification
from flexstage.hysteresis.model_file import ModelFile
from flexstage.provenance import content_hash, provenance
from flexstage.records import Record


def identified_file(found: Identification, read: Sequence[Record]) -> ModelFile:
    """Return the content of the model file of an identification, with the records that it is of."""
    origin = provenance(content_hash(tuple(r.source_hash for r in read)), found.settings)
    return ModelFile(
        model=found.model,
        provenance={
            **dataclasses.asdict(origin),
            "records": [{"file": r.source, "sha256": r.source_hash} for r in read],
        },
        errors={
            "rms": found.rms_percent,
            "max": found.max_percent,
            "heldout_rms": found.heldout_rms_percent,
            "heldout_max": found.heldout_max_percent,
            "heldout_free_constant": found.heldout_free_rms_percent,
            "heldout_95": found.heldout_band_percent,
        },
        warnings=found.warnings,
    )
