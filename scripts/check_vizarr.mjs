// Opens a pyramid with @vivjs/loaders (vizarr, Avivator) and ome-zarr.js; run by check-vizarr. Every level must have the values that zarrita
// reads from its array.
import { execFileSync } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { loadOmeZarrFromStore } from "@vivjs/loaders";
import { FileSystemStore } from "@zarrita/storage";
import * as omezarr from "ome-zarr.js";
import * as zarr from "zarrita";

const program = process.argv[2];
const place = mkdtempSync(join(tmpdir(), "check-vizarr-"));
let checks = 0;
function check(condition, message) {
  checks += 1;
  if (!condition) throw new Error(message);
}

try {
  const film = join(place, "film.zarr");
  const args = ["run", "gen:composite?size=1031x777&wavelengths=450,550,610&pitch_um=2", film, "--lens", "double-gauss-28-npz", "--stages", "ri", "--no-fsync", "--pyramid"];
  execFileSync(program, args, { stdio: ["ignore", "ignore", "pipe"] });
  const store = new FileSystemStore(film);
  const root = await zarr.open(zarr.root(store), { kind: "group" });
  const { datasets, axes } = root.attrs.ome.multiscales[0];
  check(datasets.length === 4 && axes.map((a) => a.name).join() === "wavelength,y,x", `levels ${datasets.map((d) => d.path)}`);

  const { data, metadata } = await loadOmeZarrFromStore(store);
  check(data.length === datasets.length && metadata.omero.channels.length === 3, `viv reads ${data.length} levels`);
  for (const [level, source] of data.entries()) {
    const array = await zarr.open(root.resolve(datasets[level].path), { kind: "array" });
    const { data: expected, shape } = await zarr.get(array, [1, null, null]);
    check(source.shape.join() === array.shape.join() && source.labels.join() === "wavelength,y,x", `viv: level ${level} is ${source.shape} of ${source.labels}`);
    const raster = await source.getRaster({ selection: { wavelength: 1 } });
    check(raster.width === shape[1] && raster.height === shape[0] && raster.data.every((v, i) => v === expected[i]), `viv: values of level ${level}`);
  }

  const { arr, shapes } = await omezarr.getMultiscaleWithArray(store, 0);
  check(arr.shape[1] === 777 && arr.shape[2] === 1031, `ome-zarr.js reads ${arr.shape} of ${shapes}`);
  console.log(`${checks} checks: viv's loader and ome-zarr.js opened a pyramid`);
} catch (error) {
  console.error(`check-vizarr: ${error.stack}`);
  process.exitCode = 1;
} finally {
  rmSync(place, { recursive: true, force: true });
}
