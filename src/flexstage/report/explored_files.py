"""The files of what was found among many stages, by their names: data, pictures, pages."""

from collections.abc import Callable
from functools import partial

from flexstage.base.errors import ModelError
from flexstage.files.plain import json_text
from flexstage.report.figures.style import encode
from flexstage.report.optimise import front_html
from flexstage.report.sweep import sweep_html
from flexstage.report.tolerance import tolerance_page
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import Optimum
from flexstage.studies.explore.results import samples_csv, sensitivity_csv, sweep_csv, sweep_parquet
from flexstage.studies.explore.sensitivity import Sensitivities
from flexstage.studies.explore.sweep import Sweep
from flexstage.studies.explore.tolerance import ToleranceStudy

Files = dict[str, bytes]


def sweep_files(found: Sweep) -> tuple[Files, list[str]]:
    """Return the files of a sweep, and in sentences which of them could not be made."""
    makes: dict[str, Callable[[], bytes]] = {
        "sweep.csv": partial(sweep_csv, found),
        "sweep.parquet": partial(sweep_parquet, found),
        "sweep.json": lambda: json_text(found.summary()).encode(),
        "sweep.svg": lambda: encode(found.plot(), "svg"),
        "indices.svg": lambda: encode(found.plot("indices"), "svg"),
        "sweep.html": lambda: sweep_html(found).encode(),
    }
    if found.indices is None:
        del makes["indices.svg"]
    files: Files = {}
    notes: list[str] = []
    for name, make in makes.items():
        try:
            files[name] = make()
        except ModelError as error:
            notes.append(f"{name} was not written: {error}")
    return files, notes


def optimum_files(found: Optimum) -> Files:
    """Return the files of a best stage: its stage file, and how it was found."""
    return {
        "best.yaml": found.text.encode(),
        "optimise.json": json_text(found.to_dict()).encode(),
    } | _optimum_pictures(found)


def front_files(found: Front) -> Files:
    """Return the files of a Pareto front and of the design that is chosen of it."""
    page = {"front.html": front_html(found).encode()} if len(found.problem.goals) > 2 else {}
    return (
        {
            "best.yaml": found.optimum.text.encode(),
            "optimise.json": json_text(found.to_dict()).encode(),
            "front.svg": encode(found.plot(), "svg"),
        }
        | _optimum_pictures(found.optimum)
        | page
    )


def _optimum_pictures(found: Optimum) -> Files:
    views = {"history.svg": "history", "before-after.svg": "", "figures.svg": "figures"}
    return {name: encode(found.plot(view), "svg") for name, view in views.items()}


def tolerance_files(study: ToleranceStudy, *, every: bool = False) -> Files:
    """Return the files of a lot; with those of `every` sample where asked for."""
    files = {
        "tolerance.html": tolerance_page(study).encode(),
        "tolerance.json": json_text(study.to_dict()).encode(),
        "figures.svg": encode(study.plot(), "svg"),
    }
    if study.shares:
        files["shares.svg"] = encode(study.plot("shares"), "svg")
    if every:
        files["samples.csv"] = samples_csv(study)
    return files


def sensitivity_files(found: Sensitivities) -> Files:
    """Return the files of sensitivities."""
    return {
        "sensitivity.json": json_text(found.to_dict()).encode(),
        "sensitivity.csv": sensitivity_csv(found).encode(),
        "sensitivity.svg": encode(found.plot(), "svg"),
    }
