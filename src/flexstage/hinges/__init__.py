"""Notch profiles and their stiffness."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.hinges.circular import RightCircular
    from flexstage.hinges.closed_forms import (
        CLOSED_FORMS,
        ClosedForm,
        closed_form_compliance,
        closed_forms,
    )
    from flexstage.hinges.compliance import (
        METHODS,
        HingeCompliance,
        PlaneState,
        compliance,
        plane_moduli,
        plane_state,
    )
    from flexstage.hinges.concentration import Concentration, concentration
    from flexstage.hinges.corner_filleted import CornerFilleted
    from flexstage.hinges.elliptical import Elliptical
    from flexstage.hinges.hinge_figures import hinge_figures
    from flexstage.hinges.hyperbolic import Hyperbolic
    from flexstage.hinges.leaf import Leaf
    from flexstage.hinges.parabolic import Parabolic
    from flexstage.hinges.power import PowerFunction
    from flexstage.hinges.profile import Piece, Profile, Samples, Vertex
    from flexstage.hinges.registry import PROFILES, profile_class
    from flexstage.hinges.stress import LargestRotation, largest_rotation, stress_rows
    from flexstage.hinges.v_fillet import VFillet

__all__ = [
    "CLOSED_FORMS",
    "METHODS",
    "PROFILES",
    "ClosedForm",
    "Concentration",
    "CornerFilleted",
    "Elliptical",
    "HingeCompliance",
    "Hyperbolic",
    "LargestRotation",
    "Leaf",
    "Parabolic",
    "Piece",
    "PlaneState",
    "PowerFunction",
    "Profile",
    "RightCircular",
    "Samples",
    "VFillet",
    "Vertex",
    "closed_form_compliance",
    "closed_forms",
    "compliance",
    "concentration",
    "hinge_figures",
    "largest_rotation",
    "plane_moduli",
    "plane_state",
    "profile_class",
    "stress_rows",
]

import_on_use(__name__)
