"""A simulated controller by its address, in this process."""

from collections.abc import Mapping
from urllib.parse import urlsplit

from flexstage.designs import design
from flexstage.errors import ModelError
from flexstage.instruments.address import flag, longest_silence, number, one_of, options_of
from flexstage.instruments.pi.controller import PiController
from flexstage.instruments.pi.profile import TransferLimits
from flexstage.instruments.pi.simulated.clock import FastTime, Pacemaker
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.session import Loopback
from flexstage.instruments.transport import InProcess
from flexstage.stage import Stage
from flexstage.virtual.build import virtual_stage

_OPTIONS = ("seed", "model", "rate", "amplifier", "fast", "scatter", "quiet", "serial_number")
#: Lines that a simulation takes are longer than those of a controller.
_LONG_LINES = 16384
_LONGEST_WAIT = 60.0


def open_twin(
    address: str, stage: Stage | None, *, axes: Mapping[str, str] | None, timeout: float | None
) -> PiController:
    """Connect to a controller that is simulated here: ``twin://NAME?seed=3&model=lumped``."""
    parts = urlsplit(address.strip())
    options = options_of(address, parts, _OPTIONS)
    name = parts.netloc + parts.path
    if stage is None:
        if not name:
            raise ModelError(
                f"'{address}' names no stage: write twin://vgtu-piezo, or give the stage"
            )
        stage = design(name)
    elif name not in ("", stage.name):
        raise ModelError(
            f"'{address}' is a twin of '{name}', and the stage is '{stage.name}': leave the name "
            "out, as in twin://?seed=3"
        )
    silence = longest_silence(timeout, _LONGEST_WAIT)
    fast = flag(options, "fast", True, address)
    seed = int(number(options, "seed", 0, address, whole=True))
    made = virtual_stage(
        stage,
        model=one_of(options, "model", ("lumped", "superelement"), address),  # pyright: ignore[reportArgumentType]
        seed=seed,
        sample_rate_hz=number(options, "rate", 10e3, address),
        amplifier=one_of(options, "amplifier", ("voltage", "charge"), address),  # pyright: ignore[reportArgumentType]
        quiet=flag(options, "quiet", False, address),
        scatter=flag(options, "scatter", True, address),
    )
    serial_number = options.get("serial_number") or f"twin-{seed}"
    device = VirtualController(made, serial_number=serial_number)
    pace = FastTime(device) if fast else Pacemaker(device)
    pace.start()
    conversation = Loopback(Interpreter(device, pace), ends_time=True)
    link = InProcess(conversation, name=f"twin of {stage.name}")
    transfer = TransferLimits(line_limit=_LONG_LINES)
    return PiController.open(link, stage, axes=axes, timeout=silence, transfer=transfer)
