"""What several tests need: robots, motions inside their travel, one diagnosis."""

import pkm
import pytest
from fleets import fleet_folder
from motions import driven, motion_about


@pytest.fixture(params=[name for name in pkm.robots.names() if name != "ups4"])
def robot(request):
    """Every shipped robot but the one with more drives than freedoms, whose drives cannot be moved one by one."""
    return pkm.robots.load(request.param)


@pytest.fixture
def drives_motion(robot):
    """Motion of the drives about the assembly."""
    return motion_about(robot.assemble()[driven(robot)])


@pytest.fixture(scope="session")
def hidden():
    """A 3-PRS with friction at q1 that its model does not know, and its diagnosis: robot, recording, report, shares of progress."""
    robot = pkm.robots.load("prs3")
    truth = robot.with_effect("friction_coulomb", "q1", coulomb=90.0)
    recording = pkm.simulate(truth, robot, seed=3, duration_s=10.0, name="first")
    other = pkm.simulate(truth, robot, seed=4, duration_s=10.0, name="second")
    shares = []
    report = pkm.diagnose(robot, [recording], holdout=[other], progress=shares.append)
    return robot, recording, report, shares


@pytest.fixture(scope="session")
def fleet_root(tmp_path_factory):
    """The files of a fleet, to read only."""
    return fleet_folder(tmp_path_factory.mktemp("fleet"))


@pytest.fixture(scope="session")
def diagnosed(fleet_root, tmp_path_factory):
    """Its verdicts, by one process without a cluster."""
    from pkm import fleet

    return fleet.diagnose(fleet.find(str(fleet_root)), str(tmp_path_factory.mktemp("alone") / "verdicts.parquet"), workers=0)


@pytest.fixture(scope="session")
def identified(fleet_root, tmp_path_factory):
    """Its parameters, by one process without a cluster."""
    from pkm import fleet

    return fleet.identify(fleet.find(str(fleet_root)), str(tmp_path_factory.mktemp("alone") / "parameters.parquet"), workers=0)
