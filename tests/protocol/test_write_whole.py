"""A file appears whole or not at all, and what is no file is not replaced."""

import os
import stat
import sys
from pathlib import Path

import pytest

from flexstage.base.errors import RecordError
from flexstage.files import write
from flexstage.files.write import draft_of, write_files, write_whole


def names(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*"))


def test_a_block_that_fails_leaves_what_was_there(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("before")

    def fail():
        with draft_of(target) as draft:
            draft.write_text("half")
            raise RuntimeError("power")

    with pytest.raises(RuntimeError, match="power"):
        fail()
    assert (target.read_text(), names(tmp_path)) == ("before", ["a.txt"])


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has other rights")
def test_rights_are_handed_on_and_a_new_file_is_as_readable_as_any(tmp_path):
    old, new, plain = tmp_path / "old", tmp_path / "new", tmp_path / "plain"
    old.write_text("a")
    old.chmod(0o640)
    plain.write_text("a")
    write_whole(old, "ž")
    write_whole(new, b"\x00")
    assert old.read_bytes() == "ž".encode()
    assert stat.S_IMODE(old.stat().st_mode) == 0o640
    assert stat.S_IMODE(new.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no named pipes of this kind")
def test_what_is_no_file_stays(tmp_path):
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    sentence = "cannot be written: it is not a regular file"
    for target in (pipe, link):
        with pytest.raises(RecordError, match=f"{target} {sentence}"):
            write_whole(target, "a", RecordError)
    with pytest.raises(RecordError, match=f"{tmp_path} cannot be written: it is a directory"):
        write_whole(tmp_path, "a", RecordError)
    assert pipe.is_fifo()
    assert names(tmp_path) == ["link", "pipe"]


def test_some_files_are_all_written_or_none_and_no_folder_is_left(tmp_path, monkeypatch):
    within = tmp_path / "new" / "folder"
    assert [p.name for p in write_files(within, {"a": b"1", "deep/b": b"2"})] == ["a", "b"]
    assert (within / "deep" / "b").read_bytes() == b"2"
    to_disk = write._to_disk

    def full(draft: Path) -> None:
        if ".c." in draft.name:
            raise OSError(28, "No space left on device")
        to_disk(draft)

    monkeypatch.setattr(write, "_to_disk", full)
    with pytest.raises(OSError, match="No space left") as caught:
        write_files(tmp_path / "other", {"a": b"3", "deep/c": b"4"})
    assert caught.value.filename == str(tmp_path / "other" / "deep" / "c")
    with pytest.raises(OSError, match="No space left"):
        write_files(within, {"a": b"3", "c": b"4"})
    assert (within / "a").read_bytes() == b"1"
    assert names(tmp_path) == ["new", "new/folder", "new/folder/a", "new/folder/deep",
                               "new/folder/deep/b"]  # fmt: skip
