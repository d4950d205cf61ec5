"""Wall seconds of the steps of a trace, from its progress line.

    steps.py LENSCUBE DESIGN [TRACE OPTION…]

Runs `LENSCUBE lens trace DESIGN` on a terminal of its own, 31 bands from 400 to 700 nm if no option is given, and adds up the time between changes of
the step that its progress line shows.
"""

import collections
import os
import pty
import re
import sys
import tempfile
import time

STEP = re.compile(r"\d+ nm: ([A-Za-z ]+) \(\d+ PSFs\)")


def main():
    program, design, *options = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        command = [program, "lens", "trace", design, f"{folder}/lens.zarr"]
        command += options or ["--wavelengths", "400:700:10"]
        child, terminal = pty.fork()
        if child == 0:
            os.execv(program, command)
        seconds, step, start = collections.Counter(), "begin", time.time()
        last = start
        while True:
            try:
                text = os.read(terminal, 65536).decode(errors="replace")
            except OSError:
                break
            if not text:
                break
            for found in STEP.finditer(text):
                now = time.time()
                seconds[step] += now - last
                last, step = now, found.group(1)
        seconds[step] += time.time() - last
        _, status = os.waitpid(child, 0)
        if status:
            sys.exit(f"{command}: exit status {os.waitstatus_to_exitcode(status)}")
    parts = ", ".join(f"{step} {s:.1f}" for step, s in seconds.most_common() if s >= 0.05)
    print(f"{design}: {sum(seconds.values()):.1f} s: {parts}")


if __name__ == "__main__":
    main()
