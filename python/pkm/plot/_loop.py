"""Pictures of control: structured singular values, frequency responses, and how well a reference is followed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy

from ._draw import AFTER, BEFORE, MEASURED, OTHERS, finished, new_axes, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from .._pkm import Mu, Recording


def mu(found: Mu, *, ax: Axes | None = None) -> Axes:
    """Bounds of the structured singular value over frequency, with the level that is proved between the points as well."""
    if not len(found.frequencies):
        raise ValueError("these are bounds of a matrix (must be of a system: they have frequencies)")
    ax = new_axes(ax, size=(7, 4))
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
    return finished(ax)


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
        color = [MEASURED, AFTER, BEFORE, *OTHERS][k % 5]
        top.plot(w, 20.0 * numpy.log10(numpy.abs(h)), color=color, lw=1.3, label=words)
        bottom.plot(w, numpy.rad2deg(numpy.unwrap(numpy.angle(h))), color=color, lw=1.3)
    top.set_xscale("log")
    bottom.set_xscale("log")
    top.set_ylabel("size [dB]")
    bottom.set_ylabel("phase [deg]")
    bottom.set_xlabel("frequency [rad/s]")
    for one in (top, bottom):
        one.grid(True, which="both", color="#e8e8e8", lw=0.6)
    plain(bottom)
    return finished(top), bottom


def tracking(recording: Recording, measured: str, reference: str, *, unit: str = "", ax: Axes | None = None) -> Axes:
    """A measured signal and its reference over time, positions or forces alike, and on the right their difference, reference minus measured.

    `measured`, `reference`: names of signals of the recording (`q.q1` and `q_ref.q1`, `wrench.foot.fz` and its reference).
    """
    time, actual, wanted = recording.time, recording[measured], recording[reference]
    error = wanted - actual
    size = float(numpy.sqrt(numpy.nanmean(error**2)))
    ax = new_axes(ax)
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
    return finished(ax, [*ax.lines, line])
