"""Which format a file of measured data has: by what was asked, its first bytes, its suffix."""

from pathlib import Path

from flexstage.base.errors import RecordError
from flexstage.records.cmm import has_report
from flexstage.records.gcs_array import is_gcs_array
from flexstage.records.text_rows import decoded
from flexstage.records.universal_sets import is_universal

#: Suffixes of the formats that `read_record` knows; reports of measuring machines have none.
FORMATS: dict[str, tuple[str, ...]] = {
    "text": (".csv", ".txt", ".dat", ".tsv", ".asc", ".lvm"),
    "matlab": (".mat",),
    "hdf5": (".h5", ".hdf5", ".hdf"),
    "tdms": (".tdms",),
    "numpy": (".npy", ".npz"),
    "universal": (".uff", ".unv", ".ufb", ".bunv"),
    "gcs": (".gcs",),
    "cmm": (),
}

_SIGNATURES = (
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 5.0 MAT-file", "matlab"),
    (b"MATLAB 7.3 MAT-file", "matlab"),
    (b"TDSm", "tdms"),
    (b"\x93NUMPY", "numpy"),
)
# enough for the preamble of a report, little to look through in a file of many samples
_HEAD = 65_536


def format_of(file: Path, wanted: str | None = None) -> str:
    """Return the format of a file: as told (or a suffix), by its first bytes, by its suffix."""
    if wanted is not None:
        suffix = f".{wanted.lower().lstrip('.')}"
        for name, suffixes in FORMATS.items():
            if wanted.lower() == name or suffix in suffixes:
                return name
        raise RecordError(f"the format must be one of {', '.join(FORMATS)}, got '{wanted}'")
    with file.open("rb") as stream:
        head = stream.read(_HEAD)
    suffix = file.suffix.lower()
    for signature, name in _SIGNATURES:
        if head.startswith(signature):
            return name
    if head.startswith(b"PK\x03\x04"):
        return "numpy"
    known = next((name for name, suffixes in FORMATS.items() if suffix in suffixes), "text")
    if known == "matlab" and _is_text(head[:64]):
        return "text"
    return _kind_of_text(head) if known == "text" else known


def _is_text(head: bytes) -> bool:
    """Say whether a file could be what MATLAB writes by its option -ascii."""
    return bool(head) and all(byte >= 32 or byte in b"\t\r\n" for byte in head) and max(head) < 127


def _kind_of_text(head: bytes) -> str:
    """Return which text a file is, whose suffix does not say more."""
    if is_universal(head):
        return "universal"
    # whole lines, as half a letter would change the encoding
    text = decoded(head if len(head) < _HEAD else head[: (head.rfind(b"\n") + 1) // 2 * 2])
    if is_gcs_array(text):
        return "gcs"
    return "cmm" if has_report(text.splitlines()) else "text"
