"""A trapezoidal pivot: an arm on two leaves whose lines cross beyond them, in its remote centre."""

import math
from dataclasses import dataclass, field, replace

from flexstage.designs.parameters import Topology
from flexstage.designs.pieces import WIRE, at_least, fine_screw
from flexstage.designs.pivot_pieces import PivotParameters, faces, leaf, pivot
from flexstage.files.ranges import Size
from flexstage.stage import Body, Loop, Stage
from flexstage.stage.drive import AnyActuator


@dataclass(frozen=True, slots=True, kw_only=True)
class TrapezoidalPivotParameters(PivotParameters):
    """The dimensions of a trapezoidal pivot; the near ends of its leaves are on the arm."""

    centre_distance: Size = 10e-3
    """Distance of the near ends of the leaves from the centre [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(200e-6))
    """What turns the pivot."""
    arm_height: Size = 22e-3
    """Height of the arm over its leaves [m]."""

    def __post_init__(self) -> None:
        PivotParameters.__post_init__(self)
        under = -faces(self, self.centre_distance)[1][1]
        room = under + 4.0 * self.force_patch_half_width
        self._at_least("arm_height", room, "so that the drive pushes beside the centre")
        slot = self.leaf.length * math.cos(self.half_angle)
        at_least("leaf.length * cos(half_angle)", slot, WIRE, "between arm and base")


def trapezoidal_pivot(p: TrapezoidalPivotParameters) -> Stage:
    r"""Build a trapezoidal pivot.

    Two inclined leaves carry the arm on the base; the arm turns about the point where their lines
    cross, which lies beyond them. It is a cross-spring pivot whose crossing is not between the ends
    of its leaves, so that it can be cut from one plate.

    Of leaves of length L whose near ends are r = p L from the crossing the stiffness is

    .. math:: K = \frac{8 E I}{L} (1 + 3 p + 3 p^2)

    and the centre moves by

    .. math:: s = L \vartheta^2 \frac{1 + 9 p + 9 p^2}{15 \cos\alpha}

    towards the base, to second order of the rotation :math:`\vartheta`, with leaves at an angle
    :math:`\alpha` against the line of symmetry (W. H. Wittrick, The properties of crossed flexure
    pivots, and the influence of the point at which the strips cross, Aeronaut. Quart. 2 (1951) 272,
    for leaves that cross at a part :math:`\lambda = -p` of their length; p = -1/2 gives the 2 E I/L
    of the symmetric cross-spring pivot).

    Its bodies are ``base`` (fixed) and ``arm``; its hinges ``left`` and ``right``; its drive, probe
    (a rotation) and axis ``theta``. The centre is the origin.

    Examples
    --------
    >>> stage = trapezoidal_pivot(TrapezoidalPivotParameters())
    >>> [h.name for h in stage.hinges]
    ['left', 'right']
    """
    leaves = (leaf(p, "left", ("arm", "base"), -1.0), leaf(p, "right", ("arm", "base"), 1.0))
    tip, (x, y) = faces(p, p.centre_distance)
    side, top = faces(p, p.radius)[1][0], y + p.arm_height
    right = [tip, (x, y), (side, y), (side, top)]
    arm = Body(name="arm", outline=Loop((*right, *((-u, v) for u, v in right[:0:-1]))))
    return replace(pivot(p, arm, (), leaves), name="trapezoidal-pivot", title="Trapezoidal pivot")


TOPOLOGY = Topology(
    name="trapezoidal-pivot",
    title="trapezoidal pivot on two leaves: turns about a remote centre",
    source="X. Pei, J. Yu, G. Zong, S. Bi, Z. Yu, Analysis of rotational precision for an "
    "isosceles-trapezoidal flexural pivot, J. Mech. Des. 130 (2008) 052302",
    parameters=TrapezoidalPivotParameters,
    construct=trapezoidal_pivot,
)
