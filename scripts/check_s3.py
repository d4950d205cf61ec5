"""Charts, lenses, films and scenes on an S3-compatible store; run by check-s3: check_s3.py LENSCUBE [STEP ...], all steps without names.

Checked: a job gives the same bytes on the store as in files, also with failing requests and after kills; other programs open the
film; errors are reported once with the documented exit code, and never contain credentials.
"""
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import boto3
import numpy as np
import xarray
import zarr
from obstore.store import S3Store
from s3_proxy import Proxy

LENSCUBE = Path(sys.argv[1]).resolve()
PACK = Path(__file__).resolve().parent.parent / "formats/data/double-gauss-28.lens.zip"
SECRET = "hush-hush-hush"
BUCKET = "lenscube"
SHARDS = 24
checks = 0
count_lock = threading.Lock()


def check(condition, message):
    global checks
    with count_lock:
        checks += 1
    if not condition:
        sys.exit(f"check-s3: {message}")


def environment(port, scheme="http", **changes):
    env = {k: v for k, v in os.environ.items() if not k.startswith("AWS_")}
    env |= {"AWS_ACCESS_KEY_ID": "AKIAHUSHHUSH", "AWS_SECRET_ACCESS_KEY": SECRET, "AWS_REGION": "us-east-1",
            "AWS_ENDPOINT_URL": f"{scheme}://127.0.0.1:{port}", "AWS_ALLOW_HTTP": "true"}
    return {k: v for k, v in (env | changes).items() if v is not None}


def start(env, *arguments):
    return subprocess.Popen([LENSCUBE, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env)


def lenscube(env, code, expected, *arguments, seconds=300):
    """Runs the program; it must end with `code` and print all texts of `expected`, and no credentials."""
    p = start(env, *arguments)
    out, err = p.communicate(timeout=seconds)
    at = f"lenscube {' '.join(map(str, arguments))}"
    check(p.returncode == code, f"{at}: ended with {p.returncode}, expected {code}: {out}{err}")
    for text in expected:
        check(text in out + err, f"{at}: does not print `{text}`: {out}{err}")
    for text in (SECRET, "secret-string", "AWS4-HMAC", "AKIAHUSH"):
        check(text not in out + err, f"{at}: prints credentials: {out}{err}")
    check("panicked" not in err, f"{at}: {err}")
    return out


class Store:
    """Direct access to the store."""

    def __init__(self, port):
        self.port = port
        self.s3 = boto3.client("s3", endpoint_url=f"http://127.0.0.1:{port}", aws_access_key_id="a",
                               aws_secret_access_key="b", region_name="us-east-1")
        self.s3.create_bucket(Bucket=BUCKET)

    def objects(self, prefix):
        pages = self.s3.get_paginator("list_objects_v2").paginate(Bucket=BUCKET, Prefix=prefix + "/")
        keys = [o["Key"] for page in pages for o in page.get("Contents", [])]
        return {k[len(prefix) + 1:]: self.get(k) for k in keys}

    def get(self, key):
        return self.s3.get_object(Bucket=BUCKET, Key=key)["Body"].read()

    def put(self, key, data):
        self.s3.put_object(Bucket=BUCKET, Key=key, Body=data)

    def publish(self, prefix):
        """Makes objects publicly readable, as on a web server."""
        for key in self.objects(prefix):
            self.s3.put_object_acl(Bucket=BUCKET, Key=f"{prefix}/{key}", ACL="public-read")


def files(root):
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def job_of(metadata):
    """The group's metadata without the identity and place of the copy of the chart."""
    of_copy = ("chart_mtimes", "chart_sample", "job_digest", "source", "attributes_digest")
    return json.loads(metadata, object_hook=lambda fields: {k: v for k, v in fields.items() if k not in of_copy})


def same_film(found, expected, what):
    found = {k: v for k, v in found.items() if not k.startswith("runs/")}
    expected = {k: v for k, v in expected.items() if not k.startswith("runs/")}
    check(found.keys() == expected.keys(), f"{what}: keys {sorted(found.keys() ^ expected.keys())[:5]} differ")
    for key, data in expected.items():
        same = job_of(data) == job_of(found[key]) if key == "zarr.json" else data == found[key]
        check(same, f"{what}: {key} differs")


FLAGS = ["--threads", 2, "--shard", 128, "--chunk", 64, "--psf-window", 9, "--azimuths", 8, "--memory", "1GiB"]
CHART, LENS = f"s3://{BUCKET}/charts/a.zarr", f"s3://{BUCKET}/lenses/double-gauss.lens.zarr"


def run(film, chart=CHART, lens=LENS):
    return ["run", chart, film, "--lens", lens, *FLAGS]


def s3(name):
    return f"s3://{BUCKET}/films/{name}"


def stores(store, env, here):
    """Charts, lenses and films on the store equal those in files byte for byte."""
    draw = ["--size", "500x360", "--wavelengths", "500:550:50"]
    lenscube(env, 0, [], "chart", "composite", here / "a.zarr", *draw)
    lenscube(env, 0, [], "chart", "composite", CHART, *draw)
    check(store.objects("charts/a.zarr") == files(here / "a.zarr"), "a chart on the store has other bytes than in files")
    lenscube(env, 3, ["--overwrite"], "chart", "composite", CHART, *draw)
    lenscube(env, 0, [], "chart", "composite", CHART, *draw, "--overwrite")
    with zipfile.ZipFile(PACK) as pack:
        for name in pack.namelist():
            store.put(f"lenses/double-gauss.lens.zarr/{name}", pack.read(name))
    store.put("lenses/double-gauss.lens.zip", PACK.read_bytes())
    shown = [lenscube(env, 0, [], "lens", "show", at, "--json") for at in (LENS, LENS[:-4] + "zip", PACK)]
    lenscube(env, 0, [], "lens", "diff", LENS, PACK)
    shown = [{k: v for k, v in json.loads(s).items() if k != "path"} for s in shown]
    check(shown[0] == shown[2] and shown[1] == shown[2] and shown[2]["bands"] == 31, "a lens on the store shows other tables")

    lenscube(env, 0, [], *run(here / "film.zarr", here / "a.zarr", "double-gauss-28-npz"))
    reference = files(here / "film.zarr")
    check(sum("film/c/" in k for k in reference) == SHARDS, "the job has a wrong number of shards")
    lenscube(env, 0, [], *run(s3("film.zarr")))
    same_film(store.objects("films/film.zarr"), reference, "the film on the store")
    lenscube(env, 0, ["is complete", "nothing to do"], *run(s3("film.zarr"), lens=LENS[:-4] + "zip"))
    store.publish("charts"), store.publish("lenses")
    web = f"http://127.0.0.1:{store.port}/{BUCKET}/charts/a.zarr"
    lenscube(env, 0, ["is complete"], *run(s3("film.zarr"), web))
    lenscube(env, 1, ["requires a login"], *run(s3("film.zarr"), f"http://127.0.0.1:{store.port}/{BUCKET}/films/film.zarr"))
    # From a web server into files, with the path of the array.
    lenscube(env, 0, [], *run(here / "web.zarr", web + "//chart", f"http://127.0.0.1:{store.port}/{BUCKET}/lenses/double-gauss.lens.zarr"))
    same_film(files(here / "web.zarr"), reference, "the film of a chart on a web server")
    lenscube(env, 1, ["read-only"], *run(f"http://127.0.0.1:{store.port}/{BUCKET}/films/web.zarr"))
    lenscube(env, 0, [], "export", s3("film.zarr"), here / "there.png", "--band", 550)
    lenscube(env, 0, [], "export", here / "film.zarr", here / "here.png", "--band", 550)
    check((here / "there.png").read_bytes() == (here / "here.png").read_bytes(), "pictures of the two films differ")
    return reference


def status_and_verify(store, env, reference):
    """status, verify and --repair."""
    film = s3("film.zarr")
    status = json.loads(lenscube(env, 0, [], "status", film, "--json", "--check"))
    check(status["complete"] and status["shards"] == SHARDS and status["runs"]["complete"] == 1, f"status: {status}")
    lenscube(env, 0, ["is correct"], "verify", film)
    key = "films/film.zarr/film/c/1/1/1"
    data = bytearray(store.get(key))
    data[len(data) // 3] ^= 8
    store.put(key, bytes(data))
    store.s3.delete_object(Bucket=BUCKET, Key="films/film.zarr/film/c/0/0/0")
    lenscube(env, 4, ["bad: film/c/1/1/1", "missing: film/c/0/0/0"], "verify", film)
    lenscube(env, 4, ["removed 1 damaged shards"], "verify", film, "--repair")
    lenscube(env, 4, [f"{SHARDS - 2} of {SHARDS}"], "status", film, "--check")
    lenscube(env, 0, ["resuming"], *run(film))
    same_film(store.objects("films/film.zarr"), reference, "a repaired film")
    lenscube(env, 3, ["belongs to another job", "interp"], *run(film), "--interp", "bilinear")
    lenscube(env, 1, ["found nothing"], "status", s3("nowhere.zarr"))
    lenscube(env, 2, ["lies in the chart"], *run(s3("film.zarr/inside.zarr"), film))


def other_programs(store, film_path):
    """zarr-python and xarray on the store."""
    s3_store = S3Store(BUCKET, prefix="films/film.zarr", endpoint=f"http://127.0.0.1:{store.port}", access_key_id="a",
                    secret_access_key="b", region="us-east-1", client_options={"allow_http": True})
    there = zarr.storage.ObjectStore(s3_store, read_only=True)
    here = zarr.open_group(str(film_path), mode="r")["film"][:]
    check(np.array_equal(zarr.open_group(there, mode="r")["film"][:], here), "zarr-python reads another film on the store")
    with xarray.open_zarr(there, consolidated=True) as ds:
        check(ds["film"].dims == ("wavelength", "y", "x") and np.array_equal(ds["film"].values, here), "xarray reads another film on the store")


def png_pixels(path):
    """The compressed pixels of a PNG, without its text, which names the raw."""
    data, at, pixels = path.read_bytes(), 8, []
    while at < len(data):
        length = int.from_bytes(data[at:at + 4], "big")
        if data[at + 4:at + 8] == b"IDAT":
            pixels.append(data[at + 8:at + 8 + length])
        at += 12 + length
    return b"".join(pixels)


def raws(store, env, here, reference):
    """Raws on the store equal those in files byte for byte, and are developed there."""
    flags = ["--sensor", "example-2um", "--exposure", "40ms"]
    film, raw = s3("film.zarr"), s3("film.raw.zarr")
    lenscube(env, 0, [], "sensor", here / "film.zarr", here / "film.raw.zarr", *flags)
    lenscube(env, 0, [], "sensor", film, raw, *flags)
    same_film(store.objects("films/film.raw.zarr"), files(here / "film.raw.zarr"), "a raw on the store")
    lenscube(env, 0, ["nothing to do"], "sensor", film, raw, *flags)
    lenscube(env, 0, ["complete"], "status", raw, "--check")
    lenscube(env, 3, ["another job", "seed"], "sensor", film, raw, *flags, "--seed", 2)
    for name in ("there", "here"):
        lenscube(env, 0, [], "develop", raw if name == "there" else here / "film.raw.zarr", here / f"raw-{name}.png")
    there, of_file = (png_pixels(here / f"raw-{name}.png") for name in ("there", "here"))
    check(len(there) > 100 and there == of_file, "developments of the two raws differ")
    store.s3.delete_object(Bucket=BUCKET, Key="films/film.raw.zarr/raw/c/0/0/0")
    lenscube(env, 1, ["shards of frame 0 are missing"], "develop", raw, here / "never.png")
    lenscube(env, 0, ["1 shard,"], "sensor", film, raw, *flags)
    same_film(store.objects("films/film.raw.zarr"), files(here / "film.raw.zarr"), "a resumed raw")


def scenes(store, env, here):
    """Scenes of meshes on the store equal those in files byte for byte, and so do their films."""
    corners = [(-6, -6, -3), (6, -6, -3), (6, 6, -3), (-6, 6, -3), (-.1, -.1, -1), (.1, -.1, -1), (.1, .1, -1), (-.1, .1, -1)]
    mesh = here / "squares.obj"
    mesh.write_text("\n".join([*(f"v {x} {y} {z}" for x, y, z in corners), "f 1 2 3 4", "f 5 6 7 8"]))
    flags = ["--lens", "phone", "--focus-m", 1]
    film_flags = [*flags, "--wavelengths", "500,600", "--quiet"]
    view = ["--film-size", "120x90", "--film-pitch-um", 6, "--mesh-unit", "m", "--eye", "0,0,0", "--target", "0,0,-1"]
    at, local = s3("scene.zarr"), here / "scene.zarr"
    for scene in (at, local):
        lenscube(env, 0, ["scene of"], "scene", mesh, scene, *flags, *view, "--ids", "--half")
    same_film(store.objects("films/scene.zarr"), files(local), "a scene on the store")
    lenscube(env, 0, ["nothing to do"], "scene", mesh, at, *flags, *view, "--ids", "--half")
    lenscube(env, 3, ["another job", "half"], "scene", mesh, at, *flags, *view, "--ids")
    lenscube(env, 0, ["scene, complete"], "status", at, "--check")
    store.s3.delete_object(Bucket=BUCKET, Key="films/scene.zarr/hidden/1/depth/c/0/0")
    lenscube(env, 4, ["missing hidden/1/depth/c/0/0"], "verify", at)
    lenscube(env, 2, ["is not complete"], "run", at, s3("never-of-scene.zarr"), *film_flags)
    lenscube(env, 0, ["resuming"], "scene", mesh, at, *flags, *view, "--ids", "--half")
    same_film(store.objects("films/scene.zarr"), files(local), "a resumed scene")
    pixels = lambda found: {k: v for k, v in found.items() if k.startswith("film/c/")}
    lenscube(env, 0, [], "run", local, here / "of-scene.zarr", *film_flags)
    expected = pixels(files(here / "of-scene.zarr"))
    lenscube(env, 0, [], "run", at, s3("of-scene.zarr"), *film_flags)
    check(expected and pixels(store.objects("films/of-scene.zarr")) == expected, "the films of the two scenes differ")
    for _ in range(2):
        lenscube(env, 0, [], "run", mesh, s3("of-mesh.zarr"), *film_flags, *view, "--ids", "--half")
        check(pixels(store.objects("films/of-mesh.zarr")) == expected, "the film of the mesh differs")
        check(not store.objects("films/of-mesh.zarr.scene"), "the scene of a complete film was not removed")


def kill_and_resume(store, reference):
    """SIGKILL at several moments; the same command resumes. Only complete shards remain after a kill."""
    def killed_after(first):
        film, name = s3(f"killed-{first}.zarr"), f"films/killed-{first}.zarr"
        puts, killed = set(), threading.Event()

        def rule(_, method, path):
            """Shards beyond the first ones never reach the store: their requests wait for the kill."""
            if method == "PUT" and "/film/c/" in path:
                with count_lock:
                    if path in puts or len(puts) < first:
                        puts.add(path)
                        return None
                killed.wait()
                return "reset"
        proxy = Proxy(("127.0.0.1", store.port), rule)
        shards = lambda: {k: v for k, v in store.objects(name).items() if "film/c/" in k}
        p = start(environment(proxy.port, AWS_TIMEOUT="600 seconds"), *run(film))
        while len(shards()) < first and p.poll() is None:
            time.sleep(0.02)
        p.send_signal(signal.SIGKILL)
        p.communicate()
        check(p.returncode == -signal.SIGKILL, f"the run ended with {p.returncode} before it was killed")
        killed.set()
        proxy.close()
        found = shards()
        check(len(found) == first and all(v == reference[k] for k, v in found.items()), f"{len(found)} shards after kill -9, expected {first}")
        lenscube(environment(store.port), 0, ["resuming"], *run(film))
        same_film(store.objects(name), reference, "a film resumed after kill -9")
    with ThreadPoolExecutor(3) as pool:
        list(pool.map(killed_after, (3, 9, 20)))


def transient_faults(store, reference):
    """Transient faults: the film is the same, and the exit code is 0."""
    def film_with_fault(kind):
        name = f"fault-{kind}.zarr"
        # Two of 14 requests fail: a request and its first repetition.
        proxy = Proxy(("127.0.0.1", store.port), lambda n, *_: kind if n % 14 in (6, 7) else None)
        lenscube(environment(proxy.port, AWS_TIMEOUT="1 seconds" if kind == 3.0 else None), 0, [], *run(s3(name)))
        same_film(store.objects("films/" + name), reference, f"a film made with fault {kind}")
        print(f"  {kind}: {proxy.faults} faults in {proxy.requests} requests")
        proxy.close()
    # They mostly wait, so they run concurrently.
    with ThreadPoolExecutor(7) as pool:
        list(pool.map(film_with_fault, [503, 429, 500, "reset", "cut", "lost", 3.0]))


def in_units(store, env, here, reference):
    """The same film by units of a plan: in reverse order, each twice concurrently, one of them with faults; the plan is a file."""
    film, plan = s3("units.zarr"), here / "job.json"
    lenscube(env, 0, [], "plan", *run(film)[1:], "--unit-rows", 1, "-o", plan)
    units = len(json.loads(plan.read_text())["units"])
    check(units > 3, f"a plan of {units} units")
    missing = lenscube(env, 0, [], "status", "--plan", plan, "--missing").strip()
    check(missing == f"0-{units - 1}", f"missing of a new plan: {missing}")
    proxy = Proxy(("127.0.0.1", store.port), lambda n, *_: 503 if n % 14 in (6, 7) else None)
    environments = [env, environment(proxy.port)]
    with ThreadPoolExecutor(4) as pool:
        order = [u for u in reversed(range(units)) for _ in range(2)]
        list(pool.map(lambda k, u: lenscube(environments[k % 2], 0, [], "run", "--plan", plan, "--unit", u), range(len(order)), order))
    proxy.close()
    missing = lenscube(env, 0, [], "status", "--plan", plan, "--missing", "--check").strip()
    check(missing == "", f"missing of a plan that is done: {missing}")
    same_film(store.objects("films/units.zarr"), reference, "a film made in units")
    print(f"  {units} units, each twice concurrently: {proxy.faults} faults in {proxy.requests} requests")


def permanent_errors(store, env, here):
    """Permanent errors: an error message and the documented exit code each."""
    port = store.port
    few = {"AWS_MAX_ATTEMPTS": "3"}
    film = s3("never.zarr")
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        closed_port = s.getsockname()[1]
    # They mostly pause between requests, so they run concurrently.
    jobs, proxies = [], []

    def later(*command):
        jobs.append(lambda: lenscube(*command))
    for env_of, code, expected in [
        (environment(closed_port, **few), 75, ["Connection refused", "is unreachable"]),
        (environment(port, AWS_ENDPOINT_URL="http://no-such-host.invalid:9000", **few), 75, ["is unreachable"]),
        (environment(port, AWS_ALLOW_HTTP=None), 2, ["AWS_ALLOW_HTTP"]),
        (environment(port, AWS_ACCESS_KEY_ID=None), 2, ["AWS_ACCESS_KEY_ID is not set"]),
        (environment(port, AWS_MAX_ATTEMPTS="many"), 2, ["AWS_MAX_ATTEMPTS"]),
        ({k: v for k, v in env.items() if not k.startswith("AWS_")}, 2, ["no credentials", "AWS_ACCESS_KEY_ID"]),
    ]:
        later(env_of, code, expected, *run(film, here / "a.zarr", "double-gauss-28-npz"))
    for arguments in (run("s3://no-such-bucket/film.zarr"), ["status", "s3://no-such-bucket/film.zarr"],
                  ["chart", "composite", "s3://no-such-bucket/a.zarr", "--size", 64],
                  ["lens", "show", "s3://no-such-bucket/a.lens.zarr"], ["export", "s3://no-such-bucket/a.zarr", here / "x.png"]):
        later(env, 1, ["NoSuchBucket", "create the bucket"], *arguments)
    for at in ("s3://me:hush-hush-hush@lenscube/film.zarr", "https://127.0.0.1/film.zarr?X-Amz-Signature=hush-hush-hush", "gs://a/b"):
        later(env, 2, [], "status", at)
    for kind, code, expected in [(403, 1, ["SignatureDoesNotMatch", "AWS_SECRET_ACCESS_KEY"]), (503, 75, ["SlowDown", "503"]),
                             ("reset", 75, ["is unreachable"])]:
        proxy = Proxy(("127.0.0.1", port), lambda *_, kind=kind: kind)
        proxies.append(proxy)
        for arguments in (run(film), ["status", film], ["lens", "show", LENS], ["verify", film],
                      run(film, lens="double-gauss-28-npz"), run(here / f"never-{kind}.zarr", here / "a.zarr", LENS)):
            later(environment(proxy.port, **few), code, expected, *arguments)
        # The connection fails while shards are written, or while pixels of the chart or PSFs of the lens are read.
        for part, name in (("/film/c/", "puts"), ("/chart/c/", "gets"), ("/psf/", "psfs")):
            here_rule = lambda n, m, path, part=part, kind=kind: kind if part in path and m != "HEAD" else None
            proxy = Proxy(("127.0.0.1", port), here_rule)
            proxies.append(proxy)
            later(environment(proxy.port, **few), code, expected[:1], *run(s3(f"broken-{name}-{kind}.zarr")))
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda job: job(), jobs))
    for proxy in proxies:
        proxy.close()
    server = subprocess.Popen([sys.executable, "-m", "http.server", "0", "-b", "127.0.0.1", "-d", str(here)],
                              stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env={**os.environ, "PYTHONUNBUFFERED": "1"}, text=True)
    try:
        web = server.stdout.readline().split("(")[1].split(")")[0]
        lenscube(env, 1, ["range requests"], *run(here / "no-parts.zarr", web + "a.zarr", "double-gauss-28-npz"))
        lenscube(env, 0, [], "status", web + "film.zarr")
    finally:
        server.kill()
        server.wait()


def replaced(store):
    """There are no locks on a store, so a film may be replaced during a run, which must not write its shards into the other."""
    name = "films/replaced.zarr"
    replaced, lock = [], threading.Lock()

    def rule(_, method, path):
        """Shards that are put meanwhile wait until the film is replaced."""
        if method == "PUT" and "/film/c/" in path:
            with lock:
                if path.endswith("/film/c/0/1/1") and not replaced:
                    group = json.loads(store.get(f"{name}/zarr.json"))
                    group["attributes"]["provenance"]["job_digest"] = "another"
                    store.put(f"{name}/zarr.json", json.dumps(group))
                    replaced.append(1)
    proxy = Proxy(("127.0.0.1", store.port), rule)
    lenscube(environment(proxy.port), 3, ["another job"], *run(s3("replaced.zarr")))
    proxy.close()
    found = sum("film/c/" in k for k in store.objects(name))
    check(replaced and found < SHARDS, f"{found} shards were put into another job's film")
    # With --overwrite nothing of the old film remains.
    lenscube(environment(store.port), 0, [], *run(s3("replaced.zarr")), "--overwrite")
    lenscube(environment(store.port), 0, ["is correct"], "verify", s3("replaced.zarr"))


def encrypted(store, here, reference):
    """TLS with a self-signed certificate."""
    made = subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=127.0.0.1",
                           "-addext", "subjectAltName=IP:127.0.0.1", "-addext", "basicConstraints=critical,CA:FALSE", "-keyout", here / "key.pem", "-out", here / "cert.pem"],
                          capture_output=True, text=True)
    check(made.returncode == 0, f"openssl: {made.stderr}")
    proxy = Proxy(("127.0.0.1", store.port), certificate=(here / "cert.pem", here / "key.pem"))
    trusted = environment(proxy.port, "https", AWS_ALLOW_HTTP=None, SSL_CERT_FILE=str(here / "cert.pem"))
    lenscube(trusted, 0, [], *run(s3("tls.zarr")))
    same_film(store.objects("films/tls.zarr"), reference, "a film written through TLS")
    lenscube(environment(proxy.port, "https", AWS_MAX_ATTEMPTS="2"), 75, ["certificate"], "status", s3("tls.zarr"))
    proxy.close()


def in_flight(store):
    """Number of concurrent puts if each takes long: the first waits for the second."""
    puts, second = set(), threading.Event()

    def rule(_, method, path):
        if method == "PUT" and "/film/c/" in path:
            with count_lock:
                puts.add(path)
                if len(puts) > 1:
                    second.set()
            second.wait(300)
            return 0.3
    proxy = Proxy(("127.0.0.1", store.port), rule)
    begin = time.monotonic()
    lenscube(environment(proxy.port, AWS_TIMEOUT="600 seconds"), 0, [], *run(s3("slow.zarr")))
    record = next(json.loads(v) for k, v in store.objects("films/slow.zarr").items() if k.startswith("runs/"))
    print(f"  puts of 300 ms: {proxy.max_puts} concurrent, {time.monotonic() - begin:.1f} s; {proxy.requests} requests; "
          f"peak {record['peak_resident_bytes'] / 2**20:.0f} MiB")
    check(1 < proxy.max_puts <= 8, f"{proxy.max_puts} concurrent puts")
    proxy.close()


# What each step takes.
STEPS = {status_and_verify: "store env reference", other_programs: "store film", kill_and_resume: "store reference", transient_faults: "store reference",
         in_units: "store env here reference", raws: "store env here reference", scenes: "store env here", permanent_errors: "store env here",
         replaced: "store", encrypted: "store here reference", in_flight: "store"}


def main():
    names = [step.__name__ for step in STEPS]
    wanted = sys.argv[2:] or names
    check(set(wanted) <= set(names), f"steps {wanted}: expected some of {names}")
    with tempfile.TemporaryDirectory() as scratch, socket.socket() as s:
        here = Path(scratch)
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
        s.close()
        moto = subprocess.Popen([sys.executable, "-c", "import sys; from moto.server import main; main(sys.argv[1:])",
                                 "-H", "127.0.0.1", "-p", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            for _ in range(600):
                try:
                    urllib.request.urlopen(f"http://127.0.0.1:{port}/moto-api/", timeout=5).close()
                    break
                except OSError:
                    check(moto.poll() is None, "moto does not start")
                    time.sleep(0.1)
            store, env = Store(port), environment(port)
            reference = stores(store, env, here)
            of = {"store": store, "env": env, "reference": reference, "here": here, "film": here / "film.zarr"}
            for step, takes in [(step, takes) for step, takes in STEPS.items() if step.__name__ in wanted]:
                begin = time.monotonic()
                step(*(of[name] for name in takes.split()))
                print(f"  {step.__name__}: {time.monotonic() - begin:.1f} s", flush=True)
        finally:
            moto.kill()
            moto.wait()
    print(f"check-s3: {checks} checks passed")


main()
