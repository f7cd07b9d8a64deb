"""The published schema of `results.json`, and what a program that loads tables asks of the file."""

import json
from pathlib import Path
from typing import Any

import jsonschema

import flexstage

PATH = Path(flexstage.__file__).parent / "studies" / "results.schema.json"
SCHEMA = json.loads(PATH.read_text("utf-8"))


def require_valid(document: dict[str, Any], kind: str) -> None:
    """Ask that a document is a study, a measurement or a run as the schema describes it."""
    one = {"$ref": f"#/$defs/{kind}", "$defs": SCHEMA["$defs"]}
    jsonschema.Draft202012Validator(one).validate(document)
