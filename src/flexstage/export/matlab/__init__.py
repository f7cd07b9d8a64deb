"""A stage for MATLAB and Octave: matrices, a script, and an exact step with hysteresis."""

from flexstage.export.matlab.files import matlab_files

__all__ = ["matlab_files"]
