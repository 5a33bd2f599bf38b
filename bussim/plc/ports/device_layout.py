"""Where a transaction's values lie in device memory: registers in D, coils in M, S, Y or packed in D."""

from collections.abc import Sequence
from functools import lru_cache

from bussim.engines.modbus.pdu import WRITES
from bussim.engines.modbus.server import SPACES
from bussim.plc.memory import BIT_RANGES, WORD_RANGES, Device, Memory

_WORD_BITS = 16
#: Bit devices that hold coils: X only as a source, since nothing but its input writes it.
_COILS = frozenset("MSY")


@lru_cache(maxsize=1024)
def is_bits(function: int) -> bool:
    """Whether a function (one of the known) carries coils rather than registers."""
    return SPACES[function].is_bit


@lru_cache(maxsize=1024)
def fits(device: Device, function: int, count: int) -> bool:
    """Whether ``count`` items of a function lie in memory from a device on."""
    bits = is_bits(function)
    if device.is_word:
        words = -(-count // _WORD_BITS) if bits else count
        return words_fit(device, words)
    if not bits or not (device.letter in _COILS or (device.letter == "X" and function in WRITES)):
        return False
    first, last = device.address, device.address + count - 1
    return any(low <= first and last <= high for low, high in BIT_RANGES[device.letter])


def taken(device: Device, function: int, count: int) -> set[Device]:
    """The devices that ``count`` items of a function take up in memory."""
    number = -(-count // _WORD_BITS) if device.is_word and is_bits(function) else count
    return {Device(device.letter, device.address + index) for index in range(number)}


def words_fit(device: Device, count: int) -> bool:
    """Whether ``count`` words lie in memory from a D register on."""
    low, high = WORD_RANGES["D"][0]
    return device.is_word and low <= device.address and device.address + count - 1 <= high


def fetch_words(memory: Memory, device: Device, count: int) -> list[int]:
    """``count`` D registers, which must fit."""
    return [memory.word("D", address) for address in range(device.address, device.address + count)]


def store_words(memory: Memory, device: Device, words: Sequence[int]) -> None:
    """Write D registers, which must fit."""
    for address, word in enumerate(words, device.address):
        memory.set_word("D", address, word)


def fetch(memory: Memory, device: Device, function: int, count: int) -> list[int]:
    """The values that a write takes: one an item, from where it :func:`fits`."""
    if not is_bits(function):
        return fetch_words(memory, device, count)
    if device.is_word:
        words = fetch_words(memory, device, -(-count // _WORD_BITS))
        return [words[number // _WORD_BITS] >> number % _WORD_BITS & 1 for number in range(count)]
    return [memory.get(Device(device.letter, device.address + number)) for number in range(count)]


def store(memory: Memory, device: Device, function: int, values: Sequence[int]) -> None:
    """Write the values of a read (or those that a write will take) to where they :func:`fits`.

    Coils in D registers: sixteen a word, the lowest in bit 0, what is left of the last word 0 (assumed).
    """
    if not is_bits(function):
        store_words(memory, device, values)
    elif device.is_word:
        words = [0] * -(-len(values) // _WORD_BITS)
        for number, bit in enumerate(values):
            words[number // _WORD_BITS] |= (1 if bit else 0) << number % _WORD_BITS
        store_words(memory, device, words)
    else:
        for number, bit in enumerate(values):
            memory.set(Device(device.letter, device.address + number), bit)
