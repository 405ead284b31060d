"""Who may look, and what the page may do: names of the host, token, origin, content security policy.

Without a token the server is for this computer alone: a page from elsewhere that a browser here has open must not
reach it, neither by its address (Origin) nor under a name that somebody points at 127.0.0.1 (Host).
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from dataclasses import dataclass
from urllib.parse import urlsplit

from aiohttp import web

COOKIE_DAYS = 7


@dataclass(frozen=True, slots=True)
class Safety:
    """The rules of one server on `port`; `token` None: loopback only."""

    port: int
    token: str | None

    @classmethod
    def of(cls, host: str, port: int) -> Safety:
        """Of a server that listens on `host`: with a new token, unless only this computer reaches it."""
        return cls(port, None if is_loopback_host(host) else secrets.token_urlsafe(24))

    @property
    def cookie(self) -> str:
        """Its name: browsers share cookies among the ports of a host."""
        return f"insole-{self.port}"

    def allows(self, request: web.Request) -> bool:
        """Whether it comes by a name of this server, with the token where there is one."""
        if self.token is None:
            return is_loopback_host(urlsplit(f"//{request.host}").hostname or "")
        given = request.cookies.get(self.cookie) or request.query.get("token") or ""
        return hmac.compare_digest(given.encode(), self.token.encode())

    def same_origin(self, request: web.Request) -> bool:
        """Whether a page of this very server asks; browsers do not let a page lie about it."""
        return request.headers.get("Origin") == f"{request.scheme}://{request.host}"


def is_loopback_host(host: str) -> bool:
    """Whether `host` is a name or an address of this computer that others cannot reach."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def headers(request: web.Request) -> dict[str, str]:
    """What every answer says: nothing from elsewhere, nothing inline, in nobody's frame."""
    socket = f"{'wss' if request.scheme == 'https' else 'ws'}://{request.host}"
    return {
        "Content-Security-Policy": (
            f"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self' {socket}; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        ),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cache-Control": "no-cache",
    }
