"""Exploring designs: many variants of a stage, in this process, on all cores or on a cluster."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.explore.batches import Job, batch_size
    from flexstage.explore.workers import Workers, open_workers

__all__ = [
    "Job",
    "Workers",
    "batch_size",
    "open_workers",
]

import_on_use(__name__)
