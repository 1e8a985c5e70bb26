// What the release does (one picture, a bracket, a focus stack, behind a self-timer) and the flash.

import { Dial, h, select, toggle } from "./dials.js";
import { T, metres, signed, stop } from "./texts.js";

const TIMES = [0, 2, 10]; // Seconds of the self-timer.
const COUNTS = [3, 5, 7, 9, 15, 25, 36];
const STEPS = [1 / 3, 0.5, 2 / 3, 1, 1.5, 2, 3]; // EV
const POWERS = 21; // Thirds of a stop below full power: down to 1/128.

// A number with its label; `changed` gets it, or null where the field is empty.
function numberField(label, attributes, changed) {
  const id = `drive-${numberField.count++}`;
  const input = h("input", { id, type: "number", ...attributes });
  input.addEventListener("change", () => changed(input.value === "" ? null : Number(input.value)));
  return { element: h("div", { class: "field" }, h("label", { for: id }, label), input), input };
}
numberField.count = 0;

// Release and self-timer. `kept` remembers them from one visit to the next; `current()` is the focus distance, m (null: infinity).
export class Drive {
  constructor(link, kept, current, changed) {
    this.link = link;
    this.kept = kept;
    this.changed = () => {}; // The page is not put together yet.
    this.timer = null;
    this.asked = { kind: "single", timer: 0, bracket: { count: 3, step: 1 }, focus: { count: 5, near: 0.5, far: null }, ...kept.get("drive") };
    const a = this.asked;
    this.kind = select(T.drive.release, Object.entries(T.drive.kinds), (v) => this.set({ kind: v }));
    this.time = select(T.drive.timer, TIMES.map((t) => [String(t), t ? T.drive.seconds(t) : T.drive.off]), (v) => this.set({ timer: Number(v) }));
    const counts = (of) => select(T.drive.count, COUNTS.map((n) => [String(n), String(n)]), (v) => this.set({ [of]: { ...a[of], count: Number(v) } }));
    this.count = { bracket: counts("bracket"), focus: counts("focus") };
    this.step = select(T.drive.step, STEPS.map((v, i) => [String(i), `${Number(v.toFixed(2))} EV`]), (v) => this.set({ bracket: { ...a.bracket, step: STEPS[Number(v)] } }));
    const distance = (end, label, from) => {
      const field = numberField(label, { min: "0.01", step: "any", placeholder: end === "far" ? "∞" : "", inputmode: "decimal" }, (m) => this.set({ focus: { ...a.focus, [end]: m } }));
      const take = h("button", { type: "button", class: "small", "aria-label": from, title: from, onclick: () => this.set({ focus: { ...a.focus, [end]: end === "near" ? (current() ?? a.focus.near) : current() } }) }, T.drive.here);
      return { ...field, element: h("div", { class: "with" }, field.element, take) };
    };
    this.near = distance("near", T.drive.near, T.drive.nearHere);
    this.far = distance("far", T.drive.far, T.drive.farHere);
    this.bracket = h("div", { class: "fields" }, this.count.bracket.element, this.step.element);
    this.stack = h("div", { class: "fields three" }, this.count.focus.element, this.near.element, this.far.element);
    this.badge = h("span", { class: "badge", "aria-hidden": "true" });
    this.element = h("fieldset", { class: "group" }, h("legend", {}, T.drive.title), h("div", { class: "fields wide-first" }, this.kind.element, this.time.element), this.bracket, this.stack);
    this.counter = h("div", { class: "countdown", hidden: true },
      h("span", { class: "digits", role: "timer", "aria-label": T.drive.timer }),
      h("button", { type: "button", onclick: () => this.stop() }, T.drive.stop));
    this.spoken = h("div", { class: "spoken", role: "status", "aria-live": "assertive", "aria-atomic": "true" });
    this.show();
    this.changed = changed;
  }

  set(change) {
    Object.assign(this.asked, change);
    this.kept.set("drive", this.asked);
    this.show();
  }

  // What a shot file says of series is what its camera begins with, unless this page has chosen already.
  begin(sequence) {
    if (this.begun) return;
    this.begun = true;
    if (this.kept.get("drive") || !(sequence?.bracket >= 2)) return;
    const ev = Math.abs(parseFloat(sequence.step ?? "1")) || 1;
    const step = STEPS.reduce((a, b) => (Math.abs(b - ev) < Math.abs(a - ev) ? b : a));
    this.set({ kind: "bracket", bracket: { count: Math.min(36, sequence.bracket), step } });
  }

  show() {
    const a = this.asked;
    const put = (input, value) => document.activeElement !== input && (input.value = value);
    this.kind.input.value = a.kind;
    this.time.input.value = String(a.timer);
    for (const of of ["bracket", "focus"]) {
      const list = COUNTS.includes(a[of].count) ? COUNTS : [...COUNTS, a[of].count].sort((x, y) => x - y);
      this.count[of].fill(list.map((n) => [String(n), String(n)]));
      this.count[of].input.value = String(a[of].count);
    }
    this.step.input.value = String(Math.max(0, STEPS.findIndex((v) => Math.abs(v - a.bracket.step) < 1e-6)));
    put(this.near.input, a.focus.near === null ? "" : Number(a.focus.near.toPrecision(4)));
    put(this.far.input, a.focus.far === null ? "" : Number(a.focus.far.toPrecision(4)));
    this.bracket.hidden = a.kind !== "bracket";
    this.stack.hidden = a.kind !== "focus";
    const parts = [T.drive.badge[a.kind]?.(a[a.kind]), a.timer ? T.drive.seconds(a.timer) : null].filter(Boolean);
    this.badge.textContent = parts.join(", ");
    this.badge.hidden = !parts.length;
    this.changed();
  }

  // For the release button.
  label() {
    if (this.timer) return T.drive.stop;
    const { kind, timer } = this.asked;
    const what = kind === "single" ? T.shoot : T.drive.shoot[kind](this.asked[kind]);
    return timer ? `${what}, ${T.drive.seconds(timer)} ${T.drive.timer.toLowerCase()}` : what;
  }

  release() {
    if (this.timer) {
      this.stop();
      return;
    }
    const { kind, timer, bracket, focus } = this.asked;
    const command = { do: "shoot" };
    if (kind === "bracket") command.series = { kind, count: bracket.count, step_ev: bracket.step };
    // The server says what is wrong with a distance that is left out or too near.
    if (kind === "focus") command.series = { kind, count: focus.count, near_m: focus.near ?? 0, far_m: focus.far };
    if (timer) command.timer_s = timer;
    this.link.send(command);
  }

  stop() {
    this.stopped = true;
    this.link.send({ do: "cancel-timer" });
  }

  next(list, now) {
    return list[(list.indexOf(now) + 1) % list.length];
  }

  nextKind() {
    this.set({ kind: this.next(Object.keys(T.drive.kinds), this.asked.kind) });
    this.say(T.drive.kinds[this.asked.kind]);
  }

  nextTime() {
    this.set({ timer: this.next(TIMES, this.asked.timer) });
    this.say(`${T.drive.timer} ${this.asked.timer ? T.drive.seconds(this.asked.timer) : T.drive.off}`);
  }

  say(text) {
    this.spoken.textContent = text;
  }

  // The self-timer as the camera tells it: every second is shown, and those that matter are said.
  countDown(timer) {
    const before = this.timer;
    this.timer = timer;
    this.counter.hidden = !timer;
    if (timer) {
      this.counter.firstChild.textContent = String(timer.left_s);
      if (!before) {
        this.stopped = false;
        this.say(T.drive.started(Math.ceil(timer.seconds)));
      }
      if (before && timer.left_s !== before.left_s && (timer.left_s <= 5 || timer.left_s % 5 === 0)) this.say(String(timer.left_s));
    } else if (before) this.say(before.left_s <= 1 && !this.stopped ? T.drive.taken : T.drive.stopped);
    if (Boolean(timer) !== Boolean(before)) this.changed();
  }
}

// The flash of the shot file's `[flash]`.
export class Flash {
  constructor(link) {
    this.link = link;
    this.last = { guide_number: 40 };
    this.on = toggle(T.flash.on, T.flash.hint, false, (on) => link.set({ flash: on ? this.last : null }));
    this.guide = numberField(T.flash.guide, { min: "1", max: "10000", step: "any", inputmode: "decimal" }, (n) => n !== null && link.set({ flash: { guide_number: n } }));
    this.sync = select(T.flash.sync, Object.entries(T.flash.syncs), (v) => link.set({ flash: { sync: v } }));
    this.power = new Dial(T.flash.power, (v) => link.set({ flash: { power: v } }));
    this.reach = h("p", { class: "quiet reach" });
    this.details = h("div", { class: "details" }, this.power.element, this.reach, h("div", { class: "fields" }, this.guide.element, this.sync.element));
    this.element = h("fieldset", { class: "group" }, h("legend", {}, T.flash.title), h("div", { class: "row" }, this.on), this.details);
    this.marks = Array.from({ length: POWERS + 1 }, (_, i) => {
      const k = i - POWERS;
      const full = `1/${2 ** Math.floor(-k / 3)}`;
      const thirds = -k % 3;
      return { label: thirds ? signed(-thirds / 3) : full, value: Number((2 ** (k / 3)).toPrecision(6)), long: T.flash.powerOf(thirds ? `${full} ${signed(-thirds / 3)}` : full, k / 3) };
    });
  }

  turn() {
    this.on.click();
  }

  show(shot, facts) {
    const flash = shot.flash ?? null;
    this.on.setAttribute("aria-pressed", String(Boolean(flash)));
    this.details.hidden = !flash;
    if (!flash) return;
    this.last = flash;
    const power = flash.power ?? 1;
    const at = Math.max(0, Math.min(POWERS, Math.round(3 * Math.log2(power)) + POWERS));
    this.power.show(this.marks, at, T.flash.powerOf(`1/${Number((1 / power).toPrecision(2))}`, Math.log2(power)));
    // Guide number = f-number × distance at ISO 100 and full power (ISO 1230).
    const e = facts.exposure;
    this.reach.textContent = T.flash.reach(metres((flash.guide_number * Math.sqrt((power * e.iso) / 100)) / e.f_number), stop(e.f_number), Math.round(e.iso));
    if (document.activeElement !== this.guide.input) this.guide.input.value = Number(flash.guide_number.toPrecision(4));
    this.sync.input.value = { front: "first", rear: "second", hss: "high-speed" }[flash.sync] ?? flash.sync ?? "first";
  }
}
