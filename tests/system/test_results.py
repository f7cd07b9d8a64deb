"""What a command prints and draws is what the result of the library says and draws."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from netgen.occ import Box

import flexstage as fs
from flexstage.base.errors import ModelError
from flexstage.centring import read_table
from flexstage.centring.calibrate import calibrate_files
from flexstage.centring.calibration import best_heads
from flexstage.centring.requests import CalibrateRequest
from flexstage.cli import main
from flexstage.elasticity.requests import PartRequest
from flexstage.experiments import dry_run, find_plan, read_plan
from flexstage.experiments.campaign.results import characterise_files
from flexstage.experiments.excitations import excitation_of
from flexstage.experiments.requests import CharacteriseRequest, SensorUncertainty
from flexstage.fem.part_analysis import part_result
from flexstage.files.request import Request, recorded, request_of
from flexstage.files.result import Result
from flexstage.hinges.hinge_figures import notch_of
from flexstage.hinges.requests import HingesRequest
from flexstage.hysteresis import excitation
from flexstage.hysteresis.inversion import compensate
from flexstage.hysteresis.model_file import read_model_file
from flexstage.hysteresis.prediction import predict_by_file, predict_each
from flexstage.hysteresis.requests import (
    CompensateRequest,
    ExciteRequest,
    IdentifyRequest,
    KnownChain,
    PredictRequest,
)
from flexstage.measure import read_budget
from flexstage.measure.frf import frf_of_files
from flexstage.measure.requests import FrfRequest
from flexstage.measure.uncertainty.budget_file import evaluate_budget
from flexstage.records.read import read_files
from flexstage.report.figures.style import encode
from flexstage.studies import compare_measurement, run_study
from flexstage.studies.explore.requests import SensitivityRequest, SweepRequest
from flexstage.studies.models import run_models, stage_budget
from flexstage.studies.requests import (
    AnalyseRequest,
    BudgetRequest,
    ModelOptions,
    ScaleRequest,
    StudyRequest,
)
from flexstage.studies.scale import study_scale
from tests.golden.broken_cases.table import TEXT as TABLE
from tests.undrawn import undrawn

BUDGET = """
quantity: gap
unit: um
equation: a - 2 * b
influences:
  - {name: a, value: 63.12 um, uncertainty: 12 nm, dof: 9}
  - {name: b, value: 4.1 um, half_width: 31 nm}
"""
FLOOR = """
environment: 1
name: floor
band: [1 Hz, 2 kHz]
sources:
  floor: {kind: ground, along: x, spectrum: {kind: vc, curve: D, slope_above: -5}}
"""


def table(name: str, heads: str, *columns: np.ndarray) -> None:
    np.savetxt(name, np.column_stack(columns), delimiter=",", header=heads, comments="")


@pytest.fixture(scope="module", autouse=True)
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A folder with a file for each job that reads one."""
    patch, rng = pytest.MonkeyPatch(), np.random.default_rng(5)
    patch.chdir(tmp_path_factory.mktemp("bench"))
    t = np.arange(1400) / 200.0
    u = 58.0 - 55.0 * np.clip(1.25 - t / 7.0, 0.15, 1.0) * np.cos(2.0 * np.pi * 1.3 * t)
    late = np.interp(t - 0.02, t, u)
    y = 0.31 * u + 0.04 * late + 3e-3 * rng.standard_normal(t.size)
    table("drive.csv", "time (s),u (V),y (um)", t, u, y)
    table("wanted.csv", "time (s),y (um)", t, 0.9 * y + 1.0)
    cycles = 50.0 - 50.0 * np.cos(2.0 * np.pi * np.arange(1500) / 300.0)
    moved = 0.63 * cycles + 0.01 * rng.standard_normal(cycles.size)
    table("motion.csv", "time (s),u (um),y (um)", np.arange(cycles.size) / 100.0, cycles, moved)
    theta = np.arange(360) * 2.0 * np.pi / 360
    error = 3e-4 * np.cos(theta - 0.3) + 1e-6 * rng.standard_normal(theta.size)
    table("turn.csv", "angle (rad),error (rad)", theta, error)
    s = np.arange(4096) / 2048.0
    decay = np.exp(-9.0 * s) * np.sin(2.0 * np.pi * 137.0 * s) + 1e-4 * rng.standard_normal(s.size)
    table("decay.csv", "time (s),a (m/s^2)", s, decay)
    f = np.linspace(90.0, 190.0, 401)
    h = 2.3e-6 / (1.0 - (f / 137.0) ** 2 + 0.034j * f / 137.0)
    h += 1e-9 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    table("response.csv", "frequency (Hz),real (m/N),imaginary (m/N)", f, h.real, h.imag)
    Path("budget.yaml").write_text(BUDGET, encoding="utf-8")
    Path("table.yaml").write_text(TABLE, encoding="utf-8")
    Path("floor.yaml").write_text(FLOOR, encoding="utf-8")
    Box((0, 0, 0), (30.0, 4.0, 3.0)).WriteStep("bar.step")
    run("identify", *IDENTIFY.split()[1:], "--out", "m.yaml")
    yield
    patch.undo()


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main([*words, "--quiet"] if words[0] not in WITHOUT_PROGRESS else list(words))
    return int(ended.value.code or 0)


WITHOUT_PROGRESS = {
    "hinges", "excite", "predict", "compensate", "scale", "centre", "calibrate",
}  # fmt: skip
IDENTIFY = "identify drive.csv --input u --output y --model dahl --known delay=0s"


def drive() -> list[Any]:
    return read_files([Path("drive.csv")], ["u", "y"], even=True)


def identified(*, tested: bool = False) -> Result:
    request = IdentifyRequest(model=("dahl",), known=KnownChain(delay=0.0))
    found = fs.identify(drive(), "u", "y", request)
    others = predict_each(found.model, drive(), "u", "y") if tested else []
    return replace(found, tested=tuple(others))


@dataclass(frozen=True)
class Job:
    """A command, and the same by the library."""

    words: str
    result: Callable[[], Result]
    figure: bool = True


STUDY = "--parts none --no-cache --folder study"
NECK = "leg.notch.neck_thickness"
JOBS = {
    "hinges": Job(
        "hinges --profile leaf --length 6mm --depth 1mm",
        lambda: notch_of(HingesRequest(profile="leaf", length=6e-3, depth=1e-3)),
        figure=False,
    ),
    "one model": Job(
        "analyse parallelogram --model lumped --plane stress",
        lambda: fs.analyse("parallelogram", "lumped", plane="stress"),
        figure=False,
    ),
    "all models that are quick": Job(
        "analyse parallelogram --model lumped,superelement",
        lambda: run_models(
            fs.read("parallelogram"), AnalyseRequest(model=("lumped", "superelement"))
        ),
        figure=False,
    ),
    "dynamic budget": Job(
        "budget parallelogram --environment floor.yaml --exposure 10ms",
        lambda: stage_budget(
            fs.read("parallelogram"),
            BudgetRequest(environment=Path("floor.yaml"), exposure=0.01),
        ),
    ),
    "study": Job(
        f"study parallelogram --model lumped {STUDY}",
        lambda: run_study(fs.read("parallelogram"), StudyRequest.of_models("lumped")),
        figure=False,
    ),
    "sweep": Job(
        f"sweep parallelogram --over {NECK}=0.4..0.6mm --samples 4 --workers 1",
        lambda: fs.sweep("parallelogram", over=f"{NECK}=0.4..0.6mm", samples=4),
    ),
    "sensitivity": Job(
        "sensitivity parallelogram --by *neck* --per 10um",
        lambda: fs.sensitivity("parallelogram", by="*neck*", per="10um"),
    ),
    "optimise": Job(
        "optimise parallelogram --minimise mass --over thickness=20% --model lumped --workers 1",
        lambda: fs.optimise("parallelogram", minimise="mass", over="thickness=20%", model="lumped"),
    ),
    "reconstruct": Job(
        f"reconstruct parallelogram --match mass=50g --free {NECK}=20% --free thickness=20% "
        "--model lumped --members 2 --workers 1",
        lambda: fs.reconstruct(
            "parallelogram",
            match="mass=50g",
            free=(f"{NECK}=20%", "thickness=20%"),
            model="lumped",
            members=2,
        ),
    ),
    "tolerance": Job(
        "tolerance parallelogram --model lumped --samples 300 --workers 1",
        lambda: fs.tolerance("parallelogram", model="lumped", samples=300),
    ),
    "excite": Job(
        "excite --voltage 0:100 --frequency 300Hz --duration 20s",
        lambda: excitation(
            request=ExciteRequest(voltage=(0.0, 100.0), frequency=300.0, duration=20.0)
        ),
        figure=False,
    ),
    "excite a stage": Job(
        "excite vgtu-piezo --axis y --shape sine",
        lambda: excitation_of(fs.read("vgtu-piezo"), ExciteRequest(shape="sine"), "y"),
        figure=False,
    ),
    "identify": Job(IDENTIFY, identified),
    "identify and test": Job(
        f"{IDENTIFY} --test-record drive.csv", lambda: identified(tested=True)
    ),
    "predict": Job(
        "predict m.yaml drive.csv --input u --output y --after 30s",
        lambda: predict_by_file(Path("m.yaml"), drive(), "u", "y", PredictRequest(after=30.0)),
    ),
    "compensate": Job(
        "compensate m.yaml --reference wanted.csv --column y --voltage 0:110",
        lambda: compensate(
            read_model_file(Path("m.yaml")),
            read_files([Path("wanted.csv")], ["y"], even=True)[0],
            "y",
            CompensateRequest(voltage=(0.0, 110.0)),
        ),
    ),
    "frf": Job(
        "frf response.csv --response 0,1,2",
        lambda: frf_of_files(
            [Path("response.csv")],
            FrfRequest(response=("0", "1", "2")),
        ),
    ),
    "decay": Job(
        "frf decay.csv --excitation ring-down --output 1",
        lambda: frf_of_files([Path("decay.csv")], FrfRequest(excitation="ring-down", output=(1,))),
    ),
    "uncertainty": Job(
        "uncertainty budget.yaml --trials 20000",
        lambda: evaluate_budget(read_budget(Path("budget.yaml")), trials=20_000),
    ),
    "scale": Job(
        "scale table.yaml --stage vgtu-mechanical",
        lambda: study_scale(read_table("table.yaml"), ScaleRequest(stage=("vgtu-mechanical",))),
    ),
    "centre": Job(
        "centre turn.csv --angle 0 --error 1 --radius 50mm --kind disc",
        lambda: fs.centre("turn.csv", angle=0, error=1, radius="50 mm", kind="disc"),
    ),
    "calibrate": Job(
        "calibrate turn.csv --angle 0 --error 1",
        lambda: calibrate_files([Path("turn.csv")], CalibrateRequest(angle=0, error=(1,))),
    ),
    "heads": Job(
        "calibrate --best-heads 3 --orders 1:4",
        lambda: replace(
            best_heads(3, range(1, 5), step=np.radians(10.0)),
            request=CalibrateRequest(best_heads=3, orders=(1, 2, 3, 4)),
        ),
    ),
    "part": Job(
        "part bar.step --order 0 --hold x-min",
        lambda: part_result(Path("bar.step"), PartRequest(order=0, hold=("x-min",))),
    ),
    "plan": Job(
        "run vgtu-piezo --dry-run",
        lambda: dry_run(read_plan(find_plan("vgtu-piezo")), fs.read("vgtu-piezo")),
        figure=False,
    ),
}


def plain(result: dict[str, Any]) -> Any:
    """The object as JSON has it, without the times that differ from run to run."""

    def without(value: Any) -> Any:
        if isinstance(value, dict):
            return {k: without(v) for k, v in value.items() if k not in ("created", "seconds")}
        return [without(v) for v in value] if isinstance(value, list) else value

    return without(json.loads(json.dumps(result, allow_nan=False)))


@pytest.mark.parametrize("name", JOBS)
def test_a_command_prints_and_draws_the_result_of_the_library(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    job = JOBS[name]
    capsys.readouterr()
    picture = Path(f"{name}.svg")
    more = ("--figure", str(picture)) if job.figure else ()
    # only a picture that was asked for is looked at
    with nullcontext() if job.figure else undrawn():
        assert run(*job.words.split(), *more, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    written = {"files": printed.pop("files", None), "file": printed.pop("file", None)}
    found = job.result()
    expected = found.to_dict()
    # predictions name the file of their model, and this is no file that was written
    if "file" in expected:
        assert expected.pop("file") == written["file"]
    assert plain(printed) == plain(expected)
    assert "request" in printed or found.request is None
    frames: list[Any] = []
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=frames.append))
    found.to_frame()
    assert len(frames[0])
    if job.figure:
        assert encode(found.plot(), "svg") == picture.read_bytes()


@pytest.mark.parametrize(
    "request_",
    [
        SweepRequest(over=("neck=0.3..0.8 mm",), samples=40, indices=True),
        SensitivityRequest(per=10e-6, hinges=True),
        IdentifyRequest(
            model=("dahl", "duhem"), train=(None, 1500), known=KnownChain(delay=0.0), zero="drift"
        ),
        ExciteRequest(voltage=(0.0, 120.0), rates=(0.5, 5.0), multisine=False),
        PredictRequest(after=float("inf")),
        CompensateRequest(after="rest", reference_bandwidth=200.0),
        FrfRequest(input=("force",), output=(1, "x"), band=(100.0, 300.0), fit_modes=2),
        CharacteriseRequest(
            axis="y", column=("command=0",), sensor=SensorUncertainty(calibration=1e-3)
        ),
    ],
)
def test_what_was_asked_is_asked_again_by_its_record(request_: Request) -> None:
    said = json.loads(json.dumps(recorded(request_), allow_nan=False))
    assert request_of(type(request_), None, said) == request_
    assert recorded(type(request_)()) == {}


def test_a_group_that_asks_for_something_stands_under_its_name() -> None:
    asked = AnalyseRequest(options=ModelOptions(plane="stress"))
    assert recorded(asked) == {"options": {"plane": "stress"}}


def test_another_view_is_named() -> None:
    found = fs.tolerance("parallelogram", model="lumped", samples=300)
    shown, usual = (encode(figure, "svg") for figure in (found.plot("shares"), found.plot()))
    assert shown != usual
    with pytest.raises(ModelError, match="a ToleranceStudy cannot be drawn as 'slices'"):
        found.plot("slices")


def test_measured_files_are_one_test(capsys: pytest.CaptureFixture[str]) -> None:
    words = "characterise motion.csv --test motion --column command=u --column along=y --json"
    capsys.readouterr()
    assert run(*words.split()) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed.pop("files") == []
    asked = CharacteriseRequest(column=("command=u", "along=y"))
    found = characterise_files(["motion.csv"], asked)
    assert plain(printed) == plain(compare_measurement(found, None).to_dict())
    assert plain(printed) == plain(found.to_dict())
