"""Finite elements of a meshed part: exact shapes, linear elasticity, stress.

The elements, the mesher and the factorisation are NGSolve's and Netgen's; what stands here gives
them the words of an engineer, SI units, and loads and readings as plain arrays.
"""

from flexstage.elasticity.continuum import AttachedMass, Continuum
from flexstage.elasticity.shapes import face
from flexstage.elasticity.stress import von_mises, von_mises_of
from flexstage.elasticity.unit import METRE

__all__ = ["METRE", "AttachedMass", "Continuum", "face", "von_mises", "von_mises_of"]
