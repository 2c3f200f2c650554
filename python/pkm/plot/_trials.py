"""Pictures of blind trials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy

from ..prove import share
from ._draw import AFTER, BEFORE, MEASURED, finished, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..prove import Marks


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
    ax = new_axes(ax, size=(6, 4))
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
    return finished(ax)
