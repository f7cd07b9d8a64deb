"""Tables and sentences of what was found, as the commands print them."""

from collections.abc import Iterator
from typing import Any

from flexstage.explore.optimise.front import Front
from flexstage.explore.requests.optimise import OptimiseRequest
from flexstage.explore.requests.sensitivity import SensitivityRequest
from flexstage.explore.requests.sweep import SweepRequest
from flexstage.explore.requests.tolerance import ToleranceRequest
from flexstage.report.optimise import front_notes, front_tables, optimum_notes, optimum_tables
from flexstage.report.sensitivity import left_out_notes, sensitivity_table
from flexstage.report.sweep import range_tables, sweep_notes
from flexstage.report.tolerance import choice_table, share_table, spread_table, yield_table
from flexstage.table import Table
from flexstage.web.explore.command import Request


def tables_of(request: Request, result: Any) -> Iterator[Table]:
    """Yield the tables of a result."""
    match request:
        case SweepRequest():
            yield from range_tables(result)
        case OptimiseRequest():
            is_front = isinstance(result, Front)
            yield from front_tables(result) if is_front else optimum_tables(result)
        case SensitivityRequest():
            yield sensitivity_table(result, request.length)
        case ToleranceRequest():
            study, choice = result
            if study.yields:
                yield yield_table(study.yields)
            yield spread_table(study)
            if choice is not None and choice.found:
                yield choice_table(choice)
            if study.shares:
                yield share_table(study)


def notes_of(request: Request, result: Any) -> tuple[str, ...]:
    """Return what is to be known of a result, in sentences."""
    match request:
        case SweepRequest():
            return sweep_notes(result)
        case OptimiseRequest():
            return front_notes(result) if isinstance(result, Front) else optimum_notes(result)
        case SensitivityRequest():
            return tuple(left_out_notes(result, hinges=request.hinges))
        case ToleranceRequest():
            study, choice = result
            verdict = () if choice is None else (choice.verdict,)
            return (*verdict, f"figures by the {study.model}", *study.notes)
