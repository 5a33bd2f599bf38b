"""A scenario's noise, placed on its lines."""

from __future__ import annotations

from typing import assert_never

from bussim.line.noise import BitNoise, BurstRate, ConstantRate, ErrorRate, ImpulseRate
from bussim.line.random_streams import Streams
from bussim.scenario.fault_kinds import Direction
from bussim.scenario.model import BitErrors, Burst, Impulse, Noise, ReplyLoss
from bussim.sim.wire.disturber import Loss, PlacedNoise
from bussim.sim.wire.line import Line
from bussim.sim.wire.node import Node


def place_noise(noise: Noise, name: str, line: Line, node: Node | None, streams: Streams) -> None:
    """Let a noise disturb a line, or only a node on it; ``name`` is that of its random streams."""
    kind, window = noise.kind, noise.window
    position = node.position if node is not None else None
    rate: ErrorRate
    match kind:
        case ReplyLoss(probability):
            draws = {
                port.position: streams.uniforms("noise", name, port.name)
                for port in line.ports
                if position in (None, port.position)
            }
            line.disturber.add(Loss(position, probability, window.at, window.until, draws))
            return
        case BitErrors(ber):
            rate = ConstantRate(ber)
        case Burst(good, bad, ber_good, ber_bad):
            state = streams.uniforms("noise", name, "state")
            rate = BurstRate(good, bad, ber_good, ber_bad, state)
        case Impulse(every, width, ber, phase):
            if phase is None:
                phase = int(next(streams.uniforms("noise", name, "state")) * every)
            rate = ImpulseRate(every, width, ber, window.at + phase)
        case _:
            assert_never(kind)
    process = BitNoise(name, rate, streams, window.at, window.until)
    receiver = position is not None and noise.target.direction is Direction.RX
    line.disturber.add(PlacedNoise(process, position, receiver))
