"""Blind trials from Python: the program is run, its folder read, its marks counted as docs/PROOF.md counts them."""

import hashlib
import json
import math
import os
import re
import shutil
from pathlib import Path

import pytest
from pkm import prove

PAPER = Path(__file__).parents[2] / "docs" / "PROOF.md"


def test_intervals_are_those_of_the_published_tables():
    # "6 % (1/16; 1–28)": share, count, interval, in per cent, as the program has printed them.
    cells = re.findall(r"(\d+) % \((\d+)/(\d+); (\d+)–(\d+)\)", PAPER.read_text(encoding="utf-8"))
    assert len(cells) > 50
    for percent, yes, n, low, high in (map(int, cell) for cell in cells):
        found = prove.share(yes, n)
        assert [100 * found.share, 100 * found.lower, 100 * found.upper] == pytest.approx([percent, low, high], abs=0.51)


def test_intervals_are_wilsons():
    stats = pytest.importorskip("scipy.stats", reason="the package scipy is not installed")
    for yes, n in [(0, 1), (1, 1), (0, 40), (7, 16), (299, 300)]:
        theirs = stats.binomtest(yes, n).proportion_ci(method="wilson")
        assert prove.share(yes, n)[2:] == pytest.approx((yes / n, theirs.low, theirs.high), abs=1e-12)
    assert math.isnan(prove.share(0, 0).share)


def mark(level, **said):
    keys = ("ran", "is_detected", "is_first_right", "is_in_set", "is_place_right", "is_alarm", "is_flagged", "is_impostor")
    return {"level": level, "robot": "prs3", "size": 1.0, **dict.fromkeys(keys, False), **said}


def test_marks_are_counted_where_they_belong():
    marks = [
        mark("L0", ran=True, is_detected=True, is_first_right=True, is_in_set=True, is_place_right=True),
        mark("L3", ran=True, is_detected=True, is_in_set=True),
        mark("L4", ran=True),
        mark("L5", ran=True, is_detected=True, is_flagged=True),
        mark("L6", ran=True, is_alarm=True),
        mark("L7", ran=False),
    ]
    found = {name: share[:2] for name, share in prove.count(marks).items()}
    assert found == {
        "ran": (5, 6),
        "first_right": (1, 3),
        "in_set": (2, 3),
        "place_right": (1, 3),
        "detected": (2, 3),
        "false_alarms": (1, 2),
        "unexplained": (1, 1),
        "impostors": (0, 1),
    }
    groups = prove.by(marks, "level")
    assert [len(groups[level]) for level in ("L0", "L6")] == [1, 1]
    assert {key: len(g) for key, g in prove.by(marks, lambda m: m["level"] < "L5").items()} == {True: 3, False: 3}


PROGRAM = os.environ.get("PKM_PROGRAM") or shutil.which("pkm")


@pytest.mark.skipif(PROGRAM is None, reason="the program pkm is not installed")
def test_the_program_is_run_and_read(tmp_path):
    folder = tmp_path / "proof"
    options = {"cases": 1, "seed": 5, "robots": ["five_bar"], "levels": ["L6"]}
    assert prove.trials(folder, seal_only=True, **options) == []
    assert list(prove.seals(folder)) == ["0001"] and prove.broken(folder) == []
    [found] = prove.trials(folder, resume=True, **options)
    assert found["level"] == "L6" and found["robot"] == "five_bar" and found["concealed"] == []
    verdict = json.loads((folder / "verdicts" / "0001.json").read_text(encoding="utf-8"))
    said = bool(verdict["findings"]) or verdict["unexplained"]["present"] or verdict["status"] != "ok"
    assert prove.count([found])["false_alarms"][:2] == (int(said), 1)
    answer = folder / "answers" / "0001.json"
    answer.write_text(answer.read_text(encoding="utf-8") + " ", encoding="utf-8")
    assert prove.broken(folder) == ["0001"]
    with pytest.raises(ValueError, match="holds a run already"):
        prove.trials(folder, **options)


def test_what_is_wrong_is_told(tmp_path):
    with pytest.raises(FileNotFoundError, match="program 'nowhere/pkm' is not there"):
        prove.trials(tmp_path, program="nowhere/pkm")
    (tmp_path / "results.json").write_text("{}", encoding="utf-8")
    with pytest.raises(ValueError, match="pkm.proof/1"):
        prove.results(tmp_path / "results.json")
    (tmp_path / "seals.txt").write_text("abc  0001.json\n", encoding="utf-8")
    with pytest.raises(ValueError, match="line 1: not a seal"):
        prove.seals(tmp_path)
    seal = hashlib.sha256(b"x").hexdigest()
    (tmp_path / "seals.txt").write_text(f"{seal}  0001.json\n", encoding="utf-8")
    (tmp_path / "answers").mkdir()
    (tmp_path / "answers" / "0001.json").write_bytes(b"x")
    assert prove.broken(tmp_path) == [] and prove.seals(tmp_path) == {"0001": seal}
