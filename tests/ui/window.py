"""A browser at the page of a real server."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

#: Whether what is shown is of the line as it stands on the page.
SETTLED = """return document.documentElement.dataset.ready === 'true'
  && ![...document.querySelectorAll('[aria-busy=true]')].some(e => e.offsetParent)"""

IN_A_BROWSER = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]


@contextmanager
def server(folder: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The process, and the address that it prints."""
    command = [sys.executable, "-m", "bussim", "ui", *arguments, "--no-browser", "--folder", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.terminate()


class Seen:
    """What is done with the page, and what is seen on it."""

    def __init__(self, window: Any, address: str) -> None:
        self.window, self.address = window, address

    def load(self, *, width: int = 1280, fresh: bool = True) -> None:
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.window.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        self.window.get(self.address)
        if fresh:
            self.settle()  # it keeps its line until then
            self.js("sessionStorage.clear()")
        self.window.get("about:blank")
        self.window.get(self.address)
        self.settle()

    def js(self, script: str, *arguments: Any) -> Any:
        return self.window.execute_script(script, *arguments)

    def until(self, condition: Callable[[], Any], seconds: float = 60) -> Any:
        end = time.monotonic() + seconds
        while not (found := condition()):
            assert time.monotonic() < end, f"it did not come: {self.state()}"
            time.sleep(0.03)
        return found

    def state(self) -> Any:
        """What is waited for, for a message."""
        return self.js(
            "return [[...document.querySelectorAll('[aria-busy=true]')].map(e => e.id), document.body.innerText.slice(0, 400)]"
        )

    def settle(self) -> None:
        """Wait until every answer is there, and drawn."""
        time.sleep(0.06)  # sizing is asked for when the sliders rest
        self.until(lambda: self.js(SETTLED))
        self.window.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")

    def unfold(self, lang: str) -> None:
        """Choose a language, and open every part that the page can fold."""
        if not self.js("return document.getElementById('menu').open"):
            self.one("#menu summary").click()
        self.one(f"button[data-lang={lang}]").click()
        self.settle()
        self.js("document.querySelectorAll('main details').forEach(e => e.open = true)")
        self.click("[name=noise][value=counters]")
        self.until(lambda: self.js("return document.querySelectorAll('#gap-table td').length"))

    def one(self, selector: str) -> Any:
        return self.window.find_element("css selector", selector)

    def text(self, selector: str) -> str:
        return str(self.one(selector).text)

    def click(self, selector: str) -> None:
        self.js("arguments[0].click()", self.one(selector))

    def put(self, selector: str, value: object) -> None:
        script = "arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('input', {bubbles: true}))"
        self.js(script, self.one(selector), str(value))

    def figures(self) -> dict[str, str]:
        script = "return Object.fromEntries([...document.querySelectorAll('#tiles [data-figure]')].map(e => [e.dataset.figure, e.firstChild.textContent]))"
        found: dict[str, str] = self.js(script)
        return found

    def line(self) -> dict[str, Any]:
        """The text and the form that the page has."""
        found: dict[str, Any] = self.js("return JSON.parse(sessionStorage.getItem('bussim-line')).line")
        return {"text": found["text"], "form": found["form"]}


def event(seen: Seen) -> str:
    """What became of the simulation last."""
    return str(seen.one("#run-said").get_attribute("data-event"))


def opened(seen: Seen, name: str) -> None:
    """Open a file of the folder or a built-in scenario."""
    if seen.one("#opening").get_attribute("hidden"):
        seen.click("#open")
    entry = f"[data-entry='{name}']"
    seen.until(lambda: seen.js("return document.querySelector(arguments[0])", entry))
    seen.js("document.querySelector(arguments[0]).click()", entry)
