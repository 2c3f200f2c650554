"""Pictures of a report, with matplotlib (`pip install pkm[plot]`). Every function draws into `ax`, or a new figure, and returns it."""

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
