"""The line of a session is found: rate, polarity, format, protocol, channels; and what is no line is none."""

from __future__ import annotations

import random
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from bussim.cli import main
from tests.live.recordings.generator import Sent, Serial, ascii_frame, modbus, nn_link, rtu, sigrok, wave
from tests.live.recordings.reading import attempts, ok, sniffed
from tests.selection import quick

FORMATS = [
    Serial(0, data, parity, stops)
    for data, parity, stops in [
        *((8, parity, stops) for parity in "NEO" for stops in (1, 2)),
        *((7, parity, stops) for parity in "NEO" for stops in (1, 2)),
    ]
]
RATES = [300, 1200, 4800, 9600, 19200, 31250, 38400, 115200, 187500]
LINES = [
    (form._replace(baud=baud), inverted) for form, baud, inverted in product(FORMATS, RATES, (False, True))
]
random.Random(1).shuffle(LINES)


def exchange_of(serial: Serial, seed: int, count: int = 25) -> tuple[list, str, int]:
    """What is sent on a line of this format, the protocol, and the number of exchanges."""
    if serial.data == 8:
        return modbus(serial, count, seed)[0], "modbus-rtu", count
    if seed % 2:
        return modbus(serial, count, seed, frame=ascii_frame)[0], "modbus-ascii", count
    return nn_link(serial, 10), "nn", 20


@pytest.mark.parametrize(
    ("serial", "inverted"),
    quick(14, LINES),
    ids=lambda value: f"{value.baud}-{value.name}" if isinstance(value, Serial) else str(value),
)
def test_rate_polarity_format_and_protocol_are_found(serial: Serial, inverted: bool, tmp_path: Path) -> None:
    sent, protocol, exchanges = exchange_of(serial, serial.baud // 100 + serial.stops + inverted)
    level = wave(sent, serial, 8 * serial.baud)
    path = sigrok(tmp_path / "line.sr", 8 * serial.baud, {"D0": level ^ inverted})
    found = sniffed(path)
    assert (found["protocol"], found["format"], found["inverted"]) == (protocol, serial.name, inverted)
    assert found["baud"] == pytest.approx(serial.baud, rel=0.005 if serial.baud == 187500 else 0)
    assert (found["frames"], found["damaged"], found["strays"]) == (len(sent), 0, 0)
    assert (ok(found), attempts(found)) == (exchanges, exchanges)
    assert found["suggested"] is None
    assert ("rate" in {each["code"] for each in found["warnings"]}) == (serial.baud == 187500)


WRONG = {
    "parity": ("8E1", ("-P", "odd")),
    "no parity": ("8E1", ("-P", "none")),
    "stop bits": ("8N1", ("-s", "2")),
    "data bits": ("8E1", ("-d", "7")),
    "half the rate": ("8E1", ("-b", "4800")),
    "twice the rate": ("8N1", ("-b", "19200")),
    "polarity": ("8E1", ("--invert",)),
    "channel": ("8E1", ("--channel", "other")),
    "all of it": ("8O1", ("-b", "19200", "-P", "none", "-d", "8", "-s", "1", "--no-invert")),
}


@pytest.mark.parametrize("what", WRONG)
@pytest.mark.parametrize("protocol", [(), pytest.param(("--protocol", "modbus-rtu"), marks=pytest.mark.slow)])
def test_wrong_settings_are_obeyed_and_the_right_ones_suggested(
    what: str, protocol: tuple[str, ...], tmp_path: Path
) -> None:
    name, options = WRONG[what]
    serial = Serial(9600, int(name[0]), name[1], int(name[2]))
    level = wave(modbus(serial, 25, 7)[0], serial, 96_000)
    other = np.repeat(np.random.default_rng(1).integers(0, 2, 4000, dtype=np.uint8), 37)[: len(level)]
    path = sigrok(tmp_path / "line.sr", 96_000, {"RX": level, "other": other})
    found = sniffed(path, *options, *protocol)
    assert ok(found) == 0
    suggested = found["suggested"]
    assert (suggested["baud"], suggested["format"], suggested["inverted"]) == (9600, name, False)
    assert (suggested["channels"], suggested["protocol"]) == (["RX"], "modbus-rtu")
    assert "wrong_line_settings" in {each["code"] for each in found["warnings"]}
    if "-b" in options:
        assert found["baud"] == int(options[options.index("-b") + 1])


def test_right_settings_suggest_nothing(tmp_path: Path) -> None:
    serial = Serial(9600, 8, "E", 1)
    sent, outcomes = modbus(serial, 60, 3, damaged=0.4)
    path = sigrok(tmp_path / "line.sr", 96_000, {"RX": wave(sent, serial, 96_000)})
    for options in ((), ("-b", "9600", "-P", "even", "--protocol", "modbus-rtu")):
        found = sniffed(path, *options)
        assert found["suggested"] is None
        assert found["outcomes"] == {key: count for key, count in outcomes.items() if count}
        assert found["parity_errors"] == found["damaged"] == outcomes["damaged"]


# -- what is no line --------------------------------------------------------------------------------------


def random_pulses(rng: np.random.Generator) -> np.ndarray:
    return np.repeat(rng.integers(0, 2, 3000).astype(np.uint8), rng.integers(3, 60, 3000))


def spi(rng: np.random.Generator) -> np.ndarray:
    """A clock line: bursts of eight, sixteen or 24 cycles."""
    half = int(rng.integers(3, 20))
    parts = []
    for _ in range(200):
        parts += [np.tile([0, 1], int(rng.choice([8, 16, 24]))), np.zeros(int(rng.integers(5, 80)))]
    return np.repeat(np.concatenate(parts).astype(np.uint8), half)


def one_wire(rng: np.random.Generator) -> np.ndarray:
    """Time slots of 1-Wire, in microseconds: 0 is low for 60, 1 for 6; each slot has 70."""
    parts: list[np.ndarray] = []
    for bit in rng.integers(0, 2, 1500):
        low = 6 if bit else 60
        parts += [np.zeros(low), np.ones(70 - low)]
        if rng.random() < 0.01:
            parts += [np.zeros(480), np.ones(480)]
    return np.concatenate(parts).astype(np.uint8)


def pwm(rng: np.random.Generator) -> np.ndarray:
    """Pulse width modulation, constant or swept."""
    period = int(rng.integers(20, 200))
    width = int(rng.integers(2, period - 2))
    sweep = int(rng.integers(0, 3))
    parts: list[np.ndarray] = []
    for number in range(1200):
        high = 1 + (width + sweep * number) % (period - 2)
        parts += [np.ones(high), np.zeros(period - high)]
    return np.concatenate(parts).astype(np.uint8)


SIGNALS = [(kind, seed) for seed in range(50) for kind in (random_pulses, spi, one_wire, pwm)]


@pytest.mark.parametrize(("kind", "seed"), quick(5, SIGNALS))
def test_what_is_no_serial_line_is_not_recognised(kind, seed: int, tmp_path: Path) -> None:
    level = kind(np.random.default_rng(seed))
    path = sigrok(tmp_path / "signal.sr", 1_000_000, {"D0": level})
    found = sniffed(path)
    assert (found["protocol"], found["frames"], found["suggested"]) == (None, 0, None)
    assert "not_recognised" in {each["code"] for each in found["warnings"]}
    (channel,) = found["described"]
    assert channel["edges"] == int(np.count_nonzero(np.diff(level, prepend=1)))
    assert len(channel["wrong_share"]) == 3
    assert len(channel["pieces"]) <= 8
    assert channel["idle_level"] in (0, 1)
    assert main(["fit", str(path)]) == 1


# -- channels --------------------------------------------------------------------------------------------


def split(serial: Serial, rate: int, seed: int) -> tuple[dict[str, np.ndarray], int]:
    sent, _ = modbus(serial, 30, seed)
    wires = [wave([each for each in sent if each.wire == wire], serial, rate) for wire in (0, 1)]
    return {"TX": wires[0], "RX": wires[1]}, len(sent)


def test_two_directions_on_two_channels_are_one_line(tmp_path: Path) -> None:
    serial = Serial(19200, 8, "E", 1)
    channels, frames = split(serial, 200_000, 5)
    # A channel on which nothing changes, and one that has edges wherever the line has some.
    length = max(map(len, channels.values()))
    others = {"still": np.ones(10, dtype=np.uint8), "clock": (np.arange(length) // 20 % 2).astype(np.uint8)}
    path = sigrok(tmp_path / "line.sr", 200_000, others | channels)
    for options in ((), ("--channel", "TX,RX"), ("--channel", "RX,TX")):
        found = sniffed(path, *options)
        assert sorted(found["channels"]) == ["RX", "TX"]
        assert (found["frames"], found["damaged"], ok(found)) == (frames, 0, 30)
        assert "unclear" not in found["outcomes"]
    one = sniffed(path, "--channel", "TX", "--protocol", "modbus-rtu")
    assert (one["channels"], one["frames"], ok(one)) == (["TX"], 30, 0)


def test_the_channel_with_both_directions_is_taken_before_those_with_one(tmp_path: Path) -> None:
    serial = Serial(19200, 8, "N", 1)
    channels, frames = split(serial, 200_000, 6)
    length = max(map(len, channels.values()))
    both = np.ones(length, dtype=np.uint8)
    for level in channels.values():
        both[: len(level)] &= level
    found = sniffed(sigrok(tmp_path / "line.sr", 200_000, channels | {"bus": both}))
    assert (found["channels"], found["frames"], ok(found)) == (["bus"], frames, 30)


def test_too_few_samples_are_refused_with_the_rate_that_was_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    serial = Serial(115200, 8, "N", 1)
    path = sigrok(tmp_path / "line.sr", 345_600, {"D0": wave(modbus(serial, 20, 1)[0], serial, 345_600)})
    assert main(["sniff", str(path)]) == 2
    assert "115,200 bps" in capsys.readouterr().err
    slow = Serial(1200, 8, "N", 1)
    path = sigrok(tmp_path / "slow.sr", 9600, {"D0": wave(modbus(slow, 10, 1)[0], slow, 9600)})
    assert sniffed(path)["baud"] == 1200  # too few for the usual rates, enough for its own


def test_a_line_with_a_damaged_request_is_taken_before_what_its_slave_drives(tmp_path: Path) -> None:
    """Writes and their responses are alike: some of a slave's frames by themselves look like exchanges."""
    serial = Serial(9600, 8, "E", 1)
    rng = random.Random(1)
    sent: list[Sent] = []
    for number in range(60):
        at, value = 0.05 + 0.1 * number, rng.randrange(2)
        write = rtu(1, 6, b"\x00\x07", bytes((0, value)))
        sent += [Sent(at, write, 0, (12,) if number == 30 else ()), Sent(at + 0.02, write, 1)]
    sent = [each for number, each in enumerate(sent) if number != 61]  # to what is damaged nobody responds
    channels = {
        "bus": wave(sent, serial, 100_000),
        "master": wave([each for each in sent if not each.wire], serial, 100_000),
        "slave": wave([each for each in sent if each.wire], serial, 100_000),
    }
    found = sniffed(sigrok(tmp_path / "line.sr", 100_000, channels))
    assert found["channels"] == ["bus"]
    assert (found["frames"], found["damaged"], found["outcomes"]) == (119, 1, {"ok": 59})


def test_the_line_on_which_two_send_at_once_is_taken_before_what_each_drives(tmp_path: Path) -> None:
    """Of two that are a third of a bit apart no distance of edges is whole: the line alone shows no rate."""
    serial, rate = Serial(38400, 7, "E", 1), 400_000
    sent = nn_link(serial, 24)
    own = [wave([each for each in sent if each.wire == 0], serial, rate)]
    own += [
        wave([each._replace(at=each.at + late / 38400) for each in sent if each.wire], serial, rate)
        for late in (0, 7.37)
    ]
    both = np.ones(max(map(len, own)), dtype=np.uint8)
    for level in own:
        both[: len(level)] &= level
    path = sigrok(
        tmp_path / "line.sr", rate, dict(zip(("master", "one", "two", "bus"), [*own, both], strict=True))
    )
    found = sniffed(path)
    assert (found["channels"], found["damaged"]) == (["bus"], 48)
    assert [each["code"] for each in found["warnings"]] == ["mixed_line"]
    assert (found["frames"], found["outcomes"]) == (len(sent), {"damaged": 47, "undecided": 1})
    assert sniffed(path, "--channel", "master,one")["outcomes"] == {"ok": 48}


@pytest.mark.parametrize("off", [-0.02, -0.01, 0.01, 0.02])
def test_a_clock_that_is_off_is_read_at_its_standard_rate(off: float, tmp_path: Path) -> None:
    nominal, real = Serial(9600, 8, "E", 1), Serial(round(9600 * (1 + off)), 8, "E", 1)
    path = sigrok(tmp_path / "line.sr", 100_000, {"D0": wave(modbus(real, 25, 2)[0], real, 100_000)})
    found = sniffed(path)
    assert (found["baud"], found["format"], ok(found)) == (nominal.baud, "8E1", 25)


def test_short_spikes_hide_no_rate(tmp_path: Path) -> None:
    serial, rate = Serial(9600, 8, "E", 1), 192_000
    sent, _ = modbus(serial, 40, 4)
    level = wave(sent, serial, rate)
    rng = random.Random(1)
    hit = 0
    for at in sorted(rng.sample(range(100, len(level) - 100), 60)):
        if level[at - 40 : at + 40].all():  # while the line is idle
            level[at : at + 3] ^= 1
            hit += 1
    found = sniffed(sigrok(tmp_path / "line.sr", rate, {"D0": level}))
    assert (found["frames"], found["damaged"], ok(found)) == (len(sent), 0, 40)
    assert found["spikes"] == hit


@pytest.mark.parametrize("block", quick(1, [1000, 11]))
def test_a_session_is_read_alike_in_blocks_of_any_size(
    block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    serial = Serial(9600, 8, "E", 1)
    sent, _ = modbus(serial, 3, 8, damaged=0.5)
    rng = np.random.default_rng(block)
    noise = np.repeat(rng.integers(0, 2, 300).astype(np.uint8), rng.integers(1, 60, 300))
    level = np.concatenate([noise, wave(sent, serial, 76_800), noise, wave(sent, serial, 76_800)])
    path = sigrok(tmp_path / "line.sr", 76_800, {"D0": level})
    options = ("-b", "9600", "-P", "even", "--protocol", "modbus-rtu")
    whole = sniffed(path, *options)
    assert whole["frames"] >= 2 * len(sent)
    monkeypatch.setattr("bussim.live.recordings.sigrok._BLOCK", block)
    assert sniffed(path, *options) == whole
