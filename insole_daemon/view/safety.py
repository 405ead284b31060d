"""Access rules of the page: names of the host, token, origin, content security policy.

Without a token the server accepts only browsers on this computer. Pages of other sites must not reach it, neither by
its address (checked by Origin) nor by a name that resolves to 127.0.0.1 (checked by Host).
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
        """Return the rules of a server on `host`: with a new token, unless only this computer can reach it."""
        return cls(port, None if is_loopback_host(host) else secrets.token_urlsafe(24))

    @property
    def cookie(self) -> str:
        """Name of the cookie; it contains the port because browsers share cookies among the ports of a host."""
        return f"insole-{self.port}"

    def allows(self, request: web.Request) -> bool:
        """Return whether a request has the token or, without a token, a loopback name of this server."""
        if self.token is None:
            return is_loopback_host(urlsplit(f"//{request.host}").hostname or "")
        token = request.cookies.get(self.cookie) or request.query.get("token") or ""
        return hmac.compare_digest(token.encode(), self.token.encode())

    def same_origin(self, request: web.Request) -> bool:
        """Return whether a page of this server sent the request; browsers set Origin, pages cannot."""
        return request.headers.get("Origin") == f"{request.scheme}://{request.host}"


def is_loopback_host(host: str) -> bool:
    """Return whether `host` is a loopback name or address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def headers(request: web.Request) -> dict[str, str]:
    """Return the headers of every response: no external or inline content, no framing."""
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
