"""The form of a scenario file: noise and faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from pydantic import Field, model_validator

from bussim.engines.modbus.adu import ASCII_MAX
from bussim.engines.nn.frames import MODES, data_chars
from bussim.forms.fields import (
    Baud,
    Duration,
    Format,
    Moment,
    Name,
    NodeName,
    Positive,
    Probability,
    Time,
    Title,
    choice,
    fail,
    number,
    one_of,
    whole,
)
from bussim.forms.form import Model, OneKind, kinds_of
from bussim.line.characters import NN_LINE, CharFormat
from bussim.scenario.model import BitErrors, Burst, Impulse, NoiseKind, ReplyLoss
from bussim.words.language import say

#: Characters and bits of the link's longest frame, and of the longest one on any bus.
LINK_FRAME = max(data_chars(mode) for mode in range(len(MODES)))
LINK_BITS = LINK_FRAME * NN_LINE.format.bits
LONGEST_FRAME = max(LINK_FRAME, ASCII_MAX)
LONGEST_BITS = LONGEST_FRAME * CharFormat(8, "E", 2).bits
#: Kinds of frames: the link's, and those of Modbus.
LINK_FRAMES, MODBUS_FRAMES = ("data", "poll", "parameters"), ("request", "response")
#: Codes of D8063 that no frame can cause (PW10, section 8; ports COM3 to COM6).
BOARD_CODES = (*range(10, 20), *range(40, 48), 49)

#: Faults of a station that damage single frames, so that ``count`` can limit them.
COUNTED = ("drop_reply", "lose_char", "insert_char", "pause", "flip_bits")
#: Faults of a PLC or device as a whole, whatever bus it is on.
OF_THE_OWNER = frozenset({"power_off", "stop"})

Side = Annotated[str, choice("rx", "tx")]
Count = Annotated[int, whole(1, 1_000_000)]


class BurstIn(Model):
    """Gilbert–Elliott noise."""

    example = "{good: 10 s, bad: 20 ms, ber_good: 0, ber_bad: 1.0e-2}"

    good: Positive
    bad: Positive
    ber_good: Probability = 0.0
    ber_bad: Probability


class ImpulseIn(Model):
    """Periodic impulses."""

    example = "{every: 20 ms, width: 50 us, ber: 0.5}"

    every: Positive
    width: Positive
    ber: Probability = 0.5
    phase: Time | None = None

    @model_validator(mode="after")
    def _fits(self) -> ImpulseIn:
        if self.width > self.every:
            raise fail(say("form_not_above_every"), "width")
        if self.phase is not None and self.phase >= self.every:
            raise fail(say("form_below_every"), "phase")
        return self


class _NoiseWhere(OneKind):
    """Where and when noise acts, and the recording that says how much of it there is."""

    name: Name | None = None
    bus: Name
    station: NodeName | None = None
    direction: Side | None = None
    at: Moment = 0
    for_: Duration | None = Field(None, alias="for")
    measured: Title | None = None


class NoiseIn(_NoiseWhere):
    """One entry of ``noise``: the other keys are its kinds, of which it has one."""

    example = "{bus: link, ber: 1.0e-6}"

    ber: Probability | None = None
    burst: BurstIn | None = None
    impulse: ImpulseIn | None = None
    reply_loss: Probability | None = None

    @model_validator(mode="after")
    def _sided(self) -> NoiseIn:
        if self.direction is not None and self.station is None:
            raise fail(say("form_needs_station"), "direction")
        if self.direction is not None and self.reply_loss is not None:
            raise fail(say("form_reply_loss"), "direction")
        return self

    @property
    def value(self) -> NoiseKind:
        """What it does, as a value of the scenario."""
        return _NOISE[self.kind](getattr(self, self.kind))


NoiseIn.kinds = kinds_of(NoiseIn, _NoiseWhere)
#: What becomes of each kind: the fields of a mapping are those of the value.
_NOISE: dict[str, Callable[[Any], NoiseKind]] = {
    "ber": BitErrors,
    "burst": lambda given: Burst(**dict(given)),
    "impulse": lambda given: Impulse(**dict(given)),
    "reply_loss": ReplyLoss,
}


class StationIn(Model):
    """A fault that needs no more than the name of a PLC, of one of its ports, or of a device."""

    example = "the name of a PLC, a port such as press1.COM3 or a device, or {station: press1}"
    shorthand = "station"

    station: NodeName


class SlowIn(StationIn):
    """A slave that replies late."""

    example = "{station: press1, extra: 60 ms}"

    extra: Positive


class CableCutIn(Model):
    """A broken cable."""

    example = "{bus: link, after: press1}"

    bus: Name
    after: NodeName


class WrongFormatIn(StationIn):
    """A port with other settings than the line's."""

    example = "{station: press1, format: 7O1}"

    format: Format | None = None
    baud: Baud | None = None

    @model_validator(mode="after")
    def _something(self) -> WrongFormatIn:
        if self.format is None and self.baud is None:
            raise fail(say("form_missing"), "format")
        return self


class ClockIn(StationIn):
    """A bit clock that is off."""

    example = "{station: press1, ppm: 20000}"

    ppm: Annotated[float, number(-100_000, 100_000)]


class LateReleaseIn(StationIn):
    """A driver that stays on."""

    example = "{station: press1, by: 2 ms}"

    by: Positive


class LoseCharIn(StationIn):
    """A character too few."""

    example = "the name of a PLC, or {station: press1, direction: tx, index: 3}"

    direction: Side = "tx"
    index: Annotated[int, whole(0, LONGEST_FRAME - 1)] | None = None


class InsertCharIn(LoseCharIn):
    """A character too many."""

    example = "the name of a PLC, or {station: press1, direction: tx, index: 3, value: 0x30}"

    value: Annotated[int, whole(0, 255)] | None = None


class PauseIn(StationIn):
    """A pause inside a frame, as a slow program or a USB bridge makes it."""

    example = "{station: press1, index: 3, by: 5 ms}"

    index: Annotated[int, whole(0, LONGEST_FRAME - 2)] | None = None
    by: Positive


class FlipBitsIn(StationIn):
    """Chosen bits inverted."""

    example = "{station: press1, bits: [31, 32]}"

    direction: Side = "tx"
    bits: Annotated[
        list[Annotated[int, whole(0, LONGEST_BITS - 1)]], Field(min_length=1, max_length=LONGEST_BITS)
    ]
    frame: Annotated[str, choice(*LINK_FRAMES, *MODBUS_FRAMES)] | None = None

    @model_validator(mode="after")
    def _different(self) -> FlipBitsIn:
        if len(set(self.bits)) != len(self.bits):
            raise fail(say("form_bit_twice"), "bits")
        return self


class BoardErrorIn(Model):
    """A failed exchange between PLC and board."""

    example = "{plc: press1, port: COM4, code: 40}"

    plc: Name
    port: Annotated[str, choice("COM3", "COM4", "COM5", "COM6")]
    code: Annotated[int, one_of(BOARD_CODES)]


class _FaultWhen(OneKind):
    name: Name | None = None
    at: Moment | None = None
    for_: Duration | None = Field(None, alias="for")
    count: Count | None = None


class FaultIn(_FaultWhen):
    """One entry of ``faults``: the other keys are its kinds, of which it has one."""

    example = "{at: 10 s, for: 5 s, power_off: press1}"

    power_off: StationIn | None = None
    stop: StationIn | None = None
    drop_reply: StationIn | None = None
    slow: SlowIn | None = None
    jabber: StationIn | None = None
    cable_cut: CableCutIn | None = None
    wrong_format: WrongFormatIn | None = None
    clock_ppm: ClockIn | None = None
    late_release: LateReleaseIn | None = None
    lose_char: LoseCharIn | None = None
    insert_char: InsertCharIn | None = None
    pause: PauseIn | None = None
    flip_bits: FlipBitsIn | None = None
    board_error: BoardErrorIn | None = None
    power_on: dict[str, Moment] | None = None

    @model_validator(mode="after")
    def _counted_or_timed(self) -> FaultIn:
        kind = self.kind
        if kind == "power_on":
            for key, field in _FaultWhen.model_fields.items():
                if getattr(self, key) is not None:
                    raise fail(say("form_beside_power_on"), field.alias or key)
        if self.count is not None and kind and kind not in COUNTED:
            raise fail(say("form_count_for", kind=kind, kinds=", ".join(COUNTED)), "count")
        if self.count is not None and self.for_ is not None:
            raise fail(say("form_excludes_for"), "count")
        return self


FaultIn.kinds = kinds_of(FaultIn, _FaultWhen)
