"""A fleet on a cluster: the table is that of one process, and what it has is not made again."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pkm
import pytest
from fleets import record, robot_folder, same

for needed in ("dask", "distributed", "fsspec", "pandas", "pyarrow", "scipy"):
    pytest.importorskip(needed, reason=f"the package {needed} is not installed")

import distributed
from pkm import fleet


def test_a_folder_is_found_as_tasks(fleet_root):
    tasks = fleet.find(str(fleet_root))
    assert [(t.unit, t.taken) for t in tasks] == [
        ("robot3", "2026-02-16"),
        ("robot7", "2026-02-17"),
        ("robot7", "2026-03-03"),
        ("robot9", "2026-03-04"),
        ("robot9", "2026-03-05"),
    ]
    assert tasks[0].robot == str(fleet_root / "robot3" / "robot.toml")
    assert tasks[0].recordings == (str(fleet_root / "robot3" / "2026-02-16" / "A.csv"),)
    assert tasks[0].holdout == (str(fleet_root / "robot3" / "2026-02-16" / "holdout.csv"),)


def test_recordings_without_a_robot_are_refused(tmp_path):
    record(tmp_path / "lost" / "2026-01-01", 0.0, 1, duration_s=0.5)
    with pytest.raises(ValueError, match=r"lost/2026-01-01: recordings, but no robot.toml"):
        fleet.find(str(tmp_path))
    robot = robot_folder(tmp_path / "other", "robot1")
    record(robot, 0.0, 1, names=("holdout",), duration_s=0.5)
    with pytest.raises(ValueError, match="none to learn from"):
        fleet.find(str(tmp_path / "other"))
    with pytest.raises(ValueError, match="sequence of one or more"):
        fleet.Task("robot.toml", "A.csv")
    for wrong in ("March", "2026-02-30", "20260301"):
        with pytest.raises(ValueError, match=f"taken = '{wrong}'"):
            fleet.Task("robot.toml", ["A.csv"], taken=wrong)


def test_a_folder_that_is_not_there_or_empty_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError) as error:
        fleet.find(str(tmp_path / "none"))
    assert str(error.value) == f"{tmp_path / 'none'}: no such folder"
    with pytest.raises(FileNotFoundError, match="memory://none: no such folder"):
        fleet.find("memory://none")
    # Looking for it does not make it.
    assert not list(tmp_path.iterdir())
    robot_folder(tmp_path, "robot1")
    (tmp_path / "robot1" / "notes.txt").touch()
    for folder in (tmp_path, tmp_path / "robot1"):
        with pytest.raises(ValueError) as error:
            fleet.find(str(folder))
        assert str(error.value) == f"{folder}: no recordings there or below (.csv, .mcap)"


def test_the_day_is_a_day(tmp_path):
    """A number that only looks like one is part of a name."""
    robot = robot_folder(tmp_path, "robot1")
    record(robot / "2026-13-01" / "2026-03-04", 0.0, 1, names=("A",), duration_s=0.5)
    record(robot / "batch 2026-99-99", 0.0, 2, names=("A",), duration_s=0.5)
    assert [t.taken for t in fleet.find(str(tmp_path))] == ["2026-03-04", ""]


def test_a_row_is_the_verdict_of_its_recordings(fleet_root, diagnosed):
    row = diagnosed[(diagnosed["unit"] == "robot7") & (diagnosed["taken"] == "2026-03-03")].iloc[0]
    day = fleet_root / "robot7" / "2026-03-03"
    robot = pkm.load(fleet_root / "robot7" / "robot.toml")
    report = pkm.diagnose(robot, pkm.read(day / "A.csv"), holdout=pkm.read(day / "holdout.csv"))
    assert json.loads(row["answer"]) == report.verdict
    assert row["rms_final"] == report.verdict["heldout"]["rms_final"]
    assert list(row["findings"]) == ["friction_coulomb@shoulder_left"]
    [quantity] = row["quantities"]
    assert (quantity["name"], quantity["unit"]) == ("friction_coulomb@shoulder_left.coulomb", "N·m")
    assert quantity["lower"] < quantity["value"] < quantity["upper"]


def test_a_row_says_where_it_comes_from(fleet_root, diagnosed):
    row = diagnosed.iloc[0]
    path = fleet_root / "robot3" / "2026-02-16" / "A.csv"
    told = subprocess.run(["sha256sum", path], capture_output=True, text=True, check=False)
    if told.returncode == 0:
        assert row["recordings_sha256"][0] == told.stdout.split()[0]
    assert row["recordings"][0] == str(path) and len(row["robot_sha256"]) == 64
    assert row["pkm_version"] == pkm.__build__ and row["settings"] == "{}" and row["kind"] == "diagnose"
    age = (fleet._compare.need("pandas").Timestamp.now(tz="UTC") - row["finished"]).total_seconds()
    assert 0 <= age < 3600 and row["seconds"] > 0
    # The three robots have the same files.
    assert diagnosed["robot_sha256"].nunique() == 1 and diagnosed["key"].nunique() == len(diagnosed) == 5


def test_a_damaged_recording_is_a_row_with_an_error(fleet_root, diagnosed):
    bad = diagnosed[diagnosed["status"] == "error"]
    assert list(bad["taken"]) == ["2026-03-05"]
    with pytest.raises(ValueError) as error:
        pkm.read(fleet_root / "robot9" / "2026-03-05" / "A.csv")
    assert bad.iloc[0]["error"] == str(error.value) and "line 301" in bad.iloc[0]["error"]
    assert (diagnosed["status"] != "error").sum() == 4


def test_a_second_run_does_what_is_new(tmp_path):
    root, table = tmp_path / "fleet", str(tmp_path / "t.parquet")
    robot = robot_folder(root, "robot1")
    for k in range(3):
        record(robot / f"2026-01-0{k + 1}", 0.1, k)
    first = fleet.identify(fleet.find(str(root)), table, workers=0)
    again = fleet.identify(fleet.find(str(root)), table, workers=0)
    assert len(first) == 3 and first["finished"].equals(again["finished"])
    record(robot / "2026-01-04", 0.2, 9)
    third = fleet.identify(fleet.find(str(root)), table, workers=0)
    assert len(third) == 4 and list(third["finished"][:3]) == list(first["finished"])
    # The same bytes elsewhere are the same work; with other settings, or for another robot, they are not.
    moved = robot.rename(root / "robot1 moved")
    tasks = [fleet.Task(t.robot, t.recordings, t.holdout, unit="robot1", taken=t.taken) for t in fleet.find(str(root))]
    assert fleet.identify(tasks, table, workers=0)["finished"].equals(third["finished"])
    moved.rename(robot)
    fourth = fleet.identify(fleet.find(str(root))[:1], table, workers=0, settings={"method": "wls"})
    assert len(fourth) == 5 and set(fourth["settings"]) == {"{}", '{"method": "wls"}'}
    # Nor is it other work when its series wait elsewhere.
    judged = str(tmp_path / "judged.parquet")
    found = fleet.diagnose(fleet.find(str(root))[:1], judged, workers=0)
    elsewhere = fleet.diagnose(fleet.find(str(root))[:1], judged, workers=0, settings={"scratch": str(tmp_path)})
    assert len(elsewhere) == 1 and elsewhere["finished"].equals(found["finished"]) and set(elsewhere["settings"]) == {"{}"}
    lacking = fleet.diagnose(fleet.find(str(root))[:1], str(tmp_path / "b"), workers=0, settings={"scratch": str(tmp_path / "no")})
    assert "must be a folder that is there" in lacking["error"][0]
    record(robot / "2026-01-01", 0.5, 9)
    fifth = fleet.identify(fleet.find(str(root))[:1], table, workers=0)
    assert len(fifth) == 6


def test_another_build_makes_its_own_rows(fleet_root, tmp_path, monkeypatch):
    """The version stays the same for many commits: rows of an engine that was mended are not those of the one before."""
    tasks, table = fleet.find(str(fleet_root))[:2], str(tmp_path / "t.parquet")
    monkeypatch.setattr(pkm, "__build__", "0.1.0 (000000000001)")
    first = fleet.identify(tasks, table, workers=0)
    assert fleet.identify(tasks, table, workers=0)["finished"].equals(first["finished"])
    monkeypatch.setattr(pkm, "__build__", "0.1.0 (000000000002)")
    both = fleet.identify(tasks, table, workers=0)
    assert len(both) == 4 and both["key"].nunique() == 4
    old, new = (both[both["pkm_version"] == f"0.1.0 (00000000000{k})"].reset_index(drop=True) for k in (1, 2))
    assert old["finished"].equals(first["finished"]) and (new["finished"] > first["finished"].max()).all()
    same(old.drop(columns=["key", "pkm_version"]), new.drop(columns=["key", "pkm_version"]))
    # One recording is one measurement, whoever has worked on it.
    pandas = pytest.importorskip("pandas")
    units = {"unit": "robot3", "against": "robot7"}
    pandas.testing.assert_frame_equal(fleet.compare(both, **units), fleet.compare(new, **units))
    # What cannot be had now is missing, though an earlier build had it.
    gone = fleet.Task(tasks[0].robot, [str(tmp_path / "gone.csv")], unit="robot3")
    shutil.copy(tasks[0].recordings[0], tmp_path / "gone.csv")
    fleet.identify([gone], table, workers=0)
    (tmp_path / "gone.csv").unlink()
    monkeypatch.setattr(pkm, "__build__", "0.1.0 (000000000003)")
    for _ in range(2):
        rows = fleet.identify([gone], table, workers=0, retries=0)
        assert len(rows) == 6 and list(rows[rows["status"] == "lost"]["pkm_version"]) == ["0.1.0 (000000000003)"]


def test_a_fault_of_one_recording_ends_no_run(fleet_root, tmp_path, monkeypatch):
    tasks, identification = fleet.find(str(fleet_root))[:2], pkm.Identification

    def faulty(robot, **settings):
        if not faults:
            return identification(robot, **settings)
        raise faults.pop()

    monkeypatch.setattr(pkm, "Identification", faulty)
    faults = [KeyError("no such part")]
    rows = fleet.identify(tasks, str(tmp_path / "a.parquet"), workers=0)
    assert list(rows["status"]) == ["error", "identified"] and rows["error"][0] == "fault in pkm: KeyError: 'no such part'"
    # No fault of the recording: tried again.
    faults = [MemoryError()]
    rows = fleet.identify(tasks, str(tmp_path / "b.parquet"), workers=0, retries=1)
    assert list(rows["status"]) == ["identified", "identified"]
    for error in (KeyboardInterrupt(), ImportError("a package")):
        faults = [error]
        with pytest.raises(type(error)):
            fleet.identify(tasks, str(tmp_path / "c.parquet"), workers=0)


def test_copies_are_one_row_whoever_is_first(fleet_root, tmp_path):
    [task] = [t for t in fleet.find(str(fleet_root)) if t.unit == "robot3"]
    copy = tmp_path / "copy.csv"
    shutil.copy(task.recordings[0], copy)
    other = fleet.Task(task.robot, [str(copy)], task.holdout, unit="robot3", taken="2026-05-01")
    one, two = (fleet.identify(order, str(tmp_path / name), workers=0) for name, order in (("a", [task, other]), ("b", [other, task])))
    assert len(one) == 1 and list(one["taken"]) == ["2026-02-16"]
    same(one, two)


def test_reading_makes_nothing(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such table"):
        fleet.read(str(tmp_path / "none" / "t.parquet"))
    with pytest.raises(FileNotFoundError, match="no such table"):
        fleet.compare(str(tmp_path / "none" / "t.parquet"), "robot7", since="2026-03-01")
    assert not list(tmp_path.iterdir())


def test_the_folder_of_a_table_is_made_before_work_starts(fleet_root, tmp_path, monkeypatch):
    tasks = fleet.find(str(fleet_root))[:1]
    fleet.identify(tasks, str(tmp_path / "new" / "er" / "t.parquet"), workers=0)
    assert [p.name for p in (tmp_path / "new" / "er").iterdir()] == ["t.parquet"]
    (tmp_path / "file").touch()
    monkeypatch.setattr(fleet._run, "done", lambda *item: pytest.fail("work has started"))
    for path in (tmp_path / "file" / "t.parquet", tmp_path / "file" / "new" / "t.parquet"):
        with pytest.raises(OSError, match="file") as error:
            fleet.identify(tasks, str(path), workers=0)
        assert "\n" not in str(error.value)


def test_a_run_that_was_stopped_goes_on(fleet_root, identified, tmp_path):
    table = str(tmp_path / "t.parquet")

    def stop(share):
        if share > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fleet.identify(fleet.find(str(fleet_root)), table, workers=0, progress=stop)
    kept = fleet.read(table)
    assert len(kept) == 2
    shares = []
    rows = fleet.identify(fleet.find(str(fleet_root)), table, workers=0, progress=shares.append)
    same(rows, identified)
    assert shares == [pytest.approx((k + 1) / 5) for k in range(5)]
    merged = rows.merge(kept, on="key", suffixes=("", "_kept"))
    assert len(merged) == 2 and (merged["finished"] == merged["finished_kept"]).all()


def test_a_scheduler_is_reached_by_its_address(fleet_root, identified, tmp_path):
    """Started by somebody else, in processes of their own; it is there afterwards as well."""
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None, env={"RAYON_NUM_THREADS": "1"}) as cluster:
        address = cluster.scheduler_address
        assert address.startswith("tcp://")
        same(fleet.identify(fleet.find(str(fleet_root)), str(tmp_path / "t.parquet"), scheduler=address), identified)
        with distributed.Client(address) as client:
            assert len(client.nthreads()) == 1


def test_robots_and_recordings_may_be_objects(fleet_root, tmp_path):
    robot = pkm.robots.load("five_bar").with_effect("friction_viscous", "shoulder_left", viscous=0.05)
    day = fleet_root / "robot7" / "2026-03-03"
    task = fleet.Task(robot, [pkm.read(day / "A.csv")], [pkm.read(day / "holdout.csv")], unit="bench", taken="2026-03-03")
    [row] = fleet.identify([task], str(tmp_path / "t.parquet"), workers=1).to_dict("records")
    expected = pkm.Identification(robot).fit(pkm.read(day / "A.csv"), holdout=pkm.read(day / "holdout.csv"))
    assert [q["name"] for q in row["quantities"]] == expected.names_base_
    assert [q["value"] for q in row["quantities"]] == expected.theta_base_.tolist()
    assert pkm.Robot.from_texts(*json.loads(row["answer"]).values()).parameters().tolist() == expected.robot_.parameters().tolist()


def test_a_file_that_is_not_there_is_tried_again(fleet_root, tmp_path):
    task = fleet.find(str(fleet_root))[0]
    later = tmp_path / "later.csv"
    waiting = fleet.Task(task.robot, [str(later)], task.holdout, unit="robot3", taken=task.taken)
    rows = fleet.identify([waiting, task], str(tmp_path / "t.parquet"), workers=1, retries=1)
    assert sorted(rows["status"]) == ["identified", "lost"]
    assert "later.csv" in rows[rows["status"] == "lost"].iloc[0]["error"]
    later.write_bytes((fleet_root / "robot7" / "2026-02-17" / "A.csv").read_bytes())
    rows = fleet.identify([waiting, task], str(tmp_path / "t.parquet"), workers=1)
    assert list(rows["status"]) == ["identified", "identified"]


def test_bad_requests_are_refused(fleet_root, tmp_path):
    tasks = fleet.find(str(fleet_root))[:1]
    (tmp_path / "t.parquet").write_text("no table", encoding="utf-8")
    with pytest.raises(ValueError, match=r"t.parquet: not a table of pkm.fleet") as error:
        fleet.identify(tasks, str(tmp_path / "t.parquet"), workers=0)
    assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match="cannot both be given"):
        fleet.identify(tasks, str(tmp_path / "u.parquet"), workers=1, scheduler="tcp://127.0.0.1:1")
    for wrong in ("retries", "workers"):
        with pytest.raises(ValueError, match=f"{wrong} = -1"):
            fleet.identify(tasks, str(tmp_path / "u.parquet"), **{wrong: -1})
    with pytest.raises(FileNotFoundError, match="no such table"):
        fleet.read(str(tmp_path / "none.parquet"))
    rows = fleet.identify(tasks, str(tmp_path / "u.parquet"), workers=0, settings={"colour": 1})
    assert rows.iloc[0]["status"] == "error" and "colour" in rows.iloc[0]["error"]


def test_what_is_missing_is_installed_from_the_sources():
    """The name pkm on PyPI is another project's: no text of the package may send anybody there."""
    with pytest.raises(ImportError) as error:
        fleet._needs.need("no_such.package")
    assert str(error.value) == "pkm.fleet needs the package no_such: pip install './python[fleet]' at the root of a clone of the project"
    assert "pip install './python[fleet]'" in fleet.__doc__ and "pip install './python[plot]'" in pkm.plot.__doc__
    sources = [path for suffix in ("py", "pyi") for path in Path(pkm.__file__).parent.rglob(f"*.{suffix}")]
    assert len(sources) > 20 and not [path.name for path in sources if "install pkm" in path.read_text(encoding="utf-8")]


def shell(*arguments):
    return subprocess.run([sys.executable, "-m", "pkm.fleet", *map(str, arguments)], capture_output=True, text=True, check=False)


def test_the_command_line(fleet_root, tmp_path):
    told = shell("--help")
    assert told.returncode == 0 and "--scheduler" in shell("diagnose", "--help").stdout and "examples:" in told.stdout
    table = tmp_path / "t.parquet"
    done = shell("identify", fleet_root, "--table", table, "--workers", 1, "--settings", '{"method": "wls"}')
    # One recording is damaged: that is told, and is no reason to stop.
    assert done.returncode == 1, done.stderr
    assert [line.split()[:3] for line in done.stdout.splitlines()][-1] == ["robot9", "2026-03-05", "error"]
    # The table holds more than is asked for: that is told of alone.
    part = shell("identify", fleet_root / "robot7", "--table", table, "--workers", 0, "--settings", '{"method": "wls"}')
    assert part.returncode == 0 and [line.split()[1] for line in part.stdout.splitlines()] == ["2026-02-17", "2026-03-03"]
    assert shell("--version").stdout.strip() == f"pkm {pkm.__build__}"
    compared = shell("compare", table, "robot7", "--since", "2026-03-01")
    assert compared.returncode == 0 and "moved" in compared.stdout and "shoulder_left.coulomb" in compared.stdout
    (tmp_path / "empty").mkdir()
    for wrong, told in [
        (["compare", table, "robot1", "--since", "2026-03-01"], "no unit 'robot1'"),
        (["identify", tmp_path / "none", "--table", tmp_path / "none" / "t.parquet"], "none: no such folder"),
        (["identify", tmp_path / "empty", "--table", tmp_path / "none" / "t.parquet"], "empty: no recordings"),
    ]:
        refused = shell(*wrong)
        assert refused.returncode == 2 and refused.stderr.startswith("error: ") and len(refused.stderr.splitlines()) == 1
        assert told in refused.stderr and not (tmp_path / "none").exists()


def test_the_bench_tells_what_workers_gain():
    told = shell("--bench", "--tasks", "2", "--rounds", "1", "--workers", "2")
    assert told.returncode == 0, told.stderr
    head, one, *many = ([cell.strip() for cell in line.strip("|").split("|")] for line in told.stdout.splitlines() if line.startswith("| "))
    alone, cold, warm = (dict(zip(head, row, strict=True)) for row in (one, *many))
    assert [row["how"] for row in (alone, cold, warm)] == ["one process", "2 workers, from their start", "2 workers that are there"]
    assert alone["efficiency"] == "1.00" and float(alone["processor, s"]) > 0.0
    for row in (cold, warm):
        ratio = float(alone["wall, s"]) / float(row["wall, s"])
        assert float(row["faster"]) == pytest.approx(ratio, rel=0.1) and float(row["efficiency"]) == pytest.approx(ratio / 2, rel=0.1)
        # The same is computed: that takes the processors as long, wherever.
        assert float(row["processor, s"]) > 0.5 * float(alone["processor, s"])
