from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction

import pytest

from bussim.engines.nn.frames import LinkSettings
from bussim.engines.nn.slave import Slave
from bussim.line.random_streams import Streams
from bussim.plc.memory import Device, DeviceRange, parse_device
from bussim.plc.plc import Plc, PlcState
from bussim.plc.ports.port_instructions import ProgramPorts
from bussim.plc.profiles import PROFILES, Profile
from bussim.plc.sources import Constant, Counter, Source, Toggle

PW10 = PROFILES["pw10"]
SCAN, PHASE = 1100, 500
SETTINGS = LinkSettings(2, 1, 3, 10)


def plc(
    station: int = 0,
    *,
    profile: Profile = PW10,
    linked: bool = True,
    sources: dict[str, Source] | None = None,
    jitter: int = 0,
    **registers: int,
) -> Plc:
    made = Plc(
        "press",
        profile,
        scan_mean=1000,
        scan_jitter=jitter,
        phase=PHASE,
        registers={"D8176": station, "D8177": 2, "D8178": 1, **registers},
        sources=sources or {},
        linked=linked,
        streams=Streams(1),
    )
    made.power_on()
    return made


def words(image: bytes) -> list[int]:
    """The four words of a block of mode 1, after its four bytes of points."""
    return [image[at] * 256 + image[at + 1] for at in range(4, 12, 2)]


def test_power_on_gives_the_memory_its_values_and_stops() -> None:
    tested = plc(D100=7)
    assert tested.state is PlcState.STOP
    assert tested.read("D100") == 7
    assert tested.read("D8180") == 10
    tested.run(0, traced=False)
    tested.memory.set_word("D", 100, 99)
    tested.memory.set_word("D", 101, 99)
    tested.memory.set_word("D", 8120, 99)
    tested.power_off(10)
    assert tested.state is PlcState.OFF
    tested.power_on()
    assert (tested.read("D100"), tested.read("D101"), tested.read("D8120")) == (7, 0, 0)


#: Of each profile: devices that are general, and such as are latched, at the ends of the ranges.
MEMORY = {
    "fx2n": (
        "M0 M499 S0 S499 T0 T245 C0 C99 C200 C219 D0 D199 Y0",
        "M500 M3071 S500 S999 T246 T255 C100 C199 C220 C255 D200 D7999",
    ),
    "fx1s": (
        "M0 M383 M512 S128 T0 T246 C0 C15 C32 C234 D0 D127 D256 Y0",
        "M384 M511 S0 S127 C16 C31 C235 C255 D128 D255",
    ),
}
MEMORY["pw10"] = MEMORY["fx3u"] = MEMORY["fx2n"]


def marked(profile: Profile, *, hold: int = 0, **registers: int) -> Plc:
    """A PLC in RUN all of whose devices named above hold something."""
    tested = plc(profile=profile, linked=False, **registers)
    tested.run(0, traced=False)
    memory = tested.memory
    memory.set(Device("M", 8033), hold)
    for name in " ".join(MEMORY[profile.name]).split():
        device = parse_device(name)
        memory.set(device, 1)
        if device.letter in "TC":
            memory.set_word(device.letter, device.address, 5)
            memory.held[device.letter][device.address] = 1
    memory.words("V")[3] = memory.words("D")[8200] = memory.bits("M")[8200] = memory.bits("X")[1] = 1
    return tested


def held(tested: Plc, names: str) -> list[tuple[int, int, int]]:
    """Of each device: its bit or word, and of a timer or counter its value and whether an RST holds it."""
    found = []
    for name in names.split():
        letter, address = parse_device(name)
        timed = letter in "TC"
        found.append(
            (
                tested.read(name),
                tested.memory.word(letter, address) if timed else 5,
                tested.memory.held[letter][address] if timed else 1,
            )
        )
    return found


@pytest.mark.parametrize("name", MEMORY)
@pytest.mark.parametrize("supply", [False, True])
def test_what_is_latched_stays_over_stop_and_over_a_power_loss(name: str, *, supply: bool) -> None:
    tested = marked(PROFILES[name])
    general, latched = MEMORY[name]
    tested.stop(10)
    if supply:
        tested.power_off(10)
        tested.power_on(20)
    tested.run(30, traced=False)
    assert held(tested, latched) == [(1, 5, 1)] * len(latched.split())
    assert [item[0] for item in held(tested, general)] == [0] * len(general.split())
    for device in map(parse_device, general.split()):
        if device.letter in "TC":
            assert tested.memory.word(*device) == tested.memory.held[device.letter][device.address] == 0
    # Special devices and inputs are no program's to keep: STOP leaves them alone.
    kept = 0 if supply else 1
    memory = tested.memory
    assert (memory.words("V")[3], memory.words("D")[8200], memory.bits("M")[8200]) == (0, kept, kept)
    assert memory.bits("X")[1] == kept


def test_m8033_keeps_all_at_stop_but_nothing_without_supply() -> None:
    general, latched = MEMORY["fx2n"]
    tested = marked(PROFILES["fx2n"], hold=1)
    tested.stop(10)
    assert held(tested, f"{general} {latched}") == [(1, 5, 1)] * len(f"{general} {latched}".split())
    tested.power_off(20)
    tested.power_on(30)
    assert [item[0] for item in held(tested, general)] == [0] * len(general.split())
    assert held(tested, latched) == [(1, 5, 1)] * len(latched.split())


@pytest.mark.parametrize("supply", [False, True])
def test_registers_are_what_a_general_device_begins_with_again(*, supply: bool) -> None:
    tested = plc(D100=7, D300=8)
    tested.run(0, traced=False)
    for address in (100, 101, 300):
        tested.memory.set_word("D", address, 99)
    tested.stop(10)
    if supply:
        tested.power_off(10)
        tested.power_on(20)
    assert [tested.read(name) for name in ("D100", "D101", "D300")] == [7, 0, 99]


def test_a_profile_says_what_is_latched() -> None:
    tested = plc(profile=replace(PW10, latched=(DeviceRange("D", 3, 4), DeviceRange("R", 0, 9))))
    tested.run(0, traced=False)
    for address in range(2, 6):
        tested.memory.set_word("D", address, 99)
    tested.stop(10)
    assert [tested.read(f"D{address}") for address in range(2, 6)] == [0, 99, 99, 0]


@pytest.mark.parametrize(("linked", "mean", "jitter"), [(True, 1100, 110), (False, 1000, 100)])
def test_the_scan_is_longer_while_the_link_runs(linked: bool, mean: int, jitter: int) -> None:
    tested = plc(linked=linked, jitter=100)
    engine, first = tested.run(0, traced=False)
    assert (engine is not None) is linked
    assert first == PHASE
    tested.sync(4_000_000)
    tested.cycle.count_up_to(4_000_000)
    cycle = tested.cycle
    # Uniform over mean ± jitter: the mean of n has the deviation jitter / sqrt(3 n).
    assert abs(cycle.total / cycle.count - mean) < 4 * jitter / (3 * cycle.count) ** 0.5
    assert mean + jitter - 5 < cycle.longest <= mean + jitter


def test_a_plc_with_refused_parameters_scans_as_without_a_link() -> None:
    tested = plc(D8177=0)
    engine, _ = tested.run(0, traced=False)
    assert engine is None
    assert tested.cycle.latest_end(PHASE + 3 * 1000) == PHASE + 3 * 1000


def test_scan_factor_multiplies_mean_and_jitter() -> None:
    assert plc(jitter=100).scan_under_link() == (1100, 110)
    assert plc(profile=replace(PW10, scan_factor=Fraction(3, 2)), jitter=99).scan_under_link() == (1500, 149)


def test_the_image_is_the_latest_ends() -> None:
    tested = plc(sources={"D1": Counter(100), "M1000": Toggle(100)}, D1=500, D0=3)
    tested.run(0, traced=False)
    # Before the first END: the memory at RUN, whatever the sources say.
    assert words(tested.image_at(0)) == [3, 500, 0, 0]
    assert words(tested.image_at(PHASE - 1)) == [3, 500, 0, 0]
    # An END at the very tick counts.
    assert words(tested.image_at(PHASE)) == [3, 5, 0, 0]
    assert tested.image_at(PHASE)[0] == 1
    assert words(tested.image_at(PHASE + SCAN - 1)) == [3, 5, 0, 0]
    assert words(tested.image_at(PHASE + SCAN)) == [3, 16, 0, 0]
    assert tested.image_at(PHASE + SCAN)[0] == 0
    assert words(tested.image_at(PHASE + 100 * SCAN + 7)) == [3, (PHASE + 100 * SCAN) // 100, 0, 0]


@pytest.mark.parametrize("every", [1, 399, 1100, 5000, 77_777])
def test_the_image_is_the_same_however_often_it_is_asked_for(every: int) -> None:
    source = {"D0": Counter(every), "D2": Constant(9)}
    often, once = plc(sources=source), plc(sources=source)
    often.run(0, traced=False)
    once.run(0, traced=False)
    for tick in range(0, 90_000, 371):
        image = often.image_at(tick)
        end = PHASE + (tick - PHASE) // SCAN * SCAN
        assert words(image)[0] == (end // every % 65536 if tick >= PHASE else 0)
        assert words(image)[2] == (9 if tick >= PHASE else 0)
    assert once.image_at(tick) == image


def test_an_unchanged_image_is_the_same_object() -> None:
    tested = plc(sources={"D0": Counter(50_000)})
    tested.run(0, traced=False)
    image = tested.image_at(PHASE)
    assert tested.image_at(40_000) is image
    assert tested.image_at(60_000) is not image


def test_what_was_received_is_visible_from_the_next_end_on() -> None:
    tested = plc()
    asked: list[int] = []

    def received(since: int, end: int) -> Iterable[tuple[int, bytes]]:
        asked.append(end)
        assert since < end
        yield 0, b"\xff" * 12  # its own number: not for its memory
        yield 1, b"\x01\x00\x00\x80" + b"\x12\x34" * 4
        yield 2, b"\x01" * 24  # of another mode: no block of this link

    tested.received = received
    tested.run(0, traced=False)
    tested.sync(PHASE - 1)
    assert asked == []
    assert tested.read("D32") == 0
    tested.sync(PHASE + 3 * SCAN - 1)
    assert asked == [PHASE + 2 * SCAN]
    assert [tested.read(name) for name in ("D32", "D35", "D36", "M1064", "M1065", "M1095")] == [
        0x1234,
        0x1234,
        0,
        1,
        0,
        1,
    ]
    assert (tested.read("D0"), tested.read("M1000"), tested.read("D64"), tested.read("M1128")) == (0, 0, 0, 0)


def test_another_stations_block_is_overwritten_by_what_was_received() -> None:
    tested = plc(sources={"D32": Constant(5)})
    tested.received = lambda _, end: [(1, bytes(4) + b"\x00\x63" * 4)] if end > PHASE else []
    tested.run(0, traced=False)
    tested.sync(PHASE)
    assert tested.read("D32") == 5
    tested.sync(PHASE + SCAN)
    assert tested.read("D32") == 99


def test_a_slave_takes_nothing_before_it_knows_the_mode_and_keeps_what_is_latched_at_stop() -> None:
    tested = plc(1)
    tested.received = lambda *_: [(0, b"\1" + bytes(3) + b"\x00\x63" * 4)]
    engine, _ = tested.run(0, traced=False)
    assert isinstance(engine, Slave)
    tested.sync(PHASE)
    assert tested.read("D0") == 0
    tested.parameters(SETTINGS, PHASE)
    engine.stop(PHASE + 3)
    tested.stop(PHASE + 3)
    assert (tested.read("M1000"), tested.read("D0")) == (1, 0)
    assert tested.state is PlcState.STOP


def test_an_end_at_the_tick_of_stop_does_not_happen() -> None:
    tested = plc(sources={"D200": Counter(1)})
    tested.run(0, traced=False)
    tested.stop(PHASE + SCAN)
    assert tested.read("D200") == PHASE
    tested.run(10_000, traced=False)
    tested.stop(10_000 + PHASE + 1)
    assert tested.read("D200") == 10_000 + PHASE


@pytest.mark.parametrize(("profile", "word"), [("pw10", 64), ("fx2n", 20)])
def test_a_families_blocks_have_their_own_spacing(profile: str, word: int) -> None:
    tested = plc(2, profile=PROFILES[profile], sources={f"D{word + 1}": Constant(77)})
    tested.run(0, traced=False)
    tested.parameters(SETTINGS, 1)
    assert words(tested.image_at(PHASE)) == [0, 77, 0, 0]


def test_without_other_ports_no_end_needs_to_be_carried_out() -> None:
    tested = plc()
    tested.run(0, traced=False)
    assert tested.wanted_end(0) is None
    assert tested.longest_scan() == SCAN
    assert not ProgramPorts(tested.port_registers, tested.memory, "COM2").cpavl(
        Device("D", 0), Device("M", 0), 3
    )


def test_an_end_that_is_carried_out_changes_nothing_without_ports() -> None:
    source = {"D0": Counter(100)}
    tested, twin = plc(sources=source), plc(sources=source)
    tested.run(0, traced=False)
    twin.run(0, traced=False)
    for tick in range(PHASE, 40_000, SCAN):
        assert tested.end(tick) == {}
        assert tested.image_at(tick + 5) == twin.image_at(tick + 5)
        assert tested.read("D0") == tick // 100


def test_com2_has_station_1_unless_something_else_is_said() -> None:
    assert plc().read("D8121") == 1
    assert plc(D8121=7).read("D8121") == 7
