from __future__ import annotations

from typing import Any

from bussim.results.text.ports import port_lines
from tests.results.fakes import Fake, Feeder
from tests.results.text.test_run import shown

RUN = Feeder().run()


def lines(summary: dict[str, Any]) -> list[str]:
    return [" ".join(line.split()) for line in port_lines(summary)]


def test_the_numbers_are_those_of_the_summary() -> None:
    text, port = lines(RUN.summary), RUN.summary["ports"]["press1.COM3"]
    others, response, cycle = port["other_errors"], port["response_ms"], port["cycle_ms"]
    start = text.index("press1.COM3: modbus-rtu-master on feeder, timeout 100 ms")
    age = port["polls"]["position"]["age_ms"]
    assert text[start + 1 : start + 7] == [
        (f"transactions {port['transactions']:,}: {port['ok']:,} ok, {port['answered_with_own_data']:,} with own data, "
        f"{port['exceptions']['02']} exception 02 (illegal address), "
        f"{port['timeouts']} no response in time, {port['crc_errors']} CRC or LRC, {others['framing']} framing; "
        f"{port['mismatched_responses']} responses taken that belonged to another request"),
        f"response median {response['p50']:.3f}, p99 {response['p99']:.3f}, max {response['max']:.3f} ms",
        f"poll cycle median {cycle['p50']:.3f}, max {cycle['max']:.3f} ms, {cycle['count']} cycles",
        (f"poll position {cycle['count']} turns, 0 failed; "
        f"response median {port['polls']['position']['response_ms']['p50']:.3f}, "
        f"max {port['polls']['position']['response_ms']['max']:.3f} ms; "
        f"data up to {age['open']:.3f} ms old, still so at the end"),
        (f"poll speed {cycle['count']} turns, 0 failed; "
        f"response median {port['polls']['speed']['response_ms']['p50']:.3f}, "
        f"max {port['polls']['speed']['response_ms']['max']:.3f} ms"),
        (f"port errors yy of D8063 = 7xyy: 03 {port['errors']['03']}× (CRC or LRC), 08 "
        f"{port['errors']['08']}× (framing), 09 {port['errors']['09']}× (no response in time)"),
    ]  # fmt: skip


def test_slaves_free_ports_and_devices() -> None:
    text = lines(RUN.summary)
    free = RUN.summary["ports"]["press2.COM3"]
    for line in (
        "feeder: 9600 8N1, bus load 25.0%, 2,454 frames, 1 undetected damaged frame",
        "press1.COM5: modbus-rtu-slave, station 4 on hmi",
        "requests 30, 29 answered, 1 exception 03 (illegal value), ignored: CRC or LRC wrong 2×",
        "press2.COM3: free on scan",
        (f"messages 0 sent (0 bytes), {free['received']} received ({3 * free['received']:,} bytes), "
        f"{free['timeouts']} ended by timeout, {free['damaged']} damaged characters"),
        "press2.COM5: no protocol on hmi",
        "feeder1: stepper, station 1 on feeder",
        "at the end position 20000",
        "panel: hmi on hmi, timeout 500 ms",
        "transactions 0: 0 ok",
    ):  # fmt: skip
        assert line in text, line
    assert not any("None" in line for line in text)


def test_old_data_that_were_replaced_are_not_said_to_be_there_still() -> None:
    summary = Feeder().run().summary
    age = summary["ports"]["press1.COM3"]["polls"]["position"]["age_ms"]
    age |= {"open": 1.0, "oldest": age["before_refresh"]["max"]}
    (line,) = [line for line in lines(summary) if line.startswith("poll position")]
    assert line.endswith(f"data up to {age['before_refresh']['max']:.3f} ms old")
    del age["oldest"]  # as in a folder of an earlier version
    assert line in lines(summary)


def test_many_polls_are_cut() -> None:
    summary = Feeder().run().summary
    polls = summary["ports"]["press1.COM3"]["polls"]
    polls.update({f"p{number}": polls["speed"] for number in range(20)})
    text = lines(summary)
    assert sum(line.startswith("poll ") for line in text) == 13  # 12 polls and the cycle
    assert "and 10 more polls, in summary.json" in text


def test_it_is_part_of_what_run_prints_and_a_plain_link_has_none() -> None:
    assert "\n\npress1.COM3: modbus-rtu-master on feeder" in shown(RUN)
    plain = Fake().run()
    assert list(port_lines(plain.summary)) == []
