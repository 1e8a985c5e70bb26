// Random turns of the dials for some minutes: how fast they are answered, and whether memory stays flat.
//
//   node soak.mjs DIOPTER MODULES [MINUTES]
//
// See viewfinder.mjs for MODULES. Prints times from a turn to its first frame on the page (median, 95 %, longest) by kind, and the memory of the
// program; fails where it grows by more than 5 % between the first and the last quarter, or where a turn is not answered.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";

const [program, modules, minutes = "2"] = process.argv.slice(2);
const { chromium } = createRequire(join(resolve(modules), "x.js"))("playwright-core");
const child = spawn(program, ["viewfinder", "--json"], { stdio: ["ignore", "pipe", "ignore"] });
const address = await new Promise((done) => {
  let told = "";
  child.stdout.on("data", (data) => {
    told += data;
    try { done(JSON.parse(told).address); } catch { /* Not all of it yet. */ }
  });
});
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"],
});

// The same turns each time.
let seed = 1;
const random = () => (seed = (seed * 48271) % 2147483647) / 2147483647;
const among = (list) => list[Math.floor(random() * list.length)];
const turns = {
  iso: () => ({ do: "set", shot: { exposure: { iso: among([100, 200, 400, 800, 1600, 3200]) } } }),
  tone: () => ({ do: "set", shot: { develop: { exposure: { ev: Number((random() - 0.5).toFixed(3)) } } } }),
  compensation: () => ({ do: "set", shot: { exposure: { compensation: Number((2 * random() - 1).toFixed(2)) } } }),
  aperture: () => ({ do: "set", shot: { exposure: { aperture: `f/${among([1.4, 2, 2.8, 4, 5.6, 8, 11])}` } } }),
  focus: () => ({ do: "set", shot: { focus: { distance: Number((0.5 + 2 * random()).toFixed(3)) } } }),
  orbit: () => ({ do: "move", how: "orbit", by: [0.2 * (random() - 0.5), 0.1 * (random() - 0.5)] }),
};
const memory = () => Number(/VmRSS:\s+(\d+)/.exec(readFileSync(`/proc/${child.pid}/status`, "utf8"))[1]) / 1024;
const times = new Map(Object.keys(turns).map((name) => [name, []]));
const steps = new Map(Object.keys(turns).map((name) => [name, []]));
const sizes = [];

try {
  const page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
  await page.goto(address);
  await page.waitForFunction(() => window.diopter?.header?.done || window.diopter?.header?.samples > 8, null, { timeout: 120_000 });
  const end = performance.now() + 60_000 * Number(minutes);
  while (performance.now() < end) {
    const name = among(Object.keys(turns));
    // A value that is set already is no turn.
    const answer = await page.evaluate(async (command) => {
      const { diopter } = window;
      const before = diopter.state.version;
      const begun = performance.now();
      diopter.link.send(command);
      while (diopter.header.version <= before) {
        if (diopter.state.version === before && performance.now() - begun > 400) return null;
        if (performance.now() - begun > 30_000) return Infinity;
        await new Promise((next) => requestAnimationFrame(next));
      }
      return { took: performance.now() - begun, steps: diopter.header.seconds };
    }, turns[name]());
    assert.notEqual(answer, Infinity, `${name}: not answered`);
    if (answer !== null) {
      times.get(name).push(answer.took);
      steps.get(name).push(answer.steps);
    }
    sizes.push(memory());
    await page.waitForTimeout(among([0, 50, 200, 1000]));
  }
} finally {
  child.kill("SIGINT");
  await browser.close();
}

const at = (list, part) => list.toSorted((a, b) => a - b)[Math.min(list.length - 1, Math.floor(part * list.length))] ?? NaN;
for (const [name, list] of times) {
  console.log(`${name.padEnd(13)} ${String(list.length).padStart(4)} turns   ${[0.5, 0.95, 1].map((p) => at(list, p).toFixed(0).padStart(5)).join(" ")} ms`);
}
// What the program itself took of it, from when it began on the turn.
for (const [name, list] of steps) {
  const median = (step) => `${step} ${(1000 * at(list.map((s) => s[step]), 0.5)).toFixed(0)}`;
  console.log(`${name.padEnd(13)} ms until: ${["waited", "prepared", "exposed", "denoised", "sent"].map(median).join(", ")}`);
}
const quarter = Math.floor(sizes.length / 4);
const [first, last] = [at(sizes.slice(quarter, 2 * quarter), 0.5), at(sizes.slice(-quarter), 0.5)];
console.log(`memory ${first.toFixed(0)} MB, then ${last.toFixed(0)} MB`);
assert.ok(last < 1.05 * first, "memory grows");
