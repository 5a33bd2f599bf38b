"""A server of the page without a socket, and questions to it as the page would ask them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import anyio
import httpx

from bussim.commands.new import new_scenario
from bussim.commands.report import report
from bussim.site.result import site
from bussim.ui.server import Service
from bussim.ui.workspace import Workspace

PORT, TOKEN = 4711, "the-token-of-this-start"
EXAMPLE = new_scenario(4, 2)


class Client:
    """Requests to an application in this process."""

    def __init__(self, application: Any) -> None:
        self._transport = httpx.ASGITransport(application, raise_app_exceptions=False)

    def request(self, method: str, address: str, **values: Any) -> httpx.Response:
        async def asked() -> httpx.Response:
            headers, base = {"x-bussim-token": TOKEN}, f"http://127.0.0.1:{PORT}"
            async with httpx.AsyncClient(transport=self._transport, base_url=base, headers=headers) as client:
                return await client.request(method, address, **values)

        return anyio.run(asked)

    def get(self, address: str, **values: Any) -> httpx.Response:
        return self.request("GET", address, **values)

    def post(self, address: str, **values: Any) -> httpx.Response:
        return self.request("POST", address, **values)


class Page:
    """A page that has the address and the token."""

    def __init__(self, folder: Path, opened: Path | None = None) -> None:
        self.ended = False
        self.service = service = Service(
            Workspace(folder, opened), "en", report=report, site=site, example=EXAMPLE, end=self._end
        )
        self.client = Client(service.application(PORT, TOKEN))

    def _end(self) -> None:
        self.ended = True

    def ask(self, question: str, /, **body: Any) -> dict[str, Any]:
        """A question that is answered."""
        response = self.client.post(f"/api/{question}", json=body)
        assert response.status_code == 200, response.text
        found: dict[str, Any] = response.json()
        return found

    def refused(self, question: str, /, **body: Any) -> tuple[int, dict[str, Any]]:
        """A question that is refused: its status, and the error."""
        response = self.client.post(f"/api/{question}", json=body)
        assert response.status_code >= 400, response.text
        error: dict[str, Any] = response.json()["error"]
        assert error.keys() == {"key", "values", "text"}
        return response.status_code, error

    def lines(self, question: str, /, **body: Any) -> list[dict[str, Any]]:
        """A streamed answer."""
        response = self.client.post(f"/api/{question}", json=body)
        assert response.status_code == 200, response.text
        return [json.loads(line) for line in response.text.splitlines()]
