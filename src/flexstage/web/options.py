"""How the front panel is served: where, to whom, and where its files lie."""

import ipaddress
import socket
from dataclasses import dataclass
from pathlib import Path

from flexstage.errors import ModelError

_SHORTEST_PASSWORD = 10
_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})


def is_loopback(host: str) -> bool:
    """Say whether an address to listen on is reached by this computer alone."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelOptions:
    """Where the front panel is served, who may come in, and where its files lie.

    Raises
    ------
    ModelError
        It would be served to others without a password, or with half of a certificate.

    Examples
    --------
    >>> PanelOptions(folder=Path("panel")).is_loopback
    True
    >>> PanelOptions(folder=Path("panel"), host="0.0.0.0")
    Traceback (most recent call last):
    ...
    flexstage.errors.ModelError: others reach the front panel at 0.0.0.0: give it a password ...
    """

    folder: Path
    """Where files that are given to it, and files that it makes, are kept."""
    host: str = "127.0.0.1"
    """Address that it listens on."""
    port: int = 8321
    """TCP port; 0 for any free one."""
    password: str | None = None
    """What opens it, beside the address with a token."""
    certificate: Path | None = None
    """Certificate of TLS (PEM)."""
    key: Path | None = None
    """Private key of the certificate (PEM)."""
    host_names: tuple[str, ...] = ()
    """Names by which browsers reach it, beside that of this computer and addresses."""
    upload_limit: int = 256 * 2**20
    """Most bytes of one request."""

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise ModelError(f"the port must be 0 to 65535, got {self.port}")
        if self.password is None and not self.is_loopback:
            raise ModelError(
                f"others reach the front panel at {self.host}: give it a password "
                "(--password-file), or leave --host out"
            )
        if self.password is not None and len(self.password) < _SHORTEST_PASSWORD:
            raise ModelError(
                f"the password must have {_SHORTEST_PASSWORD} letters or more, got "
                f"{len(self.password)}"
            )
        if (self.certificate is None) != (self.key is None):
            raise ModelError("TLS needs a certificate and its key: give both or none")

    @property
    def is_loopback(self) -> bool:
        """Whether this computer alone reaches it."""
        return is_loopback(self.host)

    @property
    def scheme(self) -> str:
        """The scheme of its address."""
        return "https" if self.certificate else "http"

    def address(self, port: int) -> str:
        """Return the address that a browser on this computer opens."""
        everywhere = {"0.0.0.0": "127.0.0.1", "::": "::1"}
        host = everywhere.get(self.host, self.host)
        return f"{self.scheme}://{f'[{host}]' if ':' in host else host}:{port}/"

    def is_own_name(self, name: str) -> bool:
        """Say whether a browser may call the panel by a name.

        A foreign name that points to this computer may not: a page elsewhere would read it (DNS
        rebinding). A plain address belongs to nobody else.

        Examples
        --------
        >>> options = PanelOptions(folder=Path("panel"))
        >>> options.is_own_name("localhost"), options.is_own_name("lab.example")
        (True, False)
        """
        name = name.casefold()
        if name in _LOOPBACK or name == self.host.casefold():
            return True
        if name in {n.casefold() for n in self.host_names}:
            return True
        if self.is_loopback:
            return False
        if name == socket.gethostname().casefold():
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True
