"""A rhombus amplifier, of slanted beams, with a guided output, as a family of stages."""

import math
from dataclasses import dataclass, field
from typing import Annotated

from flexstage.designs.amplifier_frame import AmplifierFrame, AmplifierParameters, Limb
from flexstage.designs.parameters import Topology
from flexstage.designs.pieces import at_most, two_sided
from flexstage.files.ranges import Range
from flexstage.hinges import CornerFilleted, Profile
from flexstage.stage import Hinge, Stage
from flexstage.units import Angle


@dataclass(frozen=True, slots=True, kw_only=True)
class RhombusParameters(AmplifierParameters):
    """The dimensions of a rhombus amplifier."""

    beam: Profile = field(
        default_factory=lambda: CornerFilleted(
            neck_thickness=0.5e-3, notch_length=14e-3, fillet_radius=0.5e-3
        )
    )
    """The beams; any profile of hinges, as long as a beam."""
    beam_angle: Annotated[Angle, Range(low=0.0, high=0.25 * math.pi, above=True)] = 0.14
    """Angle between a beam and the drive [rad]."""

    def __post_init__(self) -> None:
        AmplifierParameters.__post_init__(self)
        two_sided(self.beam, "a rhombus")
        at_most(
            "the length of beam",
            self.beam.length,
            0.5 * (self.actuator_length - self.slot) / math.cos(self.beam_angle),
            "so that the output is at least a slot wide between the beams",
        )


def rhombus(p: RhombusParameters) -> Stage:
    r"""Build a rhombus amplifier.

    It is a bridge amplifier (see `flexstage.designs.bridge.bridge`) each of whose limbs is one
    slanted beam, which bends over its whole length; the shape of most amplified actuators that one
    buys. Its four beams are hinges, called after their corner.

    Notes
    -----
    With pins at the ends of its beams the ratio is :math:`\cot\alpha`, of ``beam_angle``. Beams of
    length l and thickness t that are built in at both ends leave, by their energy of stretching and
    bending, for a free output

    .. math::
        R = \frac{(k_l - k_b)\sin\alpha\cos\alpha}{k_l\sin^2\alpha + k_b\cos^2\alpha},\quad
        k_l = \frac{E b t}{l},\ k_b = \frac{E b t^3}{l^3},

    which is the form of M. Ling, J. Cao, M. Zeng, J. Lin, D. J. Inman (Smart Materials and
    Structures 25 (2016) 075022) but for :math:`k_b` in the numerator, which they leave out.

    Validity: rigid blocks, small motion; beams without shear and without fillets, which shorten
    what bends.

    Examples
    --------
    >>> stage = rhombus(RhombusParameters())
    >>> stage.hinge("upper-left").direction
    0.14
    """
    return AmplifierFrame(parameters=p, limb=_limb(p)).stage(
        "rhombus", "Rhombus amplifier with a guided output"
    )


def _limb(p: RhombusParameters) -> Limb:
    c, s, height = math.cos(p.beam_angle), math.sin(p.beam_angle), p.beam.root_height
    # the two ends of the root on the left block, and those on the output
    x, y = -0.5 * p.actuator_length, 0.5 * p.actuator_width
    foot = ((x, y), (x - s * height, y + c * height))
    head = tuple((u + c * p.beam.length, v + s * p.beam.length) for u, v in foot)
    middle = (0.5 * (foot[0][0] + head[1][0]), 0.5 * (foot[0][1] + head[1][1]))
    return Limb(
        bodies=(),
        hinges=(
            Hinge(
                name="upper-left",
                bodies=("left", "output"),
                at=middle,
                direction=p.beam_angle,
                profile=p.beam,
            ),
        ),
        input_corner=foot,
        output_side=head,
        top=head[1][1],
    )


TOPOLOGY = Topology(
    name="rhombus",
    title="rhombus amplifier, of slanted beams, with a guided output",
    source="M. Ling, J. Cao, M. Zeng, J. Lin, D. J. Inman, Smart Materials and Structures 25 "
    "(2016) 075022",
    parameters=RhombusParameters,
    construct=rhombus,
)
