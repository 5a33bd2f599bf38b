"use strict";
(() => {
  const { payload, css, node, ofSetting, ofRuns } = charts;
  const get = (id) => document.getElementById(id);
  const token = location.hash.slice(1);
  const KEPT_IN_TAB = "bussim-line";
  const GOALS = ["goal-errors", "goal-ride", "goal-dead", "goal-heartbeat"];
  let lang = payload.lang, limits = {}, n = 0, range = 0, runId = null, runOf = -1, begun = false, ended = false;
  // What the user has: the file's text, and the fields that were changed since.
  let line = { text: "", name: "", id: null, hash: null, form: {}, bus: "", without: false, example: false };
  let past = [], checked = null, law = null, sized = null, kept = null, run = null, gaps = null;

  // ---- words ----
  const fill = (text, values) => text.replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
  const word = (key, values = {}) => fill(payload.words[lang][key], values);
  const has = (key) => key in payload.words[lang];
  const number = (value, most = 3) => value.toLocaleString("en", { maximumFractionDigits: most });
  // Rounded to the safe side: times and rates up, what passes down.
  const time = (value) => (value === null || value === undefined ? "–" : `${number(Math.ceil(value * 10 - 1e-6) / 10, 1)} ms`);
  const whole = (value) => (value === null || value === undefined ? "–" : `${number(Math.floor(value + 1e-6), 0)} ms`);
  const rate = (value, goal = Infinity) => {
    if (value === null || value === undefined) return "–";
    if (value < 1e-3) return word("never");
    for (let digits = 1; ; digits++) { // with more digits where one would exceed the goal although the figure does not
      const step = 10 ** (Math.floor(Math.log10(value)) + 1 - digits), up = Number((Math.ceil(value / step - 1e-9) * step).toPrecision(digits));
      if (up <= goal || value > goal || digits > 12) return up >= 1e9 ? up.toExponential(0) : up.toLocaleString("en", { maximumSignificantDigits: digits });
    }
  };
  const oneIn = (ber) => (1 / ber).toLocaleString("en", { maximumSignificantDigits: 2 });
  const setting = (of) => word("link.is", { retries: of.D8179, units: of.D8180 });

  // ---- asking ----
  const post = async (path, body = {}) => {
    let response;
    try {
      response = await fetch(`/api/${path}`, { method: "POST", body: JSON.stringify(body),
        headers: { "Content-Type": "application/json", "X-Bussim-Token": token } });
    } catch {
      gone(true);
      throw { key: "gone", text: word("gone"), values: {} };
    }
    gone(false);
    if (response.ok) return response;
    const { error } = await response.json();
    throw error;
  };
  const ask = async (path, body) => (await post(path, body)).json();
  // The field of a form, by the path of what was asked.
  const fieldName = (path = "") => {
    const last = path.split(".").pop().replace(/_[sh]$/, ""), key = [last, `${last}_ms`].find(has);
    return key ? word(key) : `${/^\d+$/.test(last) ? `${word("station")} ` : ""}${last}`;
  };
  const said = (error) => (error.key === "body" ? word("body", { name: fieldName(error.values.field) }) : error.key && has(error.key) ? word(error.key, { ...error.values, text: error.text }) : word("fault", { text: error.text ?? String(error) }));
  let retrying = 0;
  const gone = (is) => {
    if (ended) return;
    get("gone").hidden = !is;
    const changes = Object.entries(line.form).map(([key, each]) => `${word(has(key) ? key : "line_name")}: ${typeof each === "object" ? JSON.stringify(each) : each}`);
    if (is) get("gone").textContent = [word("gone"), changes.length ? word("gone_unsaved", { changes: changes.join(word("comma")) }) : ""].filter(Boolean).join(word("space"));
    clearTimeout(retrying);
    if (is) retrying = setTimeout(() => (begun ? ask("list").then(refresh, () => {}) : begin()), 2000);
  };
  // One question of a kind is under way, and only the newest one waits; after so long it waits no more.
  const LONG = 1500;
  class Lane {
    constructor(path, use) { Object.assign(this, { path, use, wanted: null, busy: 0, begun: 0, last: 0, timer: 0 }); }
    ask(body) { this.wanted = body; this.next(); }
    async next() {
      clearTimeout(this.timer);
      if (!this.wanted || this.busy > 1) return;
      const left = this.busy ? this.begun + LONG - performance.now() : 0;
      if (left > 0) { this.timer = setTimeout(() => this.next(), left); return; }
      const body = this.wanted;
      this.wanted = null;
      this.busy += 1;
      this.begun = performance.now();
      let found = null, refused = null;
      try { found = await ask(this.path, body); } catch (error) { refused = error; }
      if (body.n >= this.last && !(refused && this.wanted)) { this.last = body.n; this.use(found, refused); }
      this.busy -= 1;
      this.next();
    }
  }
  const goals = () => {
    const value = (id) => (get(id).validity.badInput ? NaN : get(id).value === "" ? null : Number(get(id).value)), found = [];
    if (value("goal-errors") !== null) found.push(`errors<=${value("goal-errors")}/y`);
    if (value("goal-ride") !== null) found.push(value("goal-ride") ? `ride>=${value("goal-ride")}ms` : "ride>=0");
    if (value("goal-dead") !== null) found.push(`dead<=${value("goal-dead")}ms`);
    if (value("goal-heartbeat") !== null) found.push(`heartbeat=${value("goal-heartbeat")}ms@0.1/y`);
    return found;
  };
  const question = () => ({ text: line.text, name: line.name || "line.yaml", form: line.form, bus: line.bus, beside: line.id, without_faults: line.without, lang, n });
  const lanes = {
    law: new Lane("law", (found, error) => {
      if (error) return error.key === "gone" ? busy() : problems(error);
      law = found;
      checked = found.form;
      if (line.fresh) { get("duration").value = String(checked.duration_s); line.fresh = false; }
      problems(null);
      showLaw();
    }),
    size: new Lane("size", (found, error) => {
      get("goals-bad").hidden = error?.key !== "goal";
      if (error) { get("goals-bad").textContent = said(error); busy(); return; }
      sized = found;
      showSize();
    }),
    refresh: new Lane("refresh", (found) => { if (found) { gaps = found; showGaps(); } }),
  };
  let later = 0, calm = 0, slow = 0;
  const refresh = () => {
    n += 1;
    lanes.law.ask(question()); // first, so that it is answered while the rest is done
    keepInTab();
    busy();
    clearTimeout(later);
    clearTimeout(calm);
    later = setTimeout(() => lanes.size.ask({ ...question(), goals: goals() }), 40);
    calm = setTimeout(() => { if (get("gaps").open) lanes.refresh.ask(question()); followForm(); }, 300);
  };
  // What is not of the line as it is now is marked.
  const busy = () => {
    const bad = !get("problems").hidden;
    for (const [ids, found] of [[["curve"], law], [["verdict", "trade", "table", "recommended"], sized]])
      for (const id of ids) get(id).setAttribute("aria-busy", String(bad || found?.n !== n));
    for (const id of ["tiles", "strip"]) get(id).setAttribute("aria-busy", String(bad || law?.n !== n || sized?.n !== n));
    clearTimeout(slow);
    get("working").hidden = true;
    if (!bad && (law?.n !== n || sized?.n !== n)) slow = setTimeout(() => { get("working").hidden = false; }, 1000);
  };
  // A place in the text is gone to by a click; one in a file beside it is named.
  const placed = (each) => {
    const item = node("li");
    if (each.line && each.file === question().name) {
      const jump = node("button", { type: "button", class: "jump" }, word("at_line", each));
      jump.addEventListener("click", () => jumpTo(each));
      item.append(jump);
    } else item.textContent = each.line ? word("in_file", each) : each.message;
    return item;
  };
  const problems = (error) => {
    const all = error?.values?.problems ?? (error ? [{ field: error.values?.field?.split(".").pop() ?? "", message: said(error) }] : []);
    for (const each of all) if (!each.line || each.field in line.form) { // a number box that is out of its range
      const box = get(`${each.field}-box`);
      if (box && !box.validity.valid) Object.assign(each, { line: 0, message: word("range", { field: word(each.field), least: box.min, most: box.max }) });
    }
    const found = all.filter((each, place) => each.line || all.findIndex(({ message }) => message === each.message) === place);
    // What is wrong in the text is mended there: until then its fields stay as they are.
    const isKnown = checked?.stations !== undefined;
    get("controls").dataset.known = String(isKnown);
    get("controls").toggleAttribute("inert", !isKnown || found.some((each) => each.line && !(each.field in line.form)));
    for (const each of document.querySelectorAll("[data-field]")) {
      const here = found.filter(({ field }) => field === each.dataset.field), text = get(`${each.dataset.field}-bad`);
      for (const input of each.querySelectorAll("input, select")) input.setAttribute("aria-invalid", String(here.length > 0));
      if (text) { text.hidden = !here.length; text.textContent = here.map(({ message }) => message).join(" "); }
    }
    const name = found.find(({ field }) => field === "name");
    get("name-bad").hidden = !name;
    get("name-bad").textContent = name?.message ?? "";
    get("problems").hidden = !found.length;
    get("problems").replaceChildren(...(found.length ? [node("li", {}, word("mistakes"))] : []), ...found.map(placed));
    busy();
  };
  // ---- the text: the form's changes are in it while nobody types there ----
  let written = { area: "", form: {} };
  const fillText = (text, form = {}) => { get("yaml").value = text; written = { area: get("yaml").value, form }; };
  const isTyped = () => get("yaml").value !== written.area;
  // A text area has line feeds alone, whatever the file has.
  const typedText = () => (/\r\n/.test(line.text) && !/[^\r]\n/.test(line.text) ? get("yaml").value.replaceAll("\n", "\r\n") : get("yaml").value);
  const followForm = async () => {
    if (!get("yaml-part").open || !get("problems").hidden || isTyped()) return;
    const { form } = line, asked = n, found = await ask("edit", question()).catch(() => null);
    if (found && asked === n && !isTyped()) fillText(found.text, form);
  };
  const takeText = () => { // and what was moved since it was written there
    const text = typedText(), moved = Object.entries(line.form).filter(([key, each]) => JSON.stringify(each) !== JSON.stringify(written.form[key]));
    past.push(JSON.stringify(line));
    Object.assign(line, { text, form: Object.fromEntries(moved), unsaved: true, example: false });
    fillText(text);
    refresh();
    showForm();
  };
  const jumpTo = (place) => {
    get("yaml-part").open = true;
    const area = get("yaml"), rows = area.value.split("\n");
    const at = rows.slice(0, place.line - 1).reduce((sum, row) => sum + row.length + 1, 0) + Math.max(0, place.column - 1);
    area.focus();
    area.setSelectionRange(at, at + 1);
    area.scrollTop = Math.max(0, (place.line - 4) * (area.scrollHeight / rows.length));
  };

  // ---- the form ----
  const SLIDERS = ["stations", "retries", "timeout", "scan"];
  const dirty = () => Object.keys(line.form).length > 0 || line.unsaved === true || isTyped();
  const set = (changes) => {
    past.push(JSON.stringify(line));
    past = past.slice(-200);
    line.form = { ...line.form, ...changes };
    for (const [key, value] of Object.entries(changes)) if (value === undefined) delete line.form[key];
    line.example = false;
    refresh();
    showForm();
  };
  const value = (key) => line.form[key] ?? checked?.[key];
  const attribute = (element, name, wanted) => { if (element.getAttribute(name) !== String(wanted)) element.setAttribute(name, wanted); };
  const put = (input, wanted) => { if (document.activeElement !== input && input.value !== String(wanted)) input.value = String(wanted); };
  const texts = {
    stations: () => "",
    retries: () => (law?.figures && law.n === n ? word("link.retries", { retries: value("retries"), attempts: law.figures.attempts }) : ""),
    timeout: () => word("link.timeout", { units: value("timeout"), timeout: `${10 * value("timeout")} ms` }),
    scan: () => (checked && new Set(checked.scans.map(({ mean }) => mean)).size > 1 && line.form.scan === undefined ? word("each_shown") : `${number(value("scan"), 4)} ms`),
  };
  const showForm = () => {
    get("file").textContent = line.example ? "" : dirty() ? word("changed") : line.hash ? word("saved") : "";
    get("hint").textContent = line.example ? word("example") : line.without ? word("left_out") : "";
    get("undo").disabled = !past.length;
    if (!checked) return;
    const linked = checked.stations !== undefined;
    put(get("name"), value("name"));
    document.title = `${value("name")} – bussim`;
    get("bus").parentElement.hidden = checked.links.length < 2;
    get("bus").replaceChildren(...checked.links.map((name) => node("option", { value: name }, name)));
    get("bus").value = checked.bus;
    const things = Object.entries(checked.also).map(([key, many]) => word(`also.${key}`, { many }));
    get("also").textContent = [linked ? "" : word("none_here"), things.length ? word("also", { things: things.join(word("comma")) }) : ""].filter(Boolean).join(word("space"));
    if (!linked) return;
    const own = limits.profiles[value("profile")];
    get("timeout").min = get("timeout-box").min = checked.timeout_range[0];
    get("timeout").max = get("timeout-box").max = checked.timeout_range[1];
    for (const key of SLIDERS) {
      if (key === "scan" && value(key) > Number(get(key).max)) get(key).max = Math.ceil(value(key));
      if (get(key).value !== String(value(key))) get(key).value = String(value(key));
      put(get(`${key}-box`), value(key));
      const text = texts[key]();
      get(`${key}-shown`).textContent = text;
      get(key).setAttribute("aria-valuetext", text || String(value(key)));
    }
    get("profile").value = value("profile");
    for (const button of get("mode").children) {
      attribute(button, "aria-pressed", Number(button.dataset.mode) === value("mode"));
      button.hidden = !(button.dataset.mode in (own?.modes ?? {})) && !checked.modes.includes(Number(button.dataset.mode));
    }
    get("mode-shown").textContent = word("mode_carries", Object.values(limits.profiles).map(({ modes }) => modes[value("mode")]).find(Boolean) ?? {});
    for (const button of document.querySelectorAll("[data-reset]")) {
      button.hidden = !(button.dataset.reset in line.form || (button.dataset.reset === "scan" && "scans" in line.form));
      attribute(button, "aria-label", word("reset", { field: word(button.dataset.reset) }));
    }
    showNoise();
    showStations();
  };
  let noiseKind = null;
  const showNoise = () => {
    const noise = value("noise"), kind = noiseKind ?? noise.kind;
    get("kind-file").hidden = checked.noise.kind !== "file" && kind !== "file";
    for (const radio of document.querySelectorAll("input[name=noise]")) radio.checked = radio.value === kind;
    get("rate").hidden = kind !== "ber" && kind !== "burst";
    get("lengths").hidden = kind !== "burst";
    get("counts").hidden = kind !== "counters";
    document.querySelector("label[for=ber]").textContent = word(kind === "burst" ? "ber_in" : "ber");
    if (noise.ber > 0) {
      get("ber").value = String(Math.log10(noise.ber));
      get("ber-shown").textContent = word("noise.rate", { value: oneIn(noise.ber) });
      get("ber").setAttribute("aria-valuetext", get("ber-shown").textContent);
    }
    if (kind === "burst") {
      put(get("good"), (noise.good ?? 10000) / 1000);
      put(get("bad"), noise.bad ?? 20);
    }
  };
  const noiseOf = (kind) => {
    const ber = 10 ** Number(get("ber").value), plainBer = Number(ber.toPrecision(3));
    if (kind === "ber") return { kind, ber: plainBer };
    return { kind, ber: plainBer, good: 1000 * Number(get("good").value || 10), bad: Number(get("bad").value || 20) };
  };
  const named = ({ name, station }) => word(station ? "station_name" : "master_name", { name, station });
  // Rows of stations: made anew only where there are others.
  const showStations = () => {
    const key = JSON.stringify([lang, checked.scans.map(({ name, station }) => [name, station])]);
    const off = value("off");
    if (get("off").dataset.of !== key) {
      get("off").dataset.of = key;
      get("off").replaceChildren(...checked.scans.map((each) => {
        const button = node("button", { type: "button", "data-off": each.name }, named(each));
        button.addEventListener("click", () => set({ off: value("off").includes(each.name) ? value("off").filter((name) => name !== each.name) : [...value("off"), each.name] }));
        return button;
      }));
      get("scans").replaceChildren(...checked.scans.map((each) => {
        const row = node("tr");
        row.append(node("th", { scope: "row" }, named(each)));
        for (const part of ["mean", "jitter"]) {
          const input = node("input", { type: "number", min: "0", step: "any", "data-scan": each.name, "data-part": part });
          input.setAttribute("aria-label", `${named(each)}: ${word(`${part === "mean" ? "scan" : part}_ms`)}`);
          input.addEventListener("input", () => {
            const now = Object.fromEntries(["mean", "jitter"].map((one) => [one, Number(row.querySelector(`[data-part=${one}]`).value)]));
            set({ scans: { ...line.form.scans, [each.name]: now } });
          });
          const place = node("td");
          place.append(input);
          row.append(place);
        }
        return row;
      }));
      get("counted").replaceChildren(...checked.scans.filter(({ station }) => station).map((each) => {
        const row = node("tr");
        row.append(node("th", { scope: "row" }, named(each)));
        for (const [kind, register] of [["master", `D${8203 + each.station}`], ["slaves", "D8203"]]) {
          const place = node("td");
          place.append(node("input", { type: "number", min: "0", max: "32767", step: "1", "data-counts": kind, "data-station": String(each.station),
            "aria-label": `${named(each)}: ${word(kind === "master" ? "at_master" : "at_slave")} ${register}` }));
          row.append(place);
        }
        return row;
      }));
    }
    for (const button of get("off").children) attribute(button, "aria-pressed", off.includes(button.dataset.off));
    for (const each of checked.scans) for (const input of get("scans").querySelectorAll(`[data-scan="${CSS.escape(each.name)}"]`)) put(input, each[input.dataset.part]);
  };
  for (const key of SLIDERS) {
    const numbered = (input) => (input.value === "" ? undefined : Number(input.value));
    get(key).addEventListener("input", () => set({ [key]: numbered(get(key)), ...(key === "scan" ? { scans: undefined } : {}) }));
    get(`${key}-box`).addEventListener("input", () => {
      if (get(`${key}-box`).value !== "") set({ [key]: numbered(get(`${key}-box`)), ...(key === "scan" ? { scans: undefined } : {}) });
    });
    get(`${key}-box`).addEventListener("blur", showForm);
    get(key).addEventListener("change", () => { range = 0; drawCharts(); });
  }
  get("profile").addEventListener("change", () => { // with a mode that it has
    const profile = get("profile").value, modes = Object.keys(limits.profiles[profile].modes).map(Number);
    set({ profile, ...(modes.includes(value("mode")) ? {} : { mode: Math.max(...modes) }) });
  });
  get("bus").addEventListener("change", async () => { // what was moved of the other link goes into the text
    if (isTyped()) takeText();
    const bus = get("bus").value, found = await ask("edit", question()).catch(() => null);
    if (!found) { get("bus").value = checked.bus; return; }
    past.push(JSON.stringify(line));
    Object.assign(line, { text: found.text, unsaved: dirty(), form: {}, bus });
    fillText(line.text);
    range = 0;
    refresh();
  });
  get("name").addEventListener("input", () => set({ name: get("name").value }));
  for (const radio of document.querySelectorAll("input[name=noise]")) radio.addEventListener("change", () => {
    noiseKind = radio.value;
    if (radio.value === "file") { noiseKind = null; set({ noise: undefined }); return; }
    if (radio.value === "counters") { showNoise(); return; }
    noiseKind = null;
    if (radio.value !== "unknown" && !(value("noise").ber > 0)) get("ber").value = radio.value === "ber" ? "-5" : "-2";
    range = 0;
    set({ noise: radio.value === "unknown" ? { kind: "unknown" } : noiseOf(radio.value) });
  });
  for (const id of ["ber", "good", "bad"]) get(id).addEventListener("input", () => set({ noise: noiseOf(value("noise").kind) }));
  get("work-out").addEventListener("click", async () => {
    const counts = { master: {}, slaves: {} };
    for (const input of document.querySelectorAll("[data-counts]")) if (input.value !== "") counts[input.dataset.counts][input.dataset.station] = Number(input.value);
    try {
      const { form, ...rest } = question(), { noise, ...others } = form;
      get("counters-said").textContent = "…";
      const found = await ask("counters", { ...rest, form: others, ...counts, watched_h: Number(get("watched").value) });
      if (noiseKind !== "counters") return; // the user chose something else meanwhile
      const entries = found.noise_upper_limits;
      const open = found.unlimited.join(word("comma")), taken = found.bursts !== "seen" && !open && entries.length > 0;
      get("counters-said").textContent = found.bursts === "seen" ? word("counters.bursts") : open ? word("counters.unlimited", { names: open }) : word(taken ? "counters.found" : "counters.none");
      if (taken) set({ noise: { kind: "counters", entries } });
    } catch (error) { get("counters-said").textContent = error.values?.problems?.map(({ message }) => message).join(" ") ?? said(error); }
  });
  for (const button of document.querySelectorAll("[data-reset]")) button.addEventListener("click", () => {
    if (button.dataset.reset === "noise") noiseKind = null;
    set({ [button.dataset.reset]: undefined, ...(button.dataset.reset === "scan" ? { scans: undefined } : {}) });
  });
  for (const id of GOALS) get(id).addEventListener("input", refresh);
  get("without").addEventListener("change", () => { line.without = get("without").checked; refresh(); });
  get("undo").addEventListener("click", () => { const wasTyped = isTyped(); line = JSON.parse(past.pop()); noiseKind = null; if (!wasTyped) fillText(line.text); refresh(); showForm(); });
  // A wheel over a box would change its value by accident.
  addEventListener("wheel", ({ target }) => { if (target.matches?.("input[type=number], input[type=range]")) target.blur(); }, { passive: true });

  // ---- answers ----
  const own = () => sized?.rows?.at(-1);
  const noiseUnknown = () => law?.fan?.length > 0;
  const figures = () => {
    const f = law.figures, here = own(), judged = here ?? f, goal = Number(get("goal-errors").value) || 1;
    return {
      mean: [time(f.mean_ms), noiseUnknown() ? word("no_noise") : ""],
      longest: [time(f.worst_case_ms), ""],
      dead: [time(judged.one_dead_ms), ""], // with the noise that the goals are judged by
      detect: [time(judged.detect_ms.mean), word("at_worst", { time: time(judged.detect_ms.max) })],
      errors: [rate(judged.false_errors_per_year, goal), [word("a_year"), !here ? "" : noiseUnknown() ? word("at_bad")
        : judged.false_errors_per_year > f.false_errors_per_year * 1.01 ? word("entered", { value: rate(f.false_errors_per_year) }) : ""].filter(Boolean).join(word("comma"))],
      ride: [whole(f.ride_through_ms.silence), ""],
    };
  };
  const TILES = ["mean", "longest", "dead", "detect", "errors", "ride"];
  const made = (list, names) => {
    if (list.dataset.lang === lang) return;
    list.dataset.lang = lang;
    list.replaceChildren(...names.map((name) => {
      const part = node("div"), shown = node("dd", { "data-figure": name });
      shown.append(node("span"), node("small"), node("small", { class: "kept" }));
      part.append(node("dt", {}, word(`link.${name}`)), shown);
      return part;
    }));
  };
  const showTiles = () => {
    get("strip").hidden = !law?.figures?.valid && !own(); // of a line without a law what sizing knows
    if (get("strip").hidden || !law?.figures) return;
    const shown = figures();
    for (const [list, names] of [[get("tiles"), TILES], [get("strip-figures"), ["mean", "dead", "errors"]]]) {
      made(list, names);
      names.forEach((name, place) => {
        const [text, remark, old] = list.children[place].lastChild.children;
        text.textContent = shown[name][0];
        remark.textContent = shown[name][1];
        old.textContent = kept ? word("kept", { value: kept.shown[name][0] }) : "";
      });
    }
    get("tiles").dataset.n = String(Math.min(law.n, sized?.n ?? 0));
  };
  const showLaw = () => {
    const valid = law.figures?.valid === true;
    for (const id of ["tiles", "curve", "comparing"]) get(id).hidden = !valid;
    get("gaps").hidden = !law.figures;
    get("warnings").replaceChildren(...law.warnings.map(placed));
    get("reasons").hidden = !law.figures || (valid && !line.without);
    get("reasons").firstElementChild.hidden = valid;
    get("reasons-list").replaceChildren(...(law.figures?.reasons ?? []).map((text) => node("li", {}, text)));
    get("without").checked = line.without;
    get("without").parentElement.hidden = !line.without && !law.form.also.faults && law.form.noise?.kind !== "file"; // nothing comes or goes
    get("curve-said").textContent = valid ? word(noiseUnknown() ? "curve.fan" : "curve.one") : "";
    showForm();
    showTiles();
    showNotes();
    if (sized?.sizing?.valid && sized.n === law.n) verdict();
    drawCharts(false);
    busy();
  };
  const verdict = () => {
    const { sizing, goals: wanted } = sized, here = own(), best = sizing.recommended, said_ = get("verdict");
    const forms = Object.fromEntries(wanted.map(({ name, text }) => [name, text])), parts = [];
    if (here) {
      const names = here.misses.length ? here.misses : Object.keys(forms);
      parts.push(word(here.misses.length ? "misses" : "meets", { setting: setting(here), goals: names.map((name) => forms[name]).join(word("comma")) }));
    }
    if (best) parts.push(here && best.D8179 === here.D8179 && best.D8180 === here.D8180 ? word("best") : word("other", { setting: setting(best) }));
    else parts.push(word("none"));
    if (law?.figures?.valid && law.n === sized.n) {
      const shown = figures(), atBad = here && noiseUnknown(); // else the tile's mean: sizing's is the worst of several views of the noise
      parts.push(word(atBad ? "cost_at_bad" : "link.cost", { mean: atBad ? time(here.mean_ms) : shown.mean[0], dead: shown.dead[0], errors: shown.errors[0] }));
    }
    if (checked?.off?.length) parts.push(word("off_said", { names: checked.off.join(word("comma")) }));
    said_.textContent = parts.join(word("space"));
    said_.className = here?.misses.length || !best ? "misses" : "";
  };
  const showSize = () => {
    const sizing = sized.sizing;
    for (const id of ["trade", "recommended", "costs"]) get(id).hidden = !sizing?.valid;
    get("assumed").hidden = !sizing?.assumptions.length;
    get("verdict").hidden = !sizing;
    if (sizing) {
      if (sizing.valid) verdict();
      else { get("verdict").textContent = [word("cannot"), ...sizing.reasons].join(word("space")); get("verdict").className = "plain"; }
      const best = sizing.recommended, here = own();
      get("program").textContent = best ? sizing.mov.map((text, place) => `${text.split("  ;")[0]}  ; ${word(`link.mov${place}`, { attempts: best.attempts, timeout: `${10 * best.D8180} ms` })}`).join("\n") : word("no_setting");
      get("copy").disabled = !best;
      get("use").disabled = !best || (here && best.D8179 === here.D8179 && best.D8180 === here.D8180);
      list("advice", [...new Set([sizing.apart, ...sizing.unmet.flatMap((each) => each.helps ?? []), ...sizing.otherwise])].filter(Boolean));
      get("trade-said").textContent = word("link.trade.said");
      const columns = [["D8179", (row) => row.D8179], ["trade.y", (row) => rate(row.false_errors_per_year)], ["dead", (row) => time(row.one_dead_ms)], ["ride", (row) => whole(row.ride_through_ms)]];
      get("table").tHead.replaceChildren(node("tr"));
      get("table").tHead.rows[0].append(...columns.map(([key]) => node("th", { scope: "col" }, key === "D8179" ? key : word(`link.${key}`))));
      get("table").tBodies[0].replaceChildren(...sized.rows.slice(0, -1).map((row) => {
        const shown = node("tr", row.attempts === here.attempts ? { class: "now" } : {});
        columns.forEach(([key, of], place) => {
          const cell = node(place ? "td" : "th", place ? {} : { scope: "row" });
          if (place) cell.textContent = of(row);
          else {
            const take = node("button", { type: "button" }, String(row.D8179));
            take.addEventListener("click", () => set({ retries: row.D8179 }));
            cell.append(take);
          }
          shown.append(cell);
        });
        return shown;
      }));
      list("assumptions", sizing.assumptions.map((each) => each.text ?? each.in_words ?? `${each.assumption ?? each.name}`));
    }
    const ports = Object.entries(sized.ports ?? {});
    get("ports").hidden = !ports.length;
    list("port-list", ports.map(([name, { recommended: best, reasons }]) => (best
      ? word("port_best", { node: name, timeout: best.timeout_ms, retries: best.retries, interval: best.interval_ms }) : [word("port_none", { node: name }), ...reasons].join(word("comma")))));
    if (!sizing) get("ports").open = true;
    showTiles();
    showNotes();
    drawCharts();
    busy();
  };
  const list = (id, entries) => get(id).replaceChildren(...entries.map((text) => node("li", {}, text)));
  const showNotes = () => {
    const notes = [...new Set([...(law?.figures?.notes ?? []), ...(law?.figures?.not_replying ?? []), ...(sized?.sizing?.notes ?? [])])];
    list("notes", notes);
    get("remarks").hidden = !notes.length;
  };
  const showGaps = () => {
    const rows = Object.entries(gaps.refresh_gap_ms), keys = rows.length ? Object.keys(rows[0][1]) : [];
    get("gap-table").tHead.replaceChildren(node("tr"));
    get("gap-table").tHead.rows[0].append(...["pair", ...keys].map((key) => node("th", { scope: "col" }, has(`gap.${key}`) ? word(`gap.${key}`) : key)));
    get("gap-table").tBodies[0].replaceChildren(...rows.map(([pair, each]) => {
      const row = node("tr");
      row.append(node("th", { scope: "row" }, pair), ...keys.map((key) => node("td", {}, each[key] === null ? "–" : number(each[key], 1))));
      return row;
    }));
  };
  get("gaps").addEventListener("toggle", () => { if (get("gaps").open) lanes.refresh.ask(question()); });

  // ---- charts ----
  const FAN = [["quiet", "--simulated"], ["typical", "--fault"], ["bad", "--error"]];
  const curves = () => {
    const found = noiseUnknown()
      ? law.fan.map((each, place) => ({ law: each.law, colour: css(FAN[place][1]), label: word("level", { level: each.level, value: each.ber < 1e-6 ? (1 / each.ber).toExponential(0).replace("+", "") : oneIn(each.ber) }) }))
      : [{ law: law.law, colour: css("--law"), label: kept ? word("trade.now") : "" }];
    if (kept) found.unshift({ law: kept.law, colour: css("--soft"), label: word("kept_curve") });
    return found;
  };
  const reach = (shown) => {
    const last = Math.max(...shown.map(({ law: [x] }) => x[x.length - 1]));
    if (last > range) range = last * 1.15;
    return range;
  };
  const kinds = ofSetting({
    word,
    kind: (key) => `link.${key}`,
    isSized: () => sized?.sizing?.valid === true,
    curve: () => {
      if (!law?.law?.[0].length) return null;
      const shown = curves(), main = shown[shown.length - 1].law;
      get("curve").dataset.last = JSON.stringify([main[0].at(-1), main[1].at(-1)]);
      get("curve").dataset.curves = String(shown.length);
      return {
        data: uPlot.join(shown.map(({ law: [x, y] }) => [x, y])),
        series: shown.map(({ colour, law: other }) => ({ stroke: colour, width: other === main ? 2.5 : 2, spanGaps: true, points: { show: false } })),
        legend: shown.filter(({ label }) => label).map(({ colour, label }) => [colour, label]),
        whole: [0, reach(shown)],
        description: word("curve.text", { setting: word("link.is", { retries: value("retries"), units: value("timeout") }) }),
        point: (at) => {
          const place = main[0].findLastIndex((x) => x <= at), p = place < 0 ? 1 : main[1][place];
          return word("curve.point", { time: time(at), p: p < 1e-9 || at > main[0].at(-1) ? word("practically") : Number(p.toPrecision(2)) });
        },
      };
    },
    dots: () => {
      const best = sized.sizing.recommended, here = own();
      return (sized.rows ?? []).slice(0, -1).map((row) => ({ x: row.one_dead_ms, y: row.false_errors_per_year, row, label: String(row.D8179),
        isBest: best !== null && best.attempts === row.attempts && best.D8180 === row.D8180, isNow: row.attempts === here.attempts })).concat(
        best && best.D8180 !== here?.D8180 ? [{ x: best.one_dead_ms, y: best.false_errors_per_year, row: best, label: `K${best.D8179}`, isBest: true, isNow: false }] : []);
    },
    goal: () => Number(get("goal-errors").value) || 1,
    choose: ({ row }) => set({ retries: row.D8179, ...(row.D8180 === value("timeout") ? {} : { timeout: row.D8180 }) }),
    tradeText: () => word("trade.text", { setting: own() ? setting(own()) : "" }),
    dotText: ({ row }) => word("trade.point", { setting: setting(row), dead: time(row.one_dead_ms), errors: rate(row.false_errors_per_year) }),
  });
  const drawn = {};
  const draw = (id, kind, data) => {
    if (get(id).hidden || !get(id).querySelector(".plot").clientWidth) return;
    if (!data && drawn[id]) { drawn[id].draw(); return; }
    drawn[id]?.u?.destroy();
    get(id).querySelector(".tools")?.replaceChildren();
    drawn[id] = new kind(get(id), data ?? {});
  };
  let pending = 0, traded = true; // what is traded is of a sizing alone
  const drawCharts = (trade = true) => {
    traded ||= trade;
    cancelAnimationFrame(pending);
    pending = requestAnimationFrame(() => {
      if (law?.law?.[0].length) draw("curve", kinds.curve);
      if (traded && sized?.sizing?.valid) draw("trade", kinds.trade);
      traded = false;
      small();
      const root = document.documentElement;
      root.dataset.drawn = String(law?.n ?? 0);
    });
  };
  // The law of the strip that stays in sight on a narrow page.
  let strip = null, looks = "";
  const small = () => {
    const place = get("strip-law"), isShown = law?.law?.[0].length && place.clientWidth > 0;
    const shown = isShown ? curves() : [], now = JSON.stringify([place.clientWidth, shown.map(({ colour }) => colour)]);
    if (!isShown || now !== looks) {
      strip?.destroy();
      strip = null;
      place.textContent = law?.figures?.valid === false ? get("verdict").textContent : "";
    }
    looks = now;
    if (!isShown) return;
    const data = uPlot.join(shown.map(({ law: [x, y] }) => [x, y]));
    if (strip) { strip.setData(data); return; }
    strip = new uPlot({ width: place.clientWidth, height: 60, legend: { show: false }, cursor: { show: false }, padding: [4, 4, 0, 4],
      scales: { x: { time: false, range: () => [0, range] }, y: { distr: 3, log: 10, range: () => [1e-9, 1.6] } },
      axes: [{ show: false }, { show: false }], series: [{}, ...shown.map(({ colour }) => ({ stroke: colour, width: 1.5, spanGaps: true, points: { show: false } }))],
    }, data, place);
  };
  const redraw = () => { drawCharts(); for (const id of ["histogram", "worst"]) if (drawn[id] && !get(id).hidden) drawn[id].draw(); };
  let width = 0, waiting = 0;
  new ResizeObserver(() => {
    if (document.documentElement.clientWidth === width) return;
    width = document.documentElement.clientWidth;
    clearTimeout(waiting);
    waiting = setTimeout(() => { get("menu").open = width > 830; redraw(); }, 60);
  }).observe(document.documentElement);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

  // ---- what is recommended, kept, printed ----
  get("use").addEventListener("click", () => set({ retries: sized.sizing.recommended.D8179, timeout: sized.sizing.recommended.D8180 }));
  get("copy").addEventListener("click", async () => {
    await navigator.clipboard.writeText(get("program").textContent);
    get("copied").textContent = word("copied");
  });
  get("keep").addEventListener("click", () => {
    if (!law?.law?.[0].length || law.n !== n) return;
    kept = { law: curves().at(-1).law, shown: figures() };
    get("forget").hidden = false;
    showTiles();
    drawCharts();
  });
  get("forget").addEventListener("click", () => { kept = null; get("forget").hidden = true; showTiles(); drawCharts(); });
  const show = async (button, body) => {
    button.disabled = true;
    try {
      const { url } = await ask("report", body);
      get("made-link").href = url;
      get("made").hidden = false;
      if (open(url, "_blank", "noopener")) get("made").hidden = true;
    } catch (error) { get("run-said").textContent = said(error); }
    button.disabled = false;
  };
  get("print").addEventListener("click", () => show(get("print"), { ...question(), goals: goals() }));
  get("report").addEventListener("click", () => show(get("report"), { ...question(), goals: [], run: run.id }));

  // ---- simulate ----
  const shownRun = () => {
    const bus = checked?.bus ?? "", times = run.histograms[bus], scene = run.worst[bus], link = run.links[bus];
    get("ran").hidden = false;
    list("run-verdict", [...run.verdict, ...run.warnings.filter((text) => !law?.warnings.some(({ message }) => message === text)),
      ...(link && run.means[bus] && link.scan_time_ms.mean !== null ? [word("means", { simulated: `${number(link.scan_time_ms.mean)} ms`, exact: `${number(run.means[bus])} ms` })] : [])]);
    get("histogram").hidden = !times;
    get("worst").hidden = !scene;
    if (times) draw("histogram", ofRuns.histogram, { ...times, description: word("histogram") });
    if (scene) { draw("worst", ofRuns.timeline, { ...scene, description: word("worst") }); get("worst-said").textContent = scene.why.join(" "); }
  };
  const event = (each, total) => {
    const text = get("run-said");
    if (each.event === "started") { runId = each.id; text.textContent = word("starting"); }
    if (each.event === "progress") {
      get("progress").value = each.done;
      text.textContent = word("running", { simulated: number(each.simulated_s, 0), total: number(total), left: number(Math.ceil(each.left_s), 0) }) + (runOf === n ? "" : ` ${word("of_another")}`);
    }
    if (each.event === "stopped") text.textContent = word("stopped");
    if (each.event === "failed") text.textContent = word("failed", each);
    if (each.event === "finished") {
      run = each;
      text.textContent = word("finished", each) + (runOf === n ? "" : ` ${word("of_another")}`);
      shownRun();
    }
    text.dataset.event = each.event;
  };
  get("run").addEventListener("click", async () => {
    const total = get("duration").value === "" ? 60 : Number(get("duration").value), seed = get("seed").value;
    runOf = n;
    get("run").hidden = true;
    get("stop").hidden = get("progress").hidden = false;
    get("progress").value = 0;
    get("run-said").dataset.event = "";
    try {
      const response = await post("run", { ...question(), duration_s: total, seed: seed === "" ? null : Number(seed), trace: get("trace").checked });
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      let rest = "", last = "";
      for (;;) {
        const { value: part, done } = await reader.read();
        if (done) break;
        const rows = (rest + part).split("\n");
        rest = rows.pop();
        for (const row of rows) { const each = JSON.parse(row); last = each.event; event(each, total); }
      }
      if (!["finished", "failed", "stopped"].includes(last)) event({ event: "failed", text: word("gone") });
    } catch (error) {
      get("run-said").textContent = error.values?.problems?.map(({ message }) => message).join(" ") ?? (error.key ? said(error) : word("failed", { text: String(error) }));
      get("run-said").dataset.event = "failed";
    }
    runId = null;
    get("run").hidden = false;
    get("stop").hidden = get("progress").hidden = true;
  });
  get("stop").addEventListener("click", () => { if (runId) ask("run/stop", { id: runId }).catch(() => {}); });

  // ---- open, save, YAML ----
  const toggled = (button, panel) => button.addEventListener("click", async () => {
    get(panel).hidden = !get(panel).hidden;
    button.setAttribute("aria-expanded", String(!get(panel).hidden));
    if (panel === "opening" && !get(panel).hidden) ask("list").then((found) => entries(found.entries), cannotOpen);
    if (panel === "saving") { get("target").value ||= line.name && /\.ya?ml$/i.test(line.name) ? line.name : "line.yaml"; get("target").focus(); }
  });
  toggled(get("open"), "opening");
  toggled(get("save"), "saving");
  const take = (found) => {
    get("open-bad").hidden = true;
    line = { text: found.text, name: found.name, id: found.id, hash: found.hash, form: {}, bus: "", without: false, example: found.name === "", fresh: true };
    past = []; noiseKind = null; range = 0; kept = null; checked = null; run = null;
    get("forget").hidden = true;
    get("ran").hidden = get("opening").hidden = get("saving").hidden = true;
    fillText(found.text);
    get("target").value = "";
    get("run-said").textContent = "";
    refresh();
  };
  const cannotOpen = (error) => { get("open-bad").hidden = false; get("open-bad").textContent = said(error); };
  const mayLeave = (key = "discard") => !dirty() || confirm(word(key));
  const entries = (rows) => {
    get("entries").replaceChildren(...rows.map((each) => {
      const item = node("li"), button = node("button", { type: "button", "data-entry": each.name }, each.name);
      button.addEventListener("click", async () => {
        if (!mayLeave()) return;
        try { take(await ask("open", { id: each.id })); } catch (error) { cannotOpen(error); }
      });
      item.append(button, node("span", {}, each.about ? ` ${word("built_in", { about: each.about })}` : ""));
      return item;
    }));
  };
  get("chosen-file").addEventListener("change", async () => {
    const [file] = get("chosen-file").files;
    if (file && mayLeave()) {
      const bytes = await file.arrayBuffer();
      try { take({ text: new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(bytes), name: file.name, id: null, hash: null }); } catch { cannotOpen({ key: "unreadable", values: { name: file.name } }); }
    }
    get("chosen-file").value = "";
  });
  get("save-now").addEventListener("click", async () => {
    const bad = get("save-bad"), target = get("target").value.trim();
    bad.hidden = true;
    if (isTyped()) takeText();
    try {
      const found = await ask("save", { ...question(), target, expected: target === line.name ? line.hash : null });
      Object.assign(line, { text: found.text, name: found.name, id: found.id, hash: found.hash, form: {}, unsaved: false, example: false });
      get("saving").hidden = true;
      get("save").setAttribute("aria-expanded", "false");
      fillText(line.text);
      refresh();
    } catch (error) {
      bad.hidden = false;
      bad.textContent = error.key === "name" ? word("name_bad") : said(error);
    }
  });
  get("apply").addEventListener("click", takeText);
  get("yaml").addEventListener("input", () => { keepInTab(); showForm(); });
  get("yaml-part").addEventListener("toggle", followForm);
  const keepInTab = () => {
    const kept_ = { line, lang, goals: GOALS.map((id) => get(id).value), typed: isTyped() ? { written, area: get("yaml").value } : null };
    try { sessionStorage.setItem(KEPT_IN_TAB, JSON.stringify(kept_)); } catch { sessionStorage.removeItem(KEPT_IN_TAB); /* too large; no older line instead */ }
  };
  get("quit").addEventListener("click", async () => {
    if (!mayLeave("discard_quit")) return;
    ended = true;
    await ask("quit").catch(() => {});
    get("gone").hidden = false;
    get("gone").textContent = word("quitted");
  });

  // ---- the whole page ----
  const speak = () => {
    charts.speech.lang = lang;
    document.documentElement.lang = lang === "zh" ? "zh-Hans" : "en";
    charts.speech.lang = lang;
    for (const each of document.querySelectorAll("[data-word]")) each.textContent = word(each.dataset.word);
    for (const each of document.querySelectorAll("[data-lang].chosen, button[data-lang]")) each.setAttribute("aria-pressed", String(each.dataset.lang === lang));
    get("folder").textContent = word("folder", { folder: limits.folder });
    for (const chart of Object.values(drawn)) chart.u?.destroy();
    for (const key of Object.keys(drawn)) delete drawn[key];
    if (law) showLaw();
    if (sized) showSize();
    if (run) shownRun();
  };
  for (const each of document.querySelectorAll("button[data-lang]")) each.addEventListener("click", async () => {
    lang = each.dataset.lang;
    speak();
    refresh();
    if (!run) return;
    const found = await ask("run/said", { id: run.id, lang }).catch(() => null);
    if (!found || run?.id !== found.id) return;
    run = found;
    if (get("run-said").dataset.event === "finished") event(found); else shownRun();
  });
  get("controls").addEventListener("submit", (event_) => event_.preventDefault());
  const begin = async () => {
    try { limits = await ask("hello"); } catch (error) {
      get("gone").hidden = false;
      get("gone").textContent = said(error);
      return;
    }
    get("profile").replaceChildren(...Object.keys(limits.profiles).map((name) => node("option", { value: name }, name)));
    get("mode").replaceChildren(...[...new Set(Object.values(limits.profiles).flatMap(({ modes }) => Object.keys(modes)))].sort().map((mode) => {
      const button = node("button", { type: "button", "data-mode": mode }, mode);
      button.addEventListener("click", () => set({ mode: Number(mode) }));
      return button;
    }));
    get("menu").open = document.documentElement.clientWidth > 830;
    const saved = JSON.parse(sessionStorage.getItem(KEPT_IN_TAB) ?? "null");
    if (saved) {
      ({ line, lang } = saved);
      saved.goals.forEach((text, place) => { get(GOALS[place]).value = text; });
      fillText(line.text);
      if (saved.typed) { written = saved.typed.written; get("yaml").value = saved.typed.area; get("yaml-part").open = true; }
      speak();
      refresh();
    } else {
      speak();
      take(limits.opened);
      if (limits.bad) { get("open").click(); cannotOpen(limits.bad); }
    }
    begun = true;
    document.documentElement.dataset.ready = "true";
  };
  begin();
})();
