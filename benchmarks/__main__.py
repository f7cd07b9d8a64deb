"""Run the benchmarks: `python -m benchmarks [--json] [--page FILE] [CASE ...]`.

Results come on standard output at the end; standard error says what runs meanwhile.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from itertools import groupby
from pathlib import Path

from benchmarks import (
    batch,
    cases,
    centring,
    exported,
    finite_elements,
    frequency_response,
    hysteresis,
    hysteresis_identification,
    hysteresis_plant,
    measuring,
    superelements,
    tolerance,
    twin,
)

CASES = {
    "analysis": cases.analysis,
    "batch": batch.batch,
    "equations": cases.equations,
    "growth": cases.growth,
    "elements": finite_elements.hinge,
    "elements-growth": finite_elements.growth,
    "superelements": superelements.superelements,
    "hysteresis": hysteresis.hysteresis,
    "identification": hysteresis_identification.identification,
    "plant": hysteresis_plant.plant,
    "response": frequency_response.response,
    "centring": centring.centring,
    "characterise": measuring.characterise,
    "twin": twin.twin,
    "exported": exported.exported,
    "tolerance": tolerance.tolerance,
}


#: How long cases took on two cores beside other work; the others take longer.
_TAKES = {
    "analysis": "1.5 minutes",
    "batch": "20 s",
    "equations": "1 minute",
    "exported": "2 minutes",
    "tolerance": "1 minute",
    "twin": "1.5 minutes",
}
_LONG = "some minutes"


def _timed(names: list[str]) -> list[cases.Row]:
    """Run cases, and say on standard error which one runs, what it has done, and for how long."""
    _say(f"{len(names)} of {len(CASES)} cases, about so long each on two busy cores:")
    for name in names:
        _say(f"  {name:<16}  {_TAKES.get(name, _LONG):<12}  {_what(name)}")
    rows: list[cases.Row] = []
    began = time.monotonic()
    for number, name in enumerate(names, start=1):
        start = time.monotonic()
        _say(f"{number}/{len(names)} {name} ...")
        for row in CASES[name]():
            rows.append(row)
            _say(f"    {row.case}: {row.route}: {row.time}")
        now = time.monotonic()
        _say(
            f"{number}/{len(names)} {name}: done in {now - start:.0f} s, {now - began:.0f} s in all"
        )
    return rows


def _what(name: str) -> str:
    return (CASES[name].__doc__ or "").splitlines()[0]


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


def _page(rows: list[cases.Row], machine: str) -> str:
    """Return the rows as a page of the manual, with the machine and the commit."""
    command = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    lines = [
        "# Benchmarks",
        "",
        f"Written by `make bench` at commit {commit or 'unknown'}, {machine}. Ratios are to the",
        "first line of a table; times depend on the machine, and on what else runs on it.",
    ]
    for case, group in groupby(rows, key=lambda row: row.case):
        head = "| route | time | ratio | limited by |"
        lines += ["", f"## {case}", "", head, "|---|---|---|---|"]
        for row in group:
            more = "" if row.time.finished else "> "
            lines.append(f"| {row.route} | {more}{row.time} | {row.ratio:.3g} | {row.limit} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Time flexstage against named alternatives."
    )
    parser.add_argument("names", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write a page of the manual")
    options = parser.parse_args()
    unknown = set(options.names) - set(CASES)
    if unknown:
        parser.error(f"unknown case '{min(unknown)}': expected {', '.join(CASES)}")
    rows = _timed(options.names or list(CASES))
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    if options.page is not None:
        options.page.parent.mkdir(parents=True, exist_ok=True)
        options.page.write_text(_page(rows, machine), encoding="utf-8")
    if options.json:
        print(
            json.dumps(
                {
                    "machine": machine,
                    "limit_s": cases.LIMIT,
                    "rows": [
                        {
                            "case": r.case,
                            "route": r.route,
                            "seconds": r.time.seconds,
                            "finished": r.time.finished,
                            "ratio": r.ratio,
                            "limited_by": r.limit,
                        }
                        for r in rows
                    ],
                },
                indent=2,
            )
        )
        return
    print(f"{machine}; '>': ended at its limit; ratios are to the first line of a case")
    for case, group in groupby(rows, key=lambda row: row.case):
        lines = list(group)
        width = max(len(row.route) for row in lines)
        print(f"\n{case}")
        for row in lines:
            mark = " " if row.time.finished else ">"
            print(
                f"  {row.route:<{width}}  {row.time!s:>10}  {mark}{row.ratio:>9.4g}   {row.limit}"
            )
    if not cases.HAVE_EXUDYN:
        print("\nEXUDYN is not installed, its lines are left out: pip install 'flexstage[verify]'")


if __name__ == "__main__":
    main()
