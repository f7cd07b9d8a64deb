"""The command lines of README and manual: found, run, compared with what is printed below them.

A page runs from top to bottom in one empty folder: its Python, the files that it says, and its
commands with their defaults. Those of flexstage alone run in this process, which has loaded what
they need; what a shell makes of a line, and what stays, runs in a process of its own.
"""

import contextlib
import io
import os
import re
import shlex
import signal
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import pytest

from flexstage.cli import main
from flexstage.instruments.connect import longest_silence

#: Largest difference of a printed number from the one that comes, in units of its last digit.
_DIGIT = 2.0
_NUMBER = re.compile(r"[-+\N{MINUS SIGN}]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_RULE = re.compile(r"^[\s─\-=]*$")
_READY = 60.0
#: Longest time without an answer of a simulated controller [s].
_SILENCE = 120.0


class Command(NamedTuple):
    """One command, and what is printed below it."""

    line: str
    printed: list[str]


def commands(code: str) -> list[Command]:
    """Return the commands of a console block; without a prompt each line is one."""
    lines = code.splitlines()
    prompted = any(line.startswith("$ ") for line in lines)
    found: list[Command] = []
    at = 0
    while at < len(lines):
        line = lines[at]
        at += 1
        if prompted and not line.startswith("$ "):
            if found:
                found[-1].printed.append(line)
            continue
        line = line.removeprefix("$ ")
        while line.endswith("\\"):
            line = line[:-1] + lines[at].strip()
            at += 1
        if line.strip():
            found.append(Command(line, []))
    return found


def differences(
    printed: list[str], got: str, *, digits: bool = True, noise: float = 0.0
) -> list[str]:
    """Return the printed lines that did not come, in their order; one of '…' stands for any.

    A long line may be folded in print. Without digits any number will do; with
    noise, one that differs by that share.
    """
    came = " ".join(got.split())
    missed, at = [], 0
    for line in printed:
        wanted = " ".join(line.split())
        if not wanted or wanted == "…" or _RULE.match(line):
            continue
        hits = re.compile(_pattern(wanted)).finditer(came, at)
        hit = next((h for h in hits if not digits or _near_all(wanted, h, noise)), None)
        if hit is None:
            missed.append(line)
        else:
            at = hit.end()
    return missed


def _pattern(wanted: str) -> str:
    """A pattern of the words of a line, with a group for each number."""
    parts = []
    for part in wanted.split("…"):
        words = _NUMBER.split(part)
        parts.append(f"({_NUMBER.pattern})".join(re.escape(word) for word in words))
    return ".*?".join(parts)


def _near_all(wanted: str, hit: re.Match[str], noise: float) -> bool:
    pairs = zip(_NUMBER.findall(wanted.replace("…", " ")), hit.groups(), strict=True)
    return all(_near(a, b, noise) for a, b in pairs)


def _near(wanted: str, came: str, noise: float) -> bool:
    mantissa, _, power = wanted.replace("\N{MINUS SIGN}", "-").partition("e")
    decimals = len(mantissa.partition(".")[2])
    digit = 10.0 ** (int(power or 0) - decimals)
    values = [float(text.replace("\N{MINUS SIGN}", "-")) for text in (wanted, came)]
    return abs(values[0] - values[1]) <= _DIGIT * digit * (1.0 + 1e-9) + noise * abs(values[0])


def _alone(line: str) -> list[str]:
    """Return the words of a command of flexstage that no shell is needed for, or none."""
    bare = re.sub(r"""'[^']*'|"[^"$`\\]*\"""", "", line)
    shells = re.search(r"[$`*?~(){};<>|&\\]", bare)
    words = [] if shells else shlex.split(line)
    return words[1:] if words[:1] == ["flexstage"] else []


class Shell:
    """Runs commands in a folder, and ends what it left running."""

    def __init__(self, folder: Path, environment: Mapping[str, str]) -> None:
        self.folder = folder
        self.environment = {**os.environ, **environment}
        self._running: list[subprocess.Popen[str]] = []

    def run(self, line: str, limit: float) -> subprocess.CompletedProcess[str]:
        """Run one to its end; where it changes the folder, those after it run there."""
        if line.startswith("cd "):
            self.folder = self.folder / line[3:].strip()
        words = _alone(line)
        if words:
            return self._here(words)
        return subprocess.run(
            ["bash", "-c", "true" if line.startswith("cd ") else line], cwd=self.folder,
            env=self.environment, capture_output=True, text=True, timeout=limit, check=False,
        )  # fmt: skip

    def _here(self, words: list[str]) -> subprocess.CompletedProcess[str]:
        """Run a command of flexstage in this process, as one that was started anew would."""
        # a stream of bytes below, as that of a process
        out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
        status: object = 1
        with (
            pytest.MonkeyPatch.context() as patch,
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            for name, value in self.environment.items():
                patch.setenv(name, value)
            patch.chdir(self.folder)
            # the twin of a page is a process that a busy machine may leave waiting
            patch.setattr(longest_silence, "__defaults__", (_SILENCE,))
            try:
                main(words)
            except SystemExit as end:
                status = end.code
        said = [stream.buffer.getvalue().decode() for stream in (out, err)]  # type: ignore[attr-defined]
        return subprocess.CompletedProcess(words, int(str(status or 0)), *said)

    def serve(self, line: str) -> str:
        """Start one that stays, in place of the one before; return its first line."""
        self.end()
        process = subprocess.Popen(
            ["bash", "-c", f"exec {line}"], cwd=self.folder, env=self.environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        self._running.append(process)
        assert process.stdout is not None
        return process.stdout.readline()

    def end(self) -> None:
        """End what was left running, as Ctrl-C does."""
        for process in self._running:
            process.send_signal(signal.SIGINT)
            try:
                process.communicate(timeout=_READY)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
        self._running.clear()
