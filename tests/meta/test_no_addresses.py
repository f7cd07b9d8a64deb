"""No file names a package index: where packages come from is the machine's own setting."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LOCKS = sorted((ROOT / "requirements").glob("*.txt"))

# In pieces, so that this file does not hold what it forbids. The second row serves scripts to
# pages: a report or a page that loads one does not open offline.
HOSTS = [
    ("pypi", "org"), ("pythonhosted", "org"), ("anaconda", "org"), ("npmjs", "org"),
    ("jsdelivr", "net"), ("unpkg", "com"), ("cdnjs", "cloudflare"), ("cdn", "plot"),
]  # fmt: skip
FORBIDDEN = re.compile(
    "|".join(
        [re.escape(".".join(host)) for host in HOSTS] + ["--(extra-)?index" + "-url[ =]+[a-z]"]
    ),
    re.IGNORECASE,
)
#: What a file that names one holds in any case, in small letters: few files do.
CLUES = (*(".".join(host) for host in HOSTS), "index" + "-url")


def project_files() -> list[Path]:
    """Return the files of the project, tracked or about to be."""
    listing = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        out = subprocess.run(listing, cwd=ROOT, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [
        ROOT / name.decode()
        for name in out.split(b"\0")
        if name and (ROOT / name.decode()).is_file()
    ]


def test_no_file_names_a_package_index() -> None:
    found = []
    for path in project_files():
        text = path.read_text("utf-8", "ignore")
        small = text.lower()
        if any(clue in small for clue in CLUES):
            found += [
                f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}"
                for number, line in enumerate(text.splitlines(), 1)
                if FORBIDDEN.search(line)
            ]
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize("lock", LOCKS, ids=lambda path: path.name)
def test_lock_holds_versions_and_hashes_only(lock: Path) -> None:
    for entry in lock.read_text().replace("\\\n", " ").splitlines():
        assert re.fullmatch(
            r"[\w.-]+==[^\s;]+( ; [^-]+)?(\s+--hash=sha256:[0-9a-f]{64})+\s*", entry
        ), entry


def test_there_are_two_locks_that_agree() -> None:
    pins = {
        lock.stem: set(re.findall(r"^[\w.-]+==[^\s;]+", lock.read_text(), re.M)) for lock in LOCKS
    }
    assert pins.keys() == {"main", "dev"}
    assert pins["main"] < pins["dev"]
