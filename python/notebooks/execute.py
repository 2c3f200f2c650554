"""Runs the notebooks from a clean kernel each: `python execute.py [--out DIR] [NAME ...]`; exit status 1 if one fails."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

HERE = Path(__file__).parent
# Longest a cell may take [s]: the experiments of four papers are one cell.
TIMEOUT = 3600


def names() -> list[str]:
    """Names of the notebooks beside this file."""
    return sorted(path.stem for path in HERE.glob("*.ipynb"))


# What a notebook prints that had nothing to work on.
SKIPPED = "not here and not to be had"


def execute(name: str, out: Path | None) -> tuple[str, str | None]:
    """Runs one notebook and writes it with its outputs below `out`; how it went, and what went wrong or was not there."""
    notebook = nbformat.read(HERE / f"{name}.ipynb", as_version=4)
    problem = None
    try:
        NotebookClient(notebook, timeout=TIMEOUT, kernel_name="python3").execute()
    except CellExecutionError as error:
        problem = str(error)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        nbformat.write(notebook, out / f"{name}.ipynb")
    if problem is not None:
        return "failed", problem
    printed = "".join(output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", []))
    lacking = [line for line in printed.splitlines() if SKIPPED in line]
    return ("skipped", lacking[0]) if lacking else ("ran", None)


def main() -> int:
    """Does what the command line says."""
    parser = argparse.ArgumentParser(description="Runs the notebooks, each from a clean kernel.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names())} [all]")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where the notebooks go with their outputs")
    given = parser.parse_args()
    unknown = [name for name in given.names if name not in names()]
    if unknown:
        parser.error(f"no notebook {unknown[0]!r}")
    failed = False
    for name in given.names or names():
        start = time.monotonic()
        outcome, why = execute(name, given.out)
        print(f"{name}: {outcome} in {time.monotonic() - start:.0f} s", flush=True)
        if why:
            print(why, file=sys.stderr)
        failed |= outcome == "failed"
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
