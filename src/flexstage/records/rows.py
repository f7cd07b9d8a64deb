"""A range of samples as text."""

from flexstage.errors import RecordError


def row_range(text: str | None, option: str) -> tuple[int | None, int | None] | None:
    """Return a range of samples.

    Examples
    --------
    >>> row_range("400:", "--rows")
    (400, None)
    """
    if text is None:
        return None
    words = [word.strip() for word in text.split(":")]
    if len(words) != 2 or not all(word == "" or word.isdecimal() for word in words):
        raise RecordError(f"{option} must be a range of samples such as 400:7200, got '{text}'")
    start, stop = (int(word) if word else None for word in words)
    if start is not None and stop is not None and start >= stop:
        raise RecordError(f"{option} must rise, got '{text}'")
    return start, stop
