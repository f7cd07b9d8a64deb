"""Profiles by the name that files and the command line call them by."""

from flexstage.choose import unknown
from flexstage.errors import HingeError
from flexstage.hinges.as_drawn import AsDrawn
from flexstage.hinges.circular import RightCircular
from flexstage.hinges.corner_filleted import CornerFilleted
from flexstage.hinges.elliptical import Elliptical
from flexstage.hinges.hyperbolic import Hyperbolic
from flexstage.hinges.leaf import Leaf
from flexstage.hinges.parabolic import Parabolic
from flexstage.hinges.power import PowerFunction
from flexstage.hinges.profile import Profile
from flexstage.hinges.v_fillet import VFillet

#: Every profile by its `kind`.
PROFILES: dict[str, type[Profile]] = {
    cls.kind: cls
    for cls in (
        RightCircular,
        Elliptical,
        CornerFilleted,
        Leaf,
        Parabolic,
        Hyperbolic,
        VFillet,
        PowerFunction,
        AsDrawn,
    )
}


def profile_class(kind: str) -> type[Profile]:
    """Look a profile up by its kind.

    Examples
    --------
    >>> profile_class("leaf").__name__
    'Leaf'
    """
    if kind not in PROFILES:
        raise HingeError(unknown("profile", kind, PROFILES))
    return PROFILES[kind]
