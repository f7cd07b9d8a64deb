"""Noise floor, Allan deviation, staircase test and resolution of a stage that stands still."""
