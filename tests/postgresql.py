"""A server of PostgreSQL for the tests: on loopback, in a temporary folder, gone when they end."""

import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

_STARTS_WITHIN = 60.0  # [s]


class NoServerError(Exception):
    """There can be no server here; the message says why."""


@pytest.fixture(scope="session")
def postgresql_server() -> Iterator[str]:
    """Give the address of a server, whose user may make databases."""
    try:
        with _server() as address:
            yield address
    except NoServerError as error:
        pytest.skip(f"no PostgreSQL: {error}")


@contextmanager
def database(server: str) -> Iterator[str]:
    """Give the address of a schema that is new and empty: to its user, a database of its own.

    To make and remove a database proper took the server 170 ms, a schema at most 7 ms.
    """
    import psycopg
    from psycopg import sql

    name = f"catalogue_{secrets.token_hex(6)}"
    with closing(psycopg.connect(f"{server}/postgres", autocommit=True)) as connection:
        connection.execute(sql.SQL("CREATE SCHEMA {}").format(sql.Identifier(name)))
        try:
            yield f"{server}/postgres?options=-csearch_path%3D{name}"
        finally:
            connection.execute(sql.SQL("DROP SCHEMA {} CASCADE").format(sql.Identifier(name)))


@contextmanager
def _server() -> Iterator[str]:
    programs = _programs()
    account = _account()
    folder = Path(tempfile.mkdtemp(prefix="flexstage-postgresql-"))
    try:
        if account is not None:
            os.chown(folder, *account)
        password = secrets.token_hex(16)
        _make_cluster(programs, folder, password, account)
        process, port = _started(programs, folder, password, account)
        try:
            yield f"postgresql://flexstage:{password}@127.0.0.1:{port}"
        finally:
            process.send_signal(signal.SIGINT)  # ends at once, connections and all
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(30)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _programs() -> Path:
    """Return where the programs are: Debian keeps them out of the search path."""
    if sys.platform == "win32":
        raise NoServerError("this fixture starts servers on POSIX systems only")
    found = [Path(p).resolve().parent for p in [shutil.which("postgres")] if p]
    found += sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    for folder in found:
        if (folder / "initdb").exists() and (folder / "postgres").exists():
            return folder
    raise NoServerError("it is not installed (scripts/debian-packages.sh installs it as root)")


def _account() -> tuple[int, int] | None:
    """Return user and group that the server runs as: it refuses to run as root."""
    if os.geteuid() != 0:
        return None
    import pwd

    for name in ("postgres", "nobody"):
        try:
            entry = pwd.getpwnam(name)
        except KeyError:
            continue
        return entry.pw_uid, entry.pw_gid
    raise NoServerError("it does not run as root, and there is no user 'postgres' or 'nobody'")


def _as(account: tuple[int, int] | None) -> dict[str, object]:
    if account is None:
        return {}
    return {"user": account[0], "group": account[1], "extra_groups": []}


def _make_cluster(
    programs: Path, folder: Path, password: str, account: tuple[int, int] | None
) -> None:
    secret = folder / "password"
    secret.write_text(password + "\n")
    if account is not None:
        os.chown(secret, *account)
    words = [programs / "initdb", "-D", folder / "data", "-U", "flexstage", "-E", "UTF8"]
    words += ["--locale=C", "--auth=scram-sha-256", f"--pwfile={secret}", "--no-sync"]
    made = subprocess.run(
        words, capture_output=True, text=True, timeout=120, check=False, cwd=folder, **_as(account)
    )  # type: ignore[call-overload]
    if made.returncode:
        raise NoServerError(f"initdb failed: {made.stderr.strip().splitlines()[-1:]}")


def _started(
    programs: Path, folder: Path, password: str, account: tuple[int, int] | None
) -> tuple[subprocess.Popen[bytes], int]:
    """Start the server on a free port; another program may take the port first, so try again."""
    log = folder / "log"
    for _ in range(5):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        words = [programs / "postgres", "-D", folder / "data", "-c", "listen_addresses=127.0.0.1"]
        words += ["-c", f"port={port}", "-c", "unix_socket_directories=", "-c", "fsync=off"]
        with log.open("ab") as out:
            process = subprocess.Popen(
                words, stdout=out, stderr=out, stdin=subprocess.DEVNULL, cwd=folder, **_as(account)
            )  # type: ignore[call-overload]
        if _ready(process, port, password):
            return process, port
        process.kill()
        process.wait(30)
    raise NoServerError(f"it did not start: {log.read_text(errors='replace')[-300:]}")


def _ready(process: "subprocess.Popen[bytes]", port: int, password: str) -> bool:
    import psycopg

    end = time.monotonic() + _STARTS_WITHIN
    address = f"postgresql://flexstage:{password}@127.0.0.1:{port}/postgres"
    while time.monotonic() < end and process.poll() is None:
        try:
            psycopg.connect(address, connect_timeout=5).close()
        except psycopg.OperationalError:
            time.sleep(0.05)
        else:
            return True
    return False
