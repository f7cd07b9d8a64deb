"""The files of what was found among many stages, by their names: data, pictures, pages."""

from collections.abc import Callable
from functools import partial

from flexstage.errors import ModelError
from flexstage.explore.optimise.front import Front
from flexstage.explore.optimise.optimum import Optimum
from flexstage.explore.results import (
    front_results,
    optimum_results,
    samples_csv,
    sensitivity_csv,
    sensitivity_results,
    sweep_csv,
    sweep_parquet,
    sweep_results,
    tolerance_results,
)
from flexstage.explore.sensitivity import Sensitivities
from flexstage.explore.sweep import Sweep
from flexstage.explore.tolerance import ToleranceStudy
from flexstage.explore.tolerance_choice import ToleranceChoice
from flexstage.files.plain import json_text
from flexstage.report.figures.distributions import draw_shares, draw_spreads
from flexstage.report.figures.optimum import (
    draw_before_after,
    draw_figures,
    draw_front,
    draw_history,
)
from flexstage.report.figures.sensitivity import draw_sensitivities
from flexstage.report.figures.style import encode
from flexstage.report.figures.sweep import draw_indices, draw_sweep
from flexstage.report.optimise import front_html
from flexstage.report.sweep import sweep_html
from flexstage.report.tolerance import tolerance_page

Files = dict[str, bytes]


def sweep_files(found: Sweep) -> tuple[Files, list[str]]:
    """Return the files of a sweep, and in sentences which of them could not be made."""
    makes: dict[str, Callable[[], bytes]] = {
        "sweep.csv": partial(sweep_csv, found),
        "sweep.parquet": partial(sweep_parquet, found),
        "sweep.json": lambda: json_text(sweep_results(found)).encode(),
        "sweep.svg": lambda: encode(draw_sweep(found), "svg"),
        "indices.svg": lambda: encode(draw_indices(found), "svg"),
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
        "optimise.json": json_text(optimum_results(found)).encode(),
    } | _optimum_pictures(found)


def front_files(found: Front) -> Files:
    """Return the files of a Pareto front and of the design that is chosen of it."""
    page = {"front.html": front_html(found).encode()} if len(found.problem.goals) > 2 else {}
    return (
        {
            "best.yaml": found.optimum.text.encode(),
            "optimise.json": json_text(front_results(found)).encode(),
            "front.svg": encode(draw_front(found), "svg"),
        }
        | _optimum_pictures(found.optimum)
        | page
    )


def _optimum_pictures(found: Optimum) -> Files:
    draws = {
        "history.svg": draw_history,
        "before-after.svg": draw_before_after,
        "figures.svg": draw_figures,
    }
    return {name: encode(draw(found), "svg") for name, draw in draws.items()}


def tolerance_files(
    study: ToleranceStudy, choice: ToleranceChoice | None, *, every: bool = False
) -> Files:
    """Return the files of a lot; with those of `every` sample where asked for."""
    files = {
        "tolerance.html": tolerance_page(study, choice).encode(),
        "tolerance.json": json_text(tolerance_results(study, choice)).encode(),
        "figures.svg": encode(draw_spreads(study), "svg"),
    }
    if study.shares:
        files["shares.svg"] = encode(draw_shares(study), "svg")
    if every:
        files["samples.csv"] = samples_csv(study)
    return files


def sensitivity_files(found: Sensitivities, length: float | None) -> Files:
    """Return the files of sensitivities, of changes of lengths by so much [m]."""
    return {
        "sensitivity.json": json_text(sensitivity_results(found, length)).encode(),
        "sensitivity.csv": sensitivity_csv(found).encode(),
        "sensitivity.svg": encode(draw_sensitivities(found, length), "svg"),
    }
