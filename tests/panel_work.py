"""Work for the processes of a front panel."""

import os
import time

from flexstage.base import progress
from flexstage.base.errors import ModelError


def counted(steps: int, pause: float = 0.0) -> int:
    for step in range(steps):
        progress.update("counting", step / steps)
        time.sleep(pause)
    return os.getpid()


def refused(value: float) -> None:
    raise ModelError(f"there is no such value, got {value}")


def ended_from_outside() -> None:
    os._exit(3)
