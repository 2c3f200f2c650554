"""What all pictures share: colours, axes, legends, and matrices as maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage
    from numpy.typing import NDArray

# Told apart by the colour-blind as well: measured black, before orange, after blue.
MEASURED, FITTED, BEFORE, AFTER, HELDOUT = "#222222", "#b0b0b0", "#d55e00", "#0072b2", "#e8e8e8"
# For a fourth and a fifth curve.
OTHERS = ("#009e73", "#cc79a7")


def new_axes(ax: Axes | None, size: tuple[float, float] = (9, 4)) -> Axes:
    """The axes given, or those of a new figure of this size in inches."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(figsize=size, layout="constrained")[1]


def plain(ax: Axes) -> Axes:
    """Without a frame above and on the right."""
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def finished(ax: Axes, handles: Sequence[Artist] | None = None) -> Axes:
    """Plain, and with its legend."""
    from matplotlib.lines import Line2D

    plain(ax)
    shown = ax.get_legend_handles_labels()[0] if handles is None else list(handles)
    # Above the picture: inside, it would cover samples.
    legend = ax.legend(handles=shown, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.06), ncols=4, fontsize="small", borderaxespad=0.0)
    for handle in legend.legend_handles:
        if handle is not None:
            handle.set_alpha(1.0)
        # Points that are small where thousands are drawn would be nothing in a legend.
        if isinstance(handle, Line2D) and handle.get_linestyle() == "None":
            handle.set_markersize(max(handle.get_markersize(), 6.0))
    return ax


def matrix_map(
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
