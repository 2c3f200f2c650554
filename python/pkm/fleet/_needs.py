"""Packages of the extra `fleet`, imported where they are used: the rest of pkm does without."""

import importlib
from typing import Any


def need(name: str) -> Any:
    """The module of that name, or an ImportError that says what to install."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(f"pkm.fleet needs the package {name.split('.')[0]}: pip install pkm[fleet]") from error
