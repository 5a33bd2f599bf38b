"use strict";
// What all pages draw with: colours, axes, a chart, redrawing. In scope for the scripts after it.
const charts = (() => {
  const payload = JSON.parse(document.getElementById("payload").textContent);
  const drawn = new Map(); // figure -> what is on it
  const PRINT_WIDTH = 660;
  let printing = false;

  const isPrinting = () => printing;
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const isDark = () => !printing && matchMedia("(prefers-color-scheme: dark)").matches;
  const node = (tag, attributes = {}, text = "") => {
    const made = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text) made.textContent = text;
    return made;
  };
  // What charts say, in the page's language, which may change.
  const speech = { lang: payload.lang };
  const said = (key, values = {}) =>
    payload.words[speech.lang][key].replace(/\{(\w+)\}/g, (whole, name) => values[name] ?? whole);
  const digits = (value, most = 3) => value.toLocaleString("en", { maximumFractionDigits: most });

  // Colours of the palette that vanish on a dark page.
  const DARKER = { "#000000": "#e8e8e8", "#0072B2": "#56b4e9", "#009E73": "#2fd3a2", "#D55E00": "#ff8a3d" };
  const shown = (colour) => (isDark() && DARKER[colour]) || colour;
  const grey = (colour) => (isDark() ? "#" + [1, 3, 5].map((at) =>
    Math.round((255 - parseInt(colour.slice(at, at + 2), 16)) * 0.75 + 50).toString(16).padStart(2, "0")).join("") : colour);

  const axis = (label, extra = {}) => ({
    label, labelSize: 24, labelFont: "13px system-ui, sans-serif", font: "12px system-ui, sans-serif",
    stroke: css("--ink"), grid: { stroke: css("--grid"), width: 1 }, ticks: { stroke: css("--line"), width: 1 }, ...extra,
  });
  const padded = (low, high, share = 0.03, least = 0.05) => {
    const extra = Math.max((high - low) * share, (least - (high - low)) / 2, 0);
    return [low - extra, high + extra];
  };
  // As few decimals as the steps between the ticks need.
  const plain = (u, splits) => {
    const step = splits.length > 1 ? splits[1] - splits[0] : 1;
    const places = Math.max(0, Math.min(6, -Math.floor(Math.log10(step) + 1e-9)));
    return splits.map((value) => value.toLocaleString("en", { maximumFractionDigits: places }));
  };
  // Of a logarithmic axis only whole decades are written.
  const decades = (u, splits) => splits.map((value) => {
    if (value === null) return "";
    const power = Math.log10(value);
    if (Math.abs(power - Math.round(power)) > 1e-6) return "";
    return power >= 0 && power < 7 ? value.toLocaleString("en") : power < 0 && power >= -2 ? String(+value.toPrecision(2)) : "1e" + Math.round(power);
  });

  const powers = (low, high) => {
    const splits = [];
    for (let at = Math.ceil(Math.log10(low) - 1e-9); 10 ** at <= high; at++) splits.push(10 ** at);
    return splits;
  };

  // Bounds stand upright in the law's colour, the least one thicker.
  const uprights = (u, bounds) => {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.strokeStyle = css("--law");
    bounds.forEach(([at], number) => {
      const x = u.valToPos(at, "x", true);
      ctx.lineWidth = (number ? 1.5 : 3) * devicePixelRatio;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    });
    ctx.restore();
  };
  const boundsNear = (u, bounds, left) => bounds.filter(([at]) => Math.abs(u.valToPos(at, "x") - left) <= 4).map(([, text]) => text);

  // ---- what all charts have: zoom by keyboard, hover, size ----
  class Chart {
    constructor(figure, data) {
      this.figure = figure;
      this.data = data;
      this.plot = figure.querySelector(".plot");
      this.tools = figure.querySelector(".tools");
      if (this.tools) {
        this.button(said("chart_zoom_in"), () => this.zoom(0.5));
        this.button(said("chart_zoom_out"), () => this.zoom(2));
        this.button("←", () => this.move(-0.4), said("chart_left"));
        this.button("→", () => this.move(0.4), said("chart_right"));
        this.button(said("chart_all"), () => this.all());
      }
      this.setUp();
      this.draw();
    }
    setUp() {}
    all() { this.range(...this.whole); }
    button(text, act, label = "") {
      const button = node("button", { type: "button" }, text);
      button.setAttribute("aria-label", said("chart_of", { label: label || text, title: this.data.title }));
      button.addEventListener("click", act);
      this.tools.append(button);
      return button;
    }
    toggle(text, on, act) {
      const button = this.button(text, () => {
        const now = button.getAttribute("aria-pressed") !== "true";
        button.setAttribute("aria-pressed", String(now));
        act(now);
      });
      button.setAttribute("aria-pressed", String(on));
      return button;
    }
    range(low, high) {
      const [least, most] = this.whole;
      const span = Math.min(high - low, most - least);
      low = Math.max(least, Math.min(low, most - span));
      this.view = [low, low + span];
      this.u.setScale("x", { min: low, max: low + span });
    }
    zoom(factor) {
      const { min, max } = this.u.scales.x;
      const middle = (min + max) / 2, half = ((max - min) * factor) / 2;
      this.range(middle - half, middle + half);
    }
    move(share) {
      const { min, max } = this.u.scales.x;
      this.range(min + (max - min) * share, max + (max - min) * share);
    }
    width() { return printing ? Number(this.figure.dataset.print ?? PRINT_WIDTH) : Math.max(260, Math.floor(this.plot.clientWidth)); }
    draw() {
      this.u?.destroy();
      this.plot.replaceChildren();
      const tip = this.tip = node("div", { class: "tip", hidden: "", "aria-hidden": "true" });
      const view = this.view;
      const options = this.options();
      const hooks = options.hooks ?? {};
      this.u = new uPlot({
        width: this.width(), height: 300, legend: { show: false }, padding: [12, 14, 0, 0],
        ...options,
        cursor: { drag: { x: true, y: false, uni: 8 }, points: { show: false }, y: false, ...options.cursor },
        hooks: { ...hooks, setCursor: [(u) => this.hover(u)], setSelect: [() => setTimeout(() => {
          this.view = [this.u.scales.x.min, this.u.scales.x.max];
        })] },
      }, this.content(), this.plot);
      const wrap = this.plot.querySelector(".u-wrap");
      wrap.setAttribute("role", "img");
      wrap.setAttribute("aria-label", this.data.description);
      wrap.append(tip);
      const legend = this.legend();
      if (legend.length) {
        const list = node("ul", { class: "legend" });
        for (const [colour, text, style] of legend) {
          const item = node("li"), swatch = node("i", { "aria-hidden": "true" });
          swatch.style.background = style === "hatch"
            ? `repeating-linear-gradient(45deg, ${colour} 0 2px, transparent 2px 6px)` : style === "frame" ? "none" : colour;
          if (style) swatch.style.borderColor = colour;
          item.append(swatch, text);
          list.append(item);
        }
        this.plot.append(list);
      }
      if (this.data.beyond) this.plot.append(node("p", { class: "note" }, this.data.beyond));
      if (view) this.range(...view);
    }
    legend() { return []; }
    hover(u) {
      const { left, top } = u.cursor;
      const text = left === null || left < 0 ? "" : this.describe(u, left, top);
      this.tip.hidden = !text;
      if (!text) return;
      this.tip.textContent = text;
      const x = u.over.offsetLeft + left, y = u.over.offsetTop + top;
      const box = this.tip.getBoundingClientRect(), width = this.plot.clientWidth;
      this.tip.style.left = `${Math.max(0, Math.min(x + 12, width - box.width))}px`;
      this.tip.style.top = `${y + 16}px`;
    }
    describe() { return ""; }
  }

  // Draw what the page has, by kind of chart, and again whenever its width, its colours or its medium change.
  const again = () => { for (const chart of drawn.values()) chart.draw(); };
  const start = (kinds) => {
    for (const figure of document.querySelectorAll("figure[data-chart]")) {
      const data = payload.charts[Number(figure.dataset.chart)];
      drawn.set(figure, new kinds[data.kind](figure, data));
    }
    let waiting = 0;
    let width = document.documentElement.clientWidth;
    // Also where the width changes without an event of the window, as when a picture is taken of a narrow page.
    new ResizeObserver(() => {
      if (printing || document.documentElement.clientWidth === width) return;
      width = document.documentElement.clientWidth;
      clearTimeout(waiting);
      waiting = setTimeout(again, 100);
    }).observe(document.documentElement);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
    const print = (on) => {
      printing = on;
      document.documentElement.toggleAttribute("data-print", on);
      again();
    };
    addEventListener("beforeprint", () => print(true));
    addEventListener("afterprint", () => print(false));
    document.documentElement.dataset.ready = "true";
  };

  return { payload, speech, said, css, isDark, node, digits, shown, grey, axis, padded, plain, decades, powers, uprights, boundsNear, Chart, again, isPrinting, start };
})();
