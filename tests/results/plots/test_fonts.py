"""Names in any script are drawn in fonts that have them, or a note says that there are none."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, fontManager, get_font
from matplotlib.text import Text

from bussim.results.plots import fonts
from bussim.results.plots.scan_times import scan_time_histogram
from bussim.results.plots.style import new_picture, style
from bussim.units import TICKS_PER_SECOND
from bussim.words.language import use_language
from tests.results.fakes import quiet
from tests.results.plots.test_scan_times import assert_legible

CHINESE = "三台压机与送料机"
#: Of the fonts that come with matplotlib only STIXGeneral has them.
STIX = "\u29dc\u2aaa\u2acb"
CACHES = (fonts._families, fonts._others)


@pytest.fixture(autouse=True)
def _fresh(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(fonts, "_TOLD", [])
    for cached in CACHES:
        cached.cache_clear()
    yield
    for cached in CACHES:
        cached.cache_clear()


@pytest.fixture
def no_other_fonts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fonts, "_others", list)


def drawn(text: str) -> Text:
    with style():
        picture = new_picture(4, 2, "")
        label = picture.text(0.1, 0.5, text)
        picture.draw_without_rendering()
    return label


def test_latin_names_need_no_other_font(monkeypatch: pytest.MonkeyPatch) -> None:
    def never() -> tuple[tuple[str, str], ...]:
        raise AssertionError

    monkeypatch.setattr(fonts, "_others", never)
    for text in ("press 1", "Füllstation – µs · → ≥ ° ×", "Пресс"):
        assert drawn(text).get_fontfamily() == [fonts.FONT]


def test_a_text_gets_the_fonts_that_have_its_characters() -> None:
    label = drawn(f"press {STIX}")
    assert label.get_fontfamily() == [fonts.FONT, "STIXGeneral"]
    path = findfont(FontProperties(family=["STIXGeneral"]))
    assert all(get_font(path).get_char_index(ord(character)) for character in STIX)


def test_a_font_that_was_installed_later_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """matplotlib reads the list of fonts once and keeps it in a file."""
    path = Path(findfont(FontProperties(family=["STIXGeneral"])))
    later = tmp_path / path.name
    later.write_bytes(path.read_bytes())
    (tmp_path / "broken.ttf").write_bytes(b"no font")
    rest = [font for font in fontManager.ttflist if font.name == fonts.FONT]
    monkeypatch.setattr(fontManager, "ttflist", rest)
    monkeypatch.setattr(fonts, "findSystemFonts", lambda: [str(tmp_path / "broken.ttf"), str(later)])
    assert drawn(STIX).get_fontfamily() == ["STIXGeneral"]


def test_fonts_for_chinese_come_in_their_order() -> None:
    families = [family for family, _ in fonts._others()]
    known = [family for family in families if family in fonts._CJK]
    assert known == sorted(known, key=fonts._CJK.index)
    assert families[: len(known)] == known
    assert not {fonts.FONT, fonts._BOXES} & set(families)


def test_chinese_is_drawn_in_a_font_that_has_it(capsys: pytest.CaptureFixture[str]) -> None:
    if not {family for family, _ in fonts._others()} & set(fonts._CJK):
        missing = "this machine has no font for Chinese (Debian: fonts-noto-cjk)"
        if os.environ.get("CI"):
            pytest.fail(missing)
        pytest.skip(missing)
    (family,) = drawn(CHINESE).get_fontfamily()
    path = findfont(FontProperties(family=[family]))
    assert all(get_font(path).get_char_index(ord(character)) for character in CHINESE)
    assert capsys.readouterr().err == ""


@pytest.mark.usefixtures("no_other_fonts")
def test_without_a_font_one_note_says_so_and_python_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    run = quiet(duration=TICKS_PER_SECOND).run(name=f"{CHINESE} ก")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        picture = scan_time_histogram([run], "link")
        assert_legible(picture)
        picture._repr_png_()
        assert drawn(CHINESE).get_fontfamily() == [fonts.FONT]
        scan_time_histogram([run], "link")._svg()
    said = capsys.readouterr()
    assert said.out == ""
    (note,) = said.err.splitlines()
    assert note.startswith("note: no font of this machine has ")
    assert (
        "(in '三台压机与送料机 ก: 20 link scans on link, 6 attempts a poll'); pictures show boxes instead. "
        "A Noto Sans font of the script would do" in note
    )
    assert "any of Noto Sans CJK SC, Noto Sans SC, Source Han Sans SC, Microsoft YaHei, SimHei" in note


def test_latin_pictures_do_not_look_for_fonts() -> None:
    """The fonts of the system are read only when a name needs one."""
    code = (
        "from bussim.results.plots import fonts\n"
        "from bussim.results.plots.style import new_picture, style\n"
        "with style():\n"
        "    picture = new_picture(4, 2, '')\n"
        "    picture.text(0, 0, 'press 1: 5 µs')\n"
        "    picture._repr_png_()\n"
        "print(fonts._others.cache_info().misses)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("0\n", "")


def test_long_names_without_blanks_are_broken_and_others_between_words() -> None:
    with style():
        picture = new_picture(4, 2, "")
        assert picture.wrapped("press 1", 9, 3) == "press 1"
        assert picture.wrapped("a $b$", 9, 3) == r"a \$b\$"
        lines = picture.wrapped("word " * 40, 9, 2).split("\n")
        assert len(lines) > 3
        assert "".join(lines).replace(" ", "") == "word" * 40
        assert all(picture.width_of(line, 9) <= 2 for line in lines)
        broken = picture.wrapped("short " + CHINESE * 10, 9, 1.5).split("\n")
        assert broken[0].startswith("short 三")
        assert "".join(broken) == "short " + CHINESE * 10
        assert all(picture.width_of(line, 9) <= 1.5 for line in broken)


def texts_of(picture: Figure) -> str:
    return "\n".join(text.get_text() for text in picture.findobj(Text))


def test_a_picture_is_in_the_language_that_is_used() -> None:
    with use_language("zh"):
        picture = scan_time_histogram([quiet(duration=3 * TICKS_PER_SECOND).run()], "link")
    assert "链接扫描时间（ms）" in texts_of(picture)
    assert "平均 " in texts_of(picture)
    assert "link scan" not in texts_of(picture)
    assert_legible(picture)


@pytest.mark.usefixtures("no_other_fonts")
def test_without_a_font_for_chinese_pictures_are_in_english_and_one_note_says_so(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = quiet(duration=3 * TICKS_PER_SECOND).run()
    with use_language("zh"):
        pictures = [scan_time_histogram([run], "link") for _ in range(2)]
    for picture in pictures:
        assert "link scan time (ms)" in texts_of(picture)
        assert texts_of(picture).isascii() or "µ" in texts_of(picture)
    assert capsys.readouterr().err.count("pictures are in English") == 1


def test_a_chinese_line_ends_between_characters_and_not_before_a_comma() -> None:
    picture = new_picture(4, 2, "")
    text = "最大 348.67 ms，在 21.04 s：站 1（press2）的 6 次尝试全部失败（超时时间内没有应答）；主站重新发送了参数"
    lines = picture.wrapped(text, 9, 3).split("\n")
    assert all(picture.width_of(line, 9) <= 3 for line in lines)
    assert all(picture.width_of(line, 9) > 2.2 for line in lines[:-1])
    assert not any(line[0] in "，。；：）" for line in lines)
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
