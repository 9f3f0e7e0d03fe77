// The page's own script: what is shown and asked for. All that is computed or written is the server's.
import { SCALES, chart } from "./chart.js";

const $ = (id) => document.getElementById(id);
const make = (tag, given = {}, ...inside) => {
  const made = Object.assign(document.createElement(tag), given);
  made.append(...inside);
  return made;
};
const shell = (words) => ["haptune", ...words].map((w) => (/^[\w./:+@=,-]+$/.test(w) ? w : `'${w}'`)).join(" ");
const chosen = (kind) => $(`${kind}-file`).value;
const KINDS = ["log", "device", "scene", "profile"];
const seen = { files: [], findings: [], outputs: [], text: "", profile: null, state: {}, start: "", ends: null };

function say(words, bad = false) {
  $("said").textContent = words;
  $("said").classList.toggle("is-refusal", bad);
}

async function ask(path, body, method = "POST") {
  const raw = body instanceof File || typeof body === "string";
  const answer = await fetch(path, { method, body: raw ? body : JSON.stringify(body) });
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

/** Do what was asked for; what is refused is said. Beside each button stands what it runs. */
async function guarded(work) {
  try {
    await work();
  } catch (error) {
    say(error.message, true);
  }
  for (const button of document.querySelectorAll("[data-run]")) {
    const words = wordsOf(button);
    button.disabled = words.includes("");
    button.nextElementSibling.textContent = button.disabled ? "" : shell(words);
  }
}

/** The choices of a box; what was chosen stays chosen, else the usual one is. */
function offer(box, names, usual) {
  const before = box.value || usual;
  box.replaceChildren(...names.map((name) => make("option", { value: name }, name || "as named")));
  if (names.includes(before)) box.value = before;
}

async function list() {
  const { folder, files } = await (await fetch("folder/")).json();
  $("folder").textContent = folder;
  seen.files = files;
  for (const kind of KINDS) {
    const names = files.filter((file) => file.kind === kind).map((file) => file.name);
    offer($(`${kind}-file`), names, `${kind}.yaml`);
  }
}

/** Put a file into the folder. */
async function put(name, content) {
  const { backup } = await ask(`file/${encodeURIComponent(name)}`, content, "PUT");
  await list();
  say(`written: ${name}${backup ? `; the file before is ${backup}` : ""}`);
}

async function run(button) {
  say("");
  const { exit_code, message, outputs, findings } = await ask("run/", wordsOf(button));
  say(message ?? (outputs.length ? `written: ${outputs.join(", ")}` : ""), exit_code !== 0);
  await list();
  for (const kind of KINDS) if (outputs.includes(`${kind}.yaml`)) $(`${kind}-file`).value = `${kind}.yaml`;
  if (outputs.includes("scene.yaml")) seen.text = $("scene-text").value;
  if (!$("log").hidden) seen.findings = findings;
  seen.outputs.push(...outputs);
  if (!exit_code && button.dataset.next) location.hash = button.dataset.next;
  else await view();
}

// Log -----------------------------------------------------------------------------------------

const UNITS = { force: "N (N·m)", position: "m (rad)", reference: "m (rad)" };
const stated = () => seen.files.some((file) => file.name === "hardware.yaml");

/** What the fields of a form say, of which a name may lead into a group; blank ones are left out. */
function gather(form) {
  const found = {};
  for (const { name, value, tagName } of form.elements) {
    const [key, inner] = name.split(".");
    const meant = tagName === "SELECT" || Number.isNaN(+value) ? value : +value;
    if (name && value.trim()) found[key] = inner ? { ...found[key], [inner]: meant } : meant;
  }
  return found;
}

async function showFacts() {
  seen.facts = stated() ? (await ask("show/document", { file: "hardware.yaml" })).content : {};
  for (const field of $("facts").elements) {
    const [key, inner] = field.name.split(".");
    const fact = inner ? seen.facts[key]?.[inner] : seen.facts[key];
    field.value = fact?.value ?? fact ?? "";
  }
}

async function showLog() {
  if (!chosen("log")) return;
  const told = await ask("show/log", { file: chosen("log"), columns: gather($("columns")) });
  for (const box of $("columns").querySelectorAll("select")) offer(box, ["", ...told.names], "");
  $("reading").textContent = told.reading;
  $("curves").replaceChildren();
  const spans = seen.findings.flatMap(({ at, code }) =>
    at.map(([from, to], row) => ({ from, to, words: row ? "" : code })));
  for (const [name, [x, y]] of Object.entries(told.curves)) {
    const where = $("curves").appendChild(make("div"));
    const lines = [{ x, y, kind: "line" }];
    chart(where, { title: `${name}, ${UNITS[name]}`, x: { label: "time, s" }, lines, spans, height: 170 });
  }
  $("findings").replaceChildren(
    ...seen.findings.flatMap(({ severity, code, at, seen: found, needed, remedy }) => [
      make("dt", { className: `is-${severity}` }, `${severity}: ${code}`, at.length ? ` at ${at[0][0].toPrecision(4)} s` : ""),
      make("dd", {}, `${found}; needed: ${needed}. ${remedy}`),
    ]),
  );
  $("fit").hidden = !seen.outputs.includes("fit.png");
  if (!$("fit").hidden) $("fit").querySelector("img").src = `file/fit.png?${Date.now()}`;
}

// Device and scene ----------------------------------------------------------------------------

function table({ headings, rows, numeric, title, lines }) {
  const row = (cells, tag) => make("tr", {}, ...cells.map((text, place) => make(tag, { className: numeric[place] ? "number" : "" }, text)));
  const made = make("table", {}, make("caption", {}, title), row(headings, "th"), ...rows.map((cells) => row(cells, "td")));
  return make("div", { className: "wide" }, made, ...lines.map((line) => make("p", { className: "faint" }, line)));
}

/** One more element of a kind and its wishes, at the head of the elements of the scene's text. */
function add(kind, wishes) {
  const text = $("scene-text").value;
  let name = kind;
  while (text.includes(`  ${name}:`)) name += "_2";
  $("scene-text").value = text.replace(/^elements:\n/m, `elements:\n  ${name}: {${wishes}}\n`);
}

async function showDevice() {
  if (chosen("device"))
    $("device-table").replaceChildren(table((await ask("show/document", { file: chosen("device") })).table));
  if (!chosen("scene") || $("scene-text").value !== seen.text) return;
  seen.text = $("scene-text").value = (await ask("show/document", { file: chosen("scene") })).text;
}

// Profile -------------------------------------------------------------------------------------

const MARGINS = ["firm", "balanced", "conservative"];
const SLIDES = { ...SCALES, margin: [(word) => MARGINS.indexOf(word), (place) => MARGINS[place]] };

/** Nothing of a profile is shown beside the name of another, or of one that is refused. */
async function showProfile() {
  const file = chosen("profile");
  const same = seen.profile?.file === file;
  seen.profile = null;
  try {
    $("shown").hidden ||= !same;
    const told = file ? await ask("show/document", { file }) : null;
    if (file === chosen("profile")) seen.profile = told && { ...told, file };
  } finally {
    $("shown").hidden = !seen.profile;
  }
  if (!seen.profile) return;
  const { content, verdict, table: limits } = seen.profile;
  $("verdict").textContent = verdict;
  $("limits").replaceChildren(table(limits), ...content.notes.map((note) => make("p", {}, note)));
  offer($("element"), Object.keys(content.elements), "");
  start();
}

/** The sliders of the chosen element, where the profile has it. */
function start() {
  const { units, content: { device, loop, margin, elements } } = seen.profile;
  const { stiffness, damping, mass, one_sided } = elements[$("element").value];
  const [m, b, rate] = [device.mass.value, device.damping.value, 1 / loop.sample_time];
  const most = (effect, least) => 2 * Math.max(least, ...Object.values(elements).map((each) => Math.abs(each[effect])));
  seen.state = {
    stiffness, damping, mass, margin: margin.name, extra_delay_samples: 0,
    velocity_filter: loop.velocity_filter_hz, acceleration_filter: loop.acceleration_filter_hz,
  };
  const sliders = [
    ["stiffness", `stiffness K, ${units.stiffness}`, "root", one_sided ? 1 : 0, most("stiffness", 100)],
    ["damping", `damping B, ${units.damping}`, "root", one_sided ? 0 : -b, most("damping", 10 * b)],
    ["mass", `mass M, ${units.mass}`, "root", -0.9 * m, most("mass", m)],
    ["velocity_filter", "velocity cut-off, Hz", "log", rate / 1000, rate / 2],
    ["acceleration_filter", "acceleration cut-off, Hz", "log", rate / 1000, rate / 2],
    ["margin", "margin", "margin", "firm", "conservative"],
    ["extra_delay_samples", "more delay, samples", "linear", 0, 4],
  ];
  const used = sliders.filter(([key]) => seen.state[key] != null && !(one_sided && key === "mass"));
  $("sliders").replaceChildren(...used.map(slider));
  seen.start = JSON.stringify(seen.state);
  move(true);
}

function slider([key, words, scale, low, high]) {
  const [to, from] = SLIDES[scale];
  const step = scale === "margin" ? 1 : "any";
  const slide = make("input", { type: "range", min: to(low), max: to(high), step, id: `slide-${key}` });
  const exact = make("output", {}, seen.state[key]);
  slide.value = to(seen.state[key]);
  slide.oninput = () => {
    const moved = from(+slide.value);
    seen.state[key] = exact.textContent = scale === "margin" ? moved : Number(moved.toPrecision(4));
    move(false);
  };
  return make("label", {}, make("span", {}, words), slide, exact);
}

const moving = { wanted: null, busy: false, rest: 0 };
/** Ask for where the sliders stand: at once while they move, to be proved when they rest. */
async function move(proved) {
  if (!seen.profile) return;
  const moved = JSON.stringify(seen.state) !== seen.start;
  $("whole").disabled = moved;
  if (moved) mark("not proved", "open");
  const files = { device: chosen("device"), profile: chosen("profile"), element: $("element").value };
  moving.wanted = { ...files, ...seen.state, ends: proved ? null : seen.ends, proved };
  clearTimeout(moving.rest);
  if (!proved) moving.rest = setTimeout(() => move(true), 400);
  if (moving.busy) return;
  moving.busy = true;
  await guarded(async () => {
    while (moving.wanted) {
      const asked = moving.wanted;
      moving.wanted = null;
      const told = await ask("show/moved", asked);
      if (asked.profile === seen.profile?.file) draw(told, asked);
    }
  });
  moving.busy = false;
}

function mark(words, kind) {
  Object.assign($("mark"), { textContent: words, className: kind });
}

function draw(told, { device, profile, element, ends, proved, ...state }) {
  const { units, content: { elements } } = seen.profile;
  seen.ends = told.ends;
  const rested = told.safe ? "this element alone is proved safe; the whole is not proved" : "not safe as it stands";
  if (JSON.stringify(seen.state) === seen.start) mark(`proved: ${profile}`, "proved");
  else mark(proved ? rested : "not proved", "open");
  const given = Object.entries(state).flatMap(([key, now]) => (now ? [`--${key.replaceAll("_", "-")}`, now] : []));
  $("audited").textContent = shell(["audit", device, "--like", `${profile},${element}`, ...given]);
  $("faults").replaceChildren(...told.faults.map((words) => make("li", { className: "is-refusal" }, words)));
  $("audit").replaceChildren(table(told.table));
  const [damping, best, worst, safe] = told.region;
  const points = Object.entries({ ...elements, [element]: state }).map(([words, each]) => (
    { x: each.damping, y: each.stiffness, words, now: words === element }
  ));
  const high = 1.15 * Math.max(...safe, state.stiffness) || Math.max(...best.filter(Number.isFinite)) || 1;
  chart($("region"), {
    title: `stable stiffness and damping at M = ${state.mass} ${units.mass}`, points,
    x: { label: `damping B, ${units.damping}`, scale: "root", ends: told.ends },
    y: { scale: "root", ends: [0, high] },
    lines: [
      { x: damping, y: best, kind: "area pale", name: "stable, best estimate" },
      { x: damping, y: safe, kind: "area safe", name: "with the whole margin" },
      { x: damping, y: worst, kind: "line edge", name: "worst corner of the box" },
    ],
  });
  const answer = state.stiffness > 0 ? `position, ${units.length}` : `speed, ${units.speed}`;
  chart($("step"), {
    title: `answer to a step of ${told.force.toPrecision(3)} ${units.force}: ${answer}`, x: { label: "time, s" },
    lines: told.step.map(([x, y], row) => ({ x, y, kind: "line dark", name: row ? "" : "every corner of the box" })),
  });
  const [hertz, ...felt] = told.felt;
  ["mass", "damping"].forEach((which, row) => chart($(`felt-${which}`), {
    title: `${which} that is felt of it, ${units[which]}`, x: { label: "frequency of the hand, Hz", scale: "log" },
    lines: [
      { x: hertz, y: felt[row], kind: "line dark", name: "felt" },
      { x: [hertz[0], hertz.at(-1)], y: [state[which], state[which]], kind: "line edge", name: "asked for" },
    ],
  }));
}

// Wiring --------------------------------------------------------------------------------------

const SHOW = { log: showLog, device: showDevice, profile: showProfile };
async function view() {
  const name = location.hash.slice(1) in SHOW ? location.hash.slice(1) : "log";
  for (const each of Object.keys(SHOW)) $(each).hidden = each !== name;
  for (const link of document.querySelectorAll("nav a")) link.toggleAttribute("aria-current", link.hash === `#${name}`);
  $("reported").hidden = !seen.outputs.includes("report.html");
  await guarded(SHOW[name]);
}

/** The words of a command, with what {} stands for; "" where there is none. */
function wordsOf({ dataset }) {
  const columns = Object.entries(gather($("columns"))).map(([key, text]) => `--${key.replace("_", "-")}=${text}`);
  const its = seen.profile?.content.device.logs?.some(({ source }) => source === chosen("log"));
  const words = {
    log: [chosen("log"), ...columns], its_log: its ? [chosen("log"), ...columns] : [],
    hardware: stated() ? ["--hardware", "hardware.yaml"] : [], to: [`--to=${$("to").value}`],
    device: [chosen("device")], scene: [chosen("scene")], profile: [seen.profile?.file ?? ""],
  };
  return dataset.run.split(" ").flatMap((word) => words[word.slice(1, -1)] ?? word);
}

document.onclick = ({ target }) => {
  if (target.dataset.run) guarded(() => run(target));
  if (target.id === "cancel") ask("stop/", {});
  if (target.id === "back") start();
  if (target.dataset.wishes) add(target.textContent, target.dataset.wishes);
  if (target.id === "save-scene") guarded(() => put(chosen("scene") || "scene.yaml", (seen.text = $("scene-text").value)));
  if (target.id === "state")
    guarded(() => put("hardware.yaml", JSON.stringify({ schema: "haptune/hardware/1", ...seen.facts, ...gather($("facts")) })));
};
document.onchange = ({ target }) => guarded(async () => {
  if (target.id === "dropped") {
    const [file] = target.files;
    if (!confirm(`Put ${file.name} into ${$("folder").textContent}?`)) return;
    await put(file.name, file);
    $("log-file").value = file.name;
  }
  if (target.id === "scene-file") seen.text = $("scene-text").value;
  if (["dropped", "log-file"].includes(target.id)) {
    $("columns").reset();
    Object.assign(seen, { findings: [], outputs: [] });
  }
  if (target.form !== $("facts") && !["range", "textarea"].includes(target.type)) await view();
});
window.onhashchange = view;
window.onresize = () => $("profile").hidden || move(true);

/** Tell what runs, as long as this tab is open. */
async function beat() {
  const { body } = await fetch("alive/");
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    const stage = part.value.trim().split("\n").at(-1);
    $("job").hidden = !stage;
    $("stage").textContent = stage;
  }
}
beat().catch(() => {}).finally(() => say("haptune has ended; start it again with haptune open.", true));
await guarded(list);
await guarded(showFacts);
await view();
