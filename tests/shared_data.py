"""Measurements and finite elements of others, read in the folder beside the project."""

from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
#: Why a test is skipped without them; the run counts these at its end.
ABSENT = "the data of others in ../shared/data are absent"


def needs(name: str) -> pytest.MarkDecorator:
    """Skip without a folder of the data."""
    return pytest.mark.skipif(not (DATA / name).is_dir(), reason=ABSENT)
