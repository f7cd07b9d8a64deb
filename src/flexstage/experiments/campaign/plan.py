"""What was measured and how: the kinds of tests, the description of a set of them, and its file."""

import os
from collections.abc import Callable, Sequence
from collections.abc import Mapping as MappingType
from dataclasses import dataclass, field, fields
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from flexstage.base.errors import ModelError, StageError
from flexstage.experiments.campaign.requests import (
    CharacteriseRequest,
    Columns,
    Evaluation,
    TestOptions,
)
from flexstage.files.decoder import Decoder, read_file
from flexstage.files.encoder import Encoder
from flexstage.files.format import Format
from flexstage.files.nodes import Mapping, Scalar
from flexstage.files.ranges import require_ranges
from flexstage.quantities.sensor import SensorSpecification

_MOTIONS = ("along", "across", "vertical", "roll", "pitch", "yaw")
_COMMANDED = {"command": "command"}


@dataclass(frozen=True, slots=True, kw_only=True)
class KindOfTest:
    """A kind of test."""

    what: str
    """What it is."""
    evaluated_by: str
    """The function that evaluates it, with its module beside this one."""
    over: tuple[str, ...] = ("time",)
    """What the rows of its records may follow one another by: time, point, or frequency."""
    sensors: tuple[str, ...] | None = None
    """Roles that sensors have in a plan's record of it; None where a plan cannot make one."""
    needed: tuple[str, ...] = ()
    """Those of them without which it cannot be evaluated."""
    beside: MappingType[str, str] = field(default_factory=dict)
    """Columns that a plan's record has beside its sensors, by their role."""

    @property
    def points(self) -> bool:
        """Whether its rows follow one another by number where the file has no time."""
        return "point" in self.over

    @property
    def evaluate(self) -> Callable[..., Any]:
        """The function that makes a `TestResult` of a test, its records and its campaign."""
        module, _, name = self.evaluated_by.partition(".")
        return getattr(import_module(f"flexstage.experiments.campaign.{module}"), name)


#: Kinds of tests by name; a new one is one entry here, and the function that evaluates it.
KINDS: dict[str, KindOfTest] = {
    "motion": KindOfTest(
        what="cycles over the stroke: stroke, hysteresis, straightness, rotations, coupling",
        evaluated_by="motion.evaluate_motion",
        sensors=_MOTIONS,
        needed=("along",),
        beside=_COMMANDED,
    ),
    "spheres": KindOfTest(
        what="the same by spheres of a plate that a measuring machine probes at stations",
        evaluated_by="motion.evaluate_spheres",
        over=("time", "point"),
    ),
    "positioning": KindOfTest(
        what="targets gone to from both sides: accuracy and repeatability as in ISO 230-2",
        evaluated_by="positioning.evaluate_positioning",
        over=("time", "point"),
        sensors=("along",),
        needed=("along",),
        beside=_COMMANDED,
    ),
    "staircase": KindOfTest(
        what="small steps: resolution",
        evaluated_by="positioning.evaluate_staircase",
        sensors=("along",),
        needed=("along",),
        beside=_COMMANDED,
    ),
    "hold": KindOfTest(
        what="the stage held: noise and drift",
        evaluated_by="positioning.evaluate_hold",
        sensors=("along",),
        needed=("along",),
    ),
    "response": KindOfTest(
        what="hammer, sweep or noise: natural frequencies and damping",
        evaluated_by="response.evaluate_response",
        over=("time", "frequency"),
        sensors=(),
    ),
    "ring-down": KindOfTest(
        what="free decay: natural frequencies and damping",
        evaluated_by="response.evaluate_ring_down",
    ),
    "workspace": KindOfTest(
        what="corners gone to again and again: area, squareness",
        evaluated_by="motion.evaluate_workspace",
        over=("time", "point"),
        sensors=("x", "y"),
        needed=("x", "y"),
        beside={"corner": "corner"},
    ),
}


#: What can excite a response; auto looks at the input.
EXCITATIONS: tuple[str, ...] = ("auto", "random", "periodic", "hammer", "step", "sweep")


@dataclass(frozen=True, slots=True, kw_only=True)
class Test(Evaluation, TestOptions):
    """One test: its records, and what is in them."""

    name: str
    """Its name."""
    test: str
    """Kind of test, one of `KINDS`."""
    records: tuple[str, ...]
    """Its files, from the folder of the file that describes them."""
    columns: Columns = field(default_factory=Columns)
    """What is in which column."""
    units: Columns = field(default_factory=Columns)
    """Units of columns that do not say theirs."""
    along: str | None = None
    """Name of the instrument that reads position."""
    transverse: str | None = None
    """Name of the instrument that reads the directions across it."""
    angle: str | None = None
    """Name of the instrument that reads rotations."""
    excitation: str = "auto"
    """Of a response: hammer, random, periodic, step, sweep, or auto."""

    def __post_init__(self) -> None:
        for what, given, known in (
            ("kind", self.test, KINDS),
            ("excitation", self.excitation, EXCITATIONS),
        ):
            if given not in known:
                raise ModelError(
                    f"test '{self.name}' has the unknown {what} '{given}': choose from "
                    f"{', '.join(known)}"
                )
        if not self.records:
            raise ModelError(f"test '{self.name}' names no record: give at least one file")
        if not self.axis.strip():
            raise ModelError(f"test '{self.name}' names no axis: give the one that moves")
        self.require(ModelError, f"test '{self.name}'")


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """Everything that was measured of a stage."""

    stage: str = ""
    """Stage file or name of a built-in design; empty where there is none."""
    origin: Literal["measured", "virtual"] = "measured"
    """Whether the records are measured or simulated."""
    instruments: tuple[SensorSpecification, ...] = ()
    """The sensors."""
    tests: tuple[Test, ...]
    """The tests."""
    notes: tuple[str, ...] = ()
    """Remarks that belong to every figure."""

    def __post_init__(self) -> None:
        require_ranges(self, ModelError, "a description of tests")
        for noun, named in (("instrument", self.instruments), ("test", self.tests)):
            names = [n.name for n in named]
            twice = sorted({n for n in names if names.count(n) > 1})
            if twice:
                raise ModelError(f"two {noun} entries are called '{twice[0]}': give each its own")
        known = {i.name for i in self.instruments}
        for test in self.tests:
            for name in (test.along, test.transverse, test.angle):
                if name is not None and name not in known:
                    listed = ", ".join(sorted(known)) or "none"
                    raise ModelError(
                        f"test '{test.name}' names the instrument '{name}', which is not described "
                        f"(there are: {listed})"
                    )

    @classmethod
    def of_files(cls, files: Sequence[str], request: CharacteriseRequest) -> "Campaign":
        """Return the description of one test, which one sensor reads, from its files."""
        given = request.sensor
        sensor = SensorSpecification(
            name="sensor", calibration=given.calibration, alignment=given.alignment
        )
        shared = {f.name: getattr(request, f.name) for f in fields(TestOptions)}
        test = Test(
            **shared,
            name=request.test,
            test=request.test,
            records=tuple(files),
            columns=request.columns,
            along="sensor",
            transverse="sensor",
            angle="sensor",
        )
        return cls(instruments=(sensor,), tests=(test,))

    def instrument(self, name: str | None) -> SensorSpecification | None:
        """Return what is known of an instrument; None where none is named."""
        return next((i for i in self.instruments if i.name == name), None)


#: The kind of file that describes tests.
CAMPAIGN_FILE = Format(
    noun="description of tests",
    key="campaign",
    error=StageError,
)


def read_campaign(path: str | os.PathLike[str]) -> Campaign:
    """Read the description of tests from a YAML file whose first key is ``campaign: 1``.

    Records are still named as in the file; a mistake is named by its line.
    """
    decoder, root = read_file(Path(path), CAMPAIGN_FILE)
    _check_instruments(decoder, root)
    return decoder.build(Campaign, root, "")


def _check_instruments(decoder: Decoder, root: Mapping) -> None:
    """Refuse an instrument that is not described where a test names it."""
    listed = root.items.get("instruments")
    known = list(listed.items) if isinstance(listed, Mapping) else []
    entries = root.items.get("tests")
    if not isinstance(entries, Mapping) or not isinstance(listed, (Mapping, type(None))):
        return  # the decoder says what is wrong with that
    for name, test in entries.items.items():
        for role in ("along", "transverse", "angle"):
            node = test.items.get(role) if isinstance(test, Mapping) else None
            if isinstance(node, Scalar) and node.value is not None and node.text not in known:
                decoder.refuse(
                    node,
                    f"tests.{name}.{role}",
                    f"the instrument '{node.text[:60]}' is not described (there are: "
                    f"{', '.join(known) or 'none'}): list it under 'instruments'",
                )


def campaign_text(campaign: Campaign) -> str:
    """Write the description of tests as the text of its file.

    `read_campaign` reads it back; what is as usual is left out.
    """
    return Encoder(CAMPAIGN_FILE).text(campaign)
