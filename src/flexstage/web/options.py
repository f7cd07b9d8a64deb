"""Options of the server of the front panel: address, access and folder."""

import ipaddress
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from flexstage.base.errors import ModelError
from flexstage.files.ranges import Written
from flexstage.files.request import Request, request_fields
from flexstage.instruments.requests import Address

_SHORTEST_PASSWORD = 10
_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})


def is_loopback(host: str) -> bool:
    """Return whether an address to listen on is reachable from this computer only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _first_line(path: Path) -> str:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise ModelError(f"the password file '{path}' is not a text file in UTF-8") from None
    if not lines:
        raise ModelError(f"the password file '{path}' is empty: its first line is the password")
    return lines[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate(Request):
    """Encryption of the network (TLS): a certificate and its key, or none."""

    one_value: ClassVar[bool] = True

    certificate: Path | None = None
    """Certificate (PEM)."""
    key: Path | None = None
    """Private key of the certificate (PEM)."""

    def __post_init__(self) -> None:
        super(Certificate, self).__post_init__()
        if (self.certificate is None) != (self.key is None):
            raise ModelError("TLS needs both a certificate and its key")


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeRequest(Request):
    """Address of the front panel, and folder of its files."""

    address: Address = ("127.0.0.1", 8321)
    """Address and TCP port to listen on, 0 for any free port. The default address 127.0.0.1 admits
    this computer alone; any other address admits the network and needs a password.
    """
    password_file: Path | None = None
    """File whose first line is the password that opens the panel."""
    tls: Certificate = Certificate()
    """Encryption, by "certificate=cert.pem,key=key.pem" (default: none)."""
    host_name: Annotated[tuple[str, ...], Written("NAME")] = ()
    """Additional host name of the panel in the address of a browser."""
    folder: Annotated[Path, Written("FOLDER")] = Path("front-panel")
    """Folder for uploaded files and for files that the panel writes."""

    @property
    def host(self) -> str:
        """The address to listen on."""
        return self.address[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelOptions(ServeRequest):
    """Address, access and folder of the front panel.

    Raises
    ------
    ModelError
        An address open to the network has no password, or the key of the certificate is missing.

    Examples
    --------
    >>> PanelOptions(folder=Path("panel")).is_loopback
    True
    >>> PanelOptions(folder=Path("panel"), address=("0.0.0.0", 8321))
    Traceback (most recent call last):
    ...
    flexstage.base.errors.ModelError: 0.0.0.0 admits other computers to the front panel: give a ...
    """

    password: str | None = None
    """Password, an alternative to the address with a token; the first line of the password file."""
    upload_limit: int = 256 * 2**20
    """Largest size of a request [byte]."""

    def __post_init__(self) -> None:
        super(PanelOptions, self).__post_init__()
        if self.password_file is not None:
            object.__setattr__(self, "password", _first_line(self.password_file))
        if self.password is None and not self.is_loopback:
            raise ModelError(
                f"{self.host} admits other computers to the front panel: give a password "
                "(--password-file), or omit the address in --address"
            )
        if self.password is not None and len(self.password) < _SHORTEST_PASSWORD:
            raise ModelError(
                f"the password must have {_SHORTEST_PASSWORD} letters or more, got "
                f"{len(self.password)}"
            )

    @classmethod
    def of(cls, request: ServeRequest) -> "PanelOptions":
        """Return the options of a request; the folder is relative to the present directory."""
        for file in filter(None, (request.tls.certificate, request.tls.key)):
            if not file.is_file():
                raise ModelError(f"there is no file '{file}': TLS needs its certificate and key")
        values: dict[str, Any] = {n: getattr(request, n) for n in request_fields(ServeRequest)}
        values["folder"] = request.folder.absolute()
        return cls(**values)

    @property
    def is_loopback(self) -> bool:
        """Access from this computer only."""
        return is_loopback(self.host)

    @property
    def scheme(self) -> str:
        """Scheme of the address."""
        return "https" if self.tls.certificate else "http"

    def url(self, port: int) -> str:
        """Return the address for a browser on this computer."""
        everywhere = {"0.0.0.0": "127.0.0.1", "::": "::1"}
        host = everywhere.get(self.host, self.host)
        return f"{self.scheme}://{f'[{host}]' if ':' in host else host}:{port}/"

    def is_own_name(self, name: str) -> bool:
        """Return whether a host name in a request is a name of the panel.

        A foreign name that resolves to this computer is not: a page of another site could read the
        panel (DNS rebinding). A numeric address cannot be rebound.

        Examples
        --------
        >>> options = PanelOptions(folder=Path("panel"))
        >>> options.is_own_name("localhost"), options.is_own_name("lab.example")
        (True, False)
        """
        name = name.casefold()
        if name in _LOOPBACK or name == self.host.casefold():
            return True
        if name in {n.casefold() for n in self.host_name}:
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
