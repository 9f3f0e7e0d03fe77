// Curves, areas and points as SVG, with axes; nothing of it is kept between two drawings.

/** How far along an axis a value stands, and back. */
export const SCALES = {
  linear: [(v) => v, (p) => p],
  root: [(v) => Math.sign(v) * Math.sqrt(Math.abs(v)), (p) => Math.sign(p) * p * p],
  log: [Math.log10, (p) => 10 ** p],
};
const LEFT = 58, RIGHT = 12, TOP = 8, BOTTOM = 36;
const escaped = (text) => String(text).replace(/[&<>"]/g, (letter) => `&#${letter.charCodeAt()};`);

/** Round numbers between two ends: at even steps, or where they are even to the eye. */
function ticks([low, high], [to, from]) {
  const round = (size) => [5, 2, 1].map((part) => part * 10 ** Math.floor(Math.log10(size))).find((unit) => unit <= size);
  const found = [];
  for (let at = low, part = 0; at <= high && part < 9; part += 1) {
    const step = round(Math.max(from(to(at) + (to(high) - to(low)) / 5) - at, 1e-12) * 1.01);
    const next = Math.ceil(at / step - 1e-9) * step;
    if (next <= high + 1e-9 * step) found.push(Number(next.toPrecision(6)));
    at = next + step * 0.999;
  }
  return [...new Set(found)];
}

function ends({ ends: given, scale = "linear" }, values) {
  if (given && given[0] < given[1]) return given;
  const known = values.filter(Number.isFinite);
  let [low, high] = known.reduce(([a, b], value) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
  if (!(low <= high)) [low, high] = [0, 1];
  if (low === high) [low, high] = [low - (Math.abs(low) || 1) / 2, high + (Math.abs(high) || 1) / 2];
  return scale === "log" ? [low, high] : [low - 0.03 * (high - low), high + 0.05 * (high - low)];
}

/** Draw lines, areas, spans and points; ``x`` and ``y`` tell label, scale and ends. */
export function chart(where, { title, x, y, lines, points = [], spans = [], height = 240, onspan }) {
  where.classList.add("chart");
  const width = Math.max(where.clientWidth, 240);
  const [sx, sy] = [SCALES[x.scale ?? "linear"], SCALES[y.scale ?? "linear"]];
  const ex = x.ends ?? ends({ scale: "log" }, lines.flatMap((each) => each.x));
  const ey = ends(y, [...lines.flatMap((each) => each.y), ...points.map((each) => each.y)]);
  const place = (value, [to], [low, high], from, size) => from + ((to(value) - to(low)) / (to(high) - to(low))) * size;
  const px = (value) => place(value, sx, ex, LEFT, width - LEFT - RIGHT);
  const py = (value) => place(Math.min(Math.max(value, ey[0]), ey[1]), sy, ey, height - BOTTOM, TOP + BOTTOM - height);
  const drawn = lines.map(({ x: across, y: up, kind }) => {
    const path = across.flatMap((value, row) => (up[row] === null ? [] : [`${px(value).toFixed(1)} ${py(up[row]).toFixed(1)}`]));
    const floor = kind.startsWith("area") ? `L${px(across.at(-1)).toFixed(1)} ${height - BOTTOM}L${px(across[0]).toFixed(1)} ${height - BOTTOM}Z` : "";
    return `<path class="${kind}" d="M${path.join("L")}${floor}"/>`;
  });
  const marks = spans.filter(({ from, to }) => to >= ex[0] && from <= ex[1]).map(({ from, to, code }) =>
    `<rect class="span" x="${px(Math.max(from, ex[0]))}" width="${Math.max(px(Math.min(to, ex[1])) - px(Math.max(from, ex[0])), 2)}" y="${TOP}" height="${height - TOP - BOTTOM}"><title>${escaped(code)}</title></rect>`);
  const named = spans.filter(({ from, code }, row) => from >= ex[0] && from <= ex[1] && spans.findIndex((each) => each.code === code && each.from >= ex[0]) === row)
    .map(({ from, code }) => `<text x="${px(from) + 3}" y="${TOP + 12}">${escaped(code)}</text>`);
  const dots = points.map(({ x: at, y: up, text, now, apart }, row) => {
    const last = px(at) > width - 90;
    return `<circle class="point ${now ? "now" : ""}" r="${now ? 5 : 4}" cx="${px(at)}" cy="${py(up)}" opacity="${apart ? 0.45 : 1}"/>` +
      `<text x="${px(at) + (last ? -8 : 8)}" y="${py(up) - 5 - 11 * (row % 2)}" text-anchor="${last ? "end" : "start"}">${escaped(text)}</text>`;
  });
  const axes = [
    ...ticks(ex, sx).map((value) => `<line class="grid" x1="${px(value)}" x2="${px(value)}" y1="${TOP}" y2="${height - BOTTOM}"/><text x="${px(value)}" y="${height - BOTTOM + 14}" text-anchor="middle">${value}</text>`),
    ...ticks(ey, sy).map((value) => `<line class="grid" x1="${LEFT}" x2="${width - RIGHT}" y1="${py(value)}" y2="${py(value)}"/><text x="${LEFT - 5}" y="${py(value) + 4}" text-anchor="end">${value}</text>`),
    `<text x="${(LEFT + width - RIGHT) / 2}" y="${height - 4}" text-anchor="middle">${escaped(x.label ?? "")}</text>`,
  ];
  const legend = lines.filter(({ name }) => name).map(({ kind, name }) =>
    `<svg class="key" viewBox="0 0 14 7">${kind.startsWith("area") ? `<rect class="${kind}" width="14" height="7"/>` : `<path class="${kind}" d="M0 4L14 4"/>`}</svg>${escaped(name)}`);
  where.innerHTML = `<p>${escaped(title)}</p><p>${legend.join(" ")}</p>` +
    `<svg viewBox="0 0 ${width} ${height}" role="img" aria-label="${escaped(title)}">${axes.join("")}${drawn.join("")}${marks.join("")}${named.join("")}${dots.join("")}</svg>`;
  if (onspan) letSpan(where.lastElementChild, width, ex, onspan);
}

/** A stretch dragged over is looked at closer; a double-click looks at all. */
function letSpan(picture, width, [low, high], onspan) {
  const time = (event) => {
    const { left, width: shown } = picture.getBoundingClientRect();
    const part = (((event.clientX - left) / shown) * width - LEFT) / (width - LEFT - RIGHT);
    return low + Math.min(Math.max(part, 0), 1) * (high - low);
  };
  let begun = null;
  picture.onpointerdown = (event) => (begun = time(event));
  picture.onpointerup = (event) => {
    const stretch = [begun, time(event)].sort((one, other) => one - other);
    if (begun !== null && stretch[1] - stretch[0] > 0.01 * (high - low)) onspan(stretch);
    begun = null;
  };
  picture.ondblclick = () => onspan(undefined);
}
