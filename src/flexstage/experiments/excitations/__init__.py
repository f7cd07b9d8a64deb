"""Commands that a plan asks for, each by its kind: what moves how, and for how long."""

from flexstage.experiments.excitations.cycles import Designed, EqualCycles, Falling
from flexstage.experiments.excitations.responses import Blows, Chirp, Multisine
from flexstage.experiments.excitations.rests import (
    BidirectionalTargets,
    Corners,
    Hold,
    RisingSteps,
)
from flexstage.experiments.verbs.excite import Excite

#: Commands by their kind.
EXCITATIONS: dict[str, type[Excite]] = {
    made.kind: made
    for made in (
        EqualCycles, Falling, Designed, Multisine, Chirp, RisingSteps, Corners,
        BidirectionalTargets, Hold, Blows,
    )
}  # fmt: skip
