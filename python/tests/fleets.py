"""A fleet in a folder: robots of one kind, recorded on some days, their friction known to the test alone."""

import json
import re
import shutil
from pathlib import Path

import pkm

SHIPPED = Path(__file__).parents[2] / "robots" / "five_bar"


def record(folder, coulomb, seed, names=("A", "holdout"), **scenario):
    """Recordings of a five-bar with that much dry friction more at its left shoulder than its files say."""
    folder.mkdir(parents=True, exist_ok=True)
    robot = pkm.robots.load("five_bar")
    truth = robot.with_effect("friction_coulomb", "shoulder_left", coulomb=coulomb) if coulomb else robot
    for k, name in enumerate(names):
        scenario = {"duration_s": 10.0, "rate_hz": 100.0, **scenario}
        pkm.write(folder / f"{name}.csv", pkm.simulate(truth, robot, seed=10 * seed + k, **scenario))


def robot_folder(root, unit):
    """The files of a five-bar as one robot of the fleet."""
    folder = root / unit
    folder.mkdir(parents=True)
    toml = (SHIPPED / "robot.toml").read_text(encoding="utf-8")
    (folder / "robot.toml").write_text(toml, encoding="utf-8")
    urdf = re.search(r'^urdf\s*=\s*"([^"]+)"', toml, re.MULTILINE).group(1)
    shutil.copy(SHIPPED / urdf, folder / urdf)
    return folder


def fleet_folder(root):
    """Robot 3 as ever; robot 7 rubs more since March; one recording of robot 9 is damaged."""
    three, seven, nine = (robot_folder(root, unit) for unit in ("robot3", "robot7", "robot9"))
    record(three / "2026-02-16", 0.0, 1)
    record(seven / "2026-02-17", 0.0, 2)
    record(seven / "2026-03-03", 0.6, 3)
    record(nine / "2026-03-04", 0.3, 5)
    damaged = nine / "2026-03-05" / "A.csv"
    damaged.parent.mkdir()
    lines = (nine / "2026-03-04" / "A.csv").read_text(encoding="utf-8").splitlines()
    damaged.write_text("\n".join([*lines[:300], "3.0,bro"]), encoding="utf-8")
    return root


def same(rows, others):
    """Whether two tables say the same, to the bit: all but when and where a row was made."""
    from pkm import fleet

    answers = [name for name in rows.columns if name not in fleet.CIRCUMSTANCES]
    assert list(rows.columns) == list(others.columns)
    left, right = (json.loads(r[answers].to_json(orient="records", double_precision=15)) for r in (rows, others))
    assert left == right
