"""Noise floor, Allan deviation, staircase test and resolution of a stage that stands still."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.experiment.noise.allan import AllanDeviation, allan_deviation
    from flexstage.experiment.noise.hold import HoldNoise, expected_peak_to_peak, hold_noise
    from flexstage.experiment.noise.levels import levels_of_command, levels_of_reading
    from flexstage.experiment.noise.mains import MainsLine, mains_lines
    from flexstage.experiment.noise.resolution import resolution, screw_resolution
    from flexstage.experiment.noise.staircase import Staircase, Step, staircase

__all__ = [
    "AllanDeviation",
    "HoldNoise",
    "MainsLine",
    "Staircase",
    "Step",
    "allan_deviation",
    "expected_peak_to_peak",
    "hold_noise",
    "levels_of_command",
    "levels_of_reading",
    "mains_lines",
    "resolution",
    "screw_resolution",
    "staircase",
]

import_on_use(__name__)
