"""What of a stage is to be found from measurements, and the stage that has it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Literal

from flexstage.errors import ModelError
from flexstage.hinges.other_notch import with_neck_thickness
from flexstage.stage import Hinge, Stage

Kind = Literal["neck_factor", "neck_offset", "modulus_factor", "density_factor", "damping_ratio"]
#: Kinds of parameters: the unit, and the expectation where none is given.
PARAMETER_KINDS: dict[str, tuple[str, float | None]] = {
    "neck_factor": ("1", 1.0),
    "neck_offset": ("m", 0.0),
    "modulus_factor": ("1", 1.0),
    "density_factor": ("1", 1.0),
    "damping_ratio": ("1", None),
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
    Young's modulus or of the density, or the damping ratio of all modes.
    """
    spread: float
    """Standard deviation of what is known before [1], of an offset [m]: the scatter of the machine,
    of the alloy.
    """
    hinges: tuple[str, ...] = ("*",)
    """Patterns of the names of the hinges that it is for, as ``xgp*``; all where not given."""
    expected: float | None = None
    """What is expected before; 1 of a factor, 0 of an offset. A damping ratio needs it."""

    def __post_init__(self) -> None:
        if self.kind not in PARAMETER_KINDS:
            raise ModelError(
                f"parameter '{self.name}': unknown kind {self.kind!r}: expected one of "
                f"{', '.join(PARAMETER_KINDS)}"
            )
        if not 0.0 < self.spread < math.inf:
            raise ModelError(
                f"parameter '{self.name}': the spread must be positive and finite, got "
                f"{self.spread!r}"
            )
        if self.expected is None and self.kind == "damping_ratio":
            raise ModelError(f"parameter '{self.name}': say which damping ratio is expected")
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
        usual = PARAMETER_KINDS[self.kind][1]
        return self.expected if self.expected is not None else float(usual or 0.0)

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
        The same bodies with these necks and this material; a damping ratio is no part of a stage.

    Raises
    ------
    HingeError
        A neck is impossible.
    StageError
        The material is.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> thin = UpdateParameter(name="necks", kind="neck_factor", spread=0.02)
    >>> other = stage_with(design("parallelogram"), [thin], {"necks": 0.96})
    >>> round(other.hinges[0].profile.neck_thickness * 1e3, 6)
    0.48
    """
    modulus, density = stage.material.youngs_modulus, stage.material.density
    for p in parameters:
        if p.kind == "modulus_factor":
            modulus *= values[p.name]
        elif p.kind == "density_factor":
            density *= values[p.name]
    return replace(
        stage,
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
