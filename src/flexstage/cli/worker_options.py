"""Who does work that can be shared: processes of this machine, or a cluster."""

import shutil
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from flexstage.errors import ModelError

if TYPE_CHECKING:
    from flexstage.explore import Workers


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """Who does the work.

    Parameters
    ----------
    workers
        --workers N: Number of processes that share long work (default: one for each core); 1 is
        this process alone. The numbers are the same whatever it is.
    scheduler
        --scheduler ADDRESS: Have a Dask cluster do the work, by the address of its scheduler, such
        as tcp://HOST:8786.
    """

    panel: ClassVar[str] = "Workers"
    workers: int | None = None
    scheduler: str | None = None

    def open(self) -> "AbstractContextManager[Workers]":
        """Return the workers, for a `with` block."""
        from flexstage.explore import open_workers

        return open_workers(self.workers, self.scheduler)


@contextmanager
def finished_batches(folder: Path | None) -> Iterator[Path | None]:
    """Give where finished batches are kept until this block ends, beside what is written there.

    They stay where it is interrupted, so that the same run goes on from them. Those of a run that
    fails by itself do not, as it would again; but those that were there before it do.
    """
    keep = None if folder is None else folder / "unfinished"
    before = keep is not None and keep.exists()
    try:
        yield keep
    except ModelError:
        if not before:
            _forget(keep)
        raise
    _forget(keep)


def _forget(keep: Path | None) -> None:
    if keep is not None and keep.exists():
        shutil.rmtree(keep)


#: None of them given.
USUAL_WORKERS = WorkerOptions()
