"""Checks of the program given as the first argument; used by check_interop.py and check_pyramid.py."""
import subprocess
import sys
from pathlib import Path

LENSCUBE = Path(sys.argv[1]).resolve()
GOLDEN = Path(__file__).resolve().parent.parent / "tests" / "golden"
done = 0  # number of checks


def check(condition, message):
    """Ends with exit code 1 and the message unless the condition is true."""
    global done
    done += 1
    if not condition:
        sys.exit(f"check-interop: {message}")


def lenscube(*arguments):
    """Runs the program, which must end with 0."""
    arguments = list(map(str, arguments))
    process = subprocess.run([LENSCUBE, *arguments], capture_output=True, text=True)
    check(process.returncode == 0, f"lenscube {' '.join(arguments)} ended with {process.returncode}: {process.stderr}")
