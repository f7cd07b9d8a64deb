"""Notch profiles and their stiffness."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.hinges.as_drawn import AsDrawn
    from flexstage.hinges.closed_forms import (
        CLOSED_FORMS,
        closed_form_compliance,
        closed_forms,
    )
    from flexstage.hinges.compliance import compliance
    from flexstage.hinges.conic import (
        Elliptical,
        Hyperbolic,
        Parabolic,
        PowerFunction,
        RightCircular,
    )
    from flexstage.hinges.hinge_spring import HingeCompliance, plane_state
    from flexstage.hinges.profile import CurvedProfile, Profile, Samples
    from flexstage.hinges.registry import PROFILES
    from flexstage.hinges.straight import CornerFilleted, Leaf, VFillet
    from flexstage.hinges.stress import concentration, largest_rotation, stress_rows

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
