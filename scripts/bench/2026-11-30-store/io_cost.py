"""Core seconds that the system takes to read and to write a GB, by each way that a store may use.

    io_cost.py FOLDER [GB]

A file of GB (2) gigabytes of random bytes in FOLDER, in parts of 1 MiB, as chunks of charts and films have: read with pread from the page cache and from the disk, with
O_DIRECT, through a mapping page by page and with MADV_POPULATE_READ; written with pwrite and fdatasync, and with O_DIRECT. Needs root, to empty the page cache.
User and system seconds of this process a GB, median of three rounds in turn; work of kernel threads (write-back) is not in it.
"""

import mmap
import os
import pathlib
import resource
import statistics
import sys

PART = 1 << 20
MADV_POPULATE_READ = 22


def cpu_s():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def drop():
    os.sync()
    pathlib.Path("/proc/sys/vm/drop_caches").write_text("3")


def read(path, size, flags):
    handle = os.open(path, os.O_RDONLY | flags)
    part = mmap.mmap(-1, PART)
    for at in range(0, size, PART):
        if os.preadv(handle, [part], at) != PART:
            sys.exit(f"{path}: a short read at {at}")
    os.close(handle)


def map_pages(path, size, is_populated):
    handle = os.open(path, os.O_RDONLY)
    mapping = mmap.mmap(handle, size, mmap.MAP_SHARED, mmap.PROT_READ)
    if is_populated:
        for at in range(0, size, PART):
            mapping.madvise(MADV_POPULATE_READ, at, PART)
    else:
        sum(memoryview(mapping)[::4096])
    os.close(handle)


def write(path, size, flags):
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | flags)
    part = mmap.mmap(-1, PART)
    part.write(os.urandom(PART))
    for at in range(0, size, PART):
        os.pwritev(handle, [part], at)
    os.fdatasync(handle)
    os.close(handle)


def main():
    folder = pathlib.Path(sys.argv[1])
    size = int(float(sys.argv[2] if len(sys.argv) > 2 else 2) * 1e9) // PART * PART
    path = folder / "io_cost.bin"
    write(path, size, 0)
    ways = {
        "pread, page cache": (False, lambda: read(path, size, 0)),
        "pread, disk": (True, lambda: read(path, size, 0)),
        "O_DIRECT read": (True, lambda: read(path, size, os.O_DIRECT)),
        "mapping by pages, page cache": (False, lambda: map_pages(path, size, False)),
        "mapping by pages, disk": (True, lambda: map_pages(path, size, False)),
        "MADV_POPULATE_READ, disk": (True, lambda: map_pages(path, size, True)),
        "pwrite, fdatasync": (True, lambda: write(path, size, 0)),
        "O_DIRECT write": (True, lambda: write(path, size, os.O_DIRECT)),
    }
    found = {name: [] for name in ways}
    for _ in range(3):
        for name, (is_cold, way) in ways.items():
            if is_cold:
                drop()
            else:
                read(path, size, 0)
            before = cpu_s()
            way()
            found[name].append((cpu_s() - before) / (size / 1e9))
    path.unlink()
    for name, seconds in found.items():
        print(f"{name:30} {statistics.median(seconds):.3f} core s a GB")


if __name__ == "__main__":
    main()
