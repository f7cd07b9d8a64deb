"""Levers in a row, each pushed by the one before it, and a guided output, as a family of stages."""

import math
from itertools import pairwise

from flexstage.designs.lever_chain_layout import LeverChainLayout, LeverChainParameters
from flexstage.designs.pieces import Leg, block
from flexstage.designs.topology import Topology
from flexstage.stage import Axis, Body, Hinge, Probe, Stage
from flexstage.stage.drive import placed


def lever_chain(parameters: LeverChainParameters | None = None) -> Stage:
    r"""Build a chain of levers.

    The levers lie above one another, their fulcrums in turn on the left and on the right. The
    drive pushes the first from below, each pushes the next through a *link* with two notches, and
    the last the *output*, which four leaves guide along y. y = 0 is the lower side of the first
    lever, x = 0 its fulcrum::

           =====|   output   |=====         guide
                      )(
                      ||      link-2      __ base
                     _)(_________________)(__
                    |        lever-2         |
                            base  )(
                           ___    ||   link-1
                       ____)(_____)(__
                      |    lever-1    |
                              ^ drive

    Its bodies are ``base`` (fixed), ``lever-1``, ``link-1-leg`` and so on, and ``output``; drive,
    probe and axis are called ``y``.

    Notes
    -----
    With pins for necks the ratio is the product of the ratios of the arms, :math:`\prod b_k/a_k`.
    Necks stretch under what it takes to turn them and to bend the guide. With :math:`k_{k+1}` for
    the stiffness against which lever k pushes, and :math:`K_k` for that of its output with its
    input held, what is left is

    .. math:: R = \prod_k \frac{b_k/a_k}{1 + k_{k+1}/K_k}

    (M. Ling, J. Cao, Z. Jiang, J. Lin, Sens. Actuators A 249 (2016) 15; the losses of one lever are
    those of M. Y. Jouaneh, R. Yang, Precis. Eng. 27 (2003) 407).

    Validity: small motion, rigid bodies; levers that bend, and ground that gives at the fulcrums,
    take more than the necks where arms are as short as the bodies are high.

    Examples
    --------
    >>> stage = lever_chain()
    >>> len(stage.bodies), len(stage.hinges)
    (6, 10)
    """
    p = parameters or LeverChainParameters()
    places = LeverChainLayout(p)
    bodies: list[Body] = []
    hinges: list[Hinge] = []
    names = [f"lever-{k}" for k in range(1, len(p.levers) + 1)]
    link = Leg(notch=p.notch, bar_length=p.link_bar_length)
    for k, (name, target) in enumerate(pairwise([*names, "output"])):
        low, (left, right) = places.height(k), places.span(k)
        bodies.append(block(name, (left, low), (right, low + p.lever_height)))
        head = low + p.lever_height
        hinges.append(
            Hinge(
                name=f"fulcrum-{k + 1}",
                bodies=(name, "base"),
                at=(places.fulcrums[k], head + 0.5 * p.notch.length),
                direction=0.5 * math.pi,
                profile=p.notch,
            )
        )
        bars, notches = link.between(
            f"link-{k + 1}",
            (name, target),
            (places.outputs[k], head),
            0.5 * math.pi,
            ends=("in", "out"),
        )
        bodies += bars
        hinges += notches
    output, guides = places.output()
    top = (places.outputs[-1], places.top)
    return Stage(
        name="lever-chain",
        title="Chain of levers with a guided output",
        thickness=p.thickness,
        material=p.material,
        bodies=(places.base(), *bodies, *output),
        hinges=(*hinges, *guides),
        drives=(
            placed(
                p.actuator,
                name="y",
                pushes="lever-1",
                reacts="base",
                at=((places.inputs[0], 0.0), (places.inputs[0], -p.actuator_length)),
                direction=0.5 * math.pi,
                patch_half_width=p.force_patch_half_width,
            ),
        ),
        probes=(Probe(name="y", body="output", at=top, direction=0.5 * math.pi),),
        axes=(Axis(name="y", drive="y", probe="y"),),
    )


TOPOLOGY = Topology(
    name="lever-chain",
    title="levers in a row with a guided output",
    source="M. Y. Jouaneh, R. Yang, Precis. Eng. 27 (2003) 407",
    parameters=LeverChainParameters,
    construct=lever_chain,
)
