"""What is said of broken files is what was frozen, and says what is wrong and where."""

import re
from functools import cache

import pytest

from tests.golden.broken_files import CRASH, HERE, READ, SOUND, frozen, kinds, sentences

KINDS = kinds()
#: Kinds whose readers know the line of every value.
WITH_LINES = ("stage", "design", "hysteresis-model", "plan", "campaign", "budget")
#: What has no line: the whole file is wrong, or the parser of YAML does not tell it.
WITHOUT_LINE = {
    "more than 1 MB", "a zero", "a control character", "a web page", "a drawing", "a solid",
    "no file", "a folder",
}  # fmt: skip
#: A reference that is resolved when the plan is carried out, after its lines are forgotten.
FORGOTTEN = {("plan", "a stage near one"), ("plan", "a stage in no file")}


@cache
def now(name):
    return dict(sentences(KINDS[name]))


def refusals(name):
    return {way: said for way, said in now(name).items() if not said.startswith(READ)}


@pytest.mark.parametrize("name", KINDS)
def test_every_message_is_as_frozen(name):
    assert now(name) == frozen(name)


@pytest.mark.parametrize("name", KINDS)
def test_the_unbroken_file_is_read(name):
    assert now(name)[SOUND] == READ


@pytest.mark.parametrize("name", KINDS)
def test_twenty_ways_and_no_error_of_another_library(name):
    assert len(refusals(name)) >= 20
    assert not [way for way, said in refusals(name).items() if said.startswith(CRASH)]


@pytest.mark.parametrize("name", KINDS)
def test_every_message_names_the_file(name):
    file = f"{HERE}/{KINDS[name].file}"
    nameless = {(name, way) for way, said in refusals(name).items() if file not in said}
    assert nameless <= FORGOTTEN


@pytest.mark.parametrize("name", WITH_LINES)
def test_every_message_names_the_line_that_its_reader_knows(name):
    lost = {
        way
        for way, said in refusals(name).items()
        if way not in WITHOUT_LINE
        and (name, way) not in FORGOTTEN
        and not re.search(rf"{HERE}/{KINDS[name].file}, line \d+(?:, [^ ]+)?: ", said)
    }
    assert not lost
