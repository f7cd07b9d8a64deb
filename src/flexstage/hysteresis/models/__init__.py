"""Hysteresis models, one folder each, by name in `registry`, and their common code."""
