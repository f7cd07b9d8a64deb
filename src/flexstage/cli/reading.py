"""The formats in which commands write records."""

from pathlib import Path

from flexstage.base.errors import ModelError

_FORMATS = {".csv": "csv", ".npz": "npz", ".h5": "hdf5", ".hdf5": "hdf5", ".mat": "mat"}


def record_format(out: Path | None) -> str:
    """Return the format that the suffix of a path says; CSV where nothing is written.

    Examples
    --------
    >>> record_format(Path("drive.h5"))
    'hdf5'
    """
    if out is None:
        return "csv"
    if out.suffix.lower() not in _FORMATS:
        raise ModelError(
            f"--out must end in one of {', '.join(_FORMATS)}, got '{out.name}': the suffix says "
            "the format"
        )
    return _FORMATS[out.suffix.lower()]
