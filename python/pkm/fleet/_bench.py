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
    """A table of Markdown with a line per way of working, the median of so many rounds of each, in turn.

    `efficiency` is the time of one process over workers times their own time. Beside other work on the machine it says as much about that;
    processor seconds say what the workers' way costs: starting them, moving tasks and rows, and what two cores have in common.
    """
    n = workers or os.cpu_count() or 1
    # As on the workers: the engine's threads would use the processors that are to be shared out.
    if os.environ.get("RAYON_NUM_THREADS") != "1":
        raise RuntimeError("RAYON_NUM_THREADS must be 1 before Python starts")
    load = f", load {os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else ""
    with tempfile.TemporaryDirectory() as folder:
        tasks = _made(Path(folder), n_tasks)
        taken: dict[int, list[tuple[float, float]]] = {0: [], n: []}
        for k in range(rounds):
            for ways in (0, n):
                start, used = time.perf_counter(), _processor()
                rows = diagnose(tasks, str(Path(folder) / f"{ways}-{k}.parquet"), workers=ways)
                taken[ways].append((time.perf_counter() - start, _processor() - used))
                if len(rows) != n_tasks or (rows["status"] != "ok").any():
                    raise RuntimeError(f"the bench's own recordings were not all diagnosed: {rows['error'].dropna().tolist()}")
    (one, one_used), (many, many_used) = ([statistics.median(column) for column in zip(*taken[ways], strict=True)] for ways in (0, n))
    lines = [
        f"{n_tasks} diagnoses of a five-bar, two recordings of 10 s at 200 Hz each; median of {rounds} rounds in turn, start of the cluster "
        f"included; {os.cpu_count()} processors{load}.",
        "",
        "| diagnoses | how | wall, s | tasks/s | faster | efficiency | processor, s | ours / ideal |",
        "|---|---|---|---|---|---|---|---|",
        f"| {n_tasks} | one process | {one:.1f} | {n_tasks / one:.2f} | 1.00 | 1.00 | {one_used:.1f} |  |",
        f"| {n_tasks} | {n} workers | {many:.1f} | {n_tasks / many:.2f} | {one / many:.2f} | {one / many / n:.2f} | {many_used:.1f} | {many * n / one:.2f} |",
    ]
    return "\n".join(lines)


def _processor() -> float:
    """Processor seconds of this process and of its children that have ended."""
    return sum(os.times()[:4])


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
