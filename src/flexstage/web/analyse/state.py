"""What is open in the view Analyse: models, what is asked of them and found, what is shown."""

from collections import OrderedDict
from dataclasses import dataclass, field

from flexstage.studies.requests import ModelOptions
from flexstage.system.mechanical import DriveCondition
from flexstage.web.analyse.work import ModelResult
from flexstage.web.design.state import Variant
from flexstage.web.jobs import BackgroundJob

Key = tuple[Variant, str]


@dataclass
class Shown:
    """What of the results is shown."""

    part: str = "Shapes"
    """The part of the results that is open."""
    folds: dict[str, bool] = field(default_factory=dict)
    """Which folded parts are open, by title."""
    model: str = ""
    """The model whose shapes are shown."""
    state: str = ""
    """The state that is shown: a static one by its axis, a mode by its number."""
    drives: DriveCondition = "removed"
    """Condition of the drives of the modes."""
    colour: str = "stress"
    """What colours a static state: ``stress`` or ``displacement``."""
    pair: tuple[str, str] | None = None
    """Drive and probe of the Bode diagram."""
    bode_drives: DriveCondition = "in place"
    """Condition of the drives of the Bode diagram."""
    cursors: list[float] = field(default_factory=list)
    """Frequencies of its two cursors [Hz]."""


@dataclass
class AnalyseState:
    """What one person has open in the view Analyse."""

    chosen: list[str] = field(default_factory=lambda: ["lumped", "superelement"])
    """Models that are chosen."""
    asked: ModelOptions = ModelOptions()
    """What is asked of them, each of which takes what it can."""
    fields: bool = False
    """Whether fields for ParaView are written."""
    shown: Shown = field(default_factory=Shown)
    """What of the results is shown."""
    jobs: dict[Key, BackgroundJob] = field(default_factory=dict)
    """What is being computed."""
    failed: dict[Key, str] = field(default_factory=dict)
    """Why a model gave nothing, in a sentence."""
    revision: int = 0
    """Counts what has come, so that each page of a browser sees that something did."""
    _found: OrderedDict[Key, ModelResult] = field(default_factory=OrderedDict)

    def found(self, variant: Variant, model: str) -> ModelResult | None:
        """Return what a model found of a variant, if anything."""
        return self._found.get((variant, model))

    def take(self) -> None:
        """Take what has come of jobs that are over."""
        over = [key for key, job in self.jobs.items() if job.is_over]
        for key in over:
            job = self.jobs.pop(key)
            self.failed.pop(key, None)
            if job.state == "done":
                # what is kept here need not be kept there
                self._found[key], job.result = job.result, None
                self._found.move_to_end(key)
            elif job.state == "failed":
                self.failed[key] = job.error
        while len(self._found) > 20:  # with their pictures some MB each
            self._found.popitem(last=False)
        self.revision += len(over)
