"""Which requests are answered, and what a browser may do with an answer.

A page of somebody else that is open in the same browser can send requests here, also under a name of its own that it
lets point at this machine. So the name that a request asks for must be one of ours, and what changes anything must come
from a page of ours: the browser says from where it comes, and sends our cookie with no other site's requests.
"""

import hmac
import ipaddress
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import urlsplit

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Message, Receive, Send], Awaitable[None]]

COOKIE = "auv_page"
LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
_READS = ("GET", "HEAD", "OPTIONS")
_MOST_BODY = 256 << 10  # bytes of a request that is no upload
PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
    "cache-control": "no-store",
    "content-security-policy": PAGE_POLICY,
}


class Guard:
    """Stands around the application.

    Args:
        app: what answers.
        names: that a request may ask for, without port.
        any_address: whether it may also ask for any address in numbers, as where other machines may come; such a name
            is nobody's to let point elsewhere.
        token: value of our cookie.
    """

    def __init__(self, app: App, names: Iterable[str], any_address: bool, token: str) -> None:
        self.app, self.names, self.any_address, self.token = app, {n.lower() for n in names}, any_address, token

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer, or refuse to."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            await send({"type": "websocket.close"})
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        refused = self._refusal(scope, headers)
        if refused is not None:
            await _answer(send, *refused)
            return
        if scope["method"] not in _READS and scope["path"] != "/logs":
            body = await _body(receive)
            if body is None:
                await _answer(send, 413, "this request is too large")
                return
            receive = _again(body, receive)
        await self.app(scope, receive, self._guarded(send, headers))

    def _refusal(self, scope: Message, headers: dict[str, str]) -> tuple[int, str] | None:
        host = headers.get("host", "")
        if not self._is_ours(host):
            return 421, f"this server does not answer to {host[:80]!r}: use its address, or start it with --name"
        if scope["method"] in _READS:
            return None
        origin, site = headers.get("origin"), headers.get("sec-fetch-site")
        if origin is None and site is None:
            return None  # a program: browsers always say where a request comes from that changes something
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return 403, "this request comes from a page of another site"
        if site not in (None, "same-origin"):
            return 403, "this request comes from a page of another site"
        if not hmac.compare_digest(_cookie(headers).encode(), self.token.encode()):
            return 403, "this request lacks the cookie of this page: load the page again"
        return None

    def _is_ours(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in self.names:
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return self.any_address

    def _guarded(self, send: Send, headers: dict[str, str]) -> Send:
        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = {name.lower() for name, _ in message["headers"]}
                added = [(n.encode(), v.encode()) for n, v in _HEADERS.items() if n.encode() not in given]
                if _cookie(headers) != self.token:
                    cookie = f"{COOKIE}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                    added.append((b"set-cookie", cookie.encode()))
                message["headers"] = [*message["headers"], *added]
            await send(message)

        return guarded


async def _body(receive: Receive) -> bytes | None:
    """All that a request brings; None where that is too much."""
    body = b""
    while True:
        message = await receive()
        body += message.get("body", b"")
        if len(body) > _MOST_BODY:
            return None
        if not message.get("more_body"):
            return body


def _again(body: bytes, receive: Receive) -> Receive:
    """Says first what was read, then what comes."""
    first: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def again() -> Message:
        return first.pop() if first else await receive()

    return again


def _cookie(headers: dict[str, str]) -> str:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return found.value if found is not None else ""


async def _answer(send: Send, status: int, text: str) -> None:
    headers = [(name.encode(), value.encode()) for name, value in _HEADERS.items()]
    headers.append((b"content-type", b"text/plain; charset=utf-8"))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": f"{text}\n".encode("utf-8", "backslashreplace")})
