"""Recording to disk: streams that survive a crash, and the folders of runs."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.instruments.recording.archive import archived
    from flexstage.instruments.recording.attributes import RunFile, file_summary, read_metadata
    from flexstage.instruments.recording.chunk import Irregularity
    from flexstage.instruments.recording.files import in_use
    from flexstage.instruments.recording.folder import RunFolder
    from flexstage.instruments.recording.metadata import RunMetadata, utc_now
    from flexstage.instruments.recording.recovery import Lost, Recovery, examine, recover
    from flexstage.instruments.recording.writer import STREAM_SUFFIX, RunWriter

__all__ = [
    "STREAM_SUFFIX",
    "Irregularity",
    "Lost",
    "Recovery",
    "RunFile",
    "RunFolder",
    "RunMetadata",
    "RunWriter",
    "archived",
    "examine",
    "file_summary",
    "in_use",
    "read_metadata",
    "recover",
    "utc_now",
]

import_on_use(__name__)
