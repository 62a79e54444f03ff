"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const NAMES = {measured: "measured", delivered: "as delivered", refitted: "refitted", physics: "with the physics"};
  const HIDDEN = new Set(["refitted"]);
  const pick = {}, NS = "http://www.w3.org/2000/svg", ROOM = {left: 62, right: 12, top: 10, bottom: 40};
  let zoom = null, overZoom = null, start = null;

  const byId = id => document.getElementById(id);
  const unpack = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
  const unit = name => data.units[name] ? ` [${data.units[name]}]` : "";
  const short = x => x === null || !isFinite(x) ? "–" : String(+x.toPrecision(4)).replace("-", "−");

  function make(tag, attributes, parent, text) {
    const node = document.createElementNS(NS, tag);
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    if (text !== undefined) node.textContent = text;
    if (parent) parent.appendChild(node);
    return node;
  }

  function ticks(low, high, count) {
    const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].find(k => k * power >= raw) * power, made = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) made.push(+(k * step).toPrecision(12));
    return made;
  }

  function extent(lines, xRange) {
    let low = Infinity, high = -Infinity;
    for (const {x, y} of lines) for (let i = 0; i < x.length; i++) {
      if (x[i] < xRange[0] || x[i] > xRange[1] || y[i] === null || !isFinite(y[i])) continue;
      if (y[i] < low) low = y[i];
      if (y[i] > high) high = y[i];
    }
    if (low > high) [low, high] = [-1, 1];
    const pad = (high - low) * 0.06 || Math.abs(high) * 0.05 || 1;
    return [low - pad, high + pad];
  }

  /* One figure: lines with x and y, dots, means with intervals, shaded stretches of x (spans) and of y (bands). */
  function draw(id, chart) {
    const box = byId(id), wide = Math.max(280, box.clientWidth), high = chart.high;
    const seen = chart.lines.filter(line => !HIDDEN.has(line.kind));
    const [x0, x1] = chart.range, [y0, y1] = extent([...seen, ...(chart.means || []).filter(m => !HIDDEN.has(m.kind))], chart.range);
    const px = x => ROOM.left + (x - x0) / (x1 - x0) * (wide - ROOM.left - ROOM.right);
    const py = y => high - ROOM.bottom - (y - y0) / (y1 - y0) * (high - ROOM.top - ROOM.bottom);
    const clip = `clip-${id}`;
    box.replaceChildren();
    if (chart.keys) box.appendChild(keys(chart.keys));
    const svg = make("svg", {viewBox: `0 0 ${wide} ${high}`, role: "img", "aria-label": chart.says}, null);
    box.appendChild(svg);
    make("rect", {x: ROOM.left, y: ROOM.top, width: wide - ROOM.left - ROOM.right, height: high - ROOM.top - ROOM.bottom},
      make("clipPath", {id: clip}, make("defs", {}, svg)));
    for (const y of ticks(y0, y1, 4)) {
      make("line", {class: "grid", x1: ROOM.left, x2: wide - ROOM.right, y1: py(y), y2: py(y)}, svg);
      make("text", {x: ROOM.left - 6, y: py(y) + 4, "text-anchor": "end"}, svg, short(y));
    }
    for (const x of ticks(x0, x1, Math.max(3, Math.min(10, wide / 90)))) {
      make("line", {class: "grid", x1: px(x), x2: px(x), y1: ROOM.top, y2: high - ROOM.bottom}, svg);
      make("text", {x: px(x), y: high - ROOM.bottom + 16, "text-anchor": "middle"}, svg, short(x));
    }
    const inside = make("g", {"clip-path": `url(#${clip})`}, svg);
    for (const s of chart.spans || []) {
      const a = px(Math.max(x0, s.from)), b = px(Math.min(x1, s.to));
      if (b > a) make("title", {}, make("rect", {class: `shade f${s.place % 4}`, x: a, width: b - a, y: ROOM.top, height: high - ROOM.top - ROOM.bottom}, inside), s.name);
    }
    for (const s of chart.bands || []) {
      const a = py(Math.min(y1, s.to)), b = py(Math.max(y0, s.from));
      if (b > a) make("title", {}, make("rect", {class: `shade f${s.place % 4}`, x: ROOM.left, width: wide - ROOM.left - ROOM.right, y: a, height: b - a}, inside), s.name);
    }
    if (y0 < 0 && y1 > 0) make("line", {class: "axis", x1: ROOM.left, x2: wide - ROOM.right, y1: py(0), y2: py(0)}, inside);
    for (const line of seen) {
      let path = "", pen = false;
      for (let i = 0; i < line.x.length; i++) {
        if (!isFinite(line.y[i]) || line.x[i] < x0 || line.x[i] > x1) { pen = false; continue; }
        const at = `${px(line.x[i]).toFixed(1)} ${py(line.y[i]).toFixed(1)}`;
        path += line.dots ? `M${at}h.01` : (pen ? "L" : "M") + at;
        pen = true;
      }
      make("path", {class: line.dots ? `dots ${line.kind}` : line.kind, d: path}, inside);
    }
    for (const m of chart.means || []) {
      if (HIDDEN.has(m.kind)) continue;
      const known = m.y.map((y, i) => i).filter(i => m.y[i] !== null);
      make("path", {class: m.kind, d: known.map((i, k) => `${k ? "L" : "M"}${px(m.x[i]).toFixed(1)} ${py(m.y[i]).toFixed(1)}`).join("")}, inside);
      for (const i of known) {
        if (m.half[i] !== null) make("line", {class: m.kind, x1: px(m.x[i]), x2: px(m.x[i]), y1: py(m.y[i] - m.half[i]), y2: py(m.y[i] + m.half[i])}, inside);
        make("circle", {class: m.kind, cx: px(m.x[i]), cy: py(m.y[i]), r: 3.2}, inside);
      }
    }
    make("text", {x: (ROOM.left + wide - ROOM.right) / 2, y: high - 6, "text-anchor": "middle"}, svg, chart.xLabel);
    make("text", {x: 13, y: (high - ROOM.bottom + ROOM.top) / 2, "text-anchor": "middle", transform: `rotate(-90 13 ${(high - ROOM.bottom + ROOM.top) / 2})`}, svg, chart.yLabel);
    listen(svg, chart, x => x0 + (x - ROOM.left) / (wide - ROOM.left - ROOM.right) * (x1 - x0), px, wide, high);
    byId(`${id}-text`).textContent = chart.says;
    function listen(svg, chart, toX, px, wide, high) {
      const cursor = make("line", {class: "cursor", y1: ROOM.top, y2: high - ROOM.bottom, visibility: "hidden"}, svg);
      const pulled = make("rect", {class: "pull", y: ROOM.top, height: high - ROOM.top - ROOM.bottom, visibility: "hidden"}, svg);
      let from = null;
      const at = event => {
        const frame = svg.getBoundingClientRect(), x = toX((event.clientX - frame.left) * wide / frame.width);
        return Math.min(chart.range[1], Math.max(chart.range[0], x));
      };
      svg.addEventListener("pointerdown", event => {
        if (event.pointerType === "mouse" && event.button === 0) { from = at(event); svg.setPointerCapture(event.pointerId); }
      });
      svg.addEventListener("pointermove", event => {
        const x = at(event);
        cursor.setAttribute("x1", px(x)); cursor.setAttribute("x2", px(x)); cursor.setAttribute("visibility", "visible");
        if (from !== null) {
          pulled.setAttribute("x", px(Math.min(from, x))); pulled.setAttribute("width", Math.abs(px(x) - px(from)));
          pulled.setAttribute("visibility", "visible");
        }
        byId(`${id}-text`).textContent = chart.read(x);
      });
      svg.addEventListener("pointerup", event => {
        const x = at(event), a = from;
        from = null;
        pulled.setAttribute("visibility", "hidden");
        if (a !== null && Math.abs(px(x) - px(a)) > 6) chart.zoom([Math.min(a, x), Math.max(a, x)]);
      });
      svg.addEventListener("pointerleave", () => { cursor.setAttribute("visibility", "hidden"); byId(`${id}-text`).textContent = chart.says; });
      svg.addEventListener("dblclick", () => chart.zoom(null));
    }
  }

  function keys(kinds) {
    const row = document.createElement("div");
    row.className = "keys";
    for (const kind of kinds) {
      const key = document.createElement("button"), ink = document.createElement("span");
      key.type = "button";
      key.setAttribute("aria-pressed", String(!HIDDEN.has(kind)));
      ink.className = `ink ${kind}`;
      key.append(ink, NAMES[kind]);
      key.addEventListener("click", () => { HIDDEN.has(kind) ? HIDDEN.delete(kind) : HIDDEN.add(kind); show(); });
      row.appendChild(key);
    }
    return row;
  }

  function nearest(x, value) {
    let low = 0, high = x.length - 1;
    while (high - low > 1) { const k = (low + high) >> 1; x[k] < value ? low = k : high = k; }
    return value - x[low] < x[high] - value ? low : high;
  }

  function flight(name) {
    const one = data.recordings[name];
    if (!one.held) {
      one.held = {t: unpack(one.t), channels: {}, responses: {}};
      for (const c in one.channels) one.held.channels[c] = unpack(one.channels[c]);
      for (const r in one.responses) {
        one.held.responses[r] = {};
        for (const k in one.responses[r]) one.held.responses[r][k] = unpack(one.responses[r][k]);
      }
    }
    return one.held;
  }

  const less = (a, b) => a.map((x, i) => x - b[i]);
  const reads = (lines, label, u) => x => {
    const i = nearest(lines[0].x, x);
    return `${label(lines[0].x[i])}: ` + lines.filter(l => !HIDDEN.has(l.kind)).map(l => `${l.name} ${short(l.y[i])}`).join(", ") + (u ? ` ${u}` : "");
  };

  function show() {
    const name = pick.recording.value, r = pick.response.value, c = pick.channel.value;
    const one = flight(name), t = one.t, y = one.responses[r];
    const range = zoom || [t[0], t[t.length - 1]], setZoom = z => { zoom = z; show(); };
    const spans = data.findings.flatMap((f, place) => (f.intervals[name] || []).map(([from, to]) => ({from, to, place, name: f.effect})));
    const told = spans.length ? `; shaded: ${spans.map(s => `${s.name} ${short(s.from)} to ${short(s.to)} s`).join(", ")}` : "";
    const time = x => `${name}, t = ${short(x)} s`;
    const lines = ["measured", "delivered", "refitted", "physics"].map(kind => ({x: t, y: y[kind], kind, name: NAMES[kind]}));
    const shared = {range, spans, zoom: setZoom, xLabel: "time [s]"};
    draw("history", {...shared, lines, high: 300, keys: ["measured", "delivered", "refitted", "physics"], yLabel: r + unit(r),
      read: reads(lines, time, data.units[r]), says: `${r} of ${name} over time, measured and simulated${told}.`});
    const left = ["delivered", "refitted", "physics"].map(kind => ({x: t, y: less(y.measured, y[kind]), kind, name: NAMES[kind]}));
    draw("left", {...shared, lines: left, high: 220, yLabel: `difference${unit(r)}`,
      read: reads(left, time, data.units[r]), says: `Measured less simulated ${r} of ${name}, before and after${told}.`});
    if (!c) return;
    const driving = [{x: t, y: one.channels[c], kind: "plainline", name: c}];
    const region = data.findings.flatMap((f, place) => f.region[c] ? [{from: f.region[c][0] ?? -Infinity, to: f.region[c][1] ?? Infinity, place, name: f.effect}] : []);
    draw("channel", {...shared, lines: driving, bands: region, high: 200, yLabel: c + unit(c),
      read: reads(driving, time, data.units[c]), says: `${c} of ${name} over time${region.map(s => `; shaded: where ${s.name} acts`).join("")}.`});
    const bins = data.binned[r][c], stages = ["delivered", "refitted", "physics"];
    const means = stages.map(kind => ({x: bins.at, y: bins.means[kind], half: bins.half[kind], kind, name: NAMES[kind]}));
    const dots = ["delivered", "physics"].map(kind => ({...cloud(r, c, kind), kind, dots: true}));
    const whole = data.first[c][1] > data.first[c][0] ? data.first[c] : [data.first[c][0] - 1, data.first[c][0] + 1];
    const pad = 0.02 * (whole[1] - whole[0]);
    draw("over", {range: overZoom || [whole[0] - pad, whole[1] + pad], lines: dots, means, spans: region, high: 340, keys: stages,
      zoom: z => { overZoom = z; show(); }, xLabel: c + unit(c), yLabel: `measured less simulated ${r}${unit(r)}`,
      read: x => {
        const k = nearest(bins.at, x);
        return `Bin at ${c} ${short(bins.at[k])}: ` + means.filter(m => !HIDDEN.has(m.kind)).map(m => `${m.name} ${short(m.y[k])}${m.half[k] === null ? "" : ` ± ${short(+m.half[k].toPrecision(2))}`}`).join(", ");
      },
      says: `Measured less simulated ${r} over ${c}, all recordings, before and after${region.map(s => `; shaded: where ${s.name} acts`).join("")}.`});
  }

  function cloud(r, c, kind) {
    const names = Object.keys(data.recordings), x = [], y = [];
    for (const name of names) {
      const one = flight(name), every = Math.max(1, Math.ceil(one.t.length * names.length / 1600));
      for (let i = 0; i < one.t.length; i += every) {
        x.push(one.channels[c][i]);
        y.push(one.responses[r].measured[i] - one.responses[r][kind][i]);
      }
    }
    return {x, y};
  }

  function fill(id, names) {
    const select = byId(`pick-${id}`);
    for (const name of names) select.add(new Option(name, name));
    select.addEventListener("change", () => { if (id !== "response") overZoom = null; if (id === "recording") zoom = null; show(); });
    pick[id] = select;
  }

  function choose(place) {
    const f = data.findings[place];
    if (!f) return;
    const acts = name => (f.intervals[name] || []).reduce((sum, [a, b]) => sum + b - a, 0);
    const names = Object.keys(data.recordings);
    pick.recording.value = names.reduce((best, name) => acts(name) > acts(best) ? name : best, names[0]);
    if (f.response) pick.response.value = f.response;
    if (f.channel) pick.channel.value = f.channel;
    zoom = overZoom = null;
  }

  fill("recording", Object.keys(data.recordings));
  fill("response", data.responses);
  fill("channel", data.channels);
  choose(0);
  show();
  byId("reset").addEventListener("click", () => { zoom = overZoom = null; show(); });
  for (const button of document.querySelectorAll("[data-finding]")) button.addEventListener("click", () => {
    choose(+button.dataset.finding);
    show();
    byId("figures").scrollIntoView({behavior: "smooth"});
  });
  new ResizeObserver(() => { clearTimeout(start); start = setTimeout(show, 80); }).observe(byId("history"));
})();
