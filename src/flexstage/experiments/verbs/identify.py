"""Verb *identify*: the identification of a drive from records."""

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
from flexstage.quantities.table import Bullets, Column, Picture, Pictures, Section, table

if TYPE_CHECKING:
    from flexstage.hysteresis import DriveModel
    from flexstage.instruments.catalogue.entries import ModelEntry, StageEntry

#: Fraction of a record, from its start, that the largest deviation ignores: there the state of the
#: drive depends on the motion before the record.
SETTLED = 0.1
_UM = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Identify(Verb, IdentifyRequest):
    """Identify the model of a drive from records."""

    verb: ClassVar[str] = "identify"
    uses: ClassVar[tuple[str, ...]] = ("measure", "characterise")

    of: tuple[str, ...]
    """Steps of measure of the same axis."""
    output: str
    """The sensor of the output of the drive."""
    model: tuple[str, ...] = ("preisach",)
    """Candidate models of hysteresis; the simplest that is equivalent to the best is selected."""
    characterised_by: str | None = None
    """The step of characterise with natural frequency and damping of the axis with its drive in
    place. Without it and without a known resonance, these are identified from the records.
    """

    def __post_init__(self) -> None:
        from flexstage.hysteresis.identification.model_fit import selected_models

        if not self.of:
            raise PlanError("identify needs at least one step of measure, got none")
        selected_models(self.model)
        require_fields(self, IdentifyRequest, PlanError, " of identify")
        if self.known.resonance is not None and self.characterised_by is not None:
            raise PlanError(
                "identify has a known resonance, and 'characterised_by' names a step that measures "
                "one: give one of them"
            )

    @property
    def needs(self) -> tuple[str, ...]:
        return self.of if self.characterised_by is None else (*self.of, self.characterised_by)

    def reads(self, before: Mapping[str, Verb]) -> tuple[str, ...]:
        del before
        return (self.output,)

    def refused(self, name: str, other: str, used: Verb) -> str:
        if message := Verb.refused(self, name, other, used):
            return message
        if (used.verb == "characterise") != (other == self.characterised_by):
            return (
                f"step '{name}' of identify needs records from steps of measure, and its resonance "
                f"from a step of characterise ('characterised_by'), got '{other}' of {used.verb}"
            )
        return ""

    def missing(self, name: str, before: Mapping[str, Verb]) -> str:
        for other in self.of:
            if self.output not in before[other].reads(before):
                return (
                    f"step '{name}' identifies the output of sensor '{self.output}', which step "
                    f"'{other}' does not record: add it there under 'also'"
                )
        return ""

    def run(self, context: RunContext, name: str) -> list[Path]:
        from flexstage.hysteresis import ModelFile, identify, model_text

        steps = [context.result_of(step, MeasuredStep) for step in self.of]
        identified = identify(
            [step.evaluated for step in steps],
            "command",
            self.output,
            self._request(context),
        )
        errors = {"rms": identified.rms_percent, "max": identified.max_percent}
        if identified.heldout_rms_percent is not None:
            errors["held-out rms"] = identified.heldout_rms_percent
        if identified.heldout_max_percent is not None:
            errors["held-out max"] = identified.heldout_max_percent
        origin = provenance(identified.model, {"plan": context.run.plan, "step": name})
        file = ModelFile(
            model=identified.model,
            errors=errors,
            warnings=identified.warnings,
            provenance={
                "version": origin.version,
                "created": origin.created,
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
        """Return the request, with the mode that was measured with the drives in place."""
        options = {f.name: getattr(self, f.name) for f in fields(IdentifyRequest)}
        if self.characterised_by is not None:
            modes = context.result_of(self.characterised_by, CharacterisedStep).evaluation
            axis = self.axis_of(context.plan)
            options["known"] = replace(
                self.known,
                resonance=modes.figure("natural_frequency_hz", axis).value,
                damping=modes.figure("damping_ratio", axis).value,
            )
        return IdentifyRequest(**options)

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
        # assumption: cycles over the full range precede the record
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
            "Largest deviation [µm]", "Published [µm]",
        )  # fmt: skip
        rows = []
        for step in steps:
            # the published model is a Bouc-Wen model: others are not compared with it
            published = measured_value(result.stage.published, "hysteresis_deviation", step.axis)
            reference = (
                f"{_UM * published:.10g}"
                if published is not None and step.kind == "bouc-wen"
                else ""
            )
            errors = "; ".join(f"{name} {value:.3g}" for name, value in step.errors_percent.items())
            deviation = number(_UM * step.deviation)
            rows.append((step.name, step.axis, step.kind, errors, deviation, reference))
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
    """Result of a step of identify."""

    axis: str
    """The axis."""
    model: "DriveModel"
    """The model."""
    kind: str
    """Name of the hysteresis model."""
    file: Path
    """Its file."""
    errors_percent: Mapping[str, float]
    """Errors of the fit by name, over the stroke [%]."""
    time: Array
    """Times of the last identified record [s], shape (n,)."""
    voltage: Array
    """Command of that record [V], shape (n,)."""
    measured: Array
    """Reading of that record [m], shape (n,)."""
    modelled: Array
    """Output of the model for that record [m], with the mean of the reading, shape (n,)."""
    deviation: float
    """Largest difference of reading and model, after the first tenth of the record [m]."""
    warnings: tuple[str, ...] = ()
    """Warnings of the identification."""

    @property
    def settled(self) -> float:
        """Time after which the record does not depend on the motion before it [s]."""
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

        step = cast("Identify", context.plan.action_of(self.name))
        # the last record that it was identified from
        record = context.result_of(step.of[-1], MeasuredStep).file
        created = datetime.datetime.fromtimestamp(self.file.stat().st_mtime, datetime.UTC)
        return ModelEntry(
            kind=self.kind,
            file=str(self.file.resolve()),
            axis=self.axis,
            figures={f"{k} [%]": v for k, v in self.errors_percent.items()},
            stage=stage,
            created=created,
            run=runs.get(record.relative_to(context.folder).as_posix(), ""),
            sha256=file_hash(self.file),
        )
