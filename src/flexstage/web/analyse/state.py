"""State of the view Analyse in one browser: models, options, results and display."""

from collections import OrderedDict
from dataclasses import dataclass, field

from flexstage.studies.requests import ModelOptions
from flexstage.system.mechanical import DriveCondition
from flexstage.web.analyse.work import ModelResult, NoiseResult
from flexstage.web.design.state import Variant
from flexstage.web.jobs import BackgroundJob

Key = tuple[Variant, str]


@dataclass
class Display:
    """Displayed part of the results."""

    part: str = "Shapes"
    """Open tab."""
    folds: dict[str, bool] = field(default_factory=dict)
    """Open folded sections, by title."""
    model: str = ""
    """Model of the displayed shapes."""
    state: str = ""
    """Displayed state: a static one by its axis, a mode by its number."""
    drives: DriveCondition = "removed"
    """Condition of the drives of the modes."""
    colour: str = "stress"
    """Quantity of the colours of a static state: ``stress`` or ``displacement``."""
    pair: tuple[str, str] | None = None
    """Drive and probe of the Bode diagram."""
    bode_drives: DriveCondition = "in place"
    """Condition of the drives of the Bode diagram."""
    cursors: list[float] = field(default_factory=list)
    """Frequencies of its two cursors [Hz]."""


@dataclass
class AnalyseState:
    """State of the view Analyse in one browser."""

    selected_models: list[str] = field(default_factory=lambda: ["lumped", "superelement"])
    """Selected models."""
    options: ModelOptions = ModelOptions()
    """Options of the models; each model uses those that it supports."""
    fields: bool = False
    """Write fields for ParaView."""
    display: Display = field(default_factory=Display)
    """Displayed part of the results."""
    environments: dict[str, str] = field(default_factory=dict)
    """Text of the environment of a stage, by its name."""
    loops: str = ""
    """Loops to compare, separated by commas."""
    noise_model: str = "lumped"
    """Model of the noise."""
    noise: dict[Variant, NoiseResult] = field(default_factory=dict)
    """Noise of the last stage."""
    jobs: dict[Key, BackgroundJob] = field(default_factory=dict)
    """Running jobs."""
    errors: dict[Key, str] = field(default_factory=dict)
    """Messages of failed models."""
    revision: int = 0
    """Number of finished jobs, by which each page of a browser notices a change."""
    _results: OrderedDict[Key, ModelResult] = field(default_factory=OrderedDict)

    def result(self, variant: Variant, model: str) -> ModelResult | None:
        """Return the result of a model for a variant, or None."""
        return self._results.get((variant, model))

    def collect(self) -> None:
        """Collect the results of finished jobs."""
        finished = [key for key, job in self.jobs.items() if job.is_over]
        for key in finished:
            job = self.jobs.pop(key)
            self.errors.pop(key, None)
            if job.state == "done":
                # the job need not keep the result
                self._results[key], job.result = job.result, None
                self._results.move_to_end(key)
            elif job.state == "failed":
                self.errors[key] = job.error
        while len(self._results) > 20:  # a few MB each, with their pictures
            self._results.popitem(last=False)
        self.revision += len(finished)
