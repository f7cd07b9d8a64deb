"""Requests of analyses and studies of a stage."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from flexstage.files.ranges import INNER_SHARE, Seed, Written
from flexstage.files.request import Request
from flexstage.hinges.requests import Plane
from flexstage.stage.bench import Bench
from flexstage.system.requests import ModelName, ModelNames

if TYPE_CHECKING:
    from flexstage.files.cache.cache import Cache
    from flexstage.stage import Stage
else:  # their classes need NumPy, which the help of a command does not import
    Cache = Stage = object

#: Parts of a study in addition to the models of a stage.
StudyPart = Literal["identification", "virtual", "traditional", "none"]
ALL_PARTS: tuple[StudyPart, ...] = ("identification", "virtual", "traditional")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelOptions(Request):
    """Options of a model."""

    plane: Plane = "auto"
    """Plane state of the notches."""
    accuracy: Annotated[float, INNER_SHARE, Written("SHARE")] | None = None
    """Refine the mesh of the plane or solid model until --quantity changes by less than this share,
    such as 0.1%.
    """
    quantity: Annotated[str, Written("NAME")] = "natural_frequency_hz"
    """Quantity for --accuracy, such as max_stress."""
    estimate: bool = False
    """Estimate the error of each figure, with bodies of a lower order and with more modes
    (superelement models; doubles the time of the first analysis).
    """
    supports: Literal["rigid", "elastic"] = "rigid"
    """Rigid or elastic frame under the reactions of the drives (all models except lumped)."""
    stroke: bool = False
    """Compute each axis over its stroke with large displacements (plane model): straightness,
    stiffening, buckling.
    """
    bench: Bench | None = None
    """Base plate and sensor holder, for the thermal drift with the drives in place, instead of
    those of the stage file: "base=aluminium,holder=invar,holder_length=60 mm".
    """
    cache: Cache | bool = field(default=True, compare=False)
    """Cache of condensed bodies of superelements, True for the user's cache."""
    near: Stage | None = field(default=None, compare=False)
    """A similar stage, whose superelements are reused for equal bodies."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AnalyseRequest(Request):
    """Analysis of a stage by one or several models."""

    model: ModelNames = ("superelement",)
    """Models, separated by commas, or all."""
    options: ModelOptions = ModelOptions()
    """Options of each model."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRequest(Request):
    """Study: models of a stage compared with published values."""

    model: ModelNames = ("lumped", "superelement", "plane", "superelement-3d")
    """Models, separated by commas, or all."""
    plane: Plane = "auto"
    """Plane state of the notches."""
    parts: Annotated[tuple[StudyPart, ...], Written("NAMES", commas=True)] = ALL_PARTS
    """Further parts, separated by commas: identification (identify and compensate the hysteresis of
    piezo drives on a simulated stage), virtual (simulate measurements of the stage, and the
    centring of an encoder scale), traditional (compare motion errors and drift of a stage of the
    study with those of traditional stages); or none.
    """
    seed: Seed = 1
    """Random seed of the simulated stage, and of manufactured samples."""

    @classmethod
    def of_models(cls, *model: ModelName) -> "StudyRequest":
        """Return a study of models without further parts."""
        return cls(model=model, parts=("none",))


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonRequest(Request):
    """Comparison of measurements of a stage with models and published values."""

    model: ModelNames = ("lumped", "superelement")
    """Models, separated by commas, or all."""
