"""The STOP button of the front panel: it stops every connected stage."""

import logging
import threading
from collections.abc import Callable

_LOG = logging.getLogger("flexstage.web")


class EmergencyStop:
    """The connected stages, each with the function that stops it.

    Examples
    --------
    >>> emergency_stop = EmergencyStop()
    >>> emergency_stop.add("twin", lambda: print("stopped")); emergency_stop.active
    True
    >>> emergency_stop.stop()
    stopped
    """

    def __init__(self) -> None:
        self._stops: dict[str, Callable[[], object]] = {}
        self._lock = threading.Lock()
        self.active = False

    def add(self, name: str, stop: Callable[[], object]) -> None:
        """Add a stage; `stop` may be called at any time, from any thread."""
        with self._lock:
            self._stops[name] = stop
            self.active = True

    def remove(self, name: str) -> None:
        """Remove a stage that is no longer connected."""
        with self._lock:
            self._stops.pop(name, None)
            self.active = bool(self._stops)

    def stop(self) -> None:
        """Stop all stages; the failure of one does not keep the others from being stopped."""
        with self._lock:
            functions = dict(self._stops)
        for name, stop in functions.items():
            try:
                stop()
            except Exception:  # noqa: BLE001 - the other stages are stopped in any case
                _LOG.exception("stopping '%s' failed", name)
