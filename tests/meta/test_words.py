"""The list of words that the project does not use is read, and finds them."""

from pathlib import Path

import pytest

from scripts import words

SOURCE = '''"""Say what holds."""
# nobody knows
def fit(told: float) -> float:
    found = told  # found in a comment is English
    return f"{found} left out"
'''


def test_texts_and_names_are_found_with_their_lines(tmp_path: Path) -> None:
    file = tmp_path / "module.py"
    file.write_text(SOURCE, "utf-8")
    listed = "# a comment\ntext nobody, left out -> no user\nname told, found -> message\n"
    expected = [
        f"{file}:5: 'left out': no user",
        f"{file}:2: 'nobody': no user",
        f"{file}:4: a name 'found': message",
        f"{file}:3: a name 'told': message",
    ]
    assert sorted(words.findings(file, listed)) == sorted(expected)


def test_a_page_is_looked_through_as_text(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("A line.\n\nIt goes\non; Nobody does.\n", "utf-8")
    listed = "text goes on, nobody -> continues\n"
    assert [x.partition(": ")[2] for x in words.findings(page, listed)] == [
        "'goes\non': continues",
        "'Nobody': continues",
    ]
    assert next(words.findings(page, listed)).startswith(f"{page}:3:")


# `make lint` looks through the whole project.
def test_the_command_counts(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "a.py").write_text("told = 1\n", "utf-8")
    assert words.main([str(tmp_path)]) == 1
    assert "a name 'told'" in capsys.readouterr().out
    (tmp_path / "a.py").write_text("length = 1\n", "utf-8")
    assert words.main([str(tmp_path)]) == 0
