"""In which ways the bodies of a stage move: in its plane, or out of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.stage import ExtraMass
from flexstage.stage.outline import Point

#: Loads inside a body: forces and moment on its mean motion, one kelvin, one kelvin by metre.
LOADS = ("x", "y", "rotation", "temperature", "temperature gradient x", "temperature gradient y")
#: The same out of its plane.
LOADS_OUT_OF_PLANE = ("z", "rotation x", "rotation y", "temperature gradient z")

_TURNS = ("rotation by", "slope of it")


def neck_coordinates(through: ThroughThickness) -> tuple[str, ...]:
    """Name the motions of a neck, in order: each is a mean over its width and its thickness."""
    plane, across = (("z", "z^3"), ("1", "z^2")) if through.out_of_plane else (("1", "z^2"), ("z",))
    plane, across = (
        names[: through.functions[kind].passed]
        for names, kind in ((plane, "plane"), (across, "across"))
    )
    return (
        *(f"{motion} by {k}" for k in plane for motion in ("along", "rotation")),
        *(f"across by {k}" for k in plane),
        *(f"{motion} by {k}" for k in across for motion in ("through the plate", "slope of it")),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Freedom:
    """In which way the bodies of a stage move: in its plane, or out of it."""

    necks: tuple[str, ...]
    """Name and unit of each motion of a neck."""
    loads: tuple[str, ...]
    """Loads inside each body; the first three are those on its mean motion."""
    axes: str = "xy"
    """Directions in which bodies are displaced: ``xy`` or ``z``."""

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Which motions of a neck are a rotation times half of the thickness of the neck."""
        return np.array([name.startswith(_TURNS) for name in self.necks])

    @property
    def out_of_plane(self) -> bool:
        """Whether it is the motion out of the plane."""
        return self.axes == "z"

    def carried(self, motion: Array, centre: Point, at: Point) -> Array:
        """Carry the motion of a body, one a row, from its centre to another point."""
        x, y = at[0] - centre[0], at[1] - centre[1]
        moved = motion.copy()
        if self.out_of_plane:  # displacement z, rotations about x and y
            moved[0] += y * motion[1] - x * motion[2]
        else:  # displacements x and y, rotation
            moved[0] -= y * motion[2]
            moved[1] += x * motion[2]
        return moved

    def read(self, centre: Point, at: Point) -> Array:
        """Return the displacements of a point of a body by the motions of its centre, shape (k, 3).

        The same rows are what unit forces at the point do to these motions.
        """
        return self.carried(np.eye(3), centre, at)[: len(self.axes)]

    def inertia(self, extra: ExtraMass) -> Array:
        """Return what rides on a body, for each of its motions; out of the plane it is a point."""
        out = (extra.mass, 0.0, 0.0)
        return np.array(out if self.out_of_plane else (extra.mass, extra.mass, extra.inertia))


def freedom(through: ThroughThickness) -> Freedom:
    """Return in which way bodies move that are condensed with functions through the thickness."""
    out = through.out_of_plane
    return Freedom(
        necks=tuple(f"{name} [m]" for name in neck_coordinates(through)),
        loads=LOADS_OUT_OF_PLANE if out else LOADS,
        axes="z" if out else "xy",
    )
