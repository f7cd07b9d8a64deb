"""Figures of a stage beyond those of an analysis, which a search wants to bound."""

from collections.abc import Callable, Mapping

from flexstage.stage import Stage
from flexstage.system import MechanicalSystem

#: By quantity: what computes it of a stage and a model of it, by axis, ``stage`` for the whole.
STAGE_FIGURES: Mapping[str, Callable[[Stage, MechanicalSystem], Mapping[str, float]]] = {}
