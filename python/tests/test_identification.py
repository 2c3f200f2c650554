"""Parameters from recordings through numpy: learned names, the robot that comes out, refusals."""

import numpy as np
import pkm
import pytest


@pytest.fixture(scope="module")
def runs():
    """A 3-PRS with more friction than its model says, and two motions of it."""
    robot = pkm.robots.load("prs3")
    truth = robot.with_effect("friction_coulomb", "q1", coulomb=60.0).with_effect("payload", "platform", mass=2.0)
    return robot, [pkm.simulate(truth, robot, seed=seed, duration_s=10.0) for seed in (3, 4)]


def test_fit_learns_friction_and_load(runs):
    robot, (train, test) = runs
    estimate = pkm.Identification(robot)
    assert "not fitted" in repr(estimate)
    with pytest.raises(AttributeError, match="fit"):
        estimate.theta_
    assert estimate.fit(train, holdout=test) is estimate
    learned = dict(zip(estimate.names_, estimate.theta_, strict=True))
    assert learned["q1.coulomb"] == pytest.approx(26.0 + 60.0, rel=0.03)
    before, after = estimate.heldout_["q1"]
    assert after < 0.2 * before
    assert all(after < 1.02 * before for before, after in estimate.heldout_.values())
    assert estimate.status_ == "identified", estimate.notes_
    sd = np.sqrt(np.diag(estimate.covariance_))
    assert sd.shape == estimate.theta_base_.shape == (len(estimate.names_base_),) and (sd > 0).all()
    with pytest.raises(ValueError, match="read-only"):
        estimate.theta_[0] = 1.0


def test_the_identified_robot_needs_the_recorded_effort(runs):
    robot, (train, test) = runs
    better = pkm.Identification(robot, method="wls").fit([train], holdout=[test]).robot_
    assert better.joints == robot.joints
    again = pkm.Identification(better).fit(train, holdout=test)
    # Standstill, where friction is undetermined, leaves five per cent with the true robot as well.
    assert all(before < 0.06 for before, _ in again.heldout_.values())


def test_held_terms_stay(runs):
    robot, (train, _) = runs
    estimate = pkm.Identification(robot, hold=["rotor", "offset"]).fit(train)
    learned = dict(zip(estimate.names_, estimate.theta_, strict=True))
    assert learned["q1.rotor_inertia"] == 20.0 and learned["q6.offset"] == 0.0


@pytest.mark.parametrize(
    ("arguments", "told"), [({"method": "best"}, "must be one of sdp"), ({"hold": ["mass"]}, "must be of rotor"), ({"band_hz": 1e9}, "0.4 of")]
)
def test_bad_settings_are_refused(runs, arguments, told):
    robot, (train, _) = runs
    with pytest.raises(ValueError, match=told):
        pkm.Identification(robot, **arguments).fit(train)


def test_intervals_are_those_of_the_method(runs):
    robot, (train, test) = runs
    learned = {m: pkm.Identification(robot, method=m).fit(train, holdout=test) for m in ("wls", "ols", "ridge")}
    for estimate in learned.values():
        low, high = estimate.ci95_.T
        assert estimate.ci95_.shape == (len(estimate.names_base_), 2) and (low < estimate.theta_base_).all() and (high > estimate.theta_base_).all()
        # One factor for all parameters, normal or a little more for few rows.
        factor = (high - low) / (2 * np.sqrt(np.diag(estimate.covariance_)))
        assert np.ptp(factor) < 1e-6 * factor[0] and 1.95 < factor[0] < 3
    # No unbiased estimate that is linear in the efforts is better than the weighted one.
    width = {m: np.log(np.ptp(e.ci95_, axis=1)).mean() for m, e in learned.items()}
    assert width["wls"] <= width["ols"] + 0.02, width
    assert "posterior" in learned["ridge"].intervals_ and "repetitions" in learned["wls"].intervals_


@pytest.fixture(scope="module")
def weighed():
    """An arm with and without a weighed mass in its hand, efforts in units of their own."""
    robot, link = pkm.robots.load("five_bar"), "distal_left"
    loaded = robot.with_effect("payload", link, mass=1.0)
    runs = []
    for truth, meta in ((robot, None), (loaded, {"load": {"link": link, "mass": 1.0, "xyz": [0, 0, 0]}})):
        r = pkm.simulate(truth, robot, seed=2, duration_s=20.0)
        scaled = {name: r[name] / (1.25 if name.startswith("tau.") else 1.0) for name in r.signals}
        runs.append(pkm.Recording(r.time, scaled, name="made", meta=meta))
    return robot, link, runs


def test_gains_come_from_a_weighed_mass(weighed):
    robot, _, recordings = weighed
    estimate = pkm.Identification(robot, gains=True).fit(recordings)
    found = estimate.gains_
    assert list(found["drives"]) == robot.actuators and estimate.payload_ is None
    for drive in found["drives"].values():
        # A drive that calls 1.25 N·m one has a gain of 1.25.
        assert drive["gain"] == pytest.approx(1.25, rel=0.1) and drive["ci95"][0] < drive["gain"] < drive["ci95"][1]
        assert 0 <= drive["load_share"] < 1
    # The mass hangs at the elbow: it is the left drive's.
    assert found["drives"][robot.actuators[0]]["load_share"] > 0.05
    without = pkm.Identification(robot, gains=True).fit(recordings[:1]).gains_
    assert without["status"] == "not_identified" and without["drives"] == {} and "states a load" in without["notes"][0]


def test_a_payload_is_weighed(runs):
    robot, _ = runs
    loaded = pkm.simulate(robot.with_effect("payload", "platform", mass=3.0), robot, seed=5, duration_s=20.0)
    estimate = pkm.Identification(robot, payload="platform").fit(loaded)
    found = estimate.payload_
    assert found["link"] == "platform" and found["body"]["mass"] == pytest.approx(3.0, rel=0.1)
    assert found["shown"] and all(e["ci95"][0] < e["value"] < e["ci95"][1] for e in found["shown"])
    assert estimate.gains_ is None and estimate.shapes_ == []
    with pytest.raises(ValueError, match="no link"):
        pkm.Identification(robot, payload="tail").fit(loaded)


def test_preprocessing_is_accounted_for(runs):
    robot, (train, _) = runs
    late = pkm.Recording(train.time, {n: np.roll(train[n], 6) if n.startswith("tau.") else train[n] for n in train.signals}, name="late")
    estimate = pkm.Identification(robot, find_late_s=0.05, rate_hz=250.0).fit(late)
    steps = "\n".join(estimate.preprocessing_)
    found = float(next(line for line in estimate.preprocessing_ if "clock" in line).split("late_s")[1])
    assert "decimation" in steps and found == pytest.approx(6 / 500, abs=1e-3)
    for wrong in ({"late_s": 0.1, "find_late_s": 0.1}, {"rate_hz": 0.0}, {"outliers": float("nan")}, {"derivative": "best"}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            pkm.Identification(robot, **wrong)
