#!/usr/bin/env python3
"""Write the JSON Schemas that are shipped, each beside what it describes.

python scripts/schemas.py
"""

import json
from pathlib import Path
from typing import Any

import flexstage
from flexstage.centring.table_file import TABLE_FILE, RotaryTable
from flexstage.experiments.campaign.plan import CAMPAIGN_FILE, Campaign
from flexstage.experiments.plan import PLAN_FILE, Plan
from flexstage.files.schema import file_schema
from flexstage.measure.uncertainty.budget_file import BUDGET_FILE, Budget
from flexstage.stage.file import SCHEMA_PATH, stage_schema

PACKAGE = Path(flexstage.__file__).parent


def schemas() -> dict[Path, dict[str, Any]]:
    """Make the schema of each kind of file that people write, by its place."""
    return {
        SCHEMA_PATH: stage_schema(),
        PACKAGE / "experiments" / "plan.schema.json": file_schema(PLAN_FILE, Plan),
        PACKAGE / "experiments" / "campaign" / "campaign.schema.json": file_schema(
            CAMPAIGN_FILE, Campaign
        ),
        PACKAGE / "centring" / "table.schema.json": file_schema(TABLE_FILE, RotaryTable),
        PACKAGE / "measure" / "uncertainty" / "budget.schema.json": file_schema(
            BUDGET_FILE, Budget
        ),
    }


def schema_text(schema: dict[str, Any]) -> str:
    """Write a schema as the text of its file."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for path, schema in schemas().items():
        path.write_text(schema_text(schema), encoding="utf-8")
