"""The compiled part of the package `pkm`; use `pkm` itself."""

import os
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias, final

import numpy
from numpy.typing import ArrayLike, NDArray

from .answers import (
    AppliedEffect,
    CatalogueEntry,
    ControllerHealth,
    DriveGains,
    FrictionShape,
    Margin,
    Payload,
    Quality,
    Reproduction,
    Singularities,
    UncertaintyBlock,
    Workspace,
)
from .evidence import Evidence
from .progress import Progress
from .verdict import Finding, Verdict

if TYPE_CHECKING:
    import pandas
    import xarray

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
    "diagnose",
    "effects",
    "excite",
    "load",
    "load_shipped",
    "mu",
    "papers",
    "read",
    "reproduce",
    "shipped_names",
    "simulate",
    "write",
]

__build__: Final[str]
__version__: Final[str]

_Term: TypeAlias = Literal["rotor", "friction", "passive-friction", "offset", "stiffness"]

@final
class Robot:
    """A robot: rigid bodies, joints, loops, drives, and physics beyond rigid bodies. It never changes."""

    @property
    def name(self) -> str:
        """Name of the robot."""

    @property
    def joints(self) -> list[str]:
        """Names of the joints of the spanning tree, parents first; the order of tree coordinates."""

    @property
    def actuators(self) -> list[str]:
        """Names of the driven joints, in the order of `tau`."""

    @property
    def passive(self) -> list[str]:
        """Names of the joints that no drive moves."""

    @property
    def links(self) -> list[str]:
        """Names of the links, the root included."""

    @property
    def nv(self) -> int:
        """Number of tree coordinates, which is the number of bodies."""

    @property
    def n_act(self) -> int:
        """Number of drives."""

    @property
    def mobility(self) -> int:
        """Degrees of freedom at the assembly pose: tree coordinates less independent constraints."""

    @property
    def armature(self) -> NDArray[numpy.float64]:
        """Rotor inertia seen at each joint of the tree [kg | kg·m²], shape (nv,); read-only."""

    @property
    def effects(self) -> list[AppliedEffect]:
        """Physics beyond rigid bodies, SI."""

    def assemble(self) -> NDArray[numpy.float64]:
        """Tree coordinates that close the loops near the stated assembly [m | rad], shape (nv,)."""

    def mid_pose(self) -> NDArray[numpy.float64]:
        """Positions of the drives in the middle of their travel [m | rad], (n_act,)."""

    def parameters(self) -> NDArray[numpy.float64]:
        """Inertial parameters, shape (10 * nv,): mass, mx, my, mz, ixx, ixy, iyy, ixz, iyz, izz of each body [kg, kg·m, kg·m²]."""

    def closed_loop_motion(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike
    ) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64], NDArray[numpy.float64]]:
        """Motion of all joints, three arrays (n_samples, nv), for a motion of the drives, three arrays (n_samples, n_act)."""

    @property
    def independent(self) -> list[str]:
        """Names of the joints whose motion determines all others at the assembly: the drives, or as many as there are freedoms."""

    def independent_at(self, q: ArrayLike) -> NDArray[numpy.uintp]:
        """Indices into `joints` of the independent coordinates at every pose, (n_samples, independent). q (n_samples, n_act)."""

    def crba(self, q: ArrayLike) -> NDArray[numpy.float64]:
        """Mass matrix of the tree, (n_samples, nv, nv), loops open, rotors included. q (n_samples, nv)."""

    def aba(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> NDArray[numpy.float64]:
        """Accelerations of the tree for its efforts, (n_samples, nv), loops open. Arguments (n_samples, nv)."""

    def nle(self, q: ArrayLike, v: ArrayLike) -> NDArray[numpy.float64]:
        """Coriolis, centrifugal and gravity efforts of the tree [N | N·m], (n_samples, nv). Arguments (n_samples, nv)."""

    def generalized_gravity(self, q: ArrayLike) -> NDArray[numpy.float64]:
        """Efforts that hold the tree against gravity [N | N·m], (n_samples, nv). q (n_samples, nv)."""

    def forward_dynamics(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, *, stabilisation: float = 0.0
    ) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """Accelerations (n_samples, nv) and loop efforts lambda (n_samples, rows), loops closed: M a + nle = tau + J^T lambda.

        `stabilisation`: rate at which gaps of a simulated robot are closed [1/s].
        """

    def loop_gap(self, q: ArrayLike) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """Closure error of every constraint row [m | rad], (n_samples, rows), and its Jacobian, (n_samples, rows, nv)."""

    def loop_efforts(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[numpy.float64]:
        """Efforts of the loops [N | N·m], (n_samples, rows): link a on link b, seen in a. Arguments (n_samples, n_act)."""

    def energies(self, q: ArrayLike, v: ArrayLike) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """Kinetic and potential energy [J], (n_samples,) each. Arguments (n_samples, nv)."""

    def energy_regressors(self, q: ArrayLike, v: ArrayLike) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """Kinetic and potential energy per inertial parameter, (n_samples, 10 * nv) each. Arguments (n_samples, nv)."""

    def frame_motion(self, link: str, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """Velocity and acceleration of a link's origin in the root's axes, (n_samples, 6) each, linear part first. Arguments (n_samples, nv)."""

    def center_of_mass(self, q: ArrayLike) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """Centre of mass [m], (n_samples, 3), and its Jacobian, (n_samples, 3, nv). q (n_samples, nv)."""

    def frame_pose(self, link: str, q: ArrayLike) -> NDArray[numpy.float64]:
        """Pose of a link's frame in the root frame, (n_samples, 4, 4). q (n_samples, nv)."""

    def frame_jacobian(
        self,
        link: str,
        q: ArrayLike,
        v: ArrayLike | None = None,
        *,
        reference: Literal["world", "local", "local_world_aligned"] = "local_world_aligned",
    ) -> NDArray[numpy.float64]:
        """Jacobian of a link's frame, (n_samples, 6, nv), linear part first; its time derivative when `v` is given."""

    def integrate(self, q: ArrayLike, dv: ArrayLike) -> NDArray[numpy.float64]:
        """Tree positions moved by a velocity held for unit time, (n_samples, nv)."""

    def difference(self, from_q: ArrayLike, to_q: ArrayLike) -> NDArray[numpy.float64]:
        """The velocity that leads from one tree position to another in unit time, (n_samples, nv)."""

    def reduced_mass_matrix(self, q: ArrayLike) -> NDArray[numpy.float64]:
        """Mass matrix in the independent coordinates, (n_samples, independent, independent). q (n_samples, n_act)."""

    def friction_regressor(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[numpy.float64]:
        """Columns [rotor | viscous | Coulomb] of every joint, passive ones included, (n_samples, independent, 3 * nv)."""

    def joint_wrenches(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[numpy.float64]:
        """Wrench of each joint of the tree on its body, loops closed, (n_samples, nv, 6), about the root's origin. Arguments (n_samples, n_act)."""

    def internal_efforts(self, q: ArrayLike) -> NDArray[numpy.float64]:
        """Efforts of the drives that move nothing, as orthonormal columns, (n_samples, n_act, n_act - mobility)."""

    def loop_wrenches(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[numpy.float64]:
        """Wrench of each loop's joint on the link of frame b, (n_samples, loops, 6), about b's origin in a's axes. Arguments (n_samples, n_act)."""

    def reduction(self, q: ArrayLike) -> NDArray[numpy.float64]:
        """G of v_tree = G v_ind, (n_samples, nv, independent). q (n_samples, n_act)."""

    def drive_jacobian(self, q: ArrayLike) -> NDArray[numpy.float64]:
        """B of v_act = B v_ind, (n_samples, n_act, independent). q (n_samples, n_act)."""

    def distribution(self, q: ArrayLike) -> NDArray[numpy.float64]:
        """D of the smallest tau_act = D tau_ind, (n_samples, n_act, independent). q (n_samples, n_act)."""

    def drive_reduction(self, q: ArrayLike) -> NDArray[numpy.float64]:
        """R = G D^T, the tree's motion per motion of each drive, (n_samples, nv, n_act). q (n_samples, n_act)."""

    def project(self, q: ArrayLike, v: ArrayLike) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """The state with loops closed, independent coordinates kept, (n_samples, nv) each, as the arguments are."""

    def output_jacobian(self, q: ArrayLike, *, link: str | None = None) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """Coordinates of the output, x y z [m] rx ry rz [rad], (n_samples, 6), and their rates per joint's, (n_samples, 6, nv). q (n_samples, nv)."""

    def joint_effort(self, joint: str, v: ArrayLike, *, q: float = 0.0, load: float = 0.0) -> NDArray[numpy.float64]:
        """Effort of one joint's own laws [N | N·m], friction of the URDF and effects of the file, (n_samples,); zero at rest."""

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[numpy.float64]:
        """Effort of the drives [N | N·m], (n_samples, n_act): rigid bodies and rotor inertia. Arguments (n_samples, n_act)."""

    def actuated_regressor(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, out: NDArray[numpy.float64] | None = None
    ) -> NDArray[numpy.float64]:
        """Regressor of the independent coordinates (the drives), (n_samples, independent, 10 * nv). Arguments (n_samples, n_act).

        `out`: an array of that shape to write into.
        """

    def regressor_products(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, tau: ArrayLike
    ) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64], float]:
        """(W^T W, W^T tau, tau^T tau) of the regressor, which is never stored. Arguments (n_samples, n_act), tau (n_samples, independent)."""

    def rnea(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[numpy.float64]:
        """Efforts of the spanning tree [N | N·m], (n_samples, nv), loops open. Arguments (n_samples, nv)."""

    def joint_torque_regressor(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[numpy.float64]:
        """Regressor of the spanning tree, (n_samples, nv, 10 * nv). Arguments (n_samples, nv)."""

    def singularities(
        self, q: ArrayLike, *, link: str | None = None, coordinates: Sequence[str] | None = None, length: float = 1.0
    ) -> Singularities:
        """Distances from singularities at poses of the drives, q (n_samples, n_act); metres are divided by `length`."""

    def workspace(
        self,
        axes: dict[str, ArrayLike],
        *,
        link: str | None = None,
        at: dict[str, float] | None = None,
        cone_deg: float | None = None,
        singularity_limit: float = 0.0,
        condition_limit: float = ...,
        length: float = 1.0,
        progress: Progress = None,
    ) -> Workspace:
        """Which poses can be reached, over one to three axes: x y z rx ry rz of the link or driven joints, values [m | rad]."""

    def with_effect(self, name: str, where: str, **parameters: float) -> Robot:
        """The same robot with one more effect of the library at a joint or link; parameters SI."""

    def texts(self) -> tuple[str, str]:
        """The robot as the texts of its robot.toml and of its URDF, every effect included: what `from_texts` reads."""

    @classmethod
    def from_texts(cls, toml: str, urdf: str) -> Robot:
        """A robot from the texts of a robot.toml and of the URDF that it names."""

    def unit(self, signal: str) -> str | None:
        """Unit of a signal of this robot's recordings, by its name (`q.<joint>`, ...); None where that says nothing."""

    def __reduce__(self) -> tuple[Any, tuple[str, str]]: ...
    def to_mjcf(self) -> str:
        """The robot as MJCF, for MuJoCo; its closed assembly is the keyframe `home`. Comments at the head say what is not in it."""

    def to_gepetto(self) -> tuple[str, str]:
        """The robot for Pinocchio: texts of `robot.urdf` and of `robot.yaml`, the loop file of toolbox-parallel-robots."""

@final
class Recording:
    """One recording: equally long named signals over one time axis. It never changes; NaN is a missing sample."""

    def __new__(
        cls, time: ArrayLike, signals: dict[str, ArrayLike], *, name: str = "recording", meta: dict[str, Any] | None = None
    ) -> Recording:
        """From time [s], (n_samples,), strictly increasing, and signals by name (`q.<joint>`, `tau.<joint>`, ...), SI."""

    @property
    def name(self) -> str:
        """How the recording is called in a verdict."""

    @property
    def time(self) -> NDArray[numpy.float64]:
        """Sample times [s], shape (n_samples,); read-only."""

    @property
    def signals(self) -> list[str]:
        """Names of the signals, sorted."""

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""

    @property
    def meta(self) -> dict[str, Any]:
        """What the recording says of itself: tau, load, gravity, session, controller and other texts."""

    def __getitem__(self, name: str, /) -> NDArray[numpy.float64]:
        """One signal, shape (n_samples,); read-only."""

    def to_pandas(self, robot: Robot | None = None) -> pandas.DataFrame:
        """A column per signal over `time`; units in `attrs`, those of joints with the `robot`. Needs pandas."""

    def to_xarray(self, robot: Robot | None = None) -> xarray.Dataset:
        """A variable per signal over `time`; units in `attrs`, those of joints with the `robot`. Needs xarray."""

    @staticmethod
    def from_pandas(frame: pandas.DataFrame) -> Recording:
        """The column `t` or `time`, or an index that is more than a count of rows, is time [s], every other column a signal."""

    @staticmethod
    def from_xarray(dataset: xarray.Dataset) -> Recording:
        """The coordinate `time` is time [s], every variable over it alone a signal."""

    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...
    def __contains__(self, name: str, /) -> bool: ...
    def __iter__(self) -> Iterator[str]: ...
    def __len__(self) -> int: ...

@final
class Identification:
    """Estimates the parameters of a robot from recordings. The constructor stores, `fit` learns, learned names end in `_`."""

    def __new__(
        cls,
        robot: Robot,
        *,
        method: Literal["sdp", "wls", "relevant", "ols", "huber", "bisquare", "tls", "ridge", "iv"] = "sdp",
        band_hz: float | None = None,
        hold: _Term | Sequence[_Term] | None = None,
        shapes: bool = False,
        gains: bool = False,
        payload: str | None = None,
        outliers: float | None = None,
        rate_hz: float | None = None,
        period_s: float | None = None,
        late_s: float | None = None,
        find_late_s: float | None = None,
        derivative: Literal["filtered", "central", "savitzky-golay", "spline"] = "filtered",
    ) -> Identification:
        """`band_hz`: low-pass for effort and model alike, chosen from the motion when None; `hold`: terms that stay as they are.

        Beside the parameters: `shapes` of friction laws, `gains` of the drives (one recording with `meta["load"]`, one without), what
        rides on the link `payload`. First, in this order: `outliers` replaced beyond so many robust standard deviations, thinned to
        `rate_hz`, averaged over `period_s`, efforts moved by `late_s` or by an estimate within `find_late_s` to either side.
        """

    def fit(
        self,
        recordings: Recording | Sequence[Recording],
        *,
        holdout: Recording | Sequence[Recording] | None = None,
        progress: Progress = None,
    ) -> Identification:
        """Learns from recordings, judges on `holdout` (without it, on every second of ten blocks of each), returns itself."""

    def get_params(self) -> dict[str, Any]:
        """The keywords of the constructor with their values."""

    def __getnewargs_ex__(self) -> tuple[tuple[Robot], dict[str, Any]]: ...
    def __getstate__(self) -> bytes | None: ...
    def __setstate__(self, state: bytes) -> None: ...

    @property
    def status_(self) -> str:
        """`identified`, `doubtful` or `not_identified`."""

    @property
    def notes_(self) -> list[str]:
        """What speaks against the answer, one sentence each."""

    @property
    def names_(self) -> list[str]:
        """Names of all parameters, in the order of `theta_`."""

    @property
    def theta_(self) -> NDArray[numpy.float64]:
        """All parameters of the identified robot, SI; read-only."""

    @property
    def names_base_(self) -> list[str]:
        """Names of the base parameters, in the order of `theta_base_`."""

    @property
    def theta_base_(self) -> NDArray[numpy.float64]:
        """Base parameters, SI; read-only."""

    @property
    def covariance_(self) -> NDArray[numpy.float64]:
        """Their covariance, residuals taken as coloured as they are, by the equations of the method."""

    @property
    def ci95_(self) -> NDArray[numpy.float64]:
        """95 % intervals of the base parameters, (n, 2)."""

    @property
    def intervals_(self) -> str:
        """What the intervals are about, in words."""

    @property
    def shapes_(self) -> list[FrictionShape]:
        """Shapes of friction laws that were estimated."""

    @property
    def preprocessing_(self) -> list[str]:
        """What was done to the recordings first, one line each."""

    @property
    def gains_(self) -> DriveGains | None:
        """Gains of the drives; None where they were not asked for."""

    @property
    def payload_(self) -> Payload | None:
        """What rides on the link; None where it was not asked for."""

    @property
    def heldout_(self) -> dict[str, tuple[float, float]]:
        """Held-out error of each drive as a share of its effort's rms: `{joint: (nominal, identified)}`."""

    @property
    def robot_(self) -> Robot:
        """The identified robot."""

@final
class Excitation:
    """A periodic motion of all drives, and how good it is. It never changes."""

    @property
    def period_s(self) -> float:
        """Period [s]."""

    @property
    def actuators(self) -> list[str]:
        """Names of the driven joints, in the order of the columns of `sample`."""

    @property
    def criterion(self) -> str:
        """What was made good."""

    @property
    def coefficients(self) -> NDArray[numpy.float64]:
        """Coefficients of the functions, (n_act, n_functions)."""

    @property
    def quality(self) -> Quality:
        """How good the motion is, on a grid ten times as dense as that of the search."""

    @property
    def random(self) -> Quality | None:
        """The same of the best random motion with the same limits; None where that leaves them between its samples."""

    @property
    def gain(self) -> float | None:
        """By how much the best random motion is worse, 1 or more; None where it is not known."""

    @property
    def columns(self) -> list[str]:
        """Names of the parameters whose columns count."""

    @property
    def structural(self) -> int:
        """Independent combinations of parameters that some motion of the robot would show."""

    @property
    def well_conditioned(self) -> int:
        """Columns that stay below condition number 300 together along this motion."""

    @property
    def margins(self) -> list[Margin]:
        """Where the motion comes nearest to each limit, the tightest first."""

    def sample(self, t: ArrayLike) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64], NDArray[numpy.float64]]:
        """(q, v, a) at times t [s] of shape (n_samples,), each (n_samples, n_act)."""

    def grid(
        self, rate_hz: float = 100.0, *, periods: int = 1
    ) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64], NDArray[numpy.float64], NDArray[numpy.float64]]:
        """(t, q, v, a) at a rate, from rest to rest over whole periods."""

    def recording(self, rate_hz: float = 100.0, *, periods: int = 1) -> Recording:
        """The motion as references q_ref.*, dq_ref.*, ddq_ref.* of every drive."""

    def save(self, path: str | os.PathLike[str], rate_hz: float = 100.0, *, periods: int = 1) -> None:
        """Writes these references as .csv or .mcap, for `pkm simulate --reference`."""

    @classmethod
    def _from_bytes(cls, robot: Robot, bytes: bytes) -> Excitation: ...
    def __reduce__(self) -> tuple[Any, tuple[Robot, bytes]]: ...

def excite(
    robot: Robot,
    *,
    criterion: Literal["condition", "determinant", "angle", "power"] = "condition",
    separate: Sequence[tuple[str, str, dict[str, float]]] = ...,
    basis: Literal["fourier", "spline"] = "fourier",
    harmonics: int = 5,
    pieces: int = 12,
    period_s: float = 10.0,
    share: float = 0.95,
    speed: float | None = None,
    acceleration: float | None = None,
    cone_deg: float | None = None,
    singularity: float = 0.1,
    hold: _Term | Sequence[_Term] | None = None,
    restarts: int = 4,
    draws: int = 25,
    iterations: int = 150,
    seed: int = 1,
    progress: Progress = None,
) -> Excitation:
    """Looks for a periodic motion that shows a robot's parameters as well as its limits allow, or tells two effects apart.

    `separate`: two effects, each (name, where, parameters); `share`: of the robot's limits that may be used; `speed`, `acceleration`: of
    any drive; `cone_deg`: lean of ball joints; `singularity`: least distance, as a share of that in the middle of the travel.
    """

@final
class Report:
    """A finished diagnosis; `print(report)` tells the whole story."""

    @property
    def verdict(self) -> Verdict:
        """The verdict in the layout `pkm.verdict/1`."""

    @property
    def findings(self) -> list[Finding]:
        """The findings of the verdict, most important first."""

    @property
    def evidence(self) -> Evidence:
        """The numbers behind the pictures."""

    def html(self) -> str:
        """One self-contained HTML page with every number and picture."""

    def save(self, path_json: str | os.PathLike[str], *, html: str | os.PathLike[str] | None = None) -> None:
        """Writes the verdict as JSON, the refined robot beside it (`OUT.robot.toml`, `OUT.robot.urdf`), and the page to `html`."""

    def refined(self, urdf_name: str) -> tuple[str, str]:
        """The refined robot as the texts of its robot.toml, which names `urdf_name`, and of that URDF."""

    def refined_robot(self) -> Robot:
        """The refined robot itself, with every finding in it."""

    def _repr_html_(self) -> str: ...
    @classmethod
    def _from_bytes(cls, bytes: bytes) -> Report: ...
    def __reduce__(self) -> tuple[Any, tuple[bytes]]: ...

def load(path: str | os.PathLike[str]) -> Robot:
    """Reads the robot.toml at `path` and the URDF it names."""

def effects() -> list[CatalogueEntry]:
    """The effects of the library, in the order in which equal explanations are preferred."""

def papers() -> list[str]:
    """Keys of the papers that `reproduce` knows, in the order of their years."""

def reproduce(paper: str, *, progress: Progress = None) -> Reproduction:
    """Does a paper's experiments again: every number of its against ours, and its plots."""

def shipped_names() -> list[str]:
    """Names of the shipped robots."""

def load_shipped(name: str) -> Robot:
    """The shipped robot of that name."""

def read(path: str | os.PathLike[str], *, topic: str | None = None, recover: bool = False) -> Recording:
    """Reads a recording from a `.csv` or `.mcap` file."""

def write(path: str | os.PathLike[str], recording: Recording) -> None:
    """Writes a recording as `.csv` or `.mcap`; the file appears complete or not at all."""

def simulate(
    truth: Robot,
    nominal: Robot,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    rate_hz: float | None = None,
    period_s: float | None = None,
    amplitude: float | None = None,
    encoder_resolution: float | None = None,
    encoder_noise: float | None = None,
    effort_noise: float | None = None,
    name: str | None = None,
    reference: Recording | None = None,
    progress: Progress = None,
) -> Recording:
    """Moves `truth` under a controller that knows only `nominal` and returns what a recorder would have written.

    `reference`: a recording whose `q_ref.*`, or else `q.*`, is followed from end to end, in place of a motion drawn by chance.
    """

@final
class Plant:
    """A robot that moves under the efforts of its drives, with its state."""

    def __new__(
        cls, robot: Robot, q: ArrayLike | None = None, *, kind: Literal["auto", "reduced", "constrained"] = "auto", seed: int = 1
    ) -> Plant:
        """`robot` with its effects at rest at positions `q` of its drives, by default in the middle of their travel.

        Effects of actuators and sensors (lags, delays, scales, encoders) are not a plant's: `simulate` has them.
        """

    @property
    def kind(self) -> Literal["reduced", "constrained"]:
        """In whose coordinates it moves: those of the drives, or of the whole tree."""

    @property
    def joints(self) -> list[str]:
        """Names of the driven joints, in the order of every array."""

    @property
    def q(self) -> NDArray[numpy.float64]:
        """Positions of the drives, (n_act,)."""

    @property
    def v(self) -> NDArray[numpy.float64]:
        """Velocities of the drives, (n_act,)."""

    @property
    def time(self) -> float | None:
        """Time since the start [s]."""

    @property
    def tree(self) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]] | None:
        """Positions and velocities of all joints, (nv,) each; None of a reduced plant."""

    def step(self, tau: ArrayLike, dt: float) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """Moves on by dt [s] under efforts that are constant meanwhile: (q, v) of the drives at the end."""

    def run(self, tau: ArrayLike, dt: float, *, progress: Progress = None) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """One step of dt [s] per row of efforts (n_samples, n_act): (q, v) at the end of each, of the same shape."""

def diagnose(
    robot: Robot,
    recordings: Recording | Sequence[Recording],
    *,
    holdout: Recording | Sequence[Recording] | None = None,
    band_hz: float | None = None,
    floor: float | None = None,
    seed: int | None = None,
    without: str | Sequence[str] | None = None,
    scratch: str | os.PathLike[str] | None = ...,
    progress: Progress = None,
) -> Report:
    """Compares recordings with the robot's model: where they differ, which physics is missing, how much, how much better it fits.

    `scratch`: folder for a nameless temporary file in which the series of long recordings wait, beyond half a gigabyte of them, by default
    the system's own; with None all stay in memory, and no number changes.
    """

@final
class Mu:
    """Bounds of the structured singular value, with what shows them. It never changes."""

    @property
    def upper(self) -> float:
        """Upper bound, proved."""

    @property
    def lower(self) -> float:
        """Lower bound, shown by `worst`; 0 where no perturbation was found or looked for."""

    @property
    def w(self) -> float | None:
        """Frequency at which `worst` acts [rad/s]; None of a matrix."""

    @property
    def guaranteed(self) -> tuple[float, float] | None:
        """Range of frequencies [rad/s] on all of which `upper` holds; None of a matrix, and where only points are known."""

    @property
    def worst(self) -> list[float | complex | NDArray[numpy.complex128]] | None:
        """The worst perturbation found: one float, complex or array per block; None where there is none."""

    @property
    def frequencies(self) -> NDArray[numpy.float64]:
        """Frequencies of the points [rad/s]."""

    @property
    def uppers(self) -> NDArray[numpy.float64]:
        """Upper bounds at the points."""

    @property
    def lowers(self) -> NDArray[numpy.float64]:
        """Lower bounds at the points."""

    @classmethod
    def _from_bytes(cls, bytes: bytes) -> Mu: ...
    def __reduce__(self) -> tuple[Any, tuple[bytes]]: ...

def mu(
    system: ArrayLike | tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike],
    blocks: Sequence[UncertaintyBlock],
    *,
    dt: float | None = None,
    frequencies: tuple[float, float] | None = None,
    bounds: Literal["both", "upper"] | None = None,
    slack: float | None = None,
) -> Mu:
    """Bounds the structured singular value of a complex matrix, or of a system (A, B, C, D) over a range of frequencies."""

@final
class Controller:
    """A controller for a robot, with its state."""

    def __new__(cls, robot: Robot, path: str | os.PathLike[str]) -> Controller:
        """The controller that the file at `path` (docs/FORMATS.md, section 10) states, for `robot`, at rest."""

    @classmethod
    def from_text(cls, robot: Robot, text: str, name: str = "controller.toml") -> Controller:
        """The controller that a text states, for `robot`, at rest; errors call it `name`."""

    @property
    def law(self) -> str:
        """Name of its law."""

    @property
    def rate_hz(self) -> float:
        """Steps per second that it is made for [Hz]."""

    @property
    def joints(self) -> list[str]:
        """Names of the driven joints, in the order of every array."""

    @property
    def health(self) -> ControllerHealth:
        """How the last step went."""

    def step(
        self,
        *,
        q_meas: ArrayLike,
        q_ref: ArrayLike | None = None,
        v_ref: ArrayLike | None = None,
        a_ref: ArrayLike | None = None,
        tau_ff: ArrayLike | None = None,
        tau_meas: ArrayLike | None = None,
        wrench_meas: ArrayLike | None = None,
        wrench_ref: ArrayLike | None = None,
        dt: float | None = None,
    ) -> NDArray[numpy.float64]:
        """One period: efforts for the drives [N | N·m], or voltages [V]. Numbers that are not finite are a fault, as on the robot."""

    def run(
        self,
        *,
        q_meas: ArrayLike,
        q_ref: ArrayLike | None = None,
        v_ref: ArrayLike | None = None,
        a_ref: ArrayLike | None = None,
        tau_ff: ArrayLike | None = None,
        tau_meas: ArrayLike | None = None,
        wrench_meas: ArrayLike | None = None,
        wrench_ref: ArrayLike | None = None,
        dt: float | None = None,
        progress: Progress = None,
    ) -> NDArray[numpy.float64]:
        """One period per row of arrays of shape (n_samples, n_drives), wrenches (n_samples, 6): the commands, (n_samples, n_drives)."""

    def reset(self) -> None:
        """To rest, as before the first step."""

    def __reduce__(self) -> tuple[Any, tuple[Robot, str, str]]:
        """For pickle: at rest only, for the state of its law does not travel."""
