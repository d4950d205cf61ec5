#!/usr/bin/env python3
"""Cycles of a multiprocessor for a node of psf_scatter_128, from machine code: an issue model, not a measurement.

    issue_model.py CUBIN... [--cuobjdump PATH] [--threads N]

Reads the loop over the nodes (compute capability 9.0) and its control fields: stall cycles and scoreboards. Four schedulers issue one warp
instruction a cycle each, in order within a warp; shared memory and L1 deliver 128 bytes a cycle, L2 a given number of bytes a cycle and a
latency. Assumed, not measured: latencies (LATENCY), bytes a cycle of L2. Blocks of 51 px: 78 rows and columns, packed 80 x 80.
"""

import argparse
import heapq
import re
import subprocess

COLUMNS, ROWS = 80, 78
LATENCY = {"shared": 29, "l1": 38, "l2": 270, "other": 20}


class Instruction:
    def __init__(self, address, text, high):
        self.address, self.text = address, text
        words = text.split()
        self.predicated = words[0].startswith("@")
        self.name = words[1] if self.predicated else words[0]
        control = high >> 41
        self.stall = max(1, control & 15)
        self.write, self.read, self.wait = control >> 5 & 7, control >> 8 & 7, control >> 11 & 63
        self.target = None
        if self.name.startswith("BRA"):
            self.target = int(re.search(r"0x([0-9a-f]+)", text)[1], 16)


def instructions(cuobjdump, cubin, kernel):
    """Machine code of the kernel."""
    text = subprocess.run([cuobjdump, "-sass", "-fun", kernel, cubin], capture_output=True, text=True, check=True).stdout
    found = re.findall(r"/\*([0-9a-f]{4,})\*/\s+(.+?) ;\s+/\* 0x[0-9a-f]{16} \*/\s+/\* 0x([0-9a-f]{16}) \*/", text)
    return [Instruction(int(a, 16), i, int(high, 16)) for a, i, high in found]


def node_loop(code):
    """Instructions of the loop over nodes: from the target of the backward branch after the fourth barrier."""
    barriers = [i for i, x in enumerate(code) if x.name.startswith("BAR")]
    for i, x in enumerate(code):
        if x.target is not None and x.target < code[barriers[0]].address < x.address and i > barriers[3]:
            first = next(k for k, y in enumerate(code) if y.address == x.target)
            return code[first : i + 1]
    raise SystemExit("no loop over nodes found")


def trace(loop, warp, warps):
    """Indices of the instructions that a warp issues for one node."""
    at = {x.address: i for i, x in enumerate(loop)}
    barrier, i, out, done, groups = 0, 0, [], 0, 0 # groups: source rows loaded
    tasks = {1: 8 * COLUMNS // 32, 2: 8 * COLUMNS // 32, 3: 16}
    while i < len(loop) - 1:
        x = loop[i]
        out.append(i)
        if x.name.startswith("BAR"):
            barrier, done, groups = barrier + 1, 0, 0
        groups += "LDG.E.128.CONSTANT" in x.text
        if x.target is not None:
            share = max(0, -(-(tasks.get(barrier, 0) - warp) // warps))
            target = at.get(x.target)
            if target is None:
                raise SystemExit(f"branch out of the loop: {x.text}")
            if target <= i:
                done, groups = done + 1, 0
                if done < share:
                    i = target
                    continue
            else:
                skipped = loop[i:target]
                of_task = any(y.target is not None and at[y.target] <= at[y.address] and y is not x for y in skipped)
                # A whole stage, the next weight (one warp), or further groups of rows.
                if of_task:
                    leave = share == 0
                elif barrier == 1 and not any("LDG.E.128" in y.text for y in skipped) and groups == 0 and done == 0 and not any(y.name == "FFMA" for y in skipped):
                    leave = warp != 0
                elif barrier == 1:
                    leave = 8 * groups >= ROWS
                else:
                    leave = share == 0
                if leave:
                    i = target
                    continue
        i += 1
    out.append(len(loop) - 1)
    return out


def bytes_of(name):
    return 16 if ".128" in name else 8 if ".64" in name else 4


def simulate(loop, warps, blocks, l2_bytes, packed_in_l1, nodes=6):
    """Cycles and warp instructions of a node of one block, in the steady state."""
    traces = [trace(loop, w, warps) for w in range(warps)]
    total = blocks * warps
    pc, node, ready = [0] * total, [0] * total, [0] * total
    boards = [[0] * 6 for _ in range(total)]
    waiting, arrived = [False] * total, [0] * blocks
    memory_free, l2_free, heavy_free = 0, 0.0, [0] * 4
    events, cycle, last, ended = [], 0, [None] * 4, [[] for _ in range(blocks)]
    # The second block begins half a node later.
    for w in range(warps, total):
        ready[w] = 2500
    issued = 0
    while True:
        while events and events[0][0] <= cycle:
            _, w, board = heapq.heappop(events)
            boards[w][board] -= 1
        active = False
        for scheduler in range(4):
            order = list(range(scheduler, total, 4))
            if last[scheduler] in order:
                order.remove(last[scheduler])
                order.insert(0, last[scheduler])
            for w in order:
                if waiting[w] or node[w] >= nodes:
                    continue
                active = True
                if ready[w] > cycle:
                    continue
                x = loop[traces[w % warps][pc[w]]]
                if any(x.wait >> b & 1 and boards[w][b] for b in range(6)):
                    continue
                heavy = x.name.split(".")[0] in ("IMAD", "IADD3", "LEA", "LOP3", "SHF", "ISETP", "MOV", "SEL", "PRMT", "FSETP", "FMNMX", "FSEL")
                if heavy and heavy_free[scheduler] > cycle:
                    continue
                if heavy:
                    heavy_free[scheduler] = cycle + 2
                kind = x.name.split(".")[0]
                finish = cycle + LATENCY["other"]
                if kind in ("LDS", "STS", "LDG", "STG"):
                    size = 32 * bytes_of(x.name)
                    start = max(cycle, memory_free)
                    memory_free = start + size / 128
                    if memory_free - cycle > 64:  # the queue of memory instructions is full
                        memory_free -= size / 128
                        continue
                    finish = memory_free + LATENCY["shared" if kind in ("LDS", "STS") else "l1"]
                    if kind == "LDG" and ("CONSTANT" not in x.name or not packed_in_l1) and bytes_of(x.name) == 16:
                        l2_free = max(l2_free, cycle) + size / l2_bytes
                        finish = l2_free + LATENCY["l2"]
                for board, at in ((x.write, finish), (x.read, min(finish, cycle + 12) if kind in ("LDG", "STS", "STG") else finish)):
                    if board < 6:
                        boards[w][board] += 1
                        heapq.heappush(events, (at, w, board))
                ready[w], last[scheduler] = cycle + x.stall, w
                issued += 1
                block = w // warps
                if x.name.startswith("BAR"):
                    waiting[w] = True
                    arrived[block] += 1
                    if arrived[block] == warps:
                        arrived[block] = 0
                        for v in range(block * warps, (block + 1) * warps):
                            waiting[v] = False
                            ready[v] = max(ready[v], cycle + 6)
                pc[w] += 1
                if pc[w] == len(traces[w % warps]):
                    pc[w], node[w] = 0, node[w] + 1
                    if w % warps == 0:
                        ended[block].append(cycle)
                break
        if not active and not any(waiting):
            break
        cycle += 1
        if cycle > 2_000_000:
            raise SystemExit("deadlock")
    instructions_of_node = sum(len(t) for t in traces)
    spans = [(e[-2] - e[1]) / (nodes - 3) for e in ended]
    return sum(spans) / len(spans) / blocks, instructions_of_node


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("cubins", nargs="+")
    parser.add_argument("--cuobjdump", default="cuobjdump")
    parser.add_argument("--threads", type=int, default=512)
    a = parser.parse_args()
    warps, blocks = a.threads // 32, 512 // a.threads
    for cubin in a.cubins:
        loop = node_loop(instructions(a.cuobjdump, cubin, "psf_scatter_128"))
        for in_l1 in (True, False):
            row = []
            for l2 in (24, 32, 64):
                cycles, count = simulate(loop, warps, blocks, l2, in_l1)
                row.append(f"L2 {l2} B/cycle: {cycles:5.0f} ({100 * count / 4 / cycles:3.0f} %)")
            print(f"{cubin.split('/')[-1]:30} {blocks} x {a.threads}: {count} warp instructions, packed in {'L1' if in_l1 else 'L2'}; cycles (share of the issue bound)", "; ".join(row), flush=True)


main()
