"""Uncompressed f32 chunks of a Zarr shard: read (pread) or mapped (mmap)? CPU seconds, so that other work on the machine counts little.

64 shards of 16 inner chunks (512 x 512 f32, 1 MiB + crc32c), in the page cache; each chunk ends as f32 in a tile's buffer, as the reader
of charts has it. `python3 pread_or_mmap.py DIRECTORY`
"""
import mmap, os, resource, sys, time
import numpy as np

SHARDS, CHUNKS, BYTES = 64, 16, 1 << 20
STEP = BYTES + 4
files = [os.path.join(sys.argv[1], f"shard-{i}") for i in range(SHARDS)]
rng = np.random.default_rng(1)
for name in files:
    with open(name, "wb") as f:
        f.write(rng.bytes(CHUNKS * STEP))
tile, room = np.empty(BYTES // 4, np.float32), bytearray(BYTES)


def pread():
    for name in files:
        fd = os.open(name, os.O_RDONLY)
        for c in range(CHUNKS):
            os.preadv(fd, [room], c * STEP)
            tile[:] = np.frombuffer(room, np.float32)
        os.close(fd)


def mapped(populate):
    for name in files:
        fd = os.open(name, os.O_RDONLY)
        m = mmap.mmap(fd, 0, prot=mmap.PROT_READ, flags=mmap.MAP_SHARED | (mmap.MAP_POPULATE if populate else 0))
        whole = np.frombuffer(m, np.uint8)
        for c in range(CHUNKS):
            tile.view(np.uint8)[:] = whole[c * STEP:c * STEP + BYTES]
        del whole
        m.close()
        os.close(fd)


ways = {"pread": pread, "mmap": lambda: mapped(False), "mmap, populated": lambda: mapped(True)}
for name, way in ways.items():
    way()
times = {name: [] for name in ways}
for _ in range(7):
    for name, way in ways.items():
        a = resource.getrusage(resource.RUSAGE_SELF)
        way()
        b = resource.getrusage(resource.RUSAGE_SELF)
        times[name].append((b.ru_utime - a.ru_utime, b.ru_stime - a.ru_stime))
total = SHARDS * CHUNKS * BYTES
for name, t in times.items():
    user, system = np.median(t, axis=0)
    print(f"{name:16} {1e3 * (user + system):7.1f} ms of CPU for {total >> 20} MiB ({total / (user + system) * 1e-9:.2f} GB/s a core): user {1e3 * user:.1f}, system {1e3 * system:.1f}")
for name in files:
    os.remove(name)
