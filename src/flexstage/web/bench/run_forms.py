"""Forms of the runs at the bench: a waveform, a record, a plan."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from flexstage.base.errors import FlexstageError, ModelError
from flexstage.experiments import dry_run, find_plan, read_plan
from flexstage.experiments.command import CommandWaveform
from flexstage.experiments.plan import ready_plans
from flexstage.experiments.verb import base_rate_of
from flexstage.instruments.protocol import Capability, Instrument
from flexstage.quantities.quantity import Quantity, number
from flexstage.report.run import dry_run_table
from flexstage.stage import Stage
from flexstage.web.bench.link import BenchLink
from flexstage.web.bench.readouts import shown_number
from flexstage.web.bench.runs import (
    RunDescription,
    RunOutcome,
    WaveformRequest,
    build_waveform,
    run_command,
    run_plan_file,
    take_record,
    waveform_from,
)
from flexstage.web.bench.state import BenchForms, bind_field
from flexstage.web.figures import show_table
from flexstage.web.live_history import POSITION, VOLTAGE
from flexstage.web.page import Page, choice, div, remark
from flexstage.web.uploads import upload

_SHAPES = {
    "cosine": "sine", "triangle": "triangle", "steps": "moves with rests", "file": "from a file",
}  # fmt: skip
_RECORDS = (".csv", ".txt", ".npz", ".h5", ".mat", ".tdms")
_FIELD = "dense outlined"


class RunForm(ABC):
    """Base class of the forms of runs.

    Parameters
    ----------
    page
        The page.
    bench
        The bench.
    show
        Called with the result of an earlier run, to show it.
    """

    def __init__(self, page: Page, bench: BenchLink, show: Callable[[RunOutcome], object]) -> None:
        self._page, self._bench, self._show = page, bench, show
        self._forms = page.session.state(BenchForms)
        self._start: ui.button | None = None

    @abstractmethod
    def build(self) -> None:
        """Build the form."""

    def look(self) -> None:
        """Update the form: only the browser in control can start a run."""
        drives = self._bench.control.holds(self._page.session.id)
        if self._start is not None and self._start.enabled != drives:
            self._start.set_enabled(drives)

    @property
    def _device(self) -> Instrument:
        return self._bench.linked()

    @property
    def _stage(self) -> Stage:
        self._bench.linked()
        assert self._bench.stage is not None
        return self._bench.stage

    def _about(self) -> RunDescription:
        forms = self._forms
        return RunDescription(
            parent=self._page.panel.folder("bench"),
            stage=self._stage,
            name=forms.name.strip(),
            operator=forms.operator.strip(),
            note=forms.note.strip(),
        )

    def _name_fields(self) -> None:
        """Show the fields for the name and the note of the run."""
        bind_field(ui.input("Name of the run"), self._forms, "name").props(_FIELD)
        bind_field(ui.input("Note"), self._forms, "note").props(_FIELD)

    def _run(self, name: str, function: Callable[..., Any], *arguments: Any, moves: bool) -> None:
        self._bench.run(self._page.session.id, name, function, *arguments, moves=moves)


class WaveformForm(RunForm):
    """A waveform of one axis, checked after each change."""

    def build(self) -> None:
        """Build the fields."""
        forms = self._forms
        axes = list(self._device.axes)
        if forms.axis not in axes:
            forms.axis = axes[0]
        with div("fields"):
            bind_field(choice(axes, None, "Axis"), forms, "axis", self._rebuild)
            bind_field(choice(_SHAPES, None, "Shape"), forms, "shape", self._rebuild)
            self._ends = div("fields inner")
            self._name_fields()
        self._status = ui.label().classes("small").props('role="status"')
        self._start = ui.button("Run the waveform", icon="play_arrow", on_click=self._go)
        self._closed_loop: bool | None = None
        self.look()

    def look(self) -> None:
        super().look()
        # position control may have been switched
        reading = self._bench.readings.get(self._forms.axis)
        if reading is not None and reading.closed_loop != self._closed_loop:
            self._closed_loop = reading.closed_loop
            self._rebuild()

    @property
    def _quantity(self) -> Quantity:
        return self._page.preferences.displayed(POSITION if self._closed_loop else VOLTAGE)

    def _span(self) -> tuple[float, float]:
        """Return the ends of the waveform: the entered ones, or 80 % of the limits."""
        limits = self._device.axes[self._forms.axis].limits
        low, high = (limits.position if self._closed_loop else limits.voltage) or (0.0, 1e-5)
        default = (low + 0.1 * (high - low), low + 0.9 * (high - low))
        return self._forms.ends.get(self._key, default)

    @property
    def _key(self) -> str:
        return f"{self._forms.axis} {self._quantity.unit}"

    def _rebuild(self) -> None:
        forms, quantity = self._forms, self._quantity
        self._ends.clear()
        with self._ends:
            if forms.shape == "file":
                upload(
                    self._page, "File of the waveform", _RECORDS, self._use_file, view="bench"
                ).classes("slim")
            else:
                for k, label in enumerate(("Low end", "High end")):
                    value = shown_number(quantity, self._span()[k]).replace("−", "-")
                    field = ui.number(f"{label} [{quantity.shown_unit}]", value=float(value))
                    field.props(_FIELD)
                    field.on_value_change(lambda e, k=k: self._end(k, e.value))
                bind_field(ui.number("Frequency [Hz]"), forms, "rate_hz", self._check).props(_FIELD)
            bind_field(ui.number("Cycles", min=1, precision=0), forms, "cycles", self._check).props(
                _FIELD
            )
            bind_field(ui.number("Sample rate [Hz]"), forms, "sample_rate_hz", self._check).props(
                _FIELD
            )
        self._check()

    def _end(self, which: int, value: float | None) -> None:
        if value is not None:
            ends = list(self._span())
            ends[which] = float(value) / self._quantity.factor
            self._forms.ends[self._key] = (ends[0], ends[1])
        self._check()

    def _use_file(self, path: Path) -> None:
        self._forms.file = str(path)
        self._check()

    def _command(self) -> CommandWaveform:
        forms = self._forms
        cycles = int(forms.cycles or 0)
        if forms.shape == "file":
            if not forms.file:
                raise ModelError("select a file with the waveform: CSV, HDF5, MATLAB or TDMS")
            return waveform_from(self._device, Path(forms.file), forms.axis, cycles)
        low, high = self._span()
        request = WaveformRequest(
            axis=forms.axis,
            shape=forms.shape if forms.shape in ("triangle", "steps") else "cosine",
            low=low,
            high=high,
            rate_hz=float(forms.rate_hz or 0.0),
            cycles=cycles,
        )
        return build_waveform(self._device, self._stage, request)

    def _check(self) -> None:
        """Show duration, range and rate of the waveform, or the error."""
        try:
            command = self._command()
        except (FlexstageError, OSError) as error:
            self._status.text = str(error)
            self._status.classes(add="issue error")
            return
        quantity = self._quantity
        (values,) = command.values.values()
        rate = command.waveform.largest_rate(self._forms.axis, closed=command.cycles > 1)
        self._status.classes(remove="issue error")
        file = f"{Path(self._forms.file).name}: " if self._forms.shape == "file" else ""
        self._status.text = (
            f"{file}{command.duration:.4g} s, {shown_number(quantity, float(values.min()))} to "
            f"{shown_number(quantity, float(values.max()))} {quantity.shown_unit}, at most "
            f"{number(rate * quantity.factor)} {quantity.shown_unit}/s: within the limits"
        )

    def _go(self) -> None:
        with self._page.show_errors():
            command = self._command()
            rate = float(self._forms.sample_rate_hz or 0.0)
            name = f"waveform of {self._forms.axis}"
            self._run(name, run_command, self._about(), command, rate, moves=True)


class RecordForm(RunForm):
    """A record of position and voltage of the stage."""

    def build(self) -> None:
        """Build the fields."""
        forms = self._forms
        with div("fields"):
            bind_field(ui.number("Duration [s]"), forms, "duration").props(_FIELD)
            bind_field(ui.number("Sample rate [Hz]"), forms, "sample_rate_hz").props(_FIELD)
            self._name_fields()
        remark(
            "Position and voltage of every axis, at the rate of the controller. You can move the "
            "stage during the record; a stop keeps the data so far."
        )
        self._start = ui.button("Record", icon="fiber_manual_record", on_click=self._go)

    def _go(self) -> None:
        with self._page.show_errors():
            if Capability.DATA_RECORDER not in self._device.capabilities:
                raise ModelError("this instrument has no data recorder")
            forms = self._forms
            rate, duration = float(forms.sample_rate_hz or 0.0), float(forms.duration or 0.0)
            self._run("record", take_record, self._about(), duration, rate, moves=False)


class PlanForm(RunForm):
    """A plan, with a dry run before anything moves."""

    def build(self) -> None:
        """Build the fields."""
        forms = self._forms
        plans_available = {name: f"{name} (built-in)" for name in ready_plans()}
        if not forms.plan:
            forms.plan = (
                self._stage.name
                if self._stage.name in plans_available
                else next(iter(plans_available))
            )
        if forms.plan not in plans_available:
            plans_available[forms.plan] = Path(forms.plan).name
        with div("fields"):
            plans = bind_field(
                choice(plans_available, None, "Plan"), forms, "plan", self._choose_plan
            ).classes("wide")
            self._only = choice([], None, "Only these steps", self._choose_steps, multiple=True)
            self._only.props("use-chips").classes("wide")

            def use_file(path: Path) -> None:
                read_plan(path)
                plans.set_options(plans_available | {str(path): path.name}, value=str(path))

            upload(self._page, "Plan file", (".yaml", ".yml"), use_file, view="bench").classes(
                "slim"
            )
            self._name_fields()
        self._status = ui.label().classes("small").props('role="status"')
        self._start = ui.button("Run the plan", icon="play_arrow", on_click=self._go)
        self._preview_area = div("full-width")
        self._steps()
        ui.timer(0.0, self._try, once=True)

    def _steps(self) -> None:
        with self._page.show_errors():
            names = [step.name for step in read_plan(find_plan(self._forms.plan)).steps]
            selected = [name for name in self._forms.only if name in names]
            self._only.set_options(names, value=selected)

    async def _choose_plan(self) -> None:
        self._forms.only = ()
        self._steps()
        await self._try()

    async def _choose_steps(self, event: Any) -> None:
        self._forms.only = tuple(event.value or ())
        await self._try()

    async def _try(self) -> None:
        """Show a dry run of the plan, as `flexstage run --dry-run` does."""
        forms, stage, device = self._forms, self._stage, self._device
        self._status.text = "checking the plan …"
        try:
            plan = read_plan(find_plan(forms.plan))
            preview = await asyncio.to_thread(
                dry_run, plan, stage, only=forms.only or None, base_rate_hz=base_rate_of(device)
            )
        except FlexstageError as error:
            self._status.text = str(error)
            self._status.classes(add="issue error")
            return
        problem = preview.problems[0] if preview.problems else ""
        self._status.classes(**{"add" if problem else "remove": "issue error"})
        self._status.text = problem or (
            f"{len(preview.steps)} steps, {preview.duration:.0f} s of motion and records: "
            "within the limits of the description"
        )
        self._preview_area.clear()
        with self._preview_area, ui.expansion("Dry run").classes("full-width"):
            show_table(dry_run_table(preview, plan.title or Path(forms.plan).stem))

    def _go(self) -> None:
        with self._page.show_errors():
            forms = self._forms
            arguments = (self._about(), forms.plan, None, forms.only or None, self._bench.lock_name)
            self._run(f"plan {Path(forms.plan).stem}", run_plan_file, *arguments, moves=True)
