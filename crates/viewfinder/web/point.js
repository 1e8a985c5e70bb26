// The image of a point under the pointer: a table of contrast (MTF) and the spot diagram, as the bench of the lens says.

import { h } from "./dials.js";
import { T, metres } from "./texts.js";

const SIZE = 232; // Pixels of the diagram.
const HUES = [[520, "blue"], [620, "green"], [Infinity, "red"]]; // Classes by the end of their wavelengths, nm.
const NS = "http://www.w3.org/2000/svg";

function svg(tag, attributes, ...children) {
  const element = document.createElementNS(NS, tag);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  element.append(...children);
  return element;
}

const um = (v) => (v >= 100 ? v.toFixed(0) : v >= 10 ? v.toFixed(1) : v.toFixed(2));
const percent = (v) => `${(100 * v).toFixed(v < 0.0995 ? 1 : 0)} %`;

export class PointImage {
  constructor() {
    this.place = [0.5, 0.5];
    this.busy = false;
    this.wanted = null;
    this.drawn = null;
    this.about = h("p", { class: "quiet" });
    this.table = h("table", { class: "contrast" }, h("caption", {}, T.point.mtf), h("thead", {}, h("tr", {}, T.point.columns.map((c) => h("th", { scope: "col" }, c)))), h("tbody"));
    this.diagram = h("div", { class: "spot" });
    this.legend = h("p", { class: "quiet legend" });
    this.subject = h("input", { type: "checkbox", id: "point-subject", onchange: () => this.ask() });
    // What a pointer does on the picture, for those who have none.
    const slider = (i, label) => h("input", { type: "range", min: "0", max: "1", step: "0.01", value: "0.5", "aria-label": label, title: label, oninput: (e) => {
      this.place = this.place.map((v, j) => (j === i ? Number(e.target.value) : v));
      this.ask();
    } });
    this.sliders = [slider(0, T.point.across), slider(1, T.point.down)];
    this.results = h("div", { class: "results" }, this.table, this.diagram, this.legend);
    this.element = h("section", { class: "point", "aria-label": T.point.title },
      h("h2", {}, T.point.title), h("div", { class: "field inline" }, this.subject, h("label", { for: "point-subject" }, T.point.subject)), h("div", { class: "place" }, this.sliders), this.about, this.results);
    this.results.hidden = true;
  }

  // The lens as it stands (`key`) at a place of the picture; where nothing is pointed at, the place before.
  look(key, place) {
    if (place) {
      this.place = place;
      this.sliders.forEach((slider, i) => (slider.value = String(place[i])));
    }
    this.key = key;
    this.ask();
  }

  // One question at a time; what is asked meanwhile waits, and only the last of it. A moment of rest: pointers wander.
  ask() {
    if (this.element.closest("[hidden]") || !this.key) return;
    const at = this.place.map((v) => v.toFixed(3)).join(",");
    const wanted = `/api/point.json?at=${at}&of=${this.subject.checked ? "subject" : "focus"}`;
    const name = `${this.key} ${wanted}`;
    if (name === this.drawn || name === this.wanted?.name) return;
    this.wanted = { name, address: wanted };
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.fetch(), 120);
  }

  async fetch() {
    if (this.busy || !this.wanted) return;
    this.busy = true;
    const { name, address } = this.wanted;
    this.element.setAttribute("aria-busy", "true");
    try {
      const answer = await fetch(address);
      if (answer.status === 200) this.show(await answer.json());
      this.drawn = name;
    } catch { /* The page says that the camera cannot be reached. */ }
    this.busy = false;
    this.element.setAttribute("aria-busy", "false");
    if (this.wanted.name === name) this.wanted = null;
    else this.fetch();
  }

  show(image) {
    const [x, y] = this.place;
    const field = image.field_deg === null ? "" : `${image.field_deg.toFixed(1)}°, `;
    this.about.textContent = T.point.about(`${Math.round(100 * x)} %, ${Math.round(100 * y)} %`, field + metres(image.object_m));
    this.results.hidden = Boolean(image.missing);
    if (image.missing) {
      this.about.textContent += ` ${T.point.missing[image.missing]}`;
      return;
    }
    const notes = [image.geometric && T.point.geometric, image.along_vertical && T.point.alongVertical, image.disk_um !== null && T.point.ideal].filter(Boolean);
    this.table.tBodies[0].replaceChildren(...image.mtf.map((c) =>
      h("tr", {}, h("th", { scope: "row" }, String(c.frequency)), ...[c.sagittal, c.tangential, c.limit].map((v) => h("td", {}, bar(v), percent(v))))));
    this.draw(image);
    const rms = image.spot.map((s) => `${s.nm.toFixed(0)} nm ${um(s.rms_um)} µm`).join(", ");
    const parts = [rms && T.point.rms(rms), image.disk_um !== null && T.point.disk(um(image.disk_um)), T.point.airy(um(image.airy_um)), ...notes].filter(Boolean);
    this.legend.textContent = parts.join(". ") + ".";
  }

  draw(image) {
    const all = image.spot.flatMap((s) => s.points_um);
    const reach = Math.max(1.6 * image.airy_um, 0.55 * (image.disk_um ?? 0), ...all.map((p) => 1.06 * Math.max(Math.abs(p[0]), Math.abs(p[1]))));
    const scale = (0.5 * SIZE) / reach;
    const marks = [];
    if (image.disk_um !== null) marks.push(svg("circle", { r: Math.max(0.5, 0.5 * image.disk_um * scale), class: "disk" }));
    for (const spot of image.spot) {
      const hue = HUES.find(([end]) => spot.nm < end)[1];
      const path = spot.points_um.map(([px, py]) => `M${(px * scale).toFixed(1)} ${(-py * scale).toFixed(1)}h.01`).join("");
      marks.push(svg("path", { d: path, class: `rays ${hue}` }));
    }
    marks.push(svg("circle", { r: image.airy_um * scale, class: "airy" }));
    // A bar of a round length below.
    const steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000];
    const length = steps.findLast((v) => v <= 0.7 * reach) ?? steps[0];
    const [left, low] = [-0.5 * SIZE + 8, 0.5 * SIZE - 8];
    marks.push(svg("path", { d: `M${left} ${low}h${(length * scale).toFixed(1)}`, class: "bar" }), svg("text", { x: left, y: low - 6 }, `${length} µm`));
    const label = T.point.diagram(um(image.airy_um));
    const half = 0.5 * SIZE;
    this.diagram.replaceChildren(svg("svg", { viewBox: `${-half} ${-half} ${SIZE} ${SIZE}`, role: "img", "aria-label": label }, ...marks));
  }
}

function bar(value) {
  const inner = h("i");
  inner.style.width = `${Math.max(0, Math.min(100, 100 * value)).toFixed(1)}%`;
  return h("span", { class: "gauge", "aria-hidden": "true" }, inner);
}
