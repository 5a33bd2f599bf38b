"""The form to print: whole in both languages, and one page."""

import base64
import re
import zlib
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.site.paper import form_page
from bussim.words.tables import LANGUAGES


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_form_has_a_row_a_station_and_every_register_for_both_readings(language: str) -> None:
    text = form_page(language)
    assert text.count("<tr><td></td>") == 2 * 8
    headings = re.findall(r"<th[^>]*>(\d\d)</th>", text)
    assert headings == 2 * [f"{at:02}" for at in (*range(3, 19), *range(83, 92))]
    assert ("现场读数" in text) == (language == "zh")


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["site", "--form", "zh"]) == 0
    assert capsys.readouterr().out == form_page("zh")
    assert main(["site"]) == 2
    assert main(["site", "readout.yaml", "--form", "en"]) == 2


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_form_is_one_page_of_a4(language: str, tmp_path: Path) -> None:
    from tests.report.browser import chromium

    path = tmp_path / "form.html"
    path.write_text(form_page(language), encoding="utf-8")
    with chromium() as window:
        window.get(path.as_uri())
        printed = window.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})
    pdf = base64.b64decode(printed["data"])
    parts = [pdf, *(_inflated(part) for part in re.findall(rb"stream\r?\n(.*?)endstream", pdf, re.DOTALL))]
    assert sum(len(re.findall(rb"/Type\s*/Page\b", part)) for part in parts) == 1
    assert any(re.search(rb"/MediaBox\s*\[\s*0 0 84[12][.\d]* 59[45]", part) for part in parts)


def _inflated(part: bytes) -> bytes:
    try:
        return zlib.decompress(part)
    except zlib.error:
        return b""
