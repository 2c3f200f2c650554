"""Types of `Report.evidence`: the numbers behind the pictures. Arrays are float64 of shape (n_samples,) unless stated."""

from typing import TypedDict

import numpy
from numpy.typing import NDArray


class JointSeries(TypedDict):
    """One drive over one recording; efforts after the verdict's low-pass, in `unit`."""

    joint: str
    unit: str
    recording: str
    time: NDArray[numpy.float64]
    """Time [s]."""
    measured: NDArray[numpy.float64]
    nominal: NDArray[numpy.float64]
    """The model as given."""
    refined: NDArray[numpy.float64]
    """The model with every finding."""
    heldout_spans: NDArray[numpy.float64]
    """Start and end of every held-out span [s], shape (n_spans, 2)."""
    rms_nominal: float
    rms_refined: float


class FindingPlot(TypedDict):
    """What the model lacks without one finding, against the variable that explains it."""

    rank: int
    x_label: str
    y_label: str
    x: NDArray[numpy.float64]
    y: NDArray[numpy.float64]
    """What is left of the measured effort when everything but this finding is modelled."""
    is_heldout: NDArray[numpy.bool_]
    model: NDArray[numpy.float64]
    """The finding's own contribution at the same samples."""


class RegimeCell(TypedDict):
    """Error of one drive in one regime, as a share of the drive's effort rms, before and after."""

    joint: str
    regime: str
    share: float
    before: float
    after: float


class ChainStep(TypedDict):
    """One step from the model as given to the refined one, and the verdict's held-out number after it."""

    label: str
    heldout_rms: float


class Screened(TypedDict):
    """A candidate that was screened and is not a finding; `wins`: folds in which it helped, of how many; `surprise`: sigmas above chance."""

    effect: str
    where: list[str]
    gain: float
    surprise: float
    wins: tuple[int, int]
    why_not: str


class Dependence(TypedDict):
    """A leftover against one signal: partial dependence in stretches of equally many samples; arrays have one entry per stretch."""

    joint: str
    unit: str
    signal: str
    x: NDArray[numpy.float64]
    """Mean of the signal."""
    mean: NDArray[numpy.float64]
    """Mean leftover, in `unit`."""
    error: NDArray[numpy.float64]
    """Two standard errors of that mean."""


class Lines(TypedDict):
    """A leftover's amplitude over frequency or order; `over` says which, with its unit."""

    joint: str
    unit: str
    over: str
    x: NDArray[numpy.float64]
    amplitude: NDArray[numpy.float64]


class Evidence(TypedDict):
    """Everything a report shows besides the verdict; `null_surprise`: 95 % and 99 % of what chance alone reaches, in sigmas."""

    joints: list[JointSeries]
    findings: list[FindingPlot]
    regimes: list[RegimeCell]
    chain: list[ChainStep]
    ruled_out: list[Screened]
    null_surprise: tuple[float, float]
    null_runs: int
    dependences: list[Dependence]
    lines: list[Lines]
