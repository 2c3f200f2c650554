"""Pictures of one report: measured and modelled efforts, findings, and where the model is off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy

from ._draw import AFTER, BEFORE, FITTED, HELDOUT, MEASURED, finished, matrix_map, new_axes, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .._pkm import Report
    from ..evidence import JointSeries


def joint(report: Report, name: str, *, recording: str | None = None, ax: Axes | None = None) -> Axes:
    """Measured effort of a drive, the model as given, and the refined one; held-out spans are shaded.

    `recording` is the name of one of the report's recordings; the first that holds data out, or else the first, if not given.
    """
    series = _series(report, name, recording)
    ax = new_axes(ax)
    _heldout(ax, series)
    ax.plot(series["time"], series["measured"], color=MEASURED, lw=1.8, label="measured")
    models = [
        (series["nominal"], series["rms_nominal"], BEFORE, "as given"),
        (series["refined"], series["rms_refined"], AFTER, "refined"),
    ]
    for values, rms, color, words in models:
        ax.plot(series["time"], values, color=color, lw=1.1, label=f"{words}: {rms:.3g} {series['unit']} rms off")
    ax.set_xlabel("time [s]")
    ax.set_ylabel(f"effort of {name} [{series['unit']}]")
    ax.set_title(series["recording"], loc="left", fontsize="small")
    ax.margins(x=0)
    return finished(ax)


def finding(report: Report, rank: int, *, ax: Axes | None = None) -> Axes:
    """What the model lacks without the finding of that rank, against the variable that explains it, and the finding's own law."""
    known = {f["rank"]: f for f in report.evidence["findings"]}
    if rank not in known:
        raise ValueError(f"no picture of a finding of rank {rank} (has: {', '.join(map(str, known)) or 'none'})")
    data = known[rank]
    ax = new_axes(ax)
    x, y, heldout = data["x"], data["y"], data["is_heldout"]
    # Few samples as large dots, many as small ones; the law on top is smaller than what it should cover.
    size = float(numpy.clip(160.0 / numpy.sqrt(max(len(x), 1)), 3.0, 8.0))
    for chosen, color, words in [(~heldout, FITTED, "fitted"), (heldout, MEASURED, "held out")]:
        if chosen.any():
            ax.plot(x[chosen], y[chosen], ".", color=color, ms=size, alpha=0.6, mew=0, label=f"measured, {words}", rasterized=True)
    ax.plot(x, data["model"], ".", color=AFTER, ms=0.55 * size, mew=0, label=_title(report, rank), rasterized=True)
    ax.axhline(0.0, color="#888888", lw=0.6, zorder=0)
    ax.set_xlabel(data["x_label"])
    ax.set_ylabel(data["y_label"])
    return finished(ax)


def chain(report: Report, *, ax: Axes | None = None) -> Axes:
    """The verdict's held-out number, from the model as given to the refined one, step by step."""
    steps = report.evidence["chain"]
    ax = new_axes(ax)
    at = numpy.arange(len(steps))
    bars = ax.barh(at, [s["heldout_rms"] for s in steps], color=[BEFORE] + [AFTER] * (len(steps) - 1) if steps else None)
    ax.bar_label(bars, fmt="%.3f", padding=3)
    ax.set_yticks(at, [s["label"] for s in steps])
    ax.invert_yaxis()
    ax.margins(x=0.12)
    ax.set_xlabel("held-out error [fraction of effort rms]")
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def residual(report: Report, name: str, *, recording: str | None = None, ax: Axes | None = None) -> Axes:
    """What the model as given and the refined one leave of a drive's measured effort; `recording` as in `joint`."""
    series = _series(report, name, recording)
    ax = new_axes(ax)
    _heldout(ax, series)
    for key, rms, color, words in [("nominal", "rms_nominal", BEFORE, "as given"), ("refined", "rms_refined", AFTER, "refined")]:
        left = series["measured"] - (series["nominal"] if key == "nominal" else series["refined"])
        size = series["rms_nominal"] if rms == "rms_nominal" else series["rms_refined"]
        ax.plot(series["time"], left, color=color, lw=1.0, label=f"{words}: {size:.3g} {series['unit']} rms")
    ax.axhline(0.0, color="#888888", lw=0.6, zorder=0)
    ax.set_xlabel("time [s]")
    ax.set_ylabel(f"measured less model at {name} [{series['unit']}]")
    ax.set_title(series["recording"], loc="left", fontsize="small")
    ax.margins(x=0)
    return finished(ax)


def regimes(report: Report, *, which: Literal["before", "after"] = "before", ax: Axes | None = None) -> Axes:
    """Where and when the model is off: error over effort by drive and regime, as given (`before`) or with every finding (`after`).

    Both have the same colours; a cell without a sample stays empty.
    """
    if which not in ("before", "after"):
        raise ValueError(f"which = {which!r} (must be before or after)")
    cells = report.evidence["regimes"]
    if not cells:
        raise ValueError("no regimes in the report: its recordings could not be used")
    joints, names = (list(dict.fromkeys(c[key] for c in cells)) for key in ("joint", "regime"))
    values = numpy.full((len(joints), len(names)), numpy.nan)
    for c in cells:
        if c["share"] > 0.0:
            values[joints.index(c["joint"]), names.index(c["regime"])] = c[which]
    top = max((max(c["before"], c["after"]) for c in cells if c["share"] > 0.0), default=1.0)
    ax = new_axes(ax, size=(1.6 + 0.85 * len(names), 1.6 + 0.45 * len(joints)))
    image = matrix_map(ax, values, (joints, names), limits=(0.0, top), words="{:.2f}")
    ax.figure.colorbar(image, ax=ax, label="error over effort, rms", pad=0.02)
    ax.set_title("model as given" if which == "before" else "refined model", loc="left", fontsize="small")
    return ax


def dependence(report: Report, joint: str, signal: str, *, ax: Axes | None = None) -> Axes:
    """What stays unexplained at a drive against one signal: means of stretches of equally many samples with two standard errors.

    A `signal` as the verdict's `depends_on` names it: `… by direction` draws a curve for either direction of motion.
    """
    known = report.evidence["dependences"]
    parts = [signal, f"{signal}, forwards", f"{signal}, backwards"]
    curves = [d for d in known if d["joint"] == joint and d["signal"] in parts]
    if not curves:
        has = ", ".join(f"{d['joint']} on {d['signal']}" for d in known) or "none"
        raise ValueError(f"no dependence of {joint!r} on {signal!r} in the report (has: {has})")
    ax = new_axes(ax)
    for data, colour in zip(curves, (AFTER, BEFORE), strict=False):
        label = data["signal"].removeprefix(f"{signal}, ")
        ax.errorbar(data["x"], data["mean"], yerr=data["error"], fmt="o-", color=colour, ms=4, lw=1.0, capsize=2, label=label)
    if len(curves) > 1:
        ax.legend(fontsize="small")
    ax.axhline(0.0, color="#888888", lw=0.6, zorder=0)
    ax.set_xlabel(signal)
    ax.set_ylabel(f"left unexplained at {joint} [{curves[0]['unit']}]")
    return plain(ax)


def isolability(report: Report, *, effects: Sequence[str] | None = None, ax: Axes | None = None) -> Axes:
    """Which effects these recordings could tell apart: |cosine| of the angle between any two, 1 where they look the same.

    `effects`: names of those that are shown, all if empty; if not given, what was found (in bold) and the twenty that look most like it.
    """
    found = report.verdict["isolability"]
    n = len(found["effects"])
    if not n:
        raise ValueError("no isolability in the report: its recordings could not be used")
    values = numpy.abs(numpy.array(found["cosines"], dtype=float).reshape(n, n))
    if effects is None:
        is_found = numpy.array([e["found"] for e in found["effects"]])
        alike = values[:, is_found].max(axis=1) if is_found.any() else values.sum(axis=1)
        shown = sorted({*numpy.flatnonzero(is_found).tolist(), *numpy.argsort(-alike, kind="stable")[:20].tolist()})
    else:
        unknown = sorted({*effects} - {e["effect"] for e in found["effects"]})
        if unknown:
            raise ValueError(f"no effect {unknown[0]!r} in the report (has: {', '.join(dict.fromkeys(e['effect'] for e in found['effects']))})")
        shown = [k for k, e in enumerate(found["effects"]) if not effects or e["effect"] in effects]
    chosen = [found["effects"][k] for k in shown]
    labels = [f"{e['effect']} at {' '.join(e['where'])}" for e in chosen]
    size = 1.8 + 0.26 * len(shown)
    ax = new_axes(ax, size=(size + 2.4, size + 1.0))
    image = matrix_map(ax, values[numpy.ix_(shown, shown)], (labels, labels), limits=(0.0, 1.0), words="{:.1f}" if len(shown) <= 24 else None)
    ax.tick_params(labelsize="x-small")
    ax.figure.colorbar(image, ax=ax, label="|cosine|", pad=0.02, shrink=0.7)
    for tick, effect in zip(ax.get_yticklabels(), chosen, strict=True):
        tick.set_fontweight("bold" if effect["found"] else "normal")
    return ax


def _series(report: Report, name: str, recording: str | None) -> JointSeries:
    known = report.evidence["joints"]
    of_joint = [s for s in known if s["joint"] == name]
    if not of_joint:
        raise ValueError(f"no joint {name!r} in the report (has: {', '.join(dict.fromkeys(s['joint'] for s in known)) or 'none'})")
    chosen = [s for s in of_joint if recording is None or s["recording"] == recording]
    if not chosen:
        raise ValueError(f"no recording {recording!r} in the report (has: {', '.join(s['recording'] for s in of_joint)})")
    return next((s for s in chosen if len(s["heldout_spans"])), chosen[0])


def _heldout(ax: Axes, series: JointSeries) -> None:
    for i, (start, end) in enumerate(series["heldout_spans"]):
        ax.axvspan(start, end, color=HELDOUT, lw=0, label="held out" if i == 0 else None)


def _title(report: Report, rank: int) -> str:
    found = next((f for f in report.findings if f["rank"] == rank), None)
    return "model" if found is None else f"{found['effect']} at {' '.join(found['where'])}"
