"""Fixtures of the tests of identities."""

from collections.abc import Iterator

import pytest

from tests.virtual_stages import set_once


@pytest.fixture(scope="session", autouse=True)
def _virtual_stages_are_set_once() -> Iterator[None]:
    with set_once():
        yield
