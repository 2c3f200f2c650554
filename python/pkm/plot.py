"""Pictures of a report, with matplotlib (`pip install pkm[plot]`). Every function draws into `ax`, or a new figure, and returns it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ._pkm import Report

# Told apart by the colour-blind as well: measured black, before orange, after blue.
MEASURED, FITTED, BEFORE, AFTER, HELDOUT = "#222222", "#b0b0b0", "#d55e00", "#0072b2", "#e8e8e8"


def joint(report: Report, name: str, *, recording: str | None = None, ax: Axes | None = None) -> Axes:
    """Measured effort of a drive, the model as given, and the refined one; held-out spans are shaded.

    `recording` is the name of one of the report's recordings; the first that holds data out, or else the first, if not given.
    """
    known = report.evidence["joints"]
    of_joint = [s for s in known if s["joint"] == name]
    if not of_joint:
        raise ValueError(f"no joint {name!r} in the report (has: {', '.join(dict.fromkeys(s['joint'] for s in known)) or 'none'})")
    chosen = [s for s in of_joint if recording is None or s["recording"] == recording]
    if not chosen:
        raise ValueError(f"no recording {recording!r} in the report (has: {', '.join(s['recording'] for s in of_joint)})")
    series = next((s for s in chosen if len(s["heldout_spans"])), chosen[0])
    ax = _axes(ax)
    for i, (start, end) in enumerate(series["heldout_spans"]):
        ax.axvspan(start, end, color=HELDOUT, lw=0, label="held out" if i == 0 else None)
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
    return _finished(ax)


def finding(report: Report, rank: int, *, ax: Axes | None = None) -> Axes:
    """What the model lacks without the finding of that rank, against the variable that explains it, and the finding's own law."""
    known = {f["rank"]: f for f in report.evidence["findings"]}
    if rank not in known:
        raise ValueError(f"no picture of a finding of rank {rank} (has: {', '.join(map(str, known)) or 'none'})")
    data = known[rank]
    ax = _axes(ax)
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
    return _finished(ax)


def chain(report: Report, *, ax: Axes | None = None) -> Axes:
    """The verdict's held-out number, from the model as given to the refined one, step by step."""
    steps = report.evidence["chain"]
    ax = _axes(ax)
    at = numpy.arange(len(steps))
    bars = ax.barh(at, [s["heldout_rms"] for s in steps], color=[BEFORE] + [AFTER] * (len(steps) - 1) if steps else None)
    ax.bar_label(bars, fmt="%.3f", padding=3)
    ax.set_yticks(at, [s["label"] for s in steps])
    ax.invert_yaxis()
    ax.margins(x=0.12)
    ax.set_xlabel("held-out error [fraction of effort rms]")
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def _title(report: Report, rank: int) -> str:
    found = next((f for f in report.findings if f["rank"] == rank), None)
    return "model" if found is None else f"{found['effect']} at {' '.join(found['where'])}"


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(figsize=(9, 4), layout="constrained")[1]


def _finished(ax: Axes) -> Axes:
    ax.spines[["top", "right"]].set_visible(False)
    # Above the picture: inside, it would cover samples.
    legend = ax.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.06), ncols=4, fontsize="small", borderaxespad=0.0)
    for handle in legend.legend_handles:
        if handle is not None:
            handle.set_alpha(1.0)
    return ax
