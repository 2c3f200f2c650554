"""Excitation: a motion as arrays that differences and numpy agree with, and as a file that is read back."""

import numpy as np
import pkm
import pytest

QUICK = {"period_s": 8.0, "restarts": 2, "draws": 6, "iterations": 12, "hold": ["passive-friction"]}


@pytest.fixture(scope="module")
def found():
    robot = pkm.robots.load("five_bar")
    return robot, pkm.excite(robot, **QUICK)


def test_a_motion_begins_at_rest_and_its_derivatives_are_derivatives(found):
    robot, motion = found
    assert motion.actuators == robot.actuators and motion.criterion == "condition"
    t, q, v, a = motion.grid(400.0)
    assert len(t) == 3201 and q.shape == v.shape == a.shape == (3201, robot.n_act)
    np.testing.assert_allclose(q[-1], q[0], atol=1e-12)
    for end in (v[0], a[0], v[-1], a[-1]):
        np.testing.assert_allclose(end, 0, atol=1e-9)
    # Central differences of fourth order.
    difference = lambda x: (x[:-4] - 8 * x[1:-3] + 8 * x[3:-1] - x[4:]) / (12 * (t[1] - t[0]))
    np.testing.assert_allclose(difference(q), v[2:-2], atol=1e-6 * np.abs(v).max())
    np.testing.assert_allclose(difference(v), a[2:-2], atol=1e-6 * np.abs(a).max())
    again = motion.sample(t + 3 * motion.period_s)
    for x, y in zip(again, (q, v, a), strict=True):
        np.testing.assert_allclose(x, y, atol=1e-9)


def test_its_condition_is_that_of_numpy_and_no_random_motion_is_better(found):
    robot, motion = found
    # The columns that count, at the samples that the motion is judged at.
    t = np.arange(7200) * motion.period_s / 7200
    q, v, a = motion.sample(t)
    inertial, rest = robot.actuated_regressor(q, v, a), robot.friction_regressor(q, v, a)
    names = [f"{link}.{p}" for link in robot.links for p in ("mass", "mx", "my", "mz", "ixx", "ixy", "iyy", "ixz", "iyz", "izz")]
    drives = [robot.joints.index(j) for j in robot.actuators]
    columns = {}
    bodies = [n for n in robot.links if n != robot.links[0]]
    for b, link in enumerate(bodies[: robot.nv]):
        for p in range(10):
            columns[names[10 * (robot.links.index(link)) + p]] = inertial[:, :, 10 * b + p]
    for d, j in zip(drives, robot.actuators, strict=True):
        for k, what in enumerate(("rotor_inertia", "viscous", "coulomb")):
            columns[f"{j}.{what}"] = rest[:, :, k * robot.nv + d]
        columns[f"{j}.offset"] = np.zeros((len(t), robot.n_act))
        columns[f"{j}.offset"][:, robot.actuators.index(j)] = 1
    w = np.column_stack([columns[name].ravel() for name in motion.columns])
    condition = np.linalg.cond(w / np.linalg.norm(w, axis=0))
    assert motion.quality["condition"] == pytest.approx(condition, rel=2e-2)
    assert motion.gain == pytest.approx(motion.random["condition"] / motion.quality["condition"]) and motion.gain >= 1
    assert motion.structural == len(motion.columns) == w.shape[1]
    rooms = [m["room"] for m in motion.margins]
    assert rooms == sorted(rooms) and rooms[0] >= 0 and {"position", "velocity"} <= {m["what"] for m in motion.margins}


def test_no_search_is_no_loss():
    motion = pkm.excite(pkm.robots.load("five_bar"), **{**QUICK, "iterations": 0})
    assert motion.gain >= 1


def test_a_motion_is_written_and_read(found, tmp_path):
    robot, motion = found
    for name in ("motion.csv", "motion.mcap"):
        motion.save(tmp_path / name, 50.0, periods=2)
        back = pkm.read(tmp_path / name)
        assert len(back) == 801
        q, v, a = motion.sample(back.time)
        for k, joint in enumerate(robot.actuators):
            for kind, want in (("q_ref", q), ("dq_ref", v), ("ddq_ref", a)):
                np.testing.assert_allclose(back[f"{kind}.{joint}"], want[:, k], rtol=1e-9, atol=1e-9)
    assert motion.recording(50.0).meta["excitation_criterion"] == "condition"


def test_two_effects_are_told_apart_and_progress_is_told():
    robot, shares = pkm.robots.load("five_bar"), []
    place = robot.actuators[0]
    pair = [("friction_viscous", place, {"viscous": 1.0}), ("friction_coulomb", place, {"coulomb": 1.0})]
    motion = pkm.excite(robot, criterion="angle", separate=pair, basis="spline", progress=shares.append, **QUICK)
    separation = motion.quality["separation"]
    assert separation["angle_deg"] == pytest.approx(np.degrees(np.arccos(abs(separation["cosine"]))))
    assert motion.gain >= 1 and max(shares) == pytest.approx(1.0) and "spline" in repr(motion)
    assert not {f"{place}.viscous", f"{place}.coulomb"} & set(motion.columns)

    def stop(_):
        raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        pkm.excite(robot, progress=stop, **QUICK)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"criterion": "best"}, "must be one of condition"),
        ({"basis": "bezier"}, "fourier, spline"),
        ({"harmonics": 1}, "3 to 50"),
        ({"share": 2.0}, "share of the limits = 2"),
        ({"criterion": "angle"}, "must be two"),
        ({"separate": [("time_delay", "shoulder_left", {"delay": 0.01})] * 2}, "no column"),
        ({"period_s": float("nan")}, "period = NaN"),
    ],
)
def test_bad_settings_are_refused(arguments, told):
    with pytest.raises(ValueError, match=told):
        pkm.excite(pkm.robots.load("five_bar"), **{**QUICK, **arguments})


def test_bad_rates_are_refused(found):
    _, motion = found
    for rate, periods, told in ((1.0, 1, "at least"), (100.0, 0, "periods = 0"), (1e9, 1, "limit")):
        with pytest.raises(ValueError, match=told):
            motion.grid(rate, periods=periods)
    with pytest.raises(ValueError, match="finite"):
        motion.sample([0.0, float("nan")])


def test_surplus_drives_go_where_the_loops_take_them():
    robot = pkm.robots.load("ups4")
    motion = pkm.excite(robot, **QUICK)
    assert robot.mobility < robot.n_act and motion.coefficients.shape[0] == robot.mobility
    t, q, v, a = motion.grid(100.0)
    assert q.shape == v.shape == a.shape == (len(t), robot.n_act)
    # All drives together leave no loop open, which their motion drawn one by one would.
    q_tree, v_tree, _ = robot.closed_loop_motion(q, v, a)
    gap, jacobian = robot.loop_gap(q_tree)
    assert np.abs(gap).max() < 1e-9
    np.testing.assert_allclose(np.einsum("nij,nj->ni", jacobian, v_tree), 0, atol=1e-8)
    recorded = motion.recording(100.0)
    for k, joint in enumerate(robot.actuators):
        np.testing.assert_array_equal(recorded[f"q_ref.{joint}"], q[:, k])
