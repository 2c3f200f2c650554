"""Pictures of reports, robots, control and trials, with matplotlib (`pip install './python[plot]'`, at the root of a clone of the project).

Every function draws into `ax`, or a new figure, and returns the axes; `bode` alone draws into two, takes them as `axes` and returns both.
"""

from ._loop import bode, mu, tracking
from ._report import chain, dependence, finding, isolability, joint, regimes, residual
from ._robot import friction, workspace
from ._trials import detection

__all__ = [
    "bode",
    "chain",
    "dependence",
    "detection",
    "finding",
    "friction",
    "isolability",
    "joint",
    "mu",
    "regimes",
    "residual",
    "tracking",
    "workspace",
]
