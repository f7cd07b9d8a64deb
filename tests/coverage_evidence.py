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
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from flexstage.base.errors import FlexstageError
from flexstage.hysteresis import identify
from flexstage.hysteresis.identification.result import Identification
from flexstage.hysteresis.prediction import Prediction, predict
from flexstage.records import Record, read_record

PICMA = Path(__file__).resolve().parents[2] / "shared" / "data" / "picma-p885"
#: Intervals of 95 %, and the shares of errors that a band of 95 % may hold.
WIDE, BAND = 1.96, (0.90, 0.99)
QUANTILES = (0.05, 0.5, 0.95)
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


def cuts(
    records: Pair, length: tuple[int, int], count: int
) -> Iterator[tuple[Pair, tuple[tuple[int, int], ...]]]:
    """Yield parts of records, and where they are."""
    rng = np.random.default_rng(50)
    for _ in range(count):
        size = int(rng.integers(*length))
        ends = []
        for r in records:
            # of two rates cycles are counted
            own = size if len(records) == 1 else size * r.time.size // 45
            start = int(rng.integers(0, r.time.size - own))
            ends.append((start, start + own))
        yield tuple(part(r, *e) for r, e in zip(records, ends, strict=True)), tuple(ends)


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


def within(found: Identification, tried: Prediction) -> NDArray[np.bool_]:
    """Samples after the warm-up of cycles that stay within the range that was identified."""
    assert found.model.validity is not None
    low, high = found.model.validity.input_range
    margin = 0.01 * (high - low)
    outside = (tried.command < low - margin) | (tried.command > high + margin)
    period = float(np.median([1.0 / c.rate_hz for c in tried.cycles])) if tried.cycles else 0.0
    reach = round(period / (tried.time[1] - tried.time[0]))
    near = maximum_filter1d(outside.astype(np.int8), 2 * reach + 1) > 0
    return ~near & (np.arange(near.size) >= tried.warm_up)


def held_out(
    found: Identification, records: Pair, ends: Sequence[tuple[int, int]], columns: tuple[str, str]
) -> tuple[float, float] | None:
    """Share of errors inside the stated band, and their rms [%], over what was not cut out.

    With a free constant, and only where the drive stays within the range that was identified, as
    the model says of itself.
    """
    band = found.heldout_band_percent
    if band is None:
        return None
    errors = []
    for r, (start, stop) in zip(records, ends, strict=True):
        for a, b in ((0, start), (stop, r.time.size)):
            if b - a < r.time.size // 5:
                continue
            tried = predict(found.model, part(r, a, b), *columns)
            known = within(found, tried)
            if known.sum() < r.time.size // 10:
                continue
            error = 100.0 * (tried.measured - tried.predicted)[known] / found.stroke
            errors.append(error - error.mean())
    if not errors:
        return None
    shares = [float(np.mean(np.abs(e) < band)) for e in errors]
    return float(np.mean(shares)), float(np.sqrt(np.mean([np.mean(e**2) for e in errors])))


def main() -> None:
    """Write the counts of every record, or pair."""
    count = int(sys.argv[1])
    every = pairs(Path(sys.argv[2])) if len(sys.argv) > 2 else picma()
    total: Counter[str] = Counter()
    bands: list[float] = []
    ratios: list[float] = []
    wide: list[float] = []
    for records, driven, follows, length in every:
        whole = stated(identify(records, driven, follows, model="bouc-wen"))
        for own, ends in cuts(records, length, count):
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
            elsewhere = held_out(found, records, ends, (driven, follows))
            if elsewhere is None:
                continue
            bands.append(elsewhere[0])
            held, error = found.heldout_free_rms_percent, found.heldout_standard_error
            if held is not None and error is not None:
                inside = abs(elsewhere[1] - held) <= WIDE * error
                total[f"held-out error {'covered' if inside else 'missed'}"] += 1
                ratios.append(elsewhere[1] / held)
                wide.append(error / held)
        sys.stdout.write(f"{records[0].source}: {whole}\n{dict(sorted(total.items()))}\n")
        if bands:
            inside = sum(BAND[0] <= b <= BAND[1] for b in bands)
            sys.stdout.write(
                f"the band of 95 % held {100 * np.median(bands):.1f} % of errors elsewhere in the "
                f"median, {100 * min(bands):.0f} to {100 * max(bands):.0f}; {inside} of "
                f"{len(bands)} cuts within 90 to 99 %, "
                f"{sum(b > BAND[1] for b in bands)} above\n"
                "in 5, 50 and 95 % of the cuts errors elsewhere over those held out are "
                f"{np.round(np.quantile(ratios, QUANTILES), 2)}, and their standard errors "
                f"{np.round(np.quantile(wide, QUANTILES), 2)}\n"
            )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
