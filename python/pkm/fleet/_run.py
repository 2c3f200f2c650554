"""Tasks on a cluster: submitted, tried again where a worker is lost, noted as they finish."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import pkm

from ..progress import Progress, following
from ._needs import need
from ._table import LOST, Table, frame
from ._work import Task, circumstances, done, key_of

if TYPE_CHECKING:
    import pandas

# Tasks that the scheduler holds at a time, per thread of the workers: enough that none waits, few enough that a million are no burden.
AHEAD = 8
# Settings that no answer depends on, of each kind of work.
PLACES = {"diagnose": ("scratch",)}
# Rows and seconds after which what is done is noted.
NOTE_ROWS, NOTE_S = 64, 15.0


def diagnose(tasks: Sequence[Task], table: str, **keywords: Any) -> pandas.DataFrame:
    """Diagnoses every task and returns the table, which is also written to `table`, a Parquet file at a path of fsspec.

    Keywords: `settings`, those of `pkm.diagnose` (`band_hz`, `floor`, `seed`, `without`, and `scratch`, a folder of the workers);
    `scheduler`, the address of a Dask scheduler or a `distributed.Client`; without it, a cluster of `workers` processes on this machine
    (one per processor; 0: no cluster, this process
    alone); `retries`, how often a task is tried again whose worker was lost or whose files could not be had (3); `progress`, a callable
    that takes the share done, or True for a bar.

    A row that the table has, of the same unit, bytes, settings and version of pkm, is not made again, wherever the files lie now. Bad input is a row with `status`
    "error" and the reason in `error`; what was given up is "lost", and is tried again next time.
    """
    return _run("diagnose", tasks, table, **keywords)


def identify(tasks: Sequence[Task], table: str, **keywords: Any) -> pandas.DataFrame:
    """Identifies every task; as `diagnose`, with the keywords of `pkm.Identification` as `settings`. Base parameters are `quantities`."""
    return _run("identify", tasks, table, **keywords)


def _run(
    kind: str,
    tasks: Sequence[Task],
    table: str,
    *,
    settings: dict[str, Any] | None = None,
    scheduler: Any = None,
    workers: int | None = None,
    retries: int = 3,
    progress: Progress = None,
) -> pandas.DataFrame:
    if scheduler is not None and workers is not None:
        raise ValueError("scheduler and workers cannot both be given")
    if retries < 0:
        raise ValueError(f"retries = {retries} (must be >= 0)")
    # Where series of long recordings wait changes no answer: the same work with another folder is the same work.
    place = {name: value for name, value in (settings or {}).items() if name in PLACES.get(kind, ())}
    text, store = json.dumps({k: v for k, v in (settings or {}).items() if k not in place}, sort_keys=True), Table(table)
    before = store.rows()
    # Keys of other units cannot be this task's: they need not travel to the worker.
    known: dict[str, set[str]] = {}
    for row in before:
        if row["status"] != LOST:
            known.setdefault(row["unit"] or "", set()).add(row["key"])
    work = [(kind, task, text, frozenset(known.get(task.unit, ())), place) for task in tasks]
    notes = _Notes(store)
    with following(progress, f"{kind} {len(work)} tasks") as tell:
        try:
            if workers == 0:
                for i, item in enumerate(work):
                    notes.take(_alone(item, retries))
                    tell((i + 1) / len(work))
            else:
                with _client(scheduler, workers, tasks, store, retries) as client:
                    _on_cluster(client, work, retries, notes, tell)
        finally:
            notes.flush()
    store.close(_without_lost(store.rows(), work))
    return frame(store.rows())


class _Notes:
    """Rows on their way into the table."""

    def __init__(self, store: Table) -> None:
        self.store, self.rows, self.since = store, list[dict[str, Any]](), time.monotonic()

    def take(self, row: dict[str, Any] | None) -> None:
        if row is not None:
            self.rows.append(row)
        if len(self.rows) >= NOTE_ROWS or time.monotonic() - self.since > NOTE_S:
            self.flush()

    def flush(self) -> None:
        self.store.add(self.rows)
        self.rows, self.since = [], time.monotonic()


_Item = tuple[str, Task, str, frozenset[str], dict[str, Any]]


def _without_lost(rows: list[dict[str, Any]], work: list[_Item]) -> list[dict[str, Any]]:
    """Rows less those that were given up once and have come since."""
    there = {(r["kind"], r["settings"], *r["recordings"], *r["holdout"]) for r in rows if r["status"] != LOST}
    ours = {(kind, settings, *task.names) for kind, task, settings, *_ in work}
    come = there & ours
    return [r for r in rows if not (r["status"] == LOST and (r["kind"], r["settings"], *r["recordings"], *r["holdout"]) in come)]


def _alone(item: _Item, retries: int) -> dict[str, Any] | None:
    for left in range(retries, -1, -1):
        try:
            return done(*item)
        except OSError as error:
            if left == 0:
                return _lost(item, str(error))
    raise AssertionError("retries are not negative")


def _lost(item: _Item, reason: str) -> dict[str, Any]:
    """The row of a task that was given up: its bytes are not known, so its key is made of names."""
    kind, task, settings, *_ = item
    robot = task.robot if isinstance(task.robot, str) else task.robot.name
    return {
        "key": key_of(LOST + kind, task, robot, task.names, settings),
        "kind": kind,
        "unit": task.unit,
        "taken": task.taken,
        "robot_path": robot,
        "recordings": list(task.names[: len(task.recordings)]),
        "holdout": list(task.names[len(task.recordings) :]),
        "settings": settings,
        "pkm_version": pkm.__version__,
        "status": LOST,
        "error": reason,
    } | circumstances(0.0)


@contextlib.contextmanager
def _client(scheduler: Any, workers: int | None, tasks: Sequence[Task], store: Table, retries: int) -> Iterator[Any]:
    """A client of the given scheduler, or of processes on this machine."""
    distributed = need("distributed")
    if isinstance(scheduler, distributed.Client):
        yield scheduler
        return
    if scheduler is not None:
        with distributed.Client(scheduler) as client:
            yield client
        return
    n = workers or os.cpu_count() or 1
    # A file system in memory is that of one process.
    in_memory = any(str(p).startswith("memory://") for t in tasks for p in (t.robot, *t.recordings, *t.holdout))
    # Threads of the engine and processes of the cluster would share the processors: one thread each.
    options: dict[str, Any] = {"processes": False} if in_memory else {"processes": True, "env": {"RAYON_NUM_THREADS": "1"}}
    # A worker that is lost is started anew; on a busy machine that takes longer than the cluster would wait before it does without.
    lost = {"distributed.scheduler.allowed-failures": retries, "distributed.deploy.lost-worker-timeout": "10 minutes"}
    with (
        need("dask").config.set(lost),
        distributed.LocalCluster(n_workers=n, threads_per_worker=1, dashboard_address=None, **options) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def _on_cluster(client: Any, work: list[_Item], retries: int, notes: _Notes, tell: Callable[[float], object]) -> None:
    distributed = need("distributed")
    left = iter(work)
    item_of: dict[str, _Item] = {}
    tries: dict[str, int] = {}

    def submit(item: _Item) -> Any:
        # `done` is not a pure function of its arguments: files change, so nothing may be answered from the scheduler's memory.
        future = client.submit(done, *item, pure=False, retries=retries)
        item_of[future.key] = item
        return future

    threads = max(sum(client.nthreads().values()), 1)
    first = [submit(item) for _, item in zip(range(AHEAD * threads), left, strict=False)]
    running, n_done = distributed.as_completed(first), 0
    for future in running:
        item = item_of.pop(future.key)
        if future.status == "error":
            row, again = _failed(future.exception(), item, tries, retries)
            if again:
                running.add(submit(item))
                continue
        elif future.status == "cancelled":
            row = _lost(item, "the scheduler was lost, or the task was cancelled")
        else:
            row = future.result()
        notes.take(row)
        n_done += 1
        tell(n_done / len(work))
        following_item = next(left, None)
        if following_item is not None:
            running.add(submit(following_item))


def _failed(error: BaseException, item: _Item, tries: dict[str, int], retries: int) -> tuple[dict[str, Any] | None, bool]:
    """The row of a task that failed, or that it is to be tried again."""
    distributed = need("distributed")
    if isinstance(error, distributed.KilledWorker):
        # A scheduler that is not ours gives up after as many lost workers as it pleases.
        name = repr((item[1].unit, item[1].names))
        tries[name] = tries.get(name, 0) + 1
        return _lost(item, f"the worker was lost {tries[name]} times: {error}".splitlines()[0]), tries[name] <= retries
    if isinstance(error, OSError):
        return _lost(item, str(error)), False
    raise error
