"""The linear chain between a command and a reading: each element simulated, and undone."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.hysteresis.chain.amplifier import Amplifier
    from flexstage.hysteresis.chain.creep import Creep, CreepSpectrum, LogCreep
    from flexstage.hysteresis.chain.element import ChainElement
    from flexstage.hysteresis.chain.joint import JointResponse, simulate_with_stage
    from flexstage.hysteresis.chain.lag import Lag
    from flexstage.hysteresis.chain.resonance import StageModes
    from flexstage.hysteresis.chain.sensor import Sensor

__all__ = [
    "Amplifier",
    "ChainElement",
    "Creep",
    "CreepSpectrum",
    "JointResponse",
    "Lag",
    "LogCreep",
    "Sensor",
    "StageModes",
    "simulate_with_stage",
]

import_on_use(__name__)
