"""Does the simulation agree with the figures of a port's setting? For ``bussim size --verify``.

The recommended setting is simulated with its noise raised until failed attempts are seen: they are compared
with the closed form at that noise, and the cycles with their bounds; then once more with the device dead that
costs most.
"""

import math
from dataclasses import dataclass, replace

from bussim.devices.contract import MasterSettings
from bussim.exact.metrics import YEAR
from bussim.exact.polls.failures import failures
from bussim.exact.sizing.noise_levels import BAD, LEVELS
from bussim.exact.sizing.ports.setting import at_level
from bussim.exact.sizing.ports.size import PortSizing
from bussim.plc.ports.cpavl import INTERVAL, INTERVAL_UNIT, TIMEOUT, TIMEOUT_UNIT
from bussim.plc.ports.spec import PollSpec
from bussim.scenario import fault_kinds, model
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from bussim.words.language import say

#: Two-sided 99.99 % of a normal variable; attempts that are simulated, and failed ones that are wanted.
_WIDTH, _ATTEMPTS, _WANTED = 3.89, 3_000, 60
#: The chance that an attempt fails is raised to this.
_CHANCE = _WANTED / _ATTEMPTS


@dataclass(frozen=True, slots=True)
class PortVerification:
    """Simulated figures of the recommended setting beside their closed form. Times in ticks.

    ``ber`` is the bit error rate that it was simulated with, ``dead`` the device that was off, "" for none.
    ``allowed`` is the range of failed attempts with 99.99 %, ``longest`` the longest cycle,
    which is at most ``bound``.
    """

    ber: float
    dead: str
    attempts: int
    failed: int
    allowed: tuple[float, float]
    longest: int
    bound: int

    @property
    def agrees(self) -> bool:
        """Whether the failures lie within their range and no cycle exceeds its bound."""
        return self.allowed[0] <= self.failed <= self.allowed[1] and self.longest <= self.bound

    def in_words(self) -> str:
        """What was compared, and with what result."""
        low, high = (round(value) for value in self.allowed)
        state = say("verify_dead", device=self.dead) if self.dead else say("verify_ber", rate=self.ber)
        return say(
            "verify_port",
            state=state,
            failed=self.failed,
            attempts=self.attempts,
            low=low,
            high=high,
            longest=self.longest / TICKS_PER_MS,
            bound=self.bound / TICKS_PER_MS,
            sign=say("verify_agrees" if self.agrees else "verify_disagrees"),
        )

    def to_json(self) -> dict[str, object]:
        """As plain data."""
        return {
            "bit_error_rate": self.ber,
            "dead": self.dead or None,
            "attempts": self.attempts,
            "failed_attempts": self.failed,
            "allowed_failed_attempts": list(self.allowed),
            "longest_cycle_ms": self.longest / TICKS_PER_MS,
            "bound_ms": self.bound / TICKS_PER_MS,
            "agrees": self.agrees,
        }


def with_port_setting(
    scenario: model.Scenario, node: str, timeout: int, retries: int, interval: int
) -> model.Scenario:
    """A scenario without faults, with another setting of one poll list (times in ticks)."""
    plcs, devices = list(scenario.plcs), list(scenario.devices)
    for index, plc in enumerate(plcs):
        spec = next((spec for spec in plc.ports if plc.port_node(spec.name) == node), None)
        if spec is not None:
            words = {
                f"D{spec.words.address + TIMEOUT}": timeout // TIMEOUT_UNIT,
                f"D{spec.words.address + INTERVAL}": interval // INTERVAL_UNIT,
            }
            polls = tuple(
                replace(poll, retries=retries)
                if isinstance(poll, PollSpec) and poll.port == spec.name
                else poll
                for poll in plc.polls
            )
            plcs[index] = replace(plc, registers={**plc.registers, **words}, polls=polls)
    for index, device in enumerate(devices):
        settings = device.settings
        if device.name == node and isinstance(settings, MasterSettings):
            asked = tuple(replace(poll, retries=retries) for poll in settings.polls)
            changed = replace(settings, timeout=timeout, interval=interval, polls=asked)
            devices[index] = replace(device, settings=changed)
    return replace(scenario, plcs=tuple(plcs), devices=tuple(devices), faults=(), latency=())


def verify_port(scenario: model.Scenario, node: str, sizing: PortSizing) -> list[PortVerification]:
    """Simulate the recommended setting of a poll list beside its figures: with noise, and a device dead."""
    best = sizing.recommended
    if best is None:
        return []
    setting = with_port_setting(scenario, node, best.timeout, best.retries, best.interval)
    found = best.figures
    listed = found.model
    bits = max((poll.bits for poll in listed.polls), default=1)
    ber = max(LEVELS[BAD], -math.expm1(math.log1p(-_CHANCE) / bits))
    noise = model.Noise("verify", model.Target(listed.bus), model.BitErrors(ber))
    noisy = replace(setting, noise=(noise,))
    verified = [_compare(noisy, sizing, node, "", ber)]
    costly = max(found.dead, key=lambda each: each.mean, default=None)
    if costly is not None:
        (device,) = costly.devices
        off = model.Fault("verify", fault_kinds.PowerOff(device.partition(".")[0]))
        verified.append(_compare(replace(setting, noise=(), faults=(off,)), sizing, node, device, 0.0))
    return verified


def _compare(
    scenario: model.Scenario, sizing: PortSizing, node: str, dead: str, ber: float
) -> PortVerification:
    from bussim import api

    best = sizing.recommended
    if best is None:
        raise ValueError("nothing is recommended")
    listed, figures = best.figures.model, best.figures
    if dead:
        span = max(each.cycle.most for each in figures.dead) * _ATTEMPTS // len(listed.polls)
    else:
        a_year = math.fsum(one.failures.a_year for one in figures.polls if one.failures is not None)
        span = round(YEAR * _ATTEMPTS / a_year)
    ran = api.run(replace(scenario, duration=min(span, 3600 * TICKS_PER_SECOND)), rows=False)
    seen = ran.record.ports[node]
    expected = variance = 0.0
    for poll in listed.polls:
        if poll.name in seen.polls and poll.device:
            law = failures(listed, at_level(poll, ber) if ber else replace(poll, hits=(), loss=0.0), 1.0)
            chance = 1.0 if poll.device == dead else law.attempt
            expected += seen.polls[poll.name].transactions * chance
            variance += seen.polls[poll.name].transactions * chance * (1 - chance)
    spread = _WIDTH * math.sqrt(max(variance, 1.0)) + 2 if variance else 0.0
    attempts = sum(poll.transactions for poll in seen.polls.values())
    failed = attempts - sum(poll.ok for poll in seen.polls.values())
    bound = figures.disturbed or 0
    return PortVerification(
        ber,
        dead,
        attempts,
        failed,
        (max(0.0, expected - spread), expected + spread),
        seen.cycles.maximum or 0,
        bound,
    )
