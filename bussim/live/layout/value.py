"""A layout: how the frames of an N:N link are made up of characters."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

from bussim.engines.nn.frames import DATA, KIND_NAMES, MODES, PARAMETERS, POLL, Frame, LinkSettings
from bussim.engines.nn.status import STATIONS
from bussim.live.layout.sums import Number, Sum

#: Names of what may stand in a frame besides characters that are always the same.
PARTS: Final = ("station", "counter", "data", "settings", "sum", "any")
#: Parts of which a frame has at most one.
UNIQUE: Final = frozenset(PARTS) - {"any"}
_SETTINGS: Final = len(LinkSettings._fields)
#: Bytes of the largest block.
MOST_DATA: Final = max(block.size for block in MODES)


class Part(NamedTuple):
    """A part of a frame: a character that is always the same, or the name of a part (see PARTS).

    ``summed``: the sum is made over it. ``size`` are its characters, 0 for data of any length.
    """

    what: int | str
    size: int
    summed: bool


@dataclass(frozen=True)
class FrameLayout:
    """The parts of one kind of frame, in order; ``size`` is without data of any length."""

    kind: int
    parts: tuple[Part, ...]
    size: int

    @cached_property
    def header(self) -> int | None:
        """The character with which it begins, None where that is not always the same."""
        first = self.parts[0].what
        return first if isinstance(first, int) else None

    @cached_property
    def end(self) -> tuple[int, int] | None:
        """The character behind data of any length, and how many follow it; None where there is none."""
        sizes = [part.size for part in self.parts]
        at = sizes.index(0) + 1 if 0 in sizes else len(sizes)
        what = self.parts[at].what if at < len(sizes) else None
        return (what, sum(sizes[at + 1 :])) if isinstance(what, int) else None

    @cached_property
    def before(self) -> int:
        """The characters before data of any length."""
        sizes = [part.size for part in self.parts]
        return sum(sizes[: sizes.index(0)]) if 0 in sizes else self.size

    @cached_property
    def any_length(self) -> bool:
        """Whether it has data of any length."""
        return any(not part.size for part in self.parts)


@dataclass(frozen=True)
class Layout:
    """The layout of a link's frames. ``orders`` are the parts of each kind, those under the sum marked.

    ``master`` is the number of the master's station, which the slaves' follow. ``counter`` is None where
    there is none; it begins again with 0 after ``modulo`` link scans. ``data`` is the form of data and
    settings; ``data_bytes`` is the size of a block, None where it may have any.
    """

    orders: dict[str, tuple[tuple[int | str, bool], ...]]
    station: Number
    counter: Number | None
    sum: Sum | None
    master: int = 0
    modulo: int = 1
    data: str = "hex"
    data_bytes: int | None = None

    @property
    def digits(self) -> int:
        """Characters of a byte of data."""
        return 1 if self.data == "binary" else 2

    @property
    def binary(self) -> bool:
        """Whether the characters of some field may be any: headers and end characters, too."""
        numbers = (self.station, self.counter, self.sum)
        return "binary" in (self.data, *(number.form for number in numbers if number is not None))

    def _size(self, what: int | str) -> int:
        sizes = {
            "station": self.station.size,
            "counter": self.counter.size if self.counter else 0,
            "data": (self.data_bytes or 0) * self.digits,
            "settings": _SETTINGS * self.digits,
            "sum": self.sum.size if self.sum else 0,
        }
        return sizes.get(str(what), 1)

    @cached_property
    def frames(self) -> tuple[FrameLayout, ...]:
        """The frames by their kinds."""
        found = []
        for name, order in self.orders.items():
            parts = tuple(Part(what, self._size(what), summed) for what, summed in order)
            found.append(FrameLayout(KIND_NAMES.index(name), parts, sum(part.size for part in parts)))
        return tuple(found)

    @cached_property
    def headers(self) -> frozenset[int]:
        """Characters that begin frames, and are nothing else; none where data may have them, too."""
        headers = {frame.header for frame in self.frames}
        return frozenset() if self.binary else frozenset(each for each in headers if each is not None)

    def begins(self, chars: bytes) -> bool:
        """Whether a frame may begin with these characters."""
        return any(frame.header in (None, chars[0]) for frame in self.frames)

    def decode(self, chars: bytes) -> Frame | None:
        """The frame that characters are; None if they are no valid one."""
        found = (self.decode_as(frame, chars) for frame in self.frames)
        return next((frame for frame in found if frame is not None), None)

    def decode_as(self, layout: FrameLayout, chars: bytes) -> Frame | None:
        """The frame of one kind that characters are; None if they are no valid one."""
        more = len(chars) - layout.size
        if more < 0 or (more and not layout.any_length) or more % self.digits:
            return None
        at, covered, values = 0, [], dict[str, bytes]()
        for what, size, summed in layout.parts:
            part = chars[at : at + (size or more)]
            at += len(part)
            if isinstance(what, int):
                if part[0] != what:
                    return None
            else:
                values[what] = part
            if summed:
                covered.append(part)
        if self.sum is not None and "sum" in values and not self.sum.right(b"".join(covered), values["sum"]):
            return None
        return self._frame(layout.kind, chars, values)

    def _frame(self, kind: int, chars: bytes, values: dict[str, bytes]) -> Frame | None:
        station, counter = 0, 0
        if "station" in values:
            number = self.station.read(values["station"])
            if number is None or not (kind == POLL) <= number - self.master < STATIONS:
                return None
            station = number - self.master
        if self.counter is not None and "counter" in values:
            number = self.counter.read(values["counter"])
            if number is None:
                return None
            counter = number
        data = self._bytes(values.get("data", b""))
        settings = self._bytes(values.get("settings", b""))
        if data is None or settings is None:
            return None
        given = LinkSettings(*settings) if kind == PARAMETERS and settings else None
        if given is not None and not given.possible:
            return None
        return Frame(kind, station, counter, chars, data if kind == DATA else b"", given)

    def _bytes(self, chars: bytes) -> bytes | None:
        if self.data == "binary":
            return chars
        if Number(self.data, 1).read(chars or b"0") is None:
            return None
        return bytes.fromhex(chars.decode("ascii"))


#: The layout that is assumed where none is given: that of the engine's codec (assumed.yaml).
ASSUMED: Final = Layout(
    orders={
        "data": (
            (0x02, False),
            ("station", True),
            ("counter", True),
            ("data", True),
            (0x03, True),
            ("sum", False),
        ),
        "poll": ((0x05, False), ("station", True), ("counter", True), ("sum", False)),
        "parameters": (
            *((0x01, False), (0x46, True), ("counter", True)),
            *(("settings", True), (0x03, True), ("sum", False)),
        ),
    },
    station=Number("hex", 1),
    counter=Number("hex", 1),
    sum=Sum("sum"),
    modulo=16,
)
