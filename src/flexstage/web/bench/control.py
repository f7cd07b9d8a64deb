"""Who drives the stage at the bench: one browser at a time, and all others look."""

import threading
import time
from collections.abc import Callable

from flexstage.base.errors import ModelError

#: Who has not been seen for so long is gone, and another may take over [s].
GONE = 30.0


class Control:
    """Which browser drives the stage.

    Parameters
    ----------
    clock
        The time [s].

    Examples
    --------
    >>> control = Control()
    >>> control.take("a", "Ann"); control.ask("b", "Bob"); control.name, control.asker
    ('Ann', 'Bob')
    >>> control.give("a"); control.name
    'Bob'
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.RLock()
        self._holder = self._asked = ""
        self._seen = 0.0
        #: Who drives, by the name that others see; empty for nobody.
        self.name = ""
        #: Who asks to drive.
        self.asker = ""

    def holds(self, session: str) -> bool:
        """Say whether a browser drives."""
        return bool(self._holder) and session == self._holder

    def asks(self, session: str) -> bool:
        """Say whether a browser has asked to drive."""
        return bool(self._asked) and session == self._asked

    @property
    def free(self) -> bool:
        """Whether nobody drives, or who does is gone."""
        return not self._holder or self._clock() - self._seen > GONE

    def seen(self, session: str) -> None:
        """Take note that a browser is still there."""
        with self._lock:
            if self.holds(session):
                self._seen = self._clock()

    def take(self, session: str, name: str) -> None:
        """Begin to drive, where nobody else does.

        Raises
        ------
        ModelError
            Somebody else drives.
        """
        with self._lock:
            if not self.holds(session) and not self.free:
                raise ModelError(f"{self.name} drives the stage: ask for control")
            self._hand_over(session, name)

    def ask(self, session: str, name: str) -> None:
        """Ask whoever drives to hand it over."""
        with self._lock:
            if not self.holds(session):
                self._asked, self.asker = session, name

    def give(self, session: str) -> None:
        """Hand over to whoever asked, else to nobody."""
        with self._lock:
            self.require(session)
            self._hand_over(self._asked, self.asker)

    def release(self, session: str) -> None:
        """Drive no more; who asked may ask again."""
        with self._lock:
            self.require(session)
            self._hand_over("", "")

    def keep(self, session: str) -> None:
        """Go on driving although somebody asked."""
        with self._lock:
            self.require(session)
            self._asked = self.asker = ""

    def require(self, session: str) -> None:
        """Refuse what a browser wants that does not drive.

        Raises
        ------
        ModelError
            It does not.
        """
        with self._lock:
            if not self.holds(session):
                driver = f"{self.name} drives" if self._holder else "nobody drives"
                raise ModelError(
                    f"this browser sees the stage and does not drive it; {driver}: take control or "
                    "ask for it"
                )
            self._seen = self._clock()

    def _hand_over(self, session: str, name: str) -> None:
        self._holder, self.name, self._seen = session, name, self._clock()
        self._asked = self.asker = ""
