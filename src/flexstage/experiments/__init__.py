"""Experiments: plans and campaigns that excite, record, evaluate, identify and verify."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.experiments.campaign.plan import Campaign, Columns, Test, read_campaign
    from flexstage.experiments.campaign.results import Characterisation, characterise
    from flexstage.experiments.plan import (
        DryRun,
        Plan,
        Step,
        dry_run,
        find_plan,
        plan_stage,
        read_plan,
        ready_plans,
    )
    from flexstage.experiments.results import PlanResult
    from flexstage.experiments.runner import run_plan
    from flexstage.experiments.verbs.verify import VerifiedStep
    from flexstage.experiments.virtual_campaign import virtual_campaign

__all__ = [
    "Campaign",
    "Characterisation",
    "Columns",
    "DryRun",
    "Plan",
    "PlanResult",
    "Step",
    "Test",
    "VerifiedStep",
    "characterise",
    "dry_run",
    "find_plan",
    "plan_stage",
    "read_campaign",
    "read_plan",
    "ready_plans",
    "run_plan",
    "virtual_campaign",
]

import_on_use(__name__)
