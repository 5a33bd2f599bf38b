from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.plc.memory import BlockRange, Device, Family, Memory, block_range, parse_device


@pytest.mark.parametrize(
    ("name", "device"),
    [
        ("D0", Device("D", 0)),
        ("D8201", Device("D", 8201)),
        ("M1064", Device("M", 1064)),
        ("M8191", Device("M", 8191)),
        ("X10", Device("X", 8)),
        ("Y377", Device("Y", 255)),
        ("S999", Device("S", 999)),
        ("T255", Device("T", 255)),
        ("C200", Device("C", 200)),
    ],
)
def test_names(name: str, device: Device) -> None:
    assert parse_device(name) == device
    assert str(device) == name


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("D8256", "D0–D8255"),
        ("M3072", "M8000–M8255"),
        ("M7999", "M0–M3071"),
        ("X8", "octal (no 8 or 9); point 8 of X is X10"),
        ("X9", "point 9 of X is X11"),
        ("DO", "did you mean D0?"),
        (" m 12", "did you mean M12?"),
        ("TS3", "did you mean T3?"),
        ("TN3", "can only be observed"),
        ("V0", "can only be observed"),
        ("Y400", "Y0–Y377"),
        ("T256", "T0–T255"),
        ("Q1", "X Y M S T C D"),
        ("ſ0", "not a device"),
        ("D", "not a device"),
        ("D-1", "not a device"),
        ("D１", "not a device"),
    ],
)
def test_bad_names_say_what_is_allowed(name: str, says: str) -> None:
    with pytest.raises(ValueError, match="is ") as caught:
        parse_device(name, family=Family.FX2N)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("name", "device", "width"),
    [
        ("TN255", Device("TN", 255), 16),
        ("CN199", Device("CN", 199), 16),
        ("CN200", Device("CN", 200), 32),
        ("V7", Device("V", 7), 16),
        ("Z0", Device("Z", 0), 16),
        ("D5", Device("D", 5), 16),
        ("T5", Device("T", 5), 1),
        ("C200", Device("C", 200), 1),
    ],
)
def test_what_can_be_observed(name: str, device: Device, width: int) -> None:
    assert parse_device(name, observed=True) == device
    assert (str(device), device.width, device.is_word) == (name, width, width > 1)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("V8", "V0–V7"),
        ("TN256", "TN0–TN255"),
        ("tnI5", "did you mean TN15?"),
        ("CNO", "did you mean CN0?"),
        ("CS4", "did you mean C4?"),
        ("V", "X Y M S T C D TN CN V Z"),
    ],
)
def test_what_cannot_be_observed(name: str, says: str) -> None:
    with pytest.raises(ValueError, match="is ") as caught:
        parse_device(name, observed=True, family=Family.FX2N)
    assert says in str(caught.value)


#: FX3 programming manual (JY997D16601), chapter 4: the last of each.
@pytest.mark.parametrize("last", ["M7679", "M8511", "S4095", "T511", "TN511", "D8511", "R32767"])
def test_what_only_an_fx3u_has(last: str) -> None:
    device = parse_device(last, observed=True)
    assert str(device) == last
    with pytest.raises(ValueError, match="that only an FX3U has"):
        parse_device(last, observed=True, family=Family.FX2N)
    with pytest.raises(ValueError, match=f"allowed .*{last}"):
        parse_device(str(device._replace(address=device.address + 1)), observed=True)


def test_current_values_and_index_registers_by_name() -> None:
    memory = Memory()
    memory.set_word("T", 3, 7)
    memory.set_word("C", 200, 1 << 31)
    memory.words("V")[2] = 9
    names = ("TN3", "CN200", "V2", "T3", "Z2")
    assert [memory.get(parse_device(name, observed=True)) for name in names] == [7, 1 << 31, 9, 0, 0]
    memory.set(Device("CN", 200), -1)
    memory.set(Device("TN", 3), -1)
    assert (memory.word("C", 200), memory.word("T", 3)) == ((1 << 32) - 1, 0xFFFF)


@given(st.sampled_from("XYMST"), st.integers(0, 255), st.integers(-5, 70_000))
def test_a_bit_is_zero_or_one(letter: str, address: int, value: int) -> None:
    memory = Memory()
    memory.set(Device(letter, address), value)
    assert memory.get(Device(letter, address)) == (1 if value else 0)


@given(st.integers(0, 8255), st.integers(-40_000, 70_000))
def test_a_word_keeps_its_low_16_bits(address: int, value: int) -> None:
    memory = Memory()
    memory.set(Device("D", address), value)
    assert memory.get(Device("D", address)) == memory.word("D", address) == value % 65536


def test_long_counters_have_32_bits_and_t_and_c_have_a_contact_beside_the_value() -> None:
    memory = Memory()
    memory.set_word("C", 199, 0x12345)
    memory.set_word("C", 200, 0x1_2345_6789)
    memory.set_word("T", 7, -1)
    assert memory.word("C", 199) == 0x2345
    assert memory.word("C", 200) == 0x2345_6789
    assert memory.word("T", 7) == 0xFFFF
    assert memory.get(Device("T", 7)) == 0
    memory.set(Device("C", 200), 1)
    assert memory.get(Device("C", 200)) == 1
    assert memory.word("C", 200) == 0x2345_6789


PLACES = st.builds(
    block_range,
    station=st.integers(0, 7),
    bits=st.sampled_from([0, 32, 64]),
    words=st.sampled_from([4, 8, 16, 32]),
    spacing=st.sampled_from([10, 32]),
)


@given(PLACES, st.data())
def test_an_image_is_what_its_layout_says_and_comes_back(block: BlockRange, draw: st.DataObject) -> None:
    memory = Memory()
    bits = draw.draw(st.lists(st.integers(0, 1), min_size=block.bits, max_size=block.bits))
    words = draw.draw(st.lists(st.integers(0, 65535), min_size=block.words, max_size=block.words))
    for number, bit in enumerate(bits):
        memory.set(Device("M", block.bit + number), bit)
    for number, word in enumerate(words):
        memory.set(Device("D", block.word + number), word)
    image = memory.block_image(block)
    # Eight points a byte, the lowest in bit 0; a word's high byte first.
    expected = [sum(bit << at for at, bit in enumerate(bits[n : n + 8])) for n in range(0, block.bits, 8)]
    for word in words:
        expected += [word // 256, word % 256]
    assert list(image) == expected
    other = Memory()
    other.store_block(block, image)
    assert other.block_image(block) == image
    assert [other.get(Device("M", block.bit + n)) for n in range(block.bits)] == bits
    assert [other.get(Device("D", block.word + n)) for n in range(block.words)] == words


@given(PLACES)
def test_storing_touches_nothing_beside_the_block(block: BlockRange) -> None:
    memory = Memory()
    memory.store_block(block, b"\xff" * (block.bits // 8 + 2 * block.words))
    points = [n for n in range(3072) if memory.get(Device("M", n))]
    words = [n for n in range(8256) if memory.get(Device("D", n))]
    assert points == list(range(block.bit, block.bit + block.bits))
    assert words == list(range(block.word, block.word + block.words))


@pytest.mark.parametrize(
    ("station", "spacing", "bit", "word"),
    [(0, 32, 1000, 0), (1, 32, 1064, 32), (3, 32, 1192, 96), (7, 32, 1448, 224), (7, 10, 1448, 70)],
)
def test_blocks_lie_where_the_manual_says(station: int, spacing: int, bit: int, word: int) -> None:
    assert block_range(station, 64, 8, spacing) == BlockRange(bit, 64, word, 8)
