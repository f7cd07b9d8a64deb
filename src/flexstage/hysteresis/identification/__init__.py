"""From measured records to a model of the drive: hysteresis, lag, creep and resonance."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.hysteresis.identification.amplifier import FoundAmplifier, identify_amplifier
    from flexstage.hysteresis.identification.chain_filter import ChainValues
    from flexstage.hysteresis.identification.chain_search import FoundChain, find_chain
    from flexstage.hysteresis.identification.cycles import Cycles, cycles, turning_points
    from flexstage.hysteresis.identification.families import FAMILIES
    from flexstage.hysteresis.identification.faults import RecordFault
    from flexstage.hysteresis.identification.identify import Candidate, Identification, identify
    from flexstage.hysteresis.identification.measurement import Measurement, Section, measurement
    from flexstage.hysteresis.identification.parameter_units import parameter_unit
    from flexstage.hysteresis.identification.uncertainty import Estimate
    from flexstage.hysteresis.identification.verdict import Verdict

__all__ = [
    "FAMILIES",
    "Candidate",
    "ChainValues",
    "Cycles",
    "Estimate",
    "FoundAmplifier",
    "FoundChain",
    "Identification",
    "Measurement",
    "RecordFault",
    "Section",
    "Verdict",
    "cycles",
    "find_chain",
    "identify",
    "identify_amplifier",
    "measurement",
    "parameter_unit",
    "turning_points",
]

import_on_use(__name__)
