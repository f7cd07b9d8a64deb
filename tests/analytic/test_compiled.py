"""What is compiled is that of the sources that are there."""

import subprocess
import sys
from pathlib import Path

from flexstage.hysteresis.compiled import forget_outdated


def test_a_caller_follows_what_it_calls(tmp_path: Path) -> None:
    """Numba alone keeps the caller as it was compiled first."""
    room = tmp_path / "room"
    room.mkdir()
    (room / "caller.py").write_text(
        "from flexstage.hysteresis.compiled import compiled\nfrom callee import inner\n"
        "@compiled\ndef outer(x):\n    return inner(x) + 1.0\n"
    )
    program = (
        "import sys; from pathlib import Path; sys.path.insert(0, sys.argv[1]);"
        "from flexstage.hysteresis.compiled import forget_outdated;"
        "forget_outdated((Path(sys.argv[1]),)); from caller import outer;"
        "print(outer(3.0), sum(outer.stats.cache_hits.values()))"
    )
    said = []
    for factor in (2.0, 2.0, 10.0):
        content = (
            "from flexstage.hysteresis.compiled import compiled\n"
            f"@compiled\ndef inner(x):\n    return {factor} * x\n"
        )
        if not (room / "callee.py").exists() or (room / "callee.py").read_text() != content:
            (room / "callee.py").write_text(content)
        words = [sys.executable, "-c", program, str(room)]
        said.append(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
    assert said == ["7.0 0\n", "7.0 1\n", "31.0 0\n"]


def test_a_room_that_cannot_be_written_to_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "__pycache__").write_text("no folder")
    forget_outdated((tmp_path,))
    assert (tmp_path / "__pycache__").read_text() == "no folder"
