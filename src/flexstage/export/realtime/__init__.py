"""A stage for a real-time target: one header of C, an example, and samples to check it with."""

from flexstage.export.realtime.accuracy import rounding_bound
from flexstage.export.realtime.files import realtime_files

__all__ = ["realtime_files", "rounding_bound"]
