const NS = "http://www.w3.org/2000/svg", MARGIN = {left: 84, right: 20, top: 10, bottom: 40}, DIGIT = 7, PAPER = 720;
const CURSOR = {}, LINKED = {};
let onPaper = false;

const byId = id => document.getElementById(id);
const data = JSON.parse(byId("data").textContent);
const HIDDEN = new Set(data.hidden);
const unpack = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
const unit = name => ` [${(data.units[name] || "–").replaceAll("^2", "²").replaceAll("^3", "³")}]`;
/* Number with significant digits, without an exponent from 0.0001 to 100000. */
function formatNumber(x, digits = 4) {
  if (x === null || !isFinite(x)) return "–";
  const size = Math.abs(x), plain = size === 0 || (size >= 1e-4 && size < 1e5);
  const text = plain ? String(size >= 10 ** digits ? Math.round(x) : +x.toPrecision(digits)) : (+x.toPrecision(3)).toExponential().replace("e+", "e");
  return text.replaceAll("-", "−");
}

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

/* Ticks of x whose labels do not touch each other. */
function ticksOf(x0, x1, width, whole) {
  for (let count = Math.max(3, Math.min(10, width / 70)); ; count /= 1.4) {
    const made = ticks(x0, x1, count).filter(x => !whole || x % 1 === 0);
    const widest = DIGIT * Math.max(0, ...made.map(x => formatNumber(x, 6).length));
    if (made.length < 3 || (made[1] - made[0]) / (x1 - x0) * width > widest + 10) return made;
  }
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

function nearest(x, value) {
  let low = 0, high = x.length - 1;
  while (high - low > 1) { const k = (low + high) >> 1; x[k] < value ? low = k : high = k; }
  return value - x[low] < x[high] - value ? low : high;
}

/* SVG path of a line between two values of x, with one more sample on either side so that it reaches the frame. */
function trace(line, x0, x1, px, py) {
  let path = "", pen = false;
  const {x, y} = line, sorted = !line.dots;
  const from = sorted ? Math.max(0, nearest(x, x0) - 1) : 0;
  const to = sorted ? Math.min(x.length - 1, nearest(x, x1) + 1) : x.length - 1;
  for (let i = from; i <= to; i++) {
    if (!isFinite(y[i]) || y[i] === null || (!sorted && (x[i] < x0 || x[i] > x1))) { pen = false; continue; }
    const at = `${px(x[i]).toFixed(1)} ${py(y[i]).toFixed(1)}`;
    path += line.dots ? `M${at}h.01` : (pen ? "L" : "M") + at;
    pen = true;
  }
  return path;
}

/* One figure: lines with x and y, dots, means with intervals, shaded intervals of x (spans) and of y (bands).
   chart.zoom is called with a range of x, or with null for the full range; chart.redraw after a line was hidden. */
function draw(id, chart) {
  const box = byId(id), wide = onPaper ? PAPER : Math.max(280, box.clientWidth), high = (onPaper ? 0.65 : 1) * chart.high;
  const focused = box.contains(document.activeElement) ? document.activeElement.dataset.key : undefined;
  const shown = chart.lines.filter(line => !HIDDEN.has(line.kind)), means = (chart.means || []).filter(m => !HIDDEN.has(m.kind));
  const [x0, x1] = chart.range, [y0, y1] = extent([...shown, ...means], chart.range);
  const left = wide < 480 ? MARGIN.left - 14 : MARGIN.left, right = wide - MARGIN.right, floor = high - MARGIN.bottom;
  const px = x => left + (x - x0) / (x1 - x0) * (right - left);
  const py = y => floor - (y - y0) / (y1 - y0) * (floor - MARGIN.top);
  const clip = `clip-${id}`, caption = byId(`${id}-text`);
  box.replaceChildren();
  const title = document.createElement("p");
  title.className = "title";
  title.textContent = chart.title;
  box.appendChild(title);
  if (chart.lines.length > 1) box.appendChild(legend(chart));
  const svg = make("svg", {viewBox: `0 0 ${wide} ${high}`, role: "application", "aria-roledescription": "chart",
    "aria-label": chart.caption, "aria-describedby": "chart-keys", tabindex: 0, "data-key": "chart"}, null);
  box.appendChild(svg);
  make("rect", {x: left, y: MARGIN.top, width: right - left, height: floor - MARGIN.top}, make("clipPath", {id: clip}, make("defs", {}, svg)));
  for (const y of ticks(y0, y1, 5)) {
    make("line", {class: "grid", x1: left, x2: right, y1: py(y), y2: py(y)}, svg);
    make("text", {x: left - 6, y: py(y) + 4, "text-anchor": "end"}, svg, formatNumber(chart.log ? +(10 ** y).toPrecision(2) : y, 6));
  }
  for (const x of ticksOf(x0, x1, right - left, chart.integers)) {
    make("line", {class: "grid", x1: px(x), x2: px(x), y1: MARGIN.top, y2: floor}, svg);
    make("text", {x: px(x), y: floor + 16, "text-anchor": "middle"}, svg, formatNumber(x, 6));
  }
  const inside = make("g", {"clip-path": `url(#${clip})`}, svg);
  for (const s of chart.spans || []) {
    const a = px(Math.max(x0, s.from)), b = px(Math.min(x1, s.to));
    if (b > a) make("title", {}, make("rect", {class: `shade ${s.place < 0 ? "range" : `f${s.place % 4}`}`, x: a, width: b - a, y: MARGIN.top, height: floor - MARGIN.top}, inside), s.name);
  }
  for (const s of chart.bands || []) {
    const a = py(Math.min(y1, s.to)), b = py(Math.max(y0, s.from));
    if (b > a) make("title", {}, make("rect", {class: `shade f${s.place % 4}`, x: left, width: right - left, y: a, height: b - a}, inside), s.name);
  }
  if (y0 < 0 && y1 > 0 && !chart.log) make("line", {class: "axis", x1: left, x2: right, y1: py(0), y2: py(0)}, inside);
  for (const line of shown) make("path", {class: `${line.dots ? "dots " : ""}${line.style || line.kind}`, d: trace(line, x0, x1, px, py)}, inside);
  /* Few samples are marked. */
  if (chart.marked) for (const line of shown) {
    const from = nearest(line.x, x0), to = nearest(line.x, x1);
    if (to - from < (right - left) / 8) for (let i = from; i <= to; i++) if (isFinite(line.y[i]) && line.x[i] >= x0 && line.x[i] <= x1) {
      make("circle", {class: `sample ${line.style || line.kind}`, cx: px(line.x[i]), cy: py(line.y[i]), r: 2}, inside);
    }
  }
  for (const line of chart.brushed || []) make("path", {class: `brushed ${line.kind}`, d: trace({...line, dots: true}, x0, x1, px, py)}, inside);
  if (chart.integers) for (const line of shown) for (let i = 0; i < line.x.length; i++) {
    if (line.y[i] !== null) make("circle", {class: line.style, cx: px(line.x[i]), cy: py(line.y[i]), r: 2.6}, inside);
  }
  for (const m of means) {
    const known = m.y.map((y, i) => i).filter(i => m.y[i] !== null);
    make("path", {class: m.kind, d: known.map((i, k) => `${k ? "L" : "M"}${px(m.x[i]).toFixed(1)} ${py(m.y[i]).toFixed(1)}`).join("")}, inside);
    for (const i of known) {
      if (m.half[i] !== null) make("line", {class: m.kind, x1: px(m.x[i]), x2: px(m.x[i]), y1: py(m.y[i] - m.half[i]), y2: py(m.y[i] + m.half[i])}, inside);
      make("circle", {class: m.kind, cx: px(m.x[i]), cy: py(m.y[i]), r: 3.2}, inside);
    }
  }
  make("text", {x: (left + right) / 2, y: high - 6, "text-anchor": "middle"}, svg, chart.xLabel);
  make("text", {x: 12, y: (floor + MARGIN.top) / 2, "text-anchor": "middle", transform: `rotate(-90 12 ${(floor + MARGIN.top) / 2})`}, svg, chart.yLabel);

  const cursor = make("line", {class: "cursor", y1: MARGIN.top, y2: floor, visibility: "hidden"}, svg);
  const group = chart.group || id;
  (LINKED[group] ||= {})[id] = x => {
    cursor.setAttribute("visibility", x === null || x < x0 || x > x1 ? "hidden" : "visible");
    if (x !== null) { cursor.setAttribute("x1", px(x)); cursor.setAttribute("x2", px(x)); }
  };
  const point = x => {
    CURSOR[group] = x;
    for (const move of Object.values(LINKED[group])) move(x);
    caption.textContent = x === null ? chart.caption : chart.read(x);
  };
  drag(svg, chart, event => {
    const frame = svg.getBoundingClientRect(), at = (event.clientX - frame.left) * wide / frame.width;
    return Math.min(x1, Math.max(x0, x0 + (at - left) / (right - left) * (x1 - x0)));
  }, px, floor, point);
  svg.addEventListener("keydown", event => onKey(event, chart, point, group));
  caption.textContent = chart.caption;
  if (focused === "chart") {
    svg.focus({preventScroll: true});
    if (CURSOR[group] !== undefined && CURSOR[group] !== null) point(Math.min(x1, Math.max(x0, CURSOR[group])));
  } else if (focused) [...box.querySelectorAll("button")].find(b => b.dataset.key === focused)?.focus({preventScroll: true});
}

function drag(svg, chart, at, px, floor, point) {
  const selected = make("rect", {class: "selected", y: MARGIN.top, height: floor - MARGIN.top, visibility: "hidden"}, svg);
  let from = null;
  svg.addEventListener("pointerdown", event => {
    if (event.pointerType === "mouse" && event.button === 0) { from = at(event); svg.setPointerCapture(event.pointerId); }
    else point(at(event));
  });
  svg.addEventListener("pointermove", event => {
    const x = at(event);
    point(x);
    if (from === null) return;
    selected.setAttribute("x", px(Math.min(from, x)));
    selected.setAttribute("width", Math.abs(px(x) - px(from)));
    selected.setAttribute("visibility", "visible");
  });
  svg.addEventListener("pointerup", event => {
    const x = at(event), a = from;
    from = null;
    selected.setAttribute("visibility", "hidden");
    if (a !== null && Math.abs(px(x) - px(a)) > 6) chart.zoom([Math.min(a, x), Math.max(a, x)]);
  });
  svg.addEventListener("pointerleave", event => { if (event.pointerType === "mouse") point(null); });
  svg.addEventListener("dblclick", () => chart.zoom(null));
}

/* A range scaled about x (a factor above 1 zooms out); shifted by a fraction of its width; limited to the full range. */
const scaleRange = ([a, b], factor, x) => [x - (x - a) * factor, x + (b - x) * factor];
const shiftRange = ([a, b], fraction) => [a + fraction * (b - a), b + fraction * (b - a)];
const clampRange = (range, [low, high]) => {
  const [a, b] = range, size = Math.min(b - a, high - low), from = Math.min(Math.max(a, low), high - size);
  return size >= 0.999 * (high - low) ? null : [from, from + size];
};

function onKey(event, chart, point, group) {
  const [a, b] = chart.range, x = CURSOR[group] ?? 0.5 * (a + b), step = (b - a) * (event.shiftKey ? 0.1 : 0.01);
  const moves = {
    ArrowLeft: () => point(Math.max(a, x - step)), ArrowRight: () => point(Math.min(b, x + step)),
    Home: () => point(a), End: () => point(b),
    "+": () => chart.zoom(clampRange(scaleRange(chart.range, 0.5, x), chart.all)), "=": () => moves["+"](),
    "-": () => chart.zoom(clampRange(scaleRange(chart.range, 2, x), chart.all)),
    PageUp: () => chart.zoom(clampRange(shiftRange(chart.range, -0.5), chart.all)),
    PageDown: () => chart.zoom(clampRange(shiftRange(chart.range, 0.5), chart.all)),
    0: () => chart.zoom(null), Escape: () => { point(null); chart.zoom(null); },
  };
  const action = moves[event.key];
  if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  action();
}

function legend(chart) {
  const row = document.createElement("div");
  row.className = "legend";
  for (const line of new Map([...chart.lines, ...(chart.means || [])].map(l => [l.kind, l])).values()) {
    const key = document.createElement("button"), sample = document.createElement("span");
    key.type = "button";
    key.dataset.key = line.kind;
    key.setAttribute("aria-pressed", String(!HIDDEN.has(line.kind)));
    sample.className = `sample ${line.style || line.kind}`;
    key.append(sample, line.name);
    key.addEventListener("click", () => { HIDDEN.has(line.kind) ? HIDDEN.delete(line.kind) : HIDDEN.add(line.kind); chart.redraw(); });
    row.appendChild(key);
  }
  return row;
}
