// The finder: the picture, what is drawn over it, the pointer's hands on it.

import { T } from "./texts.js";
import { h } from "./dials.js";

const CLICK = 5; // Pixels that a click may wander.
const ORBIT = 2.6; // Radians of an orbit across the picture.
const ZEBRA = 0.95;
const PEAK = 34; // Contrast (of 255) from which an edge counts as sharp.

// Codes and colours of the false-colour display, as monitors for film sets have them: near black, dark, middle grey, a stop above, near white, white.
const BANDS = [
  [0.03, [98, 40, 160]],
  [0.1, [38, 78, 190]],
  [0.39, null],
  [0.47, [46, 160, 70]],
  [0.54, null],
  [0.6, [232, 130, 170]],
  [0.84, null],
  [0.96, [240, 205, 60]],
  [1.01, [220, 50, 40]],
];

export class Finder {
  constructor(link, on) {
    this.link = link;
    this.on = on;
    this.aids = {};
    this.frame = null;
    this.pointer = null;
    this.points = new Map();
    this.canvas = h("canvas", { class: "picture", "aria-hidden": "true" });
    this.over = h("canvas", { class: "over", "aria-hidden": "true" });
    this.lens = h("canvas", { class: "magnifier", width: "220", height: "220", hidden: true, "aria-hidden": "true" });
    this.note = h("div", { class: "loading", role: "status" }, T.loading);
    this.stage = h("div", { class: "stage", tabindex: "0", role: "application", "aria-label": T.finder }, this.canvas, this.over, this.lens, this.note);
    this.element = this.stage;
    this.raw = document.createElement("canvas");
    this.listen();
    new ResizeObserver(() => this.fit()).observe(this.stage);
  }

  // Shows a frame; true once it is on the screen.
  async show(frame) {
    const bitmap = await createImageBitmap(frame.picture);
    this.bitmap?.close();
    this.bitmap = bitmap;
    this.frame = frame;
    this.note.hidden = true;
    this.pixels = null;
    if (this.raw.width !== bitmap.width || this.raw.height !== bitmap.height) {
      this.raw.width = bitmap.width;
      this.raw.height = bitmap.height;
    }
    this.raw.getContext("2d", { willReadFrequently: true }).drawImage(bitmap, 0, 0);
    this.fit();
  }

  // The picture's place within the stage, CSS pixels.
  box() {
    const { clientWidth: w, clientHeight: hgt } = this.stage;
    const [pw, ph] = this.frame?.header.whole ?? [3, 2];
    const scale = Math.min(w / pw, hgt / ph);
    return { left: (w - pw * scale) / 2, top: (hgt - ph * scale) / 2, width: pw * scale, height: ph * scale };
  }

  fit() {
    if (!this.frame) return;
    const box = this.box();
    const ratio = window.devicePixelRatio || 1;
    for (const canvas of [this.canvas, this.over]) {
      Object.assign(canvas.style, { left: `${box.left}px`, top: `${box.top}px`, width: `${box.width}px`, height: `${box.height}px` });
      const [w, hgt] = [Math.max(1, Math.round(box.width * ratio)), Math.max(1, Math.round(box.height * ratio))];
      if (canvas.width !== w || canvas.height !== hgt) [canvas.width, canvas.height] = [w, hgt];
    }
    const context = this.canvas.getContext("2d");
    context.imageSmoothingQuality = "high";
    context.drawImage(this.bitmap, 0, 0, this.canvas.width, this.canvas.height);
    this.draw();
  }

  data() {
    this.pixels ??= this.raw.getContext("2d", { willReadFrequently: true }).getImageData(0, 0, this.raw.width, this.raw.height);
    return this.pixels;
  }

  // Everything over the picture.
  draw() {
    const context = this.over.getContext("2d");
    const { width: w, height: hgt } = this.over;
    context.clearRect(0, 0, w, hgt);
    if (!this.frame) return;
    if (this.aids.falseColor || this.aids.zebra || this.aids.peaking) this.layer(context, w, hgt);
    if (this.aids.depth && this.frame.blur) this.depth(context, w, hgt);
    const line = Math.max(1, w / 900);
    if (this.aids.grid) {
      context.strokeStyle = "rgba(255,255,255,0.45)";
      context.lineWidth = line;
      context.beginPath();
      for (const t of [1 / 3, 2 / 3]) {
        context.moveTo(t * w, 0);
        context.lineTo(t * w, hgt);
        context.moveTo(0, t * hgt);
        context.lineTo(w, t * hgt);
      }
      context.stroke();
    }
    for (const mark of this.marks ?? []) {
      const size = 0.026 * w;
      context.lineWidth = 1.6 * line;
      context.strokeStyle = mark.color;
      const [x, y] = [mark.at[0] * w, mark.at[1] * hgt];
      context.beginPath();
      if (mark.round) context.arc(x, y, size, 0, 2 * Math.PI);
      else {
        for (const [sx, sy] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
          context.moveTo(x + sx * size, y + sy * size * 0.45);
          context.lineTo(x + sx * size, y + sy * size);
          context.lineTo(x + sx * size * 0.45, y + sy * size);
        }
      }
      context.stroke();
    }
    this.magnify();
  }

  // Zebra, peaking and false colour, pixel by pixel.
  layer(context, w, hgt) {
    const { data, width, height } = this.data();
    const out = new ImageData(width, height);
    const luma = new Float32Array(width * height);
    for (let i = 0; i < luma.length; i++) luma[i] = 0.2126 * data[4 * i] + 0.7152 * data[4 * i + 1] + 0.0722 * data[4 * i + 2];
    const put = (i, [r, g, b], alpha) => out.data.set([r, g, b, alpha], 4 * i);
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        const i = y * width + x;
        if (this.aids.falseColor) {
          const code = luma[i] / 255;
          const band = BANDS.find(([end]) => code < end) ?? BANDS[BANDS.length - 1];
          put(i, band[1] ?? [luma[i], luma[i], luma[i]], 255);
        }
        if (this.aids.zebra && Math.max(data[4 * i], data[4 * i + 1], data[4 * i + 2]) >= ZEBRA * 255) {
          const dark = (((x + y) * 960) / width) % 12 < 6;
          put(i, dark ? [0, 0, 0] : [255, 255, 255], 220);
        }
        if (this.aids.peaking && x > 0 && y > 0 && x < width - 1 && y < height - 1) {
          const gx = luma[i + 1] - luma[i - 1];
          const gy = luma[i + width] - luma[i - width];
          if (gx * gx + gy * gy > PEAK * PEAK) put(i, [255, 70, 60], 255);
        }
      }
    }
    this.scratch ??= document.createElement("canvas");
    [this.scratch.width, this.scratch.height] = [width, height];
    this.scratch.getContext("2d").putImageData(out, 0, 0);
    context.imageSmoothingEnabled = false;
    context.drawImage(this.scratch, 0, 0, w, hgt);
  }

  // Tints what is out of focus.
  depth(context, w, hgt) {
    const { size, steps } = this.frame.header.blur;
    const out = new ImageData(size[0], size[1]);
    for (let i = 0; i < this.frame.blur.length; i++) {
      const circles = this.frame.blur[i] / steps;
      const beyond = Math.abs(circles) - 1;
      if (beyond <= 0) continue;
      const alpha = Math.min(150, 50 + 40 * Math.log2(1 + beyond));
      out.data.set(circles < 0 ? [60, 120, 255, alpha] : [255, 140, 40, alpha], 4 * i);
    }
    this.scratch ??= document.createElement("canvas");
    [this.scratch.width, this.scratch.height] = size;
    this.scratch.getContext("2d").putImageData(out, 0, 0);
    context.imageSmoothingEnabled = true;
    context.drawImage(this.scratch, 0, 0, w, hgt);
  }

  // Circles of confusion at a place; null where it is not known.
  blurAt([x, y]) {
    if (!this.frame?.blur) return null;
    const { size, steps } = this.frame.header.blur;
    const at = (v, n) => Math.min(n - 1, Math.floor(v * n));
    return this.frame.blur[at(y, size[1]) * size[0] + at(x, size[0])] / steps;
  }

  magnify() {
    const on = this.aids.magnifier && this.pointer && this.bitmap;
    this.lens.hidden = !on;
    if (!on) return;
    const context = this.lens.getContext("2d");
    const n = this.lens.width;
    const shown = n / 2;
    const [x, y] = [this.pointer[0] * this.bitmap.width, this.pointer[1] * this.bitmap.height];
    context.imageSmoothingEnabled = false;
    context.fillStyle = "#000";
    context.fillRect(0, 0, n, n);
    context.drawImage(this.bitmap, x - shown / 2, y - shown / 2, shown, shown, 0, 0, n, n);
    context.strokeStyle = "rgba(255,255,255,.7)";
    context.strokeRect(n / 2 - 1.5, n / 2 - 1.5, 3, 3);
    // On the side where the pointer is not.
    this.lens.style.left = this.pointer[0] > 0.5 ? "12px" : "auto";
    this.lens.style.right = this.pointer[0] > 0.5 ? "auto" : "12px";
  }

  place(event) {
    const outer = this.stage.getBoundingClientRect();
    const box = this.box();
    return [(event.clientX - outer.left - box.left) / box.width, (event.clientY - outer.top - box.top) / box.height];
  }

  listen() {
    const stage = this.stage;
    const inside = (p) => p.every((v) => v >= 0 && v <= 1);
    stage.addEventListener("pointerdown", (e) => {
      if (e.button > 1) return;
      stage.setPointerCapture(e.pointerId);
      this.points.set(e.pointerId, [e.clientX, e.clientY]);
      if (this.points.size === 1) [this.from, this.moved] = [[e.clientX, e.clientY], false];
      else this.moved = true;
    });
    stage.addEventListener("pointermove", (e) => {
      const at = this.place(e);
      this.pointer = inside(at) ? at : null;
      if (this.pointer) this.on.point(this.pointer);
      this.magnify();
      const last = this.points.get(e.pointerId);
      if (!last) return;
      const now = [e.clientX, e.clientY];
      if (!this.moved && Math.hypot(now[0] - this.from[0], now[1] - this.from[1]) < CLICK) return;
      const box = this.box();
      if (this.points.size === 2) {
        const other = [...this.points].find(([id]) => id !== e.pointerId)[1];
        const spread = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
        if (spread(last) > 1 && spread(now) > 1) this.link.move("dolly", 0, Math.log(spread(last) / spread(now)));
        this.link.move("pan", (now[0] - last[0]) / (2 * box.width), (now[1] - last[1]) / (2 * box.width));
      } else {
        const from = this.moved ? last : this.from;
        const by = [now[0] - from[0], now[1] - from[1]].map((v) => v / box.width);
        this.moved = true;
        if (e.shiftKey || e.buttons === 4) this.link.move("pan", by[0], by[1]);
        else if (e.altKey) this.link.move("turn", 0.8 * by[0], 0.8 * by[1]);
        else this.link.move("orbit", ORBIT * by[0], ORBIT * by[1]);
      }
      this.points.set(e.pointerId, now);
    });
    const up = (e) => {
      if (!this.points.delete(e.pointerId)) return;
      if (!this.moved && e.type === "pointerup") {
        const at = this.place(e);
        if (inside(at)) this.on.click(at);
      }
    };
    stage.addEventListener("pointerup", up);
    stage.addEventListener("pointercancel", up);
    stage.addEventListener("pointerleave", () => {
      this.pointer = null;
      this.lens.hidden = true;
      this.on.point(null);
    });
    stage.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.link.move("dolly", 0, Math.max(-0.5, Math.min(0.5, e.deltaY * 0.0012)));
    }, { passive: false });
  }
}

// The raw histogram, on a scale of stops.
export function drawHistogram(canvas, header) {
  const context = canvas.getContext("2d");
  const { width: w, height: hgt } = canvas;
  context.clearRect(0, 0, w, hgt);
  const style = getComputedStyle(canvas);
  context.strokeStyle = style.getPropertyValue("--line");
  context.lineWidth = 1;
  context.beginPath();
  for (let s = 0; s <= header.histogram_stops; s += 2) {
    const x = Math.round((w * s) / header.histogram_stops) + 0.5;
    context.moveTo(x, 0);
    context.lineTo(x, hgt);
  }
  context.stroke();
  const colors = { R: "#ff5a4e", G: "#4fce62", B: "#5b8dff", W: "#cfcfcf" };
  // The lowest cell holds all that is darker.
  const most = Math.max(1, ...header.histogram.flatMap((c) => c.bins.slice(1)));
  context.globalCompositeOperation = "lighter";
  for (const channel of header.histogram) {
    context.fillStyle = colors[channel.channel] ?? "#cfcfcf";
    context.globalAlpha = 0.75;
    const n = channel.bins.length;
    context.beginPath();
    context.moveTo(0, hgt);
    channel.bins.forEach((count, i) => {
      const y = hgt - (hgt - 2) * Math.min(1, Math.sqrt(count / most));
      context.lineTo((w * i) / n, y);
      context.lineTo((w * (i + 1)) / n, y);
    });
    context.lineTo(w, hgt);
    context.fill();
  }
  context.globalAlpha = 1;
  context.globalCompositeOperation = "source-over";
}

// The waveform: codes of each column of the picture.
export function drawWaveform(canvas, picture) {
  const context = canvas.getContext("2d");
  const { width: w, height: hgt } = canvas;
  const out = context.createImageData(w, hgt);
  const counts = new Uint32Array(w * hgt);
  const { data, width, height } = picture;
  for (let y = 0; y < height; y += 2) {
    for (let x = 0; x < width; x++) {
      const i = 4 * (y * width + x);
      const code = (0.2126 * data[i] + 0.7152 * data[i + 1] + 0.0722 * data[i + 2]) / 255;
      counts[Math.round((1 - code) * (hgt - 1)) * w + Math.floor((x * w) / width)]++;
    }
  }
  const gain = (420 * w) / width / height;
  for (let i = 0; i < counts.length; i++) {
    const v = Math.min(1, Math.sqrt(counts[i] * gain * 0.12));
    out.data.set([150 * v, 255 * v, 170 * v, 255], 4 * i);
  }
  context.putImageData(out, 0, 0);
}
