"""A stage for MATLAB and Octave: matrices, a script, and an exact step with hysteresis."""
