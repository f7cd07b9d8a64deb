"""Profile of a GCS controller, and the connection to it."""

import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from flexstage.base.errors import ControllerError
from flexstage.instruments.pi.conversation import GcsClient
from flexstage.instruments.pi.replies import excerpt, number
from flexstage.instruments.protocol import Identity


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferLimits:
    """Limits of the amount of data that is sent or requested at once."""

    line_limit: int = 256
    """Largest number of characters of a command line."""
    rows: int = 1000
    """Largest number of rows of a table that are read at once."""
    poll: float = 0.01
    """Polling interval [s]; not used where simulated time runs fast."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerProfile:
    """Identity, commands and options that a controller reports."""

    identity: Identity
    """Its identity."""
    commands: frozenset[str]
    """The supported commands; ``#5`` for single characters."""
    parameters: Mapping[int, str] = field(default_factory=dict)
    """Names of its parameters, by number."""
    record_options: Mapping[int, str] = field(default_factory=dict)
    """Record options of its recorder, by number."""
    trigger_options: Mapping[int, str] = field(default_factory=dict)
    """Trigger options of its recorder, by number."""

    def knows(self, *commands: str) -> bool:
        """Return whether the controller supports all of these commands."""
        return self.commands.issuperset(commands)

    def parameter(self, pattern: str) -> int | None:
        """Return the lowest number of a parameter whose name matches, ignoring case.

        Examples
        --------
        >>> who = Identity(vendor="", model="")
        >>> known = {7: "Table Rate"}
        >>> about = ControllerProfile(identity=who, commands=frozenset(), parameters=known)
        >>> about.parameter("^table"), about.parameter("speed")
        (7, None)
        """
        return first_matching(self.parameters, pattern)


def read_profile(client: GcsClient) -> ControllerProfile:
    """Read the profile of a controller; this changes nothing.

    It uses ``HLP?``, and ``HPA?`` and ``HDR?`` where they are supported.
    """
    commands = _commands(client.ask("HLP?"))
    # the list is in alphabetic order, and every controller has commands that start with T or V
    if max(commands, default="") < "T":
        raise ControllerError(
            f"the answer to 'HLP?' has {len(commands)} commands, none of which starts with T or a "
            "later letter: the answer is incomplete; connect again, or check the link"
        )
    parameters = _parameters(client.ask("HPA?")) if "HPA?" in commands else {}
    options: tuple[dict[int, str], dict[int, str]] = ({}, {})
    if "HDR?" in commands:
        options = _recorder_options(client.ask("HDR?"))
    return ControllerProfile(
        identity=parse_identity(client.identity),
        commands=commands,
        parameters=parameters,
        record_options=options[0],
        trigger_options=options[1],
    )


def parse_identity(text: str) -> Identity:
    """Return the identity of an answer to ``*IDN?``: vendor, model, serial number, firmware.

    Examples
    --------
    >>> parse_identity("(c) 2013 Maker, Controller, 117, 1.02").serial_number
    '117'
    """
    fields = [f.strip() for f in text.split(",")]
    while len(fields) < 4:
        fields.append("")
    return Identity(
        vendor=", ".join(fields[:-3]),
        model=fields[-3],
        serial_number=fields[-2],
        firmware=fields[-1],
        simulated="simulated" in text.lower(),
    )


def _commands(lines: Sequence[str]) -> frozenset[str]:
    words = (line.split(maxsplit=1)[0] for line in lines if line.strip())
    return frozenset(w.rstrip(":,") for w in words if re.fullmatch(r"#\d+|\*?[A-Z]{3}\??[:,]?", w))


def _parameters(lines: Sequence[str]) -> dict[int, str]:
    """Return names by number; a line is number=level, items, type, group, name, ... with tabs.

    Many controllers also have a tab after the equals sign.
    """
    names: dict[int, str] = {}
    for line in lines:
        key, equals, rest = line.partition("=")
        columns = rest.removeprefix("\t").split("\t")
        if equals and re.fullmatch(r"\s*0[xX][0-9a-fA-F]+\s*", key) and len(columns) >= 5:
            names[int(key, 16)] = columns[4].strip()
    return names


def _recorder_options(lines: Sequence[str]) -> tuple[dict[int, str], dict[int, str]]:
    sections: dict[str, dict[int, str]] = {"#recordoptions": {}, "#triggeroptions": {}}
    current: dict[int, str] | None = None
    for line in lines:
        text = line.strip()
        if text.startswith("#"):
            current = sections.get(text.replace(" ", "").lower())
            continue
        match = re.fullmatch(r"(\d{1,6})\s*=\s*(.*)", text)
        if match and current is not None:
            current[int(match[1])] = match[2]
    return sections["#recordoptions"], sections["#triggeroptions"]


def first_matching(names: Mapping[int, str], *patterns: str) -> int | None:
    """Return the lowest number whose name matches, ignoring case, by the first pattern that does.

    Examples
    --------
    >>> first_matching({7: "Table Rate", 9: "Rate"}, "speed", "^rate")
    9
    """
    for pattern in patterns:
        for key in sorted(names):
            if re.search(pattern, names[key], re.IGNORECASE):
                return key
    return None


def describe(names: Mapping[int, str]) -> str:
    """Return a list of options for a message."""
    return ", ".join(excerpt(name) for name in names.values()) or "nothing"


#: Largest simulated time that passes with a repeated question [s].
FAST_TIME_STEP = 0.25

# Simulated time that passes at once [s].
_PIECE = 1.0
# Refusals of a controller that has lost settings of this program: control is off; no table is
# selected, or it is empty.
_CONTROL_OFF, _TABLE_GONE = frozenset({5}), frozenset({75, 401})
_RESTARTED = (
    "it was restarted, or another program commands it; settings and tables are lost and the stage "
    "may have moved: connect again and restart"
)
_NAMES = {
    "fast": r"simulated time runs fast",
    "time": r"^simulated time \[s\]",
    "drives": r"drives taken out",
}


class Connection:
    """Connection to a controller, with its clock and the settings of this program."""

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
        #: Known states of position control, by identifier of the axis.
        self.servo: dict[str, bool] = {}
        #: Number of axes of the controller, also of those without the stage.
        self.axes = 0
        #: Divider of the recorder that this program has set.
        self.divider: int | None = None
        self._numbers = {key: profile.parameter(pattern) for key, pattern in _NAMES.items()}
        self._drives_out = False
        fast = self._numbers["fast"]
        self.fast = fast is not None and number(self.read_parameter("1", fast), "SPA?") == 1.0

    def tell(self, command: str) -> None:
        """Send a command; if its refusal indicates a restart of the controller, report this."""
        try:
            self.client.tell(command)
        except ControllerError as error:
            if error.code in _CONTROL_OFF | _TABLE_GONE:
                self.check_state(error)
            if error.code in _TABLE_GONE:
                raise ControllerError(
                    f"{error}, although this program had written it: {_RESTARTED}", error.code
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
                f"the answer to '{question}' is {excerpt(' | '.join(lines))}, which belongs to "
                "another question: check whether another program uses this link"
            )
        return value.strip()

    def number_parameter(self, item: str, pattern: str) -> float | None:
        """Return the value of a numeric parameter, by a regular expression for its name.

        None where the controller has no such parameter.
        """
        key = self.profile.parameter(pattern)
        if key is None:
            return None
        return number(self.read_parameter(item, key), f"SPA? {item} 0x{key:08X}")

    # state ----------------------------------------------------------------------------------

    def check_state(self, cause: ControllerError | None = None) -> None:
        """Compare settings of the controller with those of this program; `cause` is the reason."""
        lost: list[str] = []
        controlled = [axis for axis, on in self.servo.items() if on]
        if controlled and self.profile.knows("SVO?"):
            states = self.client.ask_values("SVO?", controlled)
            lost += [
                f"position control of its axis {axis} is off"
                for axis, on in zip(controlled, states, strict=True)
                if not on
            ]
        if self.divider is not None and self.profile.knows("RTR?"):
            rate = self.client.ask_whole("RTR?")
            if rate != self.divider:
                lost.append(f"its record rate is {rate} instead of {self.divider}")
        if lost:
            code = None if cause is None else cause.code
            raise ControllerError(
                f"the controller has lost settings ({'; '.join(lost)}): {_RESTARTED}",
                code,
            ) from cause

    @property
    def has_drives(self) -> bool:
        """Whether drives can be removed from a simulated stage."""
        return self._numbers["drives"] is not None

    def restore_drives(self) -> None:
        """Install the drives of a simulated stage again after an impact."""
        if self._drives_out:
            self._set_drives(out=False)

    def remove_drives(self) -> None:
        """Remove the drives of a simulated stage for an impact."""
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
        """Let time pass [s]: that of the controller if its simulation runs fast."""
        key = self._numbers["time"]
        if seconds <= 0.0:
            return
        if self.fast and key is not None:
            # in pieces, each of which is computed well within the timeout of an answer
            for _ in range(int(seconds / _PIECE)):
                self.tell(f"SPA 1 0x{key:08X} {_PIECE:.6f}")
            if remainder := math.fmod(seconds, _PIECE):
                self.tell(f"SPA 1 0x{key:08X} {remainder:.6f}")
        else:
            self._sleep(seconds)

    def patience(self, timeout: float) -> "Patience":
        """Return a limit for waiting [s]."""
        return Patience(self, timeout)

    def between_questions(self) -> None:
        """Wait for the polling interval; in fast time the question itself lets time pass."""
        if not self.fast:
            self._sleep(self.transfer.poll)

    def settings(self) -> Mapping[str, str]:
        """Return the known settings, without a question."""
        texts = {f"position control of axis {a}": "on" if on else "off" for a, on in
                 self.servo.items()}  # fmt: skip
        if self.divider is not None:
            texts["record rate divider"] = str(self.divider)
        return texts


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
