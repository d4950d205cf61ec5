// The page of `lenscube view` in headless Chromium; run by check-view.
//
// Checked: no error on the console and no request to another host; zoom, bands, exposure, swipe, pins and crops by mouse and by
// keyboard; the spectrum on the page is that of the store; a crop has the pixels of `lenscube export`; a foreign Host is rejected; every
// control has an accessible name; light, dark and narrow layouts; a raw developed as by `lenscube develop`, its mosaic, and a pixel's
// numbers (SHOTS=folder keeps screenshots).

import { execFileSync, spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, mkdirSync } from "node:fs";
import http from "node:http";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { chromium } from "playwright-core";

const { LENSCUBE, CHROMIUM, SHOTS } = process.env;
const place = mkdtempSync(join(tmpdir(), "check-view-"));
let checks = 0;

function check(condition, message) {
  checks += 1;
  if (!condition) throw new Error(message);
}
const run = (...args) => execFileSync(LENSCUBE, args, { stdio: ["ignore", "pipe", "pipe"] });

function view(...args) {
  const child = spawn(LENSCUBE, ["view", ...args], { stdio: ["ignore", "pipe", "ignore"] });
  return new Promise((resolve, reject) => {
    child.once("exit", (code) => reject(new Error(`lenscube view ended with ${code}`)));
    child.stdout.once("data", (line) => resolve({ child, url: String(line).trim() }));
  });
}

const status = (url, headers) => new Promise((resolve, reject) =>
  http.get(url, { headers }, (response) => { response.resume(); resolve(response.statusCode); }).on("error", reject));

/** A page, with its console errors and its requests to other hosts in `errors`. */
async function open(browser, url, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 820 }, ...options });
  const page = await context.newPage();
  const errors = [];
  // The warning about reading pixels back is caused by these checks.
  const expected = (m) => m.text().includes("willReadFrequently");
  page.on("console", (m) => { if (["error", "warning"].includes(m.type()) && !expected(m)) errors.push(m.text()); });
  page.on("pageerror", (e) => errors.push(String(e)));
  page.on("request", (r) => { if (!r.url().startsWith(url) && !r.url().startsWith("blob:")) errors.push(`request to ${r.url()}`); });
  await page.goto(url);
  await ready(page);
  return { page, context, errors };
}
const ready = (page) => page.waitForFunction(() => document.body.dataset.ready === "true" && !document.getElementById("busy").textContent, null, { timeout: 120000 });
/** Waits until tiles are there and the canvas has had the same pixels for three readings: frames come late on a busy machine. */
async function still(page) {
  await page.waitForTimeout(300);
  await ready(page);
  await page.evaluate(async () => {
    const canvas = document.querySelector("#view canvas");
    const sum = () => canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data.reduce((a, v) => (a * 31 + v) | 0, 0);
    for (let last, same = 0; same < 3;) {
      await new Promise((done) => setTimeout(done, 100));
      await new Promise(requestAnimationFrame);
      const now = sum();
      same = now === last ? same + 1 : 0;
      last = now;
    }
  });
  await ready(page);
}
const screenshot = async (page, name) => { if (SHOTS) { mkdirSync(SHOTS, { recursive: true }); await page.screenshot({ path: join(SHOTS, `${name}.png`) }); } };
const text = (page, id) => page.locator(`#${id}`).textContent();

/** Pixels of a PNG, as the browser decodes them. */
const pixels = (page, bytes) => page.evaluate(async (base64) => {
  const blob = new Blob([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))], { type: "image/png" });
  const bitmap = await createImageBitmap(blob, { colorSpaceConversion: "none" });
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
  const context = canvas.getContext("2d");
  context.drawImage(bitmap, 0, 0);
  return { w: bitmap.width, h: bitmap.height, rgba: [...context.getImageData(0, 0, bitmap.width, bitmap.height).data] };
}, Buffer.from(bytes).toString("base64"));

async function viewing(browser, url) {
  const { page, context, errors } = await open(browser, url);
  check((await page.title()).includes("film.zarr"), "the title contains the film name");
  check(await page.locator("#view canvas").count() > 0, "the film is drawn");
  const before = await text(page, "zoom");
  const box = await page.locator("#view").boundingBox();
  const middle = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(...middle);
  for (let i = 0; i < 6; i += 1) await page.mouse.wheel(0, -300);
  await still(page);
  const after = await text(page, "zoom");
  check(before !== after && /^[\d.]+ : 1$/.test(after), `the wheel zooms: ${before}, then ${after}`);

  // A band, by its key and by its slider.
  await page.locator("#view .openseadragon-canvas").focus();
  await page.keyboard.press("b");
  await ready(page);
  const first = await text(page, "band-text");
  const requested = page.waitForRequest((r) => r.url().includes("/tile/film/") && r.url().includes("band=2"));
  await page.locator("#band").focus();
  await page.locator("#band").fill("2");
  await requested;
  await ready(page);
  check(await text(page, "band-text") === "610 nm" && first !== "610 nm", `band ${first}, then ${await text(page, "band-text")}`);
  await page.keyboard.press(",");
  await ready(page);
  check(await text(page, "band-text") === "550 nm", "the key , goes one band back");

  // Exposure: the same view, darker.
  const mean = () => page.evaluate(() => {
    const c = document.querySelector("#view canvas");
    const data = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
    let sum = 0;
    for (let i = 0; i < data.length; i += 4) sum += data[i];
    return sum * 4 / data.length;
  });
  await page.keyboard.press("c");
  await page.keyboard.press("0");
  await still(page);
  const bright = await mean();
  for (let i = 0; i < 4; i += 1) await page.keyboard.press("[");
  await still(page);
  check(await mean() < bright * 0.9, `[ makes it darker: ${bright}, then ${await mean()}`);
  await page.locator("#reset").click();
  await still(page);

  // Spectrum of a pixel, compared with the store; position and lens data.
  await page.locator("#px").fill("40");
  await page.locator("#py").fill("31");
  await page.locator("#go button").click();
  await page.waitForFunction(() => document.body.dataset.pixel === "40,31");
  const reply = JSON.parse(await page.evaluate(async () => (await fetch("api/pixel?x=40&y=31")).text()));
  const store = stored(40, 31);
  check(reply.film.length === 3 && reply.film.every((v, b) => Math.fround(v) === store[b]), `the store has ${store}, the page ${reply.film}`);
  const label = await page.locator("#spectrum").getAttribute("aria-label");
  for (const [b, nm] of [450, 550, 610].entries()) {
    const shown = Number(label.match(new RegExp(`${nm} nm ([\\d.]+)`))[1]);
    check(Math.abs(shown - store[b]) <= 1e-3 * store[b], `the plot shows ${shown} at ${nm} nm, the store has ${store[b]}`);
  }
  await page.waitForFunction(() => document.body.dataset.lens?.startsWith("40,31,"), null, { timeout: 120000 });
  check((await text(page, "figures")).includes("RI") && await page.locator("#psf").evaluate((i) => i.complete && i.naturalWidth > 4), "lens data are shown");
  await screenshot(page, "light");

  // Keys: a pin in the middle, moved by one pixel.
  await page.keyboard.press("Escape");
  await page.locator("#view .openseadragon-canvas").focus();
  await page.keyboard.press("0");
  await still(page);
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => document.body.dataset.pixel !== "40,31" && !document.getElementById("pin").hidden);
  const [px, py] = (await page.evaluate(() => document.body.dataset.pixel)).split(",").map(Number);
  await page.keyboard.press("Shift+ArrowRight");
  await page.waitForFunction((pixel) => document.body.dataset.pixel === pixel, `${px + 1},${py}`);
  check(true, "Shift and an arrow move the pin");
  const at = () => page.evaluate(() => document.getElementById("pin").style.left);
  const left = await at();
  await page.keyboard.press("ArrowRight");
  await still(page);
  check(await at() !== left, "arrows move the picture");
  const zoomed = await text(page, "zoom");
  await page.keyboard.press("+");
  await still(page);
  check(await text(page, "zoom") !== zoomed, "plus zooms");
  await page.keyboard.press("?");
  check(await page.locator("#help").evaluate((d) => d.open), "? shows the keys");
  await page.keyboard.press("Escape");

  // Every control has an accessible name, and Tab reaches the controls in order.
  const nameless = await page.evaluate(() => [...document.querySelectorAll("button, input, select, a, [role=slider]")].filter((e) =>
    !e.closest("[hidden]") && !(e.getAttribute("aria-label") || e.labels?.length || e.textContent.trim())).map((e) => e.id || e.outerHTML));
  check(nameless.length === 0, `without a name: ${nameless}`);
  await page.locator("#help-open").focus();
  const order = [];
  for (let i = 0; i < 14; i += 1) {
    await page.keyboard.press("Tab");
    order.push(await page.evaluate(() => document.activeElement.id || document.activeElement.className));
  }
  const expected = ["openseadragon-canvas", "mode-colour", "band", "ev", "gamma", "white", "reset", "px"];
  const places = expected.map((w) => order.findIndex((o) => o.includes(w)));
  check(places.every((p, i) => p >= 0 && (i === 0 || p > places[i - 1])), `the focus goes ${order}`);
  check(errors.length === 0, `console: ${errors.join("; ")}`);
  await context.close();
}

/** Values of a pixel of the film, from a separate run with a region of one pixel. */
function stored(x, y) {
  const film = join(place, `pixel-${x}-${y}.zarr`);
  run("run", ...chart, film, ...job, "--roi", `${x},${y},1,1`, "--codec", "none", "--chunk", "1", "--shard", "1");
  return [0, 1, 2].map((band) => new Float32Array(new Uint8Array(readFileSync(join(film, "roi_0", "c", String(band), "0", "0")).subarray(0, 4)).buffer)[0]);
}

async function swipes(browser, url) {
  const { page, context, errors } = await open(browser, url, { colorScheme: "dark" });
  const line = page.locator("#swipe-line");
  await page.locator("#swipe").click();
  await page.waitForFunction(() => !document.getElementById("swipe-line").hidden);
  await still(page);
  const column = (share) => page.evaluate((share) => {
    const c = document.querySelector("#view canvas");
    const data = c.getContext("2d").getImageData(Math.round(c.width * share), 0, 1, c.height).data;
    return [...data].join();
  }, share);
  const [film, chart] = [await column(0.42), await column(0.58)];
  const box = await page.locator("#view").boundingBox();
  const at = await line.boundingBox();
  await page.mouse.move(at.x + at.width / 2, at.y + 200);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width * 0.8, at.y + 200, { steps: 5 });
  await page.mouse.up();
  await still(page);
  check(await line.getAttribute("aria-valuenow") === "80", `the line is at ${await line.getAttribute("aria-valuenow")}`);
  check(await column(0.42) === film && await column(0.58) !== chart, "left of the line is the film, and the film differs from the chart");
  await line.focus();
  for (let i = 0; i < 25; i += 1) await page.keyboard.press("ArrowLeft");
  await still(page);
  const place = await line.getAttribute("aria-valuenow");
  check(place === "30", `arrows move the line to ${place}`);
  const again = await column(0.58);
  const difference = (a, b) => Math.max(...a.split(",").map((v, i) => Math.abs(v - b.split(",")[i])));
  // Blending on the canvas may differ at the edge of the chart.
  check(difference(again, chart) <= 8, `right of the line is the chart: maximum difference ${difference(again, chart)}`);
  for (let i = 0; i < 10; i += 1) await page.keyboard.press("ArrowRight");
  await page.mouse.click(box.x + box.width * 0.62, box.y + box.height * 0.3);
  await page.waitForFunction(() => document.body.dataset.lens, null, { timeout: 120000 });
  await still(page);
  await screenshot(page, "dark");
  await page.locator("#swipe").click();
  await page.waitForFunction(() => document.getElementById("swipe-line").hidden);
  await ready(page);
  check(errors.length === 0, `console: ${errors.join("; ")}`);
  await context.close();
}

async function crops(browser, url) {
  const { page, context, errors } = await open(browser, url, { viewport: { width: 420, height: 860 }, acceptDownloads: true });
  await screenshot(page, "narrow");
  await page.evaluate(() => scrollTo(0, 0));
  await page.keyboard.press("x");
  const box = await page.locator("#crop-layer").boundingBox();
  await page.mouse.move(box.x + 150, box.y + 150);
  await page.mouse.down();
  await page.mouse.move(box.x + 210, box.y + 190, { steps: 4 });
  await page.mouse.up();
  const drawn = await Promise.all(["cw", "ch"].map((id) => page.locator(`#${id}`).inputValue()));
  check(drawn.every((v) => Number(v) > 20), `a crop of ${drawn}`);
  // The complete film: the pixels of `export` at the same exposure.
  const all = { cx: 0, cy: 0, cw: 463, ch: 541 };
  for (const [id, v] of Object.entries(all)) await page.locator(`#${id}`).fill(String(v));
  const [saved] = await Promise.all([page.waitForEvent("download"), page.locator("#save").click()]);
  const crop = readFileSync(await saved.path());
  const exposure = (await page.locator("#save").getAttribute("href")).match(/exposure=([^&]+)/)[1];
  check(saved.suggestedFilename() === "film.zarr-0-0-463x541.png", saved.suggestedFilename());
  const out = join(place, "export.png");
  run("export", join(place, "film.zarr"), out, "--exposure", exposure, "--max-side", "9999");
  const [a, b] = [await pixels(page, crop), await pixels(page, readFileSync(out))];
  check(a.w === 463 && a.h === 541 && b.w === 463, `the crop has ${a.w} x ${a.h} pixels`);
  const differ = a.rgba.findIndex((v, i) => v !== b.rgba[i]);
  check(differ < 0, `crop and export differ at ${differ}: ${a.rgba[differ]}, ${b.rgba[differ]}`);
  check(new Set(a.rgba).size > 50, "the crop is not uniform");
  const small = await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth);
  check(small, "a narrow screen needs no horizontal scrolling");
  check(errors.length === 0, `console: ${errors.join("; ")}`);
  await context.close();
}

async function withoutPyramidAndLens(browser, url) {
  const { page, context, errors } = await open(browser, url);
  check((await text(page, "note")).includes("lenscube pyramid"), "the page reports the missing pyramid");
  check((await text(page, "lens-name")).includes("No lens data"), "the page reports the missing lens data");
  check(errors.length === 0, `console: ${errors.join("; ")}`);
  await context.close();
}

async function rawPage(browser, url) {
  const { page, context, errors } = await open(browser, url);
  check((await text(page, "facts")).includes("example-2um"), "the header names the sensor");
  check((await page.locator("#mode-colour + span").textContent()) === "Developed", "colours are those of the development");
  check(!(await page.locator("#lens-section").isVisible()) && !(await page.locator("#spectrum-figure").isVisible()), "a raw has no lens and no spectrum");
  // Frame 1, its pixel in digital numbers and electrons.
  await page.locator("#band").fill("1");
  await ready(page);
  check((await text(page, "band-text")).startsWith("frame 1, "), await text(page, "band-text"));
  await page.locator("#px").fill("40");
  await page.locator("#py").fill("31");
  await page.locator("#go button").click();
  await page.waitForFunction(() => document.body.dataset.pixel === "40,31");
  await still(page);
  const reading = await (await fetch(`${url}api/pixel?x=40&y=31&frame=1&white=D65`)).json();
  const { dn, electrons, signal_e } = reading.raw.frames[1];
  const panel = await text(page, "place");
  check(panel.includes(`${dn} DN`) && panel.includes(`${electrons.toFixed(1)} e⁻`) && panel.includes(`${signal_e.toFixed(1)} e⁻`), `${panel} for ${JSON.stringify(reading.raw)}`);
  check(Math.abs(electrons - (dn - 256) / 0.28) < 1e-9, `${dn} DN are ${electrons} e⁻`);
  check(panel.includes(reading.developed.join(", ")), "the developed colour is shown");
  await screenshot(page, "raw-developed");
  // At 1:1 the page shows what `develop` writes.
  const out = join(place, "developed.png");
  run("develop", join(place, "raw.zarr"), out, "--frame", "1", "--white", "D65");
  const crop = Buffer.from(await (await fetch(`${url}crop.png?x=0&y=0&w=463&h=541&frame=1&white=D65&exposure=1&gamma=1`)).arrayBuffer());
  const [a, b] = [await pixels(page, crop), await pixels(page, readFileSync(out))];
  check(a.w === 463 && a.h === 541 && a.rgba.every((v, i) => v === b.rgba[i]), "the page's development is that of the command");
  // The mosaic by its key, enlarged.
  await page.keyboard.press("Escape");
  await page.locator("#view .openseadragon-canvas").focus();
  const requested = page.waitForRequest((r) => r.url().includes("mosaic=1") && r.url().includes("frame=1"));
  await page.keyboard.press("b");
  await requested;
  await ready(page);
  for (let i = 0; i < 8; i += 1) await page.keyboard.press("+");
  await still(page);
  await page.keyboard.press("Enter");
  await still(page);
  await screenshot(page, "raw-mosaic");
  await page.keyboard.press(",");
  await ready(page);
  check((await text(page, "band-text")).startsWith("frame 0, "), "the key , goes one frame back");
  const nameless = await page.evaluate(() => [...document.querySelectorAll("button, input, select, a, [role=slider]")].filter((e) =>
    e.offsetParent && !(e.getAttribute("aria-label") || e.labels?.length || e.textContent.trim())).map((e) => e.id || e.outerHTML));
  check(nameless.length === 0, `without a name: ${nameless}`);
  check(errors.length === 0, `console: ${errors.join("; ")}`);
  await context.close();
}

const exposed = ["--sensor", "example-2um", "--set", "pixel.pitch_um=50", "--set", "pixel.aperture_um=50", "--exposure", "2e-5,8e-5"];
const chart = ["gen:composite?size=463x541&wavelengths=450,550,610&pitch_um=50"];
const job = ["--no-fsync"];
const servers = [];
let browser;
try {
  run("run", ...chart, join(place, "film.zarr"), ...job, "--pyramid");
  run("run", ...chart, join(place, "bare.zarr"), ...job);
  servers.push(await view(join(place, "film.zarr")));
  servers.push(await view(join(place, "bare.zarr//film"), "--chart", chart[0]));
  run("sensor", join(place, "film.zarr"), join(place, "raw.zarr"), ...exposed, "--keep-signal", "--no-fsync");
  run("pyramid", join(place, "raw.zarr"));
  servers.push(await view(join(place, "raw.zarr")));
  const { url } = servers[0];
  const { port } = new URL(url);
  check(await status(url, {}) === 200, "the page is served");
  for (const host of ["evil.example", `evil.example:${port}`, "127.0.0.1"]) check(await status(url, { Host: host }) === 403, `Host ${host} is accepted`);
  check(await status(`${url}api/content`, { Origin: "http://evil.example" }) === 403, "a foreign Origin is accepted");
  const flags = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run"];
  browser = await chromium.launch({ executablePath: CHROMIUM, args: flags });
  await viewing(browser, url);
  await swipes(browser, url);
  await crops(browser, url);
  await withoutPyramidAndLens(browser, servers[1].url);
  await rawPage(browser, servers[2].url);
  const { child } = servers.pop();
  child.removeAllListeners("exit");
  const ended = new Promise((resolve) => child.once("exit", resolve));
  child.kill("SIGINT");
  check(await ended === 0, "Ctrl-C ends the server with 0");
  console.log(`${checks} checks: Chromium ${browser.version()} showed what lenscube served`);
} catch (error) {
  console.error(`check-view: ${error.message}\n${error.stack.split("\n").slice(1, 5).join("\n")}`);
  process.exitCode = 1;
} finally {
  await browser?.close();
  for (const { child } of servers) { child.removeAllListeners("exit"); child.kill("SIGKILL"); }
  rmSync(place, { recursive: true, force: true });
}
