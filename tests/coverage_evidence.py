"""How often the errors that an identification states hold, over cuts of measured records.

At one rate delay and creep are not determined: withheld errors are counted as such. Run as a
program for a table of counts: ``python tests/coverage_evidence.py 25`` cuts each file of
``../shared/data/picma-p885``, and ``python tests/coverage_evidence.py 12 FOLDER`` pairs of files
``SERIES_RATE_*.csv`` of a folder, with columns of time, drive and position, that differ in rate.
The reference is what the whole records give.
"""

import math
import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from flexstage.base.errors import FlexstageError
from flexstage.hysteresis import identify
from flexstage.hysteresis.identification.result import Identification
from flexstage.records import Record, read_record

PICMA = Path(__file__).resolve().parents[2] / "shared" / "data" / "picma-p885"
#: Intervals of 95 %.
WIDE = 1.96
Pair = tuple[Record, ...]


def picma() -> Iterator[tuple[Pair, str, str, tuple[int, int]]]:
    """Yield records, columns, and shortest and longest cut [samples]: both files, at one rate."""
    for name, columns in (("Test_Vi_Do_Di", ("0", "4")), ("Model_Vi_Do", ("0", "4"))):
        record = read_record(PICMA / f"{name}.dat", sample_rate=200.0)
        yield (record,), *columns, (1500, 5000)


def pairs(folder: Path) -> Iterator[tuple[Pair, str, str, tuple[int, int]]]:
    """Yield pairs of files of one series at two rates; what precedes the cycles is left out."""
    series: dict[str, list[tuple[int, Path]]] = {}
    for path in sorted(folder.glob("cont_*.csv")):
        found = re.search(r"_(20|40|100)_?(?:hz)?", path.stem)
        if found is not None:
            # where the rate stands in the name belongs to the series: their filters differ
            key = path.stem[: found.start()] + "_*" + path.stem[found.end() :]
            series.setdefault(key, []).append((int(found.group(1)), path))
    for files in series.values():
        for two in combinations(sorted(files), 2):
            yield tuple(cycles_of(rate, path) for rate, path in two), "1", "2", (10, 25)


def cycles_of(rate_hz: int, path: Path) -> Record:
    """The last 45 cycles of a file."""
    record = read_record(path)
    whole = int(45 * record.sample_rate_hz / rate_hz)
    return part(record, record.time.size - whole, record.time.size)


def part(record: Record, start: int, stop: int) -> Record:
    """Cut a record."""
    channels = tuple(replace(c, values=c.values[start:stop]) for c in record.channels)
    return replace(record, channels=channels, time=record.time[start:stop])


def cuts(records: Pair, length: tuple[int, int], count: int) -> Iterator[Pair]:
    """Yield parts of records."""
    rng = np.random.default_rng(50)
    for _ in range(count):
        size = int(rng.integers(*length))
        ends = []
        for r in records:
            # of two rates cycles are counted
            own = size if len(records) == 1 else size * r.time.size // 45
            start = int(rng.integers(0, r.time.size - own))
            ends.append((start, start + own))
        yield tuple(part(r, *e) for r, e in zip(records, ends, strict=True))


def stated(found: Identification) -> dict[str, tuple[float, float]]:
    """Values and standard errors that are looked at; an error that is none is infinite."""
    own = {e.name: e for e in (*found.chain, *found.parameters)}
    made = {}
    for name in ("delay", "creep_per_decade", "gain"):
        if name in own:
            error = own[name].standard_error
            finite = error is not None and math.isfinite(error) and error > 0.0
            made[name] = (own[name].value, float(error) if finite else math.inf)
    return made


def main() -> None:
    """Write the counts of every record, or pair."""
    count = int(sys.argv[1])
    every = pairs(Path(sys.argv[2])) if len(sys.argv) > 2 else picma()
    total: Counter[str] = Counter()
    for records, driven, follows, length in every:
        whole = stated(identify(records, driven, follows, model="bouc-wen"))
        for own in cuts(records, length, count):
            try:
                found = identify(own, driven, follows, model="bouc-wen")
            except FlexstageError as error:
                total[f"refused: {str(error)[:40]}"] += 1
                continue
            for name, (value, error) in stated(found).items():
                if math.isinf(error):
                    total[f"{name} withheld"] += 1
                    continue
                both = math.hypot(error, whole[name][1] if math.isfinite(whole[name][1]) else 0.0)
                inside = abs(value - whole[name][0]) <= WIDE * both
                total[f"{name} {'covered' if inside else 'missed'}"] += 1
        sys.stdout.write(f"{records[0].source}: {whole}\n{dict(sorted(total.items()))}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
