"""Model, simulate and diagnose robots with closed loops.

Arrays are C-ordered (n_samples, n_joints), float64, SI units. What the Rust crates have as well is called as it is there.
"""

from . import answers, evidence, plot, progress, prove, robots, verdict
from ._pkm import (
    Controller,
    Excitation,
    Identification,
    Mu,
    Plant,
    Recording,
    Report,
    Robot,
    __build__,
    __version__,
    diagnose,
    effects,
    excite,
    load,
    mu,
    papers,
    read,
    reproduce,
    simulate,
    write,
)

__all__ = [
    "Controller",
    "Excitation",
    "Identification",
    "Mu",
    "Plant",
    "Recording",
    "Report",
    "Robot",
    "__build__",
    "__version__",
    "answers",
    "diagnose",
    "effects",
    "evidence",
    "excite",
    "load",
    "mu",
    "papers",
    "plot",
    "progress",
    "prove",
    "read",
    "reproduce",
    "robots",
    "simulate",
    "verdict",
    "write",
]
