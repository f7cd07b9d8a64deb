"""Finite elements of a meshed part: exact shapes, linear elasticity, stress, finite displacements.

The elements, the mesher and the factorisation are NGSolve's and Netgen's; this room adds an
engineer's terms, SI units, and loads and readings as plain arrays.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.elasticity.continuum import AttachedMass, Continuum
    from flexstage.elasticity.loaded import (
        buckling,
        follow_drive,
        follow_load,
        stress_stiffening,
        von_mises,
    )
    from flexstage.elasticity.resources import parallel
    from flexstage.elasticity.shapes import face


__all__ = [
    "AttachedMass",
    "Continuum",
    "buckling",
    "face",
    "follow_drive",
    "follow_load",
    "parallel",
    "stress_stiffening",
    "von_mises",
]

import_on_use(__name__)
