"""The JSON Schema of stage files; ``scripts/schemas.py`` writes it beside this file."""

from pathlib import Path
from typing import Any

from flexstage.files.schema import file_schema
from flexstage.stage.format import STAGE_FILE
from flexstage.stage.model import Stage

#: The schema that is shipped with the package.
SCHEMA_PATH = Path(__file__).with_name("stage.schema.json")


def stage_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of stage files."""
    schema = file_schema(STAGE_FILE, Stage)
    head, needed = [STAGE_FILE.key, "length_unit"], schema["required"]
    properties = schema["properties"]
    design = {
        "type": "object",
        "description": "A parametric design by name, with its parameters.",
        "properties": {"name": {"type": "string"}},
        "required": ["name"],
    }
    rest = {key: value for key, value in properties.items() if key not in head}
    only = [*head, "design"]
    return {
        **{key: value for key, value in schema.items() if key != "$defs"},
        "properties": {**{key: properties[key] for key in head}, "design": design, **rest},
        "required": [STAGE_FILE.key],
        "if": {"required": ["design"]},
        "then": {"propertyNames": {"enum": sorted(only)}},
        "else": {"required": [key for key in needed if key not in head]},
        "$defs": schema["$defs"],
    }
