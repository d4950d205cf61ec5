// Time from opening the page to the whole picture, and of single tiles, in headless Chromium: LENSCUBE=… CHROMIUM=… node measure.mjs FILM
// (from target/view-node, where check-view puts playwright-core).
import { spawn } from "node:child_process";
import { chromium } from "playwright-core";

const { LENSCUBE, CHROMIUM } = process.env;
const child = spawn(LENSCUBE, ["view", ...process.argv.slice(2)], { stdio: ["ignore", "pipe", "ignore"] });
const started = performance.now();
const url = await new Promise((resolve) => child.stdout.once("data", (line) => resolve(String(line).trim())));
console.log(`server up after ${(performance.now() - started).toFixed(0)} ms`);
const browser = await chromium.launch({ executablePath: CHROMIUM, args: ["--headless", "--no-sandbox", "--disable-gpu"] });
const page = await browser.newPage({ viewport: { width: 1280, height: 820 } });
for (const turn of ["first", "second"]) {
  const start = performance.now();
  await page.goto(url);
  await page.waitForFunction(() => document.body.dataset.ready === "true", null, { timeout: 600000, polling: 10 });
  console.log(`${turn} picture: ${(performance.now() - start).toFixed(0)} ms`);
}
const told = await page.evaluate(async () => {
  const site = await (await fetch("api/site")).json();
  const { film: exposure } = await (await fetch("api/exposure?white=D65")).json();
  const times = {};
  for (let level = 0; level < site.levels; level += 1) {
    const across = Math.ceil(site.size[1] / 2 ** level / site.tile);
    for (const turn of ["new", "again"]) {
      const each = [];
      for (let k = 0; k < Math.min(12, across); k += 1) {
        const begun = performance.now();
        await (await fetch(`tile/film/${level}/${across >> 1}_${(across >> 2) + (k % across)}.png?white=D65&gamma=1&exposure=${exposure}`)).blob();
        each.push(performance.now() - begun);
      }
      each.sort((a, b) => a - b);
      times[`level ${level}, ${turn}`] = `median ${each[each.length >> 1].toFixed(0)} ms, worst ${each[each.length - 1].toFixed(0)} ms`;
    }
  }
  const begun = performance.now();
  await (await fetch("api/pixel?x=7000&y=7000")).json();
  times["a pixel's spectrum"] = `${(performance.now() - begun).toFixed(0)} ms`;
  return times;
});
for (const [what, time] of Object.entries(told)) console.log(`${what}: ${time}`);
await browser.close();
child.kill("SIGINT");
