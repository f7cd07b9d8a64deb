"""Runs GNU Octave, whichever of its programs is installed."""

import shutil
import subprocess
from pathlib import Path

#: The program without a window; where only the whole one is installed, that.
OCTAVE = shutil.which("octave-cli") or shutil.which("octave")

_BEGINS, _ENDS = "the script begins", "the script has ended"


def run_octave(folder: Path, code: str, timeout: float = 240.0) -> subprocess.CompletedProcess[str]:
    """Run code in a folder; standard error is what the code itself writes there.

    What the whole program says about windows when it starts, and about its threads when it leaves,
    is left out.
    """
    assert OCTAVE is not None
    (folder / "run_it.m").write_text(
        f'fputs(stderr, "{_BEGINS}\\n");\n{code}\nfputs(stderr, "{_ENDS}\\n");\n'
    )
    done = subprocess.run(
        [OCTAVE, "--no-gui", "--norc", "--no-history", "--quiet", "run_it.m"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    done.stderr = done.stderr.partition(f"{_BEGINS}\n")[2].partition(f"{_ENDS}\n")[0]
    return done
