"""A mass on a spring with Bouc-Wen hysteresis: simulated exactly, identified from records."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.hysteresis.oscillator.identification import (
        OscillatorIdentification,
        identify_oscillator,
    )
    from flexstage.hysteresis.oscillator.oscillator import BoucWenOscillator, OscillatorResponse

__all__ = [
    "BoucWenOscillator",
    "OscillatorIdentification",
    "OscillatorResponse",
    "identify_oscillator",
]

import_on_use(__name__)
