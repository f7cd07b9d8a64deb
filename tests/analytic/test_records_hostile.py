"""Files that are broken, or no measured data: one clear sentence each, never a library's error."""

import contextlib
import io
import pickle
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from flexstage.base.errors import RecordError
from flexstage.records import read_record
from flexstage.records.datasets import most_unpacked

U = np.array([0.3, 1.7, 2.9, 0.4, -1.1, 0.2, 5.3])
JUNK = bytes(np.random.default_rng(17).integers(0, 256, 4000, dtype=np.uint8))


def mat(**variables: object) -> bytes:
    stream = io.BytesIO()
    savemat(stream, variables)
    return stream.getvalue()


def mat_4() -> bytes:
    stream = io.BytesIO()
    savemat(stream, {"u": U, "y": 2.0 * U}, format="4")
    return stream.getvalue()


def hdf5(fill: Callable[[h5py.File], object]) -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        fill(file)
    return stream.getvalue()


def npy(array: np.ndarray, *, pickled: bool = False) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=pickled)
    return stream.getvalue()


def npz(*, compressed: bool = False, **arrays: np.ndarray) -> bytes:
    stream = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def tdms(*channels: ChannelObject) -> bytes:
    stream = io.BytesIO()
    with TdmsWriter(stream) as writer:
        writer.write_segment(channels)
    return stream.getvalue()


def archive(**members: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as content:
        for name, data in members.items():
            content.writestr(name.replace("__", "."), data)
    return stream.getvalue()


def datasets(**arrays: object) -> bytes:
    return hdf5(lambda file: [file.create_dataset(k, data=v) for k, v in arrays.items()])


def huge(file: h5py.File) -> None:
    file.create_dataset("u", shape=(2**40,), dtype="f8", chunks=(1024,))


def large(file: h5py.File) -> None:
    """Half a gigabyte of which nothing is in the file."""
    file.create_dataset("u", shape=(2**26,), dtype="f8", chunks=(1024,), compression="gzip")


def loops(file: h5py.File) -> None:
    file["a/b"] = h5py.SoftLink("/a")
    file["c"] = h5py.ExternalLink("/etc/hostname", "/")


def undefined_dimensions() -> bytes:
    """A MATLAB 5 file whose compressed variable says that it is much longer than it is."""
    body = struct.pack("<II", 14, 2**31 - 1) + b"\0" * 40
    packed = zlib.compress(body)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    return head + struct.pack("<II", 15, len(packed)) + packed


class Bomb:
    def __reduce__(self) -> tuple:
        return (Path("/nonexistent/pwned").write_text, ("x",))


WHOLE = {
    "mat": mat(u=U, y=2.0 * U),
    "mat4": mat_4(),
    "h5": datasets(u=np.tile(U, 500), y=np.tile(U, 500)),
    "tdms": tdms(ChannelObject("g", "u", np.tile(U, 50), {"wf_increment": 0.005})),
    "npz": npz(u=U, y=2.0 * U),
    "npy": npy(np.column_stack([U, U])),
}
V4 = struct.pack("<5i", 0, 2**20, 2**20, 0, 2) + b"x\0" + b"\0" * 64

FILES: dict[str, tuple[str, bytes]] = {
    # text
    "empty": ("a.csv", b""),
    "blank": ("a.csv", b"\n \n\t\n"),
    "only a mark": ("a.csv", b"\xef\xbb\xbf"),
    "only a wide mark": ("a.csv", b"\xff\xfe"),
    "half a wide letter": ("a.csv", b"\xff\xfe1\x00,\x002"),
    "prose": ("a.txt", b"Dear reader,\n\nthere are no numbers in this letter.\n"),
    "only a heading": ("a.csv", b"u,y\n"),
    "one row": ("a.csv", b"u,y\n1,2\n"),
    "only missing": ("a.csv", b"u,y\n,\n,\n"),
    "words in the middle": ("a.csv", b"u,y\n1,2\n3,overload\n5,6\n"),
    "words in one column": ("a.csv", b"1.5\nstop\n2.5\n"),
    "a footer": ("a.csv", b"u,y\n1,2\n3,4\nend of file\n"),
    "a short row": ("a.csv", b"u,y\n1,2\n3\n5,6\n"),
    "a long row": ("a.csv", b"u,y\n1,2\n3,4,5\n5,6\n"),
    "half the last row": ("a.txt", b"1 2 3\n4 5 6\n7 8"),
    "another sign": ("a.txt", b"1,5;2\n1.5;3\n"),
    "thousands": ("a.txt", b"1.234,5\t2\n1.235,5\t3\n"),
    "two points": ("a.txt", b"1.2 3\n1.2.3 4\n"),
    "hexadecimal": ("a.txt", b"1 2\n0x12 3\n"),
    "underscores": ("a.txt", b"1 2\n1_000 3\n"),
    "binary as text": ("a.csv", JUNK),
    "binary without a suffix": ("a", JUNK),
    "zero bytes": ("a.txt", b"1,2\n\x00\x00\n3,4\n"),
    "a long line": ("a.csv", b"x" * 3_000_000),
    "a huge heading": ("a.csv", b"heading\n" * 20_000 + b"1,2\n3,4\n"),
    "too large a number": ("a.csv", b"1,2\n1e400,3\n"),
    "no such day": ("a.csv", b"t,u\n2023-02-28 10:00:00,1\n2023-02-30 10:00:00,2\n"),
    "no date below dates": ("a.csv", b"t,u\n2023-02-28 10:00:00,1\n17,2\n"),
    "two parts of LabVIEW": (
        "a.lvm",
        b"LabVIEW Measurement\n***End_of_Header***\n***End_of_Header***\nX_Value\tu\n"
        b"***End_of_Header***\n0\t1\n1\t2\n",
    ),
    "a picture": ("a.dat", b"\x89PNG\r\n\x1a\n" + JUNK),
    "a workbook": ("a.xlsx", archive(xl__workbook__xml=b"<workbook/>")),
    "an old workbook": ("a.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + JUNK),
    # MATLAB
    "junk mat": ("a.mat", JUNK),
    "empty mat": ("a.mat", b""),
    "mat of no variables": ("a.mat", mat()),
    "mat heading alone": ("a.mat", WHOLE["mat"][:128]),
    "mat cut": ("a.mat", WHOLE["mat"][:-70]),
    "mat cut in a heading": ("a.mat", WHOLE["mat"][:140]),
    "mat 4 cut": ("a.mat", WHOLE["mat4"][:-20]),
    "mat 4 too large": ("a.mat", V4),
    "mat that says too much": ("a.mat", undefined_dimensions()),
    "mat of text": ("a.mat", mat(a="hello", b="world")),
    "mat of three dimensions": ("a.mat", mat(u=np.ones((4, 3, 2)))),
    "mat of numbers alone": ("a.mat", mat(a=1.5, b=2.5)),
    "mat of unequal columns": ("a.mat", mat(u=U, y=U[:5])),
    "mat of an empty structure": ("a.mat", mat(s={})),
    "mat of large integers": ("a.mat", mat(u=np.array([1, 2**60 + 1, 3], dtype=np.int64))),
    "mat with NaN": ("a.mat", mat(u=np.array([0.1, np.nan, 0.3]))),
    # HDF5
    "junk h5": ("a.h5", JUNK),
    "h5 cut": ("a.h5", WHOLE["h5"][:-3000]),
    "h5 mark alone": ("a.h5", b"\x89HDF\r\n\x1a\n"),
    "h5 mark and junk": ("a.h5", b"\x89HDF\r\n\x1a\n" + JUNK),
    "h5 empty": ("a.h5", hdf5(lambda file: None)),
    "h5 empty groups": ("a.h5", hdf5(lambda file: file.create_group("a/b/c"))),
    "h5 links": ("a.h5", hdf5(loops)),
    "h5 huge": ("a.h5", hdf5(huge)),
    "h5 large": ("a.h5", hdf5(large)),
    "h5 of text": ("a.h5", datasets(u=[b"one", b"two", b"three"])),
    "h5 three dimensions": ("a.h5", datasets(u=np.ones((4, 5, 2)))),
    "h5 no samples": ("a.h5", datasets(u=np.zeros(0), y=np.zeros((0, 3)))),
    "h5 unequal columns": ("a.h5", datasets(u=U, y=U[:4])),
    "h5 large integers": ("a.h5", datasets(u=np.array([5, 2**63], dtype=np.uint64))),
    "h5 as mat 7.3": ("a.mat", b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + JUNK),
    # TDMS
    "junk tdms": ("a.tdms", JUNK),
    "tdms empty": ("a.tdms", b""),
    "tdms mark alone": ("a.tdms", b"TDSm"),
    "tdms mark and junk": ("a.tdms", b"TDSm" + JUNK),
    "tdms cut in the data": ("a.tdms", WHOLE["tdms"][:-900]),
    "tdms cut by one sample": ("a.tdms", WHOLE["tdms"][:-8]),
    "tdms cut in the heading": ("a.tdms", WHOLE["tdms"][:60]),
    "tdms of no samples": ("a.tdms", tdms(ChannelObject("g", "u", np.zeros(0)))),
    "tdms of text": ("a.tdms", tdms(ChannelObject("g", "u", ["one", "two"]))),
    "tdms of unequal columns": (
        "a.tdms",
        tdms(ChannelObject("g", "u", U), ChannelObject("g", "y", U[:4])),
    ),
    # NumPy
    "junk npy": ("a.npy", JUNK),
    "npy mark alone": ("a.npy", b"\x93NUMPY"),
    "npy mark and junk": ("a.npy", b"\x93NUMPY\x01\x00" + JUNK),
    "npy cut": ("a.npy", WHOLE["npy"][:-9]),
    "npy with a huge heading": ("a.npy", b"\x93NUMPY\x02\x00\xff\xff\xff\x7f" + b"{" * 4000),
    "npy that says too much": (
        "a.npy",
        WHOLE["npy"].replace(b"(7, 2)", b"(7777777777777, 2)")[:200],
    ),
    "npy pickled": ("a.npy", npy(np.array([Bomb(), 1.0], dtype=object), pickled=True)),
    "npz pickled": ("a.npz", archive(u__npy=npy(np.array([Bomb()], dtype=object), pickled=True))),
    "a pickle": ("a.npy", pickle.dumps(U)),
    "a pickle as npz": ("a.npz", pickle.dumps({"u": U})),
    "npz cut": ("a.npz", WHOLE["npz"][:-30]),
    "npz damaged": ("a.npz", WHOLE["npz"][:150] + b"\xff" * 40 + WHOLE["npz"][190:]),
    "npz of nothing": ("a.npz", archive()),
    "npy of three dimensions": ("a.npy", npy(np.ones((5, 4, 3)))),
    "npy of one number": ("a.npy", npy(np.array(0.7))),
    "npy of nothing": ("a.npy", npy(np.zeros((0, 2)))),
    "npy of text": ("a.npy", npy(np.array(["1.5", "2.5"]))),
    "npy with infinity": ("a.npy", npy(np.array([0.1, np.inf, 2.0]))),
}


@pytest.mark.parametrize("name", FILES)
def test_a_broken_file_is_refused_in_one_sentence(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    file, content = FILES[name]
    path = tmp_path / file
    path.write_bytes(content)
    with pytest.raises(RecordError) as caught:
        read_record(path, sample_rate=200.0)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    assert 20 < len(message.replace(str(tmp_path), "")) < 400
    assert capfd.readouterr() == ("", "")
    assert sorted(p.name for p in tmp_path.iterdir()) == [file]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("binary as text", "zero bytes", "a picture", "an old workbook"), "is not a text file"),
        (("empty", "blank"), "is empty"),
        (("a workbook",), "a workbook: save the columns as CSV"),
        (("a short row", "half the last row"), "line 3 has"),
        (("another sign",), "decimal comma"),
        (("two parts of LabVIEW",), "has several parts"),
        (("mat cut",), "truncated"),
        (("mat that says too much",), "longer than its variable"),
        (("mat of unequal columns", "h5 unequal columns", "tdms of unequal columns"), "dataset"),
        (("mat of large integers", "h5 large integers"), "beyond 2^53"),
        (("h5 huge", "h5 large"), "too large to read"),
        (("tdms cut in the data", "tdms cut by one sample"), "is incomplete"),
        (("npy with infinity", "too large a number"), "is infinite at sample"),
    ],
)
def test_the_reason_is_said(tmp_path: Path, names: tuple[str, ...], said: str) -> None:
    for name in names:
        file, content = FILES[name]
        (tmp_path / file).write_bytes(content)
        with pytest.raises(RecordError, match=re.escape(said)):
            read_record(tmp_path / file, sample_rate=200.0)


def test_a_small_file_is_not_unpacked_to_more_than_memory_should_hold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert most_unpacked(100) == 2**28
    monkeypatch.setattr("flexstage.records.datasets._ALWAYS", 2**20)  # packing less takes no time
    zeros = np.zeros(2**18)
    (tmp_path / "a.npz").write_bytes(npz(compressed=True, u=zeros))
    body = struct.pack("<II", 14, 48 + zeros.nbytes)
    body += struct.pack("<4I", 6, 8, 6, 0) + struct.pack("<4I", 5, 8, zeros.size, 1)
    body += struct.pack("<HH4s", 1, 1, b"u") + struct.pack("<II", 9, zeros.nbytes)
    packed = zlib.compress(body + zeros.tobytes(), 1)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    (tmp_path / "a.mat").write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)
    for name in ("a.npz", "a.mat"):
        with pytest.raises(RecordError, match=r"too large to read: \d+ MB from a file of") as error:
            read_record(tmp_path / name, sample_rate=200.0)
        assert name in str(error.value)


@pytest.mark.parametrize("name", WHOLE)
def test_the_same_files_unbroken_are_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"a.{name.rstrip('4')}"
    path.write_bytes(WHOLE[name])
    assert read_record(path, sample_rate=200.0).channel(0).values[:7].tolist() == U.tolist()


@pytest.mark.parametrize("name", WHOLE)
def test_every_cut_is_refused_or_leaves_all_numbers(tmp_path: Path, name: str) -> None:
    whole = WHOLE[name]
    path = tmp_path / f"a.{name.rstrip('4')}"
    path.write_bytes(whole)
    wanted = [c.values.tolist() for c in read_record(path, sample_rate=200.0).channels]
    random = np.random.default_rng(23)
    for length in random.choice(len(whole), min(40, len(whole)), replace=False):
        path.write_bytes(whole[:length])
        try:
            found = [c.values.tolist() for c in read_record(path, sample_rate=200.0).channels]
        except RecordError:
            continue
        # what is cut off may be padding, or a whole column; a part of one is never read
        assert found in (wanted, wanted[: len(found)]), length


@pytest.mark.parametrize("name", WHOLE)
def test_damaged_bytes_raise_nothing_else(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"a.{name.rstrip('4')}"
    random = np.random.default_rng(29)
    for _ in range(40):
        damaged = bytearray(WHOLE[name])
        for at in random.integers(0, min(len(damaged), 700), 6):
            damaged[at] = random.integers(0, 256)
        path.write_bytes(damaged)
        # whatever a library makes of it, and warnings are errors here
        with contextlib.suppress(RecordError):
            read_record(path, sample_rate=200.0)


def test_pickles_are_not_run(tmp_path: Path) -> None:
    for name in ("npy pickled", "npz pickled"):
        file, content = FILES[name]
        (tmp_path / file).write_bytes(content)
        with pytest.raises(RecordError, match="is pickled, which is never loaded"):
            read_record(tmp_path / file, sample_rate=2.0)


def test_what_is_said_of_a_row(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for content, match in (
        ("u,y\n1,2\n\n# note\n3,overload\n", "line 5, column 1: 'overload' is not a number"),
        ("u,y\n1,2\n3\n", "line 3 has 1 columns where the first row has 2"),
        ("1,5;2\n2;3\n1.5;3\n", "line 3 has a decimal comma where others have a point"),
    ):
        path.write_text(content)
        with pytest.raises(RecordError, match=match):
            read_record(path, sample_rate=2.0)


def test_several_datasets_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for run, count in (("slow", 5), ("fast", 7)):
            file[f"{run}/u"], file[f"{run}/y"] = U[:count], 2.0 * U[:count]
    with pytest.raises(RecordError, match=r"slow/u \(5\).*such as '(slow|fast)'"):
        read_record(path, sample_rate=2.0)
    assert read_record(path, sample_rate=2.0, dataset="/slow/").size == 5
    with pytest.raises(RecordError, match=r"no dataset 'quick'.*fast/y \(7\)"):
        read_record(path, sample_rate=2.0, dataset="quick")
    with pytest.raises(RecordError, match="differ in length"):
        read_record(path, sample_rate=2.0, dataset="slow/u,fast/y")


def test_what_is_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RecordError, match="there is no file"):
        read_record(tmp_path / "none.csv", sample_rate=2.0)
    (tmp_path / "folder.mat").mkdir()
    with pytest.raises(RecordError, match="is not a file"):
        read_record(tmp_path / "folder.mat", sample_rate=2.0)
    with pytest.raises(RecordError, match="cannot be read: File name too long"):
        read_record(tmp_path / ("x" * 3000), sample_rate=2.0)
    path = tmp_path / "locked.csv"
    path.write_text("1,2\n3,4\n")

    def denied(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", denied)
    with pytest.raises(RecordError, match="cannot be read: Permission denied"):
        read_record(path, sample_rate=2.0)
