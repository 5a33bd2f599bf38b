"""Adapters that receive what they send, in front of what is served without ``--echo``."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator

import pytest

from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.engines.nn.frames import LinkSettings, encode_parameters, encode_poll
from bussim.line.characters import CharFormat
from bussim.live.served import ServedSlave
from tests.serve.serving import LENIENT, PATIENCE, SLAVES, Serving

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
if sys.platform != "win32":
    from tests.live.peers import TerminalPair
    from tests.serve.test_bad_input import LINK, opened
    from tests.serve.test_wires import receive

READ, READ_COILS, WRITE = bytes((3, 0, 0, 0, 1)), bytes((1, 0, 0, 0, 24)), bytes((6, 0, 7, 0, 9))
#: Of 24 coils, which has the form of a request of three.
COILS = bytes((1, 3, 0, 0, 0))
NODES = {Mode.RTU: "v80", Mode.ASCII: "ascii"}
both_modes = pytest.mark.parametrize("mode", list(Mode))


@pytest.fixture
def pair() -> Iterator[TerminalPair]:
    with TerminalPair(echo=True) as ends:
        yield ends


def said(serving: Serving) -> list[str]:
    return [text for text in serving.reported if "--echo" in text]


@both_modes
@pytest.mark.parametrize(("request_", "response"), [(READ, bytes((3, 2, 0, 0))), (READ_COILS, COILS)])
def test_a_read_is_answered_once(mode: Mode, request_: bytes, response: bytes, pair: TerminalPair) -> None:
    asked, wanted = (encode_adu(mode, 1, pdu).chars for pdu in (request_, response))
    with Serving(SLAVES, ports=(f"{NODES[mode]}={pair.left}",)) as serving, opened(pair.right) as handle:
        for _ in range(3):
            os.write(handle, asked)
            assert receive(handle, len(wanted)) == wanted
            time.sleep(0.02)
        serving.wait_for(lambda: said(serving))
    (device,) = [one for one in serving.totals().devices if one.requests]
    assert (device.requests, device.answered, device.rejected) == (3, 3, {})
    assert pair.carried[0] == 3 * wanted
    assert len(said(serving)) == 1
    assert said(serving)[0] in serving.totals().warnings


@both_modes
def test_a_write_is_not_answered_for_ever(mode: Mode, pair: TerminalPair) -> None:
    """Its response equals a request: ten of them in a row are the adapter's."""
    asked = encode_adu(mode, 1, WRITE).chars
    with Serving(SLAVES, ports=(f"{NODES[mode]}={pair.left}",)) as serving, opened(pair.right) as handle:
        os.write(handle, asked)
        serving.wait_for(lambda: said(serving))
        before = len(pair.carried[0])
        os.write(handle, asked)
        serving.wait_for(lambda: len(pair.carried[0]) > before)
        time.sleep(0.05)
    assert pair.carried[0] == asked * 11
    assert sum(device.answered for device in serving.totals().devices) == 11


@both_modes
def test_a_served_slave_of_its_own_is_not_answered_for_ever(mode: Mode, pair: TerminalPair) -> None:
    asked, until = encode_adu(mode, 1, WRITE).chars, time.monotonic() + PATIENCE
    served = ServedSlave(pair.left, mode=mode, fmt=CharFormat(8, "N", 1), options=LENIENT)
    with served as slave, opened(pair.right) as handle:
        for answers in (10, 11):
            os.write(handle, asked)
            while len(pair.carried[0]) < answers * len(asked) and time.monotonic() < until:
                time.sleep(0.01)
        time.sleep(0.05)
    assert pair.carried[0] == asked * 11
    assert any("--echo" in text for text in slave.reports)


def test_a_link_is_told_of_its_echo(pair: TerminalPair) -> None:
    frames = encode_parameters(0, LinkSettings(1, 1, 3, 225)).chars, encode_poll(1, 3).chars
    with Serving(LINK, ports=(f"feeder={pair.left}",)) as serving, opened(pair.right) as handle:
        os.write(handle, frames[0])
        time.sleep(0.05)
        os.write(handle, frames[1])
        serving.wait_for(lambda: said(serving))
    assert len(pair.carried[0]) > 0


@both_modes
def test_a_master_that_repeats_a_write_is_answered_each_time(mode: Mode) -> None:
    """A program at the other end of a pseudo-terminal returns nothing, however alike its requests are."""
    asked = encode_adu(mode, 1, WRITE).chars
    with Serving(SLAVES, NODES[mode]) as serving, opened(serving.device) as handle:
        for _ in range(30):
            os.write(handle, asked)
            assert receive(handle, len(asked)) == asked
    assert said(serving) == []


@both_modes
def test_a_master_that_writes_and_reads_is_answered_each_time(mode: Mode) -> None:
    """Over a port that may be an adapter's; nine alike in a row are no echo."""
    requests = [encode_adu(mode, 1, pdu).chars for pdu in (*[WRITE] * 9, READ)]
    lengths = [*[len(requests[0])] * 9, len(encode_adu(mode, 1, bytes((3, 2, 0, 0))).chars)]
    with TerminalPair() as ends:
        with Serving(SLAVES, ports=(f"{NODES[mode]}={ends.left}",)) as serving, opened(ends.right) as handle:
            for _ in range(4):
                for asked, length in zip(requests, lengths, strict=True):
                    os.write(handle, asked)
                    assert len(receive(handle, length)) == length
        assert said(serving) == []
