"""The Modbus slaves of a scenario as the closed form of a poll list needs them. Times in ticks."""

from dataclasses import dataclass

from bussim.devices.areas import AreaMap
from bussim.devices.contract import BusDevice, SlaveSettings
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.pdu import READS, ExceptionResponse, Request
from bussim.engines.modbus.server import SPACES, serve
from bussim.exact.polls.master_timing import Span, exactly
from bussim.line.characters import LineTiming
from bussim.words.language import say

_NOTHING = exactly(0)


@dataclass(frozen=True, slots=True)
class SlaveModel:
    """One slave.

    ``owner`` is the PLC or device that it belongs to. ``end`` is how long it may wait for its END (0: it
    responds by itself); ``delay`` counts from the request's end, ``spread`` and ``extra`` (of a fault that
    makes it slow) are added to the reply's begin. ``programmed``: a program makes its scans longer.
    """

    name: str
    owner: str
    bus: str
    station: int
    framing: Framing
    timing: LineTiming
    map: AreaMap
    delay: int = 0
    spread: int = 0
    end: int = 0
    extra: Span = _NOTHING
    off: bool = False
    programmed: bool = False

    def understands(self, mode: Mode, timing: LineTiming) -> bool:
        """Whether a master of this mode, rate and format is understood."""
        own = (self.timing.baud, self.timing.format)
        return self.framing.mode is mode and own == (timing.baud, timing.format)

    def refuses(self, request: Request, *, valued: bool) -> str:
        """Why the response to a request is an exception every time, in words; "" if it is not.

        ``valued``: a write's values are those that will be written (registers only: what becomes of a
        command depends on what the device does at that time).
        """
        found, function = self.map, request.function
        if function not in found.functions:
            return say("poll_no_function")
        if request.quantity > found.limits.of(function):
            return say("poll_at_most", number=found.limits.of(function))
        parts = found.parts(SPACES[function], request.address, request.quantity)
        if parts is None:
            return say("poll_no_address")
        if function in READS:
            return ""
        if not all(part.area.writable for part in parts):
            return say("poll_read_only")
        response = serve(found, request, 0) if valued else None
        if isinstance(response, ExceptionResponse):
            return say("poll_bad_values", code=int(response.code))
        return ""


def device_model(device: BusDevice, settings: SlaveSettings, *, extra: Span, off: bool) -> SlaveModel | None:
    """A device as slave; None for one whose mode is impossible on its line."""
    try:
        framing = device.framing()
    except ValueError:
        return None
    scan = settings.plc_scan()
    return SlaveModel(
        name=device.name,
        owner=device.name,
        bus=device.bus,
        station=device.station or 0,
        framing=framing,
        timing=device.timing,
        map=settings.register_map(),
        delay=device.delay,
        spread=device.jitter,
        end=scan.mean + scan.jitter - 1 if scan is not None else 0,
        extra=extra,
        off=off,
    )
