"""The catalogue, by the same tests on SQLite and on PostgreSQL.

Evidence (Instruments, twin, control): catalogue (SQLite, PostgreSQL): same
"""

import dataclasses
import multiprocessing
import threading
from datetime import UTC, datetime, timedelta, timezone

import pytest
import sqlalchemy as sa

from flexstage.base.errors import NotConnectedError, RecordError
from flexstage.instruments.catalogue.catalogue import Catalogue, enter_folder, folder_entries
from flexstage.instruments.catalogue.database import (
    METADATA,
    VERSION,
    catalogue_engine,
    default_catalogue,
)
from flexstage.instruments.catalogue.entries import (
    CalibrationEntry,
    ModelEntry,
    RunEntry,
    StageEntry,
)
from flexstage.instruments.recording.archive import archived
from tests.postgresql import database, postgresql_server  # noqa: F401
from tests.recordings import RunFolder, metadata, truth, writer, written

START = datetime(2031, 5, 17, 9, 30, 5, 123456, tzinfo=UTC)
PIEZO = StageEntry(name="vgtu-piezo", serial_number="A-1", design="vgtu-piezo", hash="ab" * 32)
OTHER = StageEntry(name="vgtu-mechanical", serial_number="Ž 7", hash="cd" * 32)


@pytest.fixture(params=["sqlite", "postgresql"])
def address(request, tmp_path):
    """Give the address of an empty database, of each kind in turn."""
    if request.param == "sqlite":
        yield str(tmp_path / "new" / "catalogue.sqlite")
    else:
        with database(request.getfixturevalue("postgresql_server")) as made:
            yield made


@pytest.fixture
def catalogue(address):
    with Catalogue.open(address) as opened:
        yield opened


def run(number, **changes):
    words = {
        "identifier": f"{number:032x}",
        "stage": PIEZO,
        "started": START + timedelta(hours=number),
        "plan": "chapter 3",
        "step": f"step {number}",
        "kind": "motion",
        "axis": "x",
        "operator": "Ona Š.",
        "note": "µm; 'quoted'; %s; \\",
        "version": "0.1.0",
        "instrument": "Physik E-7xx 115",
        "simulated": True,
        "folder": "/data/runs/1",
        "file": "records/a.h5",
        "sha256": "12" * 32,
        "status": "complete",
        "samples": 2**40 + 3,
        "sample_rate_hz": 7812.5,
        "seed": 2**70 + 1,
    }
    return RunEntry(**{**words, **changes})


def test_a_run_comes_back_as_it_was_entered(catalogue):
    entry = run(1)
    assert catalogue.enter_run(entry) is True
    assert catalogue.runs() == [entry]
    assert catalogue.run(entry.identifier) == entry
    assert catalogue.stages() == [PIEZO]
    assert entry.duration == (2**40 + 3) / 7812.5


def test_times_are_the_same_moment_in_every_zone(catalogue):
    there = START.astimezone(timezone(timedelta(hours=5, minutes=45)))
    catalogue.enter_run(run(0, started=there))
    [found] = catalogue.runs()
    assert found.started == START
    assert found.started.utcoffset() == timedelta(0)
    assert catalogue.runs(since=there) == [found]


def test_a_run_that_is_entered_again_is_brought_up_to_date(catalogue):
    catalogue.enter_run(run(1, status="failed", file="records/a.stream", lost="not ended"))
    catalogue.enter_run(run(2))
    assert catalogue.enter_run(run(1, status="recovered", lost="5 bytes", stage=OTHER)) is False
    found = catalogue.run(f"{1:032x}")
    assert (found.status, found.file, found.lost) == ("recovered", "records/a.h5", "5 bytes")
    assert found.stage == OTHER
    assert len(catalogue.runs()) == 2


def test_runs_are_found_by_what_is_asked_and_the_latest_come_first(catalogue):
    entries = [
        run(1),
        run(2, stage=OTHER, kind="hold"),
        run(3, axis="y", status="failed"),
        run(4, plan="other", simulated=False),
        run(5, stage=dataclasses.replace(PIEZO, serial_number="A-2")),
    ]
    for entry in (entries[i] for i in (3, 0, 4, 2, 1)):
        catalogue.enter_run(entry)

    def numbers(**asked):
        return [int(e.identifier, 16) for e in catalogue.runs(**asked)]

    assert numbers() == [5, 4, 3, 2, 1]
    assert numbers(stage="vgtu-piezo") == [5, 4, 3, 1]
    assert numbers(serial_number="A-1") == [4, 3, 1]
    assert numbers(serial_number="Ž 7") == [2]
    assert numbers(kind="hold") == [2]
    assert numbers(axis="y") == [3]
    assert numbers(plan="other") == [4]
    assert numbers(status="failed") == [3]
    assert numbers(simulated=False) == [4]
    assert numbers(since=START + timedelta(hours=3)) == [5, 4, 3]
    assert numbers(limit=2) == [5, 4]
    assert numbers(stage="vgtu-piezo", axis="x", limit=2) == [5, 4]
    assert numbers(kind="") == []
    assert [s.serial_number for s in catalogue.stages()] == ["Ž 7", "A-1", "A-2"]


def test_a_run_is_named_by_the_beginning_of_its_identifier(catalogue):
    for first in ("ab12", "ab13", "00ff"):
        catalogue.enter_run(run(1, identifier=first.ljust(32, "0")))
    assert catalogue.run("AB12").identifier.startswith("ab12")
    assert catalogue.run(" 0 ").identifier.startswith("00ff")
    with pytest.raises(RecordError, match=r"several runs start with 'ab1'.*give more digits"):
        catalogue.run("ab1")
    with pytest.raises(RecordError, match=r"no run of the catalogue .* 'ab14'"):
        catalogue.run("ab14")
    for text in ("", "%", "ab_", "x"):
        with pytest.raises(RecordError, match="first digits of its identifier"):
            catalogue.run(text)


def test_texts_that_no_database_holds_lose_only_the_letters_that_cannot_be_kept(catalogue):
    catalogue.enter_run(run(1, note="a\0b \ud83d c", operator="x'; DROP TABLE runs; --"))
    found = catalogue.run(f"{1:032x}")
    assert found.note == "ab ? c"
    assert found.operator == "x'; DROP TABLE runs; --"
    assert len(catalogue.runs()) == 1
    # and the same stage is found again, whatever its name
    odd = StageEntry(name="s\0t", serial_number="\ud83d")
    for number in (2, 3):
        catalogue.enter_run(run(number, stage=odd))
    assert len(catalogue.stages()) == 2


def calibration(day, value, **changes):
    words = {
        "what": "gain of sensor x",
        "value": value,
        "unit": "m/V",
        "standard_uncertainty": 3.5e-10,
        "valid_from": START + timedelta(days=day),
        "stage": PIEZO,
    }
    return CalibrationEntry(**{**words, **changes})


def test_the_calibration_that_holds_is_the_latest_before(catalogue):
    catalogue.enter_run(run(7))
    first = calibration(0, 1.25e-5, run=f"{7:032x}", note="laser")
    later = calibration(10, 1.2503e-5)
    elsewhere = calibration(3, 9.0e-6, stage=OTHER)
    offset = calibration(5, -2e-7, what="offset of sensor x", unit="m")
    for entry in (later, first, elsewhere, offset):
        catalogue.enter_calibration(entry)
    assert catalogue.calibrations() == [later, offset, elsewhere, first]
    assert catalogue.calibrations(stage="vgtu-piezo", what=first.what) == [later, first]
    assert catalogue.calibrations(serial_number="Ž 7") == [elsewhere]
    at = START + timedelta(days=9)
    assert catalogue.calibrations(valid_at=at) == [offset, elsewhere, first]
    day_after = at + timedelta(days=1)
    found = catalogue.calibrations(valid_at=day_after, what=later.what, stage=PIEZO.name)
    assert found == [later]
    assert catalogue.calibrations(valid_at=START - timedelta(seconds=1)) == []


def test_models_are_kept_with_their_figures(catalogue):
    catalogue.enter_run(run(7))
    model = ModelEntry(
        kind="preisach",
        file="models/x.json",
        stage=PIEZO,
        created=START,
        axis="x",
        figures={"rms": 1.5e-9, "share": 0.9871},
        run=f"{7:032x}",
        sha256="34" * 32,
    )
    other = dataclasses.replace(
        model, kind="bouc-wen", file="models/y.json", axis="y", run="", created=START + timedelta(1)
    )
    catalogue.enter_model(model)
    catalogue.enter_model(other)
    assert catalogue.models() == [other, model]
    assert catalogue.models(run=f"{7:032x}") == [model]
    better = dataclasses.replace(model, figures={"rms": 1.0e-9})
    catalogue.enter_model(better)
    assert catalogue.models() == [other, better]


def test_what_comes_from_a_run_that_is_not_there_is_refused(catalogue):
    with pytest.raises(RecordError, match="is not in the catalogue: enter it first"):
        catalogue.enter_calibration(calibration(0, 1.0, run="9" * 32))
    with pytest.raises(RecordError, match="is not in the catalogue: enter it first"):
        catalogue.enter_model(ModelEntry(kind="k", file="f", stage=PIEZO, run="9" * 32))
    assert catalogue.calibrations() == []
    assert catalogue.stages() == []


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: run(1, started=START.replace(tzinfo=None)),
            "start of a run must have a time zone",
        ),
        (lambda: run(1, status="done"), "one of complete, recovered, failed, got 'done'"),
        (lambda: run(1, samples=-1), "a run of -1 samples at 7812.5 Hz is impossible"),
        (lambda: run(1, sample_rate_hz=float("nan")), "impossible"),
        (lambda: calibration(0, float("nan")), "finite value"),
        (lambda: calibration(0, 1.0, standard_uncertainty=-1.0), "not negative"),
        (lambda: calibration(0, 1.0, what=" "), "must name its quantity"),
        (
            lambda: ModelEntry(kind="k", file="f", stage=PIEZO, figures={"rms": float("inf")}),
            "figure 'rms' of a model must be finite",
        ),
    ],
)
def test_entries_that_cannot_be_are_refused(make, said):
    with pytest.raises(RecordError, match=said):
        make()


# ------------------------------------------------------------------------------ schema


def test_an_empty_database_gets_the_tables_of_the_program(address):
    with Catalogue.open(address):
        pass
    engine = catalogue_engine(address)
    found = sa.inspect(engine)
    assert set(found.get_table_names()) == set(METADATA.tables)
    for table in METADATA.tables.values():
        columns = {c["name"]: c for c in found.get_columns(table.name)}
        assert set(columns) == {c.name for c in table.columns}
        for column in table.columns:
            is_there = columns[column.name]
            assert is_there["nullable"] == column.nullable, (table.name, column.name)
            ours, theirs = getattr(column.type, "impl", column.type), is_there["type"]
            assert theirs.python_type is ours.python_type, (table.name, column.name)
        keys = {tuple(k["constrained_columns"]) for k in found.get_foreign_keys(table.name)}
        assert keys == {tuple(k.column_keys) for k in table.foreign_key_constraints}
        unique = {tuple(u["column_names"]) for u in found.get_unique_constraints(table.name)}
        assert unique == {
            tuple(c.name for c in u.columns)
            for u in table.constraints
            if isinstance(u, sa.UniqueConstraint)
        }
        indices = {i["name"] for i in found.get_indexes(table.name)} - {
            u["name"] for u in found.get_unique_constraints(table.name)
        }
        assert indices == {i.name for i in table.indexes}
    engine.dispose()


def test_what_is_a_key_has_a_length():
    """MySQL and SQL Server take no text of any length as a key."""
    for table in METADATA.tables.values():
        rules = [c for c in table.constraints if isinstance(c, sa.UniqueConstraint)]
        for column in (column for rule in (*rules, *table.indexes) for column in rule.columns):
            assert getattr(column.type, "impl", column.type).length, (table.name, column.name)


def contents(engine):
    """Return every table of a database with all its rows."""
    found = sa.MetaData()
    with engine.connect() as connection:
        found.reflect(connection)
        return {t.name: connection.execute(sa.select(t)).all() for t in found.tables.values()}


def test_a_database_of_another_version_is_refused_and_left_alone(address):
    with Catalogue.open(address) as opened:
        opened.enter_run(run(1))
        where = opened.address
    engine = catalogue_engine(address)
    for version in (VERSION - 1, VERSION + 1, None):
        with engine.connect() as connection, connection.begin():
            connection.execute(sa.text("DELETE FROM schema_version"))
            if version is not None:
                table = METADATA.tables["schema_version"]
                connection.execute(table.insert().values(version=version))
        before = contents(engine)
        for make in (True, False):
            with pytest.raises(RecordError) as caught:
                Catalogue.open(address, make=make)
            assert str(caught.value) == (
                f"the catalogue {where} is of version {version}, and this flexstage reads and "
                f"writes version {VERSION} only: use the flexstage that made it, or enter the runs "
                "anew, by 'flexstage runs add FOLDER --catalogue URL' with an empty database or a "
                "new file"
            )
        assert contents(engine) == before
    engine.dispose()


def test_tables_that_cannot_all_be_made_are_not_made_at_all(address, monkeypatch):
    def broken(connection, **_):
        connection.execute(sa.text("CREATE TABLE stages (id INTEGER)"))
        connection.execute(sa.text("SELECT * FROM nowhere"))

    with monkeypatch.context() as patched:
        patched.setattr(METADATA, "create_all", broken)
        with pytest.raises((RecordError, NotConnectedError), match="nowhere"):
            Catalogue.open(address)
    engine = catalogue_engine(address)
    assert sa.inspect(engine).get_table_names() == []
    engine.dispose()
    with Catalogue.open(address) as opened:
        assert opened.runs() == []


def test_a_database_of_another_program_is_left_alone(address):
    engine = catalogue_engine(address)
    with engine.connect() as connection, connection.begin():
        connection.execute(sa.text("CREATE TABLE runs (kilometres INTEGER)"))
    with pytest.raises(RecordError, match="belongs to another program"):
        Catalogue.open(address)
    assert sa.inspect(engine).get_table_names() == ["runs"]
    engine.dispose()


def test_an_empty_database_that_is_only_read_stays_empty(address):
    engine = catalogue_engine(address)
    with engine.connect():  # where it is a file, it is there now, and empty
        pass
    with Catalogue.open(address, make=False) as opened:
        assert opened.runs() == opened.calibrations() == opened.models() == opened.stages() == []
        where = opened.address
    assert sa.inspect(engine).get_table_names() == []
    engine.dispose()
    with Catalogue.open(address) as opened:
        assert opened.address == where


def test_opening_again_changes_nothing(address):
    with Catalogue.open(address) as opened:
        opened.enter_run(run(1))
    with Catalogue.open(address) as opened:
        assert opened.runs() == [run(1)]


# ------------------------------------------------------------------------------ others beside


def enter_many(address, worker, count, failures):
    try:
        with Catalogue.open(address) as opened:
            for k in range(count):
                opened.enter_run(run(1000 * worker + k))
                # every worker enters the same stages, at the same time as the others
                opened.enter_run(run(5000 + k, stage=StageEntry(name=f"stage {k}")))
    except Exception as error:
        failures.append(repr(error))
        raise


def check_many(address, workers, count):
    with Catalogue.open(address) as opened:
        numbers = sorted(int(e.identifier, 16) for e in opened.runs())
        assert numbers == sorted(
            [1000 * w + k for w in range(workers) for k in range(count)]
            + [5000 + k for k in range(count)]
        )
        names = [s.name for s in opened.stages()]
        assert sorted(names) == sorted(["vgtu-piezo", *(f"stage {k}" for k in range(count))])


def test_threads_that_open_a_new_catalogue_at_once_and_write(address):
    failures = []
    threads = [
        threading.Thread(target=enter_many, args=(address, w, 3, failures)) for w in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120)
    assert failures == []
    check_many(address, 4, 3)


@pytest.mark.slow
def test_processes_that_write_at_once(address):
    context = multiprocessing.get_context("spawn")
    workers = [context.Process(target=enter_many, args=(address, w, 5, [])) for w in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(120)
    assert [worker.exitcode for worker in workers] == [0, 0]
    check_many(address, 2, 5)


def test_a_writer_that_waits_too_long_is_told(tmp_path, monkeypatch):
    from flexstage.instruments.catalogue import database as module

    monkeypatch.setattr(module, "_PATIENCE", 0.05)
    file = str(tmp_path / "c.sqlite")
    with Catalogue.open(file) as opened:
        engine = catalogue_engine(file)
        link = engine.connect().execution_options(flexstage_writes=True)
        with link as other, other.begin():
            assert opened.runs() == []  # who reads need not wait
            with pytest.raises(NotConnectedError, match="database is locked"):
                opened.enter_run(run(1))
        engine.dispose()
        assert opened.enter_run(run(1)) is True


# ------------------------------------------------------------------------------ addresses


def test_the_default_is_in_the_users_data(monkeypatch, tmp_path):
    monkeypatch.delenv("FLEXSTAGE_CATALOGUE", raising=False)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert default_catalogue() == str(tmp_path / "flexstage" / "catalogue.sqlite")
    monkeypatch.setenv("FLEXSTAGE_CATALOGUE", "postgresql://u@h/d")
    assert default_catalogue() == "postgresql://u@h/d"
    monkeypatch.setenv("FLEXSTAGE_CATALOGUE", str(tmp_path / "mine.sqlite"))
    with Catalogue.open() as opened:
        assert opened.address == f"sqlite:///{tmp_path / 'mine.sqlite'}"
    assert (tmp_path / "mine.sqlite").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (" ", "must not be empty"),
        ("mysql://u:secret@h/d", "needs the driver 'MySQLdb', which is not installed"),
        (
            "paper://u:secret@h/d",
            r"does not support the database of the catalogue paper://u:\*\*\*@h/d: give",
        ),
        ("sqlite://", "in memory would be lost"),
        ("postgresql://u:secret@h:port/d", "is not valid"),
    ],
)
def test_addresses_that_are_none_are_refused_without_their_password(text, said):
    with pytest.raises(RecordError, match=said) as caught:
        Catalogue.open(text)
    assert "secret" not in str(caught.value)


def test_a_link_to_a_server_is_not_waited_for_without_end(monkeypatch):
    from flexstage.instruments.catalogue import database as module

    given = []
    monkeypatch.setattr(module, "create_engine", lambda url, **options: given.append(options))
    for text in ("postgresql://u@h/d", "mysql://u@h/d", "postgresql://u@h/d?connect_timeout=3"):
        catalogue_engine(text)
    assert [options["connect_args"] for options in given] == [{"connect_timeout": 10}] * 2 + [{}]


def test_a_file_may_be_named_with_its_driver(tmp_path):
    with Catalogue.open(f"sqlite+pysqlite:///{tmp_path / 'new' / 'c.sqlite'}") as opened:
        opened.enter_run(run(1))
    with Catalogue.open(str(tmp_path / "new" / "c.sqlite")) as opened:
        assert opened.runs() == [run(1)]


def test_a_server_that_is_not_there_is_told_without_the_password():
    address = "postgresql://u:secret@127.0.0.1:1/d"
    with pytest.raises(NotConnectedError, match="the runs are saved in their folders") as caught:
        Catalogue.open(address)
    assert "secret" not in str(caught.value)


def test_a_file_that_is_no_database_is_left_alone(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("not a database, and long enough to be looked at\n" * 50)
    before = path.read_bytes()
    with pytest.raises(RecordError, match="is not valid"):
        Catalogue.open(str(path))
    assert path.read_bytes() == before
    with pytest.raises(RecordError, match=r"folder of the catalogue .* cannot be created"):
        Catalogue.open(str(path / "below" / "c.sqlite"))
    with pytest.raises(NotConnectedError, match="unable to open"):
        Catalogue.open(str(tmp_path))


# ------------------------------------------------------------------------------ folders


@pytest.fixture
def folder(tmp_path):
    """A folder of a run with a record, one with a gap, one recovered, and one left behind."""
    place = RunFolder(tmp_path / "run")
    one, _ = written(
        place.stream("one"), [40], leave=False, metadata=metadata(step="one", note="plain")
    )
    one.close()
    gap, _ = written(
        place.stream("gap"), [40], leave=False, metadata=metadata(step="gap", note="plain")
    )
    gap.append(50, truth(50, 5))
    gap.close()
    written(place.stream("cut"), [10, 10], metadata=metadata(step="cut", note="plain"))
    archived(place.stream("cut"), place.stream("cut").with_suffix(".h5"))
    written(place.stream("left"), [10, 7], metadata=metadata(step="left", note="plain"))
    return place


def test_a_folder_is_entered_by_what_its_files_say(address, folder):
    entered = enter_folder(folder.path, address)
    assert (entered.new, entered.problems) == (4, ())
    with Catalogue.open(address) as opened:
        found = {e.step: e for e in opened.runs()}
    assert {e.step: e for e in entered.runs} == found
    one = found["one"]
    about = metadata()
    assert (one.stage.name, one.stage.serial_number) == (about.stage, about.serial_number)
    assert (one.stage.hash, one.stage.design) == (about.stage_hash, about.design)
    assert (one.operator, one.plan, one.kind, one.axis) == ("Ona Š.", "chapter 3", "motion", "x")
    assert (one.status, one.samples, one.sample_rate_hz, one.lost) == ("complete", 40, 7812.5, "")
    assert (one.folder, one.file) == (str(folder.path.resolve()), "records/one.h5")
    assert (one.seed, one.simulated, one.note) == (2**70 + 1, True, "plain")
    assert (found["gap"].status, found["gap"].samples) == ("complete", 45)
    assert found["gap"].lost == "samples 40 to 49 not received from the instrument"
    assert found["cut"].status == "recovered"
    assert "did not end" in found["cut"].lost
    assert (found["left"].status, found["left"].samples) == ("failed", 17)
    assert found["left"].file == "records/left.stream"
    # later, when it was recovered
    archived(folder.stream("left"), folder.stream("left").with_suffix(".h5"))
    again = enter_folder(folder.path, address)
    assert (len(again.runs), again.new) == (4, 0)
    with Catalogue.open(address) as opened:
        assert opened.runs(status="failed") == []
        [left] = [e for e in opened.runs() if e.step == "left"]
    assert (left.status, left.file) == ("recovered", "records/left.h5")


def test_a_catalogue_that_fails_loses_nothing_and_raises_nothing(folder, address):
    entered = enter_folder(folder.path, "postgresql://u@127.0.0.1:1/d")
    assert entered.new == 0
    assert len(entered.runs) == 4
    [problem] = entered.problems
    assert "enter them later with 'flexstage runs add FOLDER'" in problem
    assert len(folder.records()) == 3
    assert enter_folder(folder.path, address).new == 4


def test_what_cannot_be_read_is_told_and_the_rest_is_entered(folder, address):
    (folder.path / "records" / "torn.h5").write_bytes(b"\x89HDF\r\n\x1a\n torn")
    (folder.path / "records" / "torn.stream").write_bytes(b"")
    (folder.path / "records" / "zero.stream").write_bytes(b"")
    (folder.path / "records" / ".draft.h5.part").write_bytes(b"")
    entries, problems = folder_entries(folder.path)
    assert len(entries) == 4
    assert len(problems) == 2
    assert "torn.h5" in problems[0]
    assert "zero.stream" in problems[1]
    entered = enter_folder(folder.path, address)
    assert (entered.new, entered.problems) == (4, problems)
    with pytest.raises(RecordError, match="there is no folder"):
        enter_folder(folder.path / "none", address)


def test_a_run_in_progress_is_entered_as_failed_until_it_ends(tmp_path, address):
    place = RunFolder(tmp_path / "run")
    going = writer(place.stream("now"))
    going.append(0, truth(0, 12))
    assert [e.status for e in enter_folder(place.path, address).runs] == ["failed"]
    going.close()
    enter_folder(place.path, address)
    with Catalogue.open(address) as opened:
        assert [(e.status, e.samples) for e in opened.runs()] == [("complete", 12)]
