"""How much faster the processes of this machine are together than one, on recordings made for it."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

import pkm

from ._run import diagnose
from ._work import Task


def bench(n_tasks: int, workers: int | None, rounds: int) -> str:
    """A line of Markdown per way of working, the median of so many rounds of each, in turn."""
    n = workers or os.cpu_count() or 1
    # As on the workers: the engine's threads would use the processors that are to be shared out.
    if os.environ.get("RAYON_NUM_THREADS") != "1":
        raise RuntimeError("RAYON_NUM_THREADS must be 1 before Python starts")
    with tempfile.TemporaryDirectory() as folder:
        tasks = _made(Path(folder), n_tasks)
        times: dict[int, list[float]] = {0: [], n: []}
        for k in range(rounds):
            for ways in (0, n):
                start = time.perf_counter()
                rows = diagnose(tasks, str(Path(folder) / f"{ways}-{k}.parquet"), workers=ways)
                times[ways].append(time.perf_counter() - start)
                if len(rows) != n_tasks or (rows["status"] != "ok").any():
                    raise RuntimeError(f"the bench's own recordings were not all diagnosed: {rows['error'].dropna().tolist()}")
    one, many = (statistics.median(times[ways]) for ways in (0, n))
    lines = [
        f"{n_tasks} diagnoses of a five-bar, two recordings of 10 s at 200 Hz each, median of {rounds} rounds, start of the cluster included",
        "",
        "| how | s | tasks/s | faster | efficiency |",
        "|---|---|---|---|---|",
        f"| one process | {one:.1f} | {n_tasks / one:.2f} | 1.00 | 1.00 |",
        f"| {n} workers | {many:.1f} | {n_tasks / many:.2f} | {one / many:.2f} | {one / many / n:.2f} |",
    ]
    return "\n".join(lines)


def _made(folder: Path, n_tasks: int) -> list[Task]:
    robot = pkm.robots.load("five_bar")
    tasks = []
    for i in range(n_tasks):
        truth = robot.with_effect("friction_coulomb", robot.actuators[i % 2], coulomb=0.02 * (1 + i))
        paths = []
        for name in ("A", "V"):
            path = folder / f"{i}{name}.csv"
            pkm.write(path, pkm.simulate(truth, robot, seed=2 * i + (name == "V"), duration_s=10.0, rate_hz=200.0))
            paths.append(str(path))
        tasks.append(Task(robot, (paths[0],), (paths[1],), unit=f"robot{i}"))
    return tasks
