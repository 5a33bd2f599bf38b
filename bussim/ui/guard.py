"""Who may ask the server: only the page that it has handed out itself, on this computer."""

from __future__ import annotations

import json
from collections.abc import Mapping
from hmac import compare_digest
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: The header that carries the token, and the most bytes of a request.
TOKEN, MOST_BYTES = "x-bussim-token", 4 * 1024 * 1024

#: A page loads from this server alone; other pages neither frame it nor read its answers.
_POLICY = (
    "default-src 'none'; script-src 'self'; connect-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src data: blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
_HEADERS = {
    "content-security-policy": _POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
}


class Refusal(Exception):  # noqa: N818 - an answer, not a failure
    """A request that is not answered: status, key of the sentence, its values, the sentence in English."""

    def __init__(self, status: int, key: str, text: str, values: Mapping[str, Any] | None = None) -> None:
        super().__init__(text)
        self.status, self.key, self.text, self.values = status, key, text, dict(values or {})

    @property
    def said(self) -> dict[str, Any]:
        """As the page gets it."""
        return {"key": self.key, "values": self.values, "text": self.text}

    @property
    def response(self) -> Response:
        """The answer of a request that is refused."""
        return JSONResponse({"error": self.said}, self.status)


class Guard:
    """Lets requests through to an application that come from its own page.

    ``port`` is the server's. Every request must name it as its host, and no other origin: comparing the two
    with each other would prove nothing where a foreign name leads to this computer. What is posted needs the
    token and is JSON.
    """

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        self._app, self._token = app, token.encode()
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            return  # a web socket is closed by that
        try:
            self._check(scope["method"], Headers(scope=scope))
        except Refusal as refusal:
            await refusal.response(scope, receive, _with_headers(send))
        else:
            await self._app(scope, receive, _with_headers(send))

    def _check(self, method: str, headers: Headers) -> None:
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            raise Refusal(403, "foreign", "the request names another host than this server")
        if origins and origins != [f"http://{hosts[0]}"]:
            raise Refusal(403, "foreign", "the request comes from another page")
        if method in ("GET", "HEAD"):
            return
        if method != "POST":
            raise Refusal(405, "method", "only GET and POST are answered")
        if not compare_digest(headers.get(TOKEN, "").encode("latin-1"), self._token):
            raise Refusal(403, "token", "the token is missing or that of another start; open the new address")
        if headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
            raise Refusal(403, "type", "only JSON is read")


def _with_headers(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return sent


async def body_of(request: Request) -> Any:
    """The JSON of a request, counted while it is read. Raises Refusal where it is too much, or none."""
    read = bytearray()
    async for chunk in request.stream():
        read += chunk
        if len(read) > MOST_BYTES:
            raise Refusal(413, "too_large", f"a request has at most {MOST_BYTES:,} bytes")
    try:
        return json.loads(read)
    except (ValueError, RecursionError):
        raise Refusal(400, "json", "the request is no JSON") from None
