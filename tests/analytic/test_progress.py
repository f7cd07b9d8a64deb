"""Progress without a terminal: a line now and then, and none of short work."""

from flexstage.progress import now_and_then, reporting, share, tell


def test_a_line_comes_after_a_while_and_not_before_the_next() -> None:
    lines: list[str] = []
    times = iter([100.0, 104.0, 111.0, 114.0, 120.5, 121.5])
    with reporting(now_and_then(lines.append, 10.0, lambda: next(times))):
        tell("chain", 0.1)
        with share(0.2, 1.0):
            tell("Dahl", 0.25)
            tell("Duhem", 0.5)
            tell("Preisach", 0.75)
            tell("Preisach", 1.0)
    assert lines == ["40 % after 11 s: Dahl", "100 % after 22 s: Preisach"]
