"""Notch profiles and their stiffness."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.hinges.as_drawn import AsDrawn
    from flexstage.hinges.circular import RightCircular
    from flexstage.hinges.closed_forms import (
        CLOSED_FORMS,
        closed_form_compliance,
        closed_forms,
    )
    from flexstage.hinges.compliance import compliance
    from flexstage.hinges.corner_filleted import CornerFilleted
    from flexstage.hinges.elliptical import Elliptical
    from flexstage.hinges.hinge_spring import HingeCompliance, plane_state
    from flexstage.hinges.hyperbolic import Hyperbolic
    from flexstage.hinges.leaf import Leaf
    from flexstage.hinges.parabolic import Parabolic
    from flexstage.hinges.power import PowerFunction
    from flexstage.hinges.profile import CurvedProfile, Profile, Samples
    from flexstage.hinges.registry import PROFILES
    from flexstage.hinges.stress import concentration, largest_rotation, stress_rows
    from flexstage.hinges.v_fillet import VFillet

__all__ = [
    "CLOSED_FORMS",
    "PROFILES",
    "AsDrawn",
    "CornerFilleted",
    "CurvedProfile",
    "Elliptical",
    "HingeCompliance",
    "Hyperbolic",
    "Leaf",
    "Parabolic",
    "PowerFunction",
    "Profile",
    "RightCircular",
    "Samples",
    "VFillet",
    "closed_form_compliance",
    "closed_forms",
    "compliance",
    "concentration",
    "largest_rotation",
    "plane_state",
    "stress_rows",
]

import_on_use(__name__)
