"""A timeline as a picture, like a logic analyser's: matplotlib's PNG and SVG."""

from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from bussim.report.scene import (
    ACTING,
    DAMAGE,
    DRIVEN,
    END,
    EVENT,
    FLAG,
    GOOD,
    HEARD_DAMAGE,
    LEVEL,
    LOST,
    SCAN,
    TROUBLE,
    WAIT,
    Box,
    Mark,
    Scene,
)
from bussim.results.plots.style import (
    FAULT,
    FRAMES,
    GREY,
    IN_ERROR,
    Picture,
    drawn,
    finish_picture,
    new_picture,
    shorten,
    style,
)
from bussim.units import milliseconds, seconds
from bussim.words.language import said_text, say, shown

_WIDTH = 13.0
_LANE_HEIGHT = 0.36
_MOST_EVENTS = 6
_CROWDED = 70  # numbers that this part of the axis has room for


class BoxStyle(NamedTuple):
    """How a kind of box is drawn: its colour, its height as a part of the lane, and a hatch."""

    colour: str
    height: float = 0.62
    hatch: str = ""
    filled: bool = True
    meaning: str = ""


#: Frames have the colours of :data:`bussim.results.plots.style.FRAMES`.
BOX_STYLES = {
    SCAN: BoxStyle("#e4e4e4", 0.7, meaning=say("box_scan")),
    GOOD: BoxStyle("#c8c8c8", 0.5, meaning=say("box_good")),
    WAIT: BoxStyle(IN_ERROR, 0.7, "////", filled=False, meaning=say("box_wait")),
    DAMAGE: BoxStyle(IN_ERROR, 0.8, meaning=say("box_damage")),
    HEARD_DAMAGE: BoxStyle(IN_ERROR, 0.3, filled=False, meaning=say("box_heard")),
    LOST: BoxStyle(IN_ERROR, 0.8, "xxxx", filled=False, meaning=say("box_lost")),
    DRIVEN: BoxStyle(IN_ERROR, 0.3, "////", filled=False, meaning=say("box_driven")),
    ACTING: BoxStyle(FAULT, 0.5, meaning=say("box_acting")),
    FLAG: BoxStyle(IN_ERROR, 0.5, meaning=say("box_flag")),
    LEVEL: BoxStyle("#eeeeee", 0.62, meaning=say("box_level")),
}
MARKS = {
    END: ("|", GREY, 5, say("mark_end")),
    EVENT: ("v", FAULT, 7, say("mark_event")),
    TROUBLE: ("v", IN_ERROR, 7, say("mark_error")),
}


def style_of(kind: str) -> BoxStyle:
    """How a kind of box is drawn; a frame of a kind that has no colour is grey."""
    meaning = say("scene_kind", kind=kind.removesuffix("s"))
    return BOX_STYLES.get(kind) or BoxStyle(FRAMES.get(kind, GREY), meaning=meaning)


@drawn
def timeline_picture(scene: Scene, description: str) -> Picture:
    """The picture of a timeline; ``description`` is what it rests on (scenario, seed, version)."""
    with style():
        height = _LANE_HEIGHT * len(scene.lanes) + 1.6
        picture = new_picture(_WIDTH, height, description)
        label = said_text("picture_after", begin=seconds(scene.begin))
        names = [shorten(shown(lane), 30) for lane in scene.lanes]
        room = _WIDTH - 0.6 - max(picture.width_of(name, 9) for name in names)
        label = "\n".join([label, *(picture.wrapped(text, 9, room) for text in _texts(scene))])
        picture.set_figheight(height + 0.17 * label.count("\n"))
        axes = picture.add_subplot()
        _draw_boxes(axes, scene)
        _draw_marks(axes, scene)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(scene.lanes) - 0.45, -0.6)
        axes.set_xlim(0, milliseconds(scene.end - scene.begin))
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel(label, loc="left", fontsize=9)
        times = {"begin": seconds(scene.begin), "end": seconds(scene.end)}
        heading = say("picture_heading", bus=scene.bus, **times)
        finish_picture(picture, heading, _legend(scene), columns=4)
        # Only now is it known how wide a box is on paper.
        picture.draw_without_rendering()
        _label_boxes(picture, axes, scene)
    return picture


def _draw_boxes(axes: Axes, scene: Scene) -> None:
    by_kind: dict[str, list[Rectangle]] = {}
    for box in scene.boxes:
        look = style_of(box.kind)
        start, width = _extent(scene, box)
        rectangle = Rectangle((start, box.lane - look.height / 2), width, look.height)
        by_kind.setdefault(box.kind, []).append(rectangle)
    for kind, rectangles in by_kind.items():
        look = style_of(kind)
        over = kind in (DAMAGE, HEARD_DAMAGE, LOST)
        axes.add_collection(
            PatchCollection(
                rectangles,
                facecolor=look.colour if look.filled else "none",
                edgecolor=look.colour if over else IN_ERROR if look.hatch else "#555555",
                linewidth=0.5,
                hatch=look.hatch or None,
                zorder=3 if over else 2,
            )
        )


def _extent(scene: Scene, box: Box) -> tuple[float, float]:
    """Where the visible part of a box begins, and how wide it is, in ms."""
    start, end = max(box.start, scene.begin), min(box.end, scene.end)
    return milliseconds(start - scene.begin), milliseconds(end - start)


def _draw_marks(axes: Axes, scene: Scene) -> None:
    for kind, (shape, colour, size, _) in MARKS.items():
        marks = [mark for mark in scene.marks if mark.kind == kind]
        below = 0.38 if kind == END else 0.0
        axes.plot(
            [milliseconds(mark.tick - scene.begin) for mark in marks],
            [mark.lane + below for mark in marks],
            shape,
            color=colour,
            markersize=size,
            zorder=4,
        )
    last, level = scene.begin, 0
    for number, mark in enumerate(_events(scene)[:_MOST_EVENTS], 1):
        # Numbers that would lie on each other stand on lines of their own.
        level = (level + 1) % 3 if _CROWDED * (mark.tick - last) < scene.end - scene.begin else 0
        at, last = (milliseconds(mark.tick - scene.begin), mark.lane), mark.tick
        offset = (5, (-3, 5, -11)[level])
        axes.annotate(f"{number}", at, offset, textcoords="offset points", fontsize=8, zorder=5)


def _events(scene: Scene) -> list[Mark]:
    return [mark for mark in scene.marks if mark.kind != END]


def _label_boxes(picture: Picture, axes: Axes, scene: Scene) -> None:
    per_ms = axes.transData.transform((1, 0))[0] - axes.transData.transform((0, 0))[0]
    widths: dict[str, float] = {}
    for box in scene.boxes:
        if not box.label:
            continue
        start, width = _extent(scene, box)
        label = shown(box.label)
        if label not in widths:
            widths[label] = picture.width_of(label, 7) * picture.dpi
        if widths[label] + 4 > width * per_ms:
            continue
        look = style_of(box.kind)
        behind = {"facecolor": "white", "edgecolor": "none", "pad": 0.8} if look.hatch else None
        dark = look.filled and look.colour == "#000000"
        axes.text(
            start + width / 2,
            box.lane,
            shorten(label, 60),
            ha="center",
            va="center",
            fontsize=7,
            color="white" if dark else "black",
            zorder=4,
            bbox=behind,
        )


def _texts(scene: Scene) -> list[str]:
    """What is written under the picture: the events by number, and why link scans took so long."""
    events = [
        said_text("picture_event", number=number, ms=milliseconds(mark.tick - scene.begin), text=mark.text)
        for number, mark in enumerate(_events(scene), 1)
    ]
    if len(events) > _MOST_EVENTS:
        events[_MOST_EVENTS:] = [said_text("picture_more_events", number=len(events) - _MOST_EVENTS)]
    if scene.left_out:
        events.append(said_text("picture_more_devices", number=scene.left_out))
    return [*events, *map(shown, scene.why)]


def _legend(scene: Scene) -> Sequence[Artist]:
    handles: list[Artist] = []
    for kind in scene.kinds():
        if kind in MARKS:
            shape, colour, size, meaning = MARKS[kind]
            handles.append(
                Line2D([], [], linestyle="", marker=shape, color=colour, ms=size, label=shown(meaning))
            )
        elif kind not in (SCAN, LEVEL):
            look = style_of(kind)
            handles.append(
                Patch(
                    facecolor=look.colour if look.filled else "none",
                    edgecolor=IN_ERROR if look.hatch or kind == HEARD_DAMAGE else "#555555",
                    linewidth=0.5,
                    hatch=look.hatch or None,
                    label=shown(look.meaning),
                )
            )
    return handles
