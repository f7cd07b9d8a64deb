"""What a range in the type of a field holds, and what is said of a value outside it."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import pytest

from flexstage.base.errors import StageError
from flexstage.files.ranges import INNER_SHARE, NOT_NEGATIVE, POSITIVE, Range, require_ranges


@dataclass(frozen=True, kw_only=True)
class Thing:
    size: Annotated[float, POSITIVE] = 0.7
    mass: Annotated[float, NOT_NEGATIVE] = 0.0
    offset: Annotated[float, Range()] = -3.1
    share: Annotated[float, INNER_SHARE] = 0.3
    speed: Annotated[float, Range(low=2.0, high=5.0, above=True)] | None = None
    rate: Annotated[float, Range(low=2.0, high=5.0, below=True)] = 2.0
    count: Annotated[int, Range(low=1, high=9)] = 9
    band: Annotated[tuple[float, float], NOT_NEGATIVE] = (0.0, 4.0)
    rates: tuple[Annotated[float, POSITIVE], ...] = ()
    word: Literal["here", "there"] = "here"


def test_what_a_type_allows_passes():
    require_ranges(Thing(), StageError, "it")
    require_ranges(Thing(speed=5.0, rate=4.9, count=1, rates=(1e-9, 1e9)), StageError, "it")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"size": 0.0}, "size of it must be above 0, got 0"),
        ({"size": math.inf}, "size of it must be above 0, got inf"),
        ({"size": math.nan}, "size of it must be above 0, got nan"),
        ({"mass": -1e-9}, "mass of it must be not below 0, got -1e-09"),
        ({"offset": -math.inf}, "offset of it must be finite, got -inf"),
        ({"share": 1.0}, "share of it must be between 0 and 1, got 1"),
        ({"speed": 2.0}, "speed of it must be above 2, up to 5, got 2"),
        ({"rate": 5.0}, "rate of it must be from 2 to below 5, got 5"),
        ({"count": 0}, "count of it must be a whole number from 1 to 9, got 0"),
        ({"count": 2.5}, "count of it must be a whole number from 1 to 9, got 2.5"),
        ({"count": math.nan}, "count of it must be a whole number from 1 to 9, got nan"),
        ({"band": (1.0, -1.0)}, r"band of it must be not below 0, got (1.0, -1.0)"),
        ({"rates": (1.0, 0.0)}, r"rates of it must be above 0, got (1.0, 0.0)"),
        ({"word": "near"}, "word of it must be one of here, there, got 'near'"),
    ],
)
def test_what_it_does_not_is_refused_with_what_it_allows(changes, said):
    with pytest.raises(StageError) as caught:
        require_ranges(Thing(**changes), StageError, "it")
    assert str(caught.value) == said
