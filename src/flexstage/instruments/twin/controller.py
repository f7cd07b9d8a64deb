"""A simulated controller with its stage, in simulated time."""

from flexstage import __version__
from flexstage.instruments.protocol import Identity
from flexstage.instruments.twin.controller_motion import ControllerMotion
from flexstage.instruments.twin.controller_recorder import ControllerRecorder
from flexstage.instruments.twin.controller_waves import ControllerWaves
from flexstage.instruments.twin.stage import VirtualStage


class VirtualController(ControllerMotion, ControllerWaves, ControllerRecorder):
    """A controller of a stage that is simulated: axes, control, waveforms and a recorder.

    Everything is SI and in simulated time. The axes are ``1``, ``2`` ... in the order of the
    stage's; tables, channels and records are numbered from 1. Time passes only by `advance`; in
    which portions it passes makes no difference to any sample. A command acts with the next sample
    of the loop. What a client says wrong is refused by a `RefusedError` with its reason, nothing
    else, and nothing has changed then.

    A piezo axis has arrived within `window` [m] of its target for `settle` [s]; of a screw the
    window is its smallest step.

    Notes
    -----
    Moves are straight ramps at the speed of the axis, without a limit of acceleration, as piezo
    controllers make them: the corners of an open-loop ramp ring at the first mode of the stage.
    Signals are recorded at the instant at which they are there, without the delays inside a real
    controller. One thread at a time: a server holds a lock while it uses it.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.instruments.twin.build import virtual_stage
    >>> device = VirtualController(virtual_stage(design("vgtu-piezo"), model="lumped", seed=2))
    >>> device.set_servo("1", True)
    >>> device.set_targets({"1": 20e-6})
    >>> device.advance(0.5)
    >>> device.on_target("1"), round(device.position("1") * 1e6)
    (True, 20)
    """

    def __init__(
        self,
        stage: VirtualStage,
        *,
        serial_number: str = "",
        window: float = 20e-9,
        settle: float = 5e-3,
    ) -> None:
        super().__init__(stage, window=window, settle=settle)
        self._identity = Identity(
            vendor="flexstage",
            model=f"simulated {stage.stage.name}",
            serial_number=serial_number,
            firmware=__version__,
            simulated=True,
        )

    @property
    def identity(self) -> Identity:
        """What it is: it says that it is simulated."""
        return self._identity
