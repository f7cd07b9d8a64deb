"""Simulink: a script that builds the model of a stage, its data and its hysteresis."""

from flexstage.export.simulink.files import model_name, simulink_files
from flexstage.export.simulink.hysteresis_text import hysteresis_function

__all__ = ["hysteresis_function", "model_name", "simulink_files"]
