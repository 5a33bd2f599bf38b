"""The timeline as a picture."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from matplotlib.collections import PatchCollection
from matplotlib.colors import to_hex

from bussim.report.picture import BOX_STYLES, style_of, timeline_picture
from bussim.report.scene import WAIT, scene_of
from bussim.results.plots.style import FRAMES, IN_ERROR, PALETTE
from tests.report.samples import NAMES, eight_folder, longest
from tests.results.plots.test_scan_times import assert_legible, has, png_texts

ABOUT = "eight on a noisy line, seed 8, 10 s, bussim 0.1.0"


@pytest.mark.slow
def test_eight_stations_are_legible() -> None:
    picture = timeline_picture(scene_of(longest(eight_folder())), ABOUT)
    assert_legible(picture)
    for number, name in enumerate(NAMES):
        assert has(picture, f"{number} {name}")
        assert has(picture, f"data {number}")
    assert has(picture, "attempt 1: no reply (01)")
    assert has(picture, "ms after 9.6")
    assert has(picture, "no reply, code 01")


def test_a_kind_of_frame_has_its_colour() -> None:
    picture = timeline_picture(scene_of(longest(eight_folder())), ABOUT)
    drawn = {
        to_hex(collection.get_facecolor()[0]).upper(): len(collection.get_paths())  # type: ignore[index]
        for collection in picture.axes[0].findobj(PatchCollection)
        if len(collection.get_facecolor())  # type: ignore[arg-type]
    }
    frames = longest(eight_folder()).frames
    for kind in ("data", "poll"):
        assert drawn[FRAMES[kind].upper()] == sum(frame.kind == kind for frame in frames)


def test_failure_is_never_shown_by_colour_alone() -> None:
    assert BOX_STYLES[WAIT].hatch
    assert BOX_STYLES[WAIT].colour == IN_ERROR
    assert set(FRAMES.values()) <= set(PALETTE)
    assert style_of("something new").meaning == "something new frame"


@pytest.mark.parametrize("ending", [".png", ".svg"])
def test_files_say_what_they_show(tmp_path: Path, ending: str) -> None:
    picture = timeline_picture(scene_of(longest(eight_folder())), ABOUT)
    path = picture.save(tmp_path / f"timeline{ending}")
    if ending == ".png":
        about = png_texts(path)
        assert about["Description"] == ABOUT
        assert about["Title"].startswith("link, 9.6")
    else:
        text = path.read_text(encoding="utf-8")
        ET.fromstring(text)  # noqa: S314 (own output)
        assert ABOUT in text
        assert "<dc:title>link, 9.6" in text


@pytest.mark.slow
def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    one, other = (
        timeline_picture(scene_of(longest(eight_folder())), ABOUT).save(tmp_path / name).read_bytes()
        for name in ("a.svg", "b.svg")
    )
    assert one == other
