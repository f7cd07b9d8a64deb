"""Experiment plans: what is excited, measured, identified and verified, step by step."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.plans.dry_run import DryRun, dry_run
    from flexstage.plans.file import find_plan, read_plan, ready_plans
    from flexstage.plans.plan import Plan, Step
    from flexstage.plans.results import (
        PlanResult,
        VerifiedStep,
    )
    from flexstage.plans.runner import plan_stage, run_plan

__all__ = [
    "DryRun",
    "Plan",
    "PlanResult",
    "Step",
    "VerifiedStep",
    "dry_run",
    "find_plan",
    "plan_stage",
    "read_plan",
    "ready_plans",
    "run_plan",
]

import_on_use(__name__)
