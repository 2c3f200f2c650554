"""The Python of README.md runs as it stands, one block after the other; only paths that are somebody else's are others here."""

import re
import shutil
from pathlib import Path

import pkm
import pytest

for needed in ("dask", "distributed", "fsspec", "matplotlib", "pandas", "pyarrow", "scipy", "tqdm", "xarray"):
    pytest.importorskip(needed, reason=f"the package {needed} is not installed")

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)

MARK = {"level": "L6", "robot": "prs3", "size": 1.0, "ran": True, "is_alarm": False}


def blocks():
    return BLOCK.findall((ROOT / "python" / "README.md").read_text(encoding="utf-8"))


@pytest.fixture
def elsewhere(tmp_path, monkeypatch, fleet_root):
    """A folder that holds what README.md takes to be there."""
    monkeypatch.chdir(tmp_path)
    controllers = Path("docs/examples/controllers")
    shutil.copytree(ROOT / controllers, tmp_path / controllers)
    shutil.copytree(fleet_root, tmp_path / "bucket" / "robots")
    robot = pkm.robots.load("prs3")
    (tmp_path / "bag").mkdir()
    pkm.write(tmp_path / "bag" / "bag_0.mcap", pkm.simulate(robot, robot, seed=5, duration_s=2.0))
    # Forty trials take an hour: test_prove runs some.
    monkeypatch.setattr(pkm.prove, "trials", lambda out, *, cases, seed: [MARK])
    monkeypatch.setattr(pkm.prove, "results", lambda path: [MARK])
    return tmp_path


def test_every_block_of_python_runs(elsewhere):
    pytest.importorskip("matplotlib").use("Agg")
    others = {"s3://bucket/": f"{elsewhere}/bucket/", 'scheduler="tcp://10.0.0.1:8786"': "workers=0"}
    names = {}
    texts = blocks()
    assert len(texts) >= 7
    for text in texts:
        for theirs, ours in others.items():
            text = text.replace(theirs, ours)
        if "time, {" in text:
            first = names["first"]
            names |= {"time": first.time, "q": first["q.q1"], "tau": first["tau.q1"]}
        exec(compile(text, "python/README.md", "exec"), names)
    # What the blocks leave is what their comments say.
    assert names["report"].verdict["findings"][0]["effect"] == "friction_coulomb"
    assert (elsewhere / "report.html").exists() and (elsewhere / "verdict.json").exists()
    # Of 10 mm; the friction that the controller does not know stops q1 short of it.
    assert abs(names["plant"].q - names["goal"]).max() < 4e-3
    assert {"robot3", "robot7"} <= set(names["rows"]["unit"])
    assert names["jacobian"].shape == (100, 6, names["robot"].nv)
