"""Progress of long calls: `progress=True` draws a bar with tqdm, any callable takes the share done, 0 to 1."""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

Progress: TypeAlias = "Callable[[float], object] | bool | None"
"""What the argument `progress` takes."""


class Bar:
    """A bar of tqdm, in a notebook or a terminal: call it with the share done."""

    def __init__(self, words: str) -> None:
        """`words` stand before the bar."""
        try:
            # "auto" warns where a notebook has no widgets, and nothing is wrong with a bar of text.
            tqdm = importlib.import_module("tqdm.std")
        except ImportError as error:
            raise ImportError("progress=True needs the package tqdm: pip install tqdm") from error
        shape = "{desc}: {percentage:3.0f} %|{bar}| {elapsed}<{remaining}"
        self._bar: Any = tqdm.tqdm(total=1.0, desc=words, bar_format=shape)

    def __call__(self, share: float) -> None:
        """Draws the bar at `share`, 0 to 1."""
        self._bar.n = min(max(share, 0.0), 1.0)
        self._bar.refresh()

    def close(self) -> None:
        """Leaves the bar as it stands."""
        self._bar.close()


@contextlib.contextmanager
def following(progress: Progress, words: str) -> Iterator[Callable[[float], object]]:
    """A function that tells the share done to whatever `progress` asks for."""
    if progress is True:
        bar = Bar(words)
        try:
            yield bar
        finally:
            bar.close()
    elif progress in (None, False):
        yield lambda share: None
    elif callable(progress):
        yield progress
    else:
        raise TypeError(f"progress is {type(progress).__name__} (must be a callable, True, False or None)")
