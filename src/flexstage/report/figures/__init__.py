"""Figures of a stage and of what its models give, one file for each."""
