"""Parameters of a stage that are fitted to measured figures."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Literal

from flexstage.base.errors import ModelError
from flexstage.hinges.registry import with_neck_thickness
from flexstage.stage import ExtraMass, Hinge, Stage, mass_properties
from flexstage.stage.seat import TipSeat

Kind = Literal[
    "neck_factor",
    "neck_offset",
    "modulus_factor",
    "density_factor",
    "damping_ratio",
    "added_mass",
    "seat_stiffness",
]
#: Kinds of parameters: the unit, and the expectation where none is given.
PARAMETER_KINDS: dict[str, tuple[str, float | None]] = {
    "neck_factor": ("1", 1.0),
    "neck_offset": ("m", 0.0),
    "modulus_factor": ("1", 1.0),
    "density_factor": ("1", 1.0),
    "damping_ratio": ("1", None),
    "added_mass": ("kg", None),
    "seat_stiffness": ("N/m", None),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateParameter:
    """A parameter of a stage that measurements are to tell, and what is known of it before.

    Raises
    ------
    ModelError
        The kind is unknown, or a figure is impossible.

    Examples
    --------
    >>> legs = UpdateParameter(name="legs", kind="neck_offset", spread=8e-6, hinges=("xg*",))
    >>> legs.unit, legs.mean
    ('m', 0.0)
    """

    name: str
    """Its name."""
    kind: Kind
    """One of `PARAMETER_KINDS`: a factor of neck thicknesses or what is added to them, a factor of
    Young's modulus or of the density, the damping ratio of all modes, a mass at the centre of
    mass of a body, or the stiffness of the seat of a drive against small vibrations.
    """
    spread: float = math.nan
    """Standard deviation of what is known before [1], of an offset [m], of a mass [kg]: the scatter
    of the machine, of the alloy. A seat has limits instead.
    """
    hinges: tuple[str, ...] = ("*",)
    """Patterns of the names of the hinges that it is for, as ``xgp*``; all where not given."""
    expected: float | None = None
    """What is expected before; 1 of a factor, 0 of an offset. Damping ratio and mass need it."""
    body: str = ""
    """Name of the body that a mass is added to."""
    drive: str = ""
    """Name of the drive that has the seat."""
    limits: tuple[float, float] | None = None
    """Least and largest stiffness of a seat [N/m]; before, each ratio between them is as likely."""

    def __post_init__(self) -> None:
        if self.kind not in PARAMETER_KINDS:
            raise ModelError(
                f"parameter '{self.name}': unknown kind {self.kind!r}: expected one of "
                f"{', '.join(PARAMETER_KINDS)}"
            )
        if self.kind == "seat_stiffness":
            if self.limits is None or not 0.0 < self.limits[0] < self.limits[1] < math.inf:
                raise ModelError(
                    f"parameter '{self.name}': the stiffness of a seat needs limits, positive and "
                    f"rising, got {self.limits!r}"
                )
            if self.expected is not None:
                raise ModelError(
                    f"parameter '{self.name}': nothing but its limits is expected of a seat"
                )
            return
        if self.limits is not None:
            raise ModelError(f"parameter '{self.name}': only the stiffness of a seat has limits")
        if not 0.0 < self.spread < math.inf:
            raise ModelError(
                f"parameter '{self.name}': the spread must be positive and finite, got "
                f"{self.spread!r}"
            )
        if self.expected is None and self.kind == "damping_ratio":
            raise ModelError(f"parameter '{self.name}': say which damping ratio is expected")
        if self.kind == "added_mass" and not (self.expected or 0.0) > 0.0:
            raise ModelError(
                f"parameter '{self.name}': say which mass is expected, above 0, got "
                f"{self.expected!r}"
            )
        if self.expected is not None and not math.isfinite(self.expected):
            raise ModelError(
                f"parameter '{self.name}': what is expected must be finite, got {self.expected!r}"
            )

    @property
    def unit(self) -> str:
        """Unit of its value."""
        return PARAMETER_KINDS[self.kind][0]

    @property
    def mean(self) -> float:
        """What is expected of it before."""
        if self.limits is not None:
            return math.sqrt(self.limits[0] * self.limits[1])
        usual = PARAMETER_KINDS[self.kind][1]
        return self.expected if self.expected is not None else float(usual or 0.0)

    def value_at(self, x: float) -> float:
        """Return its value at a coordinate x that is normal, of mean 0 and deviation 1, before."""
        if self.limits is None:
            return self.mean + self.spread * x
        from scipy.special import ndtr

        low, high = self.limits
        return low * (high / low) ** float(ndtr(x))

    def coordinate_of(self, value: float) -> float:
        """Return the coordinate at which it has a value."""
        if self.limits is None:
            return (value - self.mean) / self.spread
        from scipy.special import ndtri

        low, high = self.limits
        return float(ndtri(math.log(value / low) / math.log(high / low)))

    def slope_at(self, x: float) -> float:
        """Return the derivative of its value there, its local standard deviation before."""
        if self.limits is None:
            return self.spread
        density = math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)
        return self.value_at(x) * math.log(self.limits[1] / self.limits[0]) * density

    def holds(self, hinge: str) -> bool:
        """Say whether it is for a hinge of this name: whether one of its patterns fits."""
        return any(fnmatchcase(hinge, pattern) for pattern in self.hinges)


def stage_with(
    stage: Stage, parameters: Sequence[UpdateParameter], values: Mapping[str, float]
) -> Stage:
    """Return a stage with other values of parameters.

    Parameters
    ----------
    stage : Stage
        The stage as it was described.
    parameters : sequence of UpdateParameter
        The parameters; where several are for one hinge, factors come before offsets.
    values : Mapping
        Value of each parameter by its name.

    Returns
    -------
    Stage
        The same bodies with these necks, masses, seats and this material; a damping ratio is no
        part of a stage, and a body of another material than the plate keeps its own.

    Raises
    ------
    HingeError
        A neck is impossible.
    StageError
        The material is.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> thin = UpdateParameter(name="necks", kind="neck_factor", spread=0.02)
    >>> other = stage_with(design("parallelogram"), [thin], {"necks": 0.96})
    >>> round(other.hinges[0].profile.neck_thickness * 1e3, 6)
    0.48
    """
    modulus, density = stage.material.youngs_modulus, stage.material.density
    bodies, drives = stage.bodies, stage.drives
    for p in parameters:
        value = values[p.name]
        if p.kind == "modulus_factor":
            modulus *= value
        elif p.kind == "density_factor":
            density *= value
        elif p.kind == "added_mass":
            mass = ExtraMass(mass=value, at=mass_properties(stage)[p.body].centre)
            bodies = tuple(
                replace(b, extra_masses=(*b.extra_masses, mass)) if b.name == p.body else b
                for b in bodies
            )
        elif p.kind == "seat_stiffness":
            seats = (TipSeat(axial_stiffness=value),)
            drives = tuple(replace(d, seats=seats) if d.name == p.drive else d for d in drives)
    return replace(
        stage,
        bodies=bodies,
        drives=drives,
        material=replace(stage.material, youngs_modulus=modulus, density=density),
        hinges=tuple(_hinge(h, parameters, values) for h in stage.hinges),
    )


def _hinge(
    hinge: Hinge, parameters: Sequence[UpdateParameter], values: Mapping[str, float]
) -> Hinge:
    thickness = hinge.profile.neck_thickness
    for p in parameters:
        if p.kind == "neck_factor" and p.holds(hinge.name):
            thickness *= values[p.name]
    for p in parameters:
        if p.kind == "neck_offset" and p.holds(hinge.name):
            thickness += values[p.name]
    return replace(hinge, profile=with_neck_thickness(hinge.profile, thickness))
