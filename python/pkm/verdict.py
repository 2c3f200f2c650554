"""Types of `Report.verdict`: the layout `pkm.verdict/1`, as it stands in the JSON file."""

from typing import Literal, TypedDict


class RecordingUse(TypedDict):
    """One recording and what it was used for; spans are start and end [s] on its own time axis."""

    path: str
    samples: int
    duration_s: float
    used: Literal["train", "holdout", "both"]
    heldout_spans: list[list[float]]


class HeldoutJoint(TypedDict):
    """Held-out errors of one drive, in its own unit."""

    joint: str
    unit: str
    rms_tau: float
    rms_nominal: float
    rms_refit: float
    rms_final: float


class Heldout(TypedDict):
    """Held-out errors as fractions of the measured effort's rms."""

    rms_nominal: float
    rms_refit: float
    rms_final: float
    noise_floor: float
    band_hz: float
    unit: str
    joints: list[HeldoutJoint]


class Estimate(TypedDict):
    """A value with its 95 % interval and unit."""

    value: float
    ci95: list[float]
    unit: str


class EffectAt(TypedDict):
    """An effect at a place that the recordings cannot separate from the finding that lists it."""

    effect: str
    where: list[str]


class LookAlike(TypedDict):
    """An explanation that was considered and rejected."""

    effect: str
    where: list[str]
    why_not: str
    separating_experiment: str


class Experiment(TypedDict):
    """What would separate a finding from `against`, with the cosine of the angle between them now and to expect."""

    against: str
    where: list[str]
    intervention: str
    cos_now: float
    cos_expected: float
    separates: bool
    says: str


class PriorGains(TypedDict):
    """Share of the squared error a finding takes away with the model's inertias exact, within `soft_prior`, and refitted."""

    anchored: float
    soft: float
    refit: float
    soft_prior: float
    depends: bool


class Seen(TypedDict):
    """An effect and the share of it that the parameters of the model cannot imitate."""

    effect: str
    where: list[str]
    kappa: float
    found: bool


class Isolability(TypedDict):
    """Cosines of the angles between effects, in the order of `effects`."""

    prior: float
    effects: list[Seen]
    cosines: list[list[float]]


class Invisible(TypedDict):
    """An effect that no size would have shown."""

    effect: str
    where: list[str]
    why: str


class Compensation(TypedDict):
    """What a controller does about a finding."""

    in_refined_model: bool
    says: str


class Finding(TypedDict):
    """One piece of missing physics: located, named, sized and proven on held-out data."""

    rank: int
    effect: str
    where: list[str]
    regime: list[str]
    when: str
    confidence: float
    p_value: float
    parameters: dict[str, Estimate]
    heldout_rms_before: float
    heldout_rms_after: float
    says: str
    equation: str
    compensation: Compensation
    look_alikes: list[LookAlike]
    cannot_tell_from: list[EffectAt]
    experiments: list[Experiment]
    depends_on_prior: PriorGains


class Unexplained(TypedDict):
    """What is left after every finding."""

    present: bool
    share_of_residual: float
    where: list[str]
    depends_on: list[str]


class Detectable(TypedDict):
    """The smallest size of an effect these recordings could have shown."""

    effect: str
    where: list[str]
    parameter: str
    value: float
    unit: str
    says: str


class Verdict(TypedDict):
    """The answer to one diagnosis."""

    schema: str
    status: Literal["ok", "unusable", "not_repeatable"]
    robot: str
    recordings: list[RecordingUse]
    nothing_missing: bool
    heldout: Heldout
    findings: list[Finding]
    unexplained: Unexplained
    minimum_detectable: list[Detectable]
    invisible: list[Invisible]
    isolability: Isolability
    refined_model: str
    says: str
    notes: list[str]
