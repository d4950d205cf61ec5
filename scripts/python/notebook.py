"""Executes example.ipynb and requires that every cell succeeds; `--write` keeps the outputs in the file.

    python notebook.py [--write]
"""

import os
import sys
import warnings
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).resolve().parent
# Above this the pictures do not belong into a repository.
MAX_BYTES = 400_000


def main() -> None:
    warnings.simplefilter("ignore")
    path = HERE / "example.ipynb"
    notebook = nbformat.read(path, as_version=4)
    # Pictures of a moderate size, and no remark on a lens that is traced or not.
    os.environ["PYTHONWARNINGS"] = "ignore"
    os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(HERE)}}).execute()
    shown = {key for cell in notebook.cells for out in cell.get("outputs", []) for key in out.get("data", {})}
    assert {"image/png", "text/html"} <= shown, f"the notebook shows {shown}"
    printed = "".join(out.get("text", "") for cell in notebook.cells for out in cell.get("outputs", []))
    assert "TypeError: run() has no keyword 'lense'; close: lens" in printed, printed
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    text = nbformat.writes(notebook) + "\n"
    assert len(text) < MAX_BYTES, f"{len(text)} bytes with outputs"
    if "--write" in sys.argv[1:]:
        path.write_text(text)
    print(f"{path.name}: {sum(c.cell_type == 'code' for c in notebook.cells)} cells, {len(text)} bytes")


if __name__ == "__main__":
    main()
