"""Commands that a plan asks for, each by its kind: what moves how, and for how long."""

from flexstage.experiments.excitations.blows import Blows
from flexstage.experiments.excitations.corners import Corners
from flexstage.experiments.excitations.cycles import EqualCycles, Falling
from flexstage.experiments.excitations.designed import Designed
from flexstage.experiments.excitations.small_sines import Chirp, Multisine
from flexstage.experiments.excitations.staircase import BidirectionalTargets, Hold, RisingSteps
from flexstage.experiments.verbs.excite import Excite

#: Commands by their kind.
EXCITATIONS: dict[str, type[Excite]] = {
    made.kind: made
    for made in (
        EqualCycles, Falling, Designed, Multisine, Chirp, RisingSteps, Corners,
        BidirectionalTargets, Hold, Blows,
    )
}  # fmt: skip
