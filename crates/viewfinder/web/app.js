// The page: puts the parts together, turns states of the camera into dials, and keys into commands.

import { Choice, Dial, Ring, h, select, toggle } from "./dials.js";
import { Drive, Flash } from "./drive.js";
import { Finder, drawHistogram, drawWaveform } from "./finder.js";
import { Link } from "./link.js";
import { Chooser, Develop, Film, Optics } from "./panels.js";
import { T, metres, seconds, signed, stop } from "./texts.js";

const AIDS = ["zebra", "peaking", "falseColor", "depth", "grid", "histogram", "waveform", "magnifier"];
const kept = {
  get: (key) => { try { return JSON.parse(localStorage.getItem(`diopter-${key}`)); } catch { return null; } },
  set: (key, value) => { try { localStorage.setItem(`diopter-${key}`, JSON.stringify(value)); } catch { /* Private windows keep nothing. */ } },
};

document.title = T.title;
const catalog = await (await fetch("/api/catalog")).json();
const link = new Link();
let state = null;
let frame = null;
let problems = 0;
let failures = 0;
let tool = "focus";
let pointed = null;
// Seen by tests.
const seen = (window.diopter = { frames: 0, state: null, header: null, link });

// --- Parts

const finder = new Finder(link, {
  click: (at) => {
    if (tool === "focus") link.send({ do: "focus", at });
    else if (tool === "white") link.send({ do: "white", at });
    else link.set({ exposure: { metering: "spot", metering_at: at } });
  },
  point: (at) => {
    pointed = at;
    if (at) link.ask(at);
    else showNumbers(null);
  },
});

const thirds = (list) => list.third;
const dial = {
  aperture: new Dial(T.aperture, (v) => link.set({ exposure: { aperture: v } })),
  shutter: new Dial(T.shutter, (v) => link.set({ exposure: { shutter: v } })),
  iso: new Dial(T.iso, (v) => link.set({ exposure: { iso: v } })),
  compensation: new Dial(T.compensation, (v) => link.set({ exposure: { compensation: v } })),
};
// Where the hand is on the focus ring, equal ways are equal changes of 1 / distance, as on lenses.
const nearest = () => state?.facts?.nearest_m ?? Math.max(0.1, (2.2 * (state?.facts?.exposure?.focal_length_mm ?? 50)) / 1000);
const focus = new Ring(T.focusDistance, (m) => (m === null ? 1 : Math.max(0, 1 - nearest() / m)), (t) => (t >= 0.9995 ? null : nearest() / (1 - t)), (m) => metres(m), (m) => link.set({ focus: { distance: m === null ? "inf" : m } }));
const span = () => state?.facts?.exposure?.lens_range?.map((r) => r[0]) ?? [12, 300];
const zoom = new Ring(T.zoom, (f) => Math.log(f / span()[0]) / Math.log(span()[1] / span()[0]), (t) => span()[0] * (span()[1] / span()[0]) ** t, (f) => `${f < 20 ? f.toFixed(1) : f.toFixed(0)} mm`, (f) => link.set({ camera: { focal_length: f, fov_deg: null, zoom_position: null } }));
const mode = new Choice(T.mode, Object.entries(T.modes).map(([v, [t, hint]]) => [v, t, hint]), setMode);
const tools = new Choice(T.tool, Object.entries(T.tools).map(([v, [t, hint]]) => [v, t, hint]), (v) => {
  tool = v;
  tools.show(v);
});
tools.show(tool);
const white = select(T.white, [...Object.entries(T.balances), ["patch", T.whitePatch]], (v) => v !== "patch" && link.set({ develop: { white: { balance: v, patch: null } } }));
const metering = select(T.metering, Object.entries(T.meteringNames), (v) => link.set({ exposure: { metering: v, metering_at: v === "spot" ? (state.shot.exposure.metering_at ?? null) : null } }));
const light = select(T.light, Object.entries(T.lights), (v) => link.set({ scene: { light: v || null } }));
const size = h("input", { id: "size", type: "text", spellcheck: "false", onchange: () => link.set({ render: { size: size.value.trim() || null } }) });
const samples = h("input", { id: "samples", type: "number", min: "1", max: "4096", onchange: () => link.set({ render: { spp: Number(samples.value) || null } }) });
const time = new Ring(T.time, (s) => (s - timeline()[0]) / (timeline()[1] - timeline()[0]), (t) => timeline()[0] + t * (timeline()[1] - timeline()[0]), (s) => `${s.toFixed(3)} s`, (s) => link.set({ scene: { at: s } }));
const timeline = () => state?.facts?.timeline ?? [0, 1];
const scene = select(T.menus.scene, [], (file) => {
  // Another scene is framed and lit in its own way; body and lens stay, unless the lens is the ideal one of the scene before.
  const nothing = (keys) => Object.fromEntries(keys.map((key) => [key, null]));
  const { lens } = state.shot.camera;
  link.set({
    scene: { ...nothing(Object.keys(state.shot.scene)), file },
    camera: { ...nothing(["look_from", "look_at", "up", "viewpoint", "path", "focal_length", "fov_deg", "zoom_position"]), lens: lens === "thin" ? null : lens },
    focus: nothing(Object.keys(state.shot.focus)),
  });
});

const histogram = h("canvas", { class: "histogram", width: "280", height: "86", role: "img" });
const waveform = h("canvas", { class: "waveform", width: "280", height: "110", role: "img", "aria-label": T.aids.waveform });
const clipping = h("div", { class: "clipping", "aria-hidden": "true" });
const scope = h("div", { class: "scope" }, h("div", { class: "scopes" }, histogram, clipping), waveform);
const aids = kept.get("aids") ?? { histogram: true };
const aidButtons = Object.fromEntries(AIDS.map((name) => [name, toggle(T.aids[name], T.aidsHints[name], Boolean(aids[name]), (on) => {
  aids[name] = on;
  kept.set("aids", aids);
  showAids();
})]));

const numbers = h("dl", { class: "numbers", "aria-label": T.probe.label });
const meter = h("div", { class: "meter", role: "img" });
const strip = h("div", { class: "strip-info", "aria-label": T.info, role: "group" });
const status = h("div", { class: "status", "aria-live": "off" });
const toast = h("div", { class: "toast", role: "alert", hidden: true });
const lost = h("div", { class: "lost", role: "status", hidden: true }, T.lost);

const develop = new Develop(link, catalog);
const optics = new Optics();
const film = new Film(link, () => finder.bitmap && finder.raw);
const bodies = new Chooser(T.menus.body, (v) => link.set({ camera: { body: v }, exposure: { iso: null } }));
const lenses = new Chooser(T.menus.lens, (v) => link.set({ camera: { lens: v, focal_length: null, zoom_position: null, fov_deg: null } }));
const bodyButton = h("button", { type: "button", class: "menu", onclick: openBodies });
const lensButton = h("button", { type: "button", class: "menu", onclick: openLenses });
const help = h("dialog", { class: "help", "aria-label": T.menus.help },
  h("header", {}, h("h2", {}, T.menus.help), h("button", { type: "button", class: "close", "aria-label": T.close, onclick: () => help.close() }, "×")),
  h("dl", {}, T.help.flatMap(([keys, what]) => [h("dt", {}, keys), h("dd", {}, what)])));
help.addEventListener("click", (e) => e.target === help && help.close());

const button = (text, label, act, extra = {}) => h("button", { type: "button", "aria-label": label, title: label, onclick: act, ...extra }, text);
const flash = new Flash(link);
const drive = new Drive(link, kept, () => state?.facts?.exposure?.focus_distance_m ?? null, showRelease);
const shutterButton = button("", drive.label(), () => drive.release(), { class: "release" });
const moves = h("div", { class: "moves", role: "group", "aria-label": T.move },
  button("◀", T.moves.left, () => link.move("orbit", 0.1, 0)), button("▶", T.moves.right, () => link.move("orbit", -0.1, 0)),
  button("▲", T.moves.up, () => link.move("orbit", 0, 0.07)), button("▼", T.moves.down, () => link.move("orbit", 0, -0.07)),
  button("+", T.moves.nearer, () => link.move("dolly", 0, -0.1)), button("−", T.moves.away, () => link.move("dolly", 0, 0.1)),
  button(T.level, T.moves.level, () => link.move("level", 0, 0), { class: "wide" }));
const af = button(T.autofocus, T.autofocusLong, () => link.send({ do: "focus", at: [0.5, 0.5] }), { class: "small" });
const hyper = button(T.hyperfocal, T.hyperfocal, () => link.set({ focus: { distance: "hyperfocal" } }), { class: "small" });

const cameraPanel = h("div", { class: "panel camera" },
  h("div", { class: "modes" }, mode.element, meter),
  dial.aperture.element, dial.shutter.element, dial.iso.element, dial.compensation.element,
  h("div", { class: "focusing" }, focus.element, h("div", { class: "row" }, af, hyper, tools.element)),
  zoom.element, time.element, moves, drive.element, flash.element,
  h("div", { class: "fields" }, white.element, metering.element, light.element,
    h("div", { class: "field" }, h("label", { for: "size" }, T.size), size), h("div", { class: "field" }, h("label", { for: "samples" }, T.samples), samples)));
const aidsPanel = h("div", { class: "panel aids" }, h("div", { class: "toggles" }, Object.values(aidButtons)), scope, numbers);

const panels = { camera: cameraPanel, aids: aidsPanel, develop: develop.element, optics: optics.element };
const tabs = Object.entries(T.panels).map(([name, text]) =>
  h("button", { type: "button", role: "tab", id: `tab-${name}`, "aria-controls": `panel-${name}`, onclick: () => openPanel(name) }, text));
for (const [name, element] of Object.entries(panels)) {
  element.id = `panel-${name}`;
  element.setAttribute("role", "tabpanel");
  element.setAttribute("aria-labelledby", `tab-${name}`);
}
const tabList = h("div", { class: "tabs", role: "tablist", "aria-label": T.panelsLabel }, tabs);
tabList.addEventListener("keydown", (e) => {
  const by = { ArrowRight: 1, ArrowLeft: -1 }[e.key];
  if (!by) return;
  e.preventDefault();
  e.stopPropagation();
  const names = Object.keys(panels);
  const name = names[(names.indexOf(kept.get("panel") ?? "camera") + by + names.length) % names.length];
  openPanel(name);
  document.getElementById(`tab-${name}`).focus();
});

function openPanel(name) {
  if (!panels[name]) name = "camera";
  kept.set("panel", name);
  for (const [other, element] of Object.entries(panels)) {
    element.hidden = other !== name;
    const tab = document.getElementById(`tab-${other}`) ?? tabs[Object.keys(panels).indexOf(other)];
    tab.setAttribute("aria-selected", String(other === name));
    tab.tabIndex = other === name ? 0 : -1;
  }
  if (state) optics.draw(opticsKey(), pointed);
  if (name === "aids") showScopes();
}

document.body.append(
  h("header", { class: "top" }, h("h1", {}, h("img", { src: "/icon.svg", alt: "", width: "22", height: "22" }), T.name), scene.element, bodyButton, lensButton, status,
    h("div", { class: "end" }, button("⟲", `${T.menus.reset}: ${T.resetHint}`, () => link.send({ do: "reset" })), button("◐", T.menus.theme, turnTheme), button("?", T.menus.help, () => help.showModal()))),
  h("main", {},
    h("section", { class: "view", "aria-label": T.title }, finder.element, drive.counter, strip),
    h("section", { class: "side", "aria-label": T.panelsLabel }, tabList, ...Object.values(panels))),
  h("footer", {}, film.element, drive.badge, shutterButton), drive.spoken, toast, lost, bodies.element, lenses.element, film.viewer.element, help);
turnTheme(null);
openPanel(kept.get("panel") ?? "camera");
showAids();

// --- From the camera to the page

link.addEventListener("open", () => (lost.hidden = true));
link.addEventListener("lost", () => (lost.hidden = false));
link.addEventListener("problem", (e) => showProblem(e.detail.problem));
link.addEventListener("probe", (e) => showNumbers(e.detail));
link.addEventListener("state", (e) => {
  // What went wrong before this page was opened is no news.
  const news = state !== null;
  state = seen.state = e.detail;
  if (state.problem && state.problem.number > problems) {
    problems = state.problem.number;
    if (news) showProblem(state.problem.problem);
  }
  if (state.queue.failed && state.queue.failed.id > failures) {
    failures = state.queue.failed.id;
    if (news) showProblem(state.queue.failed.problem);
  }
  film.show(state);
  drive.countDown(state.timer);
  drive.begin(state.shot.sequence);
  showStatus();
  if (state.facts) showState();
});
link.addEventListener("frame", async (e) => {
  const next = e.detail;
  try {
    await finder.show(next);
    frame = next;
    seen.header = next.header;
    seen.frames++;
    showFrame();
  } finally {
    // The next may come now: the latest there is then.
    link.send({ do: "ack", frame: next.header.frame });
  }
});

function showProblem(problem, title = T.problem) {
  const hint = problem.hint && !problem.message.includes(problem.hint) ? [h("i", {}, problem.hint)] : [];
  toast.replaceChildren(h("b", {}, title), h("span", {}, problem.message), ...hint, button("×", T.close, () => (toast.hidden = true), { class: "close" }));
  toast.hidden = false;
  clearTimeout(showProblem.timer);
  showProblem.timer = setTimeout(() => (toast.hidden = true), 12000);
}

function showRelease() {
  if (!drive?.label || !shutterButton) return;
  const label = drive.label();
  shutterButton.title = label;
  shutterButton.setAttribute("aria-label", label);
  shutterButton.classList.toggle("counting", Boolean(drive.timer));
}

function nearestIndex(values, value) {
  let best = 0;
  values.forEach((v, i) => {
    if (Math.abs(Math.log(v / value)) < Math.abs(Math.log(values[best] / value))) best = i;
  });
  return best;
}

function showState() {
  const { facts, shot } = state;
  const e = facts.exposure;
  const m = e.mode || "A";
  mode.show(m);
  const stops = thirds(catalog.apertures).filter((n) => n >= facts.widest * 0.97 && n <= Math.max(22, facts.widest));
  if (stops[0] > facts.widest * 1.03) stops.unshift(Number(facts.widest.toFixed(2)));
  dial.aperture.show(stops.map((n) => ({ label: stop(n).slice(2), value: `f/${n}`, long: stop(n) })), nearestIndex(stops, e.f_number), stop(e.f_number), m === "S" || m === "P");
  const times = thirds(catalog.times);
  dial.shutter.show(times.map(([n, name]) => ({ label: name.replace(" s", "").replace("1/", "") + (n >= 0.3 && n !== 0.5 ? "″" : ""), value: name, long: name })), nearestIndex(times.map((t) => t[0]), e.exposure_s), seconds(e.exposure_s), m === "A" || m === "P");
  const autoIso = shot.exposure.iso === "auto";
  const isos = facts.isos;
  dial.iso.show([{ label: T.auto, value: "auto" }, ...isos.map((n) => ({ label: String(n), value: n, long: `ISO ${n}` }))], autoIso ? 0 : 1 + nearestIndex(isos, e.iso), autoIso ? `${T.auto} ${Math.round(e.iso)}` : `ISO ${Math.round(e.iso)}`);
  const evs = Array.from({ length: 31 }, (_, i) => (i - 15) / 3);
  const comp = e.compensation_ev;
  dial.compensation.show(evs.map((v) => ({ label: signed(v), value: Number(v.toFixed(4)), long: `${signed(v)} EV` })), Math.round(comp * 3) + 15, `${signed(comp)} EV`, m === "M" && !autoIso);
  if (m === "M" && !autoIso) dial.compensation.note.textContent = "";
  const dof = facts.depth_of_field;
  focus.element.hidden = facts.pinhole;
  focus.show(e.focus_distance_m, dof ? `${metres(dof.near_m)} – ${metres(dof.far_m)}` : "");
  const range = span();
  zoom.element.hidden = !(facts.ideal || (facts.zoom && range[1] > range[0] * 1.01));
  zoom.show(e.focal_length_mm);
  time.element.hidden = !facts.timeline;
  if (facts.timeline) time.show(e.at_s);
  const w = shot.develop.white;
  white.input.value = w.patch ? "patch" : w.balance in T.balances ? w.balance : "";
  metering.input.value = e.metering || "average";
  light.input.value = shot.scene.light ?? "";
  if (document.activeElement !== size) size.value = facts.size.join("x");
  if (document.activeElement !== samples) samples.value = shot.render.spp ?? 64;
  const named = shot.scene.file ?? "still-life";
  const list = [...catalog.scenes.map((s) => [s.name, s.name]), ...catalog.files.scenes.map((f) => [f, f.split(/[\\/]/).pop()])];
  if (!list.some(([v]) => v === named)) list.push([named, named.split(/[\\/]/).pop()]);
  if (scene.known !== JSON.stringify(list)) {
    scene.fill(list);
    scene.known = JSON.stringify(list);
  }
  scene.input.value = named;
  bodyButton.replaceChildren(h("small", {}, T.menus.body), facts.body.name);
  lensButton.replaceChildren(h("small", {}, T.menus.lens), e.lens);
  showMeter(facts.meter_ev);
  const part = (cls, text) => h("span", { class: cls }, text);
  strip.replaceChildren(part("m", m), part("", seconds(e.exposure_s)), part("", stop(e.f_number)), scale(facts.meter_ev), part("", `ISO ${Math.round(e.iso)}`),
    part("", comp ? `${signed(comp)} EV` : ""), part("", facts.pinhole ? "" : metres(e.focus_distance_m)), part("last", e.flash ? T.flash.title : ""), part("last", `${e.focal_length_mm.toFixed(0)} mm`));
  finder.marks = [];
  // Where autofocus looked: green where it found something, red where not.
  const report = JSON.stringify(state.focus);
  for (const [i, { zone }] of (state.focus?.zones ?? []).entries()) {
    if (state.focus.chosen === null || i === state.focus.chosen) finder.marks.push({ at: [zone[0] + zone[2] / 2, zone[1] + zone[3] / 2], color: state.focus.chosen === null ? "#ff6a5e" : "#7dff8a" });
  }
  if (showState.report !== undefined && report !== showState.report && state.focus?.chosen === null) showProblem({ message: T.focusFailed }, T.notice);
  showState.report = report;
  if (e.metering === "spot") finder.marks.push({ at: shot.exposure.metering_at ?? [0.5, 0.5], color: "#ffd24a", round: true });
  finder.draw();
  flash.show(shot, facts);
  develop.show(shot.develop);
  optics.show(state);
  optics.draw(opticsKey(), pointed);
  film.show(state);
}

const opticsKey = () => {
  const e = state.facts.exposure;
  return [e.lens, e.focal_length_mm, e.f_number, e.extension_mm, seen.header?.version].join("|");
};

// The needle of the meter: the setting against what was metered, from −3 to +3 EV.
function scale(ev) {
  const bar = h("span", { class: "scale", "aria-hidden": "true" });
  for (let i = -9; i <= 9; i++) {
    const tick = h("i", { class: i === 0 ? "zero" : i % 3 === 0 ? "full" : "" });
    bar.append(tick);
  }
  if (ev !== null && ev !== undefined) {
    const needle = h("b");
    needle.style.left = `${50 + (Math.max(-3.2, Math.min(3.2, ev)) * 100) / 6.6}%`;
    bar.append(needle);
  }
  return bar;
}

function showMeter(ev) {
  meter.setAttribute("aria-label", T.meter(ev ?? null));
  meter.replaceChildren(scale(ev), h("span", { class: "ev" }, ev === null || ev === undefined ? "–" : `${signed(ev)} EV`));
}

function showStatus() {
  const f = frame?.header;
  status.classList.toggle("busy", Boolean(state?.busy));
  if (state?.busy) status.textContent = T.busy[state.busy];
  else if (f) status.textContent = f.done ? T.done : f.size[0] < f.whole[0] ? T.preview : T.refining(f.samples, f.of_samples);
}

function showFrame() {
  showStatus();
  if (state?.facts) optics.draw(opticsKey(), pointed);
  showScopes();
}

function showScopes() {
  if (!frame) return;
  histogram.hidden = clipping.hidden = !aids.histogram;
  waveform.hidden = !aids.waveform;
  if (aidsPanel.hidden) return;
  if (aids.histogram) {
    drawHistogram(histogram, frame.header);
    const percent = (v) => `${(100 * v).toFixed(v > 0 && v < 0.001 ? 2 : 1)} %`;
    const parts = frame.header.histogram.map((c) => `${c.channel} ${percent(c.clipped)}`);
    histogram.setAttribute("aria-label", T.histogramLabel(parts.join(", ")));
    clipping.replaceChildren(h("span", {}, T.stops), ...frame.header.histogram.map((c) => h("span", { class: c.clipped > 0 ? `channel ${c.channel} hot` : `channel ${c.channel}` }, `${c.channel} ${percent(c.clipped)}`)), h("span", {}, T.clipped));
  }
  if (aids.waveform) drawWaveform(waveform, finder.data());
}

function showAids() {
  finder.aids = aids;
  for (const [name, b] of Object.entries(aidButtons)) b.setAttribute("aria-pressed", String(Boolean(aids[name])));
  finder.draw();
  showScopes();
}

function showNumbers(n) {
  if (!n) {
    numbers.replaceChildren(h("dt", {}, T.probe.label), h("dd", {}, T.probe.none));
    return;
  }
  const row = (name, text) => [h("dt", {}, name), h("dd", {}, text)];
  const order = (band) => "RGBW".indexOf(band[0]);
  const electrons = Object.entries(n.electrons).sort(([a], [b]) => order(a) - order(b)).map(([band, v]) => `${band} ${v >= 100 ? Math.round(v) : v.toFixed(1)}`).join("  ");
  const circles = finder.blurAt(n.at);
  const blur = circles === null ? "–" : `${(Math.abs(circles) * state.facts.circle_mm * 1000).toFixed(0)} µm, ${((Math.abs(circles) * state.facts.circle_mm * state.facts.size[0]) / state.facts.film_mm[0]).toFixed(1)} px`;
  numbers.replaceChildren(...row(`${T.probe.electrons} e⁻`, electrons), ...row(`${T.probe.dn} DN`, `${n.channel} ${n.dn}${n.saturated ? ` (${T.probe.full})` : ""}`),
    ...row(T.probe.depth, n.depth_m === null ? T.probe.sky : metres(n.depth_m)), ...row(T.probe.ev, n.ev100 === null ? "–" : `EV ${n.ev100.toFixed(1)}`), ...row(T.probe.blur, blur));
  optics.draw(opticsKey(), pointed);
}
showNumbers(null);

// --- From the page to the camera

function setMode(m) {
  const e = state.facts.exposure;
  const times = thirds(catalog.times);
  const time = times[nearestIndex(times.map((t) => t[0]), e.exposure_s)][1];
  const stops = thirds(catalog.apertures);
  // What was chosen by the camera is where the hand begins.
  const aperture = state.shot.exposure.aperture ?? (Math.abs(e.f_number - facts_widest()) < 0.01 ? null : `f/${stops[nearestIndex(stops, e.f_number)]}`);
  link.set({ exposure: { mode: m, shutter: m === "M" || m === "S" ? (state.shot.exposure.shutter ?? time) : null, aperture: m === "M" || m === "A" ? aperture : null } });
}
const facts_widest = () => state.facts.widest;

function openBodies() {
  const options = catalog.bodies.map((b) => ({ value: b.name, title: b.title, about: `${b.format_mm.map((v) => v.toFixed(1)).join(" × ")} mm, ${((b.pixels[0] * b.pixels[1]) / 1e6).toFixed(1)} MP, ${b.cfa}`, more: `${b.pixels.join(" × ")} px` }));
  bodies.open(options, state.shot.camera.body ?? "canon-5d-mark-iv");
}

function openLenses() {
  const mm = (l) => (l.zoom_mm ? `${l.zoom_mm.map((v) => v.toFixed(0)).join("–")} mm` : l.focal_mm ? `${l.focal_mm.toFixed(0)} mm` : "");
  const real = catalog.lenses.map((l) => ({ value: l.name, title: l.name, about: [mm(l), l.f_number ? stop(l.f_number) : ""].filter(Boolean).join(" "), more: l.source, image: `/api/lens.svg?name=${encodeURIComponent(l.name)}` }));
  const files = catalog.files.lenses.map((f) => ({ value: f, title: f.split(/[\\/]/).pop(), about: f }));
  lenses.open([{ value: null, title: T.noLens, about: "" }, ...T.ideal.map(([value, title, about]) => ({ value, title, about })), ...real, ...files], state.shot.camera.lens ?? null);
}

function turnTheme(event) {
  const system = matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
  let theme = kept.get("theme") ?? system;
  if (event) {
    theme = theme === "dark" ? "light" : "dark";
    kept.set("theme", theme);
  }
  document.documentElement.dataset.theme = theme;
  if (frame) showScopes();
}

const flip = (name) => aidButtons[name].click();
const KEYS = {
  "[": () => dial.aperture.turn(-1), "]": () => dial.aperture.turn(1), ";": () => dial.shutter.turn(-1), "'": () => dial.shutter.turn(1),
  i: () => dial.iso.turn(1), I: () => dial.iso.turn(-1), e: () => dial.compensation.turn(1), E: () => dial.compensation.turn(-1),
  m: () => setMode("M"), a: () => setMode("A"), s: () => setMode("S"), p: () => setMode("P"),
  f: () => link.send({ do: "focus", at: [0.5, 0.5] }), l: () => link.move("level", 0, 0),
  z: () => flip("zebra"), k: () => flip("peaking"), c: () => flip("falseColor"), d: () => flip("depth"), g: () => flip("grid"), h: () => flip("histogram"), w: () => flip("waveform"), x: () => flip("magnifier"),
  b: () => drive.nextKind(), t: () => drive.nextTime(), o: () => flash.turn(),
  "+": () => link.move("dolly", 0, -0.08), "=": () => link.move("dolly", 0, -0.08), "-": () => link.move("dolly", 0, 0.08), "?": () => help.showModal(),
};
const ARROWS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

addEventListener("keydown", (e) => {
  if (!state?.facts || e.ctrlKey || e.metaKey || e.defaultPrevented || document.querySelector("dialog[open]")) return;
  const on = e.target;
  const types = on.closest?.("input, select, textarea");
  const inFinder = on === finder.stage || on === document.body;
  if (ARROWS[e.key] && inFinder) {
    const [x, y] = ARROWS[e.key];
    if (e.shiftKey) link.move("pan", 0.03 * x, 0.03 * y);
    else if (e.altKey) link.move("turn", 0.03 * x, 0.03 * y);
    else link.move("orbit", 0.06 * x, 0.06 * y);
  } else if (e.key === "Enter" && inFinder) drive.release();
  else if (e.key === "Escape" && drive.timer) drive.stop();
  else if (KEYS[e.key] && !types && !e.altKey) KEYS[e.key]();
  else return;
  e.preventDefault();
});
