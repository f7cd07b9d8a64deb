"""Find words that the project does not use, see docs/contributing/words.txt.

Run it as ``python scripts/words.py [PATH ...]``.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIST = ROOT / "docs" / "contributing" / "words.txt"
PAGES = ("README.md", "CHANGELOG.md", "SECURITY.md", "docs", "src")
#: What `make docs` writes.
GENERATED = [ROOT / "docs" / "reference" / n for n in ("api", "command-line.md", "evidence.md")]
SUFFIXES = {".py", ".md", ".html", ".js", ".ipynb"}


def read_list(text: str) -> tuple[re.Pattern[str], dict[str, str], dict[str, str]]:
    """Return the pattern of words in texts, what to write in their place, and the same of names."""
    better: dict[str, dict[str, str]] = {"text": {}, "name": {}}
    for line in text.splitlines():
        if line and not line.startswith("#"):
            words, _, instead = line.partition(" -> ")
            kind, _, words = words.partition(" ")
            better[kind] |= dict.fromkeys(words.split(", "), instead)
    longest_first = sorted(better["text"], key=len, reverse=True)
    spaced = (re.escape(words).replace(r"\ ", r"\s+") for words in longest_first)
    return re.compile(rf"\b(?:{'|'.join(spaced)})\b", re.IGNORECASE), better["text"], better["name"]


def texts(source: str) -> Iterator[tuple[int, str]]:
    """Yield the line and text of each string and comment of Python source."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def names(source: str) -> Iterator[tuple[int, str]]:
    """Yield the line and name of each variable, parameter, field, function and class."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.name


def findings(path: Path, listed: str) -> Iterator[str]:
    """Yield a line for each word of a file that the list has."""
    pattern, text_words, name_words = read_list(listed)
    source = path.read_text("utf-8")
    python = path.suffix == ".py"
    for line, text in texts(source) if python else ((1, source),):
        for match in pattern.finditer(text):
            at = line + text.count("\n", 0, match.start())
            word = " ".join(match[0].lower().split())
            yield f"{path}:{at}: '{match[0]}': {text_words[word]}"
    for line, name in names(source) if python else ():
        if (word := name.strip("_").lower()) in name_words:
            yield f"{path}:{line}: a name '{name}': {name_words[word]}"


def main(paths: list[str]) -> int:
    """Print the words of files and folders that the list has; return how many there are."""
    roots = [Path(p) for p in paths] or [ROOT / p for p in PAGES]
    files = [f for r in roots for f in (sorted(r.rglob("*")) if r.is_dir() else [r])]
    files = [f for f in files if f.suffix in SUFFIXES and not {f, f.parent} & set(GENERATED)]
    listed = LIST.read_text("utf-8")
    lines = [x for f in files for x in findings(f, listed)]
    print(*lines, sep="\n")
    return len(lines)


if __name__ == "__main__":
    sys.exit(1 if main(sys.argv[1:]) else 0)
