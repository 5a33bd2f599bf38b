"""The device model ``free``: a device that sends fixed messages in a protocol of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, model_validator

from bussim.devices.contract import Behaviour, BusDevice, FreeProtocolSettings
from bussim.devices.forms import Delay, DeviceIn, Find
from bussim.devices.free.scripted import Message, ScriptedDevice
from bussim.devices.serial_settings import DevicePort
from bussim.forms.fields import Hex, Positive, Text, Time, Times, fail
from bussim.forms.form import OneKind
from bussim.line.random_streams import Streams
from bussim.plc.ports.spec import PollSpec
from bussim.words.language import say

MAX_MESSAGES = 1000
FREE_PORT = DevicePort("free")


@dataclass(frozen=True, slots=True)
class FreeSettings(FreeProtocolSettings):
    """What the device sends, and when."""

    port = FREE_PORT

    messages: tuple[Message, ...]

    def behaviour(self, device: BusDevice, streams: Streams) -> Behaviour:
        """The messages begin anew at power-on; the streams of their jitter, one each, go on."""
        draws = [streams.uniforms("saying", device.name, number) for number in range(len(self.messages))]
        return Behaviour(lambda _: (ScriptedDevice(self.messages, device.timing, draws), device.timing))


class BytesIn(OneKind):
    """Bytes as text or in hexadecimal."""

    kinds = ("text", "bytes")

    text: Text | None = None
    bytes: Hex | None = None


def _data(given: BytesIn) -> bytes:
    return given.text or given.bytes or b""


class HeardIn(BytesIn):
    """Bytes to which a message is the reply."""

    example = 'a text, or {bytes: "02 41 03"}'
    shorthand = "text"


class MessageIn(BytesIn):
    """Something that a free-protocol device sends."""

    example = '{text: "ABC\\r", every: 1 s}'

    at: Time | None = None
    every: Positive | None = None
    times: Times | None = None
    jitter: Time | None = None
    reply_to: HeardIn | None = None
    delay: Delay | None = None

    @model_validator(mode="after")
    def _on_its_own_or_a_reply(self) -> MessageIn:
        if self.reply_to is not None:
            for key in ("at", "every", "times", "jitter"):
                if getattr(self, key) is not None:
                    raise fail(say("form_excludes", given="reply_to"), key)
        elif self.delay is not None:
            raise fail(say("model_needs_reply_to"), "delay")
        if self.times is not None and self.times > 1 and self.every is None:
            raise fail(say("form_needs_every"), "times")
        return self

    def message(self) -> Message:
        """The frozen message."""
        reply_to = _data(self.reply_to) if self.reply_to is not None else b""
        return Message(_data(self), reply_to=reply_to, **self.given("text", "bytes", "reply_to"))


class FreeIn(DeviceIn):
    """An entry of this model."""

    example = """
{name: reader, model: free, bus: feeder, says: [
  {text: "4006381333931", at: 1 s, every: 1 s, times: 3, jitter: 100 ms},
  {bytes: "02 41", reply_to: "?", delay: 5 ms}, {text: "A", reply_to: {bytes: "05"}}]}
"""
    port = FREE_PORT

    says: Annotated[list[MessageIn], Field(min_length=1, max_length=MAX_MESSAGES)]

    def settings(self, polls: tuple[PollSpec, ...], find: Find) -> FreeSettings:
        """Its messages."""
        return FreeSettings(tuple(message.message() for message in self.says))
