"""The shipped robots: `names()` and `load(name)`."""

from ._pkm import load_shipped as load
from ._pkm import shipped_names as names

__all__ = ["load", "names"]
