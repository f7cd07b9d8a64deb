"""What the functions of `flexstage.export` refuse in one sentence, called without a command."""

from collections.abc import Callable
from typing import Any

import pytest

from flexstage.base.errors import FlexstageError
from flexstage.export import (
    dxf_files,
    fmu_files,
    matlab_files,
    realtime_files,
    table_files,
    universal_files,
)
from flexstage.hysteresis import dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design

STAGE = design("parallelogram")
SYSTEM = lumped_system(STAGE)
MODEL = dynamic_model(STAGE, SYSTEM)
#: A word that the types of options exclude.
OTHER: Any = "other"


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: dxf_files(STAGE, kerf=0.0), "kerf must be positive and finite, got 0"),
        (lambda: dxf_files(STAGE, kerf=float("nan")), "kerf must be positive and finite, got nan"),
        (lambda: fmu_files(MODEL, version=OTHER), r"must be 2\.0 or 3\.0, got 'other'"),
        (lambda: matlab_files(STAGE, MODEL, name="2nd stage"), "must begin with a letter"),
        (lambda: matlab_files(STAGE, MODEL, name=""), "'' is not a valid name in MATLAB"),
        (lambda: realtime_files(MODEL, name="two stages"), "not a valid prefix of names in C"),
        (lambda: realtime_files(MODEL, precision=OTHER), "double or single, got 'other'"),
        (lambda: table_files((), name="s"), "no characteristics of 's'"),
        (lambda: universal_files(STAGE, SYSTEM, count=0), "must be 1 or more, got 0"),
    ],
)
def test_bad_values_are_refused(call: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(FlexstageError, match=sentence):
        call()
