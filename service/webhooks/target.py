"""Which addresses a webhook may call.

An address that a user gives must not make the service reach into its own network. Names are
resolved once, every address found must be public, and the connection goes to that very address.
"""

from __future__ import annotations

import ipaddress
import socket
from dataclasses import dataclass
from urllib.parse import urlsplit

from service.errors import FieldError, ServiceError

_PATH = "params.callback_url"
_ADVICE = "give an address that can be reached from the internet."


class TargetRefused(Exception):
    """The address may not be called; the message says why."""


@dataclass(frozen=True)
class Target:
    """A URL with the numeric address that its connection is pinned to."""

    url: str
    host: str
    port: int
    address: str
    secure: bool

    @property
    def pinned_url(self) -> str:
        """The same URL with the numeric address in the place of the name."""
        parts = urlsplit(self.url)
        address = f"[{self.address}]" if ":" in self.address else self.address
        path = parts.path or "/"
        query = f"?{parts.query}" if parts.query else ""
        return f"{parts.scheme}://{address}:{self.port}{path}{query}"

    @property
    def host_header(self) -> str:
        return urlsplit(self.url).netloc.rpartition("@")[2]


def check_callback(url: str | None, allow_private: bool) -> None:
    """Refuse at submission what can never be called. Names are only resolved when it is called.

    Raises ServiceError ``callback_refused``.
    """
    if url is None:
        return
    try:
        host, _, _ = _split(url)
        if not allow_private:
            _check_literal(host)
    except TargetRefused as error:
        raise ServiceError(
            "callback_refused",
            f"{_PATH}: {error}",
            errors=[FieldError(_PATH, str(error))],
        ) from None


def resolve(url: str, allow_private: bool) -> Target:
    """The target of a call about to be made. Raises TargetRefused."""
    host, port, secure = _split(url)
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise TargetRefused(f"{host} cannot be resolved ({error}).") from None
    addresses = [str(entry[4][0]).partition("%")[0] for entry in found]
    if not allow_private:
        for address in addresses:
            _check_public(address, host)
    return Target(url, host, port, addresses[0], secure)


def _split(url: str) -> tuple[str, int, bool]:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise TargetRefused("It is not a URL.") from None
    if parts.scheme not in ("http", "https") or not host:
        raise TargetRefused("It must begin with https:// or http:// and name a host.")
    if parts.username is not None or any(c.isspace() or ord(c) < 32 for c in url):
        raise TargetRefused("It must hold no user name, spaces or control characters.")
    secure = parts.scheme == "https"
    return host, port or (443 if secure else 80), secure


def _check_literal(host: str) -> None:
    if host == "localhost" or host.endswith((".localhost", ".local", ".internal")):
        raise TargetRefused(f"{host} is not a public host; {_ADVICE}")
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return
    _check_public(host, host)


def _check_public(address: str, host: str) -> None:
    parsed = ipaddress.ip_address(address)
    mapped = getattr(parsed, "ipv4_mapped", None)
    parsed = mapped or parsed
    if not parsed.is_global or parsed.is_multicast:
        named = host if host == address else f"{host} ({address})"
        raise TargetRefused(f"{named} is not a public host; {_ADVICE}")
