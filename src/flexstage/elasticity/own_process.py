"""Calls in a process of their own, so that a library that aborts does not end the program.

`python -P own_process.py ARGUMENTS RESULT` is that process. It imports nothing of the package
before it has read its task.
"""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

_WAITS = 3.0  # time on the clock, in times of the computing time, before a process is given up


class BrokenDownError(Exception):
    """The process ended without a result; the text is a predicate, such as "crashed"."""


def in_own_process(
    work: Callable[..., Any],
    *arguments: Any,
    seconds: float | None = None,
    memory: float | None = None,
) -> Any:
    """Return the result of a function of a module, called in a process of its own on one thread.

    Arguments, result and exceptions are pickled; its output is discarded. Computing time [s] and
    memory [byte] are limited, where the system can do so.
    """
    with tempfile.TemporaryDirectory() as folder:
        task, answer = Path(folder) / "given", Path(folder) / "answer"
        task.write_bytes(pickle.dumps((seconds, memory, pickle.dumps((work, arguments)))))
        one = {f"{name}_NUM_THREADS": "1" for name in ("NGS", "OMP", "OPENBLAS", "MKL")}
        try:
            ended = subprocess.run(
                [sys.executable, "-P", __file__, str(task), str(answer)],
                env={**os.environ, **one, "PYTHONPATH": os.pathsep.join(sys.path)},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=None if seconds is None else _WAITS * seconds,
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            ended = -_signal("SIGXCPU")
        if ended == 0:
            came, result = pickle.loads(answer.read_bytes())
            if came:
                return result
            if not isinstance(result, MemoryError):
                raise result
            raise BrokenDownError(f"needs more than {(memory or 0.0) / 1e9:.2g} GB of memory")
    raise BrokenDownError(_ending(ended, seconds))


def _ending(status: int, seconds: float | None) -> str:
    if seconds is not None and status == -_signal("SIGXCPU"):
        return f"did not finish within {seconds:.0f} s of computing time"
    if status == -_signal("SIGKILL"):
        return "was killed, probably for lack of memory,"
    try:
        return f"crashed (signal {-status}, {signal.Signals(-status).name})"
    except ValueError:
        return f"crashed (status {status})"


def _signal(name: str) -> int:
    return int(getattr(signal, name, 1 << 30))  # one that no process ends by, where there is none


def _main(arguments_path: str, answer: str) -> None:
    seconds, memory, task = pickle.loads(Path(arguments_path).read_bytes())
    if sys.platform != "win32":
        import resource

        for what, most in (("AS", memory), ("CPU", seconds), ("CORE", 0)):
            # a system need not know every limit
            with suppress(ValueError, OSError):
                kind = getattr(resource, f"RLIMIT_{what}")
                hard = resource.getrlimit(kind)[1]
                if most is not None:
                    resource.setrlimit(kind, (int(most), hard))
    try:
        work, arguments = pickle.loads(task)
        result = (True, work(*arguments))
    except Exception as error:  # noqa: BLE001 - the caller receives any
        if type(error).__module__ == "builtins":  # raised by mistake, and to be found there
            error.add_note(traceback.format_exc())
        result = (False, error)
    Path(answer).write_bytes(pickle.dumps(result))


if __name__ == "__main__":
    _main(*sys.argv[1:3])
