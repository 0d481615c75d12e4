"""Who may talk to the server: a token, the server's own names as host and origin, and what a page of it may load."""

import hmac
import secrets
from collections.abc import Mapping
from dataclasses import dataclass

from starlette.datastructures import Headers, QueryParams

TOKEN_BYTES = 24
"""Random bytes of a token: more than anyone can try."""
LOCAL = ("127.0.0.1", "localhost", "[::1]")
"""Names of this machine in itself."""
EVERYWHERE = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}
"""Addresses that listen on every network of the machine, and how the machine itself reaches them."""
HTTP = 80
"""The port that browsers do not say."""
HEADER = "x-morphlet-token"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; font-src 'self'; connect-src 'self'{sockets}; "
    "worker-src 'self' blob:; manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What a page may load: its own files, and nothing from elsewhere."""


def new_token() -> str:
    """A random token for one run of the server."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def is_local(host: str) -> bool:
    """Whether an address can be reached from this machine alone."""
    return host in ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class Access:
    """The rules of one server.

    Parameters
    ----------
    token
        What a request has to know.
    names
        Hosts with ports under which the server is reached.

    Examples
    --------
    >>> from morphlet.studio.access import Access
    >>> rules = Access.of("secret", "127.0.0.1", 8080)
    >>> rules.own_host("localhost:8080"), rules.own_host("evil.example:8080"), rules.own_origin("https://evil.example")
    (True, False, False)
    """

    token: str
    names: frozenset[str]

    @staticmethod
    def of(token: str, host: str, port: int, more: tuple[str, ...] = ()) -> "Access":
        """The rules for an address; `more` are further names under which it is reached."""
        bracketed = f"[{host}]" if ":" in host else host
        hosts = {*LOCAL, *more} | (set() if host in EVERYWHERE else {bracketed})
        unsaid = {name.lower() for name in hosts} if port == HTTP else set()
        return Access(token, frozenset(f"{name.lower()}:{port}" for name in hosts) | unsaid)

    def own_host(self, host: str | None) -> bool:
        """Whether a request was meant for this server, and not for a name that someone made to point here."""
        return host is not None and host.lower() in self.names

    def own_origin(self, origin: str | None) -> bool:
        """Whether a page of this server sent a request; what is no browser tells no origin."""
        if origin is None:
            return True
        scheme, _, name = origin.lower().partition("://")
        return scheme == "http" and name in self.names

    def knows(self, headers: Mapping[str, str], query: Mapping[str, str]) -> bool:
        """Whether a request knows the token; the time this takes tells nothing about it."""
        told = headers.get(HEADER) or query.get("token") or ""
        return hmac.compare_digest(told.encode(), self.token.encode())

    def trusted(self, headers: Headers, query: QueryParams) -> bool:
        """All three."""
        near = self.own_host(headers.get("host")) and self.own_origin(headers.get("origin"))
        return near and self.knows(headers, query)

    def headers(self) -> dict[str, str]:
        """What every answer tells the browser."""
        sockets = "".join(f" ws://{name}" for name in sorted(self.names) if "[" not in name)  # which a policy cannot name
        return {
            "Content-Security-Policy": POLICY.format(sockets=sockets),
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",
        }
