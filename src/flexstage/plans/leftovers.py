"""What an earlier attempt at a step has left: kept under another name, never written over."""

from pathlib import Path

from flexstage.errors import RecordError


def clear_leftovers(folder: Path, name: str, before: tuple[str, ...]) -> tuple[str, ...]:
    """Put aside what earlier attempts at a step have left.

    A stream that was cut short is recovered into ``NAME.partial-N.h5``; a record that is no longer
    valid becomes ``NAME.replaced-N.h5``.
    """
    kept = list(before)
    records = folder / "records"
    for path in sorted(records.iterdir()) if records.is_dir() else []:
        words = path.stem.split(".")
        # a name of a step has no dot; what follows one is the way in which a reference was followed
        aside = any(word.startswith(("partial-", "replaced-")) for word in words[1:])
        if words[0] != name or aside or path.suffix not in (".h5", ".stream"):
            continue
        if path.suffix == ".h5":
            target = _free(path, "replaced", ".h5")
            path.rename(target)
        else:
            target = _recovered(path)
        kept.append(target.relative_to(folder).as_posix())
    return tuple(kept)


def _recovered(stream: Path) -> Path:
    """Keep what a stream holds: as a record where it holds samples, else as it is."""
    from flexstage.instruments.recording.archive import archived

    target = _free(stream, "partial", ".h5")
    try:
        archived(stream, target)
    except RecordError:
        # no two whole samples are in it, or another program writes it: it is kept as it is
        target = _free(stream, "partial", ".stream")
        stream.rename(target)
        return target
    stream.unlink()
    return target


def _free(path: Path, word: str, suffix: str) -> Path:
    """Return a name that is not taken."""
    k = 1
    while (made := path.with_name(f"{path.stem}.{word}-{k}{suffix}")).exists():
        k += 1
    return made
