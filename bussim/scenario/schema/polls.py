"""The form of a scenario file: what is exchanged on a port that is not the link's."""

from typing import Annotated

from pydantic import Field

from bussim.engines.free.engine import MAX_BYTES
from bussim.engines.modbus.adu import LAST_STATION
from bussim.engines.modbus.pdu import STANDARD_LIMITS
from bussim.forms.fields import DeviceName, FunctionCode, Hex, Name, Text, Time, Times, choice, whole
from bussim.forms.form import Model

#: Most values that one request carries.
_MOST_VALUES = STANDARD_LIMITS.write_coils


class TransactionIn(Model):
    """A Modbus transaction that recurs. Which keys a poll needs, its function decides."""

    name: Name | None = None
    station: Annotated[int, whole(0, LAST_STATION)] | None = None
    function: FunctionCode | None = None
    address: Annotated[int, whole(0, 0xFFFF)] | None = None
    count: Annotated[int, whole(0, 0xFFFF)] | None = None
    values: Annotated[list[Annotated[int, whole(-32768, 0xFFFF)]], Field(max_length=_MOST_VALUES)] | None = (
        None
    )
    every: Time = 0
    at: Time = 0
    times: Times | None = None
    retries: Annotated[int, whole(0, 100)] | None = None
    skip_after_failure: Annotated[int, whole(1, 1000)] | None = None

    @property
    def quantity(self) -> int:
        """How many coils or registers it is about: as it says, or as many as it has values, or one."""
        if self.count is not None:
            return self.count
        return len(self.values) if self.values else 1


class HmiPollIn(TransactionIn):
    """One poll of an HMI."""

    example = "{station: 1, function: 3, address: 0, count: 2, every: 200 ms}"


class PollIn(TransactionIn):
    """One RS2 instruction of a PLC: Modbus or free, as its port's protocol says."""

    example = "{port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400, every: 200 ms}"

    port: Annotated[str, choice("COM2", "COM3", "COM4", "COM5", "COM6")]
    to: DeviceName | None = None
    from_: DeviceName | None = Field(None, alias="from")
    send: DeviceName | None = None
    send_count: Annotated[int, whole(0, MAX_BYTES)] | None = None
    data: Hex | None = None
    text: Text | None = None
