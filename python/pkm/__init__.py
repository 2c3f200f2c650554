"""Model, simulate and diagnose robots with closed loops.

Arrays are C-ordered (n_samples, n_joints), float64, SI units. Names are those of the Rust crates.
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
