"""Running a notebook without a server: its cells in order, and what each shows."""

import ast
import contextlib
import io
import json
from pathlib import Path
from typing import Any

__all__ = ["code_cells", "run_cell"]


def code_cells(notebook: Path) -> list[dict[str, Any]]:
    """Return the cells of a notebook that hold code."""
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def run_cell(source: str, names: dict[str, Any]) -> tuple[str, Any]:
    """Run a cell; return what it prints, and the value of its last line if that is one."""
    *first, last = ast.parse(source).body
    value = None
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        shown = isinstance(last, ast.Expr)
        body = ast.Module(first if shown else [*first, last], type_ignores=[])
        exec(compile(body, "<cell>", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "<cell>", "eval"), names)
    return printed.getvalue(), value
