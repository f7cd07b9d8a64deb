"""A campaign: kinds of tests, the description of a set of tests, and its file."""

import os
from collections.abc import Callable, Sequence
from collections.abc import Mapping as MappingType
from dataclasses import dataclass, field, fields
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from flexstage.base.errors import ModelError, StageError
from flexstage.experiments.requests import (
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
from flexstage.stage.bought_parts import bought_sensors

_MOTIONS = ("along", "across", "vertical", "roll", "pitch", "yaw")
_COMMANDED = {"command": "command"}


@dataclass(frozen=True, slots=True, kw_only=True)
class KindOfTest:
    """A kind of test."""

    what: str
    """Description."""
    evaluated_by: str
    """The function that evaluates it, with its module in this folder."""
    over: tuple[str, ...] = ("time",)
    """Allowed independent variables of its records: time, point, or frequency."""
    sensors: tuple[str, ...] | None = None
    """Roles of sensors in a plan's record; None where a plan cannot record it."""
    needed: tuple[str, ...] = ()
    """Roles that are required."""
    further_columns: MappingType[str, str] = field(default_factory=dict)
    """Further columns of a plan's record, by their role."""

    @property
    def points(self) -> bool:
        """Whether its rows are points where the file has no time."""
        return "point" in self.over

    @property
    def evaluate(self) -> Callable[..., Any]:
        """The function that returns a `TestResult`, given test, records and campaign."""
        module, _, name = self.evaluated_by.partition(".")
        return getattr(import_module(f"flexstage.experiments.campaign.{module}"), name)


#: Kinds of tests by name; a new kind is one entry here, and the function that evaluates it.
KINDS: dict[str, KindOfTest] = {
    "motion": KindOfTest(
        what="cycles over the stroke: stroke, hysteresis, straightness, rotations, coupling",
        evaluated_by="motion.evaluate_motion",
        sensors=_MOTIONS,
        needed=("along",),
        further_columns=_COMMANDED,
    ),
    "spheres": KindOfTest(
        what="the same, from spheres on a plate that a measuring machine probes at stations",
        evaluated_by="motion.evaluate_spheres",
        over=("time", "point"),
    ),
    "positioning": KindOfTest(
        what="targets approached from both sides: accuracy and repeatability as in ISO 230-2",
        evaluated_by="positioning.evaluate_positioning",
        over=("time", "point"),
        sensors=("along",),
        needed=("along",),
        further_columns=_COMMANDED,
    ),
    "axis-of-rotation": KindOfTest(
        what="indicators over turns of an axis: eccentricity and error motions as in ISO 230-7",
        evaluated_by="motion.evaluate_axis",
        over=("time", "point"),
    ),
    "staircase": KindOfTest(
        what="small steps: resolution",
        evaluated_by="positioning.evaluate_staircase",
        sensors=("along",),
        needed=("along",),
        further_columns=_COMMANDED,
    ),
    "hold": KindOfTest(
        what="a position that is held: noise and drift",
        evaluated_by="positioning.evaluate_hold",
        sensors=("along",),
        needed=("along",),
    ),
    "response": KindOfTest(
        what="hammer, sweep or noise: natural frequencies and damping",
        evaluated_by="motion.evaluate_response",
        over=("time", "frequency"),
        sensors=(),
    ),
    "ring-down": KindOfTest(
        what="free decay: natural frequencies and damping",
        evaluated_by="motion.evaluate_ring_down",
    ),
    "workspace": KindOfTest(
        what="repeated visits of the corners: area, squareness",
        evaluated_by="motion.evaluate_workspace",
        over=("time", "point"),
        sensors=("x", "y"),
        needed=("x", "y"),
        further_columns={"corner": "corner"},
    ),
}


#: Excitations of a response; auto detects it from the input.
EXCITATIONS: tuple[str, ...] = ("auto", "random", "periodic", "hammer", "step", "sweep")


@dataclass(frozen=True, slots=True, kw_only=True)
class Test(Evaluation, TestOptions):
    """One test, with the columns of its records."""

    name: str
    """Its name."""
    test: str
    """Kind of test, one of `KINDS`."""
    records: tuple[str, ...]
    """Its files, relative to the folder of the campaign file."""
    columns: Columns = field(default_factory=Columns)
    """Columns by role."""
    units: Columns = field(default_factory=Columns)
    """Units of columns without a unit of their own."""
    along: str | None = None
    """Name of the instrument that reads position."""
    transverse: str | None = None
    """Name of the instrument that reads the transverse directions."""
    angle: str | None = None
    """Name of the instrument that reads rotations."""
    excitation: str = "auto"
    """Of a response: hammer, random, periodic, step, sweep, or auto."""

    def __post_init__(self) -> None:
        for what, value, known in (
            ("kind", self.test, KINDS),
            ("excitation", self.excitation, EXCITATIONS),
        ):
            if value not in known:
                raise ModelError(
                    f"test '{self.name}' has the unknown {what} '{value}': choose from "
                    f"{', '.join(known)}"
                )
        if not self.records:
            raise ModelError(f"test '{self.name}' names no record: give at least one file")
        if not self.axis.strip():
            raise ModelError(f"test '{self.name}' names no axis: give the axis that moves")
        self.require(ModelError, f"test '{self.name}'")


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """Tests of a stage."""

    stage: str = ""
    """Stage file or name of a built-in design; empty where there is none."""
    origin: Literal["measured", "virtual"] = "measured"
    """Origin of the records: measured, or virtual for simulated ones."""
    instruments: tuple[SensorSpecification, ...] = ()
    """The sensors."""
    tests: tuple[Test, ...]
    """The tests."""
    notes: tuple[str, ...] = ()
    """Remarks on all figures."""
    origins: dict[str, str] = field(default_factory=dict)
    """Origin of each figure of a simulated stage, by quantity and axis, as in ``straightness x``:
    published, model, scatter or assumed.
    """

    def __post_init__(self) -> None:
        require_ranges(self, ModelError, "a description of tests")
        for noun, entries in (("instrument", self.instruments), ("test", self.tests)):
            names = [n.name for n in entries]
            twice = sorted({n for n in names if names.count(n) > 1})
            if twice:
                raise ModelError(f"two {noun} entries are called '{twice[0]}': use different names")
        known = {i.name for i in self.instruments}
        for test in self.tests:
            for name in (test.along, test.transverse, test.angle):
                if name is not None and name not in known:
                    listed = ", ".join(sorted(known)) or "none"
                    raise ModelError(
                        f"test '{test.name}' names the instrument '{name}', which is not described "
                        f"(described: {listed})"
                    )

    @classmethod
    def of_files(cls, files: Sequence[str], request: CharacteriseRequest) -> "Campaign":
        """Return the description of one test with one sensor, from its files."""
        uncertainty = request.sensor
        sensor = SensorSpecification(
            name="sensor", calibration=uncertainty.calibration, alignment=uncertainty.alignment
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
        """Return the specification of an instrument; None where it is not described."""
        return next((i for i in self.instruments if i.name == name), None)


#: Format of a campaign file.
CAMPAIGN_FILE = Format(
    noun="description of tests",
    key="campaign",
    error=StageError,
    bought={SensorSpecification: bought_sensors},
)


def read_campaign(path: str | os.PathLike[str]) -> Campaign:
    """Read the description of tests from a YAML file whose first key is ``campaign: 1``.

    Names of records are those in the file. Messages about mistakes name the line.
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
        return  # the decoder reports this mistake
    for name, test in entries.items.items():
        for role in ("along", "transverse", "angle"):
            node = test.items.get(role) if isinstance(test, Mapping) else None
            if isinstance(node, Scalar) and node.value is not None and node.text not in known:
                decoder.refuse(
                    node,
                    f"tests.{name}.{role}",
                    f"the instrument '{node.text[:60]}' is not described (described: "
                    f"{', '.join(known) or 'none'}): list it under 'instruments'",
                )


def campaign_text(campaign: Campaign) -> str:
    """Write the description of tests as the text of its file.

    `read_campaign` reads it back; default values are omitted.
    """
    return Encoder(CAMPAIGN_FILE).text(campaign)
