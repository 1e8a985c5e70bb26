// The viewfinder in Chromium: what a photographer does, what a stranger tries, and whether everybody can use it.
//
//   node viewfinder.mjs DIOPTER MODULES [OUT]
//
// DIOPTER: the program. MODULES: a folder in which `npm install playwright-core axe-core` was run. OUT: gets screenshots and the DNG.
// CHROMIUM names the browser if it is not /usr/bin/chromium.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdirSync, readFileSync, statSync } from "node:fs";
import { request } from "node:http";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";

const [program, modules, out = "."] = process.argv.slice(2);
const require = createRequire(join(resolve(modules), "x.js"));
const { chromium } = require("playwright-core");
const axe = readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
mkdirSync(out, { recursive: true });
const WAIT = 120_000;

// --- The program

function start(...args) {
  const child = spawn(program, ["viewfinder", "--json", ...args], { stdio: ["ignore", "pipe", "pipe"] });
  const ended = new Promise((done) => child.on("exit", (code, signal) => done(code ?? signal)));
  const address = new Promise((done, fail) => {
    let told = "";
    child.stdout.on("data", (data) => {
      told += data;
      try { done(JSON.parse(told).address); } catch { /* Not all of it yet. */ }
    });
    ended.then((code) => fail(new Error(`it ended: ${code}`)));
  });
  child.stderr.resume();
  return { child, address, ended };
}

const viewfinder = start();
const address = await viewfinder.address;
const { host, port, searchParams } = new URL(address);
const token = searchParams.get("token");
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"],
});
const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, colorScheme: "dark", reducedMotion: "reduce", acceptDownloads: true });
const errors = [];

async function open(where = address, size = null) {
  const page = await context.newPage();
  if (size) await page.setViewportSize(size);
  page.on("console", (m) => m.type() === "error" && errors.push(m.text()));
  page.on("pageerror", (e) => errors.push(String(e)));
  await page.goto(where);
  await page.waitForFunction(() => window.diopter?.frames > 0, null, { timeout: WAIT });
  return page;
}

const version = (page) => page.evaluate(() => window.diopter.state.version);
const picture = (page) => page.evaluate(async () => {
  const small = document.createElement("canvas");
  [small.width, small.height] = [48, 32];
  const context = small.getContext("2d");
  context.drawImage(document.querySelector("canvas.picture"), 0, 0, 48, 32);
  return [...context.getImageData(0, 0, 48, 32).data];
});
const difference = (a, b) => a.reduce((sum, v, i) => sum + Math.abs(v - b[i]), 0) / a.length;
// Waits for a picture of the shot as it is now, with at least so many samples or whole.
const settled = (page, samples = 2) => page.waitForFunction((n) => {
  const { header, state } = window.diopter;
  return header?.version === state.version && (header.done || (header.samples >= n && header.size[0] === header.whole[0]));
}, samples, { timeout: WAIT });

// Waits for a picture other than one before; the meter looks again behind the first frame.
async function changed(page, before, name) {
  for (const begun = performance.now(); performance.now() - begun < WAIT / 4; ) {
    if (difference(before, await picture(page)) > 0.2) return;
    await page.waitForTimeout(100);
  }
  assert.fail(`${name}: the picture is the same`);
}

let count = 0;
async function test(name, run) {
  const begun = performance.now();
  await run();
  count++;
  console.log(`ok ${name} (${((performance.now() - begun) / 1000).toFixed(1)} s)`);
}

async function accessible(page, what) {
  await page.evaluate(axe);
  const { violations } = await page.evaluate(() => window.axe.run(document, { runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"] }));
  const told = violations.map((v) => `${v.id}: ${v.help}: ${v.nodes.map((n) => n.html.slice(0, 140)).slice(0, 3).join(" | ")}`);
  assert.deepEqual(told, [], what);
}

// A screenshot of less than 200 KB, for eyes and documents.
async function shot(page, name) {
  const path = join(out, `${name}.jpg`);
  for (const quality of [85, 70, 50, 30]) {
    await page.screenshot({ path, type: "jpeg", quality });
    if (statSync(path).size < 200_000) return;
  }
  assert.fail(`${name} is larger than 200 KB`);
}

// --- What a photographer does

let page;
const times = [];
try {
  await test("it opens, and the token leaves the address", async () => {
    page = await open();
    assert.equal(page.url(), `http://${host}/`);
    await settled(page, 4);
    await shot(page, "desktop");
  });

  await test("each dial changes the picture", async () => {
    const key = (label, name) => async () => {
      await page.getByRole("slider", { name: label }).focus();
      await page.keyboard.press(name);
    };
    const turns = {
      "mode M": () => page.getByRole("radio", { name: /^Manual/ }).click(),
      "a longer time": key("Shutter", "ArrowLeft"),
      "a wider aperture": async () => {
        for (let i = 0; i < 6; i++) await key("Aperture", "ArrowLeft")();
      },
      "ISO": key("ISO", "ArrowRight"),
      "aperture priority": () => page.getByRole("radio", { name: /^Aperture priority/ }).click(),
      "compensation": key("Exposure compensation", "PageUp"),
      "focus": key("Focus distance", "Home"),
      "focal length": async () => {
        for (let i = 0; i < 30; i++) await key("Focal length", "ArrowRight")();
      },
      "white balance": () => page.getByLabel("White balance").selectOption("tungsten"),
      "orbit": () => page.getByRole("button", { name: "Orbit left" }).click(),
      "nearer": () => page.getByRole("button", { name: "Nearer" }).click(),
      "metering": () => page.getByLabel("Metering", { exact: true }).selectOption("highlight"),
    };
    for (const [name, turn] of Object.entries(turns)) {
      await settled(page);
      const before = await picture(page);
      const known = await version(page);
      const begun = performance.now();
      await turn();
      await page.waitForFunction((v) => window.diopter.header.version > v, known, { timeout: WAIT });
      times.push([name, performance.now() - begun]);
      // Held by hand, or chosen by the camera: the numbers, and with them the picture, may be the same.
      if (name === "mode M" || name === "aperture priority") continue;
      await changed(page, before, name);
    }
  });

  await test("a click focuses", async () => {
    await page.keyboard.press("Escape");
    const finder = page.locator(".stage");
    const box = await finder.boundingBox();
    await settled(page);
    const known = await version(page);
    await finder.click({ position: { x: box.width * 0.4, y: box.height * 0.55 } });
    await page.waitForFunction((v) => window.diopter.state.version > v && /extension/.test(window.diopter.state.shot.focus.distance ?? ""), known, { timeout: WAIT });
    const focus = await page.evaluate(() => window.diopter.state.focus);
    assert.ok(focus.confidence >= 0 && focus.zones.length === 1);
  });

  await test("dragging moves the camera", async () => {
    await settled(page);
    const before = await page.evaluate(() => window.diopter.state.pose.eye);
    const box = await page.locator(".stage").boundingBox();
    await page.mouse.move(box.x + 300, box.y + 200);
    await page.mouse.down();
    await page.mouse.move(box.x + 400, box.y + 210, { steps: 8 });
    await page.mouse.up();
    await page.waitForFunction((eye) => Math.hypot(...window.diopter.state.pose.eye.map((v, i) => v - eye[i])) > 0.01, before, { timeout: WAIT });
    await page.mouse.wheel(0, 200);
    await settled(page);
  });

  await test("aids and numbers", async () => {
    await page.getByRole("tab", { name: "Aids" }).click();
    for (const name of ["Zebra", "Focus peaking", "Thirds", "Waveform", "Depth of field", "Magnifier"]) {
      await page.getByRole("button", { name }).click();
    }
    const box = await page.locator(".stage").boundingBox();
    await page.mouse.move(box.x + box.width * 0.45, box.y + box.height * 0.6);
    await page.waitForFunction(() => /EV/.test(document.querySelector(".numbers").textContent), null, { timeout: WAIT });
    await shot(page, "aids");
    await accessible(page, "aids");
    for (const name of ["Zebra", "Focus peaking", "Thirds", "Waveform", "Depth of field", "Magnifier"]) {
      await page.getByRole("button", { name }).click();
    }
    await page.getByRole("button", { name: "False colour" }).click();
    await page.getByRole("button", { name: "False colour" }).click();
  });

  await test("the development is the recipe's own table", async () => {
    await page.getByRole("tab", { name: "Develop" }).click();
    await settled(page);
    const before = await picture(page);
    const known = await version(page);
    await page.locator("#recipe-tone-curve").selectOption("agx-punchy");
    await page.waitForFunction((v) => window.diopter.header.version > v, known, { timeout: WAIT });
    await changed(page, before, "curve");
    await shot(page, "develop");
    await accessible(page, "develop");
    await page.getByRole("button", { name: "Set curve back" }).click();
  });

  await test("a lens is chosen by its drawing", async () => {
    await page.getByRole("tab", { name: "Optics" }).click();
    await page.locator("button.menu").nth(1).click();
    await page.getByRole("searchbox").fill("planar-50mm");
    await page.waitForTimeout(300);
    await accessible(page, "chooser");
    await shot(page, "lenses");
    await page.getByRole("option", { name: /planar-50mm-f1.4/ }).click();
    await page.waitForFunction(() => window.diopter.state.shot.camera.lens === "planar-50mm-f1.4", null, { timeout: WAIT });
    await settled(page);
    await page.waitForFunction(() => document.querySelector(".optics img.section").naturalWidth > 0, null, { timeout: WAIT });
    await shot(page, "optics");
    await accessible(page, "optics");
  });

  await test("a picture is taken and its DNG fetched", async () => {
    await page.getByRole("tab", { name: "Camera" }).click();
    await page.getByLabel("Picture size").fill("360x240");
    await page.getByLabel("Picture size").press("Enter");
    await page.getByLabel("Samples a pixel").fill("4");
    await page.getByLabel("Samples a pixel").press("Enter");
    await page.waitForFunction(() => window.diopter.state.shot.render.spp === 4, null, { timeout: WAIT });
    await page.getByRole("button", { name: "Take the picture" }).click();
    await page.waitForFunction(() => window.diopter.state.film.length === 1, null, { timeout: WAIT });
    await page.getByRole("button", { name: "Open photo-0001" }).click();
    await page.getByLabel("Compare with").selectOption("live");
    const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("link", { name: "Download DNG" }).click()]);
    const path = join(out, "photo.dng");
    await download.saveAs(path);
    assert.equal(download.suggestedFilename(), "photo-0001.dng");
    assert.equal(readFileSync(path).subarray(0, 2).toString(), "II");
    assert.match(await page.locator(".repeat code").textContent(), /^diopter shoot photo-0001\.toml/);
    await page.waitForTimeout(300);
    await accessible(page, "viewer");
    await shot(page, "viewer");
    await page.keyboard.press("Escape");
  });

  const films = () => page.evaluate(() => window.diopter.state.film.length);
  const taken = (n) => page.waitForFunction((count) => window.diopter.state.film.length === count, n, { timeout: WAIT });

  await test("the flash lights the picture, by its power", async () => {
    await settled(page);
    const before = await picture(page);
    const flash = page.getByRole("button", { name: "Flash on the camera" });
    await flash.click();
    await page.waitForFunction(() => window.diopter.state.shot.flash?.guide_number === 40 && window.diopter.state.facts.exposure.flash, null, { timeout: WAIT });
    await changed(page, before, "flash");
    assert.equal(await flash.getAttribute("aria-pressed"), "true");
    await settled(page);
    const full = await picture(page);
    await page.getByRole("slider", { name: "Flash power" }).focus();
    for (const power of [0.5, 0.25, 0.125]) {
      await page.keyboard.press("PageDown");
      await page.waitForFunction((p) => Math.abs(window.diopter.state.shot.flash.power - p) < 1e-3, power, { timeout: WAIT });
    }
    assert.match(await page.getByRole("slider", { name: "Flash power" }).getAttribute("aria-valuetext"), /1\/8 \(−3\.0 EV\)/);
    await changed(page, full, "flash power");
    await page.getByLabel("Guide number").fill("20");
    await page.getByLabel("Guide number").press("Enter");
    await page.getByRole("combobox", { name: "Fires" }).selectOption("second");
    await page.waitForFunction(() => window.diopter.state.shot.flash.guide_number === 20 && window.diopter.state.shot.flash.sync === "second", null, { timeout: WAIT });
    await settled(page);
    await flash.scrollIntoViewIfNeeded();
    await shot(page, "flash");
    await accessible(page, "flash");
    // By its key, and with its settings when it comes back.
    await page.locator(".stage").focus();
    await page.keyboard.press("o");
    await page.waitForFunction(() => !window.diopter.state.shot.flash, null, { timeout: WAIT });
    await page.keyboard.press("o");
    await page.waitForFunction(() => window.diopter.state.shot.flash?.guide_number === 20, null, { timeout: WAIT });
    await page.keyboard.press("o");
    await page.waitForFunction(() => !window.diopter.state.shot.flash, null, { timeout: WAIT });
  });

  await test("a bracket is three pictures on the film", async () => {
    const before = await films();
    await page.getByRole("combobox", { name: "Pictures" }).selectOption("bracket");
    await page.getByRole("combobox", { name: "Step" }).selectOption({ label: "1 EV" });
    await page.getByRole("button", { name: "Take a bracket of 3 pictures, 1 EV apart" }).click();
    await taken(before + 3);
    const series = await page.evaluate(() => window.diopter.state.film.slice(-3).map((p) => [p.series.number, Math.round(1000 * p.series.differs.ev) / 1000, p.command]));
    assert.deepEqual(series.map((s) => s.slice(0, 2)), [[1, -1], [2, 0], [3, 1]]);
    assert.equal(new Set(series.map((s) => s[2])).size, 3);
    await page.getByRole("button", { name: /^Open photo-/ }).last().click();
    await page.locator("dialog.viewer", { hasText: "3/3 +1.0 EV" }).waitFor({ timeout: WAIT });
    await page.keyboard.press("Escape");
    await shot(page, "bracket");
    await accessible(page, "bracket");
  });

  await test("a focus stack goes from limit to limit, and is cancelled whole", async () => {
    const before = await films();
    await page.getByRole("combobox", { name: "Pictures" }).selectOption("focus");
    await page.getByRole("combobox", { name: "How many" }).selectOption("3");
    await page.getByRole("spinbutton", { name: "Near limit" }).fill("0.8");
    await page.getByRole("spinbutton", { name: "Near limit" }).press("Enter");
    await page.getByRole("spinbutton", { name: "Far limit" }).fill("2.4");
    await page.getByRole("spinbutton", { name: "Far limit" }).press("Enter");
    await accessible(page, "stack");
    await page.getByRole("button", { name: "Take a focus stack of 3 pictures" }).click();
    await taken(before + 3);
    const distances = await page.evaluate(() => window.diopter.state.film.slice(-3).map((p) => p.facts.focus_distance_m));
    for (const [i, m] of [0.8, 1.2, 2.4].entries()) assert.ok(Math.abs(distances[i] - m) < 1e-6, `${distances}`);
    // Long enough to be caught.
    await page.getByLabel("Samples a pixel").fill("4096");
    await page.getByLabel("Samples a pixel").press("Enter");
    await page.waitForFunction(() => window.diopter.state.shot.render.spp === 4096, null, { timeout: WAIT });
    await page.getByRole("button", { name: "Take a focus stack of 3 pictures" }).click();
    await page.getByRole("button", { name: "Cancel the series" }).click({ timeout: WAIT });
    await page.waitForFunction(() => window.diopter.state.queue.jobs.length === 0, null, { timeout: WAIT });
    assert.equal(await films(), before + 3);
    await page.getByLabel("Samples a pixel").fill("4");
    await page.getByLabel("Samples a pixel").press("Enter");
    await page.waitForFunction(() => window.diopter.state.shot.render.spp === 4, null, { timeout: WAIT });
    await page.getByRole("combobox", { name: "Pictures" }).selectOption("single");
  });

  await test("the self-timer counts down, aloud, and is cancelled", async () => {
    const before = await films();
    await page.getByRole("combobox", { name: "Self-timer" }).selectOption("10");
    await page.getByRole("button", { name: "Take the picture, 10 s self-timer" }).click();
    const counter = page.locator(".countdown");
    await counter.waitFor({ state: "visible", timeout: WAIT });
    await page.locator(".spoken", { hasText: "Self-timer: 10 seconds" }).waitFor({ state: "attached", timeout: WAIT });
    assert.match(await counter.locator(".digits").textContent(), /^\d+$/);
    await shot(page, "self-timer");
    await accessible(page, "self-timer");
    // However long that took, the next one is cancelled before it is over: by its own button.
    await page.evaluate(() => {
      window.diopter.link.send({ do: "cancel-timer" });
      window.diopter.link.send({ do: "shoot", timer_s: 60 });
    });
    await page.waitForFunction(() => window.diopter.state.timer?.seconds === 60, null, { timeout: WAIT });
    const all = () => page.evaluate(() => window.diopter.state.queue.jobs.length + window.diopter.state.film.length);
    const known = await all();
    assert.ok(known - before <= 1);
    await counter.getByRole("button", { name: "Cancel the self-timer" }).click();
    await counter.waitFor({ state: "hidden", timeout: WAIT });
    assert.equal(await all(), known);
    await page.locator(".spoken", { hasText: "Self-timer cancelled" }).waitFor({ state: "attached", timeout: WAIT });
    // From the keyboard, to the end.
    await page.locator(".stage").focus();
    await page.keyboard.press("t");
    await page.keyboard.press("t");
    await page.keyboard.press("Enter");
    await counter.waitFor({ state: "visible", timeout: WAIT });
    await taken(known + 1);
    await page.keyboard.press("t");
    await page.keyboard.press("t");
  });

  await test("the image of a point under the pointer", async () => {
    await page.getByRole("tab", { name: "Optics" }).click();
    await settled(page);
    const box = await page.locator(".stage").boundingBox();
    const point = page.locator(".point");
    const about = async (text) => point.locator("p", { hasText: text }).first().waitFor({ timeout: WAIT });
    await page.mouse.move(box.x + box.width * 0.5, box.y + box.height * 0.5);
    await about("At 50 %, 50 %");
    assert.equal(await point.locator("tbody tr").count(), 4);
    const contrast = () => point.locator("tbody td").allTextContents();
    const middle = await contrast();
    assert.ok(middle.length === 12 && middle.every((t) => /%$/.test(t)), `${middle}`);
    assert.ok(await point.locator("svg .airy").count() === 1 && await point.locator("svg .rays").count() === 3);
    // Without a pointer.
    await page.getByRole("slider", { name: "Place across the picture" }).focus();
    await page.keyboard.press("End");
    await about("At 100 %, 50 %");
    assert.notDeepEqual(await contrast(), middle);
    await page.getByLabel("At the distance of what is there").check();
    await page.waitForFunction(() => document.querySelector(".point").getAttribute("aria-busy") === "false", null, { timeout: WAIT });
    await point.scrollIntoViewIfNeeded();
    await shot(page, "point");
    await accessible(page, "point");
    // What has none says so.
    await page.evaluate(() => window.diopter.link.set({ camera: { lens: "pinhole" } }));
    await about("A pinhole has no image of a point");
    await page.evaluate(() => window.diopter.link.set({ camera: { lens: "thin" } }));
    await point.locator(".legend", { hasText: "Blur disk" }).waitFor({ timeout: WAIT });
    await page.evaluate(() => window.diopter.link.set({ camera: { lens: "planar-50mm-f1.4" } }));
    await page.waitForFunction(() => window.diopter.state.shot.camera.lens === "planar-50mm-f1.4", null, { timeout: WAIT });
    await page.getByRole("tab", { name: "Camera" }).click();
  });

  await test("a reload and a second tab see the same camera", async () => {
    await page.reload();
    await page.waitForFunction(() => window.diopter?.frames > 0, null, { timeout: WAIT });
    const lens = (p) => p.evaluate(() => window.diopter.state.shot.camera.lens);
    assert.equal(await lens(page), "planar-50mm-f1.4");
    const second = await open(`http://${host}/`, { width: 390, height: 844 });
    assert.equal(await lens(second), "planar-50mm-f1.4");
    await second.getByRole("radio", { name: /^Program/ }).click();
    await page.waitForFunction(() => window.diopter.state.shot.exposure.mode === "P", null, { timeout: WAIT });
    await settled(second);
    await shot(second, "phone");
    await accessible(second, "phone");
    const inside = (locator) => locator.evaluate((e) => e.scrollWidth <= e.clientWidth + 1 && e.getBoundingClientRect().right <= innerWidth + 1);
    for (const group of await second.locator(".group").all()) assert.ok(await inside(group), "a group is wider than the phone");
    await second.getByRole("button", { name: "Flash on the camera" }).scrollIntoViewIfNeeded();
    await shot(second, "phone-flash");
    await second.getByRole("tab", { name: "Optics" }).click();
    await second.locator(".point tbody tr").first().waitFor({ timeout: WAIT });
    await second.locator(".point .spot").scrollIntoViewIfNeeded();
    await shot(second, "phone-point");
    await accessible(second, "phone point");
    await second.getByRole("tab", { name: "Camera" }).click();
    await second.close();
  });

  await test("dark and light", async () => {
    await settled(page);
    await accessible(page, "dark");
    await page.getByRole("button", { name: "Light or dark page" }).click();
    await accessible(page, "light");
    await shot(page, "light");
    await page.getByRole("button", { name: "Keyboard and mouse" }).click();
    await accessible(page, "help");
    await page.keyboard.press("Escape");
    await page.getByRole("button", { name: "Light or dark page" }).click();
  });

  await test("what is wrong is answered in the words of the command line", async () => {
    await page.evaluate(() => window.diopter.link.send({ do: "set", shot: { scene: { file: "still-lifes" } } }));
    await page.locator(".toast", { hasText: "did you mean \"still-life\"" }).waitFor({ timeout: WAIT });
    await accessible(page, "toast");
    assert.notEqual(await page.evaluate(() => window.diopter.state.shot.scene.file), "still-lifes");
    await page.evaluate(() => {
      for (let i = 0; i < 200; i++) window.diopter.link.socket.send(`nonsense ${i}`);
      window.diopter.link.socket.send(new Uint8Array(100));
    });
    const known = await version(page);
    await page.evaluate(() => window.diopter.link.send({ do: "set", shot: { exposure: { iso: 1600 } } }));
    await page.waitForFunction((v) => window.diopter.header.version > v, known, { timeout: WAIT });
  });

  await test("strangers are refused", async () => {
    const status = (headers, path = "/") => new Promise((done, fail) => {
      request({ host: "127.0.0.1", port, path, headers }, (r) => done(r.resume().statusCode)).on("error", fail).end();
    });
    assert.equal(await status({}), 403);
    assert.equal(await status({}, "/?token=wrong"), 403);
    assert.equal(await status({ "x-diopter-token": token }), 200);
    assert.equal(await status({ "x-diopter-token": token, host: "evil.example" }), 421);
    assert.equal(await status({ "x-diopter-token": token, origin: "http://evil.example" }), 403);
    // A page of another origin: the browser sends no cookie, and the server would not take it.
    const other = await browser.newContext();
    const stranger = await other.newPage();
    await stranger.goto("data:text/html,x");
    const opened = await stranger.evaluate((where) => new Promise((done) => {
      const socket = new WebSocket(where);
      socket.onopen = () => done(true);
      socket.onerror = () => done(false);
    }), `ws://${host}/ws`);
    assert.equal(opened, false);
    await other.close();
  });

  assert.deepEqual(errors, [], "errors in the console");

  await test("Ctrl-C ends it, and the page says so", async () => {
    viewfinder.child.kill("SIGINT");
    assert.equal(await viewfinder.ended, 0);
    await page.locator(".lost").waitFor({ state: "visible", timeout: WAIT });
  });
} finally {
  // Gently first, so that its temporary folder goes away.
  viewfinder.child.kill("SIGINT");
  await Promise.race([viewfinder.ended, new Promise((late) => setTimeout(late, 5000).unref())]);
  viewfinder.child.kill("SIGKILL");
  await browser.close();
}
for (const [name, ms] of times) console.log(`   ${name}: ${ms.toFixed(0)} ms to the first frame`);
console.log(`${count} passed`);
