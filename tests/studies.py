"""Studies of the built-in stages, made once in a test process; tests change nothing in them."""

import functools

from flexstage.designs import design
from flexstage.report import Study, run_study


@functools.cache
def study_of(name: str) -> Study:
    """The study of a built-in stage with the models that a study has by default."""
    return run_study(design(name))
