// The page's own script: forms and curves. Whatever is computed or written, the server is asked for.
import { SCALES, chart } from "./chart.js";

const $ = (id) => document.getElementById(id);
const make = (tag, given = {}, ...inside) => {
  const made = Object.assign(document.createElement(tag), given);
  made.append(...inside);
  return made;
};
const option = (value, text = value) => make("option", { value, textContent: text });
const labelled = (text, input) => make("label", {}, text, input);
const shell = (words) => ["haptune", ...words].map((w) => (/^[\w./:+@=,-]+$/.test(w) ? w : `'${w}'`)).join(" ");
const seen = { scene: null, profile: null, gains: {}, loop: {}, findings: [], ends: {} };

async function ask(path, body, method = "POST") {
  const sent = body instanceof Blob ? body : JSON.stringify(body);
  const answer = await fetch(path, { method, body: sent });
  const said = await answer.json().catch(() => ({ problem: `refused: ${answer.statusText}` }));
  if (!answer.ok) throw new Error(said.problem ?? answer.statusText);
  return said;
}

function say(words, bad = false) {
  $("said").textContent = words;
  $("said").className = bad ? "bad" : "";
}

/** Run a command, show how far it is, and return its result; what it refuses is said. */
async function run(words) {
  const began = performance.now();
  const told = { stage: "starting" };
  const clock = setInterval(() => {
    $("job").children[1].textContent = `${told.stage}, ${((performance.now() - began) / 1000).toFixed(0)} s`;
  }, 200);
  $("job").hidden = false;
  say("");
  try {
    const answer = await fetch("run/", { method: "POST", body: JSON.stringify(words) });
    if (!answer.ok) throw new Error(await answer.text());
    let rest = "";
    for (const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader(); ; ) {
      const { done, value } = await reader.read();
      const lines = (rest += value ?? "").split("\n");
      rest = lines.pop();
      for (const line of lines) Object.assign(told, JSON.parse(line));
      if (done) break;
    }
    const { result } = told;
    const kept = result.outputs.filter((name) => !name.startsWith("/"));
    const written = kept.length ? `written: ${kept.join(", ")}` : "";
    say(result.message ?? written, result.exit_code !== 0);
    return result;
  } finally {
    clearInterval(clock);
    $("job").hidden = true;
    await list();
  }
}

/** A button that runs what its words say, which stand beside it at every moment. */
const actions = [];
function action(id, words, then = () => {}, extra = () => []) {
  const button = $(id);
  const show = () => (button.nextElementSibling.textContent = words() ? shell(words()) : "");
  actions.push(show);
  button.addEventListener("click", async (event) => {
    event.preventDefault();
    const asked = words();
    if (asked) await guarded(async () => then(await run([...asked, ...extra()]), asked));
  });
}
const refresh = () => actions.forEach((show) => show());

async function guarded(work) {
  try {
    await work();
  } catch (error) {
    say(error.message, true);
  }
  refresh();
}

/** Files of the folder into the choices; what was chosen stays chosen, new ones are taken. */
async function list() {
  const { folder, files, devices } = await (await fetch("folder/")).json();
  $("folder").textContent = folder;
  seen.files = files;
  for (const kind of ["log", "device", "scene", "profile"]) {
    const names = files.filter((file) => file.kind === kind).map((file) => file.name);
    const box = $(`${kind}-file`);
    const before = box.value;
    box.replaceChildren(...names.map((name) => option(name)));
    if (kind === "device") box.append(...devices.map((name) => option(name, `${name} (known)`)));
    if (names.includes(before) || devices.includes(before)) box.value = before;
    const chosen = names.includes(`${kind}.yaml`) ? `${kind}.yaml` : box.value;
    if (!before && chosen) box.value = chosen;
  }
  refresh();
}

// Forms: a field is named after the keys that lead to it; no key holds a line break. ----------

const written = (value) => {
  if (Array.isArray(value)) return value.map((names) => names.join(" + ")).join("\n");
  return value?.max === undefined ? (value?.value ?? value ?? "") : `${value.min} to ${value.max}`;
};

function meant({ tagName, value }) {
  if (tagName === "SELECT") return value;
  const lines = value.split("\n").filter((line) => line.trim());
  if (tagName === "TEXTAREA") return lines.map((line) => line.split("+").map((name) => name.trim()));
  const range = value.match(/^\s*(\S+)\s+to\s+(\S+)\s*$/);
  if (range) return { min: +range[1], max: +range[2] };
  return Number.isNaN(+value) ? value.trim() : +value;
}

function fill(form, content) {
  for (const field of form.elements)
    if (field.name) field.value = written(field.name.split("\n").reduce((part, key) => part?.[key], content));
}

/** Content with what the fields say; what is blank is left out. */
function gather(form, content = {}) {
  for (const field of [...form.elements].filter(({ name }) => name)) {
    const keys = field.name.split("\n");
    const last = keys.pop();
    const inner = keys.reduce((part, key) => (part[key] ??= {}), content);
    if (field.value.trim()) inner[last] = meant(field);
    else delete inner[last];
  }
  return content;
}

async function save(kind, file, content) {
  const { backup } = await ask("save/", { kind, file, content: { schema: `haptune/${kind}/1`, ...content } });
  await list();
  say(`written: ${file}${backup ? `; the file before is ${backup}` : ""}`);
}

// Log -----------------------------------------------------------------------------------------

const UNITS = { force: "N (N·m)", position: "m (rad)", reference: "m (rad)" };
const GAINS = { 1: "N, N·m, m, rad, s", 0.001: "mN, mm, ms", 0.000001: "µm, µs", 0.017453292519943295: "degrees" };
const logFile = () => $("log-file").value;
const has = (name) => seen.files?.some((file) => file.name === name);
const hardware = () => (has("hardware.yaml") ? ["--hardware", "hardware.yaml"] : []);
const columns = () =>
  Object.entries(gather($("columns"))).flatMap(([key, value]) => [`--${key.replace("_", "-")}`, String(value)]);

async function showLog(span) {
  if (!logFile()) return;
  const told = await ask("log/", { file: logFile(), columns: gather($("columns")), span });
  for (const box of $("columns").querySelectorAll("select")) {
    const chosen = box.value;
    box.replaceChildren(option("", "as named"), ...told.names.map((name) => option(name)));
    box.value = chosen;
  }
  $("curves").replaceChildren();
  $("reading").textContent = told.problem ?? "";
  if (told.problem) return;
  const rate = `${told.rows} rows, ${(1 / told.sample_time).toPrecision(4)} Hz`;
  const how = told.read_as ? `; read with ${told.read_as}` : "";
  $("reading").textContent = `${rate}${how}. Drag over a curve to look closer, double-click for all of it.`;
  const own = seen.findings.filter(({ at, source }) => at && source === logFile());
  const spans = own.flatMap(({ at, code }) => at.map(([from, to]) => ({ from, to, code })));
  for (const [name, [x, y]] of Object.entries(told.curves)) {
    const where = make("div");
    $("curves").append(where);
    chart(where, {
      title: `${name}, ${UNITS[name]}`, x: { label: "time, s", ends: span ?? told.whole }, y: {},
      lines: [{ x, y, kind: "line" }], spans, height: 170, onspan: (ends) => guarded(() => showLog(ends)),
    });
  }
}

function showFindings(findings) {
  seen.findings = findings;
  const place = ({ at = [] }) => at.slice(0, 5).map(([from]) => ` at ${from.toPrecision(4)} s`).join(",");
  $("findings").replaceChildren(
    ...findings.flatMap((each) => [
      make("dt", { className: `is-${each.severity}`, textContent: `${each.severity}: ${each.code}${place(each)}` }),
      make("dd", { textContent: `${each.seen}; needed: ${each.needed}. ${each.remedy}` }),
    ]),
  );
}

async function afterLog(result) {
  showFindings(result.findings);
  await showLog();
  if (!result.outputs.some((name) => name.endsWith("fit.png"))) return;
  const part = (which) => make("img", { src: `file/@fit.png?${Date.now()}`, alt: `Fit of the log, part ${which}` });
  $("fit").firstElementChild.replaceChildren(...[1, 2, 3].map(part));
  $("fit").hidden = false;
}

async function showFacts() {
  seen.hardware = has("hardware.yaml") ? (await ask("read/", { file: "hardware.yaml" })).content : {};
  fill($("facts"), seen.hardware);
}

async function take(file) {
  const there = seen.files.find(({ name }) => name === file.name);
  if (there?.bytes !== file.size) {
    if (!confirm(`Put ${file.name} into ${$("folder").textContent}?`)) return;
    await ask(`drop/${encodeURIComponent(file.name)}`, file, "PUT");
    await list();
  }
  $("log-file").value = file.name;
  $("log-file").onchange();
}

// Device and scene ----------------------------------------------------------------------------

const EFFECTS = ["stiffness", "damping", "mass"];
const KINDS = {
  wall: { stiffness: "max", damping: "max", one_sided: true }, fluid: { damping: "max" },
  object: { mass: "max" }, spring: { stiffness: "max" }, lightness: { damping: "min" },
};
const WISHES = { stiffness: "stiffness, N/m (N·m/rad)", damping: "damping, N·s/m (N·m·s/rad)", mass: "mass, kg (kg·m²)" };
const MOTIONS = {
  speed: "speed, m/s (rad/s)", acceleration: "acceleration, m/s² (rad/s²)",
  penetration: "how deep it must last, m (rad)", priority: "priority",
};

function table({ headings, rows, numeric, title, lines }) {
  const cell = (tag) => (text, place) => make(tag, { textContent: text, className: numeric[place] ? "number" : "" });
  const row = (cells, tag) => make("tr", {}, ...cells.map(cell(tag)));
  const notes = lines.map((text) => make("tr", {}, make("td", { colSpan: headings.length, textContent: text })));
  return make("table", {}, make("caption", { textContent: title }), make("thead", {}, row(headings, "th")),
    make("tbody", {}, ...rows.map((cells) => row(cells, "td"))), make("tfoot", {}, ...notes));
}

async function showDevice() {
  if (!$("device-file").value) return;
  const told = await ask("read/", { file: $("device-file").value });
  $("device-table").replaceChildren(table(told.table));
  const open = told.missing.map(({ key, hint }) => `${key}${hint ? ` (a hint, not used: ${hint})` : ""}`);
  if (open.length) say(`To be stated before anything is certified: ${open.join("; ")}`);
}

async function showScene() {
  if ($("scene-file").value) seen.scene = (await ask("read/", { file: $("scene-file").value })).content;
  $("scene").hidden = !seen.scene;
  if (seen.scene) drawScene();
}

function drawScene() {
  const { elements } = seen.scene;
  $("elements").replaceChildren(
    ...Object.entries(elements).map(([name, element]) => {
      const kind = element.one_sided ? "wall" : EFFECTS.filter((effect) => effect in element).join(" and ");
      const field = ([key, words]) =>
        labelled(words, make("input", { name: `elements\n${name}\n${key}`, id: `${name}.${key}` }));
      const remove = () => (gather($("scene"), seen.scene), delete elements[name], drawScene());
      return make("fieldset", {}, make("legend", { textContent: `${name}: ${kind}` }),
        ...Object.entries(WISHES).map(field),
        make("details", {}, make("summary", { textContent: "how the hand moves" }), ...Object.entries(MOTIONS).map(field)),
        make("button", { type: "button", textContent: `Remove ${name}`, onclick: remove }));
    }),
  );
  fill($("scene"), { margin: "balanced", ...seen.scene });
}

function addElement(kind) {
  gather($("scene"), seen.scene);
  let name = kind;
  while (name in seen.scene.elements) name += "_2";
  seen.scene.elements[name] = { ...KINDS[kind] };
  drawScene();
}

// Profile -------------------------------------------------------------------------------------

const MARGINS = ["firm", "balanced", "conservative"];
const { linear, root, log } = SCALES;
const names = [(word) => MARGINS.indexOf(word), (p) => MARGINS[p]];
const rounded = (value) => (typeof value === "number" ? Number(value.toPrecision(4)) : value);
const gainsOf = (element) => Object.fromEntries(EFFECTS.map((effect) => [effect, element[effect]]));

async function showProfile() {
  if (!$("profile-file").value) return;
  seen.profile = await ask("read/", { file: $("profile-file").value });
  const { content, verdict, title, bars, notes } = seen.profile;
  $("verdict").textContent = `${title}: ${verdict}`;
  const rows = bars.map(({ words, binds }) => (binds ? words.with(-1, `${words.at(-1)} (binds)`) : words));
  const headings = ["effect", "value", "steps", "limit"];
  const numeric = [false, true, true, false];
  $("bars").replaceChildren(table({ title: "What is played, and what limits it", headings, numeric, rows, lines: notes }));
  $("bars").querySelectorAll("tbody td:last-child").forEach((cell, row) => {
    const { part } = bars[row];
    cell.append(make("progress", { value: part, title: `${(100 * part).toFixed(1)} % is used` }));
  });
  $("element").replaceChildren(...Object.keys(content.elements).map((name) => option(name)));
  backToProfile();
}

function backToProfile() {
  const { loop, margin, elements } = seen.profile.content;
  seen.gains = Object.fromEntries(Object.entries(elements).map(([name, element]) => [name, gainsOf(element)]));
  const { velocity_filter_hz = null, acceleration_filter_hz = null } = loop;
  seen.loop = { velocity_filter_hz, acceleration_filter_hz, margin: margin.name ?? "balanced", extra_delay_samples: 0 };
  seen.start = JSON.stringify([seen.gains, seen.loop]);
  drawSliders();
  move(true);
}

function drawSliders() {
  const { units, mass, rate, content } = seen.profile;
  const gains = seen.gains[$("element").value];
  const b = content.device.damping.value;
  const most = (effect, least) => {
    const played = Object.values(content.elements).map((element) => Math.abs(element[effect]));
    return 2 * Math.max(least, ...played);
  };
  const sliders = [
    [gains, "stiffness", `stiffness K, ${units.stiffness}`, root, 0, most("stiffness", 100)],
    [gains, "damping", `damping B, ${units.damping}`, root, -b, most("damping", 10 * b)],
    [gains, "mass", `mass M, ${units.mass}`, root, -0.9 * mass, most("mass", mass)],
    [seen.loop, "velocity_filter_hz", "velocity cut-off, Hz", log, rate / 1000, rate / 2],
    [seen.loop, "acceleration_filter_hz", "acceleration cut-off, Hz", log, rate / 1000, rate / 2],
    [seen.loop, "margin", "margin", names, "firm", "conservative"],
    [seen.loop, "extra_delay_samples", "more delay, samples", linear, 0, 4],
  ];
  const slider = ([of, key, words, [to, from], low, high]) => {
    const step = key === "margin" ? 1 : "any";
    const slide = make("input", { type: "range", min: to(low), max: to(high), step, id: `slide-${key}` });
    const exact = make("output", { textContent: of[key] });
    slide.value = to(of[key]);
    slide.oninput = () => {
      of[key] = rounded(from(+slide.value));
      exact.textContent = of[key];
      move(false);
    };
    return make("label", {}, make("span", { textContent: words }), slide, exact);
  };
  $("sliders").replaceChildren(...sliders.filter(([of, key]) => of[key] !== null).map(slider));
}

function mark(words, kind) {
  $("mark").textContent = words;
  $("mark").className = kind;
}

const moving = { wanted: null, busy: false, rest: 0 };
/** Ask for where the sliders stand: at once while they move, to be proved when they rest. */
async function move(proved) {
  const name = $("element").value;
  const moved = JSON.stringify([seen.gains, seen.loop]) !== seen.start;
  $("report").disabled = $("export").disabled = moved;
  $("back").disabled = $("wish").disabled = !moved;
  if (moved) mark("not proved", "open");
  const files = { device: $("device-file").value, profile: $("profile-file").value };
  const ends = proved ? null : seen.ends[name];
  moving.wanted = { asked: { ...files, ...seen.gains[name], ...seen.loop, ends, proved }, name, moved };
  clearTimeout(moving.rest);
  if (!proved) moving.rest = setTimeout(() => move(true), 400);
  if (moving.busy) return;
  moving.busy = true;
  try {
    while (moving.wanted) {
      const now = moving.wanted;
      moving.wanted = null;
      drawMoved(await ask("move/", now.asked), now);
    }
  } catch (error) {
    say(error.message, true);
  }
  moving.busy = false;
}

function drawMoved(told, { asked, name, moved }) {
  const { units } = seen.profile;
  seen.ends[name] = told.ends;
  const rested = told.safe ? "this element alone is proved safe; the whole is not proved" : "not safe as it stands";
  if (!moved) mark(`proved: ${asked.profile}`, "proved");
  else mark(asked.proved ? rested : "not proved", "open");
  $("audited").textContent = told.command.length ? shell(told.command) : "audit has no option for a moving window";
  const nearest = told.nearest.flatMap((value, place) => (value ? [`${EFFECTS[place]} ${rounded(value)}`] : []));
  const wrong = nearest.length ? [...told.faults, `nearest safe values: ${nearest.join(", ")}`] : told.faults;
  $("faults").replaceChildren(...wrong.map((words) => make("li", { className: "unsafe", textContent: words })));
  $("audit").replaceChildren(table(told.table));
  drawRegion(told, asked, name);
  const force = `${told.force.toPrecision(3)} ${units.force}`;
  const answer = asked.stiffness > 0 ? `position, ${units.length}` : `speed, ${units.speed}`;
  const [x, y] = told.step;
  chart($("step"), {
    title: `answer to a step of ${force}: ${answer}`, x: { label: "time, s" }, y: {},
    lines: [{ x, y, kind: "line dark", name: "best estimate" }],
  });
  const { hertz } = told.felt;
  for (const which of ["mass", "damping"])
    chart($(`felt-${which}`), {
      title: `${which} that is felt of it, ${units[which]}`, x: { label: "frequency of the hand, Hz", scale: "log" }, y: {},
      lines: [
        { x: hertz, y: told.felt[which], kind: "line dark", name: "felt" },
        { x: [hertz[0], hertz.at(-1)], y: [asked[which], asked[which]], kind: "line edge", name: "asked for" },
      ],
    });
}

function drawRegion({ ends, region: { damping, best, worst, safe } }, asked, name) {
  const { units } = seen.profile;
  const points = Object.entries(seen.gains).map(([text, { stiffness, damping: B, mass }]) => (
    { x: B, y: stiffness, text, now: text === name, apart: mass !== asked.mass }
  ));
  const high = 1.15 * Math.max(...safe, asked.stiffness) || Math.max(...best.filter(Number.isFinite)) || 1;
  chart($("region"), {
    title: `stable stiffness and damping at M = ${asked.mass} ${units.mass}`, points,
    x: { label: `damping B, ${units.damping}`, scale: "root", ends },
    y: { scale: "root", ends: [0, high] },
    lines: [
      { x: damping, y: best, kind: "area pale", name: "stable, best estimate" },
      { x: damping, y: safe, kind: "area safe", name: "with the whole margin" },
      { x: damping, y: worst, kind: "line edge", name: "worst corner of the box" },
    ],
  });
}

async function askForThis() {
  if (!seen.scene) await showScene();
  const { content } = seen.profile;
  for (const [name, element] of Object.entries(seen.scene.elements))
    for (const effect of EFFECTS)
      if (name in seen.gains && seen.gains[name][effect] !== content.elements[name][effect])
        element[effect] = seen.gains[name][effect];
  for (const key of ["velocity_filter_hz", "acceleration_filter_hz"])
    if (seen.loop[key] !== (content.loop[key] ?? null)) seen.scene.loop = { ...seen.scene.loop, [key]: seen.loop[key] };
  seen.scene.margin = seen.loop.margin;
  drawScene();
  location.hash = "#device";
  say("The scene asks for it now. Save it, and tune.");
}

// Wiring --------------------------------------------------------------------------------------

const SHOW = {
  log: async () => (await showFacts(), await showLog()),
  device: async () => (await showDevice(), await (seen.scene ? null : showScene())),
  profile: showProfile,
};
async function view() {
  const name = location.hash.slice(1) in SHOW ? location.hash.slice(1) : "log";
  for (const each of Object.keys(SHOW)) $(each).hidden = each !== name;
  for (const link of document.querySelectorAll("nav a")) link.toggleAttribute("aria-current", link.hash === `#${name}`);
  await guarded(SHOW[name]);
}

const value = (kind) => $(`${kind}-file`).value;
const picture = () => ["--picture", "@fit.png"];
const reportLogs = () => {
  const used = seen.profile?.content.device.logs?.some(({ source }) => source === logFile());
  return used ? [logFile(), ...columns()] : [];
};
const targets = () => [...$("targets").querySelectorAll(":checked")].map((box) => box.value).join(",") || "c";
action("examine", () => logFile() && ["doctor", logFile(), ...columns(), ...hardware()], afterLog, picture);
const identify = () => logFile() && ["identify", logFile(), ...columns(), ...hardware(), "-o", "device.yaml"];
action("identify", identify, async (result) => {
  await afterLog(result);
  if (!result.exit_code) $("device-file").value = "device.yaml";
}, picture);
const example = () => ["new", "scene", ...(value("device") ? ["--device", value("device")] : []), "-o", "scene.yaml"];
action("new-scene", example, () => {
  $("scene-file").value = "scene.yaml";
  return showScene();
});
action("tune", () => value("scene") && ["tune", value("device"), value("scene"), "-o", "profile.yaml"], (result) => {
  if (result.exit_code) return;
  $("profile-file").value = "profile.yaml";
  location.hash = "#profile";
});
const report = () => value("profile") && ["report", value("profile"), ...reportLogs(), "-o", "report.html"];
action("report", report, (result) => {
  const link = make("a", { href: "file/report.html", target: "_blank", textContent: "Open the report" });
  if (!result.exit_code) $("reported").replaceChildren(link);
});
action("export", () => value("profile") && ["export", value("profile"), "--to", targets(), "-o", "controller"]);

const target = (name) => make("input", { type: "checkbox", value: name, checked: name === "c", onchange: refresh });
$("targets").append(...["c", "ros2", "chai3d", "json"].map((name) => labelled(name, target(name))));
$("gains").append(...Object.entries(GAINS).map(([size, label]) => make("option", { value: size, label })));
const adder = (kind) => make("button", { type: "button", textContent: `Add ${kind}`, onclick: () => addElement(kind) });
$("adding").append(...Object.keys(KINDS).map(adder));

const saves = {
  facts: () => save("hardware", "hardware.yaml", gather($("facts"), seen.hardware)),
  scene: () => save("scene", value("scene") || "scene.yaml", gather($("scene"), seen.scene)),
};
for (const [id, work] of Object.entries(saves)) $(id).onsubmit = (event) => (event.preventDefault(), guarded(work));
$("cancel").onclick = () => ask("stop/", {});
$("columns").onchange = () => guarded(() => showLog());
$("log-file").onchange = () => {
  $("columns").reset();
  showFindings([]);
  $("fit").hidden = true;
  guarded(() => showLog());
};
$("device-file").onchange = () => guarded(showDevice);
$("scene-file").onchange = () => guarded(showScene);
$("profile-file").onchange = () => guarded(showProfile);
$("element").onchange = () => (drawSliders(), move(true));
$("back").onclick = backToProfile;
$("wish").onclick = () => guarded(askForThis);
$("dropped").onchange = ({ target: { files } }) => files[0] && guarded(() => take(files[0]));
document.ondragover = (event) => event.preventDefault();
document.ondrop = (event) => {
  event.preventDefault();
  const [file] = event.dataTransfer.files;
  if (file) guarded(() => take(file));
};
window.onhashchange = view;
window.onresize = () => $("profile").hidden || move(true);

async function beat() {
  const { body } = await fetch("alive/");
  for (const reader = body.getReader(); !(await reader.read()).done; );
}
beat().catch(() => {}).finally(() => say("haptune has ended; start it again with haptune open.", true));
await guarded(list);
await view();
