// Page of `lenscube view`: deep zoom of a film or raw, display settings, data of a pixel.

import { byId, lens as showLens, pixel as showPixel, short } from "./panel.js";
import { adapt, bandName, facts, rawPixel, rawQuery } from "./raw.js";

const OSD = window.OpenSeadragon;
// Tiles of outdated settings are dropped intentionally.
OSD.console = Object.assign(Object.create(console), {
  warn: (...message) => { if (!String(message[0]).startsWith("Ignoring tile")) console.warn(...message); },
});
const content = await (await fetch("api/content")).json();
const [H, W] = content.size;
const state = {
  mode: content.colour ? "colour" : "band", band: content.raw ? 0 : nearest(550), ev: 0, gamma: 1, white: content.raw?.white ?? "D65",
  swipe: false, split: 0.5, pin: null, crop: null, auto: { film: 1, chart: 1 }, reading: null,
};
const layers = { film: null, chart: null }, old = { film: [], chart: [] }, latestGeneration = { film: 0, chart: 0 };
let generation = 0, requests = 0;

function nearest(nm) {
  const away = content.bands.map((b) => Math.abs(b.nm - nm));
  return away.indexOf(Math.min(...away));
}
const shownBand = () => state.mode === "band" ? state.band : null;
const colourQuery = () => content.raw ? rawQuery(state) : state.mode === "band" ? `band=${state.band}` : `white=${state.white}`;
const showReading = () => content.raw ? rawPixel(state.reading, state.band) : showPixel(content, state.reading, shownBand());
const exposure = (stack) => state.auto[stack] * 2 ** state.ev;
const tileQuery = (stack) => `${colourQuery()}&exposure=${exposure(stack)}&gamma=${state.gamma}`;
const clamp = (v, min, max) => Math.min(max, Math.max(min, v));

const viewer = OSD({
  element: byId("view"), drawer: "canvas", showNavigationControl: false, showNavigator: false, prefixUrl: "",
  gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: true }, gestureSettingsTouch: { clickToZoom: false, dblClickToZoom: true },
  animationTime: 0.35, springStiffness: 9, blendTime: 0, maxZoomPixelRatio: 24, minZoomImageRatio: 0.7, visibilityRatio: 0.4,
  imageLoaderLimit: 4, immediateRender: true, timeout: 900000, maxImageCacheCount: 600, preserveImageSizeOnResize: false,
});

function source(stack) {
  const [height, width] = stack === "film" ? content.size : content.chart.size;
  const top = (stack === "film" ? content.levels : content.chart.levels) - 1;
  const query = tileQuery(stack);
  return {
    height, width, tileSize: content.tile, minLevel: 0, maxLevel: top,
    getTileUrl: (level, x, y) => `tile/${stack}/${top - level}/${y}_${x}.png?${query}`,
  };
}

/** Adds a layer of a stack with the current settings; the old layer stays until the new one is loaded. */
function addLayer(stack) {
  const id = ++generation;
  latestGeneration[stack] = id;
  const [x, y, width] = stack === "film" ? [0, 0, W] : content.chart.place;
  viewer.addTiledImage({
    tileSource: source(stack), x: x / W, y: y / W, width: width / W,
    // The chart lies on top, the newest film on top of older ones.
    index: stack === "film" ? old.film.length + (layers.film ? 1 : 0) : undefined,
    success: ({ item }) => {
      if (latestGeneration[stack] !== id) { viewer.world.removeItem(item); return; }
      if (layers[stack]) old[stack].push(layers[stack]);
      else if (stack === "film") requestAnimationFrame(() => { viewer.viewport.goHome(true); updateMarks(); });
      layers[stack] = item;
      const onLoaded = () => {
        if (layers[stack] === item && item.getFullyLoaded()) removeOldLayers(stack);
        updateBusy();
      };
      item.addHandler("fully-loaded-change", onLoaded);
      clip();
      onLoaded();
    },
  });
}

function removeOldLayers(stack) {
  old[stack].splice(0).forEach((item) => viewer.world.removeItem(item));
}

function removeLayer(stack) {
  latestGeneration[stack] = 0;
  removeOldLayers(stack);
  if (layers[stack]) viewer.world.removeItem(layers[stack]);
  layers[stack] = null;
  updateBusy();
}

function updateBusy() {
  const items = Object.values(layers).filter(Boolean);
  const ready = items.length > 0 && items.every((i) => i.getFullyLoaded());
  byId("busy").textContent = ready ? "" : "reading …";
  document.body.dataset.ready = ready;
  document.body.dataset.query = tileQuery("film");
}

/** Requests the automatic exposure of the current mode, then reloads the layers. */
async function reload(autoExposure = true) {
  updateControls();
  document.body.dataset.ready = false;
  const request = ++requests;
  if (autoExposure) {
    const answer = await fetch(`api/exposure?${colourQuery()}${state.swipe ? "&chart=1" : ""}`);
    if (!answer.ok) { note(await answer.text()); return; }
    const found = await answer.json();
    if (request !== requests) return;
    state.auto = { film: found.film, chart: found.chart ?? found.film };
  }
  note(null);
  updateControls();
  addLayer("film");
  if (state.swipe) addLayer("chart");
  else removeLayer("chart");
  // The developed colour of a raw's pixel depends on the mode.
  if (state.reading && content.raw) read(state.reading);
  else if (state.reading) showReading();
}

let reloadTimer = 0;
function reloadSoon() {
  clearTimeout(reloadTimer);
  updateControls();
  reloadTimer = setTimeout(() => reload(false), 60);
}

function updateControls() {
  byId("mode-colour").checked = state.mode === "colour";
  byId("mode-band").checked = state.mode === "band";
  byId("band").value = state.band;
  byId("band-text").textContent = state.mode === "band" || content.raw ? bandName(content, state.band) : "";
  byId("band").setAttribute("aria-valuetext", bandName(content, state.band));
  [...byId("band-inks").children].forEach((ink, b) => ink.classList.toggle("on", b === shownBand()));
  byId("ev").value = state.ev;
  byId("ev-text").textContent = `×${short(exposure("film"), 3)}  ${state.ev >= 0 ? "+" : "−"}${Math.abs(state.ev).toFixed(1)} EV`;
  byId("gamma").value = state.gamma;
  byId("gamma-text").textContent = state.gamma.toFixed(2);
  byId("white").value = state.white;
  byId("white").disabled = state.mode === "band";
  byId("swipe").setAttribute("aria-pressed", state.swipe);
  byId("swipe-line").hidden = !state.swipe;
  updateCrop();
}

function note(text) {
  byId("note").hidden = !text;
  byId("note").textContent = text ?? "";
}

// Display settings.

function setMode(mode) {
  if (mode === "colour" && !content.colour) return;
  state.mode = mode;
  reload();
}
function setBand(band) {
  state.band = clamp(band, 0, content.bands.length - 1);
  if (!content.raw) state.mode = "band";
  reload();
  requestLens();
}
function setEv(ev) {
  state.ev = clamp(Math.round(ev * 10) / 10, -8, 8);
  reloadSoon();
}
function setSwipe(on) {
  if (!content.chart) return;
  state.swipe = on;
  reload();
  updateMarks();
}

// Pixels.

const item = () => layers.film;
function pixelAt(point) {
  const p = item()?.viewerElementToImageCoordinates(point);
  if (!p) return null;
  const [x, y] = [Math.floor(p.x), Math.floor(p.y)];
  return x >= 0 && y >= 0 && x < W && y < H ? { x, y } : null;
}

/** Runs the latest of many requests, one at a time. */
function latest(run) {
  let pending = null, busy = false;
  return async (next) => {
    pending = next;
    if (busy) return;
    busy = true;
    while (pending !== null) {
      const current = pending;
      pending = null;
      try { await run(current); } catch (error) { note(`No response from lenscube: ${error.message}`); }
    }
    busy = false;
  };
}

const read = latest(async ({ x, y }) => {
  const answer = await fetch(`api/pixel?x=${x}&y=${y}${content.raw ? `&${colourQuery()}` : ""}`);
  if (!answer.ok) { note(await answer.text()); return; }
  state.reading = await answer.json();
  if (document.activeElement !== byId("px") && document.activeElement !== byId("py")) [byId("px").value, byId("py").value] = [x, y];
  showReading();
  document.body.dataset.pixel = `${x},${y}`;
});

const readLens = latest(async ({ x, y }) => {
  const band = state.band;
  const answer = await fetch(`api/lens?x=${x}&y=${y}&band=${band}`);
  if (!answer.ok) { lensNote(await answer.text()); byId("lens").hidden = true; return; }
  lensNote(content.lens.note);
  byId("lens").hidden = false;
  const log = byId("psf-log").checked ? "&log=1" : "";
  showLens(await answer.json(), { azimuth_deg: azimuth(x, y) }, band, `psf.png?x=${x}&y=${y}&band=${band}${log}`);
  document.body.dataset.lens = `${x},${y},${band}`;
});

const azimuth = (x, y) => Math.atan2(y - content.axis[0], x - content.axis[1]) * 180 / Math.PI;
let lensTimer = 0, hovered = null;
function requestLens() {
  const p = state.pin ?? hovered;
  if (p && !content.lens.error) readLens(p);
}
function hover(p) {
  hovered = p;
  read(p);
  clearTimeout(lensTimer);
  lensTimer = setTimeout(requestLens, 120);
}
function pin(p) {
  state.pin = p;
  byId("unpin").hidden = !p;
  updateMarks();
  if (p) hover(p);
}
function lensNote(text) {
  byId("lens-name").textContent = content.lens.name ?? "No lens data";
  if (!text) return;
  const small = document.createElement("small");
  small.textContent = text;
  byId("lens-name").append(small);
}

// Crops.

function setCrop(rect) {
  if (rect) {
    const [x, y] = [clamp(Math.round(rect.x), 0, W - 1), clamp(Math.round(rect.y), 0, H - 1)];
    rect = { x, y, w: clamp(Math.round(rect.w), 1, W - x), h: clamp(Math.round(rect.h), 1, H - y) };
  }
  state.crop = rect;
  for (const key of "xywh") byId(`c${key}`).value = rect ? rect[key] : "";
  updateCrop();
  updateMarks();
}
function updateCrop() {
  const save = byId("save"), c = state.crop;
  const large = c && (c.w * c.h > 2 ** 24 || Math.max(c.w, c.h) > 2 ** 14);
  save.setAttribute("aria-disabled", !c || large);
  byId("crop-note").textContent = !c ? "" : large ? "too large for a crop; use lenscube export" : `${c.w} × ${c.h} px`;
  if (!c || large) { save.removeAttribute("href"); return; }
  save.href = `crop.png?x=${c.x}&y=${c.y}&w=${c.w}&h=${c.h}&${tileQuery("film")}`;
  save.download = `${name.replace(/[^\w.-]+/g, "-")}-${c.x}-${c.y}-${c.w}x${c.h}.png`;
}
function setCropping(on) {
  byId("crop-layer").hidden = !on;
  byId("crop").setAttribute("aria-pressed", on);
}

// Overlays.

function clip() {
  for (const chart of [layers.chart, ...old.chart].filter(Boolean)) {
    const [h, w] = content.chart.size;
    const x = clamp(chart.viewerElementToImageCoordinates(new OSD.Point(state.split * byId("view").clientWidth, 0)).x, 0, w);
    chart.setClip(new OSD.Rect(x, 0, Math.max(w - x, 1e-3), h));
  }
}

function place(mark, rect) {
  const a = item().imageToViewerElementCoordinates(new OSD.Point(rect.x, rect.y));
  const b = item().imageToViewerElementCoordinates(new OSD.Point(rect.x + rect.w, rect.y + rect.h));
  return [a.x, a.y, b.x - a.x, b.y - a.y];
}

function updateMarks() {
  clip();
  byId("swipe-line").style.left = `${100 * state.split}%`;
  byId("swipe-line").setAttribute("aria-valuenow", Math.round(100 * state.split));
  if (!item()) return;
  byId("pin").hidden = !state.pin;
  if (state.pin) {
    const [x, y, w, h] = place(byId("pin"), { ...state.pin, w: 1, h: 1 });
    Object.assign(byId("pin").style, { left: `${x + w / 2}px`, top: `${y + h / 2}px`, width: `${w + 3}px`, height: `${h + 3}px` });
  }
  byId("frame").hidden = !state.crop;
  if (state.crop) {
    const [x, y, w, h] = place(byId("frame"), state.crop);
    Object.assign(byId("frame").style, { left: `${x}px`, top: `${y}px`, width: `${w}px`, height: `${h}px` });
  }
  const zoom = item().viewportToImageZoom(viewer.viewport.getZoom(true));
  byId("zoom").textContent = zoom >= 1 ? `${short(zoom, 2)} : 1` : `1 : ${short(1 / zoom, 2)}`;
  viewer.drawer.setImageSmoothingEnabled(zoom < 1.5);
  scale(zoom);
}

function scale(zoom) {
  byId("scale").hidden = !content.pitch_um;
  if (!content.pitch_um) return;
  const um = 130 * content.pitch_um / zoom;
  const power = 10 ** Math.floor(Math.log10(um));
  const length = [5, 2, 1].find((n) => n * power <= um) * power;
  byId("scale-bar").style.width = `${length / content.pitch_um * zoom}px`;
  byId("scale-text").textContent = length >= 1000 ? `${length / 1000} mm` : `${Number(length.toPrecision(3))} µm`;
}

// Input.

viewer.addHandler("viewport-change", updateMarks);
viewer.addHandler("resize", () => requestAnimationFrame(updateMarks));
viewer.addHandler("animation-finish", updateMarks);
viewer.addHandler("canvas-click", (event) => {
  if (!event.quick) return;
  const p = pixelAt(event.position);
  if (p) pin(p);
});
viewer.addHandler("canvas-key", (event) => {
  const { key, shiftKey } = event.originalEvent;
  const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
  if (step && shiftKey && state.pin) {
    event.preventDefaultAction = true;
    pin({ x: clamp(state.pin.x + step[0], 0, W - 1), y: clamp(state.pin.y + step[1], 0, H - 1) });
  } else if (!step && !["+", "=", "-", "_", "0"].includes(key)) {
    event.preventDefaultAction = true;
  }
});
byId("view").addEventListener("pointermove", (event) => {
  if (state.pin || event.buttons) return;
  const box = byId("view").getBoundingClientRect();
  const p = pixelAt(new OSD.Point(event.clientX - box.left, event.clientY - box.top));
  if (p) hover(p);
});

const keys = {
  c: () => setMode("colour"), b: () => setMode("band"), ",": () => setBand(state.band - 1), ".": () => setBand(state.band + 1),
  "[": () => setEv(state.ev - 0.3), "]": () => setEv(state.ev + 0.3), s: () => setSwipe(!state.swipe), x: () => setCropping(byId("crop-layer").hidden),
  1: () => viewer.viewport.zoomTo(item().imageToViewportZoom(1)), 0: () => viewer.viewport.goHome(),
  "+": () => viewer.viewport.zoomBy(1.5), "=": () => viewer.viewport.zoomBy(1.5), "-": () => viewer.viewport.zoomBy(1 / 1.5),
  "?": () => byId("help").showModal(),
  Escape: () => { setCropping(false); if (state.crop) setCrop(null); else pin(null); },
};
document.addEventListener("keydown", (event) => {
  const typing = event.target.matches("input:not([type=range],[type=radio],[type=checkbox]), select, textarea");
  const inViewer = viewer.canvas.contains(event.target);
  if (typing || event.ctrlKey || event.metaKey || event.altKey || byId("help").open) return;
  if (inViewer && ["+", "=", "-", "0"].includes(event.key)) return;
  if (inViewer && event.key === "Enter") {
    const p = pixelAt(new OSD.Point(byId("view").clientWidth / 2, byId("view").clientHeight / 2));
    if (p) pin(p);
    return;
  }
  keys[event.key]?.();
});

byId("mode-colour").addEventListener("change", () => setMode("colour"));
byId("mode-band").addEventListener("change", () => setMode("band"));
byId("band").addEventListener("input", () => setBand(Number(byId("band").value)));
byId("ev").addEventListener("input", () => setEv(Number(byId("ev").value)));
byId("gamma").addEventListener("input", () => { state.gamma = Number(byId("gamma").value); reloadSoon(); });
byId("white").addEventListener("change", () => { state.white = byId("white").value; reload(); });
byId("reset").addEventListener("click", () => { Object.assign(state, { ev: 0, gamma: 1, white: content.raw?.white ?? "D65" }); reload(); });
byId("swipe").addEventListener("click", () => setSwipe(!state.swipe));
byId("unpin").addEventListener("click", () => pin(null));
byId("psf-log").addEventListener("change", requestLens);
byId("help-open").addEventListener("click", () => byId("help").showModal());
byId("go").addEventListener("submit", (event) => {
  event.preventDefault();
  const [x, y] = [Number(byId("px").value), Number(byId("py").value)];
  if (!(Number.isInteger(x) && Number.isInteger(y) && x >= 0 && y >= 0 && x < W && y < H)) { note(`Pixel coordinates range from 0, 0 to ${W - 1}, ${H - 1}.`); return; }
  note(null);
  viewer.viewport.panTo(item().imageToViewportCoordinates(x + 0.5, y + 0.5));
  pin({ x, y });
});
byId("crop").addEventListener("click", () => setCropping(byId("crop-layer").hidden));
byId("crop-view").addEventListener("click", () => {
  const box = item().viewportToImageRectangle(viewer.viewport.getBounds());
  const [x, y] = [Math.max(0, box.x), Math.max(0, box.y)];
  setCrop({ x, y, w: Math.min(W, box.x + box.width) - x, h: Math.min(H, box.y + box.height) - y });
});
byId("crop-form").addEventListener("input", () => {
  const [x, y, w, h] = ["cx", "cy", "cw", "ch"].map((id) => Number(byId(id).value));
  if ([x, y, w, h].every(Number.isInteger) && w > 0 && h > 0) { state.crop = { x: clamp(x, 0, W - 1), y: clamp(y, 0, H - 1), w, h }; state.crop.w = Math.min(w, W - state.crop.x); state.crop.h = Math.min(h, H - state.crop.y); updateCrop(); updateMarks(); }
});
byId("crop-form").addEventListener("submit", (event) => event.preventDefault());

/** Calls `move` while a pressed pointer moves over `element`. */
function drag(element, move) {
  element.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    element.setPointerCapture(event.pointerId);
    const box = byId("view").getBoundingClientRect();
    const where = (e) => new OSD.Point(e.clientX - box.left, e.clientY - box.top);
    const start = where(event);
    const go = (e) => move(start, where(e), false);
    element.addEventListener("pointermove", go);
    element.addEventListener("pointerup", (e) => { element.removeEventListener("pointermove", go); move(start, where(e), true); }, { once: true });
  });
}
drag(byId("crop-layer"), (from, to, end) => {
  const [a, b] = [from, to].map((p) => item().viewerElementToImageCoordinates(p));
  const [x, y] = [Math.floor(Math.min(a.x, b.x)), Math.floor(Math.min(a.y, b.y))];
  setCrop({ x, y, w: Math.ceil(Math.max(a.x, b.x)) - x, h: Math.ceil(Math.max(a.y, b.y)) - y });
  if (end) setCropping(false);
});
function setSplit(split) {
  state.split = clamp(split, 0.02, 0.98);
  updateMarks();
  viewer.forceRedraw();
}
drag(byId("swipe-line"), (_, to) => setSplit(to.x / byId("view").clientWidth));
byId("swipe-line").addEventListener("keydown", (event) => {
  const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
  if (step) { event.preventDefault(); event.stopPropagation(); setSplit(state.split + step); }
});

// Start.

const name = content.name.replace(/^(?!gen:).*\/(?=[^/]+(\/\/[^/]+)?$)/, "");
document.title = `${name} · lenscube view`;
byId("name").textContent = name;
byId("name").title = content.name;
byId("facts").textContent = [
  `${W} × ${H} px`, content.pitch_um ? `${content.pitch_um} µm` : "", ...(content.raw ? facts(content.raw) : [`${content.bands.length} bands`, content.units ?? ""]),
  content.levels > 1 ? { complete: "pyramid", stale: "stale pyramid", unfinished: "unfinished pyramid", none: "no pyramid" }[content.pyramid] : "",
].filter(Boolean).join("  ·  ");
byId("band").max = content.bands.length - 1;
byId("band-inks").replaceChildren(...content.bands.map((b) => { const ink = document.createElement("i"); ink.style.background = b.ink; return ink; }));
byId("mode-colour").disabled = !content.colour;
if (content.raw) adapt(content.raw);
byId("swipe").hidden = !content.chart;
byId("legend").innerHTML = content.chart ? "<span><i></i>film</span><span><i class=\"c\"></i>chart</span>" : "";
lensNote(content.lens.error ?? content.lens.note ?? "move the pointer over a pixel to show its figures and PSF");
if (content.levels > 1 && content.pyramid !== "complete") note("No pyramid: zoomed-out views read all pixels and are slow. Create one with lenscube pyramid.");
const firstNote = byId("note").textContent;
reload().then(() => { if (firstNote) note(firstNote); });
