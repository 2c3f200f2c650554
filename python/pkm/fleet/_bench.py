"""How much faster the processes of this machine are together than one, on recordings made for it."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import pkm

from ._needs import need
from ._run import diagnose
from ._work import Task


def bench(n_tasks: int, workers: int | None, rounds: int) -> str:
    """A table of Markdown with a line per way of working, the median of so many rounds of each, in turn.

    `efficiency` is the time of one process over workers times their own time. Beside other work on the machine it says as much about that;
    processor seconds say what the workers' way costs: starting them, moving tasks and rows, and what two cores have in common. The share
    of them that one process needs as well is `of them for the work`.
    """
    n = workers or os.cpu_count() or 1
    # As on the workers: the engine's threads would use the processors that are to be shared out.
    if os.environ.get("RAYON_NUM_THREADS") != "1":
        raise RuntimeError("RAYON_NUM_THREADS must be 1 before Python starts")
    load = f", load {os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else ""
    ways = ("one process", f"{n} workers, from their start", f"{n} workers that are there")
    with tempfile.TemporaryDirectory() as folder:
        tasks = _made(Path(folder), n_tasks)
        taken: dict[str, list[tuple[float, float]]] = {way: [] for way in ways}
        for k in range(rounds):
            for number, way in zip((0, n), ways, strict=False):
                start, used = time.perf_counter(), _processor()
                _done(tasks, Path(folder) / f"{number}-{k}.parquet", workers=number)
                taken[way].append((time.perf_counter() - start, _processor() - used))
        taken[ways[2]] = _warm(tasks, n, rounds, Path(folder))
    lines = [
        f"{n_tasks} diagnoses of a five-bar, two recordings of 10 s at 200 Hz each; median of {rounds} rounds in turn; {os.cpu_count()} processors{load}.",
        "",
        "| diagnoses | how | wall, s | tasks/s | faster | efficiency | processor, s | of them for the work | ours / ideal |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    alone, alone_used = (statistics.median(column) for column in zip(*taken[ways[0]], strict=True))
    for way in ways:
        wall, used = (statistics.median(column) for column in zip(*taken[way], strict=True))
        share = 1 if way == ways[0] else n
        ideal = "" if way == ways[0] else f"{wall * n / alone:.2f}"
        speeds = f"{wall:.1f} | {n_tasks / wall:.2f} | {alone / wall:.2f} | {alone / wall / share:.2f}"
        lines.append(f"| {n_tasks} | {way} | {speeds} | {used:.1f} | {alone_used / used:.2f} | {ideal} |")
    return "\n".join(lines)


def _done(tasks: list[Task], table: Path, **how: Any) -> None:
    rows = diagnose(tasks, str(table), **how)
    if len(rows) != len(tasks) or (rows["status"] != "ok").any():
        raise RuntimeError(f"the bench's own recordings were not all diagnosed: {rows['error'].dropna().tolist()}")


def _warm(tasks: list[Task], n: int, rounds: int, folder: Path) -> list[tuple[float, float]]:
    """Seconds and processor seconds of each round on a cluster whose workers have done something before."""
    distributed = need("distributed")
    cluster = distributed.LocalCluster(
        n_workers=n, threads_per_worker=1, dashboard_address=None, processes=True, env={"RAYON_NUM_THREADS": "1"}
    )
    out = []
    with cluster, distributed.Client(cluster) as client:

        def used_by_all() -> float:
            return _processor() + float(sum(client.run(_processor).values()))

        _done(tasks[: 2 * n], folder / "warm.parquet", scheduler=client)
        for k in range(rounds):
            start, used = time.perf_counter(), used_by_all()
            _done(tasks, folder / f"warm-{k}.parquet", scheduler=client)
            out.append((time.perf_counter() - start, used_by_all() - used))
    return out


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
