"""Experiment plans: what is excited, measured, identified and verified, step by step."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.plans.dry_run import DryRun, PlannedMotion, PlannedStep, dry_run
    from flexstage.plans.file import find_plan, plan_from_text, read_plan, ready_plans
    from flexstage.plans.plan import Defaults, Plan, SensorEntry, Step
    from flexstage.plans.results import (
        CentredMove,
        CentredStep,
        CharacterisedStep,
        CommandedStep,
        CompensatedStep,
        FollowedRun,
        IdentifiedStep,
        MeasuredStep,
        PlanResult,
        StepResult,
        VerifiedStep,
    )
    from flexstage.plans.results_file import plain_results, results_text
    from flexstage.plans.runner import plan_stage, run_plan

__all__ = [
    "CentredMove",
    "CentredStep",
    "CharacterisedStep",
    "CommandedStep",
    "CompensatedStep",
    "Defaults",
    "DryRun",
    "FollowedRun",
    "IdentifiedStep",
    "MeasuredStep",
    "Plan",
    "PlanResult",
    "PlannedMotion",
    "PlannedStep",
    "SensorEntry",
    "Step",
    "StepResult",
    "VerifiedStep",
    "dry_run",
    "find_plan",
    "plain_results",
    "plan_from_text",
    "plan_stage",
    "read_plan",
    "ready_plans",
    "results_text",
    "run_plan",
]

import_on_use(__name__)
