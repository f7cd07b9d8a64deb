"""What is filled in for a run at the bench: a waveform, a record, a plan."""

import asyncio
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
from flexstage.web.bench.state import BenchForms, kept
from flexstage.web.figures import show_table
from flexstage.web.live_history import POSITION, VOLTAGE
from flexstage.web.page import Page, choice, div, remark
from flexstage.web.uploads import upload

_SHAPES = {"cosine": "sine", "triangle": "triangle", "file": "from a file"}
_RECORDS = (".csv", ".txt", ".npz", ".h5", ".mat", ".tdms")
_FIELD = "dense outlined"


class RunForm:
    """What all runs have: where they begin, and what is refused.

    Parameters
    ----------
    page
        The page.
    bench
        The bench.
    show
        Called with what an earlier run gave, to show it.
    """

    def __init__(self, page: Page, bench: BenchLink, show: Callable[[RunOutcome], object]) -> None:
        self._page, self._bench, self._show = page, bench, show
        self._forms = page.session.state(BenchForms)
        self._start: ui.button | None = None

    def look(self) -> None:
        """Follow the bench: runs are begun by who drives."""
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

    def _words(self) -> None:
        """Ask for what a person says of the run."""
        kept(ui.input("Name of the run"), self._forms, "name").props(_FIELD)
        kept(ui.input("Note"), self._forms, "note").props(_FIELD)

    def _run(self, name: str, function: Callable[..., Any], *given: Any, moves: bool) -> None:
        self._bench.run(self._page.session.id, name, function, *given, moves=moves)


class WaveformForm(RunForm):
    """A waveform of one axis, checked while it is filled in."""

    def build(self) -> None:
        """Make the fields."""
        forms = self._forms
        axes = list(self._device.axes)
        if forms.axis not in axes:
            forms.axis = axes[0]
        with div("fields"):
            kept(choice(axes, None, "Axis"), forms, "axis", self._anew)
            kept(choice(_SHAPES, None, "Shape"), forms, "shape", self._anew)
            self._ends = div("fields inner")
            self._words()
        self._said = ui.label().classes("small").props('role="status"')
        self._start = ui.button("Run the waveform", icon="play_arrow", on_click=self._go)
        self._closed: bool | None = None
        self.look()

    def look(self) -> None:
        super().look()
        # the position control of the axis may have been switched
        closed = self._bench.readings.get(self._forms.axis)
        if closed is not None and closed.closed_loop != self._closed:
            self._closed = closed.closed_loop
            self._anew()

    @property
    def _quantity(self) -> Quantity:
        return self._page.preferences.shown(POSITION if self._closed else VOLTAGE)

    def _span(self) -> tuple[float, float]:
        """Return the ends of the waveform: those filled in, or the middle of what is allowed."""
        limits = self._device.axes[self._forms.axis].limits
        low, high = (limits.position if self._closed else limits.voltage) or (0.0, 1e-5)
        usual = (low + 0.1 * (high - low), low + 0.9 * (high - low))
        return self._forms.ends.get(self._key, usual)

    @property
    def _key(self) -> str:
        return f"{self._forms.axis} {self._quantity.unit}"

    def _anew(self) -> None:
        forms, quantity = self._forms, self._quantity
        self._ends.clear()
        with self._ends:
            if forms.shape == "file":
                upload(
                    self._page, "File of the waveform", _RECORDS, self._given, view="bench"
                ).classes("slim")
            else:
                for k, word in enumerate(("Low end", "High end")):
                    value = shown_number(quantity, self._span()[k]).replace("−", "-")
                    field = ui.number(f"{word}, {quantity.shown_unit}", value=float(value))
                    field.props(_FIELD)
                    field.on_value_change(lambda e, k=k: self._end(k, e.value))
                kept(ui.number("Frequency, Hz"), forms, "rate_hz", self._check).props(_FIELD)
            kept(ui.number("Cycles", min=1, precision=0), forms, "cycles", self._check).props(
                _FIELD
            )
            kept(ui.number("Record at, Hz"), forms, "sample_rate_hz", self._check).props(_FIELD)
        self._check()

    def _end(self, which: int, value: float | None) -> None:
        if value is not None:
            ends = list(self._span())
            ends[which] = float(value) / self._quantity.factor
            self._forms.ends[self._key] = (ends[0], ends[1])
        self._check()

    def _given(self, path: Path) -> None:
        self._forms.file = str(path)
        self._check()

    def _made(self) -> CommandWaveform:
        forms = self._forms
        cycles = int(forms.cycles or 0)
        if forms.shape == "file":
            if not forms.file:
                raise ModelError("give a record that holds the waveform: CSV, HDF5, MATLAB, TDMS")
            return waveform_from(self._device, Path(forms.file), forms.axis, cycles)
        low, high = self._span()
        order = WaveformRequest(
            axis=forms.axis,
            shape="triangle" if forms.shape == "triangle" else "cosine",
            low=low,
            high=high,
            rate_hz=float(forms.rate_hz or 0.0),
            cycles=cycles,
        )
        return build_waveform(self._device, self._stage, order)

    def _check(self) -> None:
        """Say at once what the waveform would be, or why it is refused."""
        try:
            made = self._made()
        except (FlexstageError, OSError) as error:
            self._said.text = str(error)
            self._said.classes(add="issue error")
            return
        quantity = self._quantity
        (values,) = made.values.values()
        rate = made.waveform.largest_rate(self._forms.axis, closed=made.cycles > 1)
        self._said.classes(remove="issue error")
        file = f"{Path(self._forms.file).name}: " if self._forms.shape == "file" else ""
        self._said.text = (
            f"{file}{made.duration:.4g} s, {shown_number(quantity, float(values.min()))} to "
            f"{shown_number(quantity, float(values.max()))} {quantity.shown_unit}, at most "
            f"{number(rate * quantity.factor)} {quantity.shown_unit}/s: within the limits"
        )

    def _go(self) -> None:
        with self._page.show_errors():
            made = self._made()
            rate = float(self._forms.sample_rate_hz or 0.0)
            name = f"waveform of {self._forms.axis}"
            self._run(name, run_command, self._about(), made, rate, moves=True)


class RecordForm(RunForm):
    """A record of what the stage does, whoever moves it."""

    def build(self) -> None:
        """Make the fields."""
        forms = self._forms
        with div("fields"):
            kept(ui.number("Duration, s"), forms, "duration").props(_FIELD)
            kept(ui.number("Record at, Hz"), forms, "sample_rate_hz").props(_FIELD)
            self._words()
        remark(
            "Position and voltage of every axis, at the rate of the controller. The stage may be "
            "moved by hand meanwhile; what was recorded until a stop is kept."
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
    """A plan, tried dry before anything moves."""

    def build(self) -> None:
        """Make the fields."""
        forms = self._forms
        ready = {name: f"{name} (comes with flexstage)" for name in ready_plans()}
        if not forms.plan:
            forms.plan = self._stage.name if self._stage.name in ready else next(iter(ready))
        if forms.plan not in ready:
            ready[forms.plan] = Path(forms.plan).name
        with div("fields"):
            plans = kept(choice(ready, None, "Plan"), forms, "plan", self._other).classes("wide")
            self._only = choice([], None, "Only these steps", self._chosen, multiple=True)
            self._only.props("use-chips").classes("wide")

            def given(path: Path) -> None:
                read_plan(path)
                plans.set_options(ready | {str(path): path.name}, value=str(path))

            upload(self._page, "Plan file", (".yaml", ".yml"), given, view="bench").classes("slim")
            self._words()
        self._said = ui.label().classes("small").props('role="status"')
        self._start = ui.button("Carry out the plan", icon="play_arrow", on_click=self._go)
        self._shown = div("full-width")
        self._steps()
        ui.timer(0.0, self._try, once=True)

    def _steps(self) -> None:
        with self._page.show_errors():
            names = [step.name for step in read_plan(find_plan(self._forms.plan)).steps]
            chosen = [name for name in self._forms.only if name in names]
            self._only.set_options(names, value=chosen)

    async def _other(self) -> None:
        self._forms.only = ()
        self._steps()
        await self._try()

    async def _chosen(self, event: Any) -> None:
        self._forms.only = tuple(event.value or ())
        await self._try()

    async def _try(self) -> None:
        """Show what the plan would do, as `flexstage run --dry-run` does."""
        forms, stage, device = self._forms, self._stage, self._device
        self._said.text = "looking at the plan …"
        try:
            plan = read_plan(find_plan(forms.plan))
            found = await asyncio.to_thread(
                dry_run, plan, stage, only=forms.only or None, base_rate_hz=base_rate_of(device)
            )
        except FlexstageError as error:
            self._said.text = str(error)
            self._said.classes(add="issue error")
            return
        problem = found.problems[0] if found.problems else ""
        self._said.classes(**{"add" if problem else "remove": "issue error"})
        self._said.text = problem or (
            f"{len(found.steps)} steps, {found.duration:.0f} s of motion and records: within the "
            "limits of the description"
        )
        self._shown.clear()
        with self._shown, ui.expansion("What it would do").classes("full-width"):
            show_table(dry_run_table(found, plan.title or Path(forms.plan).stem))

    def _go(self) -> None:
        with self._page.show_errors():
            forms = self._forms
            given = (self._about(), forms.plan, None, forms.only or None, self._bench.locked)
            self._run(f"plan {Path(forms.plan).stem}", run_plan_file, *given, moves=True)
