"""Finite elements of a meshed part: exact shapes, linear elasticity, stress, finite displacements.

The elements, the mesher and the factorisation are NGSolve's and Netgen's; what stands here gives
them the words of an engineer, SI units, and loads and readings as plain arrays.
"""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.elasticity.buckling import BucklingFactors, buckling
    from flexstage.elasticity.continuum import AttachedMass, Continuum
    from flexstage.elasticity.large_displacement import Equilibria, follow_drive, follow_load
    from flexstage.elasticity.loaded import loaded, material_stress, stress_stiffening
    from flexstage.elasticity.memory import memory_available, memory_needed, require_memory
    from flexstage.elasticity.shapes import face
    from flexstage.elasticity.stress import von_mises, von_mises_of
    from flexstage.elasticity.threads import free_cores, parallel
    from flexstage.elasticity.unit import METRE

__all__ = [
    "METRE",
    "AttachedMass",
    "BucklingFactors",
    "Continuum",
    "Equilibria",
    "buckling",
    "face",
    "follow_drive",
    "follow_load",
    "free_cores",
    "loaded",
    "material_stress",
    "memory_available",
    "memory_needed",
    "parallel",
    "require_memory",
    "stress_stiffening",
    "von_mises",
    "von_mises_of",
]

import_on_use(__name__)
