"""Commands that a plan asks for, each by its kind: what moves how, and for how long."""

from flexstage.plans.excite_base import Excite
from flexstage.plans.excite_loops import Cycles, Designed, Falling
from flexstage.plans.excite_places import Blows, Corners, Hold, Positioning, Staircase
from flexstage.plans.excite_sines import Chirp, Multisine

#: Commands by their kind.
EXCITATIONS: dict[str, type[Excite]] = {
    made.kind: made
    for made in (
        Cycles, Falling, Designed, Multisine, Chirp, Staircase, Corners, Positioning, Hold, Blows,
    )
}  # fmt: skip
