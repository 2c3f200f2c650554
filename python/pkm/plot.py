"""Pictures of a report, with matplotlib (`pip install pkm[plot]`). Every function draws into `ax`, or a new figure, and returns it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy

from .prove import share

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage
    from numpy.typing import ArrayLike, NDArray

    from ._pkm import Mu, Recording, Report, Robot
    from .answers import Workspace
    from .evidence import JointSeries
    from .prove import Marks

# Told apart by the colour-blind as well: measured black, before orange, after blue.
MEASURED, FITTED, BEFORE, AFTER, HELDOUT = "#222222", "#b0b0b0", "#d55e00", "#0072b2", "#e8e8e8"


def joint(report: Report, name: str, *, recording: str | None = None, ax: Axes | None = None) -> Axes:
    """Measured effort of a drive, the model as given, and the refined one; held-out spans are shaded.

    `recording` is the name of one of the report's recordings; the first that holds data out, or else the first, if not given.
    """
    series = _series(report, name, recording)
    ax = _axes(ax)
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


def residual(report: Report, name: str, *, recording: str | None = None, ax: Axes | None = None) -> Axes:
    """What the model as given and the refined one leave of a drive's measured effort; `recording` as in `joint`."""
    series = _series(report, name, recording)
    ax = _axes(ax)
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
    return _finished(ax)


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
    ax = _axes(ax, size=(1.6 + 0.85 * len(names), 1.6 + 0.45 * len(joints)))
    image = _map(ax, values, (joints, names), limits=(0.0, top), words="{:.2f}")
    ax.figure.colorbar(image, ax=ax, label="error over effort, rms", pad=0.02)
    ax.set_title("model as given" if which == "before" else "refined model", loc="left", fontsize="small")
    return ax


def dependence(report: Report, joint: str, signal: str, *, ax: Axes | None = None) -> Axes:
    """What stays unexplained at a drive against one signal: means of stretches of equally many samples with two standard errors."""
    known = report.evidence["dependences"]
    data = next((d for d in known if (d["joint"], d["signal"]) == (joint, signal)), None)
    if data is None:
        has = ", ".join(f"{d['joint']} on {d['signal']}" for d in known) or "none"
        raise ValueError(f"no dependence of {joint!r} on {signal!r} in the report (has: {has})")
    ax = _axes(ax)
    ax.errorbar(data["x"], data["mean"], yerr=data["error"], fmt="o-", color=AFTER, ms=4, lw=1.0, capsize=2)
    ax.axhline(0.0, color="#888888", lw=0.6, zorder=0)
    ax.set_xlabel(signal)
    ax.set_ylabel(f"left unexplained at {joint} [{data['unit']}]")
    return _plain(ax)


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
    ax = _axes(ax, size=(size + 2.4, size + 1.0))
    image = _map(ax, values[numpy.ix_(shown, shown)], (labels, labels), limits=(0.0, 1.0), words="{:.1f}" if len(shown) <= 24 else None)
    ax.tick_params(labelsize="x-small")
    ax.figure.colorbar(image, ax=ax, label="|cosine|", pad=0.02, shrink=0.7)
    for tick, effect in zip(ax.get_yticklabels(), chosen, strict=True):
        tick.set_fontweight("bold" if effect["found"] else "normal")
    return ax


def detection(marks: Sequence[Marks], *, bins: Sequence[float] = (0.0, 0.75, 1.5, 3.0, 6.0, 1e9), ax: Axes | None = None) -> Axes:
    """How often blind trials (`pkm.prove`) detect and rightly name what is concealed, by its size, with Wilson's 95 % intervals.

    Sizes are over the smallest that could stand out of the noise; trials without a size are left out.
    """
    if len(bins) < 2 or any(b <= a for a, b in zip(bins, bins[1:], strict=False)):
        raise ValueError(f"bins = {list(bins)} (must be two or more numbers that increase)")
    sized = [m for m in marks if m.get("size") is not None]
    groups = [g for a, b in zip(bins, bins[1:], strict=False) if (g := [m for m in sized if a <= m["size"] < b])]
    if not groups:
        raise ValueError("no trial with a size in these bins")
    ax = _axes(ax, size=(6, 4))
    x = numpy.array([numpy.exp(numpy.mean(numpy.log([m["size"] for m in g]))) for g in groups])
    curves = [("is_detected", MEASURED, "anything said"), ("is_in_set", BEFORE, "among the names"), ("is_first_right", AFTER, "first name right")]
    for k, (key, color, words) in enumerate(curves):
        shares, low, high = numpy.array([share(sum(bool(m[key]) for m in g), len(g))[2:] for g in groups]).T
        # A few per cent apart, so that intervals do not cover each other.
        at = x * 1.04 ** (k - 1)
        # A share of none or all lies on its interval's end, but for rounding.
        spread = numpy.maximum([shares - low, high - shares], 0.0)
        ax.errorbar(at, shares, yerr=spread, fmt="o-", color=color, ms=4, lw=1.2, capsize=2, label=words)
    for at, g in zip(x, groups, strict=True):
        ax.annotate(f"n = {len(g)}", (at, -0.04), ha="center", va="top", fontsize="x-small", color="#888888", annotation_clip=False)
    ax.set_xscale("log")
    ax.set_xticks(x, [f"{at:.2g}" for at in x])
    ax.minorticks_off()
    ax.set_ylim(-0.12, 1.05)
    ax.set_xlabel("size over the smallest that can be detected")
    ax.set_ylabel("share of trials")
    return _finished(ax)


def friction(
    robots: Robot | Mapping[str, Robot],
    joint: str,
    *,
    speed: float | None = None,
    recording: Recording | None = None,
    q: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Effort of a joint's own laws against its velocity, of one robot or of several by name, and behind it, of a `recording`, the
    measured effort of the drive less rigid bodies and rotors of the first robot.

    `speed`: the largest shown; that of the recording, or 1, if not given. `q`: position at which the laws are drawn; that of the assembly.
    The measured effort holds what else the model lacks as well; velocities are those recorded, or slopes of the positions.
    """
    named = dict(robots) if isinstance(robots, Mapping) else {robots.name: robots}
    if not named:
        raise ValueError("no robot")
    first = next(iter(named.values()))
    if joint not in first.joints:
        raise ValueError(f"no joint {joint!r} in the robot (has: {', '.join(first.joints)})")
    ax = _axes(ax)
    if recording is not None:
        v_meas, left = _left_by_bodies(first, recording, joint)
        speed = float(numpy.abs(v_meas).max()) if speed is None else speed
        ax.plot(v_meas, left, ".", color=FITTED, ms=3, mew=0, alpha=0.6, label="measured less rigid bodies", rasterized=True)
    speed = 1.0 if speed is None else speed
    # The two sides apart: at rest friction is not a function of speed.
    v = numpy.concatenate([-numpy.geomspace(speed, 1e-6 * speed, 400), [0.0], numpy.geomspace(1e-6 * speed, speed, 400)])
    for k, (words, robot) in enumerate(named.items()):
        at = float(robot.assemble()[robot.joints.index(joint)]) if q is None else q
        effort = robot.joint_effort(joint, v, q=at)
        effort[v == 0.0] = numpy.nan
        ax.plot(v, effort, color=[AFTER, BEFORE, MEASURED, "#009e73", "#cc79a7"][k % 5], lw=1.4, label=words)
    ax.axhline(0.0, color="#888888", lw=0.6, zorder=0)
    ax.set_xlabel(f"velocity of {joint} [{_rate(first.unit(f'q.{joint}'))}]")
    ax.set_ylabel(f"effort at {joint} [{first.unit(f'tau.{joint}')}]")
    return _finished(ax)


def workspace(
    found: Workspace,
    axes: Mapping[str, ArrayLike],
    *,
    which: Literal["parallel", "serial", "condition"] = "parallel",
    ax: Axes | None = None,
) -> Axes:
    """Singular values, or their ratio, over the reachable part of a workspace of two axes, as `robot.workspace(axes)` returned it.

    `parallel` is the smallest singular value of dq/dx, 0 where the platform gives way, `serial` that of dx/dq, 0 where it cannot move.
    Poses out of reach stay empty.
    """
    if which not in ("parallel", "serial", "condition"):
        raise ValueError(f"which = {which!r} (must be parallel, serial or condition)")
    names = list(axes)
    x, y = (numpy.asarray(values, dtype=float) for values in axes.values()) if len(names) == 2 else (numpy.zeros(0), numpy.zeros(0))
    if len(names) != 2 or found["reachable"].shape != (len(x), len(y)):
        raise ValueError(f"the workspace has shape {found['reachable'].shape}, axes {[len(numpy.asarray(v)) for v in axes.values()]} (must be two, alike)")
    # What cannot be reached has no singular value that means anything.
    values = numpy.where(found["reachable"], found[which], numpy.nan)
    if numpy.isnan(values).all():
        raise ValueError("no pose of the workspace can be reached")
    ax = _axes(ax, size=(6, 5))
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import LogLocator, ScalarFormatter

    norm = LogNorm() if which == "condition" else None
    mesh = ax.pcolormesh(x, y, values.T, shading="nearest", cmap="viridis_r" if which == "condition" else "viridis", norm=norm, rasterized=True)
    words = {"parallel": "smallest singular value of dq/dx", "serial": "smallest singular value of dx/dq", "condition": "condition number of dx/dq"}
    bar = ax.figure.colorbar(mesh, ax=ax, label=words[which], pad=0.02)
    if which == "condition":
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        bar.ax.yaxis.set_major_formatter(ScalarFormatter())
        bar.ax.minorticks_off()
    if set(names) <= {"x", "y", "z"}:
        ax.set_aspect("equal")
    ax.plot([found["home"][names[0]]], [found["home"][names[1]]], "+", color="#ffffff", ms=11, mew=3)
    ax.plot([found["home"][names[0]]], [found["home"][names[1]]], "+", color=BEFORE, ms=9, mew=1.4, label="home")
    x_words, y_words = (f"{n} [{'m' if n in ('x', 'y', 'z') else 'rad' if n in ('rx', 'ry', 'rz') else 'm or rad'}]" for n in names)
    ax.set_xlabel(x_words)
    ax.set_ylabel(y_words)
    return _finished(ax)


def mu(found: Mu, *, ax: Axes | None = None) -> Axes:
    """Bounds of the structured singular value over frequency, with the level that is proved between the points as well."""
    if not len(found.frequencies):
        raise ValueError("these are bounds of a matrix (must be of a system: they have frequencies)")
    ax = _axes(ax, size=(7, 4))
    w = found.frequencies
    order = numpy.argsort(w)
    shown = order[w[order] > 0.0]
    ax.fill_between(w[shown], found.lowers[shown], found.uppers[shown], color=AFTER, alpha=0.2, lw=0)
    ax.plot(w[shown], found.uppers[shown], color=AFTER, lw=1.3, label="upper bound")
    ax.plot(w[shown], found.lowers[shown], color=BEFORE, lw=1.3, label="lower bound")
    if found.guaranteed is not None:
        low, high = found.guaranteed
        ends = [max(low, float(w[shown][0])), min(high, float(w[shown][-1]))]
        ax.plot(ends, [found.upper, found.upper], color=MEASURED, lw=1.0, ls="--", label=f"proved throughout: {found.upper:.4g}")
    if found.w is not None and found.w > 0.0 and found.lower > 0.0:
        ax.plot([found.w], [found.lower], "o", color=BEFORE, ms=5, label=f"worst perturbation: {found.lower:.4g}")
    ax.set_xscale("log")
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("frequency [rad/s]")
    ax.set_ylabel("structured singular value")
    return _finished(ax)


def bode(
    responses: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    axes: tuple[Axes, Axes] | None = None,
) -> tuple[Axes, Axes]:
    """Frequency responses by name, each (frequencies [rad/s], complex values): their size [dB] above their phase [deg], unwrapped."""
    if not responses:
        raise ValueError("no response")
    if axes is None:
        from matplotlib import pyplot

        top, bottom = pyplot.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")[1]
    else:
        top, bottom = axes
    for k, (words, (frequencies, values)) in enumerate(responses.items()):
        w, h = numpy.asarray(frequencies, dtype=float), numpy.asarray(values, dtype=complex)
        if w.ndim != 1 or w.shape != h.shape:
            raise ValueError(f"response {words!r}: frequencies have shape {w.shape}, values {h.shape} (must be alike, one axis)")
        color = [MEASURED, AFTER, BEFORE, "#009e73", "#cc79a7"][k % 5]
        top.plot(w, 20.0 * numpy.log10(numpy.abs(h)), color=color, lw=1.3, label=words)
        bottom.plot(w, numpy.rad2deg(numpy.unwrap(numpy.angle(h))), color=color, lw=1.3)
    top.set_xscale("log")
    bottom.set_xscale("log")
    top.set_ylabel("size [dB]")
    bottom.set_ylabel("phase [deg]")
    bottom.set_xlabel("frequency [rad/s]")
    for one in (top, bottom):
        one.grid(True, which="both", color="#e8e8e8", lw=0.6)
    _plain(bottom)
    return _finished(top), bottom


def tracking(recording: Recording, measured: str, reference: str, *, unit: str = "", ax: Axes | None = None) -> Axes:
    """A measured signal and its reference over time, positions or forces alike, and on the right their difference, reference minus measured.

    `measured`, `reference`: names of signals of the recording (`q.q1` and `q_ref.q1`, `wrench.foot.fz` and its reference).
    """
    time, actual, wanted = recording.time, recording[measured], recording[reference]
    error = wanted - actual
    size = float(numpy.sqrt(numpy.nanmean(error**2)))
    ax = _axes(ax)
    in_unit = f" {unit}" if unit else ""
    ax.plot(time, wanted, color=MEASURED, lw=1.8, label=reference)
    ax.plot(time, actual, color=AFTER, lw=1.1, label=measured)
    # On an axis of its own: a good controller's error would be a flat line beside the signal.
    right = ax.twinx()
    words = f"error: {size:.3g}{in_unit} rms, {numpy.nanmax(numpy.abs(error)):.3g}{in_unit} at most"
    (line,) = right.plot(time, error, color=BEFORE, lw=0.9, label=words)
    right.axhline(0.0, color=BEFORE, lw=0.4, zorder=0)
    right.set_ylabel("error" + (f" [{unit}]" if unit else ""), color=BEFORE)
    right.tick_params(axis="y", colors=BEFORE)
    right.spines[["top"]].set_visible(False)
    ax.set_xlabel("time [s]")
    ax.set_ylabel(measured + (f" [{unit}]" if unit else ""))
    ax.set_title(recording.name, loc="left", fontsize="small")
    ax.margins(x=0)
    return _finished(ax, [*ax.lines, line])


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


def _map(
    ax: Axes, values: NDArray[numpy.float64], labels: tuple[Sequence[str], Sequence[str]], *, limits: tuple[float, float], words: str | None
) -> AxesImage:
    """A matrix as colours with its numbers on them."""
    image = ax.imshow(values, cmap="YlOrRd", vmin=limits[0], vmax=limits[1], aspect="auto")
    ax.set_yticks(range(len(labels[0])), labels[0])
    ax.set_xticks(range(len(labels[1])), labels[1], rotation=40, ha="right", rotation_mode="anchor")
    if words is not None:
        for (i, k), value in numpy.ndenumerate(values):
            if numpy.isfinite(value):
                is_dark = value > limits[0] + 0.6 * (limits[1] - limits[0])
                ax.text(k, i, words.format(value), ha="center", va="center", fontsize="x-small", color="white" if is_dark else "black")
    ax.spines[:].set_visible(False)
    return image


def _left_by_bodies(robot: Robot, recording: Recording, joint: str) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
    """Velocity of a drive, and its measured effort less rigid bodies and rotors, where nothing is missing."""
    if joint not in robot.actuators:
        raise ValueError(f"joint {joint!r} is not driven: no effort is measured there (drives: {', '.join(robot.actuators)})")
    time, q = recording.time, numpy.stack([recording[f"q.{name}"] for name in robot.actuators], axis=1)
    given = [recording[f"dq.{name}"] if f"dq.{name}" in recording else numpy.gradient(q[:, k], time) for k, name in enumerate(robot.actuators)]
    v = numpy.stack(given, axis=1)
    # Accelerations from noisy positions are mostly noise: the model's effort is smoothed with a window of 50 ms.
    n = max(1, round(0.05 * (len(time) - 1) / recording.duration))
    window = numpy.hanning(n + 2)[1:-1] / numpy.hanning(n + 2)[1:-1].sum()
    smooth = numpy.stack([numpy.convolve(column, window, mode="same") for column in v.T], axis=1)
    a = numpy.gradient(smooth, time, axis=0)
    whole = numpy.isfinite(q).all(axis=1) & numpy.isfinite(a).all(axis=1) & numpy.isfinite(recording[f"tau.{joint}"])
    # The window hangs over the ends.
    whole[: 2 * n] = whole[len(time) - 2 * n :] = False
    model = robot.inverse_dynamics(q[whole], smooth[whole], a[whole])[:, robot.actuators.index(joint)]
    return smooth[whole, robot.actuators.index(joint)], recording[f"tau.{joint}"][whole] - model


def _rate(unit: str | None) -> str:
    return f"{unit}/s" if unit else "1/s"


def _title(report: Report, rank: int) -> str:
    found = next((f for f in report.findings if f["rank"] == rank), None)
    return "model" if found is None else f"{found['effect']} at {' '.join(found['where'])}"


def _axes(ax: Axes | None, size: tuple[float, float] = (9, 4)) -> Axes:
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(figsize=size, layout="constrained")[1]


def _plain(ax: Axes) -> Axes:
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def _finished(ax: Axes, handles: Sequence[Artist] | None = None) -> Axes:
    ax.spines[["top", "right"]].set_visible(False)
    shown = ax.get_legend_handles_labels()[0] if handles is None else list(handles)
    # Above the picture: inside, it would cover samples.
    legend = ax.legend(handles=shown, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.06), ncols=4, fontsize="small", borderaxespad=0.0)
    for handle in legend.legend_handles:
        if handle is not None:
            handle.set_alpha(1.0)
    return ax
