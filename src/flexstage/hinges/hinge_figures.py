"""Figures of a notch by every method."""

import contextlib
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from flexstage.base.choose import nearest
from flexstage.base.errors import HingeError
from flexstage.files.result import Result
from flexstage.hinges.closed_forms import closed_form_compliance, closed_forms
from flexstage.hinges.compliance import compliance
from flexstage.hinges.hinge_spring import plane_state
from flexstage.hinges.profile import Profile
from flexstage.hinges.registry import profile_class
from flexstage.hinges.requests import HingesRequest
from flexstage.hinges.stress import concentration, largest_rotation
from flexstage.quantities.material import Material
from flexstage.quantities.material import material as find_material
from flexstage.quantities.quantity import number

#: Quantity, place on the diagonal of the compliance, unit of its stiffness.
_QUANTITIES = (("axial", 0, "N/m"), ("shear", 1, "N/m"), ("rotation", 2, "N m/rad"))

_METHOD_VALIDITY = {
    "euler-bernoulli": "slender, and no shear deformation",
    "timoshenko": "slender: too stiff by 2 to 30 % as t/R grows",
    "wedge": "within 2 % of plane finite elements, 1.3 % in rotation",
    "finite-element": "plane finite elements of this notch, within 0.05 %",
}


def hinge_figures(
    notch: Profile, material: Material, width: float, plane: str = "auto"
) -> dict[str, Any]:
    """Return the figures of a notch, by every method, as plain data.

    `width` is the thickness of the plate. Everything is in SI units: sizes, ``stiffness`` (a row
    for each quantity and method), compliance, concentration of stress, largest rotation.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> from flexstage.quantities.material import material
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> rows = hinge_figures(notch, material("Al 7075-T6"), 10e-3)["stiffness"]
    >>> row = next(r for r in rows if (r["quantity"], r["method"]) == ("rotation", "wedge"))
    >>> round(row["stiffness"], 2)
    9.2
    """
    e, nu = material.youngs_modulus, material.poissons_ratio
    if plane not in ("auto", "stress", "strain"):
        raise HingeError(f"the plane state must be auto, stress or strain, got '{plane}'")
    state = plane_state(width, notch.neck_thickness, plane)
    methods = ["wedge", "timoshenko", "euler-bernoulli"]
    springs = {m: compliance(notch, e, nu, width, method=m, plane=state) for m in methods}
    # finite elements do without a neck that is too thin to mesh; the others have taken it
    with contextlib.suppress(HingeError):
        meshed = compliance(notch, e, nu, width, method="finite-element", plane=state)
        springs["finite-element"] = meshed
    best = springs["wedge"].matrix
    rows: list[dict[str, Any]] = []
    for quantity, place, unit in _QUANTITIES:
        stiffness_rows = [
            (method, float(springs[method].matrix[place, place]), _METHOD_VALIDITY[method])
            for method in springs
        ]
        stiffness_rows += [
            (
                form.name,
                closed_form_compliance(form, notch, e, nu, width, plane=state),
                form.validity,
            )
            for form in closed_forms(notch)
            if form.quantity == quantity
        ]
        rows += [
            {
                "quantity": quantity,
                "method": method,
                # a formula outside its range can give a compliance that no hinge has
                "stiffness": 1.0 / value if value > 0.0 else None,
                "unit": unit,
                "difference_percent": 100.0 * (float(best[place, place]) / value - 1.0)
                if value > 0.0
                else None,
                "validity": validity,
            }
            for method, value, validity in stiffness_rows
        ]
    factors = concentration(notch)
    turn = largest_rotation(notch, material, width, plane=state)
    sizes = {f.name: getattr(notch, f.name) for f in dataclasses.fields(notch)}
    return {
        "profile": notch.kind,
        **sizes,
        "width": width,
        "material": material.name,
        "plane": state,
        "root_height": notch.root_height,
        "stiffness": rows,
        "compliance": best.tolist(),
        "concentration": {
            "axial": list(factors.axial),
            "bending": list(factors.bending),
            "source": factors.source,
            "validity": factors.validity,
        },
        "largest_rotation": {
            "before_yield": turn.before_yield,
            "before_fatigue": turn.before_fatigue,
            "fatigue_cycles": material.fatigue_cycles,
            "unit": "rad",
        },
    }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class HingeFigures(Result):
    """A notch of a plate, and its figures by every method."""

    table_key: ClassVar[str] = "stiffness"

    profile: Profile
    """Contour."""
    material: Material
    """Material of the plate."""
    width: float
    """Width of the hinge [m]."""
    plane: str = "auto"
    """Plane state: ``stress``, ``strain``, or ``auto`` to choose by width against neck."""
    figures: Mapping[str, Any] = field(init=False)
    """Result of `hinge_figures`: plain data in SI units."""

    def __post_init__(self) -> None:
        figures = hinge_figures(self.profile, self.material, self.width, self.plane)
        object.__setattr__(self, "figures", figures)

    def data(self) -> dict[str, Any]:
        return dict(self.figures)

    def stiffness(self, quantity: str = "rotation", method: str = "wedge") -> float:
        """Return a stiffness about the neck: ``rotation`` [N m/rad], ``axial`` or ``shear`` [N/m].

        The method is ``wedge``, ``timoshenko``, ``euler-bernoulli``, ``finite-element``, or a
        closed form by its name.
        """
        rows = [row for row in self.figures["stiffness"] if row["stiffness"] is not None]
        methods = {row["method"]: row["stiffness"] for row in rows if row["quantity"] == quantity}
        if method not in methods:
            near = nearest(method, methods)
            hint = f"did you mean '{near}'?" if near else f"choose from {', '.join(methods)}"
            if not methods:
                hint = "the quantities are axial, shear and rotation"
            raise HingeError(f"there is no {quantity} stiffness by '{method}': {hint}")
        return methods[method]

    def __repr__(self) -> str:
        size = f"neck {1e3 * self.profile.neck_thickness:g} mm, width {1e3 * self.width:g} mm"
        return (
            f"{self.profile.kind} notch, {size}, {self.material.name}\n"
            f"  rotation {number(self.stiffness())} N m/rad, axial "
            f"{number(1e-6 * self.stiffness('axial'))} N/µm"
        )


#: Option and factor for each field of a profile; lengths along the hinge are total ones.
_SIZES = {
    "radius": "radius",
    "fillet_radius": "radius",
    "notch_length": "length",
    "leaf_length": "length",
    "half_length": "length",
    "notch_depth": "depth",
    "half_opening_angle": "half_angle",
    "exponent": "exponent",
}


def notch_of(request: HingesRequest) -> HingeFigures:
    """Return the requested notch.

    Examples
    --------
    >>> notch = notch_of(HingesRequest(profile="leaf", length=6e-3, depth=1e-3))
    >>> notch.to_dict()["leaf_length"], round(notch.stiffness(), 2)
    (0.006, 1.31)
    """
    names = dict.fromkeys(_SIZES.values())
    if request.profile == "circular" and all(getattr(request, name) is None for name in names):
        request = dataclasses.replace(request, radius=1e-3)
    return HingeFigures(
        request=request,
        profile=_notch(request),
        material=find_material(request.material),
        width=request.width,
        plane=request.plane,
    )


def _notch(request: HingesRequest) -> Profile:
    """Build the profile; refuse missing and surplus dimensions by name."""
    kind = request.profile
    cls = profile_class(kind)
    if kind == "as-drawn":
        raise HingeError("an as-drawn notch needs a contour, which only a stage file can contain")
    options = {name: f"--{name.replace('_', '-')}" for name in _SIZES.values()}
    sizes = {name: getattr(request, name) for name in options}
    options_of_fields = {
        f.name: _SIZES[f.name] for f in dataclasses.fields(cls) if f.name in _SIZES
    }
    missing = [options[name] for name in options_of_fields.values() if sizes[name] is None]
    if missing:
        raise HingeError(f"a {kind} notch also needs {' and '.join(missing)}")
    surplus = [
        options[name]
        for name, value in sizes.items()
        if value is not None and name not in options_of_fields.values()
    ]
    if surplus:
        takes = " ".join(options[name] for name in options_of_fields.values())
        raise HingeError(f"a {kind} notch has no {' or '.join(surplus)}: it takes {takes}")
    values = {
        field: 0.5 * sizes[name] if field == "half_length" else sizes[name]
        for field, name in options_of_fields.items()
    }
    return cls(neck_thickness=request.neck, one_sided=request.one_sided, **values)
