"""A Cartwheel pivot: four leaves meet in a hub, two from the base and two to the arm that turns."""

import math
from dataclasses import dataclass, replace

from flexstage.designs.parameters import Topology
from flexstage.designs.pieces import WIRE
from flexstage.designs.pivot_pieces import PivotParameters, faces, leaf, pivot
from flexstage.errors import StageError
from flexstage.stage import Body, Loop, PlaneMotion, Stage, moved
from flexstage.stage.issue import millimetres


@dataclass(frozen=True, slots=True, kw_only=True)
class CartwheelParameters(PivotParameters):
    """The dimensions of a Cartwheel pivot; the near ends of its leaves are on the hub."""

    def __post_init__(self) -> None:
        PivotParameters.__post_init__(self)
        sine, cosine = math.sin(self.half_angle), math.cos(self.half_angle)
        room = 0.5 * (self.leaf.root_height * sine + WIRE) / cosine
        self._at_least("centre_distance", room, "for two leaves one over the other")
        column = faces(self, self.radius)[1][0] + self.actuator_length
        room = (column - WIRE) * sine
        self._at_most("centre_distance", room, "between the hub and the column")
        gap = -2.0 * faces(self, self.radius)[1][1]
        if gap < self.actuator_length:
            raise StageError(
                f"base and arm must be an actuator_length of {millimetres(self.actuator_length)} "
                f"apart, got {millimetres(gap)}: make half_angle smaller or the leaf longer"
            )


def cartwheel(p: CartwheelParameters) -> Stage:
    r"""Build a Cartwheel pivot.

    Two leaves go from the base to a hub in the middle, and two, their mirror images, from there to
    the arm. The lines of all leaves meet in the centre, about which hub and arm turn, the hub half
    as far. It is what is left of a cross-spring pivot in one plate, in which two leaves that cross
    cannot be cut: they are joined where they would.

    Of leaves of length L with an end at a distance h = p L from the centre the stiffness is

    .. math:: K = \frac{4 E I}{L} (1 + 3 p + 3 p^2)

    four times that of a cross-spring pivot whose leaves are twice as long, 2 E I/(2 L) for p = 0
    (J. A. Haringx, The cross-spring pivot as a constructional element, Appl. Sci. Res. A1 (1949)
    313, has E I/L for each of two leaves that cross in their middles). The centre moves by

    .. math:: s = L \vartheta^2 \frac{1 + 9 p + 9 p^2}{30 \cos\alpha}

    towards the base, to second order of the rotation :math:`\vartheta`, with leaves at an angle
    :math:`\alpha` against the line of symmetry: two leaves turn the hub by half of it and draw it
    by L (theta/2)^2 (1 + 9 p + 9 p^2)/(15 cos(alpha)), and so do the other two (the second-order
    coefficients of a leaf are those of S. Awtar, A. H. Slocum, E. Sevincer, J. Mech. Des. 129
    (2007) 625; the polynomial is W. H. Wittrick's, Aeronaut. Quart. 2 (1951) 272).

    Its bodies are ``base`` (fixed), ``hub`` and ``arm``; its hinges ``lower-left``,
    ``lower-right``, ``upper-left`` and ``upper-right``; its drive, probe (a rotation) and axis
    ``theta``. The centre is the origin.

    Examples
    --------
    >>> stage = cartwheel(CartwheelParameters())
    >>> [h.name for h in stage.hinges]
    ['lower-left', 'lower-right', 'upper-left', 'upper-right']
    """
    lower = tuple(
        leaf(p, f"lower-{side}", ("hub", "base"), sign)
        for side, sign in (("left", -1.0), ("right", 1.0))
    )
    mirror = PlaneMotion.reflection(0.0)
    above = {"base": "arm", "lower-left": "upper-left", "lower-right": "upper-right"}
    tip, (x, y) = faces(p, p.radius)
    arm = Body(
        name="base",
        outline=Loop((tip, (x, y), (x, tip[1] - p.wall), (-x, tip[1] - p.wall), (-x, y))),
    )
    h, s, c = p.centre_distance, math.sin(p.half_angle), math.cos(p.half_angle)
    hub = Body(name="hub", outline=Loop(((h / s, 0.0), (0.0, h / c), (-h / s, 0.0), (0.0, -h / c))))
    upper = tuple(moved(hinge, mirror, above) for hinge in lower)
    return replace(
        pivot(p, moved(arm, mirror, above), (hub,), (*lower, *upper)),
        name="cartwheel",
        title="Cartwheel pivot",
    )


TOPOLOGY = Topology(
    name="cartwheel",
    title="Cartwheel pivot: four leaves meet in a hub",
    source="X. Pei, J. Yu, G. Zong, S. Bi, H. Su, The modeling of cartwheel flexural hinges, Mech. "
    "Mach. Theory 44 (2009) 1900; S. T. Smith, Flexures, Gordon and Breach, 2000",
    parameters=CartwheelParameters,
    construct=cartwheel,
)
