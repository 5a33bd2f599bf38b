"""A headless Chromium. Without one tests are skipped, but in CI that is a failure."""

from __future__ import annotations

import base64
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NoReturn

import pytest

_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
)


def paths() -> tuple[str, str]:
    """Chromium and its driver; skips the test where they are missing, in CI fails it."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    driver = shutil.which("chromedriver")
    if browser is None or driver is None:
        _missing("chromium and chromium-driver are not installed")
    return browser, driver


def _missing(what: str) -> NoReturn:
    if os.environ.get("CI"):
        pytest.fail(what)
    pytest.skip(what)


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser that keeps its console and network log."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    browser, driver = paths()
    with TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = browser
        for flag in (*_FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        window = webdriver.Chrome(service=Service(driver), options=options)
        try:
            yield window
        finally:
            window.quit()


def show(window: Any, page: Path, *, width: int = 1280, dark: bool = False) -> None:
    """Load a page at a width, in the light or the dark scheme."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    window.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    window.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": [scheme]})
    window.get(page.resolve().as_uri())


_AXE = Path(__file__).parent.parent / "vendor" / "axe.min.js"
#: Rules of axe-core 4.14 that a page breaks, each with the elements that break it. What waits for an answer is
#: pale: it is not to be read as one of this line.
_BROKEN = """const done = arguments[arguments.length - 1];
axe.run({ exclude: [["[aria-busy=true]"]] }, { resultTypes: ["violations"] }).then(
  found => done(found.violations.map(each => [each.id, ...each.nodes.map(node => node.html.slice(0, 200))])), error => done(String(error)));"""


def broken_rules(window: Any) -> Any:
    """What axe-core finds wrong with the page as it is shown: names, roles, contrast, order of headings, landmarks."""
    window.execute_script(_AXE.read_text(encoding="utf-8"))
    return window.execute_async_script(_BROKEN)


def printed(window: Any, path: Path) -> list[str]:
    """The text of each page of paper, as another program reads it from the PDF; the PDF is left at ``path``."""
    pdf = window.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})["data"]
    path.write_bytes(base64.b64decode(pdf))
    program = shutil.which("pdftotext")
    if program is None:
        _missing("pdftotext (poppler-utils) is not installed")
    text = subprocess.run([program, "-layout", path, "-"], capture_output=True, text=True, check=True).stdout
    return text.removesuffix("\f").split("\f")
