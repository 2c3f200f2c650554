"""Blind trials (docs/PROOF.md) from Python: the program `pkm prove` makes, seals, diagnoses and judges; here it is run, read and counted."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

Marks: TypeAlias = "dict[str, Any]"
"""What came of one case: `is_detected`, `is_first_right`, `is_alarm`, `size`, `level`, ...; the keys of results.json."""

HEALTHY = ("L6", "L7")
"""Levels at which nothing is concealed."""

OUTSIDE = "L5"
"""Level at which something is concealed that the catalogue has no name for."""


class Share(NamedTuple):
    """So many of so many, with Wilson's 95 % interval; all NaN of none."""

    yes: int
    n: int
    share: float
    lower: float
    upper: float


def trials(
    folder: str | os.PathLike[str],
    *,
    cases: int | None = None,
    seed: int = 1,
    levels: Sequence[str] = (),
    robots: Sequence[str] = (),
    sizes: Sequence[float] = (),
    jobs: int = 1,
    resume: bool = False,
    seal_only: bool = False,
    program: str | os.PathLike[str] | None = None,
) -> list[Marks]:
    """Makes, seals, diagnoses and judges so many cases with the program `pkm`; without `cases`, those that lie in the folder.

    The marks of every case are returned, none with `seal_only`. `program`: path of pkm; what `PKM_PROGRAM` says or the search path has,
    if not given. What the program refuses is a ValueError with its own words. Ctrl-C stops it; `resume` goes on.
    """
    path = program or os.environ.get("PKM_PROGRAM") or shutil.which("pkm")
    if path is None or shutil.which(path) is None:
        raise FileNotFoundError(f"program {os.fspath(path or 'pkm')!r} is not there: cargo install --locked --path crates/pkm")
    words = [os.fspath(path), "prove", "--out", os.fspath(folder), "--jobs", str(jobs), "--quiet"]
    words += [] if cases is None else ["--cases", str(cases), "--seed", str(seed)]
    for flag, values in (("--level", levels), ("--robot", robots), ("--size", sizes)):
        words += [word for value in values for word in (flag, str(value))]
    words += ["--resume"] * resume + ["--seal-only"] * seal_only
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        told = [line for line in done.stderr.splitlines() if line.strip()]
        raise ValueError(told[0] if told else f"pkm prove ended with {done.returncode}")
    return [] if seal_only else results(Path(folder) / "results.json")


def results(path: str | os.PathLike[str]) -> list[Marks]:
    """The marks in a results.json that `pkm prove` has written."""
    text = json.loads(Path(path).read_text(encoding="utf-8"))
    if not isinstance(text, dict) or text.get("schema") != "pkm.proof/1":
        raise ValueError(f"{os.fspath(path)}: schema must be pkm.proof/1")
    cases: list[Marks] = text["cases"]
    return cases


def seals(folder: str | os.PathLike[str]) -> dict[str, str]:
    """The seals of a run: SHA-256 of the answers by name of the case."""
    path = Path(folder) / "seals.txt"
    out = {}
    for i, line in enumerate(path.read_text(encoding="utf-8").splitlines()):
        parts = line.split()
        if len(parts) != 2 or len(parts[0]) != 64 or not parts[1].endswith(".json"):
            raise ValueError(f"{path}: line {i + 1}: not a seal: 64 hexadecimal digits, two spaces, NAME.json")
        out[parts[1].removesuffix(".json")] = parts[0]
    return out


def broken(folder: str | os.PathLike[str]) -> list[str]:
    """Names of the cases whose answers are not those that were sealed: none, in an honest run."""
    answers = Path(folder) / "answers"
    return [name for name, seal in seals(folder).items() if hashlib.sha256((answers / f"{name}.json").read_bytes()).hexdigest() != seal]


def share(yes: int, n: int) -> Share:
    """So many of so many, with Wilson's 95 % interval."""
    if n == 0:
        return Share(0, 0, math.nan, math.nan, math.nan)
    z, p = 1.959963984540054, yes / n
    middle, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return Share(yes, n, p, max((middle - half) / (1 + z * z / n), 0.0), min((middle + half) / (1 + z * z / n), 1.0))


def count(marks: Sequence[Marks]) -> dict[str, Share]:
    """The scores of docs/PROOF.md over these marks; those of a level, robot or size are of the marks that one picks.

    `first_right`, `in_set`, `place_right` and `detected` are of cases with something concealed that has a name, `false_alarms` of those with
    nothing, `unexplained` and `impostors` of those whose physics has no name, `ran` of all.
    """
    named = [m for m in marks if m["level"] not in (*HEALTHY, OUTSIDE)]
    healthy, outside = ([m for m in marks if m["level"] in levels] for levels in (HEALTHY, (OUTSIDE,)))

    def of(chosen: Sequence[Marks], key: str) -> Share:
        return share(sum(bool(m[key]) for m in chosen), len(chosen))

    return {
        "ran": of(marks, "ran"),
        "first_right": of(named, "is_first_right"),
        "in_set": of(named, "is_in_set"),
        "place_right": of(named, "is_place_right"),
        "detected": of(named, "is_detected"),
        "false_alarms": of(healthy, "is_alarm"),
        "unexplained": of(outside, "is_flagged"),
        "impostors": of(outside, "is_impostor"),
    }


def by(marks: Sequence[Marks], key: str | Callable[[Marks], Any]) -> dict[Any, list[Marks]]:
    """Marks in groups: by a key of theirs (`level`, `robot`), or by what a function says of each."""
    of = key if callable(key) else lambda m: m[key]
    groups: dict[Any, list[Marks]] = {}
    for m in marks:
        groups.setdefault(of(m), []).append(m)
    return groups
