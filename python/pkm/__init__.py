"""Model, simulate and diagnose robots with closed loops.

Arrays are C-ordered (n_samples, n_joints), float64, SI units. Names are those of the Rust crates.
"""

from . import evidence, plot, robots, verdict
from ._pkm import Identification, Recording, Report, Robot, __version__, diagnose, effects, load, read, simulate, write

__all__ = [
    "Identification",
    "Recording",
    "Report",
    "Robot",
    "__version__",
    "diagnose",
    "effects",
    "evidence",
    "load",
    "plot",
    "read",
    "robots",
    "simulate",
    "verdict",
    "write",
]
