"""C that tests compile: text to a shared library, loaded with ctypes."""

import ctypes
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

__all__ = [
    "EXACT",
    "OPTIMISED",
    "STRICT",
    "compile_program",
    "compiler",
    "load_library",
    "write_files",
]

#: Flags with which double precision gives the bits of Python; optimisation, which takes three times
#: as long to compile, changes none of them (`test_optimisation_does_not_change_a_bit`).
EXACT = ("-O0", "-ffp-contract=off")
#: The same for long runs, and for warnings that only the optimiser gives.
OPTIMISED = ("-O1", *EXACT[1:])
#: Flags under which every warning is an error.
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror")


def compiler(*names: str) -> str:
    """Return a C compiler, or skip the test.

    Parameters
    ----------
    *names : str
        Compilers that will do; gcc where none is given.

    Returns
    -------
    str
        Its path.
    """
    for name in names or ("gcc",):
        found = shutil.which(name)
        if found:
            return found
    pytest.skip(f"no compiler: {' or '.join(names or ('gcc',))} is not installed")


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write content by file name into a folder.

    Parameters
    ----------
    folder : Path
        The folder; made where it is not there.
    files : Mapping
        Content by name.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stderr}"


#: Libraries of this process by what they were compiled from.
_LOADED: dict[tuple[object, ...], ctypes.CDLL] = {}


def load_library(
    folder: Path,
    source: str,
    *,
    files: Mapping[str, bytes] | None = None,
    flags: Sequence[str] = EXACT,
    with_compiler: str = "gcc",
) -> ctypes.CDLL:
    """Compile a source text into a shared library and load it; the same text is compiled once.

    Parameters
    ----------
    folder : Path
        Where headers and library are written, of this test alone.
    source : str
        The text, in C.
    files : Mapping, optional
        Further files by name, which it includes.
    flags : Sequence of str
        Flags of the compiler besides those that every warning is an error.
    with_compiler : str
        The compiler; the test is skipped where it is absent.

    Returns
    -------
    ctypes.CDLL
        The library.
    """
    found = compiler(with_compiler)
    written = {**(files or {}), "library.c": source.encode()}
    key = (found, *flags, *sorted(written.items()))
    if key in _LOADED:
        return _LOADED[key]
    write_files(folder, written)
    # one name a library, else the loader gives the first one again
    number = len(list(folder.glob("library*.so")))
    library = folder / f"library{number}.so"
    c = str(folder / "library.c")
    _run([found, *STRICT, *flags, "-shared", "-fPIC", c, "-o", str(library), "-lm"])
    _LOADED[key] = ctypes.CDLL(str(library))
    return _LOADED[key]


def compile_program(
    folder: Path,
    source: str,
    *,
    files: Mapping[str, bytes] | None = None,
    flags: Sequence[str] = EXACT,
    with_compiler: str = "gcc",
    strict: Sequence[str] = STRICT,
) -> Path:
    """Compile a source text into a program.

    Parameters
    ----------
    folder : Path
        Where headers and program are written, of this test alone.
    source : str
        The text, in C.
    files : Mapping, optional
        Further files by name, which it includes.
    flags : Sequence of str
        Flags of the compiler.
    with_compiler : str
        The compiler; the test is skipped where it is absent.
    strict : Sequence of str
        Flags by which every warning is an error, and the language.

    Returns
    -------
    Path
        The program.
    """
    found = compiler(with_compiler)
    suffix = "cpp" if "++" in with_compiler else "c"
    write_files(folder, {**(files or {}), f"program.{suffix}": source.encode()})
    program = folder / "program"
    text = str(folder / f"program.{suffix}")
    _run([found, *strict, *flags, text, "-o", str(program), "-lm"])
    return program
