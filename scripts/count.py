#!/usr/bin/env python3
"""Count the package: lines by room, names on faces, modules of one importer, doubled names.

    python scripts/count.py [SRC]

Lines are those that hold a token of code, of a docstring or of a comment alone. A face is the
`__init__` of a room. Only imports inside the package count; those for types alone are left out of
circles.
"""

import ast
import io
import re
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

PACKAGE = "flexstage"
#: What parses the text of a file that people or programs write, in place of the one codec.
PARSERS = re.compile(r"\byaml\.(parse|compose|load|safe_load)\(|\bjson\.loads?\(|\btomllib\.")


@dataclass(slots=True)
class Module:
    """What one file holds."""

    name: str
    path: Path
    code: int = 0
    docstrings: int = 0
    comments: int = 0
    classes: list[str] = field(default_factory=list)
    face: list[str] = field(default_factory=list)
    imports: set[str] = field(default_factory=set)
    of_types: set[str] = field(default_factory=set)

    @property
    def room(self) -> str:
        """The room that it is of."""
        parts = self.name.split(".")
        return parts[1] if len(parts) > 1 else PACKAGE


def read(path: Path, source: Path) -> Module:
    """Read one file."""
    parts = list(path.relative_to(source).with_suffix("").parts)
    if parts[-1] == "__init__":
        parts.pop()
    module = Module(".".join(parts), path)
    text = path.read_text("utf-8")
    tree = ast.parse(text)
    documented = docstring_lines(tree)
    code, comments = set(), set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        span = range(token.start[0], token.end[0] + 1)
        if token.type == tokenize.COMMENT:
            comments.update(span)
        elif token.string.strip() and token.type != tokenize.ENDMARKER:
            code.update(span)
    code -= documented
    module.code, module.docstrings = len(code), len(documented)
    module.comments = len(comments - code - documented)
    module.classes = [n.name for n in ast.walk(tree) if isinstance(n, ast.ClassDef)]
    if path.name == "__init__.py":
        module.face = exported(tree)
    imports(tree.body, module, for_types=False)
    return module


def docstring_lines(tree: ast.Module) -> set[int]:
    """The lines of its docstrings, and of the texts below the fields of its classes."""
    lines: set[int] = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        texts = node.body if isinstance(node, ast.ClassDef) else node.body[:1]
        for text in texts:
            if (
                isinstance(text, ast.Expr)
                and isinstance(text.value, ast.Constant)
                and isinstance(text.value.value, str)
            ):
                lines.update(range(text.lineno, (text.end_lineno or text.lineno) + 1))
    return lines


def exported(tree: ast.Module) -> list[str]:
    """The names of `__all__`."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return [str(c.value) for c in ast.walk(node.value) if isinstance(c, ast.Constant)]
    return []


def imports(body: list[ast.stmt], module: Module, *, for_types: bool) -> None:
    """Collect what a file imports of the package, at its top and in its functions."""
    for node in body:
        guarded = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node):
            if isinstance(inner, ast.ImportFrom) and (inner.module or "").startswith(PACKAGE):
                names = {f"{inner.module}.{alias.name}" for alias in inner.names}
                (module.of_types if guarded or for_types else module.imports).update(names)
            elif isinstance(inner, ast.Import):
                names = {a.name for a in inner.names if a.name.startswith(PACKAGE)}
                (module.of_types if guarded or for_types else module.imports).update(names)


def resolved(name: str, known: set[str]) -> str | None:
    """The module of an imported name."""
    while name not in known and "." in name:
        name = name.rpartition(".")[0]
    return name if name in known else None


def circles(arrows: dict[str, set[str]]) -> Iterator[list[str]]:
    """The groups of modules that import each other, by Tarjan's algorithm."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []

    def visit(node: str) -> Iterator[list[str]]:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(arrows.get(node, ())):
            if other not in index:
                yield from visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            at = stack.index(node)
            group = stack[at:]
            del stack[at:]
            if len(group) > 1:
                yield sorted(group)

    for node in sorted(arrows):
        if node not in index:
            yield from visit(node)


def main(source: Path) -> None:
    """Print the counts."""
    sys.setrecursionlimit(10_000)
    modules = [read(p, source) for p in sorted((source / PACKAGE).rglob("*.py"))]
    known = {m.name for m in modules}
    for m in modules:
        # a star on a face brings what another module imports for types
        starred = {name.removesuffix(".*") for name in m.of_types if name.endswith(".*")}
        m.face += [name for other in modules if other.name in starred for name in other.of_types]
    rooms: dict[str, Counter[str]] = defaultdict(Counter)
    for m in modules:
        top = m.face if m.name.count(".") <= 1 and m.path.name == "__init__.py" else []
        rooms[m.room].update(
            files=1, code=m.code, docstring=m.docstrings, comment=m.comments, names=len(top)
        )
    columns = ("files", "code", "docstring", "comment", "names")
    say(f"{'room':16}" + "".join(f"{c:>11}" for c in columns))
    for room, counts in sorted(rooms.items(), key=lambda item: -item[1]["code"]):
        say(f"{room:16}" + "".join(f"{counts[c]:>11}" for c in columns))
    total = sum(rooms.values(), Counter())
    say(f"{'all':16}" + "".join(f"{total[c]:>11}" for c in columns))

    importers: dict[str, set[str]] = defaultdict(set)
    arrows: dict[str, set[str]] = defaultdict(set)
    for m in modules:
        for name in m.imports | m.of_types:
            target = resolved(name, known)
            if target not in (None, m.name):
                importers[str(target)].add(m.name)
                if name in m.imports:
                    arrows[m.name].add(str(target))
    once = [m.name for m in modules if len(importers[m.name]) == 1 and m.path.name != "__init__.py"]
    doubled = Counter(name for m in modules for name in m.classes if not name.startswith("_"))
    twice = sorted(name for name, count in doubled.items() if count > 1)
    groups = list(circles(arrows))
    say(f"\nnames on all faces: {sum(len(m.face) for m in modules)}")
    say(f"modules imported by one other: {len(once)}")
    say(f"class names that exist twice: {len(twice)}: {', '.join(twice)}")
    say(f"circles of imports: {len(groups)}")
    for group in groups:
        say(f"  {', '.join(group)}")
    parsers = [m.name for m in modules if PARSERS.search(m.path.read_text("utf-8"))]
    say(f"modules that parse YAML or JSON: {len(parsers)}: {', '.join(parsers)}")


def say(line: str) -> None:
    """Print a line."""
    sys.stdout.write(line + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "src")
