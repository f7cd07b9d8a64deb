"""Models of built-in stages that take minutes, computed once in a run of the tests.

The first process that asks for one computes it, as a study does; the others read what it kept.
"""

from filelock import FileLock

from flexstage.files.cache import Memory, open_cache
from flexstage.stage.designs import design
from flexstage.studies.models import ModelRun, run_model
from flexstage.studies.requests import ModelOptions


def solved(name: str, model: str) -> ModelRun:
    """What a model makes of a built-in stage."""
    cache = open_cache(True)
    assert cache is not None
    cache.directory.mkdir(parents=True, exist_ok=True)
    with FileLock(cache.directory / f"{name}-{model}.lock"):
        return Memory(cache).recall(model, run_model, design(name), model, ModelOptions())
