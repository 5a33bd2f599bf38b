"""The bytes of a pcapng file, block by block, without Wireshark."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from ipaddress import IPv4Address
from pathlib import Path

import pytest

from bussim.export.formats import export_trace
from bussim.export.packets import how_to_open, script
from bussim.export.selection import Selection, survey
from bussim.units import nanoseconds
from tests.export.samples import FEEDER, GATE, LINK, OVEN, exchanges, exported, frame, link_frames, trace

Block = tuple[int, bytes]


def blocks(path: Path) -> Iterator[Block]:
    data, at = path.read_bytes(), 0
    while at < len(data):
        kind, size = struct.unpack_from("<II", data, at)
        assert size % 4 == 0
        assert struct.unpack_from("<I", data, at + size - 4)[0] == size
        yield kind, data[at + 8 : at + size - 4]
        at += size
    assert at == len(data)


def options(data: bytes) -> dict[int, bytes]:
    found, at = {}, 0
    while at < len(data):
        code, size = struct.unpack_from("<HH", data, at)
        if code == 0:
            break
        assert code not in found
        found[code] = data[at + 4 : at + 4 + size]
        at += 4 + size + -size % 4
    return found


def packets(path: Path) -> list[tuple[int, int, bytes, dict[int, bytes]]]:
    """Interface, nanoseconds, data and options of every packet."""
    found = []
    for kind, body in blocks(path):
        if kind == 6:
            number, high, low, size, whole = struct.unpack_from("<IIIII", body)
            assert size == whole
            rest = body[20 + size + -size % 4 :]
            found.append((number, high << 32 | low, body[20 : 20 + size], options(rest)))
    return found


def interfaces(path: Path) -> list[tuple[int, dict[int, bytes]]]:
    return [
        (struct.unpack_from("<H", body)[0], options(body[8:])) for kind, body in blocks(path) if kind == 1
    ]


def test_a_bus_is_an_interface_and_a_frame_a_packet(tmp_path: Path) -> None:
    rtu = [each for one in exchanges(20) for each in one.frames]
    link = link_frames(50)
    frames = sorted(rtu + link, key=lambda each: each.end)
    path = exported(trace(*frames, buses=(LINK, OVEN)), tmp_path / "a.pcapng", "pcapng")
    (first, head), *_ = blocks(path)
    assert (first, head[:4]) == (0x0A0D0D0A, struct.pack("<I", 0x1A2B3C4D))
    assert options(head[16:])[1] == b"three presses, seed 7"
    assert options(head[16:])[4].startswith(b"bussim ")
    (nn, nn_said), (oven, oven_said) = interfaces(path)
    assert (nn, oven) == (148, 147)
    assert (nn_said[2], oven_said[2]) == (b"link", b"oven")
    assert nn_said[9] == oven_said[9] == b"\x09"
    assert struct.unpack("<Q", oven_said[8]) == (19200,)
    assert oven_said[3] == b"Modbus RTU, 19200 8E1: press2.COM5, oven1"
    expected = [
        (0 if each.bus == "link" else 1, nanoseconds(each.start), each.chars, {})
        for each in sorted(frames, key=lambda each: each.start)
    ]
    assert packets(path) == expected


def test_damage_is_a_comment_and_a_flag(tmp_path: Path) -> None:
    frames = [
        frame(LINK, 0, "press1", b"\x0511A2", damaged=(28,)),
        frame(LINK, 200_000, "press1", b"\x0511A2", damaged_at={"press2": (3,)}),
        frame(LINK, 400_000, "press3", b"abc", kind="jabber"),
        frame(LINK, 600_000, "press1", b"\x0511A2"),
    ]
    path = exported(trace(*frames), tmp_path / "a.pcapng", "pcapng")
    hit, private, jabber, clean = packets(path)
    # The parity of the third character was wrong: its bit 7 says so.
    assert hit[2] == b"\x051\xb1A2"
    assert hit[3][1] == b"press1: bit 28 inverted on the wire; parity error in character 3"
    assert struct.unpack("<I", hit[3][2]) == (1 << 31,)
    assert (private[2], private[3]) == (b"\x0511A2", {1: b"press1: bit 3 inverted at press2 only"})
    assert jabber[3] == {1: b"press3: jabber"}
    assert clean[2:] == (b"\x0511A2", {})


def test_rtu_characters_of_eight_bits_are_not_marked(tmp_path: Path) -> None:
    one = frame(OVEN, 0, "oven1", b"\x02\x03", damaged=(9,))
    (packet,) = packets(exported(trace(one, buses=(OVEN,)), tmp_path / "a.pcapng", "pcapng"))
    assert packet[2] == b"\x02\x03"
    assert b"parity error in character 1" in packet[3][1]


def test_a_bus_with_two_protocols_is_two_interfaces(tmp_path: Path) -> None:
    frames = [
        frame(GATE, 0, "sorter.COM3", b"\x01", protocol="free"),
        frame(GATE, 100_000, "reader1", b"\x02", protocol="modbus-rtu"),
    ]
    path = exported(trace(*frames, buses=(GATE,)), tmp_path / "a.pcapng", "pcapng")
    assert [(kind, said[2]) for kind, said in interfaces(path)] == [
        (150, b"gate (free)"),
        (147, b"gate (modbus-rtu)"),
    ]
    assert [packet[0] for packet in packets(path)] == [0, 1]


def test_a_quiet_bus_is_an_interface_too(tmp_path: Path) -> None:
    path = exported(trace(*link_frames(3), buses=(LINK, FEEDER)), tmp_path / "a.pcapng", "pcapng")
    assert [(kind, said[2]) for kind, said in interfaces(path)] == [(148, b"link"), (147, b"feeder")]


def test_udp_names_the_master_and_the_slave(tmp_path: Path) -> None:
    done = exchanges(40, bus=FEEDER)
    frames = [each for one in done for each in one.frames]
    path = exported(
        trace(*frames, buses=(LINK, FEEDER)), tmp_path / "a.pcapng", "pcapng", encapsulation="udp"
    )
    assert [kind for kind, _ in interfaces(path)] == [148, 1]
    addresses = []
    for one, (_, _, data, _) in zip(frames, packets(path), strict=True):
        assert data[12:14] == b"\x08\x00"
        head = data[14:34]
        assert sum(struct.unpack(">10H", head)) % 0xFFFF == 0  # the header's own checksum
        assert struct.unpack_from(">H", head, 2)[0] == len(data) - 14
        source, target, size, _ = struct.unpack_from(">HHHH", data, 34)
        assert size == len(one.chars) + 8
        assert data[42:] == one.chars
        assert (target if one.kind == "request" else source) == 5020
        addresses.append((str(IPv4Address(head[12:16])), str(IPv4Address(head[16:20])), data[:6]))
    for one, (source, target, mac) in zip(frames, addresses, strict=True):
        if one.kind == "response":
            assert (source, target) == ("10.2.1.17", "10.2.0.1")
        elif one.station == 0:
            assert (source, target, mac) == ("10.2.0.1", "10.2.255.255", b"\xff" * 6)
        else:
            assert (source, target) == ("10.2.0.1", "10.2.1.17")
    (names,) = [body for kind, body in blocks(path) if kind == 4]
    assert bytes((10, 2, 0, 1)) + b"press1.COM3\0" in names
    assert bytes((10, 2, 1, 17)) + b"feeder1\0" in names


def test_a_long_remark_is_cut_to_what_the_format_takes(tmp_path: Path) -> None:
    nodes = {f"{number:05}" * 20: (1,) for number in range(1000)}
    one = frame(LINK, 0, "press1", b"\x0511A2", damaged_at=nodes)
    (packet,) = packets(exported(trace(one), tmp_path / "a.pcapng", "pcapng"))
    assert len(packet[3][1]) == 65_535


@pytest.mark.parametrize(
    ("encapsulation", "expected"),
    [
        (
            "serial",
            """-o 'uat:user_dlts:"User 0 (DLT=147)","mbrtu","0","","0",""' -o mbrtu.crc_verification:TRUE""",
        ),
        ("udp", "-o mbrtu.udp.port:5020 -o mbrtu.crc_verification:TRUE"),
    ],
)
def test_the_options_that_wireshark_needs(tmp_path: Path, encapsulation: str, expected: str) -> None:
    frames = [each for one in exchanges(2) for each in one.frames] + link_frames(2)
    found = survey(Selection(trace(*frames, buses=(LINK, OVEN))))
    (hint,) = how_to_open(found, encapsulation)
    assert hint == f"Wireshark or tshark needs: {expected} -X lua_script:{script('nn.lua')}"
    assert script("nn.lua").is_file()
    done = export_trace(
        trace(*frames, buses=(LINK, OVEN)), tmp_path / "a.pcapng", "pcapng", encapsulation=encapsulation
    )
    assert done.hints == (hint,)
