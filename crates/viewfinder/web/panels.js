// What lies behind the dials: settings of the development, the optics, choosers of lens and body, the film strip and its viewer.

import { h, select } from "./dials.js";
import { PointImage } from "./point.js";
import { T, duration, metres, seconds, stop } from "./texts.js";

// All settings of the recipe, as its own table describes them.
export class Develop {
  constructor(link, catalog) {
    this.link = link;
    this.rows = new Map();
    this.preset = select(T.preset, [["", T.presetNone], ...Object.keys(catalog.presets).map((n) => [n, n])], (name) => {
      if (catalog.presets[name]) link.set({ develop: catalog.presets[name] });
      this.preset.input.value = "";
    });
    this.element = h("div", { class: "panel develop" }, this.preset.element);
    const sections = new Map();
    for (const setting of catalog.settings) {
      const [section] = setting.name.split(".");
      if (!sections.has(section)) sections.set(section, []);
      sections.get(section).push(setting);
    }
    for (const [section, settings] of sections) {
      const body = h("div", { class: "settings" }, settings.map((s) => this.row(s)));
      // What is turned most stands open.
      const open = ["white", "exposure", "tone", "grade"].includes(section);
      this.element.append(h("details", { open }, h("summary", {}, T.sections[section] ?? section), body));
    }
  }

  change(name, value) {
    const [section, key] = name.split(".");
    this.link.set({ develop: { [section]: { [key]: value } } });
  }

  row(setting) {
    const { name, allowed, unit, why } = setting;
    const id = `recipe-${name.replace(".", "-")}`;
    const label = name.split(".")[1].replaceAll("_", " ");
    const back = h("button", { type: "button", class: "back", title: T.setBack(label), "aria-label": T.setBack(label), onclick: () => this.change(name, setting.default) }, "↺");
    const put = (value) => this.change(name, value);
    let inputs;
    let show;
    if (allowed.kind === "bool") {
      const box = h("input", { type: "checkbox", id, onchange: () => put(box.checked) });
      inputs = [box];
      show = (v) => (box.checked = Boolean(v));
    } else if (allowed.kind === "names") {
      const list = h("select", { id, onchange: () => put(list.value) }, allowed.names.map((n) => h("option", { value: n }, n)));
      inputs = [list];
      show = (v) => (list.value = v ?? "");
    } else if (allowed.kind === "number") {
      // A number that may be left out has no slider; wide ranges are dialled about the default.
      const box = h("input", { type: "number", id, step: "any", min: allowed.low, max: allowed.high, placeholder: T.unset });
      box.addEventListener("change", () => put(box.value === "" ? setting.default : Number(box.value)));
      inputs = [box];
      show = (v) => document.activeElement !== box && (box.value = v ?? "");
      if (setting.default !== null && allowed.high - allowed.low <= 1000) {
        const range = h("input", { type: "range", "aria-label": `${T.sections[name.split(".")[0]]}: ${label}`, min: allowed.low, max: allowed.high, step: (allowed.high - allowed.low) / 400 });
        range.addEventListener("input", () => {
          box.value = Number(Number(range.value).toPrecision(3));
          put(Number(box.value));
        });
        inputs.unshift(range);
        const alone = show;
        show = (v) => {
          alone(v);
          if (document.activeElement !== range) range.value = v ?? setting.default;
        };
      }
    } else if (allowed.kind === "numbers") {
      const text = h("input", { type: "text", id, placeholder: T.unset, inputmode: "decimal", spellcheck: "false" });
      text.addEventListener("change", () => {
        const numbers = text.value.split(/[\s,]+/).filter(Boolean).map(Number);
        put(numbers.length ? numbers : setting.default);
      });
      inputs = [text];
      show = (v) => document.activeElement !== text && (text.value = Array.isArray(v) ? v.map((n) => Number(n.toPrecision(4))).join(", ") : "");
    } else {
      const text = h("input", { type: "text", id, spellcheck: "false", placeholder: T.unset });
      text.addEventListener("change", () => put(text.value));
      inputs = [text];
      show = (v) => document.activeElement !== text && (text.value = v ?? "");
    }
    const row = h("div", { class: `setting ${allowed.kind}` }, h("label", { for: id, title: why }, label, unit ? h("small", {}, ` ${unit}`) : null), h("div", { class: "inputs" }, inputs), back);
    this.rows.set(name, { show, row, standard: JSON.stringify(setting.default) });
    return row;
  }

  show(recipe) {
    for (const [name, { show, row, standard }] of this.rows) {
      const [section, key] = name.split(".");
      const value = recipe[section]?.[key] ?? null;
      show(value);
      row.classList.toggle("changed", JSON.stringify(value) !== standard);
    }
  }
}

// The lens in section and facts of lens and light.
export class Optics {
  constructor() {
    this.image = h("img", { class: "section", alt: T.optics.section });
    this.none = h("p", { class: "quiet" }, T.optics.none);
    this.image.addEventListener("error", () => this.found(false));
    this.image.addEventListener("load", () => this.found(true));
    this.follow = h("input", { type: "checkbox", id: "follow" });
    this.list = h("dl", { class: "facts" });
    this.point = new PointImage();
    this.warnings = h("ul", { class: "warnings" });
    this.element = h("div", { class: "panel optics" },
      this.image, this.none, h("div", { class: "field inline" }, this.follow, h("label", { for: "follow" }, T.optics.follow)), this.point.element, this.list, this.warnings);
    this.none.hidden = true;
    this.drawn = null;
  }

  found(is) {
    this.image.hidden = !is;
    this.none.hidden = is;
  }

  // Draws anew where the lens stands otherwise, or another place is pointed at; only while it is looked at.
  draw(key, place) {
    if (this.element.hidden) return;
    this.point.look(key, place);
    const at = this.follow.checked && place ? `&at=${place.map((v) => v.toFixed(3)).join(",")}` : "";
    const wanted = key + at;
    if (wanted === this.drawn) return;
    this.drawn = wanted;
    this.image.src = `/api/lens.svg?v=${encodeURIComponent(key)}${at}`;
  }

  show(state) {
    const f = state.facts;
    const e = f.exposure;
    const row = (name, text) => (text ? [h("dt", {}, name), h("dd", {}, text)] : []);
    const dof = f.depth_of_field;
    const zone = state.focus?.chosen !== null && state.focus ? state.focus.zones[state.focus.chosen] : null;
    const focus = state.focus ? `${zone ? zone.method : "failed"}, ${metres(state.focus.distance_m)}, ${Math.round(100 * state.focus.confidence)} %` : null;
    this.list.replaceChildren(
      ...row(T.facts.lens, e.lens), ...row(T.facts.body, f.body.name),
      ...row(T.facts.focal, `${e.focal_length_mm.toFixed(1)} mm (${e.focal_length_35mm_mm.toFixed(0)} mm on 36 × 24)`),
      ...row(T.facts.stop, `f/${e.f_number.toFixed(2)}, T/${e.t_number.toFixed(2)}`),
      ...row(T.facts.ev, e.metered_ev100 === null ? null : `EV ${e.metered_ev100.toFixed(2)} (ISO 100)`),
      ...row(T.facts.film, `${f.film_mm.map((v) => v.toFixed(1)).join(" × ")} mm, ${f.size.join(" × ")} px`),
      ...row(T.facts.field, dof && !f.pinhole ? T.depthOfField(metres(dof.near_m), metres(dof.far_m)) : null),
      ...row(T.facts.hyperfocal, f.pinhole ? null : metres(f.hyperfocal_m)), ...row(T.facts.focus, focus),
    );
    this.warnings.replaceChildren(...state.warnings.map((w) => h("li", {}, w)));
  }
}

// A dialog to choose a lens or a body.
export class Chooser {
  constructor(title, choose) {
    this.choose = choose;
    this.search = h("input", { type: "search", placeholder: T.search, "aria-label": T.search, oninput: () => this.filter() });
    this.list = h("div", { class: "list", role: "listbox", "aria-label": title, tabindex: "0" });
    this.image = h("img", { class: "section", alt: "" });
    this.about = h("p", { class: "quiet" });
    this.element = h("dialog", { class: "chooser", "aria-label": title },
      h("header", {}, h("h2", {}, title), h("button", { type: "button", class: "close", "aria-label": T.close, onclick: () => this.element.close() }, "×")),
      this.search, h("div", { class: "two" }, this.list, h("div", { class: "preview" }, this.image, this.about)));
    this.element.addEventListener("click", (e) => e.target === this.element && this.element.close());
    this.list.addEventListener("keydown", (e) => {
      const by = { ArrowDown: 1, ArrowUp: -1 }[e.key];
      if (by) {
        e.preventDefault();
        const shown = this.options.filter((o) => !o.element.hidden);
        const at = shown.findIndex((o) => o === this.at);
        this.look(shown[Math.max(0, Math.min(shown.length - 1, at + by))]);
      } else if (e.key === "Enter" && this.at) this.take(this.at);
    });
  }

  // `options`: [{ value, title, about, image }]
  open(options, current) {
    this.options = options;
    this.list.replaceChildren(...options.map((o, i) => {
      o.element = h("div", { class: "option", role: "option", id: `option-${i}`, "aria-selected": String(o.value === current), onclick: () => this.take(o), onpointerenter: () => this.look(o) },
        h("b", {}, o.title), h("span", {}, o.about));
      return o.element;
    }));
    this.search.value = "";
    this.element.showModal();
    this.search.focus();
    this.look(options.find((o) => o.value === current) ?? options[0]);
    this.at?.element.scrollIntoView({ block: "center" });
  }

  look(option) {
    if (!option) return;
    this.at?.element.classList.remove("looked");
    this.at = option;
    option.element.classList.add("looked");
    this.list.setAttribute("aria-activedescendant", option.element.id);
    this.image.hidden = !option.image;
    if (option.image) this.image.src = option.image;
    this.about.textContent = option.more ?? "";
    option.element.scrollIntoView({ block: "nearest" });
  }

  filter() {
    const words = this.search.value.toLowerCase().split(/\s+/);
    for (const o of this.options) o.element.hidden = !words.every((w) => `${o.title} ${o.about} ${o.value}`.toLowerCase().includes(w));
    this.look(this.options.find((o) => !o.element.hidden));
  }

  take(option) {
    this.element.close();
    this.choose(option.value);
  }
}

// What a picture of a series differs in.
function difference(series) {
  const d = series?.differs;
  if (!d) return "";
  return "ev" in d ? T.drive.ev(d.ev) : metres(d.focus_m);
}

// Pictures that were taken, and those to come.
export class Film {
  constructor(link, live) {
    this.link = link;
    this.empty = h("p", { class: "quiet" }, T.filmEmpty);
    this.strip = h("ul", { class: "film", "aria-label": T.film });
    this.element = h("div", { class: "filmroom" }, this.empty, this.strip);
    this.viewer = new Viewer(link, live);
    this.known = "";
  }

  show(state) {
    const { jobs } = state.queue;
    const key = JSON.stringify([jobs, state.film.map((p) => p.id)]);
    if (key === this.known) return;
    this.known = key;
    this.empty.hidden = jobs.length + state.film.length > 0;
    const taken = state.film.map((p) =>
      h("li", {}, h("button", { type: "button", class: "frame", "aria-label": T.open(p.name), onclick: () => this.viewer.open(p, state.film) },
        h("img", { src: `/film/${p.id}/thumbnail.jpg`, alt: "" }), h("span", {}, [`${stop(p.facts.f_number)}  ${seconds(p.facts.exposure_s)}`, difference(p.series) || `ISO ${Math.round(p.facts.iso)}`].join("  ")))));
    const waiting = jobs.map((j, i) => {
      const part = j.series ? [T.drive.part(j.series), difference(j.series), ""].filter((t, k) => t || k === 2).join(" ") : "";
      const cancel = (command, text, name) => h("button", { type: "button", class: "small", "aria-label": name, onclick: () => this.link.send(command) }, text);
      // The series is cancelled at its first picture.
      const first = j.series && jobs.findIndex((o) => o.series?.id === j.series.id) === i;
      const whole = first && jobs.some((o, k) => k > i && o.series?.id === j.series.id) ? cancel({ do: "cancel-series", id: j.series.id }, T.drive.cancelAll, T.drive.cancelAll) : null;
      return h("li", { class: "job" }, h("div", { class: "frame" }, h("progress", { max: "1", value: j.done, "aria-label": `${part}${T.jobs[j.what]}` }), h("span", {}, `${part}${T.jobs[j.what]} ${T.left(j.left_s)}`),
        whole ?? cancel({ do: "cancel", id: j.id }, T.cancel, `${T.cancel} ${part}`.trim())));
    });
    const end = this.strip.scrollWidth - this.strip.scrollLeft - this.strip.clientWidth < 40;
    this.strip.replaceChildren(...taken, ...waiting);
    if (end) this.strip.scrollLeft = this.strip.scrollWidth;
    this.viewer.known(state.film);
  }
}

// One picture large, with its files, and a wiper over another one.
class Viewer {
  constructor(link, live) {
    this.link = link;
    this.live = live;
    this.image = h("img", { class: "whole", alt: "" });
    this.other = h("canvas", { class: "other", hidden: true, "aria-hidden": "true" });
    this.title = h("h2");
    this.about = h("p", { class: "quiet" });
    this.files = h("div", { class: "files" });
    this.command = h("code");
    this.copy = h("button", { type: "button", class: "small", onclick: () => this.copied() }, T.copy);
    this.compare = select(T.compare, [], (v) => this.against(v));
    this.wiper = h("input", { type: "range", min: "0", max: "1", step: "0.005", value: "0.5", "aria-label": T.wiper, hidden: true, oninput: () => this.wipe() });
    this.discard = h("button", { type: "button", class: "small", onclick: () => this.throwAway() }, T.discard);
    this.element = h("dialog", { class: "viewer", "aria-label": T.film },
      h("header", {}, this.title, h("button", { type: "button", class: "close", "aria-label": T.close, onclick: () => this.element.close() }, "×")),
      h("div", { class: "sheet" }, this.image, this.other), this.wiper, this.about,
      h("div", { class: "row" }, this.files, this.compare.element, this.discard),
      h("div", { class: "repeat" }, h("p", { class: "quiet" }, T.repeat), h("div", { class: "row" }, this.command, this.copy)));
    this.element.addEventListener("click", (e) => e.target === this.element && this.element.close());
  }

  open(picture, film) {
    this.picture = picture;
    const f = picture.facts;
    this.title.textContent = picture.name;
    this.image.src = `/film/${picture.id}/jpg`;
    this.image.alt = picture.name;
    const own = difference(picture.series);
    const part = picture.series ? `${T.drive.part(picture.series)}${own ? ` ${own}` : ""}, ` : "";
    this.about.textContent = `${part}${f.lens}, ${stop(f.f_number)}, ${seconds(f.exposure_s)}, ISO ${Math.round(f.iso)}, ${picture.size.join(" × ")} px, ${duration(picture.seconds)}`;
    this.files.replaceChildren(...Object.entries(T.kinds).map(([kind, text]) =>
      h("a", { class: "button", href: `/film/${picture.id}/${kind}`, download: `${picture.name}.${kind}`, "aria-label": `${T.downloads} ${text}` }, text)));
    this.command.textContent = picture.command;
    this.copy.textContent = T.copy;
    this.known(film);
    this.against("");
    this.element.showModal();
  }

  known(film) {
    if (!this.picture) return;
    const before = this.compare.input.value;
    this.compare.fill([["", T.compareNone], ["live", T.compareLive], ...film.filter((p) => p.id !== this.picture.id).map((p) => [String(p.id), p.name])]);
    this.compare.input.value = before;
  }

  async against(which) {
    this.compare.input.value = which;
    this.second = null;
    if (which === "live") this.second = this.live();
    else if (which) {
      const image = new Image();
      image.src = `/film/${which}/jpg`;
      await image.decode().catch(() => null);
      this.second = image;
    }
    this.wiper.hidden = this.other.hidden = !this.second;
    if (!this.second) return;
    [this.other.width, this.other.height] = this.picture.size;
    this.wipe();
  }

  wipe() {
    if (!this.second) return;
    const { width: w, height: hgt } = this.other;
    const context = this.other.getContext("2d");
    const x = Math.round(w * Number(this.wiper.value));
    context.clearRect(0, 0, w, hgt);
    context.save();
    context.beginPath();
    context.rect(x, 0, w - x, hgt);
    context.clip();
    context.drawImage(this.second, 0, 0, w, hgt);
    context.restore();
    context.fillStyle = "#ffb454";
    context.fillRect(x - w / 800, 0, w / 400, hgt);
  }

  async copied() {
    await navigator.clipboard?.writeText(this.picture.command).catch(() => null);
    this.copy.textContent = T.copied;
  }

  throwAway() {
    this.link.send({ do: "discard", id: this.picture.id });
    this.element.close();
  }
}
