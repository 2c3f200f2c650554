"""The table of verdicts: one Parquet file, and beside it, while a run is under way, the rows that are done."""

from __future__ import annotations

import io
import itertools
import ntpath
import posixpath
import uuid
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ._needs import need, reaching

if TYPE_CHECKING:
    import pandas

# Columns that differ between two runs of the same work.
CIRCUMSTANCES = ("finished", "seconds", "worker")


def schema() -> Any:
    """Columns and types of the table."""
    pa = need("pyarrow")
    text, texts = pa.string(), pa.list_(pa.string())
    of = pa.struct([("name", text), ("value", pa.float64()), ("lower", pa.float64()), ("upper", pa.float64()), ("unit", text)])
    return pa.schema(
        [
            ("key", text),
            ("unit", text),
            ("taken", text),
            ("kind", text),
            ("status", text),
            ("error", text),
            ("says", text),
            ("robot", text),
            ("findings", texts),
            ("unexplained", pa.bool_()),
            ("rms_nominal", pa.float64()),
            ("rms_final", pa.float64()),
            ("quantities", pa.list_(of)),
            ("answer", text),
            ("robot_path", text),
            ("robot_sha256", text),
            ("recordings", texts),
            ("recordings_sha256", texts),
            ("holdout", texts),
            ("holdout_sha256", texts),
            ("settings", text),
            ("pkm_version", text),
            ("finished", pa.timestamp("us", tz="UTC")),
            ("seconds", pa.float64()),
            ("worker", text),
        ]
    )


class Table:
    """The table at a path of fsspec, for one run at a time. What is written is there complete or not at all."""

    def __init__(self, path: str) -> None:
        """Of `path`, whether it is there or not."""
        self.url = path
        self.fs, self.path = need("fsspec").core.url_to_fs(path)
        self.parts = f"{self.path}.parts"
        # Elsewhere a path begins with a bucket. There are no folders, and a bucket is not ours to make.
        self.has_folders = posixpath.isabs(self.path) or ntpath.isabs(self.path)

    def ready(self) -> None:
        """Makes the folder: where that is refused is known before anything is computed."""
        if self.has_folders:
            with reaching(self.url):
                self.fs.makedirs(posixpath.dirname(self.path), exist_ok=True)

    def names(self) -> list[str]:
        """The files that hold rows."""
        with reaching(self.url):
            # Others write here as well, and what was listed once would be remembered.
            self.fs.invalidate_cache()
            names = [self.path] if self.fs.exists(self.path) else []
            if self.fs.exists(self.parts):
                names += sorted(n for n in self.fs.ls(self.parts, detail=False) if n.endswith(".parquet"))
        return names

    def rows(self) -> list[dict[str, Any]]:
        """Every row, those of a run that was stopped or goes on included; of two with one key the first in the table's order, then the later."""
        found: dict[str, dict[str, Any]] = {}
        try:
            read = [self._read(name) for name in self.names()]
        except FileNotFoundError:
            # A run has ended meanwhile: its notes are in the table now.
            read = [self._read(name) for name in self.names()]
        for row in itertools.chain(*read):
            old = found.get(row["key"])
            # One work twice in a run, as of copied files: which was done first must not show.
            if old is None or (_order(row), old["finished"]) <= (_order(old), row["finished"]):
                found[row["key"]] = row
        return list(found.values())

    def add(self, rows: Sequence[dict[str, Any]]) -> None:
        """Notes rows of a run that goes on."""
        if rows:
            self._write(f"{self.parts}/{uuid.uuid4().hex}.parquet", rows)

    def close(self, rows: Sequence[dict[str, Any]]) -> None:
        """Makes one file of the rows, in an order that does not depend on who was done first, and forgets the notes."""
        self._write(self.path, sorted(rows, key=_order))
        with reaching(self.url):
            if self.fs.exists(self.parts):
                self.fs.rm(self.parts, recursive=True)

    def _read(self, name: str) -> list[dict[str, Any]]:
        pa, parquet = need("pyarrow"), need("pyarrow.parquet")
        with reaching(name):
            data = self.fs.cat_file(name)
        try:
            rows: list[dict[str, Any]] = parquet.read_table(io.BytesIO(data)).to_pylist()
        except (pa.ArrowException, OSError) as error:
            raise ValueError(f"{name}: not a table of pkm.fleet ({str(error).splitlines()[0]})") from None
        if rows and "key" not in rows[0]:
            raise ValueError(f"{name}: not a table of pkm.fleet (no column key)")
        return rows

    def _write(self, name: str, rows: Sequence[dict[str, Any]]) -> None:
        pa, parquet, columns = need("pyarrow"), need("pyarrow.parquet"), schema()
        data = io.BytesIO()
        parquet.write_table(pa.Table.from_pylist([{c: row.get(c) for c in columns.names} for row in rows], schema=columns), data)
        with reaching(self.url):
            if not self.has_folders:
                # An object appears whole, and cannot be renamed but by a copy.
                self.fs.pipe_file(name, data.getvalue())
                return
            # What a killed run leaves half written lies among the notes, and goes with them.
            self.fs.makedirs(self.parts, exist_ok=True)
            beside = f"{self.parts}/{uuid.uuid4().hex}.tmp"
            self.fs.pipe_file(beside, data.getvalue())
            self.fs.mv(beside, name)


def _order(row: dict[str, Any]) -> tuple[Any, ...]:
    return row["unit"] or "", row["taken"] or "", row["kind"], row["recordings"], row["key"]


def frame(rows: Sequence[dict[str, Any]]) -> pandas.DataFrame:
    """Rows as a `pandas.DataFrame`, in the table's order and types."""
    pa, columns = need("pyarrow"), schema()
    ordered = [{c: row.get(c) for c in columns.names} for row in sorted(rows, key=_order)]
    need("pandas")
    out: pandas.DataFrame = pa.Table.from_pylist(ordered, schema=columns).to_pandas()
    return out


def read(path: str) -> pandas.DataFrame:
    """The table at a path of fsspec as a `pandas.DataFrame`, rows of a run that was stopped or goes on included."""
    table = Table(path)
    if not table.names():
        raise FileNotFoundError(f"{path}: no such table")
    return frame(table.rows())
