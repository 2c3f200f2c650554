"""Pictures of robots: friction laws, and singular values over a workspace."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy

from ._draw import AFTER, BEFORE, FITTED, MEASURED, OTHERS, finished, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike, NDArray

    from .._pkm import Recording, Robot
    from ..answers import Workspace

# Of a link, and their units; every other axis of a workspace is a drive.
COORDINATES = {"x": "m", "y": "m", "z": "m", "rx": "rad", "ry": "rad", "rz": "rad"}


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
    ax = new_axes(ax)
    if recording is not None:
        v_meas, left = _left_by_bodies(first, recording, joint)
        speed = float(numpy.abs(v_meas).max()) if speed is None else speed
        ax.plot(v_meas, left, ".", color=FITTED, ms=3, mew=0, alpha=0.6, label="measured less rigid bodies", rasterized=True)
    speed = 1.0 if speed is None else speed
    # The two sides apart: at rest friction is not a function of speed.
    v = numpy.concatenate([-numpy.geomspace(speed, 1e-6 * speed, 400), [0.0], numpy.geomspace(1e-6 * speed, speed, 400)])
    # One robot is what is known; of several the first is what was believed before, as in every other picture.
    colors = ([] if len(named) == 1 else [BEFORE]) + [AFTER, MEASURED, *OTHERS]
    for k, (words, robot) in enumerate(named.items()):
        at = float(robot.assemble()[robot.joints.index(joint)]) if q is None else q
        effort = robot.joint_effort(joint, v, q=at)
        effort[v == 0.0] = numpy.nan
        ax.plot(v, effort, color=colors[k % len(colors)], lw=1.4, label=words)
    ax.axhline(0.0, color="#888888", lw=0.6, zorder=0)
    ax.set_xlabel(f"velocity of {joint} [{_rate(first.unit(f'q.{joint}'))}]")
    ax.set_ylabel(f"effort at {joint} [{first.unit(f'tau.{joint}')}]")
    return finished(ax)


def workspace(
    found: Workspace,
    axes: Mapping[str, ArrayLike],
    *,
    which: Literal["parallel", "serial", "condition"] = "parallel",
    robot: Robot | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Singular values, or their ratio, over the reachable part of a workspace of two axes, as `robot.workspace(axes)` returned it.

    `parallel` is the smallest singular value of dq/dx, 0 where the platform gives way, `serial` that of dx/dq, 0 where it cannot move.
    Poses out of reach stay empty. Axes that are drives have the unit that they have in the `robot`, "m or rad" without it.
    """
    if which not in ("parallel", "serial", "condition"):
        raise ValueError(f"which = {which!r} (must be parallel, serial or condition)")
    names = list(axes)
    x, y = (numpy.asarray(values, dtype=float) for values in axes.values()) if len(names) == 2 else (numpy.zeros(0), numpy.zeros(0))
    if len(names) != 2 or found["reachable"].shape != (len(x), len(y)):
        raise ValueError(f"the workspace has shape {found['reachable'].shape}, axes {[len(numpy.asarray(v)) for v in axes.values()]} (must be two, alike)")
    units = [_unit(name, robot) for name in names]
    # What cannot be reached has no singular value that means anything.
    values = numpy.where(found["reachable"], found[which], numpy.nan)
    if numpy.isnan(values).all():
        raise ValueError("no pose of the workspace can be reached")
    ax = new_axes(ax, size=(6, 5))
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
    ax.set_xlabel(f"{names[0]} [{units[0]}]")
    ax.set_ylabel(f"{names[1]} [{units[1]}]")
    return finished(ax)


def _unit(axis: str, robot: Robot | None) -> str:
    """Of an axis of a workspace: a coordinate of the link, or else a drive."""
    if axis in COORDINATES:
        return COORDINATES[axis]
    if robot is None:
        return "m or rad"
    if axis not in robot.actuators:
        raise ValueError(f"no drive {axis!r} in the robot (has: {', '.join(robot.actuators)})")
    return robot.unit(f"q.{axis}") or "m or rad"


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
