"""How a text names columns of a file."""


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
