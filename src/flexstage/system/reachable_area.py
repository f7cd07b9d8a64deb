"""What all drives of a stage reach together."""

from dataclasses import dataclass

from flexstage.arrays import Array
from flexstage.short_repr import short_repr
from flexstage.system.zonotope import (
    box_section,
    polygon_area,
    zonogon_outline,
    zonotope_volume,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReachableArea:
    """The positions that all drives reach together, and the angles with them.

    It is the sum of the strokes of the drives, each along its column of the Jacobian: a polygon, or
    with a rotation a polyhedron, whose points opposite of the middle are alike.
    """

    axes: tuple[str, ...]
    """The two displacements, and the rotation where there is one."""
    drives: tuple[str, ...]
    """The drives."""
    generators: Array
    """What the stroke of each drive does [m, m, rad], shape (2, d) or (3, d)."""
    lowest: Array
    """Where all drives are at the lower end of their strokes [m, m, rad], shape (2,) or (3,)."""
    middle: Array
    """Where all drives are in the middle of their strokes [m, m, rad], shape (2,) or (3,)."""

    __repr__ = short_repr

    @property
    def projection(self) -> Array:
        """Corners of the positions reached at any angle, counterclockwise [m], shape (k, 2)."""
        return zonogon_outline(self.generators[:2]) + self.middle[:2]

    def section(self, angle: float | None = None) -> Array:
        """Return the corners of the positions that are reached at one angle.

        Parameters
        ----------
        angle : float, optional
            The reading of the rotation [rad], 0 where all drives are at no elongation; that of the
            middle, where the area is largest, if not given. Without a rotation there is none.

        Returns
        -------
        numpy.ndarray
            The corners, counterclockwise [m], shape (k, 2); fewer than 3 where it has no area.

        Notes
        -----
        Validity: exact for linear stages.
        """
        if len(self.axes) < 3:
            return self.projection
        level = 0.0 if angle is None else angle - float(self.middle[2])
        return box_section(self.generators, level) + self.middle[:2]

    @property
    def area(self) -> float:
        """Area reached at the angle of the middle [m^2]."""
        return polygon_area(self.section())

    @property
    def projected_area(self) -> float:
        """Area reached at any angle [m^2]."""
        return zonotope_volume(self.generators[:2])

    @property
    def volume(self) -> float:
        """Area or volume of all that is reached [m^2, or m^2 rad]."""
        return zonotope_volume(self.generators)
