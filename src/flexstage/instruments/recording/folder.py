"""The folder of a run: what lies where."""

import re
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

from flexstage.errors import RecordError
from flexstage.files.write import sync_folder
from flexstage.instruments.recording.stream import STREAM_SUFFIX


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFolder:
    """A folder with everything that a run gave.

    ``run.json`` is its state, ``records/`` holds streams and HDF5 files, ``models/`` identified
    models, ``report/`` figures and pages.
    """

    path: Path
    """The folder."""

    @classmethod
    def create(
        cls, root: str | Path, stage: str, slug: str = "", *, when: datetime | None = None
    ) -> Self:
        """Make a folder that was not there before, named by time in UTC, stage and slug.

        Examples
        --------
        >>> import tempfile
        >>> when = datetime(2031, 5, 17, 9, 30, 5, tzinfo=UTC)
        >>> with tempfile.TemporaryDirectory() as root:
        ...     RunFolder.create(root, "vgtu-piezo", "Loop width", when=when).path.name
        '20310517T093005Z-vgtu-piezo-loop-width'
        """
        time = (when or datetime.now(UTC)).astimezone(UTC).strftime("%Y%m%dT%H%M%SZ")
        words = [time, *(w for w in (_slug(stage), _slug(slug)) if w)]
        name = "-".join(words)
        try:
            Path(root).mkdir(parents=True, exist_ok=True)
            for number in range(1, 10_000):
                path = Path(root) / (name if number == 1 else f"{name}-{number}")
                with suppress(FileExistsError):
                    path.mkdir()
                    for part in ("records", "models", "report"):
                        (path / part).mkdir()
                    sync_folder(path)
                    sync_folder(path.parent)
                    return cls(path=path)
        except OSError as error:
            raise RecordError(
                f"the folder of the run cannot be made in '{root}': {error.strerror or error}"
            ) from error
        raise RecordError(f"'{root}' holds too many runs of the name {name}")

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Return a folder that is there."""
        if not Path(path).is_dir():
            raise RecordError(f"there is no folder '{path}': give the folder of a run")
        return cls(path=Path(path))

    def stream(self, name: str) -> Path:
        """Return where the stream of a measurement is written; its HDF5 file will be beside it."""
        word = _slug(name)
        if not word:
            raise RecordError(f"'{name}' has no letter that the name of a file can have")
        return self.path / "records" / f"{word}{STREAM_SUFFIX}"

    def records(self) -> list[Path]:
        """Return the HDF5 files of the run, by name."""
        return self._files(".h5")

    def streams(self) -> list[Path]:
        """Return the streams that no HDF5 file stands for, by name: runs that did not end well."""
        return [p for p in self._files(STREAM_SUFFIX) if not p.with_suffix(".h5").exists()]

    def _files(self, suffix: str) -> list[Path]:
        # a folder that was laid out by hand, or a single folder of records, is one too
        places = [p for p in (self.path, self.path / "records") if p.is_dir()]
        found = (p for place in places for p in place.iterdir())
        return sorted(p for p in found if p.suffix == suffix and not p.name.startswith("."))


def _slug(text: str) -> str:
    """Return a text in letters that every system takes in the name of a file."""
    return re.sub(r"[^a-z0-9]+", "-", text.casefold()).strip("-")[:60].rstrip("-")
