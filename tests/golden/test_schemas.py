"""The JSON Schemas that are shipped say of the frozen broken files what their readers say."""

import importlib.util
from pathlib import Path

import jsonschema
import pytest

from flexstage.base.errors import FlexstageError
from flexstage.experiments import ready_plans
from flexstage.files.nodes import Node, Scalar, parse_yaml, plain
from tests.golden.broken_files import READ, broken, frozen, kinds

_PLACE = Path(__file__).parents[2] / "scripts" / "schemas.py"
_SPEC = importlib.util.spec_from_file_location("schemas", _PLACE)
assert _SPEC is not None
assert _SPEC.loader is not None
scripts = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(scripts)

SCHEMAS = {path.name.partition(".")[0]: (path, made) for path, made in scripts.schemas().items()}
KINDS = kinds()


def content(text: bytes | str) -> object:
    """What a file holds by the core schema of YAML 1.2, as editors see it."""
    decoded = text.decode() if isinstance(text, bytes) else text
    node: Node = parse_yaml(decoded, "file", "file", FlexstageError)
    return node.value if isinstance(node, Scalar) else plain(node)


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_shipped_schema_is_the_one_of_the_classes(name):
    # mended by: python scripts/schemas.py
    path, made = SCHEMAS[name]
    assert path.read_text(encoding="utf-8") == scripts.schema_text(made)
    jsonschema.Draft202012Validator.check_schema(made)


def test_the_ready_plans_are_valid():
    validator = jsonschema.Draft202012Validator(SCHEMAS["plan"][1])
    for path in ready_plans().values():
        assert not list(validator.iter_errors(content(path.read_bytes())))


@pytest.mark.parametrize("name", SCHEMAS)
def test_an_editor_marks_no_file_that_is_read_and_most_that_are_refused(name):
    validator = jsonschema.Draft202012Validator(SCHEMAS[name][1])
    said = frozen(name)
    assert not list(validator.iter_errors(content(KINDS[name].text)))
    marked, refused = set(), set()
    for way, edit in KINDS[name].edits.items():
        try:
            held = content(broken(KINDS[name].text, edit))
        except (FlexstageError, UnicodeDecodeError):
            continue  # no editor reads it either
        (marked if not validator.is_valid(held) else set()).add(way)
        (refused if not said[way].startswith(READ) else set()).add(way)
    assert marked <= refused
    # what the schema cannot know: names that refer to others, and units of text
    assert len(marked) > 0.4 * len(refused)
