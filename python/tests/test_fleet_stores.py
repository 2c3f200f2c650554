"""Recordings, robots and tables that lie elsewhere: in memory, and on a server that speaks S3."""

import logging
import os
import urllib.request

import pytest
from fleets import record

for needed in ("dask", "distributed", "fsspec", "pandas", "pyarrow", "scipy"):
    pytest.importorskip(needed, reason=f"the package {needed} is not installed")

import fsspec
from pkm import fleet


def same_of_other_paths(rows, others):
    """Whether two tables say the same but for where the files lie."""
    paths = ["robot_path", "recordings", "holdout", "error", "worker", "finished", "seconds"]
    left, right = (r.drop(columns=paths).reset_index(drop=True).to_json(double_precision=15) for r in (rows, others))
    assert left == right


def test_files_may_lie_in_memory(fleet_root, identified):
    memory = fsspec.filesystem("memory")
    memory.put(str(fleet_root / "robot7"), "/fleet/robot7", recursive=True)
    try:
        tasks = fleet.find("memory://fleet")
        assert tasks[0].recordings == ("memory:///fleet/robot7/2026-02-17/A.csv",)
        rows = fleet.identify(tasks, "memory://out/verdicts.parquet", workers=2)
        assert memory.exists("/out/verdicts.parquet") and not memory.exists("/out/verdicts.parquet.parts")
        same_of_other_paths(rows, identified[identified["unit"] == "robot7"])
    finally:
        memory.rm("/", recursive=True)


class Remembering(fsspec.get_filesystem_class("file")):
    """As stores that list a folder once."""

    protocol = "remembering"
    listed = {}

    def ls(self, path, detail=False, **_):
        if path not in self.listed:
            self.listed[path] = super().ls(path, detail=True)
        return self.listed[path] if detail else [info["name"] for info in self.listed[path]]

    @classmethod
    def _strip_protocol(cls, path):
        return super()._strip_protocol(path.removeprefix("remembering://"))

    def invalidate_cache(self, path=None):
        self.listed.clear()


def test_what_was_listed_is_listed_again(tmp_path):
    fsspec.register_implementation("remembering", Remembering, clobber=True)
    days = ["2026-01-01", "2026-01-02"]
    (tmp_path / "robot.toml").touch()
    for k, day in enumerate(days):
        (tmp_path / day).mkdir()
        (tmp_path / day / "A.csv").touch()
        assert [t.taken for t in fleet.find(f"remembering://{tmp_path}")] == days[: k + 1]


def served(port):
    """A server of S3 on that port, or any free one with 0, and its address."""
    moto = pytest.importorskip("moto.server", reason="the package moto[s3] is not installed")
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=port, verbose=False)
    server.start()
    return server, f"http://127.0.0.1:{server.get_host_and_port()[1]}"


@pytest.fixture
def s3(monkeypatch):
    """A store with an empty bucket `robots`, known to every process by the environment alone; and its server."""
    pytest.importorskip("s3fs", reason="the package s3fs is not installed")
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server, address = served(0)
    # What is stored is this process's, and outlives its server.
    urllib.request.urlopen(f"{address}/moto-api/reset", data=b"").close()
    for name in [name for name in os.environ if name.startswith(("AWS_", "FSSPEC_"))]:
        monkeypatch.delenv(name)
    for name, value in {
        "AWS_ENDPOINT_URL": address,
        "AWS_ACCESS_KEY_ID": "somebody",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_DEFAULT_REGION": "us-east-1",
        # A server that is not there is asked once.
        "AWS_MAX_ATTEMPTS": "1",
    }.items():
        monkeypatch.setenv(name, value)
    # Instances keep their endpoint.
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    store = fsspec.filesystem("s3", skip_instance_cache=True, use_listings_cache=False)
    store.mkdir("robots")
    yield store, server
    server.stop()
    fsspec.get_filesystem_class("s3").clear_instance_cache()


def test_everything_may_lie_in_a_bucket(fleet_root, identified, s3, tmp_path):
    store, _ = s3
    store.put(str(fleet_root) + "/", "robots/fleet/", recursive=True)
    tasks, table = fleet.find("s3://robots/fleet"), "s3://robots/out/parameters.parquet"
    assert tasks[0].recordings == ("s3://robots/fleet/robot3/2026-02-16/A.csv",) and tasks[0].robot == "s3://robots/fleet/robot3/robot.toml"
    # A run of this process alone, stopped after two rows; then a worker in a process of its own.
    with pytest.raises(ZeroDivisionError):
        fleet.identify(tasks, table, workers=0, progress=lambda share: 1 / (share < 0.3))
    kept = fleet.read(table)
    # Notes of another run, elsewhere, that goes on.
    for part in store.ls("robots/out/parameters.parquet.parts"):
        store.mv(part, part.replace(".parquet.parts/", ".parquet.parts/a"))
    assert fleet.read(table).equals(kept)
    assert len(kept) == 2 and not store.exists("robots/out/parameters.parquet")
    rows = fleet.identify(tasks, table, workers=1)
    same_of_other_paths(rows, identified)
    assert set(kept["finished"]) <= set(rows["finished"])
    assert store.find("robots/out") == ["robots/out/parameters.parquet"]
    damaged = rows.iloc[-1]
    assert damaged["status"] == "error" and damaged["error"].startswith("s3://robots/fleet/robot9/2026-03-05/A.csv line 301")
    # What somebody else puts there is seen, though this process has listed the folder before; and so is that a file has grown since.
    record(tmp_path / "2026-04-01", 0.2, 9)
    store.put(str(tmp_path / "2026-04-01" / "A.csv"), "robots/fleet/robot3/2026-04-01/A.csv")
    tasks = fleet.find("s3://robots/fleet")
    fsspec.filesystem("s3").ls("robots/fleet/robot9/2026-03-05")
    good = (fleet_root / "robot9" / "2026-03-04" / "A.csv").read_bytes()
    store.pipe_file("robots/fleet/robot9/2026-03-05/A.csv", good)
    assert fleet._work.fetched("s3://robots/fleet/robot9/2026-03-05/A.csv") == good
    rows = fleet.identify(tasks, table, workers=0)
    assert list(rows["taken"][:2]) == ["2026-02-16", "2026-04-01"] and len(rows) == 7
    assert sorted(rows[rows["taken"] == "2026-03-05"]["status"]) == ["error", "identified"]
    store.rm("robots/out", recursive=True)
    with pytest.raises(FileNotFoundError, match="no such table"):
        fleet.read(table)


def test_a_bucket_that_is_not_there_is_not_made(fleet_root, s3):
    store, _ = s3
    with pytest.raises(FileNotFoundError, match="no such table"):
        fleet.read("s3://robotz/t.parquet")
    # Neither is what nothing lies below, of whatever name.
    for none in ("s3://robots/none", "s3://robotz/none"):
        with pytest.raises(FileNotFoundError) as error:
            fleet.find(none)
        assert "\n" not in str(error.value)
    with pytest.raises(OSError, match="bucket does not exist"):
        fleet.identify(fleet.find(str(fleet_root))[:1], "s3://robotz/t.parquet", workers=0)
    assert store.ls("") == ["robots"]


@pytest.mark.parametrize("workers", [0, 1])
def test_a_store_that_is_not_reached_loses_no_run(fleet_root, s3, tmp_path, workers):
    """Its library's own errors are no OSError, and not all of them can be pickled."""
    store, server = s3
    there, elsewhere = fleet.find(str(fleet_root))[:2]
    away = fleet.Task(there.robot, ["s3://robots/A.csv"], there.holdout, unit="robot1")
    store.put(there.recordings[0], "robots/A.csv")
    server.stop()
    rows = fleet.identify([away, elsewhere], str(tmp_path / "t.parquet"), workers=workers, retries=0)
    assert list(rows["status"]) == ["lost", "identified"]
    assert rows["error"][0].startswith("s3://robots/A.csv: EndpointConnectionError: ") and "\n" not in rows["error"][0]
    for refused in (fleet.find, fleet.read):
        with pytest.raises(OSError, match="^s3://robots/x: EndpointConnectionError: "):
            refused("s3://robots/x")
    again, _ = served(int(os.environ["AWS_ENDPOINT_URL"].rsplit(":", 1)[1]))
    rows = fleet.identify([away, elsewhere], str(tmp_path / "t.parquet"), workers=workers, retries=0)
    again.stop()
    assert list(rows["status"]) == ["identified", "identified"]
