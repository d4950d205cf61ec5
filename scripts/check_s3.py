"""Charts, lenses and films on an S3-compatible store, with the program given; check-s3 runs it.

What must hold: a job gives the same bytes there as in files, however the way to the store fails meanwhile, and whenever the
program is killed; other programs open the film; what cannot be is one clear error with the right exit code, which tells
nothing that is secret.
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
counting = threading.Lock()


def holds(condition, what):
    global checks
    with counting:
        checks += 1
    if not condition:
        sys.exit(f"check-s3: {what}")


def environment(port, scheme="http", **more):
    env = {k: v for k, v in os.environ.items() if not k.startswith("AWS_")}
    env |= {"AWS_ACCESS_KEY_ID": "AKIAHUSHHUSH", "AWS_SECRET_ACCESS_KEY": SECRET, "AWS_REGION": "us-east-1",
            "AWS_ENDPOINT_URL": f"{scheme}://127.0.0.1:{port}", "AWS_ALLOW_HTTP": "true"}
    return {k: v for k, v in (env | more).items() if v is not None}


def start(env, *words):
    return subprocess.Popen([LENSCUBE, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env)


def lenscube(env, code, says, *words, seconds=300):
    """Runs the program; it must end with `code` and say every word of `says`, and nothing that is secret."""
    p = start(env, *words)
    out, err = p.communicate(timeout=seconds)
    at = f"lenscube {' '.join(map(str, words))}"
    holds(p.returncode == code, f"{at}: ended with {p.returncode}, expected {code}: {out}{err}")
    for word in says:
        holds(word in out + err, f"{at}: does not say `{word}`: {out}{err}")
    for word in (SECRET, "secret-string", "AWS4-HMAC", "AKIAHUSH"):
        holds(word not in out + err, f"{at}: tells what is secret: {out}{err}")
    holds("panicked" not in err, f"{at}: {err}")
    return out


class Place:
    """The store, and how to look at it past the program."""

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
        """Lets anybody read, as from a web server."""
        for key in self.objects(prefix):
            self.s3.put_object_acl(Bucket=BUCKET, Key=f"{prefix}/{key}", ACL="public-read")


def files(root):
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def job_of(metadata):
    """The group's metadata without what tells this copy of the chart from another."""
    group = json.loads(metadata)
    provenance = group["attributes"]["provenance"]
    for words in (provenance, provenance["job"]):
        words.pop("chart_mtimes", None), words.pop("job_digest", None)
    return group


def same_film(found, expected, what):
    found = {k: v for k, v in found.items() if not k.startswith("runs/")}
    expected = {k: v for k, v in expected.items() if not k.startswith("runs/")}
    holds(found.keys() == expected.keys(), f"{what}: keys {sorted(found.keys() ^ expected.keys())[:5]} differ")
    for key, data in expected.items():
        same = job_of(data) == job_of(found[key]) if key == "zarr.json" else data == found[key]
        holds(same, f"{what}: {key} differs")


FLAGS = ["--threads", 2, "--shard", 128, "--chunk", 64, "--psf-window", 9, "--azimuths", 8, "--memory", "1GiB"]
CHART, LENS = f"s3://{BUCKET}/charts/a.zarr", f"s3://{BUCKET}/lenses/double-gauss.lens.zarr"


def run(film, chart=CHART, lens=LENS):
    return ["run", chart, film, "--lens", lens, *FLAGS]


def s3(name):
    return f"s3://{BUCKET}/films/{name}"


def stores(place, env, here):
    """Charts, lenses and films there are those of files, byte for byte."""
    draw = ["--size", "360x500", "--wavelengths", "500:550:50"]
    lenscube(env, 0, [], "chart", "composite", here / "a.zarr", *draw)
    lenscube(env, 0, [], "chart", "composite", CHART, *draw)
    holds(place.objects("charts/a.zarr") == files(here / "a.zarr"), "a chart there has other bytes than in files")
    lenscube(env, 3, ["--overwrite"], "chart", "composite", CHART, *draw)
    lenscube(env, 0, [], "chart", "composite", CHART, *draw, "--overwrite")
    with zipfile.ZipFile(PACK) as pack:
        for name in pack.namelist():
            place.put(f"lenses/double-gauss.lens.zarr/{name}", pack.read(name))
    place.put("lenses/double-gauss.lens.zip", PACK.read_bytes())
    shown = [lenscube(env, 0, [], "lens", "show", at, "--json") for at in (LENS, LENS[:-4] + "zip", PACK)]
    lenscube(env, 0, [], "lens", "diff", LENS, PACK)
    shown = [{k: v for k, v in json.loads(s).items() if k != "path"} for s in shown]
    holds(shown[0] == shown[2] and shown[1] == shown[2] and shown[2]["bands"] == 31, "a lens shows other tables there")

    lenscube(env, 0, [], *run(here / "film.zarr", here / "a.zarr", "double-gauss-28-npz"))
    whole = files(here / "film.zarr")
    holds(sum("film/c/" in k for k in whole) == SHARDS, "the job has another number of shards than it should")
    lenscube(env, 0, [], *run(s3("film.zarr")))
    same_film(place.objects("films/film.zarr"), whole, "the film there")
    lenscube(env, 0, ["is complete", "nothing to do"], *run(s3("film.zarr"), lens=LENS[:-4] + "zip"))
    place.publish("charts"), place.publish("lenses")
    web = f"http://127.0.0.1:{place.port}/{BUCKET}/charts/a.zarr"
    lenscube(env, 0, ["is complete"], *run(s3("film.zarr"), web))
    lenscube(env, 1, ["wants a login"], *run(s3("film.zarr"), f"http://127.0.0.1:{place.port}/{BUCKET}/films/film.zarr"))
    # From a web server into files, by another name of the same array.
    lenscube(env, 0, [], *run(here / "web.zarr", web + "//chart", f"http://127.0.0.1:{place.port}/{BUCKET}/lenses/double-gauss.lens.zarr"))
    same_film(files(here / "web.zarr"), whole, "the film of a chart on a web server")
    lenscube(env, 1, ["only read"], *run(f"http://127.0.0.1:{place.port}/{BUCKET}/films/web.zarr"))
    lenscube(env, 0, [], "export", s3("film.zarr"), here / "there.png", "--band", 550)
    lenscube(env, 0, [], "export", here / "film.zarr", here / "here.png", "--band", 550)
    holds((here / "there.png").read_bytes() == (here / "here.png").read_bytes(), "pictures of the two films differ")
    return whole


def looked_at(place, env, whole):
    """status, verify and --repair."""
    film = s3("film.zarr")
    status = json.loads(lenscube(env, 0, [], "status", film, "--json", "--check"))
    holds(status["complete"] and status["shards"] == SHARDS and status["runs"]["complete"] == 1, f"status: {status}")
    lenscube(env, 0, ["is sound"], "verify", film)
    key = "films/film.zarr/film/c/1/1/1"
    data = bytearray(place.get(key))
    data[len(data) // 3] ^= 8
    place.put(key, bytes(data))
    place.s3.delete_object(Bucket=BUCKET, Key="films/film.zarr/film/c/0/0/0")
    lenscube(env, 4, ["bad: film/c/1/1/1", "missing: film/c/0/0/0"], "verify", film)
    lenscube(env, 4, ["removed 1 bad shards"], "verify", film, "--repair")
    lenscube(env, 4, [f"{SHARDS - 2} of {SHARDS}"], "status", film, "--check")
    lenscube(env, 0, ["resuming"], *run(film))
    same_film(place.objects("films/film.zarr"), whole, "a repaired film")
    lenscube(env, 3, ["belongs to another job", "interp"], *run(film), "--interp", "bilinear")
    lenscube(env, 1, ["found nothing"], "status", s3("nowhere.zarr"))
    lenscube(env, 2, ["its own chart"], *run(s3("film.zarr/inside.zarr"), film))


def other_programs(place, whole_film):
    """zarr-python and xarray, past files."""
    store = S3Store(BUCKET, prefix="films/film.zarr", endpoint=f"http://127.0.0.1:{place.port}", access_key_id="a",
                    secret_access_key="b", region="us-east-1", client_options={"allow_http": True})
    there = zarr.storage.ObjectStore(store, read_only=True)
    here = zarr.open_group(str(whole_film), mode="r")["film"][:]
    holds(np.array_equal(zarr.open_group(there, mode="r")["film"][:], here), "zarr-python reads another film there")
    with xarray.open_zarr(there, consolidated=True) as ds:
        holds(ds["film"].dims == ("wavelength", "y", "x") and np.array_equal(ds["film"].values, here), "xarray reads another film there")


def killed(place, whole):
    """SIGKILL at several moments; the same command resumes. Nothing is left behind but shards, each whole."""
    def killed_after(first):
        film, name = s3(f"killed-{first}.zarr"), f"films/killed-{first}.zarr"
        puts = []

        def rule(_, method, path):
            if method == "PUT" and "/film/c/" in path:
                puts.append(path)
                return 0.05
        way = Proxy(("127.0.0.1", place.port), rule)
        p = start(environment(way.port), *run(film))
        while len(puts) < first and p.poll() is None:
            time.sleep(0.005)
        p.send_signal(signal.SIGKILL)
        p.communicate()
        holds(p.returncode == -signal.SIGKILL, f"the run ended with {p.returncode} before it was killed")
        way.close()
        time.sleep(0.3)  # what was under way may still arrive
        there = {k: v for k, v in place.objects(name).items() if "film/c/" in k}
        holds(0 < len(there) < SHARDS and all(v == whole[k] for k, v in there.items()), f"{len(there)} shards after kill -9")
        lenscube(environment(place.port), 0, ["resuming"], *run(film))
        same_film(place.objects(name), whole, "a film resumed after kill -9")
    with ThreadPoolExecutor(3) as pool:
        list(pool.map(killed_after, (3, 9, 20)))


def survived(place, whole):
    """Faults that pass: the film is the same, and nobody is asked for help."""
    def film_in_spite_of(kind):
        name = f"fault-{kind}.zarr"
        # Every seventh request fails, and so does its first repetition.
        way = Proxy(("127.0.0.1", place.port), lambda n, *_: kind if n % 14 in (6, 7) else None)
        lenscube(environment(way.port, AWS_TIMEOUT="1 seconds" if kind == 3.0 else None), 0, [], *run(s3(name)))
        same_film(place.objects("films/" + name), whole, f"a film made in spite of {kind}")
        print(f"  {kind}: {way.faults} faults in {way.requests} requests")
        way.close()
    # Most of the time each of them waits.
    with ThreadPoolExecutor(7) as pool:
        list(pool.map(film_in_spite_of, [503, 429, 500, "reset", "cut", "lost", 3.0]))


def in_units(place, env, here, whole):
    """The same film by processes of a plan: out of order, twice at once, one of them through faults, the plan elsewhere than the film."""
    film, plan = s3("units.zarr"), here / "job.json"
    lenscube(env, 0, [], "plan", *run(film)[1:], "--unit-rows", 1, "-o", plan)
    units = len(json.loads(plan.read_text())["units"])
    holds(units > 3, f"a plan of {units} units")
    missing = lenscube(env, 0, [], "status", "--plan", plan, "--missing").strip()
    holds(missing == f"0-{units - 1}", f"missing of a new plan: {missing}")
    way = Proxy(("127.0.0.1", place.port), lambda n, *_: 503 if n % 14 in (6, 7) else None)
    ways = [env, environment(way.port)]
    with ThreadPoolExecutor(4) as pool:
        order = [u for u in reversed(range(units)) for _ in range(2)]
        list(pool.map(lambda k, u: lenscube(ways[k % 2], 0, [], "run", "--plan", plan, "--unit", u), range(len(order)), order))
    way.close()
    missing = lenscube(env, 0, [], "status", "--plan", plan, "--missing", "--check").strip()
    holds(missing == "", f"missing of a plan that is done: {missing}")
    same_film(place.objects("films/units.zarr"), whole, "a film made in units")
    print(f"  {units} units, each twice at once: {way.faults} faults in {way.requests} requests")


def refused(place, env, here):
    """What cannot be: one clear error each, with the right code."""
    port = place.port
    few = {"AWS_MAX_ATTEMPTS": "3"}
    film = s3("never.zarr")
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        nobody = s.getsockname()[1]
    # Most of the time each of them pauses between its requests.
    jobs, proxies = [], []

    def later(*command):
        jobs.append(lambda: lenscube(*command))
    for env_of, code, says in [
        (environment(nobody, **few), 75, ["Connection refused", "out of reach"]),
        (environment(port, AWS_ENDPOINT_URL="http://no-such-host.invalid:9000", **few), 75, ["out of reach"]),
        (environment(port, AWS_ALLOW_HTTP=None), 2, ["AWS_ALLOW_HTTP"]),
        (environment(port, AWS_ACCESS_KEY_ID=None), 2, ["AWS_ACCESS_KEY_ID is not set"]),
        (environment(port, AWS_MAX_ATTEMPTS="many"), 2, ["AWS_MAX_ATTEMPTS"]),
        ({k: v for k, v in env.items() if not k.startswith("AWS_")}, 2, ["no credentials", "AWS_ACCESS_KEY_ID"]),
    ]:
        later(env_of, code, says, *run(film, here / "a.zarr", "double-gauss-28-npz"))
    for words in (run("s3://no-such-bucket/film.zarr"), ["status", "s3://no-such-bucket/film.zarr"],
                  ["chart", "composite", "s3://no-such-bucket/a.zarr", "--size", 64],
                  ["lens", "show", "s3://no-such-bucket/a.lens.zarr"], ["export", "s3://no-such-bucket/a.zarr", here / "x.png"]):
        later(env, 1, ["NoSuchBucket", "create the bucket"], *words)
    for at in ("s3://me:hush-hush-hush@lenscube/film.zarr", "https://127.0.0.1/film.zarr?X-Amz-Signature=hush-hush-hush", "gs://a/b"):
        later(env, 2, [], "status", at)
    for kind, code, says in [(403, 1, ["SignatureDoesNotMatch", "AWS_SECRET_ACCESS_KEY"]), (503, 75, ["SlowDown", "503"]),
                             ("reset", 75, ["out of reach"])]:
        proxy = Proxy(("127.0.0.1", port), lambda *_, kind=kind: kind)
        proxies.append(proxy)
        for words in (run(film), ["status", film], ["lens", "show", LENS], ["verify", film],
                      run(film, lens="double-gauss-28-npz"), run(here / f"never-{kind}.zarr", here / "a.zarr", LENS)):
            later(environment(proxy.port, **few), code, says, *words)
        # The connection breaks while shards are put, or while the chart's pixels or the lens's PSFs are fetched.
        for part, name in (("/film/c/", "puts"), ("/chart/c/", "gets"), ("/psf/", "psfs")):
            here_rule = lambda n, m, path, part=part, kind=kind: kind if part in path and m != "HEAD" else None
            proxy = Proxy(("127.0.0.1", port), here_rule)
            proxies.append(proxy)
            later(environment(proxy.port, **few), code, says[:1], *run(s3(f"broken-{name}-{kind}.zarr")))
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


def replaced(place):
    """Without locks a film may be replaced under a run: it writes none of its shards into the other."""
    name = "films/replaced.zarr"
    theirs = []

    def rule(_, method, path):
        if method == "PUT" and path.endswith("/film/c/0/1/1") and not theirs:
            group = json.loads(place.get(f"{name}/zarr.json"))
            group["attributes"]["provenance"]["job_digest"] = "another"
            theirs.append(1)
            place.put(f"{name}/zarr.json", json.dumps(group))
    way = Proxy(("127.0.0.1", place.port), rule)
    lenscube(environment(way.port), 3, ["another job"], *run(s3("replaced.zarr")))
    way.close()
    there = sum("film/c/" in k for k in place.objects(name))
    holds(theirs and there < SHARDS, f"{there} shards were put into another job's film")
    # Anew: nothing of what was there stays.
    lenscube(environment(place.port), 0, [], *run(s3("replaced.zarr")), "--overwrite")
    lenscube(environment(place.port), 0, ["is sound"], "verify", s3("replaced.zarr"))


def encrypted(place, here, whole):
    """TLS, with a certificate of our own."""
    made = subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=127.0.0.1",
                           "-addext", "subjectAltName=IP:127.0.0.1", "-addext", "basicConstraints=critical,CA:FALSE", "-keyout", here / "key.pem", "-out", here / "cert.pem"],
                          capture_output=True, text=True)
    holds(made.returncode == 0, f"openssl: {made.stderr}")
    way = Proxy(("127.0.0.1", place.port), certificate=(here / "cert.pem", here / "key.pem"))
    trusted = environment(way.port, "https", AWS_ALLOW_HTTP=None, SSL_CERT_FILE=str(here / "cert.pem"))
    lenscube(trusted, 0, [], *run(s3("tls.zarr")))
    same_film(place.objects("films/tls.zarr"), whole, "a film put through TLS")
    lenscube(environment(way.port, "https", AWS_MAX_ATTEMPTS="2"), 75, ["certificate"], "status", s3("tls.zarr"))
    way.close()


def in_flight(place):
    """Puts at once when each takes long."""
    way = Proxy(("127.0.0.1", place.port), lambda n, m, path: 0.3 if m == "PUT" and "/film/c/" in path else None)
    begin = time.monotonic()
    lenscube(environment(way.port), 0, [], *run(s3("slow.zarr")))
    record = next(json.loads(v) for k, v in place.objects("films/slow.zarr").items() if k.startswith("runs/"))
    print(f"  puts of 300 ms: {way.most_puts} at once, {time.monotonic() - begin:.1f} s; {way.requests} requests; "
          f"peak {record['peak_resident_bytes'] / 2**20:.0f} MiB")
    holds(1 < way.most_puts <= 8, f"{way.most_puts} puts at once")
    way.close()


def main():
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
                    holds(moto.poll() is None, "moto does not start")
                    time.sleep(0.1)
            place, env = Place(port), environment(port)
            whole = stores(place, env, here)
            for step, args in [(looked_at, (place, env, whole)), (other_programs, (place, here / "film.zarr")), (killed, (place, whole)),
                               (survived, (place, whole)), (in_units, (place, env, here, whole)), (refused, (place, env, here)), (replaced, (place,)),
                               (encrypted, (place, here, whole)), (in_flight, (place,))]:
                begin = time.monotonic()
                step(*args)
                print(f"  {step.__name__}: {time.monotonic() - begin:.1f} s", flush=True)
        finally:
            moto.kill()
            moto.wait()
    print(f"check-s3: {checks} checks, all is well")


main()
