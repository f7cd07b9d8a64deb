"""Set up a virtual environment from a requirement lock; do nothing when it is already right.

Usage: python scripts/environment.py ENVIRONMENT LOCK

The environment is made anew when the Python, the lock or the place of the checkout has changed; the
package alone is installed again when only ``pyproject.toml`` has. A stamp in the environment says
what it was made from; it goes first and comes last, so an interrupted run leaves none. Only the
standard library is needed.
"""

import fcntl
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def digest(path: Path) -> str:
    """Return a fingerprint of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def read_stamp(stamp: Path) -> dict[str, str]:
    """Return what an environment was made from, or nothing when that is not known."""
    try:
        return json.loads(stamp.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def set_up(environment: Path, lock: Path) -> None:
    """Bring one environment to the state that the lock and the project ask for."""
    python = environment / "bin" / "python"
    stamp = environment / "flexstage-stamp.json"
    base = {"python": sys.version, "place": str(environment), "lock": digest(lock)}
    wanted = base | {"project": digest(ROOT / "pyproject.toml")}
    found = read_stamp(stamp)
    if found == wanted and python.exists():
        return

    start = time.monotonic()
    stamp.unlink(missing_ok=True)
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    if {key: found.get(key) for key in base} != base or not python.exists():
        print(f"setting up {environment.name} from {lock.relative_to(ROOT)} ...", file=sys.stderr)
        # This may be the Python of the environment itself, where that is activated: it is about to
        # go, and the one that it was made from stays.
        maker = getattr(sys, "_base_executable", sys.executable)
        shutil.rmtree(environment, ignore_errors=True)
        subprocess.run([maker, "-m", "venv", str(environment)], check=True)
        # A lock names wheels for every platform, so nothing is ever built here. Python translates a
        # module when it is first imported; to do so with all of them takes longer than all else.
        locked = ["--no-compile", "--require-hashes", "--only-binary", ":all:"]
        locked += ["--requirement", str(lock)]
        subprocess.run(pip + locked, check=True)
    editable = ["--no-deps", "--no-build-isolation", "--editable", str(ROOT)]
    subprocess.run(pip + editable, check=True)

    draft = stamp.with_suffix(".draft")
    draft.write_text(json.dumps(wanted), encoding="utf-8")
    draft.replace(stamp)
    print(f"{environment.name} is ready ({time.monotonic() - start:.0f} s)", file=sys.stderr)


def main(arguments: list[str]) -> int:
    """Set up the environment named on the command line, one process at a time."""
    environment, lock = ((ROOT / argument).absolute() for argument in arguments)
    # A setting of the shell must not let the environment see packages from elsewhere.
    os.environ.pop("PYTHONPATH", None)
    os.environ.pop("PYTHONHOME", None)
    with environment.with_name(environment.name + ".lock").open("w") as guard:
        fcntl.flock(guard, fcntl.LOCK_EX)
        try:
            set_up(environment, lock)
        except subprocess.CalledProcessError as error:
            print(f"{environment.name} could not be set up: {error}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
