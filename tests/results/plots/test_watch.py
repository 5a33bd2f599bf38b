"""Pictures of devices over time: axes of whole numbers, and how much they hold."""

from __future__ import annotations

import pytest

from bussim.results.meters.watch import Watch, Watched
from bussim.results.plots.watch import shown_devices, watch_picture
from bussim.units import TICKS_PER_SECOND as S
from tests.selection import quick


def word(number: int, *values: int) -> Watched:
    return Watched("a", f"D{number}", 16, "", [S * (at + 1) for at in range(len(values))], list(values))


@pytest.mark.parametrize("values", [(), (0,), (7, 7), (0, 1), (65535,), (-32768, 32767), (1000, 1003)])
@pytest.mark.parametrize("others", quick(1, (0, 30)))
def test_words_have_whole_numbers_on_their_axes(values: tuple[int, ...], others: int) -> None:
    watch = Watch([word(0, *values), *(word(number, 1) for number in range(1, others + 1))])
    axes = watch_picture(watch, 0, 10 * S, "title", "about").axes[0]
    low, high = axes.get_ylim()
    assert high - low >= 2
    assert low < min((0, *values)) <= max((0, *values)) < high
    ticks = [tick for tick in axes.get_yticks() if low <= tick <= high]
    assert len(ticks) >= 2
    assert all(tick == round(tick) for tick in ticks)
    labels = [axes.yaxis.get_major_formatter()(tick) for tick in ticks]
    assert [float(label.replace("\N{MINUS SIGN}", "-")) for label in labels] == ticks


def test_the_picture_grows_no_taller_than_its_limit_and_says_what_it_shows() -> None:
    words = [word(number, 1) for number in range(60)]
    number = shown_devices(words)
    assert 30 <= number < 60
    picture = watch_picture(Watch(words), 0, 10 * S, "title", "about")
    assert picture.get_size_inches()[1] <= 22
    assert len(picture.axes) == number
    assert picture.title == f"title (the first {number} of 60)"
    bits = [Watched("a", f"M{at}", 1) for at in range(100)]
    assert shown_devices(bits) > 95
    assert len(watch_picture(Watch(words[:5]), 0, S, "title", "about").axes) == 5


def test_devices_of_a_plc_with_a_long_name_can_be_told_apart() -> None:
    name = "一台名字很长的压机它的名字由很有时间的人写成而且写得很完整"
    devices = [Watched(name, f"M{at}", 1) for at in range(3)] + [Watched(name, "D8201", 16)]
    axes, words = watch_picture(Watch(devices), 0, S, "title", "about").axes
    labels = [label.get_text() for label in axes.get_yticklabels()] + [words.get_ylabel()]
    assert [label.partition(".")[2] for label in labels] == ["M0", "M1", "M2", "D8201"]
    assert all(len(label) == 24 and label.startswith("一台名字很长的压机") for label in labels)


@pytest.mark.slow
def test_a_tall_picture_has_its_times_above_and_below() -> None:
    for number, above in ((3, False), (20, True)):
        picture = watch_picture(Watch([word(at, 1) for at in range(number)]), 0, S, "title", "about")
        picture.draw_without_rendering()
        first = picture.axes[0].xaxis.get_major_ticks()[0]
        assert first.label2.get_visible() is above
