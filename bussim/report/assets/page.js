"use strict";
(() => {
  const { payload, said, css, isDark, digits, shown, grey, axis, padded, plain, decades, powers, uprights, boundsNear, Chart, start } = charts;

  // ---- histograms, aggregated anew for what is visible ----
  const MOST_BARS = 150;
  const WHOLE = [0, 1, 2, 3, 4, 5, 6, 7, 8].flatMap((power) => [1, 2, 5].map((digit) => digit * 10 ** power)); // of counts
  const barWidth = (span, most) => {
    for (let decade = 1; ; decade *= 10)
      for (const width of [decade, 2 * decade, 5 * decade]) if (span <= width * most) return width;
  };
  // P(x' > x) between the points of the law.
  const tailAt = (law, x) => {
    if (x <= law[0][0]) return 1;
    let low = 0, high = law.length - 1;
    if (x >= law[high][0]) return law[high][1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (law[middle][0] <= x) low = middle; else high = middle;
    }
    const [x0, p0] = law[low], [x1, p1] = law[high];
    return p0 + ((p1 - p0) * (x - x0)) / (x1 - x0);
  };
  class Histogram extends Chart {
    setUp() {
      this.several = this.data.series.length > 1;
      this.sums = this.data.series.map(({ bins }) => {
        let sum = 0;
        return [bins.map(([place]) => place), [0, ...bins.map(([, count]) => (sum += count))]];
      });
      const places = this.data.series.flatMap(({ bins }) => [bins[0][0], bins[bins.length - 1][0]]);
      const unit = this.data.bin_ms;
      const { shown } = this.data;
      this.whole = shown ? [shown[0], shown[1] + (shown[1] - shown[0]) * 0.03 + unit]
        : padded((Math.min(...places) - 0.5) * unit, (Math.max(...places) + 0.5) * unit);
      this.view = shown ? this.whole : this.data.usual;
      this.log = !this.view && this.whole[1] - this.whole[0] > 5;
      this.logarithmic = this.toggle(said("chart_log"), this.log, (on) => { this.log = on; this.draw(); });
    }
    all() { // a few far ones are seen on a logarithmic axis only
      if (this.data.usual && !this.log) this.logarithmic.click();
      super.all();
    }
    counted(number, from, to) { // samples in bins from…to-1
      const [places, sums] = this.sums[number];
      const before = (place) => {
        let low = 0, high = places.length;
        while (low < high) { const middle = (low + high) >> 1; if (places[middle] < place) low = middle + 1; else high = middle; }
        return sums[low];
      };
      return before(to) - before(from);
    }
    times(count) { return this.data.times[count === 1 ? 0 : 1].replace("{count}", digits(count)); }
    aggregate(min, max) {
      const unit = this.data.bin_ms;
      const width = barWidth(Math.ceil((max - min) / unit), Math.max(30, Math.min(MOST_BARS, this.width() / 6)));
      const first = Math.floor((min / unit + 0.5) / width), last = Math.ceil((max / unit + 0.5) / width);
      const x = [], columns = this.data.series.map(() => []), law = [];
      for (let bar = first; bar <= last; bar++) {
        const from = bar * width, to = from + width;
        x.push(((from + to) / 2 - 0.5) * unit);
        this.data.series.forEach((series, number) => {
          const count = this.counted(number, from, to);
          columns[number].push(count === 0 && this.log ? null : this.several ? count / series.count : count);
        });
        if (this.data.law.length) {
          const share = tailAt(this.data.law, (from - 0.5) * unit) - tailAt(this.data.law, (to - 0.5) * unit);
          law.push(this.data.series[0].count * Math.max(share, 0));
        }
      }
      this.barMs = width * unit;
      const floor = this.several ? 0.5 / Math.max(...this.data.series.map(({ count }) => count)) : 0.5;
      const top = Math.max(...columns.flat().filter((value) => value !== null), ...law, this.log ? floor * 4 : 0) || 1;
      this.y = this.log ? [floor, top * 1.6] : [0, top * 1.06];
      this.bounds = [first, last, width];
      return [x, ...columns, ...(law.length ? [law.map((value) => (this.log && value < floor / 10 ? null : value))] : [])];
    }
    content() { return this.aggregate(...(this.view ?? this.whole)); }
    colours() { return this.several ? this.data.series.map((_, number) => shown(payload.runs[number])) : [css("--simulated")]; }
    options() {
      const bars = uPlot.paths.bars({ size: [1, Infinity], align: 0 });
      const colours = this.colours();
      const series = this.data.series.map(({ label }, number) => this.several
        ? { label, paths: () => null, points: { show: false } }
        : { label, fill: colours[number], stroke: colours[number], width: 0, paths: bars, points: { show: false } });
      if (this.data.law.length) series.push({ label: "exact law", paths: () => null, points: { show: false } });
      return {
        scales: {
          x: { time: false, range: (u, min, max) => (min === null ? this.whole : [min, max]) },
          y: { distr: this.log ? 3 : 1, log: 10, range: () => this.y },
        },
        axes: [
          axis(said("chart_time", { time: this.data.time }), { values: plain }),
          axis("", { size: 62, values: this.log ? decades : plain, ...(this.log || this.several ? {} : { incrs: WHOLE }), ...(this.log ? { splits: () => powers(...this.y), filter: (u, all) => all } : {}) }),
        ],
        series: [{}, ...series],
        hooks: {
          setScale: [(u, key) => {
            if (key !== "x" || this.busy) return;
            const { min, max } = u.scales.x, bounds = String(this.bounds);
            const fresh = this.aggregate(min, max);
            if (String(this.bounds) === bounds) return;
            this.busy = true;
            queueMicrotask(() => { u.setData(fresh, false); u.setScale("x", { min, max }); this.busy = false; });
          }],
          drawAxes: [(u) => this.caption(u)],
          draw: [(u) => this.stairs(u), (u) => uprights(u, this.data.bounds)],
        },
      };
    }
    // A step as wide as each bar, down to the axis where there is nothing.
    stairs(u) {
      const { ctx, bbox } = u, [floor] = this.y, bottom = bbox.top + bbox.height;
      const lines = this.several ? this.colours().map((colour, number) => [colour, u.data[number + 1], 0.2]) : [];
      if (this.data.law.length) lines.push([css("--law"), u.data[2], 0]);
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height + 2);
      ctx.clip();
      ctx.lineWidth = 2 * devicePixelRatio;
      for (const [colour, values, shade] of lines) {
        ctx.strokeStyle = ctx.fillStyle = colour;
        ctx.beginPath();
        u.data[0].forEach((x, index) => {
          const left = u.valToPos(x - this.barMs / 2, "x", true), right = u.valToPos(x + this.barMs / 2, "x", true);
          const value = values[index] ?? 0;
          const y = value <= (this.log ? floor : 0) ? bottom : u.valToPos(value, "y", true);
          if (index === 0) ctx.moveTo(left, bottom);
          ctx.lineTo(left, y);
          ctx.lineTo(right, y);
        });
        ctx.stroke();
        ctx.globalAlpha = shade;
        ctx.fill();
        ctx.globalAlpha = 1;
      }
      ctx.restore();
    }
    caption(u) {
      const text = said(this.several ? "chart_share_per" : "chart_per", { counted: this.data.counted, width: digits(this.barMs) });
      const { ctx } = u, ratio = devicePixelRatio;
      ctx.save();
      ctx.fillStyle = css("--ink");
      ctx.font = `${13 * ratio}px system-ui, sans-serif`;
      ctx.textAlign = "center";
      ctx.translate(12 * ratio, u.bbox.top + u.bbox.height / 2);
      ctx.rotate(-Math.PI / 2);
      ctx.fillText(text, 0, 0);
      ctx.restore();
    }
    legend() {
      const colours = this.colours();
      const entries = this.data.series.map(({ label, count }, number) =>
        [colours[number], said(this.several ? "chart_series" : "chart_counted", { label, times: this.times(count) })]);
      if (this.data.law.length) entries.push([css("--law"), said("chart_expected_law", this.data)]);
      for (const [, text] of this.data.bounds) entries.push([css("--law"), text]);
      return entries;
    }
    describe(u, left) {
      const index = u.cursor.idx;
      if (index === null || index === undefined) return "";
      const half = this.barMs / 2, x = u.data[0][index];
      const parts = [said("chart_range", { low: digits(x - half), high: digits(x + half) })];
      this.data.series.forEach((series, number) => {
        const value = u.data[number + 1][index] ?? 0;
        parts.push(this.several ? said("chart_series", { label: series.label, times: `${digits(100 * value, 4)} %` }) : this.times(value));
      });
      parts.push(...boundsNear(u, this.data.bounds, left));
      if (this.data.law.length) parts.push(said("chart_expected", { count: digits(u.data[2][index] ?? 0, 1) }));
      return parts.join(" · ");
    }
  }

  // ---- how often it takes longer ----
  class Tail extends Chart {
    setUp() {
      const { counted, law } = this.data;
      const least = 1e-12;
      this.law = law.filter(([, p]) => p >= least);
      const xs = [...counted.map(([x]) => x), ...this.law.map(([x]) => x)];
      if (!xs.length) xs.push(0, 1);
      this.whole = padded(Math.min(...xs), Math.max(...xs));
      this.least = Math.min(0.1, ...counted.map(([, p]) => p), ...this.law.map(([, p]) => p));
    }
    content() {
      const tables = [[this.data.counted.map(([x]) => x), this.data.counted.map(([, p]) => p)]];
      if (this.law.length) tables.push([this.law.map(([x]) => x), this.law.map(([, p]) => p)]);
      return uPlot.join(tables);
    }
    options() {
      const series = [{ label: "counted", stroke: css("--simulated"), width: 5, spanGaps: true, points: { show: false },
        paths: uPlot.paths.stepped({ align: 1 }) }];
      if (this.law.length) series.push({ label: "exact law", stroke: css("--law"), width: 2, spanGaps: true, points: { show: false } });
      const power = Math.floor(Math.log10(this.least));
      const every = Math.max(1, Math.ceil(-power / 8));
      const splits = [];
      for (let at = 0; at >= power; at -= every) splits.unshift(10 ** at);
      return {
        scales: {
          x: { time: false, range: (u, min, max) => (min === null ? this.whole : [min, max]) },
          y: { distr: 3, log: 10, range: () => [10 ** power, 1.6] },
        },
        axes: [axis(said("chart_tail_x"), { values: plain }),
          axis(said("chart_tail_y"), { size: 62, values: decades, splits: () => splits, filter: (u, all) => all })],
        series: [{}, ...series],
      };
    }
    legend() {
      const entries = [[css("--simulated"), said("chart_counted_run")]];
      if (this.law.length) entries.push([css("--law"), said("chart_law", this.data)]);
      return entries;
    }
    describe(u, left) {
      const x = u.posToVal(left, "x");
      const last = this.data.counted.filter(([at]) => at <= x).pop();
      const once = (p) => (p >= 0.5 ? `${digits(100 * p, 1)} %` : p > 0 ? said("chart_one_in", { number: digits(1 / p, 1 / p < 10 ? 1 : 0) }) : said("chart_none"));
      const share = x < (this.data.counted[0]?.[0] ?? 0) ? said("chart_every")
        : once(last && x <= this.data.counted[this.data.counted.length - 1][0] ? last[1] : 0);
      const parts = [said("chart_over", { time: digits(x) }), said("chart_counted_share", { share })];
      if (this.law.length) parts.push(x > this.law[this.law.length - 1][0] ? said("chart_law_least") : said("chart_law_share", { share: once(tailAt(this.law, x)) }));
      return parts.join(" · ");
    }
  }

  // ---- over the run ----
  const LANE = 14;
  class OverRun extends Chart {
    setUp() {
      this.whole = [0, this.data.end];
      this.rows = [["chart_fault", this.data.faults, "--fault"], ["chart_in_error", this.data.errors, "--error"],
        ["chart_lost", this.data.lost, "--lost"]]
        .filter(([, spans]) => spans.length);
    }
    content() {
      const { cells } = this.data;
      return [cells.map(([x]) => x), cells.map(([, longest]) => longest), cells.map(([, , shortest]) => shortest)];
    }
    options() {
      const values = this.data.cells.flatMap(([, a, b]) => [a, b]);
      const [low, high] = padded(Math.min(...values), Math.max(...values), 0.06, 1);
      return {
        padding: [12, 14, this.rows.length * LANE, 0],
        scales: { x: { time: false, range: (u, min, max) => (min === null ? this.whole : [min, max]) },
          y: { range: () => [Math.max(0, low), high] } },
        axes: [axis(said("chart_run_time"), { values: plain }), axis(said("chart_scan_time"), { size: 62, values: plain })],
        series: [{}, { label: "longest", stroke: css("--simulated"), width: 1, points: { show: true, size: 3, fill: css("--simulated") }, paths: () => null },
          { label: "shortest", stroke: css("--simulated"), width: 1, points: { show: false }, paths: () => null }],
        hooks: { draw: [(u) => this.bars(u)] },
      };
    }
    bars(u) {
      const { ctx, bbox } = u, ratio = devicePixelRatio;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, 0, bbox.width, ctx.canvas.height);
      ctx.clip();
      ctx.strokeStyle = css("--simulated");
      ctx.globalAlpha = 0.45;
      ctx.lineWidth = ratio;
      ctx.beginPath();
      for (const [x, longest, shortest] of this.data.cells) {
        if (longest === shortest) continue;
        const at = u.valToPos(x, "x", true);
        ctx.moveTo(at, u.valToPos(longest, "y", true));
        ctx.lineTo(at, u.valToPos(shortest, "y", true));
      }
      ctx.stroke();
      this.rows.forEach(([, spans, colour], row) => {
        ctx.fillStyle = css(colour);
        for (const [, from, to] of spans) {
          const left = u.valToPos(from, "x", true), right = u.valToPos(to, "x", true);
          ctx.globalAlpha = 0.13;
          ctx.fillRect(left, bbox.top, right - left, bbox.height);
          ctx.globalAlpha = 1;
          ctx.fillRect(left, ctx.canvas.height - (this.rows.length - row) * LANE * ratio + 3 * ratio,
            Math.max(right - left, 2 * ratio), (LANE - 5) * ratio);
        }
      });
      ctx.restore();
    }
    legend() {
      const entries = [[css("--simulated"), said("chart_neighbours")]];
      for (const [name, , colour] of this.rows)
        entries.push([css(colour), said(name)]);
      return entries;
    }
    describe(u, left) {
      const x = u.posToVal(left, "x"), index = u.cursor.idx, parts = [];
      if (index !== null && index !== undefined && this.data.cells[index]) {
        const [at, longest, shortest] = this.data.cells[index];
        parts.push(`${digits(at)} s`, longest === shortest ? `${digits(longest)} ms` : said("chart_range", { low: digits(shortest), high: digits(longest) }));
      }
      for (const [, spans] of this.rows) for (const [text, from, to] of spans) if (from <= x && x <= to) parts.push(text);
      return parts.join(" · ");
    }
  }

  // ---- the timeline, like a logic analyser ----
  class Timeline extends Chart {
    setUp() { this.whole = [0, this.data.span]; }
    time() { return said("chart_after", { begin: this.data.begin_s.toFixed(6) }); }
    content() { return [[0, this.data.span], [0, this.data.lanes.length]]; }
    options() {
      const count = this.data.lanes.length, narrow = this.width() < 600;
      const most = narrow ? 13 : 22;
      return {
        height: 24 * count + 74,
        cursor: { y: true },
        scales: { x: { time: false, range: (u, min, max) => (min === null ? this.whole : [min, max]) }, y: { range: () => [0, count], dir: -1 } },
        axes: [
          axis(this.time(), { values: plain }),
          axis(null, { size: narrow ? 98 : 160, gap: 6, grid: { show: false }, ticks: { show: false },
            splits: () => this.data.lanes.map((_, lane) => lane + 0.5),
            values: () => this.data.lanes.map((name) => (name.length > most ? name.slice(0, most - 1) + "…" : name)) }),
        ],
        series: [{}, { paths: () => null, points: { show: false } }],
        hooks: { draw: [(u) => this.shapes(u)] },
      };
    }
    colour(kind) {
      const style = this.data.box_styles[kind];
      return style.grey ? grey(style.colour) : shown(style.colour);
    }
    ink(style) {
      return style.hatch || (style.grey && isDark()) ? css("--ink") : style.colour === "#000000" && !isDark() ? "#ffffff" : "#000000";
    }
    shapes(u) {
      const { ctx, bbox } = u, ratio = devicePixelRatio, { min, max } = u.scales.x;
      const tall = bbox.height / this.data.lanes.length;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      ctx.font = `${11 * ratio}px system-ui, sans-serif`;
      ctx.textBaseline = "middle";
      ctx.textAlign = "center";
      for (const [lane, from, to, kind, label] of this.data.boxes) {
        if (to < min || from > max) continue;
        const style = this.data.box_styles[kind], colour = this.colour(kind);
        const left = u.valToPos(Math.max(from, min), "x", true), right = u.valToPos(Math.min(to, max), "x", true);
        const over = kind === "damage" || kind === "heard damage" || kind === "lost";
        const wide = Math.max(right - left, (over ? 3 : 1) * ratio), high = tall * style.height, top = bbox.top + tall * (lane + 0.5) - high / 2;
        ctx.fillStyle = ctx.strokeStyle = colour;
        ctx.lineWidth = ratio;
        if (style.filled) ctx.fillRect(left, top, wide, high);
        if (style.hatch) {
          ctx.save();
          ctx.beginPath();
          ctx.rect(left, top, wide, high);
          ctx.clip();
          ctx.beginPath();
          for (let at = left - high; at < right; at += 7 * ratio) { ctx.moveTo(at, top + high); ctx.lineTo(at + high, top); }
          ctx.stroke();
          ctx.restore();
        }
        ctx.strokeStyle = style.filled && !over ? css("--soft") : colour;
        if (wide > 5 * ratio || !style.filled) ctx.strokeRect(left, top, wide, high);
        if (!label) continue;
        const textWidth = ctx.measureText(label).width;
        if (textWidth + 8 * ratio > wide) continue;
        const middle = (left + right) / 2, centre = top + high / 2 + ratio;
        if (style.hatch) {
          ctx.fillStyle = css("--plot");
          ctx.fillRect(middle - textWidth / 2 - 3 * ratio, top + 2 * ratio, textWidth + 6 * ratio, high - 4 * ratio);
        }
        ctx.fillStyle = this.ink(style);
        ctx.fillText(label, middle, centre);
      }
      for (const [lane, at, kind] of this.data.marks) {
        if (at < min || at > max) continue;
        const style = this.data.mark_styles[kind], x = u.valToPos(at, "x", true);
        const bottom = bbox.top + tall * (lane + 1);
        ctx.fillStyle = ctx.strokeStyle = shown(style.colour);
        ctx.beginPath();
        if (style.below) {
          ctx.strokeStyle = css("--soft");
          ctx.lineWidth = ratio;
          ctx.moveTo(x, bottom - 5 * ratio);
          ctx.lineTo(x, bottom);
          ctx.stroke();
        } else {
          const y = bottom - tall / 2;
          ctx.moveTo(x, y + 6 * ratio);
          ctx.lineTo(x - 5 * ratio, y - 5 * ratio);
          ctx.lineTo(x + 5 * ratio, y - 5 * ratio);
          ctx.fill();
        }
      }
      ctx.restore();
    }
    legend() {
      const entries = [];
      for (const [kind, style] of Object.entries(this.data.box_styles))
        if (kind !== "scan" && kind !== "level")
          entries.push([this.colour(kind), style.meaning, style.hatch ? "hatch" : style.filled ? "" : "frame"]);
      for (const style of Object.values(this.data.mark_styles))
        entries.push([style.below ? css("--soft") : shown(style.colour), (style.below ? "| " : "▼ ") + style.meaning]);
      return entries;
    }
    describe(u, left, top) {
      const x = u.posToVal(left, "x"), lane = Math.floor((top / u.over.clientHeight) * this.data.lanes.length);
      const near = (u.scales.x.max - u.scales.x.min) / u.over.clientWidth * 5;
      const parts = [];
      for (const [at, tick, , text] of this.data.marks) if (at === lane && Math.abs(tick - x) <= near) parts.push(text);
      for (const [at, from, to, , , text] of this.data.boxes) if (at === lane && from <= x && x <= to) parts.push(text);
      return parts.length ? said("chart_at", { time: digits(x), parts: [...new Set(parts)].slice(0, 4).join(" · ") }) : "";
    }
  }

  // ---- what latencies are made of: lanes of boxes as well ----
  class Parts extends Timeline {
    setUp() { this.view = this.whole = [0, this.data.span * 1.03]; }
    time() { return "ms"; }
    options() {
      const options = super.options();
      const count = this.data.lanes.length;
      return { ...options, height: 40 * count + 62,
        hooks: { draw: [...options.hooks.draw, (u) => uprights(u, this.data.bounds)] } };
    }
    // The same on a light page and a dark one: lighter blue is another part's.
    colour(kind) { return this.data.box_styles[kind].colour; }
    ink(style) { return style.colour === "#0072B2" ? "#ffffff" : "#000000"; }
    legend() {
      return [...super.legend(), ...this.data.bounds.map(([, text]) => [css("--law"), text])];
    }
    describe(u, left, top) { return [super.describe(u, left, top), ...boundsNear(u, this.data.bounds, left)].filter(Boolean).join(" · "); }
  }

  charts.ofRuns = { histogram: Histogram, tail: Tail, "over-run": OverRun, timeline: Timeline, parts: Parts };
  start(charts.ofRuns);
})();
