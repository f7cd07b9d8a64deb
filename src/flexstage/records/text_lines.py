"""The lines of a text file, whatever its encoding."""

import re
from pathlib import Path

from flexstage.errors import RecordError

# control characters that no text has: a form feed, an escape and the old end of file may occur
_BINARY = re.compile("[\x00-\x08\x0e-\x19\x1c-\x1f]")


def text_lines(path: Path) -> list[str]:
    """Return the lines of a text file, UTF-8, UTF-16 with a mark, or Latin-1."""
    data = path.read_bytes()
    if not data.strip():
        raise RecordError(f"'{path}' is empty: there is nothing to read")
    text = decoded(data)
    if not text or _BINARY.search(text):
        raise RecordError(
            f"'{path}' is not a text file: give its format, or save the columns as CSV"
        )
    return text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\n\x1a \t").split("\n")


def decoded(data: bytes) -> str:
    """Return bytes as text, UTF-8, UTF-16 with a mark, or Latin-1; empty for half a letter."""
    wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "latin-1"):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return ""
