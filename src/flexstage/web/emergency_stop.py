"""What the button STOP of the front panel stops: every stage that is connected."""

import logging
import threading
from collections.abc import Callable

_LOG = logging.getLogger("flexstage.web")


class Stops:
    """The connected stages, and how each is stopped.

    Examples
    --------
    >>> stops = Stops()
    >>> stops.add("twin", lambda: print("stopped")); stops.active
    True
    >>> stops.stop()
    stopped
    """

    def __init__(self) -> None:
        self._stops: dict[str, Callable[[], object]] = {}
        self._lock = threading.Lock()
        self.active = False

    def add(self, name: str, stop: Callable[[], object]) -> None:
        """Put a stage under the button; `stop` may come at any time, from any thread."""
        with self._lock:
            self._stops[name] = stop
            self.active = True

    def remove(self, name: str) -> None:
        """Take a stage away that is no longer connected."""
        with self._lock:
            self._stops.pop(name, None)
            self.active = bool(self._stops)

    def stop(self) -> None:
        """Stop all of them, also where one fails."""
        with self._lock:
            stops = dict(self._stops)
        for name, stop in stops.items():
            try:
                stop()
            except Exception:  # noqa: BLE001 - the others are stopped in any case
                _LOG.exception("stopping '%s' failed", name)
