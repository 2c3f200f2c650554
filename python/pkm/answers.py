"""Types of what properties and functions return as dicts. Arrays are float64; their shapes are those of what returns them."""

from typing import Literal, TypedDict

import numpy
from numpy.typing import NDArray


class AppliedEffect(TypedDict):
    """An effect of the library at a place; `where` has one name."""

    effect: str
    where: list[str]
    parameters: dict[str, float]


class Singularities(TypedDict):
    """Arrays over samples; `loosest_motion` has a column per joint, `loosest_output` one per name in `coordinates`."""

    parallel: NDArray[numpy.float64]
    serial: NDArray[numpy.float64]
    condition: NDArray[numpy.float64]
    passive: NDArray[numpy.float64]
    constraint: NDArray[numpy.float64]
    loosest_motion: NDArray[numpy.float64]
    loosest_output: NDArray[numpy.float64]
    coordinates: list[str]


class FrictionShape(TypedDict):
    """A value that a friction law is not linear in."""

    name: str
    unit: str
    stated: float
    value: float
    ci95: list[float]
    is_shown: bool


class DriveGain(TypedDict):
    """Acting effort over recorded effort, and the share of the recorded effort that the known load is."""

    gain: float
    ci95: list[float]
    load_share: float


class DriveGains(TypedDict):
    """Gains by driven joint; empty where there is nothing to tell them from."""

    status: Literal["identified", "doubtful", "not_identified"]
    notes: list[str]
    drives: dict[str, DriveGain]


class Estimated(TypedDict):
    """A number with its 95 % interval."""

    name: str
    unit: str
    value: float
    ci95: list[float]


class Payload(TypedDict):
    """A body that can exist, about the frame of the link, and what the motion shows of it before anything physical is asked."""

    link: str
    status: Literal["identified", "doubtful", "not_identified"]
    notes: list[str]
    body: dict[str, float]
    shown: list[Estimated]


class Separation(TypedDict):
    """Two effects after the base parameters have explained what they can."""

    cosine: float
    angle_deg: float
    left: list[float]
    effort: list[float]
    alone: list[float]


class Quality(TypedDict, total=False):
    """How good a motion is; `separation` with two effects only."""

    condition: float
    condition_raw: float
    log_determinant: float
    separation: Separation


class Margin(TypedDict):
    """Where a motion comes nearest to a limit; `room` is a share of half the range."""

    what: str
    where: str
    value: float
    lower: float
    upper: float
    room: float
    time: float


class Workspace(TypedDict):
    """Arrays with one axis per scanned axis; `cause` indexes `causes`, NaN where the loops do not close."""

    reachable: NDArray[numpy.bool_]
    cause: NDArray[numpy.uint8]
    parallel: NDArray[numpy.float64]
    serial: NDArray[numpy.float64]
    condition: NDArray[numpy.float64]
    causes: list[str]
    home: dict[str, float]


class Units(TypedDict):
    """Unit of a parameter by kind of joint."""

    prismatic: str
    revolute: str


class Parameter(TypedDict):
    """A parameter of an effect; a default of None makes it required."""

    name: str
    unit: Units
    lower: float
    upper: float
    default: float | None


class LookAlike(TypedDict):
    """An effect that looks similar in recordings, and what tells the two apart."""

    effect: str
    experiment: str


class CatalogueEntry(TypedDict):
    """One effect of the library."""

    name: str
    sentence: str
    equation: str
    place: str
    compensation: str
    energy: Literal["stores", "dissipates", "passive", "feeds", "neither"]
    parameters: list[Parameter]
    look_alikes: list[LookAlike]


class PaperRow(TypedDict):
    """One number of a paper and ours; `target` and `limit` are what ours is held against, as `gate` says."""

    place: str
    what: str
    ours: float
    paper: float | None
    gate: Literal["within", "at most", "at least", "told"]
    limit: float | None
    target: float
    verdict: Literal["reproduced", "conclusion holds", "not reproducible", "MISSED"]
    why: str


class PaperLine(TypedDict):
    """A line of a plot."""

    label: str
    x: NDArray[numpy.float64]
    y: NDArray[numpy.float64]


class PaperPlot(TypedDict):
    """A plot, at most three lines."""

    title: str
    x_label: str
    y_label: str
    lines: list[PaperLine]


class Reproduction(TypedDict):
    """A paper's experiments, done again."""

    title: str
    rows: list[PaperRow]
    plots: list[PaperPlot]


class ActedLimit(TypedDict):
    """A limit that acted; `where` is a joint or a component of the wrench, None for the workspace."""

    limit: Literal["Position", "Velocity", "Effort", "EffortRate", "Wrench", "Workspace", "Singularity"]
    where: str | None


class ControllerFault(TypedDict):
    """The first fault of a controller; `number` never changes behind its name `code`."""

    code: str
    number: int
    where: str | None
    value: float
    limit: float


class ControllerHealth(TypedDict):
    """How a step went."""

    is_faulted: bool
    is_saturated: bool
    acted: list[ActedLimit]
    fault: ControllerFault | None


class UncertaintyKind(TypedDict):
    """What every block of an uncertainty says."""

    kind: Literal["real", "complex", "full"]


class UncertaintyBlock(UncertaintyKind, total=False):
    """One block of an uncertainty: `repeats` of scalars, `rows` and `cols` of a full block; 1 by default."""

    repeats: int
    rows: int
    cols: int
