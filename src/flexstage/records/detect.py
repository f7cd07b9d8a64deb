"""Format of a file of measured data: by request, by its first bytes, or by its suffix."""

from pathlib import Path

from flexstage.base.errors import RecordError
from flexstage.records.cmm import has_report
from flexstage.records.text import is_gcs_array
from flexstage.records.text_rows import decoded
from flexstage.records.universal_sets import is_universal

#: Suffixes of the formats of `read_record`; reports of measuring machines have none.
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
# bytes to examine: enough for the preamble of a report
_HEAD = 65_536


def format_of(file: Path, requested: str | None = None) -> str:
    """Return the format of a file: by request, by its first bytes, or by its suffix."""
    if requested is not None:
        suffix = f".{requested.lower().lstrip('.')}"
        for name, suffixes in FORMATS.items():
            if requested.lower() == name or suffix in suffixes:
                return name
        raise RecordError(f"the format must be one of {', '.join(FORMATS)}, got '{requested}'")
    with file.open("rb") as stream:
        head = stream.read(_HEAD)
    suffix = file.suffix.lower()
    for signature, name in _SIGNATURES:
        if head.startswith(signature):
            return name
    if head.startswith(b"PK\x03\x04"):
        return "numpy"
    kind = next((name for name, suffixes in FORMATS.items() if suffix in suffixes), "text")
    if kind == "matlab" and _is_ascii(head[:64]):
        return "text"
    return _kind_of_text(head) if kind == "text" else kind


def _is_ascii(head: bytes) -> bool:
    """Return whether a file may be text, as MATLAB writes with its option -ascii."""
    return bool(head) and all(byte >= 32 or byte in b"\t\r\n" for byte in head) and max(head) < 127


def _kind_of_text(head: bytes) -> str:
    """Return the format of a text file, by its first lines."""
    if is_universal(head):
        return "universal"
    # whole lines, as half a letter would change the encoding
    text = decoded(head if len(head) < _HEAD else head[: (head.rfind(b"\n") + 1) // 2 * 2])
    if is_gcs_array(text):
        return "gcs"
    return "cmm" if has_report(text.splitlines()) else "text"
