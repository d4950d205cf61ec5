// What differs on the page for a raw: frames instead of bands, its development, a pixel's numbers.

import { byId, list, short } from "./panel.js";

const seconds = (t) => t >= 1 ? `${short(t)} s` : `${short(t * 1e3)} ms`;

/** Name of a band of a film, or of a frame of a raw. */
export function bandName(content, band) {
  return content.raw ? `frame ${band}, ${seconds(content.raw.exposure_s[band])}` : `${content.bands[band].nm} nm`;
}

/** Parameters of an address for the display mode of a raw. */
export function rawQuery(state) {
  return `frame=${state.band}&${state.mode === "band" ? "mosaic=1" : `white=${state.white}`}`;
}

/** Adapts names and controls to a raw. */
export function adapt(raw) {
  const frames = raw.exposure_s.length;
  const texts = {
    "mode-colour": "Developed", "mode-band": "Mosaic",
    "help-all": "complete raw; one sensor pixel per screen pixel", "help-modes": "developed; mosaic", "help-bands": "previous frame, next frame",
  };
  for (const [id, text] of Object.entries(texts)) {
    const element = byId(id)?.tagName === "INPUT" ? byId(id).nextElementSibling : byId(id);
    if (element) element.textContent = text;
  }
  byId("view").setAttribute("aria-label", byId("view").getAttribute("aria-label").replace("Film", "Raw"));
  byId("band").setAttribute("aria-label", "Frame");
  byId("band").hidden = frames === 1;
  byId("crop").textContent = "Draw on raw";
  for (const option of byId("white").options) option.disabled = !raw.lights.includes(option.value);
  for (const id of ["band-inks", "spectrum-figure", "lens-section"]) byId(id).hidden = true;
  byId("help-swipe").previousElementSibling.hidden = byId("help-swipe").hidden = true;
}

/** What the header says of a raw. */
export const facts = (raw) => [raw.sensor, `${raw.exposure_s.length} frames`, `gain ${short(raw.gain)}`, `black ${short(raw.black_dn)} DN, white ${short(raw.white_dn)} DN`];

/** Numbers of a pixel of a frame. */
export function rawPixel(reading, frame) {
  const raw = reading.raw, values = raw.frames[frame];
  const pairs = [
    ["Image height", `${reading.height_mm.toFixed(4)} mm`], ["Azimuth", `${reading.azimuth_deg.toFixed(2)}°`],
    ["Sensor row, column", `${raw.row}, ${raw.column}`],
    ["Filter", raw.filter === raw.plane ? raw.filter : `${raw.filter}, plane ${raw.plane}`],
    ["Raw", `${values.dn} DN${values.clipped ? ", clipped" : ""}`],
    ["Charge with noise", `${values.electrons.toFixed(1)} e⁻`],
  ];
  if (values.signal_e !== null) pairs.push(["Mean charge of light", `${values.signal_e.toFixed(1)} e⁻`], ["Signal", `${short(raw.signal_e_per_s, 5)} e⁻/s`]);
  if (reading.developed) pairs.push(["Developed, sRGB", reading.developed.join(", ")]);
  list(byId("place"), pairs);
}
