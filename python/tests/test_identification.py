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
