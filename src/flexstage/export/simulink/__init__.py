"""Simulink: a script that builds the model of a stage, its data and its hysteresis."""
