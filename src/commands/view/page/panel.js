// Data of a pixel: field point, spectrum, lens figures.

const SVG = "http://www.w3.org/2000/svg";
export const byId = (id) => document.getElementById(id);

/** Number with a few significant digits. */
export function short(v, digits = 4) {
  if (v === null || v === undefined || !Number.isFinite(v)) return "missing";
  const size = Math.abs(v);
  if (size !== 0 && (size < 1e-3 || size >= 1e5)) return v.toExponential(digits - 1).replace("e", "·10^").replace("^+", "^");
  return String(Number(v.toPrecision(digits)));
}

/** Fills a description list with names and values. */
export function list(dl, pairs) {
  dl.replaceChildren(...pairs.flatMap(([name, value]) => {
    const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
    dt.textContent = name;
    dd.textContent = value;
    return [dt, dd];
  }));
}

function draw(svg, name, attributes, text) {
  const mark = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) mark.setAttribute(key, value);
  if (text !== undefined) mark.textContent = text;
  svg.append(mark);
}

/** Spectra of film and chart, with gaps at missing samples. */
export function spectrum(bands, film, chart, band) {
  const svg = byId("spectrum");
  svg.replaceChildren();
  const box = { left: 4, right: 316, top: 16, bottom: 114 };
  const values = [...film, ...(chart ?? [])].filter((v) => v !== null);
  const max = Math.max(...values, 0), min = Math.min(...values, 0);
  const span = max - min || 1;
  const nm = bands.map((b) => b.nm);
  const [first, last] = [Math.min(...nm), Math.max(...nm)];
  const x = (v) => last > first ? box.left + 6 + (v - first) / (last - first) * (box.right - box.left - 12) : 160;
  const y = (v) => box.bottom - (v - min) / span * (box.bottom - box.top);
  draw(svg, "line", { class: "axis", x1: box.left, x2: box.right, y1: y(0), y2: y(0) });
  draw(svg, "line", { class: "axis", x1: box.left, x2: box.right, y1: box.top, y2: box.top });
  draw(svg, "text", { x: box.left, y: box.top - 4 }, values.length ? short(max) : "no samples");
  draw(svg, "text", { x: x(first), y: box.bottom + 15 }, `${short(first)} nm`);
  if (last > first) draw(svg, "text", { x: x(last), y: box.bottom + 15, "text-anchor": "end" }, `${short(last)} nm`);
  if (band !== null) draw(svg, "line", { class: "now", x1: x(nm[band]), x2: x(nm[band]), y1: box.top, y2: box.bottom });
  const order = nm.map((_, b) => b).sort((a, b) => nm[a] - nm[b]);
  for (const [values, kind] of [[chart, "chart"], [film, "film"]]) {
    if (!values) continue;
    let path = "", open = false;
    for (const b of order) {
      if (values[b] === null) { open = false; continue; }
      path += `${open ? "L" : "M"}${x(nm[b]).toFixed(1)} ${y(values[b]).toFixed(1)}`;
      open = true;
    }
    draw(svg, "path", { class: kind, d: path });
  }
  for (const b of order) {
    if (film[b] !== null) draw(svg, "circle", { cx: x(nm[b]), cy: y(film[b]), r: bands.length > 12 ? 2.2 : 3.4, fill: bands[b].ink });
  }
  svg.setAttribute("aria-label", `Spectrum of the pixel: ${order.map((b) => `${nm[b]} nm ${short(film[b])}`).join(", ")}`);
}

/** Field point and values of a pixel. */
export function pixel(content, reading, band) {
  const pairs = [];
  if (reading.height_mm !== null) {
    pairs.push(["Image height", `${reading.height_mm.toFixed(4)} mm`], ["Azimuth", `${reading.azimuth_deg.toFixed(2)}°`]);
  }
  if (band !== null) {
    pairs.push([`Film, ${content.bands[band].nm} nm`, short(reading.film[band], 6)]);
    if (reading.chart) pairs.push([`Chart, ${content.bands[band].nm} nm`, short(reading.chart[band], 6)]);
  }
  list(byId("place"), pairs);
  spectrum(content.bands, reading.film, reading.chart, band);
}

/** Figures and PSF of the lens at a pixel. */
export function lens(answer, reading, band, src) {
  const f = answer.figures;
  const um = (v) => v === null ? "unknown" : `${short(v, 3)} µm`;
  list(byId("figures"), [
    ["λ", `${f.wavelength_nm} nm`],
    ["Relative illumination (RI)", f.relative_illumination.toFixed(4)],
    ["Real image height", `${f.image_height_mm.toFixed(3)} mm`],
    ["Ideal image height", `${f.ideal_height_mm.toFixed(3)} mm`],
    ["Distortion", `${f.distortion_percent.toFixed(3)} %`],
    ["Lateral colour", um(f.lateral_colour_um)],
    ["RMS spot radius", um(f.rms_um)],
    ["Strehl", f.strehl === null ? "unknown" : short(f.strehl, 3)],
    ["Light in PSF window", `${(100 * f.energy_in_window).toFixed(1)} %`],
  ]);
  const image = byId("psf");
  image.src = src;
  // Azimuth increases from +x downwards, as CSS rotation does.
  image.style.transform = `rotate(${reading.azimuth_deg}deg)`;
  image.alt = `PSF at ${f.image_height_mm.toFixed(3)} mm, ${f.wavelength_nm} nm`;
  byId("psf-text").textContent = `PSF, ${f.psf_window_um.toFixed(0)} µm wide`;
}
