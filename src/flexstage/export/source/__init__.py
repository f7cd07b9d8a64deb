"""The model as C: hysteresis, modes, amplifier, creep and sensor, without libraries."""

from flexstage.export.source.render import render_source
from flexstage.export.source.variables import CVariable, c_variables

__all__ = ["CVariable", "c_variables", "render_source"]
