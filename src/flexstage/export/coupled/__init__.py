"""Coupled drives for other programs: C of the model, and its linear systems for MATLAB."""
