"""What every request passes before anything of the page is reached: rate, host, size, origin.

An ASGI middleware. It also puts the security headers on every answer.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lmctl.web.access import AccessPolicy, AccessRole
from lmctl.web.rate_limit import RateLimit
from lmctl.web.run_watch import encoded

#: Requests of one address: so many a second for long, and so many at once.
REQUESTS_PER_S, REQUESTS_AT_ONCE = 50.0, 400.0

_TOO_MANY = f"more than {REQUESTS_PER_S:.0f} requests a second"

#: Wrong tokens of one address.
_WRONG_PER_S, _WRONG_AT_ONCE = 0.2, 10.0

#: Length of a body, and how long it may take to come [s].
MAX_BODY_BYTES, BODY_S = 4096, 10.0

CONTENT_SECURITY_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": CONTENT_SECURITY_POLICY, "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY", "Referrer-Policy": "no-referrer", "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin", "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}


def request_rate(now_s: Callable[[], float] = time.monotonic) -> RateLimit:
    """The rate at which one address may ask."""
    return RateLimit(REQUESTS_PER_S, REQUESTS_AT_ONCE, now_s)


def flood_refusal() -> bytes:
    """The answer to a request of an address that has none left, as it goes out; the connection is
    then closed."""
    body, headers = _refusal_answer(429, _TOO_MANY)
    lines = [f"{name}: {value}" for name, value in _HEADERS.items()]
    lines += [f"{name.decode()}: {value.decode()}" for name, value in headers]
    return "\r\n".join(["HTTP/1.1 429 Too Many Requests", *lines, "", ""]).encode() + body


class RequestProtection:
    """Refuses what no viewer of the page sends. Sets `scope["state"]["role"]` of what passes.

    now_s : a clock that never goes back
    rate : of requests, where connections look at it, too; None: one of its own
    """

    def __init__(
        self, app: ASGIApp, access: AccessPolicy, now_s: Callable[[], float] = time.monotonic,
        rate: RateLimit | None = None,
    ) -> None:
        self._app = app
        self._access = access
        self._rate = rate or request_rate(now_s)
        self._wrong = RateLimit(_WRONG_PER_S, _WRONG_AT_ONCE, now_s)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return

        async def send_protected(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        refusal, role = self._refusal(scope)
        if refusal is None:
            try:
                async with asyncio.timeout(BODY_S):
                    body = await _bounded_body(Headers(scope=scope), receive)
            except TimeoutError:
                refusal = (408, f"the body of a request takes at most {BODY_S:.0f} s")
            else:
                if body is None:
                    refusal = (413, f"a request holds at most {MAX_BODY_BYTES} bytes")
        if refusal is not None:
            await _refuse(send_protected, *refusal)
            return
        scope.setdefault("state", {})["role"] = role
        await self._app(scope, _replay(body or b"", receive), send_protected)

    def _refusal(self, scope: Scope) -> tuple[tuple[int, str] | None, AccessRole]:
        """Status and reason of a refusal, None where there is none; and the role."""
        headers, address = Headers(scope=scope), (scope.get("client") or ("?",))[0]
        if not self._rate.take(address):
            return (429, _TOO_MANY), AccessRole.NONE
        host = _host_name(headers.get("host", ""))
        if self._access.host_names is not None and host not in self._access.host_names:
            return (421, f"this page does not answer as {host!r}"), AccessRole.NONE
        if scope["method"] not in ("GET", "HEAD"):
            origin = headers.get("origin")
            if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none") or (
                origin is not None and urlsplit(origin).netloc != headers.get("host", "")
            ):
                return (403, "only this page may act here"), AccessRole.NONE
            if headers.get("content-type", "").partition(";")[0].strip() != "application/json":
                return (415, "a request is application/json"), AccessRole.NONE
        authorization = headers.get("authorization")
        if authorization is not None and self._wrong.is_exhausted(address):
            return (429, "too many wrong tokens; wait a minute"), AccessRole.NONE
        role = self._access.role_of(authorization)
        if authorization is not None and role is AccessRole.NONE:
            self._wrong.take(address)
        return None, role


def _host_name(host: str) -> str:
    """Of a Host header, without its port."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0].lower()


async def _bounded_body(headers: Headers, receive: Receive) -> bytes | None:
    """The whole body, None where it is too long."""
    stated = headers.get("content-length", "0")
    if not stated.isdigit() or int(stated) > MAX_BODY_BYTES:
        return None
    if stated == "0" and "transfer-encoding" not in headers:
        return b""
    body = b""
    while True:
        message = await receive()
        body += bytes(message.get("body", b""))
        if len(body) > MAX_BODY_BYTES:
            return None
        if message["type"] != "http.request" or not message.get("more_body"):
            return body


def _replay(body: bytes, receive: Receive) -> Receive:
    """Hands the body that was read to the application, then goes on as before."""
    handed = False

    async def replayed() -> Message:
        nonlocal handed
        if handed:
            return await receive()
        handed = True
        return {"type": "http.request", "body": body, "more_body": False}

    return replayed


def _refusal_answer(status: int, reason: str) -> tuple[bytes, list[tuple[bytes, bytes]]]:
    """Body and headers."""
    body = encoded({"error": reason, "where": [], "hint": ""})
    headers = [(b"content-type", b"application/json"),
               (b"content-length", str(len(body)).encode()), (b"connection", b"close")]
    return body, headers + ([(b"retry-after", b"1")] if status == 429 else [])


async def _refuse(send: Send, status: int, reason: str) -> None:
    body, headers = _refusal_answer(status, reason)
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
