"""What the parts of a controller share: the link, the clock, what was set."""

import math
import time
from collections.abc import Callable, Mapping

from flexstage.errors import ControllerError
from flexstage.instruments.pi.client import GcsClient
from flexstage.instruments.pi.profile import ControllerProfile, TransferLimits
from flexstage.instruments.pi.replies import excerpt, number

#: Simulated time that passes with a question that is repeated, at most [s].
FAST_TIME_STEP = 0.25

# Simulated time that is let pass at once [s].
_PIECE = 1.0
# Refusals that a controller gives when what was set here is not there any more: control is off; no
# table was chosen, or it is empty.
_CONTROL_OFF, _TABLE_GONE = frozenset({5}), frozenset({75, 401})
_RESTARTED = (
    "it was restarted, or somebody else commands it; settings and tables are gone and the stage "
    "may have moved, so connect again and begin anew"
)
_NAMES = {
    "fast": r"simulated time runs fast",
    "time": r"^simulated time \[s\]",
    "drives": r"drives taken out",
}


class Connection:
    """Link, clock and memory of a controller."""

    def __init__(
        self,
        client: GcsClient,
        profile: ControllerProfile,
        transfer: TransferLimits,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self.client, self.profile, self.transfer = client, profile, transfer
        self._clock, self._sleep = clock, sleep
        #: Whether position control is on, as far as is known, by identifier of the axis.
        self.servo: dict[str, bool] = {}
        #: Divider of the recorder that was set here.
        self.divider: int | None = None
        self._numbers = {key: profile.parameter(pattern) for key, pattern in _NAMES.items()}
        self._drives_out = False
        fast = self._numbers["fast"]
        self.fast = fast is not None and number(self.read_parameter("1", fast), "SPA?") == 1.0

    def tell(self, command: str) -> None:
        """Give a command; where its refusal shows that the controller was restarted, say so."""
        try:
            self.client.tell(command)
        except ControllerError as error:
            if error.code in _CONTROL_OFF | _TABLE_GONE:
                self.check_state(error)
            if error.code in _TABLE_GONE:
                raise ControllerError(
                    f"{error}, though it was written from here: {_RESTARTED}", error.code
                ) from error
            raise

    def read_parameter(self, item: str, key: int) -> str:
        """Return the value of a parameter of an axis, a channel, or ``1`` for the controller."""
        question = f"SPA? {item} 0x{key:08X}"
        lines = self.client.ask(question)
        name, equals, value = lines[0].partition("=")
        words = name.split()
        try:
            right = len(lines) == 1 and len(words) == 2 and int(words[1], 0) == key
        except ValueError:
            right = False
        if not (equals and right):
            raise ControllerError(
                f"the answer to '{question}' is {excerpt(' | '.join(lines))}, which is about "
                "something else: is another program using this link?"
            )
        return value.strip()

    def number_parameter(self, item: str, pattern: str) -> float | None:
        """Return a number among the parameters, by a regular expression for its name.

        None where the controller has no such parameter.
        """
        key = self.profile.parameter(pattern)
        if key is None:
            return None
        return number(self.read_parameter(item, key), f"SPA? {item} 0x{key:08X}")

    # state ----------------------------------------------------------------------------------

    def check_state(self, cause: ControllerError | None = None) -> None:
        """Compare what the controller has with what was set here; the cause gave reason to ask."""
        lost: list[str] = []
        wanted = [axis for axis, on in self.servo.items() if on]
        if wanted and self.profile.knows("SVO?"):
            states = self.client.ask_values("SVO?", wanted)
            lost += [
                f"position control of its axis {axis} is off"
                for axis, on in zip(wanted, states, strict=True)
                if not on
            ]
        if self.divider is not None and self.profile.knows("RTR?"):
            rate = self.client.ask_whole("RTR?")
            if rate != self.divider:
                lost.append(f"its record rate is {rate} and not {self.divider}")
        if lost:
            code = None if cause is None else cause.code
            raise ControllerError(
                f"the controller has lost what was set here ({'; '.join(lost)}): {_RESTARTED}",
                code,
            ) from cause

    @property
    def has_drives(self) -> bool:
        """Whether drives can be taken out of a simulated stage."""
        return self._numbers["drives"] is not None

    def drives_back(self) -> None:
        """Put the drives of a simulated stage back in place after a blow."""
        if self._drives_out:
            self._set_drives(out=False)

    def drives_away(self) -> None:
        """Take the drives of a simulated stage out, for a blow."""
        if not self._drives_out:
            self._set_drives(out=True)

    def _set_drives(self, *, out: bool) -> None:
        key = self._numbers["drives"]
        if key is not None:
            self.tell(f"SPA 1 0x{key:08X} {int(out)}")
            self._drives_out = out

    # time -----------------------------------------------------------------------------------

    def now(self) -> float:
        """Return the time of the computer's clock [s]."""
        return self._clock()

    def pause(self, seconds: float) -> None:
        """Let time pass [s]: that of the controller where it is simulated and fast."""
        key = self._numbers["time"]
        if seconds <= 0.0:
            return
        if self.fast and key is not None:
            # in pieces, each of which is computed well before an answer is given up
            for _ in range(int(seconds / _PIECE)):
                self.tell(f"SPA 1 0x{key:08X} {_PIECE:.6f}")
            if rest := math.fmod(seconds, _PIECE):
                self.tell(f"SPA 1 0x{key:08X} {rest:.6f}")
        else:
            self._sleep(seconds)

    def patience(self, timeout: float) -> "Patience":
        """Return a limit for waiting [s]."""
        return Patience(self, timeout)

    def between_questions(self) -> None:
        """Wait a little before a question is repeated; in fast time the question itself waits."""
        if not self.fast:
            self._sleep(self.transfer.poll)

    def settings(self) -> Mapping[str, str]:
        """Return what was set, without asking."""
        found = {f"position control of axis {a}": "on" if on else "off" for a, on in
                 self.servo.items()}  # fmt: skip
        if self.divider is not None:
            found["record rate divider"] = str(self.divider)
        return found


class Patience:
    """Counts the time of waiting [s], also where simulated time runs fast.

    In fast time each question counts as a quarter of a second divided by ten, since it may be
    answered before that has passed: what is waited for may take up to ten times the time-out.
    """

    def __init__(self, connection: Connection, timeout: float) -> None:
        self._connection, self._end = connection, connection.now() + timeout
        self._questions = 1 + int(10.0 * timeout / FAST_TIME_STEP)

    def over(self) -> bool:
        """Say whether it has ended, and count one more question."""
        self._questions -= 1
        if self._connection.fast:
            return self._questions <= 0
        return self._connection.now() >= self._end
