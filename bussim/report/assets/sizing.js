"use strict";
(() => {
  const { payload, css, node, again, start } = charts;
  const { items, dims } = payload;
  const state = { lang: payload.lang, place: dims.map(() => 0), retries: 0, timeout: 0, noise: 0 };
  const get = (id) => document.getElementById(id);
  let item = items[0];

  // ---- words ----
  const word = (key, values = {}) => payload.words[state.lang][key].replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
  const kind = (key) => `${item.kind}.${key}`;
  const whole = (value) => (value >= 1e9 ? value.toExponential(0) : value.toLocaleString("en", { maximumSignificantDigits: 6 }));
  const time = (value) => (value === null ? "–" : `${value.toLocaleString("en", { maximumFractionDigits: 1 })} ms`);
  const rate = (value) => (value === null ? "–" : value < 1e-3 ? word("never") : whole(value));
  const shown = (name, value) => (name === "errors" ? rate(value) : time(value));
  // What the solver wrote in English alone stays English, and says so to a screen reader.
  const solver = (text) => {
    const own = payload.sentences[text];
    return state.lang === "zh" && own ? { text: own } : { text, lang: "en" };
  };

  // ---- figures: looked up, never reckoned ----
  const pick = (list, index) => list[list.length === 1 ? 0 : index];
  const cell = (table, { noise = state.noise, retries = state.retries, timeout = state.timeout } = {}) =>
    pick(pick(pick(table, noise), retries), timeout);
  const figure = (name, at) => cell(item.figures[name], at);
  const setting = (retries = state.retries, timeout = state.timeout) => word(kind("is"), {
    retries: item.retries[retries], units: item.units[timeout], timeout: time(item.timeouts[timeout]) });
  const noiseName = ({ name, value } = item.noises[state.noise]) =>
    word(name === "times" && value === 1 ? "noise.entered" : `noise.${name}`, { value: value.toLocaleString("en") });
  const rows = () => item.retries.map((_, row) => row).filter((row) => item.attempts.indexOf(item.attempts[row]) === row);

  const TILES = {
    link: ["mean", "longest", "dead", "detect", "errors", "ride"],
    port: ["mean", "dead", "dead_longest", "two_dead", "errors", "age"],
  };
  const STRIP = { link: ["mean", "dead", "errors"], port: ["mean", "dead_longest", "errors"] };
  const COLUMNS = { link: ["errors", "dead", "ride"], port: ["errors", "dead", "dead_longest"] };
  const tile = (list, name) => {
    const part = node("div"), term = node("dt", {}, word(kind(name))), value = node("dd", { "data-figure": name }, shown(name, figure(name)));
    if (name === "detect") value.append(node("small", { "data-figure": "detect_longest" }, word("at_worst", { time: time(figure("detect_longest")) })));
    if (name === "errors") value.append(node("small", {}, word("a_year")));
    part.append(term, value);
    list.append(part);
  };

  const verdict = () => {
    const missing = cell(item.missed), said = get("verdict"), best = item.recommended[state.noise];
    const misses = item.goals.filter((_, bit) => (missing >> bit) & 1).map(({ text }) => solver(text).text);
    const here = best !== null && best[0] === state.retries && best[1] === state.timeout;
    const parts = [word(misses.length ? "misses" : "meets", { setting: setting(), goals: (misses.length ? misses : item.goals.map(({ text }) => solver(text).text)).join(word("comma")) })];
    if (best === null) parts.push(word("none"));
    else parts.push(here ? word("best") : word("other", { setting: setting(...best) }));
    const values = Object.fromEntries(Object.keys(item.figures).map((name) => [name, shown(name, figure(name))]));
    if (item.kind === "link") parts.push(word("link.cost", values));
    else if (item.costly) parts.push(word("port.cost", { ...values, device: item.costly[0], polls: item.costly[1],
      attempts: item.attempts[state.retries], timeout: time(item.timeouts[state.timeout]) }));
    said.textContent = parts.join(word("space"));
    said.className = misses.length ? "misses" : "";
    get("use").disabled = best === null || here;
  };

  const program = () => {
    const values = { retries: item.retries[state.retries], units: item.units[state.timeout] };
    const fill = (text) => text.replace(/\{(\w+)\}/g, (_, name) => values[name]);
    const lines = item.program.map((line, number) => `${fill(line)}  ; ${word(kind(`mov${number}`), {
      ...values, attempts: item.attempts[state.retries], timeout: time(item.timeouts[state.timeout]) })}`);
    get("program").textContent = lines.join("\n") || word("no_program");
    for (const id of ["pymodbus", "pymodbus-said"]) get(id).hidden = !item.pymodbus;
    if (item.pymodbus) get("pymodbus").textContent = fill(item.pymodbus[state.timeout]);
  };

  const table = () => {
    const columns = COLUMNS[item.kind], head = node("tr");
    for (const key of ["retries", ...columns]) head.append(node("th", { scope: "col" }, word(key === "retries" ? key : kind(key === "errors" ? "trade.y" : key))));
    document.querySelector("#table thead").replaceChildren(head);
    document.querySelector("#table tbody").replaceChildren(...rows().map((row) => {
      const line = node("tr", item.attempts[row] === item.attempts[state.retries] ? { class: "now" } : {});
      line.append(node("th", { scope: "row" }, String(item.retries[row])));
      for (const name of columns) line.append(node("td", {}, shown(name, figure(name, { retries: row }))));
      return line;
    }));
    const reason = solver(item.reason ?? "");
    get("reason").textContent = figure("errors") === null ? `–: ${reason.text}` : "";
    get("reason").lang = reason.lang ?? document.documentElement.lang;
  };

  const list = (id, entries) => get(id).replaceChildren(...entries.map(({ text, lang }) => node("li", lang ? { lang } : {}, text)));
  const assumptions = () => {
    get("assumptions-part").hidden = !item.assumptions?.length;
    list("assumptions", (item.assumptions ?? []).map((each) => {
      const [name, other] = each.text.map((text) => solver(text).text);
      return { text: word("assumption", { name, other, errors: rate(Number(each.errors.replaceAll(",", ""))), dead: time(each.dead), ride: time(each.ride),
        setting: each.stays ? word("stays") : each.setting ? word("instead", { setting: word("link.is", { retries: each.setting[0], units: each.setting[1] }) }) : word("none") }) };
    }));
    const notes = [...(item.polls ?? []).map(([name, device, least, most]) => ({ text: word("response", { name, device, least: time(least), most: time(most) }) })),
      ...item.unmet.map((goals) => ({ text: word(goals.length > 1 ? "conflict" : "unmet", { goals: goals.map((text) => solver(text).text).join(word("comma")) }) })),
      ...item.remedies.map((text) => { const own = solver(text); return { ...own, text: word("remedy", own) }; }),
      ...(item.beside ?? []).map((goal) => ({ text: word("beside", { goal: solver(goal).text }) })),
      ...item.notes.map(solver)];
    get("notes-part").hidden = !notes.length;
    list("notes", notes);
  };

  // ---- charts ----
  const FLOOR = 1e-9;
  const kinds = charts.ofSetting({
    word, kind,
    isSized: () => item.valid,
    curve: () => {
      if (!item.over) return null;
      // [how many are certain, then probabilities up to the last one above 0]
      const [certain, ...rest] = cell(item.over);
      const known = [...Array(certain + 1).fill(1), ...rest];
      const over = item.x.map((_, index) => known[index] ?? (index === known.length ? FLOOR / 10 : null));
      return {
        data: [item.x, over],
        series: [{ stroke: css("--law"), width: 2, points: { show: false }, paths: uPlot.paths.stepped({ align: 1 }) }],
        whole: [0, item.x[item.x.length - 1]],
        description: word("curve.text", { setting: setting() }),
        point: (x) => {
          const index = item.x.findLastIndex((at) => at <= x), p = index < 0 ? 1 : over[index] ?? 0;
          return word("curve.point", { time: time(item.x[Math.max(0, index)]), p: p < FLOOR ? word("practically") : whole(p) });
        },
      };
    },
    dots: () => {
      const best = item.recommended[state.noise];
      return rows().map((row) => ({ x: figure("dead", { retries: row }), y: figure("errors", { retries: row }), row, label: String(item.retries[row]),
        isBest: best !== null && best[0] === row && best[1] === state.timeout, isNow: item.attempts[row] === item.attempts[state.retries] }));
    },
    choose: ({ row }) => choose("retries", row),
    tradeText: () => word("trade.text", { setting: setting() }),
    dotText: ({ row }) => word("trade.point", { setting: setting(row), dead: time(figure("dead", { retries: row })), errors: rate(figure("errors", { retries: row })) }),
  });

  // ---- the whole page ----
  let pending = 0;
  const show = () => {
    document.documentElement.lang = state.lang === "zh" ? "zh-Hans" : "en";
    for (const each of document.querySelectorAll("[data-word]")) each.textContent = word(each.dataset.word, payload);
    for (const each of document.querySelectorAll("[data-lang]")) each.setAttribute("aria-pressed", String(each.dataset.lang === state.lang));
    document.title = get("title").textContent = word(payload.title, { name: payload.name || word(kind("about"), item.about) });
    get("about").textContent = payload.name ? `${item.name}: ${word(kind("about"), item.about)}` : "";
    get("curve").hidden = !item.over;
    const plainly = !item.valid;
    for (const id of ["tiles", "strip", "details", "trade", "use", "least"]) get(id).hidden = plainly;
    for (const each of document.querySelectorAll("fieldset")) each.hidden = plainly;
    dims.forEach((dim, place) => { const out = get(`${dim.key}-shown`); if (out) out.textContent = dim.values[state.place[place]]; });
    assumptions();
    if (plainly) {
      get("verdict").textContent = word("cannot");
      get("verdict").className = "plain";
      return;
    }
    const texts = {
      retries: word(kind("retries"), { retries: item.retries[state.retries], attempts: item.attempts[state.retries] }),
      timeout: word(kind("timeout"), { units: item.units[state.timeout], timeout: time(item.timeouts[state.timeout]) }),
      noise: noiseName(),
    };
    for (const [key, text] of Object.entries(texts)) {
      get(`${key}-shown`).textContent = text;
      get(key).setAttribute("aria-valuetext", text);
    }
    get("least").textContent = word(kind("least"), { least: time(item.least), interval: time(item.interval ?? null) });
    get("curve-said").textContent = word("curve.said");
    get("trade-said").textContent = word(kind("trade.said"));
    for (const [id, names] of [["tiles", TILES], ["strip", STRIP]]) {
      get(id).replaceChildren();
      for (const name of names[item.kind]) tile(get(id), name);
    }
    verdict();
    program();
    table();
    cancelAnimationFrame(pending);
    pending = requestAnimationFrame(again);
  };
  const choose = (key, value) => {
    state[key] = value;
    get(key).value = String(value);
    show();
  };
  const enter = () => { // another line: its own settings
    item = items[dims.reduce((sum, dim, place) => sum * dim.values.length + state.place[place], 0)];
    if (!item.valid) return;
    [state.retries, state.timeout, state.noise] = item.start;
    for (const [key, list_] of [["retries", item.retries], ["timeout", item.timeouts], ["noise", item.noises]]) {
      get(key).max = String(list_.length - 1);
      get(key).value = String(state[key]);
    }
  };
  dims.forEach((dim, place) => {
    const part = node("div", { class: "slider" }), label = node("label", { for: dim.key, "data-word": dim.key });
    const named = dim.key === "name";
    const input = named ? node("select", { id: dim.key }) : node("input", { type: "range", id: dim.key, min: "0", max: String(dim.values.length - 1), step: "1" });
    part.hidden = dim.values.length === 1;
    if (named) dim.values.forEach((name, index) => input.append(node("option", { value: String(index) }, name)));
    state.place[place] = dim.start ?? 0;
    input.value = String(state.place[place]);
    input.addEventListener("input", () => {
      state.place[place] = Number(input.value);
      if (!named) input.setAttribute("aria-valuetext", String(dim.values[state.place[place]]));
      enter();
      show();
    });
    part.append(label, input);
    if (!named) part.append(node("output", { id: `${dim.key}-shown`, for: dim.key }));
    get("chosen").append(part);
  });
  for (const key of ["retries", "timeout", "noise"]) get(key).addEventListener("input", () => choose(key, Number(get(key).value)));
  for (const each of document.querySelectorAll("[data-lang]")) each.addEventListener("click", () => { state.lang = each.dataset.lang; show(); });
  get("use").addEventListener("click", () => {
    [state.retries, state.timeout] = item.recommended[state.noise];
    choose("timeout", state.timeout);
    choose("retries", state.retries);
  });
  get("controls").addEventListener("submit", (event) => event.preventDefault());
  // "sv" writes a date as 2026-03-31.
  addEventListener("beforeprint", () => { get("printed").textContent = word("printed", { date: new Date().toLocaleDateString("sv") }); });
  enter();
  show();
  cancelAnimationFrame(pending);
  start(kinds);
})();
