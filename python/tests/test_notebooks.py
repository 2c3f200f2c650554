"""The notebooks as files: readable, without outputs, runnable top to bottom as programs; `cargo xtask long` runs them."""

import ast
import importlib
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


@pytest.fixture
def offline(tmp_path, monkeypatch):
    """No recording, an empty home, and a proxy that answers nobody; the folder of what a reader has fetched."""
    monkeypatch.delenv("PKM_DATA", raising=False)
    for name in ["https_proxy", "HTTPS_PROXY"]:
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.setenv("HOME", str(tmp_path))
    kept = tmp_path / ".cache" / "pkm" / "emps"
    kept.mkdir(parents=True)
    return kept


@pytest.fixture
def execute(monkeypatch):
    """The function that `cargo xtask long` runs notebooks with."""
    pytest.importorskip("nbclient", reason="the package nbclient is not installed")
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module("execute").execute


def test_without_network_the_real_recording_is_skipped_and_said_to_be(offline, execute):
    outcome, why = execute("real_recording", None)
    assert outcome == "skipped" and why.startswith("DATA_EMPS.mat: not here and not to be had")


def test_another_file_than_the_published_one_is_refused(offline, execute):
    (offline / "DATA_EMPS.mat").write_bytes(b"not what was published")
    outcome, why = execute("real_recording", None)
    assert outcome == "failed" and "DATA_EMPS.mat: SHA-256 differs from the one above" in why
