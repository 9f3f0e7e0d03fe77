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
const read = (file) => ask("show/document", { file });
const tell = (id, textContent, className = "") => Object.assign($(id), { textContent, className });
const seen = { files: {}, findings: [], outputs: [], text: "" };

async function ask(path, body, method = "POST") {
  const answer = await fetch(path, { method, body: method === "PUT" ? body : JSON.stringify(body) });
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

/** Do what was asked for; what is refused is said. Beside each button stands what it runs. */
async function guarded(work) {
  await work().catch((error) => tell("said", error.message, "is-refusal"));
  $("shown").hidden = !seen.profile;
  for (const each of document.querySelectorAll("[data-output]"))
    each.hidden = !seen.outputs.includes(each.dataset.output);
  for (const button of document.querySelectorAll("[data-run]")) {
    const words = wordsOf(button);
    button.disabled = words.includes("");
    button.nextElementSibling.textContent = button.disabled ? "" : shell(words);
  }
}

/** The choices of a box, of which the first that is wished for and there is chosen. */
function offer(box, names, ...wishes) {
  const wanted = wishes.find((name) => names.includes(name));
  box.replaceChildren(...names.map((name) => new Option(name || "as named", name, false, name === wanted)));
}

/** The files that there are: what was written is chosen, then what was before, then the usual one. */
async function list(written = []) {
  const { folder, files } = await (await fetch("folder/")).json();
  $("folder").textContent = folder;
  seen.files = files;
  for (const kind of ["log", "device", "scene", "profile"])
    offer($(`${kind}-file`), files[kind] ?? [], ...written, chosen(kind), `${kind}.yaml`);
  if (written.includes(chosen("scene"))) seen.text = $("scene-text").value;
}

async function put(name, content) {
  const { backup } = await ask(`file/${encodeURIComponent(name)}`, content, "PUT");
  await list([name]);
  tell("said", `written: ${name}${backup ? `; the file before is ${backup}` : ""}`);
}

async function run(button) {
  tell("said", "");
  const { exit_code, message, outputs, findings } = await ask("run/", wordsOf(button));
  const written = outputs.length ? `written: ${outputs.join(", ")}` : "";
  tell("said", message ?? written, exit_code ? "is-refusal" : "");
  await list(outputs);
  if (!$("log").hidden) seen.findings = findings;
  seen.outputs.push(...outputs);
  if (outputs.includes("fit.png")) $("fit").querySelector("img").src = `file/fit.png?${Date.now()}`;
  if (!exit_code && button.dataset.next) location.hash = button.dataset.next;
  else await view();
}

// Log -----------------------------------------------------------------------------------------
const UNITS = { force: "N (N·m)", position: "m (rad)", reference: "m (rad)" };
const stated = () => seen.files.hardware?.includes("hardware.yaml");

/** What the fields of a form say, of which a name may lead into a group; blank ones are left out. */
function gather(form) {
  const found = {};
  for (const { name, value, tagName } of form.elements) {
    const [key, inner] = name.split(".");
    const meant = tagName === "SELECT" || Number.isNaN(+value) ? value : +value;
    if (value.trim()) found[key] = inner ? { ...found[key], [inner]: meant } : meant;
  }
  return found;
}

async function showFacts() {
  seen.facts = stated() ? (await read("hardware.yaml")).content : {};
  for (const field of $("facts").elements) {
    const fact = field.name.split(".").reduce((group, key) => group?.[key], seen.facts);
    field.value = field.dataset.was = fact?.value ?? fact ?? "";
  }
}

/** The facts that were there, with their intervals, but those that were written anew or cleared. */
function facts() {
  const anew = [...$("facts").elements].filter(({ value, dataset }) => value !== dataset.was);
  const found = { schema: "haptune/hardware/1", ...seen.facts };
  for (const key of anew.map(({ name }) => name.split(".")[0])) found[key] = gather($("facts"))[key];
  return JSON.stringify(found);
}

async function showLog() {
  if (!chosen("log")) return;
  const told = await ask("show/log", { file: chosen("log"), columns: gather($("columns")) });
  for (const box of $("columns").querySelectorAll("select")) offer(box, ["", ...told.names], box.value);
  $("reading").textContent = told.reading;
  $("curves").replaceChildren();
  const spans = seen.findings.flatMap(({ at, code }) => at.map((ends, row) => [...ends, row ? "" : code]));
  for (const [name, [x, y]] of Object.entries(told.curves)) {
    const where = $("curves").appendChild(make("div"));
    chart(where, { title: `${name}, ${UNITS[name]}`, lines: [{ x, y, kind: "line" }], spans, height: 170 });
  }
  $("findings").replaceChildren(
    ...seen.findings.flatMap(({ severity, code, at, seen: found, needed, remedy }) => [
      make("dt", { className: `is-${severity}` }, `${severity}: ${code}`, at.length ? ` at ${at[0][0].toPrecision(4)} s` : ""),
      make("dd", {}, `${found}; needed: ${needed}. ${remedy}`),
    ]),
  );
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
  if (chosen("device")) $("device-table").replaceChildren(table((await read(chosen("device"))).table));
  if (!chosen("scene") || $("scene-text").value !== seen.text) return;
  seen.text = $("scene-text").value = (await read(chosen("scene"))).text;
}

// Profile -------------------------------------------------------------------------------------
const MARGINS = ["firm", "balanced", "conservative"];
const SLIDES = { ...SCALES, margin: [(word) => MARGINS.indexOf(word), (place) => MARGINS[place], 1] };

/** Nothing of a profile is shown beside the name of another, or of one that is refused. */
async function showProfile() {
  const file = chosen("profile");
  $("shown").hidden ||= seen.profile?.file !== file;
  seen.profile = null;
  if (!file) return;
  const told = await read(file);
  if (file !== chosen("profile")) return;
  seen.profile = { ...told, file };
  $("verdict").textContent = told.verdict;
  $("limits").replaceChildren(table(told.table), ...told.content.notes.map((note) => make("p", {}, note)));
  offer($("element"), Object.keys(told.content.elements), $("element").value);
  start();
}

/** The sliders of the chosen element, where the profile has it. */
function start() {
  const { units, content: { device, loop, margin, elements } } = seen.profile;
  const { stiffness, damping, mass, one_sided: wall } = elements[$("element").value];
  const [m, b] = [device.mass.value, device.damping.value];
  const hertz = [0.001 / loop.sample_time, 0.5 / loop.sample_time];
  const most = (effect, least) => 2 * Math.max(least, ...Object.values(elements).map((each) => Math.abs(each[effect])));
  const sliders = [
    ["stiffness", stiffness, `stiffness K, ${units.stiffness}`, "root", wall ? 1 : 0, most("stiffness", 100)],
    ["damping", damping, `damping B, ${units.damping}`, "root", wall ? 0 : -b, most("damping", 10 * b)],
    ["mass", mass, `mass M, ${units.mass}`, "root", -0.9 * m, most("mass", m)],
    ["velocity_filter", loop.velocity_filter_hz, "velocity cut-off, Hz", "log", ...hertz],
    ["acceleration_filter", loop.acceleration_filter_hz, "acceleration cut-off, Hz", "log", ...hertz],
    ["margin", margin.name, "margin", "margin", "firm", "conservative"],
    ["extra_delay_samples", 0, "more delay, samples", "linear", 0, 4],
  ];
  const used = sliders.filter(([key, value]) => value != null && !(wall && key === "mass"));
  $("sliders").replaceChildren(...used.map(slider));
  seen.state = Object.fromEntries(sliders);
  seen.start = JSON.stringify(seen.state);
  move(true);
}

function slider([key, value, words, scale, low, high]) {
  const [to, from, step = "any"] = SLIDES[scale];
  const slide = make("input", { type: "range", min: to(low), max: to(high), step, id: `slide-${key}` });
  const exact = make("output", {}, value);
  slide.value = to(value);
  slide.oninput = () => {
    const moved = from(+slide.value);
    seen.state[key] = exact.textContent = scale === "margin" ? moved : Number(moved.toPrecision(4));
    move(false);
  };
  return make("label", {}, make("span", {}, words), slide, exact);
}

/** Ask for where the sliders stand: at once while they move, to be proved when they rest. */
async function move(proved) {
  if (!seen.profile) return;
  $("whole").disabled = JSON.stringify(seen.state) !== seen.start;
  if ($("whole").disabled) tell("mark", "not proved", "open");
  const files = { device: chosen("device"), profile: chosen("profile"), element: $("element").value };
  const before = seen.wanted;
  seen.wanted = { ...files, ...seen.state, ends: proved ? null : seen.ends, proved };
  clearTimeout(seen.rest);
  if (!proved) seen.rest = setTimeout(() => move(true), 400);
  if (before) return;
  await guarded(async () => {
    for (let asked; asked !== seen.wanted; ) {
      asked = seen.wanted;
      const told = await ask("show/moved", asked);
      if (asked.profile === seen.profile?.file) draw(told, asked);
    }
  });
  seen.wanted = null;
}

function draw(told, { device, profile, element, ends, proved, ...state }) {
  const { units, content: { elements } } = seen.profile;
  seen.ends = told.ends;
  const rested = told.safe ? "this element alone is proved safe; the whole is not proved" : "not safe as it stands";
  if ($("whole").disabled) tell("mark", proved ? rested : "not proved", "open");
  else tell("mark", `proved: ${profile}`, "proved");
  const given = Object.entries(state).flatMap(([key, now]) => (now ? [`--${key.replaceAll("_", "-")}`, now] : []));
  $("audited").textContent = shell(["audit", device, "--like", `${profile},${element}`, ...given]);
  $("faults").replaceChildren(...told.faults.map((words) => make("li", { className: "is-refusal" }, words)));
  $("audit").replaceChildren(table(told.table));
  const [damping, best, worst, safe] = told.region;
  const all = Object.entries({ ...elements, [element]: state });
  const points = all.map(([words, each]) => [each.damping, each.stiffness, words, words === element]);
  const high = 1.15 * Math.max(...safe, state.stiffness) || Math.max(...best.filter(Number.isFinite)) || 1;
  chart($("region"), {
    title: `stable stiffness and damping at M = ${state.mass} ${units.mass}`, points,
    x: { label: `damping B, ${units.damping}`, scale: "root" },
    y: { scale: "root", ends: [0, high] },
    lines: [
      { x: damping, y: best, kind: "area pale", name: "stable, best estimate" },
      { x: damping, y: safe, kind: "area safe", name: "with the whole margin" },
      { x: damping, y: worst, kind: "line edge", name: "worst corner of the box" },
    ],
  });
  const answer = state.stiffness > 0 ? `position, ${units.length}` : `speed, ${units.speed}`;
  chart($("step"), {
    title: `answer to a step of ${told.force.toPrecision(3)} ${units.force}: ${answer}`,
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
  if (target.id === "save-scene") guarded(() => put(chosen("scene") || "scene.yaml", $("scene-text").value));
  if (target.id === "state") guarded(() => put("hardware.yaml", facts()));
};
document.onchange = ({ target }) => guarded(async () => {
  const [file] = target.files ?? [];
  if (file && !confirm(`Put ${file.name} into ${$("folder").textContent}?`)) return;
  if (file) await put(file.name, file);
  if (target.id === "scene-file") seen.text = $("scene-text").value;
  if (file || target.id === "log-file") {
    $("columns").reset();
    Object.assign(seen, { findings: [], outputs: [] });
  }
  if (target.form !== $("facts") && !["range", "textarea"].includes(target.type)) await view();
});
window.onhashchange = view;
window.onresize = () => $("profile").hidden || move(true);

/** Tell what runs, as long as this tab is open. */
const alive = new EventSource("alive/");
alive.onmessage = ({ data }) => tell("stage", data);
alive.onerror = () => tell("said", "haptune has ended; start it again with haptune open.", "is-refusal");
await guarded(list);
await guarded(showFacts);
await view();
