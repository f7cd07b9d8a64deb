"""How the front panel is served: where, to whom, and where its files lie."""

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
    """Say whether an address to listen on is reached by this computer alone."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _first_line(path: Path) -> str:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise ModelError(f"the password file '{path}' is no text in UTF-8") from None
    if not lines:
        raise ModelError(f"the password file '{path}' is empty: its first line is the password")
    return lines[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate(Request):
    """What encrypts the network (TLS): a certificate with its key, or none."""

    one_value: ClassVar[bool] = True

    certificate: Path | None = None
    """Certificate (PEM)."""
    key: Path | None = None
    """Private key of the certificate (PEM)."""

    def __post_init__(self) -> None:
        super(Certificate, self).__post_init__()
        if (self.certificate is None) != (self.key is None):
            raise ModelError("TLS needs a certificate and its key: give both or none")


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeRequest(Request):
    """Where the front panel is served, and where its files lie."""

    address: Address = ("127.0.0.1", 8321)
    """Address and TCP port to listen on, 0 for any free port; any address but 127.0.0.1, which is
    meant where none is given, lets others on the network in, and needs a password.
    """
    password_file: Path | None = None
    """File whose first line is the password that opens the panel."""
    tls: Certificate = Certificate()
    """Encryption, by "certificate=cert.pem,key=key.pem" (default: none)."""
    host_name: Annotated[tuple[str, ...], Written("NAME")] = ()
    """Name by which browsers reach it, beside that of this computer."""
    folder: Annotated[Path, Written("FOLDER")] = Path("front-panel")
    """Where files that are given to the panel, and those it makes, are kept."""

    @property
    def host(self) -> str:
        """The address to listen on."""
        return self.address[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelOptions(ServeRequest):
    """Where the front panel is served, who may come in, and where its files lie.

    Raises
    ------
    ModelError
        It would be served to others without a password, or with half of a certificate.

    Examples
    --------
    >>> PanelOptions(folder=Path("panel")).is_loopback
    True
    >>> PanelOptions(folder=Path("panel"), address=("0.0.0.0", 8321))
    Traceback (most recent call last):
    ...
    flexstage.base.errors.ModelError: others reach the front panel at 0.0.0.0: give it a ...
    """

    password: str | None = None
    """What opens it, beside the address with a token; that of the file where there is one."""
    upload_limit: int = 256 * 2**20
    """Most bytes of one request."""

    def __post_init__(self) -> None:
        super(PanelOptions, self).__post_init__()
        if self.password_file is not None:
            object.__setattr__(self, "password", _first_line(self.password_file))
        if self.password is None and not self.is_loopback:
            raise ModelError(
                f"others reach the front panel at {self.host}: give it a password "
                "(--password-file), or leave the address out of --address"
            )
        if self.password is not None and len(self.password) < _SHORTEST_PASSWORD:
            raise ModelError(
                f"the password must have {_SHORTEST_PASSWORD} letters or more, got "
                f"{len(self.password)}"
            )

    @classmethod
    def of(cls, request: ServeRequest) -> "PanelOptions":
        """Return the options that are asked for; the folder is that of the present directory."""
        for file in filter(None, (request.tls.certificate, request.tls.key)):
            if not file.is_file():
                raise ModelError(f"there is no file '{file}': TLS needs its certificate and key")
        asked: dict[str, Any] = {n: getattr(request, n) for n in request_fields(ServeRequest)}
        return cls(**{**asked, "folder": request.folder.absolute()})

    @property
    def is_loopback(self) -> bool:
        """Whether this computer alone reaches it."""
        return is_loopback(self.host)

    @property
    def scheme(self) -> str:
        """The scheme of its address."""
        return "https" if self.tls.certificate else "http"

    def url(self, port: int) -> str:
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
