"""Experiment plans: what is excited, measured, identified and verified, step by step."""
