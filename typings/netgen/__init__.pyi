# The library's own stubs are generated from C++ and name too few of its overloads to check against.
from typing import Any

def __getattr__(name: str) -> Any: ...
