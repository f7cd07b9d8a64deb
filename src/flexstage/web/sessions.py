"""Sessions of the front panel on the server, with units and theme: a reload loses nothing."""

import hashlib
import hmac
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Generic, Literal, TypeVar

from flexstage.quantities.quantity import Quantity, display

AUTOMATIC = "auto"
#: Selectable units of lengths and angles, with the factor from SI.
LENGTHS = MappingProxyType({"nm": 1e9, "µm": 1e6, "mm": 1e3})
ANGLES = MappingProxyType({"µrad": 1e6, "mrad": 1e3, "arcsec": 206264.80624709636})
#: Themes; `auto` follows the setting of the computer.
THEMES = ("auto", "light", "dark")


@dataclass(frozen=True, slots=True, kw_only=True)
class Preferences:
    """Units and theme of one user."""

    length: str = AUTOMATIC
    """One of `LENGTHS`, or `AUTOMATIC`: the customary unit of each quantity."""
    angle: str = AUTOMATIC
    """One of `ANGLES`, or `AUTOMATIC`."""
    theme: Literal["auto", "light", "dark"] = "auto"
    """Theme of the page."""

    @property
    def dark(self) -> bool | None:
        """Dark page or not; None if the computer decides."""
        return {"auto": None, "light": False, "dark": True}[self.theme]

    def displayed(self, quantity: Quantity | str) -> Quantity:
        """Return a quantity with the unit that is selected for its dimension.

        Examples
        --------
        >>> arcsec = Preferences(angle="arcsec")
        >>> rotation, pitch = map(arcsec.displayed, ("parasitic_rotation", "pitch"))
        >>> rotation.text(4.85e-6), pitch.shown_unit
        ('1.000', 'arcsec')
        """
        customary = display(quantity) if isinstance(quantity, str) else quantity
        for unit, selected, units in (("m", self.length, LENGTHS), ("rad", self.angle, ANGLES)):
            if customary.unit == unit and selected != AUTOMATIC:
                return replace(customary, shown_unit=selected, factor=units[selected])
        return customary

    def length_unit(self) -> tuple[str, float]:
        """Return the unit of lengths and its factor, for axes."""
        unit = "µm" if self.length == AUTOMATIC else self.length
        return unit, LENGTHS[unit]

    def angle_unit(self) -> tuple[str, float]:
        """Return the unit of angles and its factor, for axes."""
        unit = "µrad" if self.angle == AUTOMATIC else self.angle
        return unit, ANGLES[unit]


S = TypeVar("S")

_MAX_UNDO = 200  # states that can be undone
_MAX_FAILURES, _FAILURE_WINDOW = 5, 60.0  # wrong passwords of one address, in this time [s]
_MAX_IDLE = 86400.0  # unused time after which a session ends [s]


class History(Generic[S]):
    """States of an edited object, with undo and redo.

    Examples
    --------
    >>> neck = History(0.5)
    >>> neck.put(0.4), neck.undo(), neck.now
    (None, None, 0.5)
    """

    def __init__(self, now: S) -> None:
        self.now = now
        self._undo_stack: deque[S] = deque(maxlen=_MAX_UNDO)
        self._redo_stack: list[S] = []

    def put(self, state: S) -> None:
        """Add a new state; undone states are lost."""
        if state != self.now:
            self._undo_stack.append(self.now)
            self._redo_stack.clear()
            self.now = state

    def undo(self) -> None:
        """Return to the previous state, if there is one."""
        if self._undo_stack:
            self._redo_stack.append(self.now)
            self.now = self._undo_stack.pop()

    def redo(self) -> None:
        """Revert the last undo, if there is one."""
        if self._redo_stack:
            self._undo_stack.append(self.now)
            self.now = self._redo_stack.pop()

    @property
    def can_undo(self) -> bool:
        """A previous state exists."""
        return bool(self._undo_stack)

    @property
    def can_redo(self) -> bool:
        """An undone state exists."""
        return bool(self._redo_stack)


@dataclass(eq=False, kw_only=True)
class States:
    """States of views, by their class."""

    _states: dict[type, Any] = field(default_factory=dict)

    def state(self, kind: type[S], make: Callable[[], S] | None = None) -> S:
        """Return the state of a view; the first call creates it."""
        if kind not in self._states:
            self._states[kind] = (make or kind)()
        return self._states[kind]

    def existing_state(self, kind: type[S]) -> S | None:
        """Return the state of a view, or None if the view was never opened."""
        return self._states.get(kind)


@dataclass(eq=False)
class Session(States):
    """A browser with access, and the states of its views."""

    id: str = field(default_factory=lambda: secrets.token_hex(6))
    """Name in the log and in the list of jobs; it is not secret."""
    preferences: Preferences = field(default_factory=Preferences)
    """Units and theme."""
    last_seen: float = 0.0
    """Time of the last sign of the browser, by the clock of `Access` [s]."""


class Access:
    """Single-use tokens, sessions and the password of the panel."""

    def __init__(
        self, password: str | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._salt = secrets.token_bytes(16)
        self._password = None if password is None else self._digest(password)
        self._clock = clock
        self._tokens: set[str] = set()
        self._sessions: dict[str, Session] = {}
        self._wrong: dict[str, list[float]] = {}
        self._lock = threading.Lock()

    @property
    def has_password(self) -> bool:
        """A password is set."""
        return self._password is not None

    def new_token(self) -> str:
        """Return a token for one login."""
        token = secrets.token_urlsafe(32)
        with self._lock:
            self._tokens = {_hashed(token)}
        return token

    def redeem(self, token: str) -> bool:
        """Use a token and return whether it is valid; a token is valid once."""
        with self._lock:
            if _hashed(token) not in self._tokens:
                return False
            self._tokens.clear()
            return True

    def is_password(self, password: str, client: str) -> bool | None:
        """Return whether a password is right; None after too many failures of one address."""
        now = self._clock()
        with self._lock:
            failures = [at for at in self._wrong.get(client, []) if now - at < _FAILURE_WINDOW]
            if len(failures) >= _MAX_FAILURES:
                return None
            if self._password and hmac.compare_digest(self._digest(password), self._password):
                self._wrong.pop(client, None)
                return True
            if len(self._wrong) > 1000:
                self._wrong.clear()
            self._wrong[client] = [*failures, now]
            return False

    def open_session(self) -> str:
        """Start a session, and return the secret for its cookie."""
        secret = secrets.token_urlsafe(32)
        with self._lock:
            self._sessions[_hashed(secret)] = Session(last_seen=self._clock())
        return secret

    def session(self, secret: str) -> Session | None:
        """Return the session of a secret; it ends after a day without use."""
        now = self._clock()
        with self._lock:
            sessions = self._sessions.items()
            self._sessions = {k: s for k, s in sessions if now - s.last_seen < _MAX_IDLE}
            if (session := self._sessions.get(_hashed(secret))) is not None:
                session.last_seen = now
            return session

    def keep_alive(self, session: Session) -> None:
        """Record a sign of the browser of a session."""
        session.last_seen = self._clock()

    def end(self, session: Session) -> None:
        """End a session: its cookie becomes invalid."""
        with self._lock:
            self._sessions = {k: s for k, s in self._sessions.items() if s is not session}

    def sessions(self) -> list[tuple[Session, float]]:
        """Return the sessions and the time since the last sign of each [s], the latest first."""
        now = self._clock()
        with self._lock:
            return sorted(
                ((s, now - s.last_seen) for s in self._sessions.values()), key=lambda p: p[1]
            )

    def take_over(self, mine: Session, abandoned: Session) -> None:
        """Give the browser of one session an abandoned session instead."""
        with self._lock:
            others = ((k, s) for k, s in self._sessions.items() if s is not abandoned)
            self._sessions = {k: abandoned if s is mine else s for k, s in others}

    def _digest(self, password: str) -> bytes:
        return hashlib.scrypt(password.encode(), salt=self._salt, n=2**12, r=8, p=1)


def _hashed(secret: str) -> str:
    # a look-up by hash: its duration reveals nothing about the secret
    return hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()
