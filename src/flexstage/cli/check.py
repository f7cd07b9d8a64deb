"""`flexstage check`: errors and warnings about a stage."""

import re
from dataclasses import asdict
from typing import TYPE_CHECKING

import typer

from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import count, print_json
from flexstage.cli.stage_options import AS_DRAWN, DrawnStageOptions, StageArgument

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexstage.stage import Issue, Stage


@from_docstring
def check(
    stage: StageArgument,
    options: DrawnStageOptions = AS_DRAWN,
    json: JsonOption = False,
) -> None:
    """Check a stage: geometry, hinges, supports and drives."""
    from flexstage.stage.checks import check as check_stage

    described = options.stage(stage)
    issues = check_stage(described)
    errors = sum(issue.severity == "error" for issue in issues)
    if json:
        rows = [asdict(issue) for issue in issues]
        print_json({"stage": described.name, "ok": errors == 0, "findings": rows})
    else:
        for line in _lines(issues):
            typer.echo(line, err=True)
        if not errors:
            typer.echo(_summary(described, len(issues)))
    if errors:
        raise typer.Exit(2)


def _lines(issues: "Sequence[Issue]") -> list[str]:
    """Return a line for each issue; issues that differ only in names and numbers share one."""
    groups: dict[tuple[str, str], list[Issue]] = {}
    for issue in issues:
        sentence = re.sub(r"'[^']*'|[-\d.]+", "", issue.message)
        groups.setdefault((issue.severity, sentence), []).append(issue)
    lines = []
    for (severity, _), group in groups.items():
        lines.append(f"{severity}: {group[0].message}")
        if len(group) > 1:
            others = "; ".join(" at ".join(issue.what) for issue in group[1:])
            lines.append(f"  the same for {len(group) - 1} more: {others}")
    return lines


def _summary(stage: "Stage", warnings: int) -> str:
    outcome = "no problems found" if not warnings else f"no errors, {count(warnings, 'warning')}"
    parts = {
        "body": len(stage.bodies),
        "hinge": len(stage.hinges),
        "drive": len(stage.drives),
        "probe": len(stage.probes),
    }
    return f"{stage.name}: {outcome} ({', '.join(count(n, noun) for noun, n in parts.items())})"
