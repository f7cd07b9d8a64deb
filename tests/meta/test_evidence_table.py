"""The table of evidence is made from the docstrings of tests, with the outcome of a run."""

from types import SimpleNamespace

from tests import evidence_table


def test_each_paragraph_of_evidence_is_a_row_of_a_known_part() -> None:
    rows = evidence_table.rows()
    assert {row.part for row in rows} == set(evidence_table.PARTS)
    files = evidence_table.TESTS.glob("*/test_*.py")
    marks = sum(file.read_text("utf-8").count("\nEvidence (") for file in files)
    assert len(rows) == marks > 75


def test_the_page_of_a_run_has_the_outcome_of_each_file() -> None:
    row, other, *_ = [row for row in evidence_table.rows() if row.part == "Finite elements"]
    reports = [SimpleNamespace(nodeid=f"tests/{row.file}::test_{k}") for k in range(3)]
    reporter = SimpleNamespace(stats={"passed": reports[:2], "failed": reports[2:]})
    page = evidence_table.page(evidence_table.outcomes_of(reporter))  # type: ignore[arg-type]
    assert f"| {row.text} | `{row.file}` | 2 passed, 1 failed |" in page
    assert f"| {other.text} | `{other.file}` | not run |" in page
    assert page.startswith("# Table of evidence\n\nRevision ")
