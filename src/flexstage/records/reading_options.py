"""What texts say on how files are read: options of commands, fields of a page."""

from collections.abc import Sequence
from typing import Any

from flexstage.errors import RecordError
from flexstage.units import parse


def understood(
    files: int,
    *,
    sample_rate: str | None,
    time: str | None,
    resample: str | None = None,
    rows: str | None,
    delimiter: str | None,
    **how: Any,
) -> dict[str, Any]:
    """Return what options on some files say, as `flexstage.records.files.read_files` takes it."""
    # NumPy comes with it, and commands name columns before they need any
    from flexstage.records.sampling import row_range

    rates = file_rates(sample_rate, "--sample-rate", files)
    new_rates = file_rates(resample, "--resample", files)
    return {
        **how,
        "rates_hz": rates,
        "resample_hz": None if resample is None else new_rates,
        "time": None if time is None else column(time),
        "rows": row_range(rows, "--rows"),
        "delimiter": _spelled(delimiter),
    }


def _spelled(delimiter: str | None) -> str | None:
    # a shell passes a backslash and a letter where a tab is meant
    return None if delimiter is None else delimiter.replace("\\t", "\t")


def file_rates(text: str | None, option: str, files: int) -> Sequence[float | None]:
    """Return a rate for each file [Hz], of one or one for each; None where none is given.

    That of --resample may be median, which is None as well.
    """
    if text is None:
        return [None] * files
    given = [
        None
        if option == "--resample" and word.strip() == "median"
        else parse(word, "frequency", bare_unit="Hz")
        for word in text.split(",")
    ]
    if len(given) not in (1, files):
        raise RecordError(
            f"{option} needs one rate, or one for each of {files} files, got {len(given)}"
        )
    return given * files if len(given) == 1 else given


def column(text: str) -> str | int:
    """Return what names a column: its number, or its name.

    Examples
    --------
    >>> column("4"), column("position")
    (4, 'position')
    """
    plain = text.strip()
    return int(plain) if plain.isdecimal() else plain


def column_list(text: str | None) -> list[str | int]:
    """Return what names several columns, with commas between.

    Examples
    --------
    >>> column_list("4, position"), column_list(None)
    ([4, 'position'], [])
    """
    return [column(word) for word in (text or "").split(",") if word.strip()]
