"""A simulated stage, and the controller that it is connected to.

`virtual_stage` makes a stage that runs sample by sample, with the hysteresis, creep, noise and
scatter that such stages have; `VirtualController` puts axes, waveforms and a recorder before it;
`Interpreter` gives that the General Command Set, and `GcsServer` a TCP port.
`flexstage.instruments.connect` does all of it for an address such as ``twin://vgtu-piezo?seed=3``.
"""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.instruments.twin.build import virtual_stage
    from flexstage.instruments.twin.controller import VirtualController
    from flexstage.instruments.twin.interpreter import Interpreter
    from flexstage.instruments.twin.server import GcsServer

__all__ = ["GcsServer", "Interpreter", "VirtualController", "virtual_stage"]

import_on_use(__name__)
