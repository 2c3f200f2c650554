"""Blind trials (docs/PROOF.md) from Python: cases made and sealed, diagnosed, scored; folders are those of `pkm prove`."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ._pkm import diagnose as _diagnose
from ._pkm import judge_trial, load, make_trial, read, score_trials
from .progress import Progress, following

Marks = dict[str, Any]
"""What came of one case: `is_detected`, `is_first_right`, `is_alarm`, `size`, `level`, ...; the keys of results.json."""


def make(
    folder: str | os.PathLike[str],
    cases: int,
    *,
    seed: int = 1,
    levels: Sequence[str] = (),
    robots: Sequence[str] = (),
    sizes: Sequence[float] = (0.5, 1.0, 2.0, 4.0),
    progress: Progress = None,
) -> dict[str, str]:
    """Makes so many cases, seals their answers, and returns the seals, SHA-256 by name of the case.

    The cases of a seed are the same everywhere. A folder that holds seals is refused.
    """
    root = Path(folder)
    if (root / "seals.txt").exists():
        raise ValueError(f"{root}: holds a run already")
    if cases < 1:
        raise ValueError(f"cases = {cases} (must be >= 1)")
    seals = {}
    with following(progress, "making cases") as tell:
        for number in range(1, cases + 1):
            name = f"{number:04}"
            files, answer = make_trial(number, seed, levels=list(levels), robots=list(robots), sizes=list(sizes))
            for file, text in files.items():
                _write(root / "cases" / name / file, text)
            _write(root / "answers" / f"{name}.json", answer)
            seals[name] = hashlib.sha256(answer.encode()).hexdigest()
            tell(number / cases)
    _write(root / "seals.txt", "".join(f"{seal}  {name}.json\n" for name, seal in seals.items()))
    return seals


def diagnose(folder: str | os.PathLike[str], *, progress: Progress = None, **settings: Any) -> int:
    """Diagnoses every case that has not been, from its public files alone, and returns how many that were; `settings` as `pkm.diagnose`."""
    root = Path(folder)
    left = [name for name in seals(root) if not (root / "runs" / f"{name}.json").exists()]
    with following(progress, "diagnosing cases") as tell:
        for i, name in enumerate(left):
            ran, verdict = _one(root / "cases" / name, settings)
            if verdict is not None:
                _write(root / "verdicts" / f"{name}.json", json.dumps(verdict))
            _write(root / "runs" / f"{name}.json", json.dumps(ran))
            tell((i + 1) / len(left))
    return len(left)


def _one(case: Path, settings: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    given = _manifest(case / "case.toml")
    start = time.perf_counter()
    try:
        robot = load(case / "robot.toml")
        learned = [read(case / name) for name in given["recordings"]]
        held = [read(case / name) for name in given["holdouts"]]
        verdict: Any = _diagnose(robot, learned, holdout=held or None, **settings).verdict
    except (ValueError, OSError) as error:
        return {"seconds": time.perf_counter() - start, "exit": 2, "error": str(error)}, None
    return {"seconds": time.perf_counter() - start, "exit": 0, "error": ""}, verdict


def _manifest(path: Path) -> dict[str, list[str]]:
    """The two lists of a case.toml; its arrays of plain names are JSON as they stand."""
    out: dict[str, list[str]] = {"recordings": [], "holdouts": []}
    for line in path.read_text(encoding="utf-8").splitlines():
        key, _, value = line.partition("=")
        if key.strip() in out:
            out[key.strip()] = json.loads(value)
    if not out["recordings"]:
        raise ValueError(f"{path}: no recordings = [...] in it")
    return out


def seals(folder: str | os.PathLike[str]) -> dict[str, str]:
    """The seals of a run: SHA-256 of the answers by name of the case."""
    path = Path(folder) / "seals.txt"
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    bad = next((i for i, parts in enumerate(lines) if len(parts) != 2 or len(parts[0]) != 64), None)
    if bad is not None:
        raise ValueError(f"{path}: line {bad + 1}: not a seal: 64 hexadecimal digits, two spaces, NAME.json")
    return {name.removesuffix(".json"): seal for seal, name in lines}


def score(folder: str | os.PathLike[str]) -> list[Marks]:
    """Opens the seals and judges what has been diagnosed: the marks of every case, by `pkm prove` or from here.

    An answer that does not fit its seal is a ValueError: it was changed after it had been sealed.
    """
    root, marks = Path(folder), []
    for name, seal in seals(root).items():
        answer = (root / "answers" / f"{name}.json").read_text(encoding="utf-8")
        if hashlib.sha256(answer.encode()).hexdigest() != seal:
            raise ValueError(f"{root / 'answers' / name}.json: changed after it had been sealed")
        run = root / "runs" / f"{name}.json"
        if run.exists():
            verdict = root / "verdicts" / f"{name}.json"
            text = verdict.read_text(encoding="utf-8") if verdict.exists() else None
            marks.append(json.loads(judge_trial(name, answer, text, run.read_text(encoding="utf-8"))))
    return marks


def markdown(marks: Sequence[Marks]) -> str:
    """The tables of docs/PROOF.md for these marks, with their intervals."""
    return score_trials([json.dumps(m) for m in marks])


def results(path: str | os.PathLike[str]) -> list[Marks]:
    """The marks in a results.json that `pkm prove` has written."""
    text = json.loads(Path(path).read_text(encoding="utf-8"))
    if not isinstance(text, dict) or text.get("schema") != "pkm.proof/1":
        raise ValueError(f"{path}: schema must be pkm.proof/1")
    cases: list[Marks] = text["cases"]
    return cases


def _write(path: Path, text: str) -> None:
    """A file is seen complete or not at all: a run that is stopped can go on."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False, encoding="utf-8") as file:
        file.write(text)
    os.replace(file.name, path)
