"""A scenario with ports and devices and without mistakes, to be changed in one place."""

from __future__ import annotations

PORTS = """\
schema: 1
name: ports
duration: 10 s
buses:
  - {name: link, nn: true}
  - {name: line}
  - {name: codes, format: 7E1}
plcs:
  - name: press1
    scan: 8 ms
    nn: {bus: link, port: COM4, station: 0, slaves: 1}
    ports:
      COM3: {bus: line, protocol: modbus-rtu-master}
      COM5: {bus: codes, protocol: free}
    polls:
      - {port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400}
      - {port: COM5, to: D300, count: 20}
  - name: press2
    scan: 5 ms
    nn: {bus: link, port: COM4, station: 1}
    ports:
      COM3: {bus: line, protocol: modbus-rtu-slave, station: 2}
devices:
  - {name: drive, model: stepper, bus: line, station: 1}
  - {name: reader, model: free, bus: codes, says: [{text: "A", every: 1 s}]}
"""

#: Parts of it, to be replaced.
MASTER = "COM3: {bus: line, protocol: modbus-rtu-master}"
SLAVE = "COM3: {bus: line, protocol: modbus-rtu-slave, station: 2}"
FREE_PORT = "COM5: {bus: codes, protocol: free}"
POLL = "{port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400}"
FREE_POLL = "{port: COM5, to: D300, count: 20}"
DRIVE = "{name: drive, model: stepper, bus: line, station: 1}"


def changed(*changes: tuple[str, str]) -> str:
    """The sample with some of its text replaced, each once."""
    text = PORTS
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def more(text: str) -> str:
    """The sample with lines after its last (a device, noise, faults)."""
    return PORTS + text


#: A scenario with every kind of port, poll and device, and most of their keys.
FULL_PORTS = """\
schema: 1
name: three presses and a feeder
duration: 60 s
seed: 7
buses:
  - {name: link, nn: true}
  - {name: feeder, baud: 9600, format: 8N1}
  - {name: panel, baud: 19200, format: 8E1}
  - {name: codes, baud: 9600, format: 7E1}
plcs:
  - name: press1
    profile: pw10
    scan: {mean: 8 ms, jitter: 1 ms}
    nn: {bus: link, port: COM4, station: 0, slaves: 2, mode: 2, retries: 5, timeout: 50 ms}
    ports:
      COM2: {bus: panel, protocol: modbus-rtu-slave, station: 3}
      COM3: {bus: feeder, protocol: modbus-rtu-master, timeout: 100 ms, interval: 5 ms}
      COM5: {bus: codes, protocol: free, start: 0x02, end: "\\r", eight_bit: true, cpavl: {words: D7000}}
    polls:
      - {port: COM3, station: 1, function: 3, address: 0x16, count: 2, to: D400, every: 200 ms, retries: 1}
      - {name: go, port: COM3, station: 1, function: 5, address: 7, values: [1], at: 1 s, times: 1}
      - {port: COM3, station: 2, function: 0x10, address: 10, from: D500, count: 4, every: 1 s}
      - {port: COM3, station: 2, function: 0x01, address: 10, to: M100, count: 4, every: 1 s}
      - {port: COM5, to: D300, count: 20}
  - {name: press2, profile: pw10, scan: 5 ms, nn: {bus: link, port: COM4, station: 1}}
  - {name: press3, profile: pw10, scan: 12 ms, registers: {D8176: 2, M8179: 1, D100: 0x81, D101: 2, D106: 2}, ports: {COM4: {bus: link}, COM3: {bus: feeder, cpavl: {words: D100, bits: M100}}}}
devices:
  - {name: feeder1, model: stepper, bus: feeder, station: 1, registers: {pitch: 500, acceleration: 2000}, switches: [{input: 1, low: -5}], profile: {acceleration_unit: 2.5}}
  - {name: oven, model: v80, bus: feeder, station: 4, mode: ascii, coils: {127: 1, 00128: 0}, registers: {40108: 0x63}, delay: 5 ms, jitter: 2 ms}
  - {name: press9, model: lx, bus: feeder, station: 5, scan: {mean: 5 ms, jitter: 1 ms}, registers: {D5: -1, M3: 1}}
  - name: sensors
    model: map
    bus: feeder
    station: 6
    functions: [3, 4, 6, 16]
    registers:
      - {address: 0, value: 5, count: 3, writable: true, low: 0, high: 9}
      - {address: 10, ramp: {from: 0, to: 1000, over: 10 s, repeat: true}, name: level}
      - {address: 20, noise: {center: 100, spread: 5, every: 1 s}, words: 2, high_first: true}
    input_registers: [{address: 0, count: 100}]
  - name: hmi1
    model: hmi
    bus: panel
    timeout: 500 ms
    polls:
      - {station: 3, function: 3, address: 0, count: 10, every: 300 ms}
  - name: scanner
    model: free
    bus: codes
    says:
      - {text: "\\x024006381333931\\r", every: 2 s, jitter: 100 ms, at: 500 ms}
      - {bytes: "02 41 0D", reply_to: "?", delay: 10 ms}
noise:
  - {bus: link, ber: 1.0e-6}
  - {bus: feeder, ber: 1.0e-6}
  - {bus: feeder, station: press1, ber: 1.0e-6}
  - {bus: feeder, station: feeder1, reply_loss: 0.1}
faults:
  - {at: 10 s, for: 5 s, power_off: feeder1}
  - {at: 30 s, count: 3, drop_reply: press1.COM2}
  - {slow: {station: feeder1, extra: 3 ms}}
  - {jabber: press1.COM4}
  - {cable_cut: {bus: feeder, after: press1}}
  - {wrong_format: {station: sensors, baud: 19200}}
  - {flip_bits: {station: feeder1, bits: [62, 31], frame: response}}
  - {insert_char: {station: press1.COM3, value: 200}}
  - {power_on: {press2: 4 s, oven: 1 s}}
"""
