"""Recordings as tables of pandas and datasets of xarray, and back: what `Recording.to_pandas` and its kin call."""

from __future__ import annotations

import importlib
import json
import re
from typing import TYPE_CHECKING, Any

import numpy

if TYPE_CHECKING:
    import pandas
    import xarray

    from ._pkm import Recording, Robot

# Columns that are taken for time where the index is none.
TIME = ("t", "time")
# Names under which loggers keep time in units of their own: `timestamp`, `t [s]`, `stamp`, `Time (ms)`.
LIKE_TIME = re.compile(r"time|stamp|^t(?![a-z0-9.])|^sec(ond)?s?(?![a-z])", re.IGNORECASE)


def _need(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(f"this needs the package {name}: pip install {name}") from error


def _units(recording: Recording, robot: Robot | None) -> dict[str, str]:
    known = {name: robot.unit(name) for name in recording.signals} if robot is not None else {}
    return {name: unit for name, unit in known.items() if unit is not None}


def to_pandas(recording: Recording, robot: Robot | None = None) -> pandas.DataFrame:
    """A column per signal over the index `time`; `attrs` has `name`, `meta` and `units`."""
    index = _need("pandas").Index(recording.time, name="time")
    frame: pandas.DataFrame = _need("pandas").DataFrame({name: recording[name] for name in recording.signals}, index=index)
    frame.attrs.update({"name": recording.name, "meta": recording.meta, "units": _units(recording, robot)})
    return frame


def from_pandas(frame: pandas.DataFrame) -> Recording:
    """Time from the column `t` or `time`, or else the index; every other column is a signal; `attrs` as `to_pandas` writes it.

    An index without a name that counts rows is no time: pandas makes one where it is given none.
    """
    pkm = importlib.import_module("pkm")
    column = next((name for name in TIME if name in frame.columns), None)
    if column is None and frame.index.name is None and frame.index.dtype.kind in "iu":
        like = next((str(name) for name in frame.columns if LIKE_TIME.search(str(name))), None)
        what = "name that of time t" if like is None else f"there is {like!r}: rename it t if it is in seconds or dates"
        raise ValueError(f"no column t in the frame, and its index only counts rows ({what})")
    times = frame.index if column is None else frame[column]
    signals = {str(name): frame[name].to_numpy(float) for name in frame.columns if name != column}
    made: Recording = pkm.Recording(
        _seconds(times.to_numpy()), signals, name=str(frame.attrs.get("name", "recording")), meta=dict(frame.attrs.get("meta", {})) or None
    )
    return made


def to_xarray(recording: Recording, robot: Robot | None = None) -> xarray.Dataset:
    """A variable per signal over `time`, each with its `units`; `attrs` has `name` and `meta`, what the recording says of itself, as JSON."""
    units = _units(recording, robot)
    made: xarray.Dataset = _need("xarray").Dataset(
        {name: ("time", recording[name], {"units": units[name]} if name in units else {}) for name in recording.signals},
        coords={"time": ("time", recording.time, {"units": "s"})},
        # As text: netCDF keeps no mappings.
        attrs={"name": recording.name, "meta": json.dumps(recording.meta)},
    )
    return made


def from_xarray(dataset: xarray.Dataset) -> Recording:
    """Every variable over `time` alone is a signal."""
    pkm = importlib.import_module("pkm")
    if "time" not in dataset.coords:
        raise ValueError(f"no coordinate time in the dataset (has: {', '.join(map(str, dataset.coords)) or 'none'})")
    signals = {str(name): values.to_numpy().astype(float) for name, values in dataset.data_vars.items() if values.dims == ("time",)}
    if not signals:
        raise ValueError("no variable over time alone in the dataset")
    meta = json.loads(dataset.attrs.get("meta", "{}")) or None
    made: Recording = pkm.Recording(_seconds(dataset["time"].to_numpy()), signals, name=str(dataset.attrs.get("name", "recording")), meta=meta)
    return made


def _seconds(times: Any) -> Any:
    """Time stamps and durations as seconds from the first, numbers as they are."""
    if times.dtype.kind in "mM":
        return (times - times[0]) / numpy.timedelta64(1, "s")
    return times.astype(float)
