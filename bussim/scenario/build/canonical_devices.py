"""Devices and polls as plain data in the file's own form, with every default filled in."""

from __future__ import annotations

from collections.abc import Sequence

from bussim.devices.profiles import DEVICE_PROFILES
from bussim.forms.form import as_written, in_order
from bussim.scenario.resolve.map_entries import functions, stepper_profile
from bussim.scenario.rules.devices import SPACES, reference
from bussim.scenario.schema.devices import DeviceIn, HmiIn, MapIn, SlaveIn, StepperIn, V80In
from bussim.scenario.schema.polls import PollIn, TransactionIn
from bussim.units import format_time


def written_poll(poll: TransactionIn) -> dict[str, object]:
    """A poll. A name that it was not given stays open: it follows from what the poll asks."""
    written = as_written(poll)
    if poll.function is not None:
        written.setdefault("count", poll.quantity)
        written.setdefault("retries", 0)
    elif isinstance(poll, PollIn):
        data = poll.data or poll.text
        if data is not None:
            written.setdefault("send_count", len(data))
    return in_order(poll, written)


def written_device(device: DeviceIn, polls: Sequence[TransactionIn]) -> dict[str, object]:
    """A device, and the polls of an HMI."""
    written = {key: value for key, value in as_written(device).items() if value not in ({}, [])}
    if isinstance(device, SlaveIn):
        delay = device.delay if device.delay is not None else DEVICE_PROFILES[device.model].delay
        written["delay"] = format_time(delay)
    if isinstance(device, StepperIn):
        profile = stepper_profile(device)
        written["profile"] = {
            "save_coil": profile.save_coil,
            "acceleration_unit": float(profile.acceleration_unit),
            "homing_zeroes": profile.homing_zeroes,
            "refused_command": profile.refused_command,
            "step_output": profile.step_output.value,
            "zero_is_endless": profile.zero_is_endless,
        }
    if isinstance(device, V80In):
        for section, (_, digit) in SPACES.items():
            if section in written:
                written[section] = {
                    f"{10_000 * digit + reference(section, key) + 1:05}": value
                    for key, value in written[section].items()
                }
    if isinstance(device, MapIn):
        written["functions"] = sorted(functions(device))
    if isinstance(device, HmiIn) and polls:
        written["polls"] = [written_poll(poll) for poll in polls]
    return in_order(device, written)
