"""Parameter studies: sensitivity, sweep, optimisation, tolerance analysis, reconstruction."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.studies.explore.batches import Job, batch_size
    from flexstage.studies.explore.ensemble import Ensemble, FreeDimension, Observation
    from flexstage.studies.explore.family import (
        Evaluated,
        Family,
        evaluate,
        jacobian,
        known_figures,
    )
    from flexstage.studies.explore.figures import Figure, Requirement, figure_of, requirement_of
    from flexstage.studies.explore.optimise.front import Front, find_front
    from flexstage.studies.explore.optimise.multi_fidelity import SearchOptions, find_optimum
    from flexstage.studies.explore.optimise.optimum import Optimum
    from flexstage.studies.explore.optimise.problem import Goal, Problem
    from flexstage.studies.explore.reconstruct import dimension_of, reconstruct
    from flexstage.studies.explore.sampling import (
        SobolIndices,
        SweepPlan,
        saltelli_points,
        sobol_indices,
        usual_plan,
    )
    from flexstage.studies.explore.sensitivity import Sensitivities, sensitivities
    from flexstage.studies.explore.sweep import Sweep, sweep
    from flexstage.studies.explore.tolerance import ToleranceChoice, ToleranceStudy, tolerance
    from flexstage.studies.explore.tolerance_choice import choose_tolerances
    from flexstage.studies.explore.variables import Variable, every_variable, variables_of
    from flexstage.studies.explore.workers import Workers, open_workers

__all__ = [
    "Ensemble",
    "Evaluated",
    "Family",
    "Figure",
    "FreeDimension",
    "Front",
    "Goal",
    "Job",
    "Observation",
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
    "dimension_of",
    "evaluate",
    "every_variable",
    "figure_of",
    "find_front",
    "find_optimum",
    "jacobian",
    "known_figures",
    "open_workers",
    "reconstruct",
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
