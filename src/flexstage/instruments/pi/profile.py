"""What a controller says of itself: its commands, parameters, and what its recorder offers."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from flexstage.errors import ControllerError
from flexstage.instruments.pi.client import GcsClient
from flexstage.instruments.pi.replies import excerpt
from flexstage.instruments.protocol import Identity


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferLimits:
    """How much is sent and asked for at once."""

    line_limit: int = 256
    """Most characters of a command line."""
    rows: int = 1000
    """Most rows of a table that are read at once."""
    poll: float = 0.01
    """Time between two questions while waiting [s]; none passes where simulated time runs fast."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerProfile:
    """What a controller says of itself."""

    identity: Identity
    """What it is."""
    commands: frozenset[str]
    """The commands that it knows; ``#5`` for single characters."""
    parameters: Mapping[int, str] = field(default_factory=dict)
    """What its parameters are called, by number."""
    record_options: Mapping[int, str] = field(default_factory=dict)
    """What its recorder records, by number."""
    trigger_options: Mapping[int, str] = field(default_factory=dict)
    """What starts its recorder, by number."""

    def knows(self, *commands: str) -> bool:
        """Say whether the controller knows all of these commands."""
        return self.commands.issuperset(commands)

    def parameter(self, pattern: str) -> int | None:
        """Return the lowest number of a parameter whose name the expression fits, in any case.

        Examples
        --------
        >>> who = Identity(vendor="", model="")
        >>> known = {7: "Table Rate"}
        >>> about = ControllerProfile(identity=who, commands=frozenset(), parameters=known)
        >>> about.parameter("^table"), about.parameter("speed")
        (7, None)
        """
        return _find(self.parameters, pattern)

    def record_option(self, *patterns: str) -> int | None:
        """Return the number of what the recorder records, by the first expression that fits any."""
        return _find_first(self.record_options, patterns)

    def trigger_option(self, *patterns: str) -> int | None:
        """Return the number of what starts the recorder, by the first expression that fits any."""
        return _find_first(self.trigger_options, patterns)


def read_profile(client: GcsClient) -> ControllerProfile:
    """Ask a controller what it can do; nothing is changed by it.

    By ``HLP?`` always, ``HPA?`` and ``HDR?`` where it knows them.
    """
    commands = _commands(client.ask("HLP?"))
    # the list is in order of the alphabet, and every controller has commands that begin with T or V
    if max(commands, default="") < "T":
        raise ControllerError(
            f"'HLP?' was answered with {len(commands)} commands, none of which begins with T or a "
            "later letter: the answer came in part; connect again, or check the link"
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
    """Read the answer to ``*IDN?``: vendor, model, serial number, firmware, between commas.

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
    """Return names by number; a line is number=level, items, type, group, name, ... by tabs.

    Many controllers put a tab behind the sign, too.
    """
    found: dict[int, str] = {}
    for line in lines:
        key, equals, rest = line.partition("=")
        columns = rest.removeprefix("\t").split("\t")
        if equals and re.fullmatch(r"\s*0[xX][0-9a-fA-F]+\s*", key) and len(columns) >= 5:
            found[int(key, 16)] = columns[4].strip()
    return found


def _recorder_options(lines: Sequence[str]) -> tuple[dict[int, str], dict[int, str]]:
    sections: dict[str, dict[int, str]] = {"#recordoptions": {}, "#triggeroptions": {}}
    current: dict[int, str] | None = None
    for line in lines:
        text = line.strip()
        if text.startswith("#"):
            current = sections.get(text.replace(" ", "").lower())
            continue
        found = re.fullmatch(r"(\d{1,6})\s*=\s*(.*)", text)
        if found and current is not None:
            current[int(found[1])] = found[2]
    return sections["#recordoptions"], sections["#triggeroptions"]


def _find(names: Mapping[int, str], pattern: str) -> int | None:
    fitting = (n for n, name in sorted(names.items()) if re.search(pattern, name, re.IGNORECASE))
    return next(fitting, None)


def _find_first(names: Mapping[int, str], patterns: Sequence[str]) -> int | None:
    for pattern in patterns:
        number = _find(names, pattern)
        if number is not None:
            return number
    return None


def describe(names: Mapping[int, str]) -> str:
    """Return a list of options for a sentence."""
    return ", ".join(excerpt(name) for name in names.values()) or "nothing"
