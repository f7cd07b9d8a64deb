"""Trajectories of one or more axes: whole periods, with round corners, that repeat smoothly."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.control.trajectories.from_file import trajectory_of
    from flexstage.control.trajectories.lissajous import lissajous
    from flexstage.control.trajectories.raster import raster
    from flexstage.control.trajectories.sine import sine
    from flexstage.control.trajectories.spiral import spiral
    from flexstage.control.trajectories.staircase import staircase
    from flexstage.control.trajectories.trajectory import Trajectory, band_limited
    from flexstage.control.trajectories.triangle import triangle

__all__ = [
    "Trajectory",
    "band_limited",
    "lissajous",
    "raster",
    "sine",
    "spiral",
    "staircase",
    "trajectory_of",
    "triangle",
]

import_on_use(__name__)
