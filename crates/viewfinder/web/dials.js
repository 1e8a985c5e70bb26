// Controls: a dial whose marks slide under an index, continuous rings, rows of choices; and the small helper that makes elements.

import { T } from "./texts.js";

export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "class") element.className = value;
    else element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children.flat().filter((c) => c !== null && c !== undefined));
  return element;
}

const STEP = 46; // Pixels from mark to mark.
const SHOWN = 6; // Marks on each side of the index.

// A dial of marks. `label` names it; `choose(mark)` is called when it is turned.
export class Dial {
  constructor(label, choose) {
    this.choose = choose;
    this.marks = [];
    this.index = 0;
    this.offset = 0;
    this.held = false;
    this.strip = h("div", { class: "strip", "aria-hidden": "true" });
    this.value = h("output", { class: "value" });
    this.note = h("span", { class: "note" });
    this.wheel = h("div", { class: "wheel", role: "slider", tabindex: "0", "aria-label": label }, this.strip);
    this.element = h("div", { class: "dial" }, h("div", { class: "head" }, h("span", { class: "name" }, label), this.note, this.value), this.wheel);
    this.wheel.addEventListener("keydown", (e) => this.key(e));
    this.wheel.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.turn(Math.sign(e.deltaY || e.deltaX));
    }, { passive: false });
    this.wheel.addEventListener("pointerdown", (e) => this.hold(e));
  }

  // `marks`: [{ label, value }]; `index`: where the dial stands; `byCamera`: it turns by itself.
  show(marks, index, text, byCamera = false) {
    this.byCamera = byCamera;
    this.element.classList.toggle("by-camera", byCamera);
    this.note.textContent = byCamera ? T.byCamera : "";
    this.value.textContent = text;
    this.marks = marks;
    if (!this.held) this.index = index;
    this.wheel.setAttribute("aria-valuemin", "0");
    this.wheel.setAttribute("aria-valuemax", String(Math.max(0, marks.length - 1)));
    this.wheel.setAttribute("aria-valuenow", String(Math.max(0, Math.round(this.index))));
    this.wheel.setAttribute("aria-valuetext", byCamera ? `${text}, ${T.byCamera}` : text);
    this.wheel.setAttribute("aria-disabled", String(byCamera));
    this.draw();
  }

  draw() {
    const middle = Math.round(this.index);
    const spans = [];
    for (let i = middle - SHOWN; i <= middle + SHOWN; i++) {
      const mark = this.marks[i];
      if (!mark) continue;
      const span = h("span", { class: i === middle ? "mark at" : "mark" }, mark.label);
      span.style.transform = `translateX(${(i - this.index - this.offset) * STEP - STEP / 2}px)`;
      spans.push(span);
    }
    this.strip.replaceChildren(...spans);
  }

  turn(by) {
    if (this.byCamera) return;
    const next = Math.min(this.marks.length - 1, Math.max(0, Math.round(this.index) + by));
    if (next === this.index || !this.marks[next]) return;
    this.index = next;
    this.value.textContent = this.marks[next].long ?? this.marks[next].label;
    this.draw();
    this.choose(this.marks[next].value);
  }

  key(e) {
    const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 3, PageDown: -3, Home: -1e6, End: 1e6 };
    if (!(e.key in steps) || e.altKey || e.ctrlKey || e.metaKey) return;
    e.preventDefault();
    e.stopPropagation();
    this.turn(steps[e.key]);
  }

  hold(e) {
    if (this.byCamera || e.button !== 0) return;
    this.held = true;
    const from = e.clientX;
    const start = this.index;
    let moved = false;
    const target = e.target.closest(".mark");
    this.wheel.setPointerCapture(e.pointerId);
    const move = (m) => {
      const by = (from - m.clientX) / STEP;
      moved ||= Math.abs(m.clientX - from) > 4;
      const at = Math.min(this.marks.length - 1, Math.max(0, start + by));
      const next = Math.round(at);
      this.offset = at - next;
      if (next !== this.index && this.marks[next]) {
        this.index = next;
        this.value.textContent = this.marks[next].long ?? this.marks[next].label;
        this.choose(this.marks[next].value);
      }
      this.draw();
    };
    const up = () => {
      this.wheel.removeEventListener("pointermove", move);
      this.wheel.removeEventListener("pointerup", up);
      this.wheel.removeEventListener("pointercancel", up);
      this.held = false;
      this.offset = 0;
      if (!moved && target) {
        const at = this.marks.findIndex((m) => m.label === target.textContent);
        if (at >= 0) this.turn(at - this.index);
      }
      this.draw();
    };
    this.wheel.addEventListener("pointermove", move);
    this.wheel.addEventListener("pointerup", up);
    this.wheel.addEventListener("pointercancel", up);
  }
}

// A continuous ring: `to(value)` gives its place 0 to 1, `from(place)` the value.
export class Ring {
  constructor(label, to, from, tell, choose) {
    this.to = to;
    this.tell = tell;
    this.held = false;
    this.input = h("input", { type: "range", min: "0", max: "1", step: "0.001", "aria-label": label });
    this.value = h("output", { class: "value" });
    this.note = h("span", { class: "note" });
    this.element = h("div", { class: "ring" }, h("div", { class: "head" }, h("span", { class: "name" }, label), this.note, this.value), this.input);
    this.input.addEventListener("input", () => {
      const value = from(Number(this.input.value));
      this.show(value, this.note.textContent, true);
      choose(value);
    });
    for (const [event, held] of [["pointerdown", true], ["pointerup", false], ["pointercancel", false], ["blur", false]]) {
      this.input.addEventListener(event, () => (this.held = held));
    }
  }

  show(value, note = "", mine = false) {
    this.note.textContent = note;
    this.value.textContent = this.tell(value);
    this.input.setAttribute("aria-valuetext", this.tell(value));
    if (!mine && !this.held) this.input.value = String(this.to(value));
  }
}

// One of a few.
export class Choice {
  constructor(label, options, choose) {
    this.buttons = options.map(([value, text, hint]) =>
      h("button", {
        type: "button", role: "radio", "aria-checked": "false", title: hint, "data-value": value, tabindex: "-1",
        "aria-label": hint ?? text,
        onclick: () => choose(value),
      }, text));
    this.element = h("div", { class: "choice", role: "radiogroup", "aria-label": label }, this.buttons);
    this.element.addEventListener("keydown", (e) => {
      const by = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[e.key];
      if (!by) return;
      e.preventDefault();
      e.stopPropagation();
      const at = this.buttons.findIndex((b) => b === document.activeElement);
      const next = this.buttons[(at + by + this.buttons.length) % this.buttons.length];
      next.focus();
      next.click();
    });
  }

  show(value) {
    let any = false;
    for (const b of this.buttons) {
      const on = b.dataset.value === value;
      any ||= on;
      b.setAttribute("aria-checked", String(on));
      b.tabIndex = on ? 0 : -1;
    }
    if (!any && this.buttons[0]) this.buttons[0].tabIndex = 0;
  }
}

let names = 0;

// A labelled list to choose from.
export function select(label, options, choose) {
  const id = `select-${++names}`;
  const input = h("select", { id, onchange: () => choose(input.value) });
  const fill = (list) => input.replaceChildren(...list.map(([value, text]) => h("option", { value }, text)));
  fill(options);
  return { element: h("div", { class: "field" }, h("label", { for: id }, label), input), input, fill };
}

// A switch.
export function toggle(label, hint, on, changed) {
  const button = h("button", { type: "button", class: "toggle", "aria-pressed": String(on), title: hint }, label);
  button.addEventListener("click", () => {
    const now = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(now));
    changed(now);
  });
  return button;
}
