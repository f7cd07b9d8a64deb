"""What is asked of the models of a stage, one or several."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from flexstage.files.ranges import INNER_SHARE, Seed, Written
from flexstage.files.request import Request
from flexstage.hinges.requests import Plane
from flexstage.system.requests import ModelName, ModelNames

if TYPE_CHECKING:
    from flexstage.files.cache.cache import Cache
    from flexstage.stage import Stage
else:  # a command reads texts; their classes need NumPy
    Cache = Stage = object

#: What a study does beside the models of a stage.
StudyPart = Literal["identification", "virtual", "traditional", "none"]
ALL_PARTS: tuple[StudyPart, ...] = ("identification", "virtual", "traditional")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelOptions(Request):
    """What is asked of a model beyond its stage."""

    plane: Plane = "auto"
    """Plane state of the notches."""
    accuracy: Annotated[float, INNER_SHARE, Written("SHARE")] | None = None
    """Refine the mesh of the plane or solid model until --quantity changes by less than this share,
    such as 0.1%.
    """
    quantity: Annotated[str, Written("NAME")] = "natural_frequency_hz"
    """Quantity that --accuracy refers to, such as max_stress."""
    estimate: bool = False
    """Estimate the error of each figure, by bodies of a lower order and with more modes
    (superelement models; the first analysis takes twice as long).
    """
    supports: Literal["rigid", "elastic"] = "rigid"
    """Rigid or elastic frame under the reactions of the drives (all models but the lumped one)."""
    stroke: bool = False
    """Compute each axis over its stroke with large displacements (plane model): straightness,
    stiffening, buckling.
    """
    cache: Cache | bool = field(default=True, compare=False)
    """Where condensed bodies of superelements are kept, True for the user's cache."""
    near: Stage | None = field(default=None, compare=False)
    """A stage that differs little, whose superelements serve: only what differs is computed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AnalyseRequest(Request):
    """An analysis: a stage by one model or several."""

    model: ModelNames = ("superelement",)
    """Models with commas between, or all."""
    options: ModelOptions = ModelOptions()
    """What is asked of each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRequest(Request):
    """A study: models of a stage beside what was published of it."""

    model: ModelNames = ("lumped", "superelement", "plane", "superelement-3d")
    """Models with commas between, or all."""
    plane: Plane = "auto"
    """Plane state of the notches."""
    parts: Annotated[tuple[StudyPart, ...], Written("NAMES", commas=True)] = ALL_PARTS
    """What is done beside the models, with commas between: identification (identify and compensate
    the hysteresis of piezo drives on a simulated stage), virtual (simulate measurements of the
    stage, and centring an encoder scale with it), traditional (set motion errors and drift of a
    stage of the study against those of traditional stages); or none.
    """
    seed: Seed = 1
    """Random seed of the simulated stage, and of stages as they are made."""

    @classmethod
    def of_models(cls, *model: ModelName) -> "StudyRequest":
        """Return a study of some models, and nothing beside them."""
        return cls(model=model, parts=("none",))


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonRequest(Request):
    """What measurements of a stage are compared with, beside what was published of it."""

    model: ModelNames = ("lumped", "superelement")
    """Models with commas between, or all."""
