"""The verb *identify*: the model of a drive is found in records."""

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import PlanError
from flexstage.base.provenance import file_hash, provenance
from flexstage.experiments.verb import ResultLookup, RunContext, StepResult, Verb
from flexstage.experiments.verbs.characterise import CharacterisedStep
from flexstage.experiments.verbs.measure import MeasuredStep
from flexstage.files.plain import picked
from flexstage.files.request import require_fields
from flexstage.files.write import write_whole
from flexstage.hysteresis.requests import IdentifyRequest
from flexstage.quantities.characteristic import measured_value
from flexstage.quantities.quantity import number
from flexstage.quantities.section import Bullets, Picture, Pictures, Section
from flexstage.quantities.table import Column, table

if TYPE_CHECKING:
    from flexstage.hysteresis import DriveModel
    from flexstage.instruments.catalogue.entries import ModelEntry, StageEntry

#: Share of a record, from its start, that the largest deviation leaves out: it remembers what was
#: before the record.
SETTLED = 0.1
_UM = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Identify(Verb, IdentifyRequest):
    """Finds the model of a drive in records."""

    verb: ClassVar[str] = "identify"
    uses: ClassVar[tuple[str, ...]] = ("measure", "characterise")

    of: tuple[str, ...]
    """Steps that measured the same axis."""
    output: str
    """The sensor that follows the drive."""
    model: tuple[str, ...] = ("preisach",)
    """Models of hysteresis that are tried; the simplest that is as good as the best is taken."""
    characterised_by: str | None = None
    """The step of characterise that found natural frequency and damping of the axis with its drive
    in place; looked for in the records where neither it nor the resonance is given.
    """

    def __post_init__(self) -> None:
        from flexstage.hysteresis.identification.model_fit import selected_models

        if not self.of:
            raise PlanError("identify needs a step that measures at least")
        selected_models(self.model)
        require_fields(self, IdentifyRequest, PlanError, " of identify")
        if self.known.resonance is not None and self.characterised_by is not None:
            raise PlanError(
                "identify has a known resonance, and 'characterised_by' names a step that found "
                "one: give one of them"
            )

    @property
    def needs(self) -> tuple[str, ...]:
        return self.of if self.characterised_by is None else (*self.of, self.characterised_by)

    def reads(self, before: Mapping[str, Verb]) -> tuple[str, ...]:
        del before
        return (self.output,)

    def refused(self, name: str, other: str, used: Verb) -> str:
        if said := Verb.refused(self, name, other, used):
            return said
        if (used.verb == "characterise") != (other == self.characterised_by):
            return (
                f"step '{name}' of identify takes records from steps of measure and its resonance "
                f"from one of characterise ('characterised_by'), got '{other}' of {used.verb}"
            )
        return ""

    def missing(self, name: str, before: Mapping[str, Verb]) -> str:
        for other in self.of:
            if self.output not in before[other].reads(before):
                return (
                    f"step '{name}' identifies by the sensor '{self.output}', which step "
                    f"'{other}' does not record: add it there under 'also'"
                )
        return ""

    def run(self, context: RunContext, name: str) -> list[Path]:
        from flexstage.hysteresis import ModelFile, identify, model_text

        steps = [context.result_of(step, MeasuredStep) for step in self.of]
        found = identify(
            [step.evaluated for step in steps],
            "command",
            self.output,
            self._request(context),
        )
        errors = {"rms": found.rms_percent, "max": found.max_percent}
        if found.heldout_rms_percent is not None:
            errors["held-out rms"] = found.heldout_rms_percent
        if found.heldout_max_percent is not None:
            errors["held-out max"] = found.heldout_max_percent
        made = provenance(found.model, {"plan": context.run.plan, "step": name})
        file = ModelFile(
            model=found.model,
            errors=errors,
            warnings=found.warnings,
            provenance={
                "version": made.version,
                "created": made.created,
                "stage": context.stage.name,
                "serial_number": context.run.serial_number,
                "axis": self.axis_of(context.plan),
                "records": [step.file.name for step in steps],
                "plan": context.run.plan,
                "step": name,
                "simulated": context.instrument.identity.simulated,
            },
        )
        target = context.folder / "models" / f"{name}.yaml"
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, model_text(file))
        return [target]

    def _request(self, context: RunContext) -> IdentifyRequest:
        """Return what is asked for, with the mode that was measured in place."""
        asked = {f.name: getattr(self, f.name) for f in fields(IdentifyRequest)}
        if self.characterised_by is not None:
            found = context.result_of(self.characterised_by, CharacterisedStep).found
            axis = self.axis_of(context.plan)
            asked["known"] = replace(
                self.known,
                resonance=found.figure("natural_frequency_hz", axis).value,
                damping=found.figure("damping_ratio", axis).value,
            )
        return IdentifyRequest(**asked)

    def result(
        self, context: RunContext, name: str, files: list[Path], *, now: bool
    ) -> "IdentifiedStep":
        from flexstage.hysteresis import read_model_file

        del now
        read = read_model_file(files[0])
        record = context.result_of(self.of[-1], MeasuredStep).evaluated
        voltage = record.channel("command").values
        measured = record.channel(self.output).values
        dt = 1.0 / record.sample_rate_hz
        # what was before the record is taken to be cycles over the whole range
        modelled = read.model.simulate(voltage, dt, read.model.conditioned())
        late = slice(int(SETTLED * voltage.size), None)
        modelled = modelled + float(np.mean(measured[late] - modelled[late]))
        return IdentifiedStep(
            name=name,
            axis=self.axis_of(context.plan),
            model=read.model,
            kind=read.model.hysteresis.kind,
            file=files[0],
            errors_percent={k: v for k, v in read.errors.items() if v is not None},
            time=record.time,
            voltage=voltage,
            measured=measured,
            modelled=modelled,
            deviation=float(np.max(np.abs(measured[late] - modelled[late]))),
            warnings=read.warnings,
        )

    @staticmethod
    def section(steps: "Sequence[IdentifiedStep]", result: ResultLookup) -> Section:
        heads = (
            Column("Step", "title"), "Axis", "<Model", "<Errors [% of the stroke]",
            "Largest deviation [µm]", "published [µm]",
        )  # fmt: skip
        rows = []
        for step in steps:
            # the study's own model is a Bouc-Wen model: no other is set beside what it printed
            known = measured_value(result.stage.published, "hysteresis_deviation", step.axis)
            beside = f"{_UM * known:.10g}" if known is not None and step.kind == "bouc-wen" else ""
            errors = "; ".join(f"{name} {value:.3g}" for name, value in step.errors_percent.items())
            deviation = number(_UM * step.deviation)
            rows.append((step.name, step.axis, step.kind, errors, deviation, beside))
        pictures = (
            Picture(
                result=step,
                title=f"{step.name}: record and model",
                caption=f"Step {step.name}: record and identified model.",
            )
            for step in steps
        )
        warned = dict.fromkeys(f"{step.name}: {text}" for step in steps for text in step.warnings)
        content = (
            table("", heads, rows),
            Pictures(pictures=tuple(pictures)),
            Bullets(tuple(warned)),
        )
        return Section(title="Identified drives", key="models", content=content)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedStep(StepResult):
    """A model that was identified."""

    axis: str
    """The axis."""
    model: "DriveModel"
    """The model."""
    kind: str
    """Name of the hysteresis model."""
    file: Path
    """Its file."""
    errors_percent: Mapping[str, float]
    """Errors of the fit by what they are, over the stroke [%]."""
    time: Array
    """Times of the record that it was identified from, the last of them where there were several
    [s], shape (n,).
    """
    voltage: Array
    """Command there [V], shape (n,)."""
    measured: Array
    """Reading there [m], shape (n,)."""
    modelled: Array
    """What the model says there [m], its mean set to that of the reading, shape (n,)."""
    deviation: float
    """Largest difference of reading and model, after the first tenth of the record [m]."""
    warnings: tuple[str, ...] = ()
    """What the records cannot tell."""

    @property
    def settled(self) -> float:
        """Time at which the record has forgotten what was before it [s]."""
        return float(self.time[int(SETTLED * self.time.size)])

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        return {
            **picked(self, "axis", "model=kind"),
            "file": result.relative(self.file),
            **picked(self, "errors_percent", "deviation", "warnings"),
        }

    @property
    def line(self) -> str:
        rms = self.errors_percent.get("rms", float("nan"))
        return f"{self.name}: {self.kind}, {rms:.3g} % of the stroke rms"

    def model_entry(
        self, context: RunContext, stage: "StageEntry", runs: Mapping[str, str]
    ) -> "ModelEntry":
        from flexstage.instruments.catalogue.entries import ModelEntry

        action = cast("Identify", context.plan.action_of(self.name))
        # the last record that it was identified from
        record = context.result_of(action.of[-1], MeasuredStep).file
        made = datetime.datetime.fromtimestamp(self.file.stat().st_mtime, datetime.UTC)
        return ModelEntry(
            kind=self.kind,
            file=str(self.file.resolve()),
            axis=self.axis,
            figures={f"{k} [%]": v for k, v in self.errors_percent.items()},
            stage=stage,
            created=made,
            run=runs.get(record.relative_to(context.folder).as_posix(), ""),
            sha256=file_hash(self.file),
        )
