"""Packages of the extra `fleet`, imported where they are used, and stores, whose errors are made one kind: the rest of pkm does without."""

import contextlib
import importlib
from collections.abc import Iterator
from typing import Any


def need(name: str) -> Any:
    """The module of that name, or an ImportError that says what to install."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        # From the sources: the name pkm on PyPI is another project's.
        words = f"pkm.fleet needs the package {name.split('.')[0]}: pip install './python[fleet]' at the root of a clone of the project"
        raise ImportError(words) from error


@contextlib.contextmanager
def reaching(path: str) -> Iterator[None]:
    """Whatever a store's library raises, as OSError in one line: its own kinds are not known here, and not every one can be pickled."""
    try:
        yield
    except (OSError, ImportError):
        raise
    except Exception as error:
        raise OSError(f"{path}: {type(error).__name__}: {error}".splitlines()[0]) from None
