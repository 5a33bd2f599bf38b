"use strict";
// The two charts of a setting: how often a link scan takes longer, and what each number of retries costs.
// `view` says what is on them; what is a line of a poll list there is one of a link here.
charts.ofSetting = (view) => {
  const { css, axis, decades, plain, Chart, isPrinting } = charts;
  const CHART_HEIGHT = 270, PRINTED_HEIGHT = 215, FLOOR = 1e-9;
  const height = () => (isPrinting() ? PRINTED_HEIGHT : CHART_HEIGHT);
  class Curve extends Chart {
    content() { return view.curve().data; }
    draw() {
      const shown = view.curve();
      if (!shown) return;
      this.data.description = shown.description;
      this.whole = shown.whole;
      // Only its points are new: the drawing stays, which takes a third of the time.
      const looks = JSON.stringify([this.width(), height(), css("--ink"), charts.speech.lang, shown.series, shown.legend]);
      if (this.u && looks === this.looks) {
        this.u.setData(shown.data);
        this.plot.querySelector(".u-wrap").setAttribute("aria-label", shown.description);
        return;
      }
      this.looks = looks;
      super.draw();
    }
    options() {
      const splits = [1e-9, 1e-6, 1e-3, 1];
      return {
        height: height(), padding: [12, 26, 0, 0],
        cursor: { drag: { x: false, y: false } },
        scales: { x: { time: false, range: () => this.whole }, y: { distr: 3, log: 10, range: () => [FLOOR, 1.6] } },
        axes: [axis(view.word("curve.x"), { values: plain }), axis(view.word("curve.y"), { size: 62, values: decades, splits: () => splits, filter: (u, all) => all })],
        series: [{}, ...view.curve().series],
      };
    }
    legend() { return view.curve().legend ?? []; }
    describe(u, left) { return view.curve().point(u.posToVal(left, "x")); }
  }
  class TradeOff extends Chart {
    dots() { return view.dots().filter(({ x, y }) => x !== null && y !== null).map((dot) => ({ ...dot, y: Math.max(dot.y, FLOOR) })); }
    draw() {
      if (!view.isSized()) return;
      this.data.description = view.tradeText();
      const most = Math.max(1, ...this.dots().map(({ x }) => x)) * 1.08, step = 10 ** Math.floor(Math.log10(most));
      this.whole = [0, [1, 1.5, 2, 3, 4, 5, 6, 8, 10].map((times) => times * step).find((at) => at >= most)];
      super.draw();
      this.u.over.addEventListener("click", (event) => {
        const near = this.near(this.u, event.offsetX, event.offsetY);
        if (near) view.choose(near);
      });
    }
    content() { return [this.whole, [1, 1]]; }
    options() {
      return {
        height: height(), padding: [12, 26, 0, 0],
        cursor: { drag: { x: false, y: false } },
        scales: { x: { time: false, range: () => this.whole }, y: { distr: 3, log: 10, range: () => [FLOOR, 1e9] } },
        axes: [axis(view.word(view.kind("trade.x")), { values: plain }),
          axis(view.word(view.kind("trade.y")), { size: 88, values: decades, splits: () => [1e-9, 1e-6, 1e-3, 1, 1e3, 1e6, 1e9], filter: (u, all) => all })],
        series: [{}, { paths: () => null, points: { show: false } }],
        hooks: { draw: [(u) => this.points(u)] },
      };
    }
    points(u) {
      const { ctx, bbox } = u, ratio = devicePixelRatio;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      const goal = view.goal?.();
      if (goal) {
        ctx.fillStyle = css("--law");
        ctx.globalAlpha = 0.12;
        const top = u.valToPos(goal, "y", true);
        ctx.fillRect(bbox.left, top, bbox.width, bbox.top + bbox.height - top);
        ctx.globalAlpha = 1;
      }
      ctx.font = `${12 * ratio}px system-ui, sans-serif`;
      ctx.textBaseline = "middle";
      for (const { x, y, label, isBest, isNow } of this.dots()) {
        const left = u.valToPos(x, "x", true), top = Math.min(u.valToPos(y, "y", true), bbox.top + bbox.height - 8 * ratio);
        ctx.fillStyle = ctx.strokeStyle = css(isBest ? "--law" : "--simulated");
        ctx.beginPath();
        ctx.arc(left, top, (isBest ? 7 : 5) * ratio, 0, 2 * Math.PI);
        ctx.fill();
        if (isNow) {
          ctx.lineWidth = 2.5 * ratio;
          ctx.strokeStyle = css("--ink");
          ctx.beginPath();
          ctx.arc(left, top, 10 * ratio, 0, 2 * Math.PI);
          ctx.stroke();
        }
        ctx.fillStyle = css("--ink");
        ctx.fillText(label, left + 13 * ratio, top - 11 * ratio);
      }
      ctx.restore();
    }
    near(u, left, top) {
      const away = ({ x, y }) => Math.hypot(u.valToPos(x, "x") - left, Math.min(u.valToPos(y, "y"), u.over.clientHeight - 8) - top);
      return this.dots().map((dot) => [away(dot), dot]).filter(([far]) => far < 20).sort(([a], [b]) => a - b)[0]?.[1];
    }
    legend() {
      return [[css("--simulated"), view.word("trade.dot")], [css("--law"), view.word("trade.best")], [css("--ink"), view.word("trade.now"), "frame"],
        ...(view.goal?.() ? [[css("--law"), view.word("trade.goal"), "hatch"]] : [])];
    }
    describe(u, left, top) {
      const near = this.near(u, left, top);
      return near ? view.dotText(near) : "";
    }
  }
  return { curve: Curve, trade: TradeOff };
};
