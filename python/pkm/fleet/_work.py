"""One task: a robot, its recordings, and the row that comes of them. What runs on a worker; nothing here knows Dask."""

from __future__ import annotations

import hashlib
import json
import posixpath
import re
import socket
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, timezone
from pathlib import Path
from typing import Any

import pkm

from ._needs import need, reaching

# What `pkm.read` takes.
SUFFIXES = (".csv", ".mcap")
# Status of what is tried again next time: files that could not be had, workers that were lost.
LOST = "lost"
# In names of folders and sessions, when something was recorded.
DATE = re.compile(r"(?<!\d)(\d{4}-\d{2}-\d{2})(?!\d)")


@dataclass(frozen=True)
class Task:
    """A robot, recordings of it that belong together, and which robot and day they are of.

    `robot` is the path of a robot.toml or a `pkm.Robot`, `recordings` and `holdout` are paths or `pkm.Recording`s; paths are those of
    fsspec (`/data/a.csv`, `s3://bucket/a.mcap`). `unit` names the one machine among many of its kind, `taken` is an ISO date or time.
    """

    robot: str | pkm.Robot
    recordings: tuple[str | pkm.Recording, ...]
    holdout: tuple[str | pkm.Recording, ...] = ()
    unit: str = ""
    taken: str = ""
    # Paths by name are what a row tells of.
    names: tuple[str, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if isinstance(self.recordings, str) or isinstance(self.holdout, str) or not self.recordings:
            raise ValueError(f"task of {self.unit or 'a robot'}: recordings must be a sequence of one or more")
        if self.taken and not _is_day(self.taken[:10]):
            raise ValueError(f"task of {self.unit or 'a robot'}: taken = {self.taken!r} (must begin with a day like 2026-03-01)")
        object.__setattr__(self, "recordings", tuple(self.recordings))
        object.__setattr__(self, "holdout", tuple(self.holdout))
        object.__setattr__(self, "names", tuple(_name(r) for r in (*self.recordings, *self.holdout)))


def _name(recording: str | pkm.Recording) -> str:
    return recording if isinstance(recording, str) else recording.name


def _path(robot: str | pkm.Robot) -> str:
    return robot if isinstance(robot, str) else robot.name


def _is_day(text: str) -> bool:
    try:
        return date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False


def _day_in(text: str) -> str:
    """The first day in a text, or nothing: what only looks like one would stop a comparison by weeks."""
    return next((day for day in DATE.findall(text) if _is_day(day)), "")


def find(root: str, *, holdout: str = "holdout") -> list[Task]:
    """The tasks below a folder: every folder that holds recordings is one, with the robot.toml in it or in the nearest folder above.

    The unit is the folder of the robot.toml; the day is the first date (`2026-03-02`) in the path below it, or else the recordings' session.
    Files whose name begins with `holdout` are only judged on. A folder of recordings without a robot is an error, and so is a folder that
    is not there or has no recording below it.
    """
    fs, path = need("fsspec").core.url_to_fs(root)
    with reaching(root):
        # Recordings come from elsewhere, and what was listed once would be remembered.
        fs.invalidate_cache()
        names = sorted(name for name in fs.find(path) if not posixpath.basename(name).startswith("."))
        # Stores list nothing where nothing is; those of objects have no folder but by what lies in it.
        if not names and not fs.exists(path):
            raise FileNotFoundError(f"{root}: no such folder")
    robots = {posixpath.dirname(name) for name in names if posixpath.basename(name) == "robot.toml"}
    by_folder: dict[str, list[str]] = {}
    for name in names:
        if name.lower().endswith(SUFFIXES):
            by_folder.setdefault(posixpath.dirname(name), []).append(name)
    if not by_folder:
        raise ValueError(f"{root}: no recordings there or below ({', '.join(SUFFIXES)})")
    tasks = []
    for folder, files in by_folder.items():
        home = next((f for f in _upwards(folder, path) if f in robots), None)
        if home is None:
            raise ValueError(f"{fs.unstrip_protocol(folder)}: recordings, but no robot.toml there or above")
        held = [f for f in files if posixpath.basename(f).startswith(holdout)]
        learned = [f for f in files if f not in held]
        if not learned:
            raise ValueError(f"{fs.unstrip_protocol(folder)}: every recording is held out, none to learn from")
        url = _same_kind(fs, root)
        tasks.append(
            Task(
                url(posixpath.join(home, "robot.toml")),
                tuple(map(url, learned)),
                tuple(map(url, held)),
                unit=posixpath.relpath(home, path) if home != path else posixpath.basename(home),
                taken=_day_in(posixpath.relpath(folder, home)),
            )
        )
    return tasks


def _upwards(folder: str, top: str) -> Iterable[str]:
    yield folder
    while folder != top and posixpath.dirname(folder) != folder:
        folder = posixpath.dirname(folder)
        yield folder


def _same_kind(fs: Any, root: str) -> Any:
    """Paths as the user writes them: with a protocol where the root has one."""
    return fs.unstrip_protocol if "://" in root else str


def fetched(path: str) -> bytes:
    """The bytes behind a path of fsspec; OSError where they cannot be had."""
    with reaching(path):
        fs, name = need("fsspec").core.url_to_fs(path)
        # Not by `open`: that goes by a length which may have been listed before the file grew.
        data: bytes = fs.cat_file(name)
        return data


def sha256(data: bytes) -> str:
    """In hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def _toml(text: str) -> dict[str, Any]:
    try:
        toml = need("tomllib")
    except ImportError:  # Python 3.10
        toml = need("tomli")
    parsed: dict[str, Any] = toml.loads(text)
    return parsed


def _robot_texts(robot: str | pkm.Robot) -> tuple[str, str]:
    """Texts of robot.toml and URDF."""
    if isinstance(robot, pkm.Robot):
        return robot.texts()
    toml = fetched(robot).decode()
    try:
        urdf = _toml(toml)["urdf"]
    except (KeyError, ValueError) as error:
        raise ValueError(f"{robot}: no urdf = \"...\" in it ({error})") from None
    beside = robot.rsplit("/", 1)
    return toml, fetched("/".join([*beside[:-1], str(urdf)])).decode()


def _array_hash(recording: pkm.Recording) -> str:
    digest = hashlib.sha256(recording.time.tobytes())
    for name in recording.signals:
        digest.update(name.encode() + b"\0" + recording[name].tobytes())
    digest.update(json.dumps(recording.meta, sort_keys=True).encode())
    return digest.hexdigest()


def _recording(given: str | pkm.Recording, data: bytes | None) -> pkm.Recording:
    """The recording, named by its path wherever its bytes have come from."""
    if isinstance(given, pkm.Recording):
        return given
    with tempfile.TemporaryDirectory() as folder:
        # The reader goes by the suffix alone.
        path = Path(folder) / ("recording" + posixpath.splitext(given)[1])
        path.write_bytes(data or b"")
        try:
            read = pkm.read(path)
        except (ValueError, OSError) as error:
            raise ValueError(str(error).replace(str(path), given)) from None
    return pkm.Recording(read.time, {name: read[name] for name in read.signals}, name=given, meta=read.meta)


def key_of(kind: str, task: Task, robot: str, recordings: Sequence[str], settings: str) -> str:
    """What makes two rows the same work: build of pkm, kind, settings, the unit, and every byte that went in; not where the files lie."""
    parts = [pkm.__build__, kind, settings, task.unit, robot, str(len(task.recordings)), *recordings]
    return sha256("\n".join(parts).encode())


def done(kind: str, task: Task, settings: str, known: frozenset[str], place: dict[str, Any]) -> dict[str, Any] | str:
    """The row of a task, or its key where a row with that is known; `place` are settings that no answer depends on.

    Bad input is a row with an error, a file that cannot be had an OSError.
    """
    started = time.perf_counter()
    row = _asked(kind, task, settings)
    given = [*task.recordings, *task.holdout]
    data = [fetched(r) if isinstance(r, str) else None for r in given]
    hashes = [_array_hash(r) if isinstance(r, pkm.Recording) else sha256(d or b"") for r, d in zip(given, data, strict=True)]
    try:
        texts = _robot_texts(task.robot)
        robot_hash, reason = sha256("\0".join(texts).encode()), None
    except ValueError as error:
        texts, robot_hash, reason = None, "", error
    n = len(task.recordings)
    row["key"] = key_of(kind, task, robot_hash or str(reason), hashes, settings)
    if row["key"] in known:
        return str(row["key"])
    row |= {"robot_sha256": robot_hash, "recordings_sha256": hashes[:n], "holdout_sha256": hashes[n:]}
    try:
        if texts is None:
            raise reason or ValueError("no robot")
        robot = pkm.Robot.from_texts(*texts)
        recordings = [_recording(r, d) for r, d in zip(given, data, strict=True)]
        row |= _taken(row, recordings)
        row |= _answer(kind, robot, recordings[:n], recordings[n:], json.loads(settings) | place)
    except ValueError as error:
        row |= {"status": "error", "error": str(error)}
    except MemoryError:
        # Of this worker as it is now, not of the recording.
        raise OSError(f"{', '.join(task.names)}: out of memory") from None
    except (OSError, ImportError):
        raise
    except BaseException as error:
        # A fault of the library must not end the run of a thousand recordings; Ctrl-C must.
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        row |= {"status": "error", "error": f"fault in pkm: {type(error).__name__}: {error}"}
    return row | circumstances(time.perf_counter() - started)


def _asked(kind: str, task: Task, settings: str) -> dict[str, Any]:
    """What a row says of the task, whatever comes of it."""
    n = len(task.recordings)
    return {
        "kind": kind,
        "unit": task.unit,
        "taken": task.taken,
        "robot_path": _path(task.robot),
        "recordings": list(task.names[:n]),
        "holdout": list(task.names[n:]),
        "settings": settings,
        "pkm_version": pkm.__build__,
    }


def lost(kind: str, task: Task, settings: str, reason: str) -> dict[str, Any]:
    """The row of a task that was given up."""
    given_up = {"key": lost_key(kind, task, settings), "status": LOST, "error": reason}
    return _asked(kind, task, settings) | given_up | circumstances(0.0)


def lost_key(kind: str, task: Task, settings: str) -> str:
    """Made of names, as the bytes are not known; whichever build gave it up, it is the same that is missing."""
    return sha256("\n".join([LOST, kind, settings, task.unit, _path(task.robot), *task.names]).encode())


def circumstances(seconds: float) -> dict[str, Any]:
    """What a row has that another run of the same work has not."""
    return {"finished": datetime.now(timezone.utc), "seconds": seconds, "worker": socket.gethostname()}


def _taken(row: dict[str, Any], recordings: Sequence[pkm.Recording]) -> dict[str, str]:
    sessions = (str(r.meta.get("session", "")) for r in recordings)
    return {"taken": row["taken"] or next(filter(None, map(_day_in, sessions)), "")}


def _answer(
    kind: str, robot: pkm.Robot, learned: list[pkm.Recording], held: list[pkm.Recording], settings: dict[str, Any]
) -> dict[str, Any]:
    """What the engine says, in columns."""
    try:
        if kind == "diagnose":
            verdict = pkm.diagnose(robot, learned, holdout=held or None, **settings).verdict
            findings = [f"{f['effect']}@{','.join(f['where'])}" for f in verdict["findings"]]
            errors = verdict["heldout"]
            return {
                "robot": robot.name,
                "status": verdict["status"],
                "says": verdict["says"],
                "findings": findings,
                "unexplained": verdict["unexplained"]["present"],
                "rms_nominal": errors["rms_nominal"],
                "rms_final": errors["rms_final"],
                "quantities": [
                    quantity(f"{name}.{key}", value["value"], value["ci95"], value["unit"])
                    for name, f in zip(findings, verdict["findings"], strict=True)
                    for key, value in f["parameters"].items()
                ],
                "answer": json.dumps(verdict),
            }
        found = pkm.Identification(robot, **settings).fit(learned, holdout=held or None)
    except TypeError as error:
        raise ValueError(f"settings of {kind}: {error}") from None
    pairs = found.heldout_.values()
    rms = [(sum(pair[k] ** 2 for pair in pairs) / max(len(pairs), 1)) ** 0.5 for k in (0, 1)]
    toml, urdf = found.robot_.texts()
    return {
        "robot": robot.name,
        "status": found.status_,
        "says": "; ".join(found.notes_),
        "rms_nominal": rms[0],
        "rms_final": rms[1],
        "quantities": [
            quantity(name, value, list(ci), "")
            for name, value, ci in zip(found.names_base_, found.theta_base_.tolist(), found.ci95_.tolist(), strict=True)
        ],
        "answer": json.dumps({"robot.toml": toml, "robot.urdf": urdf}),
    }


def quantity(name: str, value: float, ci95: Sequence[float], unit: str) -> dict[str, Any]:
    """A number that can be compared between rows."""
    return {"name": name, "value": float(value), "lower": float(ci95[0]), "upper": float(ci95[1]), "unit": unit}
