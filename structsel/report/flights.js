/* Time histories of every recording and differences over a channel; then the further charts. */
const STAGES = (data.stages || []).map(([kind]) => kind), NAMES = {measured: "measured", ...Object.fromEntries(data.stages || [])};
const pick = {};
let zoom = null, overZoom = null, interval = null;

function flight(name) {
  const one = data.recordings[name];
  if (one.unpacked) return one.unpacked;
  const times = text => Float64Array.from(unpack(text), x => x + one.start);
  const t = times(one.t), own = series => series.t ? times(series.t) : t;
  one.unpacked = {t, channels: {}, responses: {}};
  for (const [c, held] of Object.entries(one.channels)) one.unpacked.channels[c] = {x: own(held), y: unpack(held.y)};
  for (const [r, held] of Object.entries(one.responses)) {
    one.unpacked.responses[r] = {x: own(held)};
    for (const [kind, y] of Object.entries(held.y)) one.unpacked.responses[r][kind] = unpack(y);
  }
  return one.unpacked;
}

const minus = (a, b) => a.map((x, i) => x - b[i]);
const reader = (lines, label, u) => x => {
  const i = nearest(lines[0].x, x);
  return `${label(lines[0].x[i])}: ` + lines.filter(l => !HIDDEN.has(l.kind)).map(l => `${l.name} ${formatNumber(l.y[i])}`).join(", ") + (u ? ` ${u}` : "");
};

function show() {
  const name = pick.recording.value, r = pick.response.value, c = pick.channel.value;
  const one = flight(name), y = one.responses[r];
  const all = [one.t[0], one.t[one.t.length - 1]], range = zoom || all;
  const spans = data.findings.flatMap((f, place) => (f.intervals[name] || []).map(([from, to]) => ({from, to, place, name: f.effect})));
  const findings = spans.length;
  if (c && overZoom) spans.push(...within(one.channels[c], overZoom).map(([from, to]) => ({from, to, place: -1, name: `${c} in the selected range`})));
  if (interval && interval.name === name) spans.push({from: interval.from, to: interval.to, place: -1, name: "selected"});
  const shading = findings ? `; shaded: ${spans.slice(0, findings).map(s => `${s.name} ${formatNumber(s.from)} to ${formatNumber(s.to)} s`).join(", ")}` : "";
  const time = x => `${name}, t = ${formatNumber(x)} s`;
  const shared = {group: "time", range, all, spans, marked: true, zoom: z => { zoom = z; interval = null; show(); }, redraw: show, xLabel: "time [s]"};
  say(name, range, zoom);
  const line = (kind, values) => ({x: y.x, y: values, kind, name: NAMES[kind]});
  const lines = ["measured", ...STAGES].map(kind => line(kind, y[kind]));
  draw("history", {...shared, title: `${name}: ${r}`, lines, high: 300, yLabel: r + unit(r),
    read: reader(lines, time, data.units[r]), caption: `${r} of ${name} over time, measured and ${data.verb}${shading}.`});
  const difference = STAGES.map(kind => line(kind, minus(y.measured, y[kind])));
  draw("difference", {...shared, title: `${name}: measured minus ${data.verb} ${r}`, lines: difference, high: 220, yLabel: `difference${unit(r)}`,
    read: reader(difference, time, data.units[r]), caption: `Measured minus ${data.verb} ${r} of ${name}${shading}.`});
  if (data.innovation) {
    const lines = [{x: y.x, y: y.innovation, kind: "plainline", name: data.innovation}];
    draw("innovation", {...shared, title: `${name}: innovation of ${r}`, lines, bands: [{from: -2, to: 2, place: 0, name: "95 % if the filter model is correct"}], high: 200, yLabel: "innovation [std]",
      read: reader(lines, time, "standard deviations"), caption: `${data.innovation} of ${r} of ${name}; shaded: two standard deviations, which should contain 95 %.`});
  }
  if (!c) return;
  const driving = [{...one.channels[c], kind: "plainline", name: c}];
  const region = data.findings.flatMap((f, place) => f.region[c] ? [{from: f.region[c][0] ?? -Infinity, to: f.region[c][1] ?? Infinity, place, name: f.effect}] : []);
  const where = region.map(s => `; shaded: where ${s.name} acts`).join("");
  draw("channel", {...shared, title: `${name}: ${c}`, lines: driving, bands: region, high: 200, yLabel: c + unit(c),
    read: reader(driving, time, data.units[c]), caption: `${c} of ${name} over time${where}.`});
  const bins = data.binned[r][c], stages = STAGES;
  const means = stages.map(kind => ({x: bins.at, y: bins.means[kind], half: bins.half[kind], kind, name: NAMES[kind]}));
  const ends = [...new Set([stages[0], stages[stages.length - 1]])];
  const dots = ends.map(kind => ({x: scatter("channels", c), y: scatter("residuals", r, kind), kind, name: NAMES[kind], dots: true}));
  const full = data.first[c][1] > data.first[c][0] ? data.first[c] : [data.first[c][0] - 1, data.first[c][0] + 1];
  const pad = 0.02 * (full[1] - full[0]), wide = [full[0] - pad, full[1] + pad];
  const times = zoom || interval ? ends.map(kind => samplesOf(one, r, c, kind, interval && interval.name === name ? [interval.from, interval.to] : range)) : [];
  draw("over", {title: `${listNames(Object.keys(data.recordings))}: measured minus ${data.verb} ${r}`, brushed: times.filter(l => !HIDDEN.has(l.kind)), range: overZoom || wide, all: wide, lines: dots, means, spans: region, high: 340,
    zoom: z => { overZoom = z; show(); }, redraw: show, xLabel: c + unit(c), yLabel: `measured minus ${data.verb} ${r}${unit(r)}`,
    read: x => {
      const k = nearest(bins.at, x);
      return `Bin at ${c} ${formatNumber(bins.at[k])}${data.units[c] ? ` ${data.units[c]}` : ""}: ` + means.filter(m => !HIDDEN.has(m.kind)).map(m => `${m.name} ${formatNumber(m.y[k])}${m.half[k] === null ? "" : ` ± ${formatNumber(+m.half[k].toPrecision(2))}`}`).join(", ") + (data.units[r] ? ` ${data.units[r]}` : "");
    },
    caption: `Measured minus ${data.verb} ${r} over ${c}, all recordings${where}.`});
}

/* Time intervals in which a channel is in a range. */
function within({x, y}, [low, high]) {
  const found = [];
  let from = null;
  for (let i = 0; i <= x.length; i++) {
    const inside = i < x.length && y[i] >= low && y[i] <= high;
    if (inside && from === null) from = i;
    if (!inside && from !== null) { found.push([x[from], x[Math.min(i, x.length - 1)]]); from = null; }
  }
  return found;
}

/* Differences of one recording over a channel, for the samples in a time range. */
function samplesOf(one, r, c, kind, [from, to]) {
  const at = one.channels[c], y = one.responses[r], made = {kind, x: [], y: []};
  for (let i = 0; i < y.x.length; i++) if (y.x[i] >= from && y.x[i] <= to) {
    made.x.push(at.y[nearest(at.x, y.x[i])]);
    made.y.push(y.measured[i] - y[kind][i]);
  }
  return made;
}

const listNames = names => names.length > 4 ? `${names.slice(0, 3).join(", ")} and ${names.length - 3} more` : names.join(", ");

/* The shown or selected time range in words. */
function say(name, range, part) {
  const [from, to] = interval && interval.name === name ? [interval.from, interval.to] : range;
  byId("selection").textContent = part || interval ? `Selected: ${name}, ${formatNumber(from)} to ${formatNumber(to)} s.` : "";
}

/* Show one interval of a recording, with as much time around it. */
function showInterval(name, from, to) {
  const t = flight(name).t, around = Math.max(0.5 * (to - from), 1);
  pick.recording.value = name;
  interval = {name, from, to};
  zoom = clampRange([from - around, to + around], [t[0], t[t.length - 1]]);
  show();
  byId("figures").scrollIntoView({behavior: "smooth"});
}

function scatter(part, name, kind) {
  const packed = kind ? data.scatter[part][name] : data.scatter[part], key = kind || name;
  if (typeof packed[key] === "string") packed[key] = unpack(packed[key]);
  return packed[key];
}

function fill(id, names) {
  const select = byId(`pick-${id}`);
  for (const name of names) select.add(new Option(name, name));
  select.addEventListener("change", () => { if (id !== "response") overZoom = null; if (id === "recording") zoom = interval = null; show(); });
  pick[id] = select;
}

function showFinding(place) {
  const f = data.findings[place];
  if (!f) return;
  pick.recording.value = f.recording || Object.keys(data.recordings)[0];
  if (f.response) pick.response.value = f.response;
  if (f.channel) pick.channel.value = f.channel;
  zoom = overZoom = interval = null;
}

function drawSingle(chart, range) {
  const x = chart.x, all = [x[0], x[x.length - 1] > x[0] ? x[x.length - 1] : x[0] + 1];
  const lines = chart.lines.map(l => ({x, y: l.y, kind: `${chart.id}-${l.name}`, style: l.style, name: l.name}));
  const value = y => chart.log ? 10 ** y : y;
  draw(chart.id, {...chart, lines, high: 240, range: range || all, all, zoom: z => drawSingle(chart, z), redraw: () => drawSingle(chart, range),
    read: at => { const k = nearest(x, at); return `${chart.labels ? chart.labels[k] : `${chart.xLabel} ${x[k]}`}: ` + lines.map(l => `${l.name} ${l.y[k] === null ? "–" : formatNumber(value(l.y[k]))}`).join(", "); }});
}

function whenResized(box, redraw) {
  let waiting = null, before = box.clientWidth;
  new ResizeObserver(() => {
    if (box.clientWidth === before) return;
    before = box.clientWidth;
    clearTimeout(waiting);
    waiting = setTimeout(redraw, 80);
  }).observe(box);
}

/* Paper: charts are drawn for its width. The summary is printed unless everything is asked for. */
const folded = [...document.querySelectorAll("details:not([open])")];
function redraw() {
  if (byId("history")) show();
  for (const chart of data.charts) drawSingle(chart);
}
addEventListener("beforeprint", () => {
  for (const one of folded) { one.dataset.was = one.open; one.open = true; }
  onPaper = true;
  redraw();
});
addEventListener("afterprint", () => {
  for (const one of folded) one.open = one.dataset.was === "true";
  onPaper = false;
  document.body.classList.remove("everything");
  redraw();
});
for (const button of document.querySelectorAll("[data-print]")) button.addEventListener("click", () => {
  document.body.classList.toggle("everything", button.dataset.print === "everything");
  print();
});
for (const chart of data.charts) { drawSingle(chart); whenResized(byId(chart.id), () => drawSingle(chart)); }
if (byId("history")) {
  fill("recording", Object.keys(data.recordings));
  fill("response", data.responses);
  fill("channel", data.channels);
  if (data.start && data.recordings[data.start]) pick.recording.value = data.start;
  showFinding(0);
  show();
  const steps = {
    closer: (range) => scaleRange(range, 0.5, 0.5 * (range[0] + range[1])), wider: (range) => scaleRange(range, 2, 0.5 * (range[0] + range[1])),
    earlier: (range) => shiftRange(range, -0.5), later: (range) => shiftRange(range, 0.5),
  };
  for (const [id, step] of Object.entries(steps)) byId(id).addEventListener("click", () => {
    const t = flight(pick.recording.value).t, all = [t[0], t[t.length - 1]];
    zoom = clampRange(step(zoom || all), all);
    show();
  });
  byId("reset").addEventListener("click", () => { zoom = overZoom = interval = null; show(); });
  for (const button of document.querySelectorAll("[data-finding]")) button.addEventListener("click", () => {
    showFinding(+button.dataset.finding);
    show();
    byId("figures").scrollIntoView({behavior: "smooth"});
  });
  for (const button of document.querySelectorAll("[data-interval]")) button.addEventListener("click", () => {
    showFinding(+button.dataset.interval);
    showInterval(button.dataset.recording, +button.dataset.from, +button.dataset.to);
  });
  /* A recording's name in a table shows the recording. */
  for (const cell of document.querySelectorAll("main tbody th, main td.word")) {
    const name = cell.textContent.replaceAll("\u00a0", " ");
    if (!Object.hasOwn(data.recordings, name)) continue;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "recording";
    button.textContent = name;
    button.title = `Show ${name} in the time histories`;
    button.addEventListener("click", () => {
      pick.recording.value = name;
      zoom = interval = null;
      show();
      byId("figures").scrollIntoView({behavior: "smooth"});
    });
    cell.replaceChildren(button);
  }
  whenResized(byId("history"), show);
}
