"""Run the benchmarks: `python -m benchmarks [--json] [CASE ...]`."""

import argparse
import json
import platform
import sys
from itertools import groupby

from benchmarks import (
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
    twin,
)

CASES = {
    "analysis": cases.analysis,
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
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    options = parser.parse_args()
    unknown = set(options.names) - set(CASES)
    if unknown:
        parser.error(f"unknown case '{min(unknown)}': expected {', '.join(CASES)}")
    rows: list[cases.Row] = []
    for name in options.names or CASES:
        for row in CASES[name]():
            rows.append(row)
            if sys.stderr.isatty():
                sys.stderr.write(f"\r{row.case}: {row.route}\033[K")
                sys.stderr.flush()
    if sys.stderr.isatty():
        sys.stderr.write("\r\033[K")
    machine = f"{platform.machine()}, Python {platform.python_version()}"
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
