"""Links to work out, built without a scenario."""

from __future__ import annotations

from dataclasses import replace

from bussim.engines.nn.frames import data_chars
from bussim.exact.link import LineNoise, LinkModel, NoiseSource, Station, frame_ticks
from bussim.plc.profiles import PROFILES, AbsentStation, Turnaround

MS = 72_000
SECOND = 72_000_000
FULL, PROBE = AbsentStation.FULL, AbsentStation.PROBE
PW10 = PROFILES["pw10"]


def link(
    slaves: int = 2,
    *,
    mode: int = 2,
    attempts: int = 4,
    timeout: int = 50,
    absent: AbsentStation = FULL,
    ber: float = 0.0,
    loss: float = 0.0,
    turnaround: Turnaround = PW10.turnaround,
) -> LinkModel:
    """A link of the pw10 profile; ``timeout`` in ms."""
    reply = frame_ticks(data_chars(mode))
    return LinkModel(
        bus="link",
        master="p0",
        stations=tuple(
            Station(k, f"p{k}", turnaround, reply, loss=loss, scan=10 * MS) for k in range(1, slaves + 1)
        ),
        mode=mode,
        retries=attempts - 1,
        attempts=attempts,
        timeout=timeout * MS,
        gap=PW10.master_gap,
        overhead=PW10.scan_overhead,
        data=reply,
        absent=absent,
        noise=LineNoise((NoiseSource("bus", None, ber),) if ber else ()),
        scan=8 * MS,
    )


def with_burst(
    model: LinkModel,
    good: float,
    bad: float,
    ber_good: float,
    ber_bad: float,
    part: str = "bus",
    station: int | None = None,
) -> LinkModel:
    """The same link with a burst noise more; sojourns in ms."""
    chains = (*model.noise.chains, (good * MS, bad * MS))
    source = NoiseSource(part, station, ber_good, ber_bad, chain=len(chains) - 1)
    return replace(model, noise=LineNoise((*model.noise.sources, source), chains))


def with_noise(model: LinkModel, part: str, station: int | None, ber: float) -> LinkModel:
    """The same link with independent bit errors more."""
    source = NoiseSource(part, station, ber)
    return replace(model, noise=replace(model.noise, sources=(*model.noise.sources, source)))


def change(model: LinkModel, number: int, **fields: object) -> LinkModel:
    """The same link with one station changed."""
    stations = tuple(replace(s, **fields) if s.number == number else s for s in model.stations)  # type: ignore[arg-type]
    return replace(model, stations=stations)
