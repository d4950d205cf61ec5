"""Executes example.ipynb and lens.ipynb and requires that every cell succeeds; `--write` keeps the outputs in the files.

    python notebook.py [--write]
"""

import os
import re
import sys
import tempfile
import warnings
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).resolve().parent
# Above this the pictures do not belong into a repository.
MAX_BYTES = 400_000


def check_example(shown: set[str], printed: str) -> None:
    assert {"image/png", "text/html"} <= shown, f"the notebook shows {shown}"
    assert "TypeError: run() has no keyword 'lense'; close: lens" in printed, printed


def check_lens(shown: set[str], printed: str) -> None:
    assert "image/png" in shown, f"the notebook shows {shown}"
    (difference,) = re.findall(r"differ by (\S+)", printed)
    assert float(difference) < 1e-6, printed
    (film, restored), = re.findall(r"RMS error of the film (\S+), of the restored picture (\S+)", printed)
    assert float(restored) < 0.5 * float(film), printed


def execute(path: Path) -> tuple[set[str], str]:
    """Executes a notebook; the types of what it shows, and what it prints."""
    notebook = nbformat.read(path, as_version=4)
    # In another folder than the package's sources, which have no native module: the installed package is used.
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": folder}}).execute()
    shown = {key for cell in notebook.cells for out in cell.get("outputs", []) for key in out.get("data", {})}
    printed = "".join(out.get("text", "") for cell in notebook.cells for out in cell.get("outputs", []))
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    text = nbformat.writes(notebook) + "\n"
    assert len(text) < MAX_BYTES, f"{len(text)} bytes with outputs"
    if "--write" in sys.argv[1:]:
        path.write_text(text)
    print(f"{path.name}: {sum(c.cell_type == 'code' for c in notebook.cells)} cells, {len(text)} bytes")
    return shown, printed


def main() -> None:
    warnings.simplefilter("ignore")
    # Pictures of a moderate size, and no remark on a lens that is traced or not.
    os.environ["PYTHONWARNINGS"] = "ignore"
    os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
    for name, check in (("example", check_example), ("lens", check_lens)):
        check(*execute(HERE / f"{name}.ipynb"))


if __name__ == "__main__":
    main()
