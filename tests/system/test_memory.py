"""What is remembered: the same result as when it was made, and never one of anything else."""

import json
import math
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from flexstage.base.provenance import content_hash
from flexstage.cli import main
from flexstage.files.cache import Cache, Memory
from flexstage.files.cache import memory as memory_module
from flexstage.files.cache.memory import NotPlainError, pack, source_hash, unpack
from flexstage.hinges import RightCircular
from flexstage.hinges.profile import Vertex
from flexstage.quantities.characteristic import Characteristic, Characteristics
from flexstage.quantities.table import Definitions, Picture
from flexstage.report.figures.fields import draw_fe_modes
from flexstage.report.figures.style import svg_text
from flexstage.report.study import report_html, study_section
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.studies import results_json, run_model, run_study
from flexstage.studies import study as study_module
from flexstage.studies.requests import ModelOptions
from flexstage.studies.results import analysis_results
from tests.undrawn import without_figures

ROW = Characteristic(quantity="resolution", axis="x", origin="plane", value=2.3e-8, unit="m")


def memory(directory: Path) -> Memory:
    """A memory that has to read what another one kept."""
    return Memory(Cache(directory, memory=0))


def packed(value: Any) -> Any:
    return unpack(pack(value)[0])


# ------------------------------------------------------------------------------------- packing


@pytest.mark.parametrize(
    "value",
    [
        None,
        True,
        -17,
        2.0**0.5,
        math.inf,
        3.5 - 2.25j,
        "µm, \N{SUPERSCRIPT TWO}",
        (),
        [1, (2.0, "3")],
        {("ratio", "x"): 1.697, "of": {"x": None}},
        ROW,
        Characteristics((ROW, replace(ROW, axis="y"))),
        (Vertex(0.3e-3, 0.7e-3, 0.2),),
    ],
)
def test_a_value_returns_as_it_was(value: object) -> None:
    found = packed(value)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    "array",
    [
        np.linspace(0.3, 7.1, 24).reshape(2, 3, 4),
        np.asfortranarray(np.linspace(0.3, 7.1, 24).reshape(6, 4)),
        np.linspace(0.3, 7.1, 24)[::3],
        np.array([3, -(2**60)]),
        np.array([True, False, True]),
        np.array([1.5 + 2j, math.nan]),
        np.zeros((0, 5)),
        np.array(2.5),
    ],
)
def test_an_array_returns_with_type_shape_and_order(array: np.ndarray) -> None:
    found = packed(array)
    assert np.array_equal(found, array, equal_nan=array.dtype.kind in "fc")
    assert (found.dtype, found.shape) == (array.dtype, array.shape)
    assert found.flags.f_contiguous == (array.flags.f_contiguous or array.size < 9)
    assert found.flags.writeable


def test_what_stands_in_several_places_is_one() -> None:
    shared = np.arange(4000.0)
    entry, _ = pack(({"a": shared, "b": shared}, ROW, [ROW]))
    assert sum(a.nbytes for a in entry.values()) < 1.1 * shared.nbytes
    (arrays, row, (again,)) = unpack(entry)
    assert arrays["a"] is arrays["b"]
    assert row is again


@dataclass(frozen=True)
class Foreign:
    """Of another package, whose code nobody compares."""

    value: float = 1.0


@pytest.mark.parametrize(
    "value", [Foreign(), (ROW, Foreign()), max, Path("x"), {1, 2}, np.array([None])]
)
def test_what_is_no_data_of_the_package_is_refused(value: object) -> None:
    with pytest.raises(NotPlainError):
        pack(value)


@pytest.mark.parametrize(
    "name",
    [
        "os:_Environ",
        "flexstage.files.cache.memory:source_hash",
        "flexstage.files.cache.memory:Memory",
    ],
)
def test_only_classes_of_data_are_made(name: str) -> None:
    tree = json.dumps(["object", name, []]).encode()
    with pytest.raises((NotPlainError, AttributeError)):
        unpack({"tree": np.frombuffer(tree, dtype=np.uint8)})


# ------------------------------------------------------------------------------------- memory

CALLS: list[tuple[object, ...]] = []


def work(value: object, *, times: float = 2.0) -> tuple[object, float]:
    CALLS.append((value, times))
    return value, times


@pytest.fixture(autouse=True)
def no_calls() -> None:
    CALLS.clear()


def test_the_same_is_done_once(tmp_path: Path) -> None:
    for turn in range(3):
        memo = memory(tmp_path)
        assert memo.recall("work", work, ROW, times=3.0) == (ROW, 3.0)
        assert (memo.computed, memo.read) == ((), ("work",)) if turn else (("work",), ())
    assert len(CALLS) == 1


def test_another_argument_is_other_work(tmp_path: Path) -> None:
    given = [1.0, 1.0 + 2.0**-52, 1, "1.0", np.ones(3), np.ones((3, 1)), np.ones(3, dtype=int)]
    given += [ROW, replace(ROW, value=2.3e-8 * (1.0 + 1e-15)), {"a": 1.0}, partial(work, 1.0)]
    for value in given:
        memory(tmp_path).recall("work", work, value)
    memory(tmp_path).recall("work", work, given[0], times=2.5)
    assert len(CALLS) == len(given) + 1


def test_another_source_or_library_is_other_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "package"
    (package / "room").mkdir(parents=True)
    source = package / "room" / "law.py"
    source.write_text("G = 9.80665\n")
    kept = tmp_path / "kept"
    hashes = []

    def recalled() -> None:
        hashes.append(source_hash(package))
        monkeypatch.setattr(memory_module, "_surroundings", lambda: (hashes[-1],))
        memory(kept).recall("work", work, 1.0)

    recalled()
    recalled()
    assert len(CALLS) == 1
    source.write_text("G = 9.80666\n")  # as long, and perhaps within one tick of the clock
    recalled()
    assert len(CALLS) == 2
    (package / "room" / "__pycache__").mkdir()
    (package / "room" / "__pycache__" / "law.pyc").write_bytes(b"compiled")
    recalled()
    assert len(CALLS) == 2
    source.rename(package / "law.py")
    recalled()
    assert len(CALLS) == 3
    assert len(set(hashes)) == 3


def test_surroundings_name_the_source_and_the_libraries() -> None:
    found = memory_module._surroundings()
    assert found[0] == source_hash(Path(memory_module.__file__).parents[1])
    assert any(f"numpy {np.__version__}" == one for one in found)
    assert any(one.startswith("ngsolve ") for one in found)


def test_a_damaged_entry_is_made_again(tmp_path: Path) -> None:
    memory(tmp_path).recall("work", work, ROW)
    (file,) = tmp_path.glob("*.arrays")
    whole = file.read_bytes()
    for bad in (whole[:-3], whole[:200] + b"\xff" + whole[201:], b""):
        file.write_bytes(bad)
        assert memory(tmp_path).recall("work", work, ROW) == (ROW, 2.0)
        assert file.read_bytes() == whole
    assert len(CALLS) == 4


def test_without_a_cache_all_is_done(tmp_path: Path) -> None:
    memo = Memory(None)
    assert memo.cache is None
    for _ in range(2):
        memo.recall("work", work, ROW)
    assert len(CALLS) == 2
    assert (memo.computed, memo.read) == ((), ())


def test_what_cannot_be_kept_or_told_apart_is_done_each_time(tmp_path: Path) -> None:
    for given in (Foreign(), object(), lambda: 1.0):
        for _ in range(2):
            assert memory(tmp_path).recall("work", work, given)[0] is given
    assert len(CALLS) == 6
    assert not tmp_path.exists() or not list(tmp_path.glob("*.arrays"))


@dataclass(frozen=True)
class _Curve:
    values: tuple[float, ...]
    drawn: Any = field(default=None, compare=False)


def test_fields_that_are_not_compared_are_no_content() -> None:
    assert content_hash(_Curve((1.0, 2.0), object())) == content_hash(_Curve((1.0, 2.0)))
    assert content_hash(_Curve((1.0, 2.5))) != content_hash(_Curve((1.0, 2.0)))


# -------------------------------------------------------------------------------------- models


def test_a_model_is_read_with_all_that_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage, options = design("parallelogram"), ModelOptions(plane="stress")
    first = memory(tmp_path).recall("plane", run_model, stage, "plane", options)
    assert first.mesh is not None
    memo = memory(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("flexstage.fem.whole_stage.plane_model", None)
        read = memo.recall("plane", run_model, stage, "plane", options)
    assert memo.read == ("plane",)
    assert analysis_results(read.analysis, responses=True) == analysis_results(
        first.analysis, responses=True
    )
    assert read.beyond_analysis() == first.beyond_analysis()
    assert read.analysis.system.stress is not None
    assert first.analysis.system.stress is not None
    assert np.array_equal(read.analysis.system.stress.matrix, first.analysis.system.stress.matrix)
    assert read.mesh is not None
    assert (read.mesh.unknowns, read.mesh.elements) == (first.mesh.unknowns, first.mesh.elements)
    # its mesh is made again where its fields are asked for
    pictures = [svg_text(draw_fe_modes(r.mesh, r.analysis, most=1)) for r in (first, read)]  # type: ignore[arg-type]
    assert pictures[0] == pictures[1]


def neck_changed(stage: Stage, by: float) -> Stage:
    """The stage with another neck in its first hinge."""
    hinge, *others = stage.hinges
    profile = hinge.profile
    assert isinstance(profile, RightCircular)
    thin = replace(profile, neck_thickness=profile.neck_thickness * (1.0 + by))
    return replace(stage, hinges=(replace(hinge, profile=thin), *others))


def test_a_study_is_read_and_is_the_same_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage, cache = design("parallelogram"), Cache(tmp_path)
    models = ("lumped", "superelement")
    done: list[str] = []
    instead: dict[str, str] = {}

    def run(stage: Stage, model: str, options: ModelOptions) -> Any:
        done.append(model)
        return run_model(stage, instead.get(model, model), options)

    run.__module__, run.__qualname__ = "tests", "run"
    monkeypatch.setattr(study_module, "run_model", run)

    def study(stage: Stage, **options: Any) -> Any:
        done.clear()
        return run_study(stage, model=models, parts="virtual", cache=cache, **options)

    first = study(stage)
    assert first.read == ()
    assert done == ["lumped", "lumped", "superelement"]
    again = study(stage)
    # a stage of one axis centres no scale: why is found out each time
    assert again.read == ("superelement", "characterise x")
    assert done == ["lumped", "lumped"]
    results = [json.loads(results_json(found.to_dict())) for found in (first, again)]
    for found in results:
        # the lumped model, which is not kept, says when it was run
        for run_anew in (found["models"]["lumped"], *found["variants"].values()):
            assert run_anew["provenance"].pop("created")
    assert results[0] == results[1]
    (said,) = study_section(again, "provenance").content
    assert isinstance(said, Definitions)
    assert said.entries["read from the cache"] == "superelement, characterise x"
    instead["superelement"] = "lumped"  # quick, where only what was read is looked at
    for changed, kept in (
        (study(neck_changed(stage, 1e-9)), ()),
        # the virtual stage is measured without the models of the study
        (study(stage, plane="stress"), ("characterise x",)),
        (study(stage, seed=2), ("superelement",)),
        (run_study(stage, model=models, parts="virtual"), ()),
    ):
        assert changed.read == kept


def test_what_bodies_in_space_give_is_not_kept_beside_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage, cache = design("parallelogram"), Cache(tmp_path)
    kept: list[Cache | bool] = []

    def run(stage: Stage, model: str, options: ModelOptions) -> Any:
        assert model == "superelement-3d"
        kept.append(options.cache)
        return run_model(stage, "lumped")

    monkeypatch.setattr(study_module, "run_model", run)
    for _ in range(2):
        assert run_study(stage, model=["superelement-3d"], cache=cache).read == ()
    run_study(stage, model=["superelement-3d"])
    # they themselves are, where anything is
    assert kept == [cache, cache, False]
    assert not list(tmp_path.rglob("*.arrays"))


def _sketch(picture: Picture) -> Figure:
    figure = Figure(figsize=(1.0, 1.0))
    figure.text(0.0, 0.5, picture.title)
    return figure


def test_pictures_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = run_study(design("parallelogram"))
    memo = memory(tmp_path)
    with monkeypatch.context() as patch:
        # each picture has its own look; drawing it in full takes seconds, and others look at that
        patch.setattr("flexstage.report.page.draw_picture", _sketch)
        page = report_html(study, memo)
    assert len(memo.computed) > 3
    with monkeypatch.context() as patch:
        patch.setattr("flexstage.report.page.draw_picture", None)
        again = memory(tmp_path)
        assert report_html(study, again) == page
    assert (again.computed, again.read) == ((), memo.computed)
    other = memory(tmp_path)
    changed = run_study(neck_changed(design("parallelogram"), 1e-3))
    without_figures(report_html, changed, other)
    assert "drawing of parallelogram" in other.computed


@pytest.mark.usefixtures("undrawn")
def test_the_command_keeps_nothing_where_it_is_told_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FLEXSTAGE_CACHE", str(tmp_path / "cache"))
    words = [
        "study",
        "parallelogram",
        "--model",
        "lumped",
        "--parts",
        "identification,traditional",
        "--quiet",
    ]
    for options, kept in ((["--no-cache"], False), ([], True)):
        with pytest.raises(SystemExit) as ended:
            main([*words, "--folder", str(tmp_path / "out"), *options])
        assert ended.value.code == 0
        assert bool(list((tmp_path / "cache").glob("computed/*.arrays"))) == kept
    capsys.readouterr()
