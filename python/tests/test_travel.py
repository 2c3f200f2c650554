"""What travels between processes comes out as it went in, to the bit; and what a table of pandas or xarray holds."""

import copy
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pkm
import pytest


def through(thing):
    return pickle.loads(pickle.dumps(thing))


def test_robots_travel(robot):
    lead = robot.joints[0]
    changed = robot.with_effect("spring", lead, stiffness=0.1 + 0.2, rest=1 / 3).with_effect("friction_coulomb", lead, coulomb=1e-3)
    for one in (robot, changed, copy.deepcopy(changed)):
        there = through(one)
        assert there.joints == one.joints and there.effects == one.effects and there.name == one.name
        np.testing.assert_array_equal(there.parameters(), one.parameters())
        np.testing.assert_array_equal(there.assemble(), one.assemble())
        assert through(there).texts() == there.texts()
    # An effect changes what a simulation gives: it must not be lost on the way.
    runs = [pkm.simulate(r, robot, duration_s=1.0, rate_hz=100.0) for r in (changed, through(changed))]
    np.testing.assert_array_equal(runs[0][f"tau.{robot.actuators[0]}"], runs[1][f"tau.{robot.actuators[0]}"])


def test_pairs_of_joints_travel():
    arm = pkm.robots.load("serial_arm").with_effect("transmission_coupling", "j4,j5", inertia=0.01)
    assert through(arm).effects == arm.effects


def test_texts_that_are_no_robot_are_refused():
    toml, urdf = pkm.robots.load("prs3").texts()
    with pytest.raises(ValueError, match="robot.toml: line 1"):
        pkm.Robot.from_texts("name =", urdf)
    with pytest.raises(ValueError, match="robot.urdf"):
        pkm.Robot.from_texts(toml, "<robot")


def test_recordings_travel():
    time = np.arange(20) / 10.0
    values = np.random.default_rng(1).normal(size=20)
    values[3] = np.nan
    meta = {"tau": "commanded", "load": {"link": "l", "mass": 0.1 + 0.2, "xyz": [0.0, 0.1, 0.2]}, "gravity": [0.0, 0.1, -9.8], "session": "2021-03-03"}
    recording = pkm.Recording(time, {"q.a": values, "tau.a": -values}, name="here", meta={**meta, "note": "a = b"})
    there = through(recording)
    assert (there.name, there.signals, there.meta) == (recording.name, recording.signals, recording.meta)
    np.testing.assert_array_equal(there.time, recording.time)
    np.testing.assert_array_equal(there["q.a"], values)


def test_reports_travel(hidden):
    _, _, report, _ = hidden
    there = through(report)
    assert str(there) == str(report) and there.verdict == report.verdict
    assert there.html() == report.html() and there._repr_html_() == report._repr_html_()
    np.testing.assert_array_equal(there.evidence["joints"][0]["refined"], report.evidence["joints"][0]["refined"])
    np.testing.assert_array_equal(there.refined_robot().parameters(), report.refined_robot().parameters())
    assert there.refined_robot().effects == report.refined_robot().effects
    assert there.refined("mine.urdf")[0] == report.refined("mine.urdf")[0]
    assert through(there).verdict == report.verdict


def test_identifications_travel(hidden):
    robot, recording, _, _ = hidden
    bare = through(pkm.Identification(robot, method="wls", hold=["offset"], band_hz=8.0))
    assert "not fitted" in repr(bare) and bare.get_params()["band_hz"] == 8.0
    with pytest.raises(AttributeError, match="fit"):
        bare.theta_
    fitted = pkm.Identification(robot, method="wls", hold=["offset"]).fit(recording)
    there = through(fitted)
    assert there.get_params() == fitted.get_params()
    for name in ("theta_", "theta_base_", "covariance_", "ci95_"):
        np.testing.assert_array_equal(getattr(there, name), getattr(fitted, name))
    for name in ("status_", "notes_", "names_", "names_base_", "intervals_", "shapes_", "preprocessing_", "gains_", "payload_", "heldout_"):
        assert getattr(there, name) == getattr(fitted, name), name
    np.testing.assert_array_equal(there.robot_.parameters(), fitted.robot_.parameters())
    # The copy learns again, and what it learns is the same.
    np.testing.assert_array_equal(through(bare).fit(recording).theta_.shape, fitted.theta_.shape)


def test_another_process_reads_them(hidden, tmp_path):
    robot, recording, report, _ = hidden
    (tmp_path / "all.pickle").write_bytes(pickle.dumps((robot, recording, report)))
    code = "import pickle, sys; r, a, b = pickle.load(open(sys.argv[1], 'rb')); print(r.name, len(a), len(b.findings))"
    told = subprocess.run([sys.executable, "-c", code, tmp_path / "all.pickle"], capture_output=True, text=True, check=True)
    assert told.stdout.split() == [robot.name, str(len(recording)), str(len(report.findings))]


def test_damaged_bytes_are_refused():
    with pytest.raises(ValueError, match="pickle of Report") as error:
        pkm.Report._from_bytes(b"\xff\x00")
    assert "\n" not in str(error.value)


def test_parameters_make_another_like_it(hidden):
    robot, _, _, _ = hidden
    first = pkm.Identification(robot, method="ridge", outliers=4.0, find_late_s=0.01, derivative="spline", shapes=True)
    again = pkm.Identification(robot, **first.get_params())
    assert again.get_params() == first.get_params() and first.get_params()["method"] == "ridge"


@pytest.fixture
def mixed():
    """A slide, a turn, and signals of every kind."""
    robot, time = pkm.robots.load("prs3"), np.arange(30) / 100.0
    names = ["q.q1", "dq.q1", "ddq_ref.q1", "tau.q1", "q.q7", "dq.q7", "tau.q7", "q_link.q1", "temp.q1", "wrench.foot.fx", "wrench.foot.mz"]
    names += ["pose.eye.x", "pose.eye.qw", "battery"]
    signals = {name: np.sin(time + k) for k, name in enumerate(names)}
    signals["tau.q1"][4] = np.nan
    return robot, pkm.Recording(time, signals, name="mixed", meta={"tau": "measured", "session": "2026-03-01"})


# Of docs/FORMATS.md, section 2.
UNITS = {
    "q.q1": "m",
    "dq.q1": "m/s",
    "ddq_ref.q1": "m/s²",
    "tau.q1": "N",
    "q.q7": "rad",
    "dq.q7": "rad/s",
    "tau.q7": "N·m",
    "q_link.q1": "m",
    "temp.q1": "°C",
    "wrench.foot.fx": "N",
    "wrench.foot.mz": "N·m",
    "pose.eye.x": "m",
    "pose.eye.qw": "1",
}


def test_signals_have_units(mixed):
    robot, recording = mixed
    assert {name: unit for name in recording.signals if (unit := robot.unit(name))} == UNITS
    assert robot.unit("t") == "s" and robot.unit("q.nobody") is None and robot.unit("battery") is None


def test_pandas_and_back(mixed):
    pandas = pytest.importorskip("pandas", reason="the package pandas is not installed")
    robot, recording = mixed
    frame = recording.to_pandas(robot)
    assert isinstance(frame, pandas.DataFrame) and list(frame.columns) == recording.signals and frame.index.name == "time"
    assert frame.attrs["units"] == UNITS
    np.testing.assert_array_equal(frame["tau.q1"], recording["tau.q1"])
    for back in (pkm.Recording.from_pandas(frame), pkm.Recording.from_pandas(frame.reset_index())):
        assert (back.name, back.signals, back.meta) == (recording.name, recording.signals, recording.meta)
        np.testing.assert_array_equal(back.time, recording.time)
        np.testing.assert_array_equal(back["tau.q1"], recording["tau.q1"])
    # A logger's table: time stamps in a column of its own.
    stamps = pandas.date_range("2026-03-01", periods=30, freq="10ms")
    made = pkm.Recording.from_pandas(pandas.DataFrame({"time": stamps, "q.q1": np.arange(30)}))
    np.testing.assert_allclose(made.time, np.arange(30) / 100.0, atol=1e-12)
    assert made.signals == ["q.q1"]


def test_row_numbers_are_no_time():
    """A logger's table whose time is called something else, read without an index."""
    pandas = pytest.importorskip("pandas", reason="the package pandas is not installed")
    seconds = np.arange(30) / 100.0
    for name in ("timestamp", "t [s]", "stamp", "Time (s)", "header.stamp.sec", "T", "time_ns", "seconds"):
        frame = pandas.DataFrame({"q.q1": np.ones(30), "tau.q1": np.ones(30), "temp.q1": np.ones(30), name: seconds})
        # Rows that were dropped leave an index that is no range, and counts rows as well.
        for rows in (frame, frame[frame[name] != 0.05], frame[::2]):
            with pytest.raises(ValueError) as error:
                pkm.Recording.from_pandas(rows)
            told = f"no column t in the frame, and its index only counts rows (there is {name!r}: rename it t if it is in seconds or dates)"
            assert str(error.value) == told
        made = pkm.Recording.from_pandas(frame.rename(columns={name: "t"}))
        np.testing.assert_array_equal(made.time, seconds)
        made = pkm.Recording.from_pandas(frame.set_index(name))
        np.testing.assert_array_equal(made.time, seconds)
    bare = pandas.DataFrame({"q.q1": np.ones(30), "tau.q1": np.ones(30), "temp.q1": np.ones(30), "tool": np.ones(30)})
    with pytest.raises(ValueError, match=r"index only counts rows \(name that of time t\)"):
        pkm.Recording.from_pandas(bare)
    # Of numbers with a point, of dates, or with a name, an index is meant.
    for index in (pandas.Index(seconds), pandas.date_range("2026-03-01", periods=30, freq="10ms"), pandas.RangeIndex(30, name="t")):
        made = pkm.Recording.from_pandas(bare.set_index(index))
        np.testing.assert_allclose(made.time, seconds if index.name is None else np.arange(30), atol=1e-12)


def test_xarray_and_back(mixed, tmp_path):
    xarray = pytest.importorskip("xarray", reason="the package xarray is not installed")
    robot, recording = mixed
    data = recording.to_xarray(robot)
    assert isinstance(data, xarray.Dataset) and data["time"].attrs["units"] == "s"
    assert {name: data[name].attrs["units"] for name in data if "units" in data[name].attrs} == UNITS
    assert float(data["q.q1"].sel(time=0.1)) == recording["q.q1"][10]
    back = pkm.Recording.from_xarray(data)
    assert (back.name, back.signals, back.meta) == (recording.name, recording.signals, recording.meta)
    np.testing.assert_array_equal(back["tau.q1"], recording["tau.q1"])
    with pytest.raises(ValueError, match="no coordinate time"):
        pkm.Recording.from_xarray(xarray.Dataset({"a": ("x", [1.0])}))


QUICK = {"period_s": 8.0, "restarts": 1, "draws": 4, "iterations": 3, "hold": ["passive-friction"], "seed": 2**64 - 1}


@pytest.mark.parametrize("basis", ["fourier", "spline"])
def test_motions_travel(basis):
    robot = pkm.robots.load("five_bar").with_effect("spring", "shoulder_left", stiffness=0.3, rest=0.1)
    motion = pkm.excite(robot, basis=basis, **QUICK)
    there = through(motion)
    for name in ("period_s", "actuators", "criterion", "quality", "random", "gain", "columns", "structural", "well_conditioned", "margins"):
        assert getattr(there, name) == getattr(motion, name), name
    assert repr(there) == repr(motion)
    for mine, theirs in zip(motion.grid(100.0, periods=2), there.grid(100.0, periods=2), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    ours, copied = motion.recording(50.0), there.recording(50.0)
    assert copied.meta == ours.meta and copied.signals == ours.signals
    assert ours.meta["excitation_seed"] == str(2**64 - 1)
    with pytest.raises(ValueError, match="no motion of"):
        pkm.Excitation._from_bytes(pkm.robots.load("prs3"), motion.__reduce__()[1][1])


def test_controllers_travel_at_rest():
    file = Path(__file__).parents[2] / "docs/examples/controllers/computed_torque.toml"
    robot = pkm.robots.load("five_bar")
    controller = pkm.Controller(robot, file)
    there = through(controller)
    assert (there.law, there.rate_hz, there.joints) == (controller.law, controller.rate_hz, controller.joints)
    assert pkm.Controller.from_text(robot, file.read_text(encoding="utf-8")).law == controller.law
    drives = [robot.joints.index(name) for name in robot.actuators]
    q = np.tile(robot.assemble()[drives], (50, 1))
    wanted = q + 1e-3 * np.sin(np.arange(50) / 10.0)[:, None]
    ours = controller.run(q_meas=q, q_ref=wanted)
    np.testing.assert_array_equal(there.run(q_meas=q, q_ref=wanted), ours)
    # Its observer has moved: a copy that began anew would be another controller.
    for moved in (controller, there):
        with pytest.raises(ValueError, match="reset"):
            pickle.dumps(moved)
    controller.reset()
    np.testing.assert_array_equal(through(controller).run(q_meas=q, q_ref=wanted), ours)
    with pytest.raises(ValueError, match="mine.toml"):
        pkm.Controller.from_text(robot, "law =", "mine.toml")


def test_bounds_of_mu_travel():
    blocks = [{"kind": "real", "repeats": 1}, {"kind": "complex"}, {"kind": "full", "rows": 2, "cols": 1}]
    matrix = np.random.default_rng(3).normal(size=(3, 4)) + 1j * np.random.default_rng(4).normal(size=(3, 4))
    system = (-np.diag([1.0, 2.0]), np.ones((2, 4)), np.ones((3, 2)), np.zeros((3, 4)))
    for one in (pkm.mu(matrix, blocks), pkm.mu(system, blocks), pkm.mu(matrix, blocks, bounds="upper")):
        there = through(one)
        assert (there.upper, there.lower, there.w, there.guaranteed) == (one.upper, one.lower, one.w, one.guaranteed)
        for name in ("frequencies", "uppers", "lowers"):
            np.testing.assert_array_equal(getattr(there, name), getattr(one, name))
        assert (there.worst is None) == (one.worst is None)
        for mine, theirs in zip(one.worst or [], there.worst or [], strict=True):
            np.testing.assert_array_equal(mine, theirs)
    assert pkm.mu(matrix, blocks).worst is not None
