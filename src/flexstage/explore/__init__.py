"""Many stages at once: what moves what, sweeps, the best, and what the workshop makes of it."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.explore.batches import Job, batch_size
    from flexstage.explore.family import Evaluated, Family, evaluate, jacobian, known_figures
    from flexstage.explore.figures import Figure, Requirement, figure_of, requirement_of
    from flexstage.explore.optimise.front import Front, find_front
    from flexstage.explore.optimise.ladder import SearchOptions, find_optimum
    from flexstage.explore.optimise.optimum import Optimum
    from flexstage.explore.optimise.problem import Goal, Problem
    from flexstage.explore.sampling import (
        SobolIndices,
        SweepPlan,
        saltelli_points,
        sobol_indices,
        usual_plan,
    )
    from flexstage.explore.sensitivity import Sensitivities, sensitivities
    from flexstage.explore.sweep import Sweep, sweep
    from flexstage.explore.tolerance import ToleranceChoice, ToleranceStudy, tolerance
    from flexstage.explore.tolerance_choice import choose_tolerances
    from flexstage.explore.variables import Variable, every_variable, variables_of
    from flexstage.explore.workers import Workers, open_workers

__all__ = [
    "Evaluated",
    "Family",
    "Figure",
    "Front",
    "Goal",
    "Job",
    "Optimum",
    "Problem",
    "Requirement",
    "SearchOptions",
    "Sensitivities",
    "SobolIndices",
    "Sweep",
    "SweepPlan",
    "ToleranceChoice",
    "ToleranceStudy",
    "Variable",
    "Workers",
    "batch_size",
    "choose_tolerances",
    "evaluate",
    "every_variable",
    "figure_of",
    "find_front",
    "find_optimum",
    "jacobian",
    "known_figures",
    "open_workers",
    "requirement_of",
    "saltelli_points",
    "sensitivities",
    "sobol_indices",
    "sweep",
    "tolerance",
    "usual_plan",
    "variables_of",
]

import_on_use(__name__)
