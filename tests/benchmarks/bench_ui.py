"""How soon the page of `bussim ui` answers, by a headless Chromium at a real server.

    python tests/benchmarks/bench_ui.py [--quick]

Times are of this machine at this moment; nothing here is a test's verdict.
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tests.report.browser import chromium
from tests.ui.window import Seen, server

#: Lines by name: what is set beside the example of four stations, the sliders that are moved.
LINES: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "noise unknown, 4 stations": ({}, ("stations", "retries", "timeout", "scan")),
    "ber 1e-5, 4 stations": ({"ber": -5}, ("stations", "retries", "timeout", "scan", "ber")),
    "ber 1e-4, 8 stations, 9 retries": ({"ber": -4, "stations": 8, "retries": 9}, ("retries", "ber")),
    "ber 1e-3, 8 stations, 9 retries": ({"ber": -3, "stations": 8, "retries": 9}, ("retries",)),
    "bursts, 8 stations, 9 retries": ({"burst": -2, "stations": 8, "retries": 9}, ("retries",)),
}
#: From a slider's event until the distribution is drawn and the tiles are of it, in ms.
REDRAWN = """const done = arguments[3], root = document.documentElement, input = document.getElementById(arguments[0]);
const count = arguments[2], all = [];
const once = (left) => {
  if (!left) { done(all); return; }
  const begun = performance.now(), before = Number(root.dataset.drawn), step = Number(input.step) || 1;
  const value = Number(input.value), most = Number(input.max);
  input.value = String(left % 2 ? Math.min(value + step, most) : value - step);
  input.dispatchEvent(new Event('input'));
  const look = () => {
    if (Number(root.dataset.drawn) > before) { all.push(performance.now() - begun); setTimeout(() => once(left - 1), 400); }
    else setTimeout(look, 1);
  };
  look();
};
once(count);"""
#: 60 moves at 30 Hz: redraws a second, and how late the last one is drawn (ms).
DRAG = """const done = arguments[0], root = document.documentElement, input = document.getElementById('retries');
let move = 0, redraws = 0, seen = root.dataset.drawn;
const watch = new MutationObserver(() => { if (root.dataset.drawn !== seen) { seen = root.dataset.drawn; redraws += 1; } });
watch.observe(root, { attributes: true });
const begun = performance.now();
const timer = setInterval(() => {
  input.value = String(move % 2 ? 8 : 9);
  input.dispatchEvent(new Event('input'));
  if (++move < 60) return;
  clearInterval(timer);
  const last = performance.now(), rate = redraws / (last - begun) * 1000;
  const look = () => {
    if (document.getElementById('curve').getAttribute('aria-busy') === 'false') done([rate, performance.now() - last]);
    else setTimeout(look, 1);
  };
  look();
}, 33);"""
LOADED = """return [performance.timeOrigin, ...['/api/law', '/api/size'].map(name => {
  const found = performance.getEntriesByType('resource').find(e => e.name.endsWith(name));
  return found ? found.responseEnd : null; })]"""
SIZES = """return performance.getEntriesByType('resource').concat(performance.getEntriesByType('navigation')).map(
  e => [e.name.replace(location.origin, '').split('#')[0], e.encodedBodySize])"""


def prepare(seen: Seen, values: dict[str, Any]) -> None:
    seen.load()
    for key in ("ber", "burst"):
        if key in values:
            seen.click(f"[name=noise][value={key}]")
            seen.put("#ber", values[key])
    for key in ("stations", "retries"):
        if key in values:
            seen.put(f"#{key}", values[key])
    seen.until(
        lambda: seen.js("return document.getElementById('curve').getAttribute('aria-busy') === 'false'"), 200
    )
    time.sleep(0.5)


def main() -> None:
    count = 4 if "--quick" in sys.argv else 12
    folder = Path(tempfile.mkdtemp())
    begun = time.monotonic()
    with chromium() as window:
        window.set_script_timeout(300)
        begun = time.monotonic()
        with server(folder) as (_, address):
            print(f"start to URL: {time.monotonic() - begun:.2f} s")
            seen = Seen(window, address)
            window.get(address)
            seen.settle()
            _, law, size = seen.js(LOADED)
            print(f"navigation to distribution {law / 1000:.2f} s, to recommendation {size / 1000:.2f} s")
            sizes: dict[str, list[int]] = {}
            for name, size_ in seen.js(SIZES):
                sizes.setdefault(name, []).append(size_)
            files = {name: each for name, each in sizes.items() if not name.startswith("/api")}
            print(
                f"page: {sum(map(sum, files.values())) / 1e3:.0f} kB in {len(files)} requests, {len(sizes)} with its questions"
            )
            print(
                "; ".join(
                    f"{name} {each[0] / 1e3:.1f} kB"
                    for name, each in sizes.items()
                    if name.startswith("/api")
                )
            )
            for name, (values, sliders) in LINES.items():
                prepare(seen, values)
                for slider in sliders:
                    found = window.execute_async_script(REDRAWN, slider, 0, count)
                    high = sorted(found)[int(0.9 * len(found))]
                    print(f"{name}: {slider} to redraw {statistics.median(found):.0f} ms, p90 {high:.0f} ms")
                rate, late = window.execute_async_script(DRAG)
                print(f"{name}: 30 moves a second: {rate:.1f} redraws a second, the last {late:.0f} ms late")
            prepare(seen, {})
            seen.click("#trace")
            clicked = time.monotonic()
            seen.click("#run")
            event = "return document.getElementById('run-said').dataset.event"
            seen.until(lambda: seen.js(event) in ("progress", "finished"))
            first = time.monotonic() - clicked
            seen.until(lambda: seen.js(event) == "finished")
            print(f"simulate 60 s: first progress {first:.2f} s, done {time.monotonic() - clicked:.2f} s")
            seen.put("#duration", 1e6)
            seen.click("#run")
            seen.until(lambda: seen.js(event) == "progress")
            clicked = time.monotonic()
            seen.click("#stop")
            seen.until(lambda: seen.js(event) == "stopped")
            print(f"stop acts after {time.monotonic() - clicked:.2f} s")
            print(json.dumps(window.get_log("browser")[:3]))


if __name__ == "__main__":
    main()
