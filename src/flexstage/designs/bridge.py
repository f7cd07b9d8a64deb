"""A bridge amplifier with a guided output, as a family of stages."""

from dataclasses import dataclass, field

from flexstage.designs.amplifier_frame import AmplifierFrame, AmplifierParameters, Limb
from flexstage.designs.parameters import Topology
from flexstage.designs.pieces import two_sided
from flexstage.files.ranges import Size
from flexstage.hinges import Profile, RightCircular
from flexstage.stage import Body, Hinge, Loop, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeParameters(AmplifierParameters):
    """The dimensions of a bridge amplifier."""

    link_length: Size = 12e-3
    """Distance of the two necks of a link along the drive [m]."""
    link_offset: Size = 2e-3
    """Distance of the two necks of a link across the drive [m]."""
    notch: Profile = field(
        default_factory=lambda: RightCircular(neck_thickness=0.4e-3, radius=1e-3)
    )
    """The notches of the links."""

    def __post_init__(self) -> None:
        AmplifierParameters.__post_init__(self)
        two_sided(self.notch, "a link")
        self._at_least(
            "link_length",
            self.notch.length + self.slot,
            "so that a link has a bar",
        )
        self._at_most(
            "link_length",
            0.5 * (self.actuator_length - self.slot) - self.notch.length,
            "so that the output is at least a slot wide",
        )


def bridge(p: BridgeParameters) -> Stage:
    r"""Build a bridge amplifier.

    A stack pushes two blocks apart. Four links, each with a notch at either end, join them to the
    foot of the base and to the output, which comes down as the links flatten::

                  base ]=======|  output |=======[ base      guide: four leaves
                               |         |
                     left   __  \_)_____(_/  __   right
                    |     |_)__/           \__(_|     |
                    |     |  < - - drive - - >  |     |      y = 0
                    |     |_)___           ___(_|     |
                              \__)_____(__/
                               |  base   |

    Bodies, drive, probe and axis are those of `flexstage.designs.amplifier_frame.AmplifierFrame`;
    the links are called after their corner, their hinges end in ``-in`` and ``-out``.

    Notes
    -----
    With pins for necks the ratio is :math:`l_x/l_y`, ``link_length`` over ``link_offset``
    (J. Pokines, E. Garcia, Smart Materials and Structures 7 (1998) 105). Necks that resist turning
    by :math:`k_\theta` and stretching by :math:`k_u`, each, leave for a free output

    .. math:: R = \frac{l_x l_y}{l_y^2 + 4 k_\theta/k_u},

    which follows from the moment of the force F in a link, :math:`F l_y = 2 k_\theta\varphi`, and
    its stretching, 2 F/k_u; M. Ling et al. (Mech. Syst. Signal Process. 119 (2019)) quote it.
    A load of stiffness k at the output, its guide for one, leaves of it
    :math:`k_o/(k_o + k)`, where :math:`k_o` is the stiffness of the output with the drive held.

    Validity: rigid bodies, small motion; no shear of the necks.

    Examples
    --------
    >>> stage = bridge(BridgeParameters())
    >>> neck, head = stage.hinge("upper-left-in").at, stage.hinge("upper-left-out").at
    >>> round((head[0] - neck[0]) / (head[1] - neck[1]), 6)
    6.0
    """
    return bridge_amplifier(p).stage("bridge", "Bridge amplifier with a guided output")


def bridge_amplifier(p: BridgeParameters) -> AmplifierFrame:
    """Return a bridge without a base."""
    return AmplifierFrame(parameters=p, limb=_limb(p))


def _limb(p: BridgeParameters) -> Limb:
    r, low = 0.5 * p.notch.length, 0.5 * p.actuator_width
    height = p.notch.root_height
    face = -0.5 * p.actuator_length
    near, far = face + r, face + r + p.link_length
    side, high = far + r, low + height + p.link_offset
    left, right = near + r, far - r
    link = Loop(((left, low), (right, low), (right, high), (left, high)))
    rows = (
        ("in", ("left", "upper-left"), (near, low + 0.5 * height)),
        ("out", ("upper-left", "output"), (far, high - 0.5 * height)),
    )
    return Limb(
        bodies=(Body(name="upper-left", outline=link),),
        hinges=tuple(
            Hinge(name=f"upper-left-{end}", bodies=bodies, at=at, direction=0.0, profile=p.notch)
            for end, bodies, at in rows
        ),
        input_corner=((face, low + height + p.edge),),
        output_side=((side, low), (side, high)),
        top=high,
    )


TOPOLOGY = Topology(
    name="bridge",
    title="bridge amplifier with a guided output",
    source="J. Pokines, E. Garcia, Smart Materials and Structures 7 (1998) 105; N. Lobontiu, "
    "E. Garcia, Comput. Struct. 81 (2003) 2797",
    parameters=BridgeParameters,
    construct=bridge,
)
