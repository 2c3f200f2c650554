"""The notebooks as files: readable, without outputs, runnable top to bottom as programs; `cargo xtask long` runs them."""

import ast
from pathlib import Path

import pkm
import pytest

nbformat = pytest.importorskip("nbformat", reason="the package nbformat is not installed")

FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_there_are_notebooks():
    assert [path.stem for path in NOTEBOOKS] == ["four_papers", "from_a_rosbag", "own_robot", "real_recording"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_clean(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
    # It begins with what it is, and checks itself somewhere: a run that does not fail says something.
    assert notebook.cells[0].source.startswith("# ")
    assert any("assert " in cell.source for cell in code)
    for cell in code:
        for node in ast.walk(ast.parse(cell.source)):
            # Names of pkm that a notebook uses must be there: a renamed function is noticed here, not in an hour.
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "pkm":
                assert hasattr(pkm, node.attr), node.attr
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "pkm.plot":
                assert hasattr(pkm.plot, node.attr), node.attr
