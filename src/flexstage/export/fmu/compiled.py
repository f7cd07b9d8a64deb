"""The shared library of an FMU, made by the C compiler of this computer."""

import platform
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from flexstage.errors import ModelError

#: Options that keep every result to the last bit: products and sums are not contracted. A higher
#: level gains a tenth in time, but reads ahead what it then does not use, which valgrind reports.
OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off")

_COMPILERS = ("cc", "gcc", "clang")
_TIME_LIMIT = 300  # seconds; the largest stage takes a few
_SYSTEMS = {"linux": "linux", "win32": "windows", "darwin": "darwin"}
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
_EXTENSIONS = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}


def compiler() -> str | None:
    """Return the path of the C compiler that is found; None where there is none."""
    return next((path for name in _COMPILERS if (path := shutil.which(name))), None)


def binary_folder(version: str) -> tuple[str, str]:
    """Return where an importer on this computer looks: folder under ``binaries``, and extension."""
    system = _SYSTEMS.get(sys.platform, sys.platform)
    machine = platform.machine().lower()
    machine = _MACHINES.get(machine, machine)
    extension = _EXTENSIONS.get(system, ".so")
    if version == "2.0" and machine == "x86_64" and system in _EXTENSIONS:
        return {"windows": "win64"}.get(system, f"{system}64"), extension
    return f"{machine}-{system}", extension


def shared_library(sources: Mapping[str, bytes], main: str, name: str) -> bytes:
    """Compile the main file of some sources, which includes the others, into a shared library."""
    found = compiler()
    if found is None:
        raise ModelError(
            "no C compiler was found for the binary of the FMU: install gcc or clang, or export "
            "the sources alone"
        )
    extension = binary_folder("3.0")[1]
    with TemporaryDirectory(prefix="flexstage-fmu-") as folder:
        for file, content in sources.items():
            (Path(folder) / file).write_bytes(content)
        out = f"{name}{extension}"
        command = [found, *OPTIONS, "-fvisibility=hidden", "-shared", "-o", out, main]
        if extension != ".dll":
            command += ["-fPIC", "-lm"]
        if extension == ".so":
            # the same sources give the same bytes
            command += ["-s", "-Wl,--build-id=none"]
        try:
            done = subprocess.run(
                command,
                cwd=folder,
                capture_output=True,
                text=True,
                timeout=_TIME_LIMIT,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as problem:
            raise ModelError(f"the C compiler {found} did not finish: {problem}") from problem
        if done.returncode != 0:
            said = next((x for x in done.stderr.splitlines() if "error" in x), done.stderr.strip())
            raise ModelError(f"the C compiler {found} refused the sources of the FMU: {said}")
        return (Path(folder) / out).read_bytes()
