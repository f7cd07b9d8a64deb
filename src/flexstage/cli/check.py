"""`flexstage check`: say what is wrong with a stage."""

from dataclasses import asdict
from typing import TYPE_CHECKING

import typer

from flexstage.cli.common import JsonOption, StageArgument, count, load_stage, print_json

if TYPE_CHECKING:
    from flexstage.stage import Stage

__all__ = ["check"]


def check(stage: StageArgument, json: JsonOption = False) -> None:
    """Check a stage: geometry, hinges, supports and drives."""
    from flexstage.stage.checks import check as check_stage

    described = load_stage(stage)
    findings = check_stage(described)
    errors = sum(f.severity == "error" for f in findings)
    if json:
        rows = [asdict(finding) for finding in findings]
        print_json({"stage": described.name, "ok": errors == 0, "findings": rows})
    else:
        for finding in findings:
            typer.echo(f"{finding.severity}: {finding.message}", err=True)
        if not errors:
            typer.echo(_summary(described, len(findings)))
    if errors:
        raise typer.Exit(2)


def _summary(stage: "Stage", warnings: int) -> str:
    found = "nothing wrong" if not warnings else f"no errors, {count(warnings, 'warning')}"
    parts = {
        "body": len(stage.bodies),
        "hinge": len(stage.hinges),
        "drive": len(stage.drives),
        "probe": len(stage.probes),
    }
    return f"{stage.name}: {found} ({', '.join(count(n, noun) for noun, n in parts.items())})"
