// The page: a film in deep zoom, what is shown of it, and what is read off it.

import { at, lens as showLens, pixel as showPixel, short } from "./panel.js";

const OSD = window.OpenSeadragon;
// Tiles of a look that has changed meanwhile are dropped on purpose.
OSD.console = Object.assign(Object.create(console), {
  warn: (...words) => { if (!String(words[0]).startsWith("Ignoring tile")) console.warn(...words); },
});
const site = await (await fetch("api/site")).json();
const [H, W] = site.size;
const state = {
  mode: site.colour ? "colour" : "band", band: nearest(550), ev: 0, gamma: 1, white: "D65",
  swipe: false, split: 0.5, pin: null, crop: null, auto: { film: 1, chart: 1 }, reading: null,
};
const layers = { film: null, chart: null }, old = { film: [], chart: [] }, wanted = { film: 0, chart: 0 };
let generation = 0, asked = 0;

function nearest(nm) {
  const away = site.bands.map((b) => Math.abs(b.nm - nm));
  return away.indexOf(Math.min(...away));
}
const now = () => state.mode === "band" ? state.band : null;
const what = () => state.mode === "band" ? `band=${state.band}` : `white=${state.white}`;
const exposure = (stack) => state.auto[stack] * 2 ** state.ev;
const look = (stack) => `${what()}&exposure=${exposure(stack)}&gamma=${state.gamma}`;
const clamp = (v, least, most) => Math.min(most, Math.max(least, v));

const viewer = OSD({
  element: at("view"), drawer: "canvas", showNavigationControl: false, showNavigator: false, prefixUrl: "",
  gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: true }, gestureSettingsTouch: { clickToZoom: false, dblClickToZoom: true },
  animationTime: 0.35, springStiffness: 9, blendTime: 0, maxZoomPixelRatio: 24, minZoomImageRatio: 0.7, visibilityRatio: 0.4,
  imageLoaderLimit: 4, immediateRender: true, timeout: 900000, maxImageCacheCount: 600, preserveImageSizeOnResize: false,
});

function source(stack) {
  const [height, width] = stack === "film" ? site.size : site.chart.size;
  const top = (stack === "film" ? site.levels : site.chart.levels) - 1;
  const asked = look(stack);
  return {
    height, width, tileSize: site.tile, minLevel: 0, maxLevel: top,
    getTileUrl: (level, x, y) => `tile/${stack}/${top - level}/${y}_${x}.png?${asked}`,
  };
}

/** Lays a stack anew; what was there stays until the new one is loaded. */
function lay(stack) {
  const mine = ++generation;
  wanted[stack] = mine;
  const [x, y, width] = stack === "film" ? [0, 0, W] : site.chart.place;
  viewer.addTiledImage({
    tileSource: source(stack), x: x / W, y: y / W, width: width / W,
    // The chart lies on top, the newest film on top of older ones.
    index: stack === "film" ? old.film.length + (layers.film ? 1 : 0) : undefined,
    success: ({ item }) => {
      if (wanted[stack] !== mine) { viewer.world.removeItem(item); return; }
      if (layers[stack]) old[stack].push(layers[stack]);
      else if (stack === "film") requestAnimationFrame(() => { viewer.viewport.goHome(true); marks(); });
      layers[stack] = item;
      const settle = () => {
        if (layers[stack] === item && item.getFullyLoaded()) clear(stack);
        tellBusy();
      };
      item.addHandler("fully-loaded-change", settle);
      clip();
      settle();
    },
  });
}

function clear(stack) {
  old[stack].splice(0).forEach((item) => viewer.world.removeItem(item));
}

function unlay(stack) {
  wanted[stack] = 0;
  clear(stack);
  if (layers[stack]) viewer.world.removeItem(layers[stack]);
  layers[stack] = null;
  tellBusy();
}

function tellBusy() {
  const items = Object.values(layers).filter(Boolean);
  const ready = items.length > 0 && items.every((i) => i.getFullyLoaded());
  at("busy").textContent = ready ? "" : "reading …";
  document.body.dataset.ready = ready;
  document.body.dataset.look = look("film");
}

/** Asks for the exposure that suits what is shown, then shows it. */
async function relook(anew = true) {
  tellLook();
  document.body.dataset.ready = false;
  const mine = ++asked;
  if (anew) {
    const answer = await fetch(`api/exposure?${what()}${state.swipe ? "&chart=1" : ""}`);
    if (!answer.ok) { note(await answer.text()); return; }
    const found = await answer.json();
    if (mine !== asked) return;
    state.auto = { film: found.film, chart: found.chart ?? found.film };
  }
  note(null);
  tellLook();
  lay("film");
  if (state.swipe) lay("chart");
  else unlay("chart");
  if (state.reading) showPixel(site, state.reading, now());
}

let waiting = 0;
function soon() {
  clearTimeout(waiting);
  tellLook();
  waiting = setTimeout(() => relook(false), 60);
}

function tellLook() {
  at("mode-colour").checked = state.mode === "colour";
  at("mode-band").checked = state.mode === "band";
  at("band").value = state.band;
  at("band-text").textContent = state.mode === "band" ? `${site.bands[state.band].nm} nm` : "";
  at("band").setAttribute("aria-valuetext", `${site.bands[state.band].nm} nm`);
  [...at("band-inks").children].forEach((ink, b) => ink.classList.toggle("on", b === now()));
  at("ev").value = state.ev;
  at("ev-text").textContent = `×${short(exposure("film"), 3)}  ${state.ev >= 0 ? "+" : "−"}${Math.abs(state.ev).toFixed(1)} EV`;
  at("gamma").value = state.gamma;
  at("gamma-text").textContent = state.gamma.toFixed(2);
  at("white").value = state.white;
  at("white").disabled = state.mode === "band";
  at("swipe").setAttribute("aria-pressed", state.swipe);
  at("swipe-line").hidden = !state.swipe;
  tellCrop();
}

function note(text) {
  at("note").hidden = !text;
  at("note").textContent = text ?? "";
}

// What is shown.

function setMode(mode) {
  if (mode === "colour" && !site.colour) return;
  state.mode = mode;
  relook();
}
function setBand(band) {
  state.band = clamp(band, 0, site.bands.length - 1);
  state.mode = "band";
  relook();
  askLens();
}
function setEv(ev) {
  state.ev = clamp(Math.round(ev * 10) / 10, -8, 8);
  soon();
}
function setSwipe(on) {
  if (!site.chart) return;
  state.swipe = on;
  relook();
  marks();
}

// Pixels.

const item = () => layers.film;
function pixelAt(point) {
  const p = item()?.viewerElementToImageCoordinates(point);
  if (!p) return null;
  const [x, y] = [Math.floor(p.x), Math.floor(p.y)];
  return x >= 0 && y >= 0 && x < W && y < H ? { x, y } : null;
}

/** Runs the latest of many wishes, one at a time. */
function latest(run) {
  let wish = null, busy = false;
  return async (next) => {
    wish = next;
    if (busy) return;
    busy = true;
    while (wish !== null) {
      const mine = wish;
      wish = null;
      try { await run(mine); } catch (fault) { note(`No answer from lenscube: ${fault.message}`); }
    }
    busy = false;
  };
}

const read = latest(async ({ x, y }) => {
  const answer = await fetch(`api/pixel?x=${x}&y=${y}`);
  if (!answer.ok) { note(await answer.text()); return; }
  state.reading = await answer.json();
  if (document.activeElement !== at("px") && document.activeElement !== at("py")) [at("px").value, at("py").value] = [x, y];
  showPixel(site, state.reading, now());
  document.body.dataset.pixel = `${x},${y}`;
});

const readLens = latest(async ({ x, y }) => {
  const band = state.band;
  const answer = await fetch(`api/lens?x=${x}&y=${y}&band=${band}`);
  if (!answer.ok) { lensNote(await answer.text()); at("lens").hidden = true; return; }
  lensNote(site.lens.note);
  at("lens").hidden = false;
  const log = at("psf-log").checked ? "&log=1" : "";
  showLens(await answer.json(), { azimuth_deg: azimuth(x, y) }, band, `psf.png?x=${x}&y=${y}&band=${band}${log}`);
  document.body.dataset.lens = `${x},${y},${band}`;
});

const azimuth = (x, y) => Math.atan2(y - site.axis[0], x - site.axis[1]) * 180 / Math.PI;
let resting = 0, pointed = null;
function askLens() {
  const p = state.pin ?? pointed;
  if (p && !site.lens.error) readLens(p);
}
function point(p) {
  pointed = p;
  read(p);
  clearTimeout(resting);
  resting = setTimeout(askLens, 120);
}
function pin(p) {
  state.pin = p;
  at("unpin").hidden = !p;
  marks();
  if (p) point(p);
}
function lensNote(text) {
  at("lens-name").textContent = site.lens.name ?? "No lens data";
  if (!text) return;
  const small = document.createElement("small");
  small.textContent = text;
  at("lens-name").append(small);
}

// Crops.

function setCrop(rect) {
  if (rect) {
    const [x, y] = [clamp(Math.round(rect.x), 0, W - 1), clamp(Math.round(rect.y), 0, H - 1)];
    rect = { x, y, w: clamp(Math.round(rect.w), 1, W - x), h: clamp(Math.round(rect.h), 1, H - y) };
  }
  state.crop = rect;
  for (const key of "xywh") at(`c${key}`).value = rect ? rect[key] : "";
  tellCrop();
  marks();
}
function tellCrop() {
  const save = at("save"), c = state.crop;
  const large = c && (c.w * c.h > 2 ** 24 || Math.max(c.w, c.h) > 2 ** 14);
  save.setAttribute("aria-disabled", !c || large);
  at("crop-note").textContent = !c ? "" : large ? "too large for a crop: lenscube export" : `${c.w} × ${c.h} px`;
  if (!c || large) { save.removeAttribute("href"); return; }
  save.href = `crop.png?x=${c.x}&y=${c.y}&w=${c.w}&h=${c.h}&${look("film")}`;
  save.download = `${name.replace(/[^\w.-]+/g, "-")}-${c.x}-${c.y}-${c.w}x${c.h}.png`;
}
function setCropping(on) {
  at("crop-layer").hidden = !on;
  at("crop").setAttribute("aria-pressed", on);
}

// What lies over the picture.

function clip() {
  for (const chart of [layers.chart, ...old.chart].filter(Boolean)) {
    const [h, w] = site.chart.size;
    const x = clamp(chart.viewerElementToImageCoordinates(new OSD.Point(state.split * at("view").clientWidth, 0)).x, 0, w);
    chart.setClip(new OSD.Rect(x, 0, Math.max(w - x, 1e-3), h));
  }
}

function place(mark, rect) {
  const a = item().imageToViewerElementCoordinates(new OSD.Point(rect.x, rect.y));
  const b = item().imageToViewerElementCoordinates(new OSD.Point(rect.x + rect.w, rect.y + rect.h));
  return [a.x, a.y, b.x - a.x, b.y - a.y];
}

function marks() {
  clip();
  at("swipe-line").style.left = `${100 * state.split}%`;
  at("swipe-line").setAttribute("aria-valuenow", Math.round(100 * state.split));
  if (!item()) return;
  at("pin").hidden = !state.pin;
  if (state.pin) {
    const [x, y, w, h] = place(at("pin"), { ...state.pin, w: 1, h: 1 });
    Object.assign(at("pin").style, { left: `${x + w / 2}px`, top: `${y + h / 2}px`, width: `${w + 3}px`, height: `${h + 3}px` });
  }
  at("frame").hidden = !state.crop;
  if (state.crop) {
    const [x, y, w, h] = place(at("frame"), state.crop);
    Object.assign(at("frame").style, { left: `${x}px`, top: `${y}px`, width: `${w}px`, height: `${h}px` });
  }
  const zoom = item().viewportToImageZoom(viewer.viewport.getZoom(true));
  at("zoom").textContent = zoom >= 1 ? `${short(zoom, 2)} : 1` : `1 : ${short(1 / zoom, 2)}`;
  viewer.drawer.setImageSmoothingEnabled(zoom < 1.5);
  scale(zoom);
}

function scale(zoom) {
  at("scale").hidden = !site.pitch_um;
  if (!site.pitch_um) return;
  const um = 130 * site.pitch_um / zoom;
  const power = 10 ** Math.floor(Math.log10(um));
  const length = [5, 2, 1].find((n) => n * power <= um) * power;
  at("scale-bar").style.width = `${length / site.pitch_um * zoom}px`;
  at("scale-text").textContent = length >= 1000 ? `${length / 1000} mm` : `${Number(length.toPrecision(3))} µm`;
}

// Hands.

viewer.addHandler("viewport-change", marks);
viewer.addHandler("resize", () => requestAnimationFrame(marks));
viewer.addHandler("animation-finish", marks);
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
at("view").addEventListener("pointermove", (event) => {
  if (state.pin || event.buttons) return;
  const box = at("view").getBoundingClientRect();
  const p = pixelAt(new OSD.Point(event.clientX - box.left, event.clientY - box.top));
  if (p) point(p);
});

const keys = {
  c: () => setMode("colour"), b: () => setMode("band"), ",": () => setBand(state.band - 1), ".": () => setBand(state.band + 1),
  "[": () => setEv(state.ev - 0.3), "]": () => setEv(state.ev + 0.3), s: () => setSwipe(!state.swipe), x: () => setCropping(at("crop-layer").hidden),
  1: () => viewer.viewport.zoomTo(item().imageToViewportZoom(1)), 0: () => viewer.viewport.goHome(),
  "+": () => viewer.viewport.zoomBy(1.5), "=": () => viewer.viewport.zoomBy(1.5), "-": () => viewer.viewport.zoomBy(1 / 1.5),
  "?": () => at("help").showModal(),
  Escape: () => { setCropping(false); if (state.crop) setCrop(null); else pin(null); },
};
document.addEventListener("keydown", (event) => {
  const typing = event.target.matches("input:not([type=range],[type=radio],[type=checkbox]), select, textarea");
  const own = viewer.canvas.contains(event.target);
  if (typing || event.ctrlKey || event.metaKey || event.altKey || at("help").open) return;
  if (own && ["+", "=", "-", "0"].includes(event.key)) return;
  if (own && event.key === "Enter") {
    const p = pixelAt(new OSD.Point(at("view").clientWidth / 2, at("view").clientHeight / 2));
    if (p) pin(p);
    return;
  }
  keys[event.key]?.();
});

at("mode-colour").addEventListener("change", () => setMode("colour"));
at("mode-band").addEventListener("change", () => setMode("band"));
at("band").addEventListener("input", () => setBand(Number(at("band").value)));
at("ev").addEventListener("input", () => setEv(Number(at("ev").value)));
at("gamma").addEventListener("input", () => { state.gamma = Number(at("gamma").value); soon(); });
at("white").addEventListener("change", () => { state.white = at("white").value; relook(); });
at("reset").addEventListener("click", () => { Object.assign(state, { ev: 0, gamma: 1, white: "D65" }); relook(); });
at("swipe").addEventListener("click", () => setSwipe(!state.swipe));
at("unpin").addEventListener("click", () => pin(null));
at("psf-log").addEventListener("change", askLens);
at("help-open").addEventListener("click", () => at("help").showModal());
at("go").addEventListener("submit", (event) => {
  event.preventDefault();
  const [x, y] = [Number(at("px").value), Number(at("py").value)];
  if (!(Number.isInteger(x) && Number.isInteger(y) && x >= 0 && y >= 0 && x < W && y < H)) { note(`Pixels go from 0, 0 to ${W - 1}, ${H - 1}.`); return; }
  note(null);
  viewer.viewport.panTo(item().imageToViewportCoordinates(x + 0.5, y + 0.5));
  pin({ x, y });
});
at("crop").addEventListener("click", () => setCropping(at("crop-layer").hidden));
at("crop-view").addEventListener("click", () => {
  const box = item().viewportToImageRectangle(viewer.viewport.getBounds());
  const [x, y] = [Math.max(0, box.x), Math.max(0, box.y)];
  setCrop({ x, y, w: Math.min(W, box.x + box.width) - x, h: Math.min(H, box.y + box.height) - y });
});
at("crop-form").addEventListener("input", () => {
  const [x, y, w, h] = ["cx", "cy", "cw", "ch"].map((id) => Number(at(id).value));
  if ([x, y, w, h].every(Number.isInteger) && w > 0 && h > 0) { state.crop = { x: clamp(x, 0, W - 1), y: clamp(y, 0, H - 1), w, h }; state.crop.w = Math.min(w, W - state.crop.x); state.crop.h = Math.min(h, H - state.crop.y); tellCrop(); marks(); }
});
at("crop-form").addEventListener("submit", (event) => event.preventDefault());

/** Follows a pointer that is held down on `element`. */
function drag(element, move) {
  element.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    element.setPointerCapture(event.pointerId);
    const box = at("view").getBoundingClientRect();
    const where = (e) => new OSD.Point(e.clientX - box.left, e.clientY - box.top);
    const start = where(event);
    const go = (e) => move(start, where(e), false);
    element.addEventListener("pointermove", go);
    element.addEventListener("pointerup", (e) => { element.removeEventListener("pointermove", go); move(start, where(e), true); }, { once: true });
  });
}
drag(at("crop-layer"), (from, to, end) => {
  const [a, b] = [from, to].map((p) => item().viewerElementToImageCoordinates(p));
  const [x, y] = [Math.floor(Math.min(a.x, b.x)), Math.floor(Math.min(a.y, b.y))];
  setCrop({ x, y, w: Math.ceil(Math.max(a.x, b.x)) - x, h: Math.ceil(Math.max(a.y, b.y)) - y });
  if (end) setCropping(false);
});
function setSplit(split) {
  state.split = clamp(split, 0.02, 0.98);
  marks();
  viewer.forceRedraw();
}
drag(at("swipe-line"), (_, to) => setSplit(to.x / at("view").clientWidth));
at("swipe-line").addEventListener("keydown", (event) => {
  const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
  if (step) { event.preventDefault(); event.stopPropagation(); setSplit(state.split + step); }
});

// Beginning.

const name = site.name.replace(/^(?!gen:).*\/(?=[^/]+(\/\/[^/]+)?$)/, "");
document.title = `${name} · lenscube view`;
at("name").textContent = name;
at("name").title = site.name;
at("facts").textContent = [
  `${W} × ${H} px`, site.pitch_um ? `${site.pitch_um} µm` : "", `${site.bands.length} bands`, site.units ?? "",
  site.levels > 1 ? { complete: "pyramid", stale: "stale pyramid", unfinished: "unfinished pyramid", none: "no pyramid" }[site.pyramid] : "",
].filter(Boolean).join("  ·  ");
at("band").max = site.bands.length - 1;
at("band-inks").replaceChildren(...site.bands.map((b) => { const ink = document.createElement("i"); ink.style.background = b.ink; return ink; }));
at("mode-colour").disabled = !site.colour;
at("swipe").hidden = !site.chart;
at("legend").innerHTML = site.chart ? "<span><i></i>film</span><span><i class=\"c\"></i>chart</span>" : "";
lensNote(site.lens.error ?? site.lens.note ?? "point at a pixel for its figures and PSF");
if (site.levels > 1 && site.pyramid !== "complete") note("No pyramid: far views read the whole film and take a while. lenscube pyramid makes one.");
const firstNote = at("note").textContent;
relook().then(() => { if (firstNote) note(firstNote); });
