"""NI cards: sensors at analogue inputs, drives behind amplifiers at analogue outputs."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.instruments.ni.acquisition import NiAcquisition
    from flexstage.instruments.ni.address import open_address
    from flexstage.instruments.ni.setup import DriveOutput, NiSetup, SensorInput

__all__ = ["DriveOutput", "NiAcquisition", "NiSetup", "SensorInput", "open_address"]

import_on_use(__name__)
