"""Who is in the front panel, and what each has open: on the server, so a reload loses nothing."""

import hashlib
import hmac
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from flexstage.web.preferences import Preferences

S = TypeVar("S")

_KEPT = 200  # states that can be undone
_TRIES, _WHILE = 5, 60.0  # wrong passwords of one address, in so many seconds
_LONGEST = 86400.0  # a session that nobody has used for so long ends [s]


class History(Generic[S]):
    """States of something that is edited, with undo and redo.

    Examples
    --------
    >>> neck = History(0.5)
    >>> neck.put(0.4), neck.undo(), neck.now
    (None, None, 0.5)
    """

    def __init__(self, now: S) -> None:
        self.now = now
        self._before: deque[S] = deque(maxlen=_KEPT)
        self._after: list[S] = []

    def put(self, state: S) -> None:
        """Take a new state; what had been undone is gone."""
        if state != self.now:
            self._before.append(self.now)
            self._after.clear()
            self.now = state

    def undo(self) -> None:
        """Go back to the state before, if there is one."""
        if self._before:
            self._after.append(self.now)
            self.now = self._before.pop()

    def redo(self) -> None:
        """Take back the last undo, if there is one."""
        if self._after:
            self._before.append(self.now)
            self.now = self._after.pop()

    @property
    def can_undo(self) -> bool:
        """Whether there is a state before."""
        return bool(self._before)

    @property
    def can_redo(self) -> bool:
        """Whether something was undone."""
        return bool(self._after)


@dataclass(eq=False, kw_only=True)
class States:
    """What views keep, each by its class."""

    _states: dict[type, Any] = field(default_factory=dict)

    def state(self, kind: type[S], make: Callable[[], S] | None = None) -> S:
        """Return what a view keeps; made when it is first asked for."""
        if kind not in self._states:
            self._states[kind] = (make or kind)()
        return self._states[kind]

    def opened(self, kind: type[S]) -> S | None:
        """Return what a view keeps, where it was ever opened."""
        return self._states.get(kind)


@dataclass(eq=False)
class Session(States):
    """A browser that came in, and what its views keep for it."""

    id: str = field(default_factory=lambda: secrets.token_hex(6))
    """Its name in the log and in the list of jobs: no secret."""
    preferences: Preferences = field(default_factory=Preferences)
    """Units and look."""
    seen: float = 0.0
    """When its browser was last seen, by the clock of the access [s]."""


class Access:
    """Tokens that open the panel once, sessions that they open, and the password."""

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
        """Whether there is a password."""
        return self._password is not None

    def new_token(self) -> str:
        """Return a token that opens the panel once."""
        token = secrets.token_urlsafe(32)
        with self._lock:
            self._tokens = {_hashed(token)}
        return token

    def spend(self, token: str) -> bool:
        """Take a token; say whether it opens the panel. It does so once."""
        with self._lock:
            if _hashed(token) not in self._tokens:
                return False
            self._tokens.clear()
            return True

    def is_password(self, given: str, client: str) -> bool | None:
        """Say whether a password is right; None where an address tried too often to be heard."""
        now = self._clock()
        with self._lock:
            tries = [at for at in self._wrong.get(client, []) if now - at < _WHILE]
            if len(tries) >= _TRIES:
                return None
            if self._password and hmac.compare_digest(self._digest(given), self._password):
                self._wrong.pop(client, None)
                return True
            if len(self._wrong) > 1000:
                self._wrong.clear()
            self._wrong[client] = [*tries, now]
            return False

    def open_session(self) -> str:
        """Start a session, and return the secret that its cookie holds."""
        secret = secrets.token_urlsafe(32)
        with self._lock:
            self._sessions[_hashed(secret)] = Session(seen=self._clock())
        return secret

    def session(self, secret: str) -> Session | None:
        """Return the session of a secret, which lasts a day from when it was last used."""
        now = self._clock()
        with self._lock:
            lasting = self._sessions.items()
            self._sessions = {k: s for k, s in lasting if now - s.seen < _LONGEST}
            if (found := self._sessions.get(_hashed(secret))) is not None:
                found.seen = now
            return found

    def saw(self, session: Session) -> None:
        """Take note that the browser of a session is still there."""
        session.seen = self._clock()

    def end(self, session: Session) -> None:
        """End a session: its cookie opens nothing any more."""
        with self._lock:
            self._sessions = {k: s for k, s in self._sessions.items() if s is not session}

    def sessions(self) -> list[tuple[Session, float]]:
        """Return the sessions and how long ago each was seen [s], the latest first."""
        now = self._clock()
        with self._lock:
            return sorted(((s, now - s.seen) for s in self._sessions.values()), key=lambda p: p[1])

    def go_on(self, mine: Session, left: Session) -> None:
        """Let the browser of one session have another instead, which its own browser has left."""
        with self._lock:
            others = ((k, s) for k, s in self._sessions.items() if s is not left)
            self._sessions = {k: left if s is mine else s for k, s in others}

    def _digest(self, password: str) -> bytes:
        return hashlib.scrypt(password.encode(), salt=self._salt, n=2**12, r=8, p=1)


def _hashed(secret: str) -> str:
    # found by its hash, so that how long it takes tells nothing of the secret
    return hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()
