// Curves, areas and points as SVG, with axes; nothing of it is kept between two drawings.

/** How far along an axis a value stands, and back. */
export const SCALES = {
  linear: [(v) => v, (p) => p],
  root: [(v) => Math.sign(v) * Math.sqrt(Math.abs(v)), (p) => Math.sign(p) * p * p],
  log: [Math.log10, (p) => 10 ** p],
};
const LEFT = 58, RIGHT = 12, TOP = 8, BOTTOM = 36;
const within = (value, [low, high]) => low <= value && value <= high;
const escaped = (text) => String(text).replace(/[&<>"]/g, (letter) => `&#${letter.charCodeAt()};`);

/** A little more than all values, where nothing else is asked for. */
function around(values) {
  const known = values.filter(Number.isFinite);
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const room = (high - low) / 20 || Math.abs(high) / 2 || 1;
  return [low - room, high + room];
}

/** Round values of an axis, as far apart as a fifth of it or less; of a logarithmic one the decades. */
function ticks([low, high], scale) {
  const [to, from] = scale === "log" ? SCALES.log : SCALES.linear;
  const size = 10 ** Math.floor(Math.log10((high - low) / 4));
  const step = scale === "log" ? 1 : size * [5, 2, 1].find((part) => part * size <= (high - low) / 4);
  const first = Math.ceil(to(low) / step), count = Math.floor(to(high) / step) - first + 1;
  return Array.from({ length: count }, (_, row) => Number(from((first + row) * step).toPrecision(6)));
}

/** Draw lines, areas, spans and the points within the axes; ``x`` and ``y`` tell label and scale. */
export function chart(where, { title, x = {}, y = {}, lines, points = [], spans = [], height = 240 }) {
  const width = Math.max(where.clientWidth, 240), floor = height - BOTTOM;
  const along = ([to], [low, high], from, size) => (value) =>
    (from + ((to(Math.min(Math.max(value, low), high)) - to(low)) / (to(high) - to(low))) * size).toFixed(1);
  const ex = [lines[0].x[0], lines[0].x.at(-1)];
  const ey = y.ends ?? around(lines.flatMap((each) => each.y));
  const px = along(SCALES[x.scale ?? "linear"], ex, LEFT, width - LEFT - RIGHT);
  const py = along(SCALES[y.scale ?? "linear"], ey, floor, TOP - floor);
  const text = (left, top, words, anchor = "middle") =>
    `<text x="${left}" y="${top}" text-anchor="${anchor}">${escaped(words)}</text>`;
  const drawn = [
    ...ticks(ex, x.scale).filter((value, row, all) => row % 2 === 0 || px(value) - px(all[row - 1]) > 30).map((value) => `<path class="grid" d="M${px(value)} ${TOP}V${floor}"/>${text(px(value), floor + 14, value)}`),
    ...ticks(ey, y.scale).map((value) => `<path class="grid" d="M${LEFT} ${py(value)}H${width - RIGHT}"/>${text(LEFT - 5, +py(value) + 4, value, "end")}`),
    ...lines.map(({ x: across, y: up, kind }) => {
      const path = across.flatMap((value, row) => (up[row] === null ? [] : [`${px(value)} ${py(up[row])}`]));
      const closed = kind.startsWith("area") ? `V${floor}H${px(across[0])}Z` : "";
      return `<path class="${kind}" d="M${path.join("L")}${closed}"/>`;
    }),
    ...spans.map(([low, high, words]) =>
      `<path class="span" d="M${px(low)} ${TOP}H${Math.max(px(high), +px(low) + 2)}V${floor}H${px(low)}Z"/>` +
      text(px(low), TOP + 12, words, "start")),
    ...points.filter(([at, up]) => within(at, ex) && within(up, ey)).map(([at, up, words, now], row) => {
      const last = px(at) > width - 90;
      const name = text(+px(at) + (last ? -8 : 8), py(up) - 6 - 11 * (row % 3), words, last ? "end" : "start");
      return `<circle class="point ${now ? "now" : ""}" r="${now ? 5 : 4}" cx="${px(at)}" cy="${py(up)}"/>${name}`;
    }),
    text((LEFT + width - RIGHT) / 2, height - 4, x.label ?? "time, s"),
  ];
  const legend = lines.filter(({ name }) => name).map(({ kind, name }) =>
    `<span><svg viewBox="0 0 14 7"><path class="${kind}" d="M0 4H14${kind.startsWith("area") ? "V7H0Z" : ""}"/></svg> ${escaped(name)}</span>`);
  where.innerHTML = `<p>${escaped(title)}</p><p class="legend">${legend.join(" ")}</p>` +
    `<svg viewBox="0 0 ${width} ${height}" role="img" aria-label="${escaped(title)}">${drawn.join("")}</svg>`;
}
