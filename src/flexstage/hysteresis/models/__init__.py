"""The hysteresis models, one folder each, by name in `registry`; beside them what they share."""
