"""A served Modbus slave on a pseudo-terminal: transactions a second, and its response beyond the silence.

    python tests/benchmarks/bench_slave.py [transactions]

One master asks for ten registers at 115200 8N1, again and again, without a pause. The bar: 300
transactions a second, and a median of less than 1 ms beyond the 1.75 ms of silence that end a request.
"""

from __future__ import annotations

import os
import select
import statistics
import sys
import time

from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.line.characters import CharFormat
from bussim.live.served import ServedSlave

SILENCE = 1.75e-3
REQUEST = encode_adu(Mode.RTU, 1, bytes((3, 0, 0, 0, 10))).chars
RESPONSE = 25


def main(count: int) -> int:
    """Measure and print; returns 1 where the bar is missed."""
    times = []
    with ServedSlave(fmt=CharFormat(8, "N", 1)) as slave:
        end = os.open(slave.device, os.O_RDWR | os.O_NOCTTY)
        begun = time.perf_counter()
        for _ in range(count):
            asked = time.perf_counter()
            os.write(end, REQUEST)
            got = 0
            while got < RESPONSE:
                if not select.select((end,), (), (), 5)[0]:
                    print("no response within 5 s")
                    return 1
                got += len(os.read(end, 256))
            times.append(time.perf_counter() - asked)
        total = time.perf_counter() - begun
        os.close(end)
    rate, beyond = count / total, statistics.median(times) - SILENCE
    p99 = sorted(times)[count * 99 // 100] - SILENCE
    print(f"{rate:.0f} transactions a second (bar: 300)")
    print(f"response {1000 * beyond:.3f} ms beyond the silence, median (bar: 1 ms); p99 {1000 * p99:.3f} ms")
    return 0 if rate >= 300 and beyond < 1e-3 else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000))
