"""Commands ask for what their records must be over, and get one sentence where they are not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexstage.base.errors import RecordError
from flexstage.records import Record, read_record
from flexstage.records.read import read_files
from flexstage.records.read_options import ReadOptions
from tests.measuring_files import function_58, report

COLUMNS = "t (s),x (um)\n0.5,3.25\n0.75,4.5\n1.0,7\n"
POINT = [("SPH1", [("X", 10.0, 10.0012), ("Y", -25.5, -25.5031)])]
MEASURED = report([POINT, POINT], opening="DIM L{number}= LOCATION OF SPHERE {feature}")


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    content = {
        "time": ("loop.csv", COLUMNS.encode()),
        "point": ("spheres.txt", MEASURED.encode()),
        "frequency": ("frf.uff", function_58(np.array([0.5 + 1.5j, 2.5 - 0.25j]))),
    }
    paths = {}
    for kind, (name, data) in content.items():
        paths[kind] = tmp_path / name
        paths[kind].write_bytes(data)
    return paths


def read(
    paths: list[Path], columns: list[str] | None = None, over: Any = "time", **options: Any
) -> list[Record]:
    how = ReadOptions(**options)
    return read_files(paths, columns, options=how, over=over)


@pytest.mark.parametrize("wanted", ["time", "point", "frequency"])
@pytest.mark.parametrize("kind", ["time", "point", "frequency"])
def test_a_record_over_something_else_is_refused(
    files: dict[str, Path], wanted: Any, kind: str
) -> None:
    found = kind
    if (wanted, kind) == ("point", "time"):
        # rows of a text are points where a command asks for them
        found = "point"
    if found == wanted:
        assert [r.over for r in read([files[kind]], over=wanted)] == [wanted]
        return
    with pytest.raises(RecordError, match=f"is over {found}, and a record over {wanted} is needed"):
        read([files[kind]], over=wanted)
    assert read([files[kind]], over="any")[0].over == found


def test_what_is_asked_for_by_default_is_time(files: dict[str, Path]) -> None:
    assert read([files["time"]], ["x"])[0].over == "time"
    for kind in ("point", "frequency"):
        with pytest.raises(RecordError, match="give samples with their times or their rate"):
            read([files["time"], files[kind]])


def test_the_unit_of_all_lengths(files: dict[str, Path]) -> None:
    plain, inches = (
        read_record(files["point"], over="point", columns=["SPH1.X"], units=units).channel("SPH1.X")
        for units in (None, {"length": "inch"})
    )
    assert (plain.unit, inches.unit) == ("", "m")
    np.testing.assert_allclose(inches.values, plain.values * 0.0254, rtol=1e-15)
    with pytest.raises(RecordError, match="no column 'length'"):
        read_record(files["time"], units={"length": "mm"})
