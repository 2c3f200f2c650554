"""Tasks on a cluster: submitted, tried again where a worker is lost, noted as they finish."""

from __future__ import annotations

import contextlib
import json
import math
import os
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from ..progress import Progress, following
from ._needs import need
from ._table import Table, frame
from ._work import LOST, Task, done, lost, lost_key

if TYPE_CHECKING:
    import pandas

# Tasks that the scheduler holds at a time, per thread of the workers: enough that none waits, few enough that a million are no burden.
AHEAD = 8
# Seconds after which the cluster is asked again how many threads it has.
ASK_S = 5.0
# How often a task may be cancelled, by somebody or as its scheduler is lost, and is submitted anew.
CANCELLED = 5
# Settings that no answer depends on, of each kind of work.
PLACES = {"diagnose": ("scratch",)}
# Rows and seconds after which what is done is noted.
NOTE_ROWS, NOTE_S = 64, 15.0


def diagnose(tasks: Sequence[Task], table: str, **keywords: Any) -> pandas.DataFrame:
    """Diagnoses every task and returns the table, which is also written to `table`, a Parquet file at a path of fsspec.

    Keywords: `settings`, those of `pkm.diagnose` (`band_hz`, `floor`, `seed`, `without`, and `scratch`, a folder of the workers);
    `scheduler`, the address of a Dask scheduler or a `distributed.Client`; without it, a cluster of `workers` processes on this machine
    (one per processor; 0: no cluster, this process alone); `retries`, how often a task is tried again whose worker was lost or whose files
    could not be had (3); `progress`, a callable that takes the share done, or True for a bar.

    The last try after lost workers is made with nothing else of this run on the cluster: no task is given up for what another does to its
    worker. A scheduler that is given tries again as often as it is set to (`distributed.scheduler.allowed-failures`) within every try.

    A row that the table has, of the same unit, bytes, settings and build of pkm, is not made again, wherever the files lie now. Bad input is
    a row with `status` "error" and the reason in `error`; what was given up is "lost", and is tried again next time. A run that is killed
    loses the rows of its last 15 s at most. One run at a time may write a table; its folder is made where there is none.
    """
    return run("diagnose", tasks, table, **keywords)[0]


def identify(tasks: Sequence[Task], table: str, **keywords: Any) -> pandas.DataFrame:
    """Identifies every task; as `diagnose`, with the keywords of `pkm.Identification` as `settings`. Base parameters are `quantities`."""
    return run("identify", tasks, table, **keywords)[0]


def run(
    kind: str,
    tasks: Sequence[Task],
    table: str,
    *,
    settings: dict[str, Any] | None = None,
    scheduler: Any = None,
    workers: int | None = None,
    retries: int = 3,
    progress: Progress = None,
) -> tuple[pandas.DataFrame, set[str]]:
    """The table, and the keys of the rows that are these tasks'."""
    if scheduler is not None and workers is not None:
        raise ValueError("scheduler and workers cannot both be given")
    if retries < 0:
        raise ValueError(f"retries = {retries} (must be >= 0)")
    if workers is not None and workers < 0:
        raise ValueError(f"workers = {workers} (must be >= 0)")
    # Where series of long recordings wait changes no answer: the same work with another folder is the same work.
    place = {name: value for name, value in (settings or {}).items() if name in PLACES.get(kind, ())}
    text, store = json.dumps({k: v for k, v in (settings or {}).items() if k not in place}, sort_keys=True), Table(table)
    store.ready()
    # Keys of other units cannot be this task's: they need not travel to the worker.
    known: dict[str, set[str]] = {}
    for row in store.rows():
        if row["status"] != LOST:
            known.setdefault(row["unit"] or "", set()).add(row["key"])
    work = [(kind, task, text, frozenset(known.get(task.unit, ())), place) for task in tasks]
    with following(progress, f"{kind} {len(work)} tasks") as tell, _Notes(store) as notes:

        def take(item: _Item, outcome: dict[str, Any] | str) -> None:
            notes.take(item, outcome)
            tell(notes.n / len(work))

        if workers == 0:
            for item in work:
                take(item, _alone(item, retries))
        elif work:
            with _client(scheduler, workers, tasks) as client:
                _on_cluster(client, work, retries, take)
    # What was given up once and has come since.
    store.close([row for row in store.rows() if row["key"] not in notes.come])
    return frame(store.rows()), notes.keys


_Item = tuple[str, Task, str, frozenset[str], dict[str, Any]]


class _Notes:
    """Rows on their way into the table: noted when they are many, and by a thread when they have waited, as the next may take an hour."""

    def __init__(self, store: Table) -> None:
        self.store, self.n = store, 0
        self.keys: set[str] = set()
        # Keys under which what is done now would have been lost.
        self.come: set[str] = set()
        self.rows: list[dict[str, Any]] = []
        self.refused: Exception | None = None
        self.lock, self.over = threading.Lock(), threading.Event()
        self.thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> _Notes:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.over.set()
        self.thread.join()
        self.flush()

    def take(self, item: _Item, outcome: dict[str, Any] | str) -> None:
        """The row of a task, or its key where the table has the row."""
        self.n += 1
        self.keys.add(outcome if isinstance(outcome, str) else outcome["key"])
        if isinstance(outcome, str) or outcome["status"] != LOST:
            self.come.add(lost_key(*item[:3]))
        if isinstance(outcome, str):
            return
        with self.lock:
            self.rows.append(outcome)
        if self.refused is not None:
            raise self.refused
        if len(self.rows) >= NOTE_ROWS:
            self.flush()

    def flush(self) -> None:
        """Notes what there is; what the store refuses stays."""
        with self.lock:
            rows, self.rows = self.rows, []
        try:
            self.store.add(rows)
        except BaseException:
            with self.lock:
                self.rows = rows + self.rows
            raise

    def _watch(self) -> None:
        while not self.over.wait(NOTE_S):
            try:
                self.flush()
            except Exception as error:
                # For the next row to tell: whoever waits for it cannot be reached from here.
                self.refused = error
                return


def _alone(item: _Item, retries: int) -> dict[str, Any] | str:
    for left in range(retries, -1, -1):
        try:
            return done(*item)
        except OSError as error:
            if left == 0:
                return lost(*item[:3], str(error))
    raise AssertionError("retries are not negative")


@contextlib.contextmanager
def _client(scheduler: Any, workers: int | None, tasks: Sequence[Task]) -> Iterator[Any]:
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
    in_memory = any(isinstance(p, str) and p.startswith("memory://") for t in tasks for p in (t.robot, *t.recordings, *t.holdout))
    # Threads of the engine and processes of the cluster would share the processors: one thread each.
    options: dict[str, Any] = {"processes": False} if in_memory else {"processes": True, "env": {"RAYON_NUM_THREADS": "1"}}
    # Lost workers are counted here, task by task. They are started anew; on a busy machine that takes longer than the cluster would wait
    # before it does without.
    how = {"distributed.scheduler.allowed-failures": 0, "distributed.deploy.lost-worker-timeout": "10 minutes"}
    with (
        need("dask").config.set(how),
        distributed.LocalCluster(n_workers=n, threads_per_worker=1, dashboard_address=None, **options) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def _on_cluster(client: Any, work: list[_Item], retries: int, take: Callable[[_Item, dict[str, Any] | str], None]) -> None:
    running, room = need("distributed").as_completed(), _room(client)
    left = iter(range(len(work)))
    number_of: dict[str, int] = {}
    tries, cancelled = Counter[int](), Counter[int]()
    last: deque[int] = deque()

    def submit(number: int) -> None:
        try:
            # `done` is not a pure function of its arguments: files change, so nothing may be answered from the scheduler's memory.
            # Its `retries` are of errors alone, not of lost workers.
            future = client.submit(done, *work[number], pure=False, retries=retries)
        finally:
            # A client that has closed would never say what became of the task; and that says nothing of it.
            if client.status in ("closing", "closed"):
                raise ConnectionError("the scheduler was lost; rows that were done are kept, and the same call goes on from there")
        number_of[future.key] = number
        running.add(future)

    def fill() -> None:
        n = next(room)
        while len(number_of) < n and (number := next(left, None)) is not None:
            submit(number)
        if last and not number_of:
            submit(last.popleft())

    fill()
    for future in running:
        number = number_of.pop(future.key)
        if future.status == "finished":
            take(work[number], future.result())
        elif future.status == "cancelled" and cancelled[number] < CANCELLED:
            # By a scheduler or a cluster that was started anew, which is no fault of its tasks.
            cancelled[number] += 1
            submit(number)
        else:
            reason, again = _failed(future)
            tries[number] += again
            if not again:
                take(work[number], lost(*work[number][:3], reason))
            elif tries[number] > retries:
                take(work[number], lost(*work[number][:3], f"tried {tries[number]} times: {reason}"))
            elif tries[number] == retries:
                last.append(number)
            else:
                submit(number)
        fill()


def _room(client: Any) -> Iterator[int]:
    """How many tasks the scheduler may hold, whenever asked: a cluster grows and shrinks."""
    asked, threads = -math.inf, 1
    while True:
        # While the client looks for its scheduler, what was known before has to do.
        if time.monotonic() - asked >= ASK_S and client.status == "running":
            with contextlib.suppress(OSError):
                threads = max(sum(client.nthreads().values()), 1)
            asked = time.monotonic()
        yield AHEAD * threads


def _failed(future: Any) -> tuple[str, bool]:
    """Why a task has no row, and whether it is to be tried again; raises what is no fault of one task."""
    if future.status == "cancelled":
        return f"cancelled {CANCELLED + 1} times, by whoever did or for schedulers that were lost", False
    error = future.exception()
    if isinstance(error, need("distributed").KilledWorker):
        return f"the worker was lost: {error}".splitlines()[0], True
    if isinstance(error, OSError):
        # The scheduler has tried again already.
        return str(error), False
    raise error
