"""Design, verify, identify and drive flexure-based micropositioning stages.

The package is a set of rooms with one direction of imports; ``import flexstage`` itself loads none
of them, so it takes milliseconds. See the reference manual for the rooms.
"""

__all__ = ["__version__"]

__version__ = "0.1.0"
