"""Excitations of a plan by their kind, and the record that identifies an axis of a stage."""

from flexstage.experiments.excitations.continuous import (
    Chirp,
    DescendingLoops,
    Designed,
    EqualCycles,
    HammerImpacts,
    Multisine,
    excitation_of,
)
from flexstage.experiments.excitations.stepwise import (
    BidirectionalTargets,
    Dwell,
    RisingSteps,
    WorkspaceCorners,
)
from flexstage.experiments.verbs.excite import Excite

__all__ = ["EXCITATIONS", "excitation_of"]

#: Excitations by their kind.
EXCITATIONS: dict[str, type[Excite]] = {
    excitation.kind: excitation
    for excitation in (
        EqualCycles, DescendingLoops, Designed, Multisine, Chirp, RisingSteps, WorkspaceCorners,
        BidirectionalTargets, Dwell, HammerImpacts,
    )
}  # fmt: skip
