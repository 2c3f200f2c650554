"""Workers, schedulers and runs that are killed on the way: the table is that of one process."""

import functools
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import uuid

import pytest
from fleets import record, robot_folder, same

for needed in ("dask", "distributed", "fsspec", "pandas", "psutil", "pyarrow", "scipy"):
    pytest.importorskip(needed, reason=f"the package {needed} is not installed")
if sys.platform == "win32":
    pytest.skip("SIGKILL is of POSIX", allow_module_level=True)

import dask
import distributed
import psutil
from pkm import fleet
from pkm.fleet._work import done

ONE_THREAD = {"RAYON_NUM_THREADS": "1"}


@pytest.fixture(scope="module")
def tasks(fleet_root):
    return fleet.find(str(fleet_root))


def cluster_of(n):
    return distributed.LocalCluster(n_workers=n, threads_per_worker=1, dashboard_address=None, env=ONE_THREAD)


def kill_a_busy_worker(client, killed, stop):
    """Kills the first worker process that has a task, without a word."""
    pids = client.run(os.getpid)
    while not stop.is_set():
        busy = [worker for worker, keys in client.processing().items() if keys and worker in pids]
        if busy:
            time.sleep(0.3)
            os.kill(pids[busy[0]], signal.SIGKILL)
            killed.append(pids[busy[0]])
            return
        time.sleep(0.02)


# All tasks at once, and one per thread: then the others are submitted as those come back.
@pytest.mark.parametrize("ahead", [8, 1])
def test_killed_workers_change_nothing(tasks, diagnosed, tmp_path, monkeypatch, ahead):
    monkeypatch.setattr(fleet._run, "AHEAD", ahead)
    killed, stop, submitted, shares, held = [], threading.Event(), [], [], []

    def told(share):
        shares.append(share)
        held.append(len(submitted) - len(shares))

    with cluster_of(2) as cluster, distributed.Client(cluster) as client:
        submit = client.submit
        monkeypatch.setattr(client, "submit", lambda *a, **k: submitted.append(a) or submit(*a, **k))
        before = set(client.run(os.getpid).values())
        killer = threading.Thread(target=kill_a_busy_worker, args=(client, killed, stop))
        killer.start()
        rows = fleet.diagnose(tasks, str(tmp_path / "verdicts.parquet"), scheduler=client, progress=told)
        stop.set()
        killer.join()
        after = set(client.run(os.getpid).values())
    assert killed and killed[0] in before and killed[0] not in after
    same(rows, diagnosed)
    same(fleet.read(str(tmp_path / "verdicts.parquet")), diagnosed)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["verdicts.parquet"]
    assert shares == [pytest.approx((k + 1) / 5) for k in range(5)]
    # What the scheduler holds when a row has come, before the next is submitted: of five tasks, or of two threads.
    assert held == ([4, 3, 2, 1, 0] if ahead == 8 else [1, 1, 1, 1, 0])


def test_a_cluster_that_grows_is_used(tasks, identified, tmp_path, monkeypatch):
    monkeypatch.setattr(fleet._run, "AHEAD", 1)
    monkeypatch.setattr(fleet._run, "ASK_S", 0.0)
    submitted, held = [], []
    with cluster_of(1) as cluster, distributed.Client(cluster) as client:
        submit = client.submit
        monkeypatch.setattr(client, "submit", lambda *a, **k: submitted.append(a) or submit(*a, **k))

        def told(_):
            held.append(len(submitted) - len(held))
            if len(held) == 1:
                cluster.scale(3)
                client.wait_for_workers(3)

        same(fleet.identify(tasks, str(tmp_path / "t.parquet"), scheduler=client, progress=told), identified)
    assert held == [1, 3, 3, 2, 1]


def doomed(unit, folder, times, kind, task, *rest):
    """Takes its worker with it, for one unit and so many times; a file in `folder` for each."""
    if task.unit == unit and len(os.listdir(folder)) < times:
        (folder / uuid.uuid4().hex).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return done(kind, task, *rest)


@pytest.fixture
def deaths(tmp_path):
    path = tmp_path / "deaths"
    path.mkdir()
    return path


@pytest.mark.parametrize("retries", [0, 1])
def test_a_scheduler_that_gives_up_at_once_is_asked_again(tasks, identified, tmp_path, monkeypatch, deaths, retries):
    """It is somebody else's: what it is told of retries is for errors, a lost worker is none."""
    monkeypatch.setattr(fleet._run, "done", functools.partial(doomed, "robot3", deaths, 1))
    seen, failed = [], fleet._run._failed
    monkeypatch.setattr(fleet._run, "_failed", lambda future: seen.append(future.exception()) or failed(future))
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}), cluster_of(1) as cluster, distributed.Client(cluster) as client:
        rows = fleet.identify(tasks[:1], str(tmp_path / "t.parquet"), scheduler=client, retries=retries)
    assert [type(error) for error in seen] == [distributed.KilledWorker] and len(list(deaths.iterdir())) == 1
    if retries:
        same(rows, identified[:1])
    else:
        [row] = rows.to_dict("records")
        assert row["status"] == "lost" and row["error"].startswith("tried 1 times: the worker was lost")


def test_a_task_that_kills_every_worker_is_given_up_alone(tasks, identified, tmp_path, monkeypatch, deaths):
    """It is tried as often as was said, and takes no other task with it that waits on its worker."""
    monkeypatch.setattr(fleet._run, "done", functools.partial(doomed, "robot3", deaths, 99))
    table = str(tmp_path / "t.parquet")
    rows = fleet.identify(tasks, table, workers=1, retries=1)
    assert len(list(deaths.iterdir())) == 2
    [row] = rows[rows["unit"] == "robot3"].to_dict("records")
    assert row["status"] == "lost" and "tried 2 times: the worker was lost" in row["error"]
    same(rows[rows["unit"] != "robot3"], identified[identified["unit"] != "robot3"])
    monkeypatch.undo()
    # What was given up is tried again, and its row makes room.
    same(fleet.identify(tasks, table, workers=0), identified)


def scheduler(port, file):
    """A scheduler of its own, and its worker: processes."""
    file.unlink(missing_ok=True)
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--host", "127.0.0.1"]
    one = subprocess.Popen([*command, "--port", str(port), "--scheduler-file", str(file)], stderr=subprocess.DEVNULL)
    while not file.exists() or not file.read_text(encoding="utf-8").endswith("}"):
        assert one.poll() is None
        time.sleep(0.05)
    address = json.loads(file.read_text(encoding="utf-8"))["address"]
    command = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    return address, [one, subprocess.Popen(command, stderr=subprocess.DEVNULL, env={**os.environ, **ONE_THREAD})]


@pytest.mark.parametrize("returns", [False, True])
def test_a_scheduler_that_is_killed(tasks, identified, tmp_path, monkeypatch, returns):
    """Its tasks are given to the next at its address; where none comes, the run ends, and its rows are there."""
    monkeypatch.setattr(fleet._run, "AHEAD", 2)
    file, table = tmp_path / "scheduler.json", str(tmp_path / "t.parquet")
    address, processes = scheduler(0, file)
    shares = []

    def told(share):
        shares.append(share)
        if len(shares) == 2:
            processes[0].kill()
            processes[0].wait()
            if returns:
                processes.extend(scheduler(address.rsplit(":", 1)[1], file)[1])

    try:
        # How long a client looks for its scheduler.
        with dask.config.set({"distributed.comm.timeouts.connect": "20s" if returns else "3s"}):
            if returns:
                # No try is used up by that.
                same(fleet.identify(tasks, table, scheduler=address, retries=0, progress=told), identified)
                return
            with pytest.raises(ConnectionError, match="the scheduler was lost"):
                fleet.identify(tasks, table, scheduler=address, progress=told)
    finally:
        for process in processes:
            process.kill()
            process.wait()
    kept = fleet.read(table)
    assert len(kept) == len(shares) < 5 and "lost" not in set(kept["status"])
    same(fleet.identify(tasks, table, workers=0), identified)


@pytest.mark.parametrize("times", [0, 1])
def test_what_somebody_cancels_is_submitted_again(tasks, identified, tmp_path, monkeypatch, times):
    """As a client does that starts its workers anew; not for ever."""
    monkeypatch.setattr(fleet._run, "CANCELLED", times)
    futures, shares = [], []
    with cluster_of(1) as cluster, distributed.Client(cluster) as client:
        submit = client.submit
        monkeypatch.setattr(client, "submit", lambda *a, **k: futures.append(submit(*a, **k)) or futures[-1])

        def told(share):
            shares.append(share)
            if len(shares) == 1:
                client.cancel([future for future in futures if not future.done()], force=True)

        rows = fleet.identify(tasks, str(tmp_path / "t.parquet"), scheduler=client, retries=0, progress=told)
    if times:
        same(rows, identified)
    else:
        gone = rows[rows["status"] == "lost"]
        assert 0 < len(gone) < len(rows) == 5 and gone["error"].str.startswith("cancelled 1 times").all()


def fleet_of_one_day(root, n):
    """So many robots with copies of one recording: different work, made fast."""
    first = robot_folder(root, "robot000")
    record(first / "2026-01-01", 0.3, 1, duration_s=4.0)
    for k in range(1, n):
        shutil.copytree(first, root / f"robot{k:03}")
    return root


def test_a_killed_run_goes_on_from_its_notes(tmp_path):
    root, table = fleet_of_one_day(tmp_path / "fleet", 90), tmp_path / "out" / "t.parquet"
    command = [sys.executable, "-m", "pkm.fleet", "identify", str(root), "--table", str(table), "--workers", "1", "--quiet"]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    parts = table.with_name("t.parquet.parts")
    while not list(parts.glob("*.parquet")):
        assert run.poll() is None
        time.sleep(0.002)
    workers = psutil.Process(run.pid).children(recursive=True)
    run.kill()
    assert run.wait() == -signal.SIGKILL and workers
    kept = fleet.read(str(table))
    # Noted in whole lots, of which one was enough to be killed for.
    assert len(kept) >= fleet._run.NOTE_ROWS and len(kept) < 90 and not table.exists()
    # Nobody goes on computing for a run that is no more.
    gone, still = psutil.wait_procs(workers, timeout=20)
    assert gone and not [p for p in still if p.status() != psutil.STATUS_ZOMBIE]
    (parts / "half.tmp").write_bytes(b"PAR1")
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.returncode == 0 and len(again.stdout.splitlines()) == 90, again.stderr
    rows = fleet.read(str(table))
    same(rows, fleet.identify(fleet.find(str(root)), str(tmp_path / "whole.parquet"), workers=0))
    merged = rows.merge(kept, on="key", suffixes=("", "_kept"))
    assert len(merged) == len(kept) and (merged["finished"] == merged["finished_kept"]).all()
    assert (rows["finished"] > kept["finished"].max()).sum() == 90 - len(kept)
    assert [p.name for p in table.parent.iterdir()] == ["t.parquet"]


def test_a_row_is_noted_while_the_next_takes_its_time(tasks, tmp_path, monkeypatch):
    """A killed run loses seconds, not what was done before a long task."""
    assert fleet._run.NOTE_S == 15.0 and "last 15 s" in fleet.diagnose.__doc__
    monkeypatch.setattr(fleet._run, "NOTE_S", 0.05)
    table, seen = str(tmp_path / "t.parquet"), []

    def slow(kind, task, *rest):
        if seen:
            # Nothing else happens in this process but waiting.
            end = time.monotonic() + 20.0
            while len(fleet._table.Table(table).rows()) < len(seen) and time.monotonic() < end:
                time.sleep(0.01)
            assert sorted(r["key"] for r in fleet._table.Table(table).rows()) == sorted(r["key"] for r in seen)
        seen.append(done(kind, task, *rest))
        return seen[-1]

    monkeypatch.setattr(fleet._run, "done", slow)
    assert len(fleet.identify(tasks[:3], table, workers=0)) == len(seen) == 3


def test_a_store_that_refuses_a_note_ends_the_run(tasks, identified, tmp_path, monkeypatch):
    """At the next row, not after hours; and what it takes in the end is kept."""
    monkeypatch.setattr(fleet._run, "NOTE_S", 0.05)
    add, table, refused = fleet._table.Table.add, str(tmp_path / "t.parquet"), threading.Event()

    def full(self, rows):
        if rows and not refused.is_set():
            refused.set()
            raise OSError(28, "No space left on device")
        add(self, rows)

    def after_it(*item):
        row = done(*item)
        if waits:
            assert refused.wait(20.0)
            time.sleep(0.2)
        waits.append(item)
        return row

    waits = []
    monkeypatch.setattr(fleet._table.Table, "add", full)
    monkeypatch.setattr(fleet._run, "done", after_it)
    with pytest.raises(OSError, match="No space left"):
        fleet.identify(tasks, table, workers=0)
    assert len(waits) == 2 and len(fleet.read(table)) == 2
    monkeypatch.undo()
    same(fleet.identify(tasks, table, workers=0), identified)
