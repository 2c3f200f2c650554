"""Exported robots against MuJoCo and Pinocchio: the same mass matrix, the same bias, the same closed poses."""

import drawn_robots
import mujoco
import numpy as np
import pkm
import pytest
import yaml
from drawn_robots import reduction

RNG = np.random.default_rng(20261126)

# What the chains are joined by, and how many passive joints that determines.
SPATIAL = {
    "sphere": (["x", "y", "z"], 3),
    "pin": (["x", "y", "z", "rx", "ry"], 5),
    "pin about y": (["x", "y", "z", "rx", "rz"], 5),
    "rigid": (["x", "y", "z", "rx", "ry", "rz"], 6),
}
PLANAR = {
    "x y": (["x", "y"], 2),
    "x y rx": (["x", "y", "rx"], 2),
    "x y rz": (["x", "y", "rz"], 3),
    "five of six": (["x", "y", "z", "rx", "ry"], 2),
}
# Exact for the toolbox by way of massless joints, not for MuJoCo.
LOOSE = {
    "cylinder": (["x", "y", "rx", "ry"], 4),
    "slide": (["x", "y", "rx", "ry", "rz"], 5),
    "plane": (["z"], 1),
    "parallel": (["rx", "ry", "rz"], 3),
    "point on a line": (["x", "z"], 2),
}


def robots(folder):
    """Every robot that both programs can have."""
    for name in pkm.robots.names():
        yield name, pkm.robots.load(name)
    for seed in range(3):
        yield f"tree {seed}", drawn_robots.tree(folder, seed)
    yield "tree on its side", drawn_robots.tree(folder, 7, gravity=(3.0, -9.0, 0.4))
    yield "tree upside down", drawn_robots.tree(folder, 8, gravity=(0.0, 0.0, 9.81))
    yield "follower", drawn_robots.coupled(folder, 1, {"j0": -0.7})
    for seed in range(2):
        for name, (constrain, n) in SPATIAL.items():
            yield f"{name} {seed}", drawn_robots.joined_chains(folder, seed, constrain, n)
        for name, (constrain, n) in PLANAR.items():
            yield f"planar {name} {seed}", drawn_robots.planar_chains(folder, seed, constrain, n)


def mass_and_bias(robot, q, v):
    """Mass matrix of the tree, rotors included, and bias, by the columns of inverse dynamics."""
    zero, nv = np.zeros(robot.nv), robot.nv
    tiled = np.tile(q, (nv, 1))
    columns = robot.rnea(tiled, np.zeros((nv, nv)), np.eye(nv)) - robot.rnea(q[None], zero[None], zero[None])
    return columns.T, robot.rnea(q[None], v[None], zero[None])[0]


def assert_same(ours, theirs):
    np.testing.assert_allclose(theirs, ours, rtol=1e-8, atol=1e-8 * np.abs(ours).max())


def closed_poses(robot, n=3):
    """Coordinates that close the loops, and the motions that keep them closed: the assembly first."""
    yield reduction(robot, np.zeros(robot.n_act))
    for step in RNG.uniform(-0.03, 0.03, (n, robot.n_act)):
        yield reduction(robot, step)


# ---- MuJoCo


class InMujoco:
    """An exported robot without friction, springs and travel limits, which are no part of mass matrix and bias."""

    def __init__(self, robot):
        self.model = mujoco.MjModel.from_xml_string(robot.to_mjcf())
        self.data = mujoco.MjData(self.model)
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
        self.dof = [self.model.joint(name).dofadr[0] for name in robot.joints]
        assert self.model.nv == robot.nv
        assert (self.model.dof_damping[self.dof] > 0).any()
        self.model.dof_damping[:] = 0.0
        self.model.dof_frictionloss[:] = 0.0

    def at(self, q, v):
        self.data.qpos[self.dof], self.data.qvel[self.dof] = q, v
        mujoco.mj_forward(self.model, self.data)
        mass = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, mass)
        return mass[np.ix_(self.dof, self.dof)], self.data.qfrc_bias[self.dof].copy()

    def constraints(self):
        """Position errors and Jacobian of the loops and couplings."""
        data = self.data
        rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        return data.efc_pos[rows], data.efc_J.reshape(data.nefc, -1)[rows][:, self.dof]


def test_mujoco_has_the_same_mass_matrix_and_bias(tmp_path):
    for name, robot in robots(tmp_path):
        there = InMujoco(robot)
        for _ in range(4):
            q, v = RNG.uniform(-1, 1, robot.nv), RNG.uniform(-2, 2, robot.nv)
            for ours, theirs in zip(mass_and_bias(robot, q, v), there.at(q, v), strict=True):
                assert_same(ours, theirs)
        assert name


def test_mujoco_closes_the_same_loops(tmp_path):
    n_closed = 0
    for name, robot in robots(tmp_path):
        there = InMujoco(robot)
        mujoco.mj_resetDataKeyframe(there.model, there.data, there.model.key("home").id)
        np.testing.assert_allclose(there.data.qpos[there.dof], robot.assemble(), atol=1e-9)
        for q, motions in closed_poses(robot):
            there.at(q, np.zeros(robot.nv))
            error, jacobian = there.constraints()
            assert np.abs(error).max(initial=0.0) < 1e-9, name
            # Motions that keep our loops closed keep theirs closed, and theirs leave no others.
            assert np.abs(jacobian @ motions).max(initial=0.0) < 1e-9 * (1 + np.abs(motions).max()), name
            n_rows = np.linalg.matrix_rank(jacobian, tol=1e-7) if len(jacobian) else 0
            assert n_rows == robot.nv - robot.n_act, name
            n_closed += len(error) > 0
    assert n_closed > 60


def test_mujoco_moves_as_our_efforts_say(tmp_path):
    for name, robot in robots(tmp_path):
        there = InMujoco(robot)
        drives = [robot.joints.index(joint) for joint in robot.actuators]
        q, _ = reduction(robot, np.zeros(robot.n_act))
        a = RNG.uniform(-1, 1, (1, robot.n_act))
        tau = robot.inverse_dynamics(q[None, drives], np.zeros_like(a), a)[0]
        there.model.actuator_ctrllimited[:] = 0
        for joint, effort in zip(robot.actuators, tau, strict=True):
            there.data.ctrl[there.model.actuator(joint).id] = effort
        there.at(q, np.zeros(robot.nv))
        # MuJoCo's loops are soft: solimp lets them give way by one part in ten thousand.
        moved = there.data.qacc[there.dof][drives]
        np.testing.assert_allclose(moved, a[0], rtol=0.01, atol=0.01, err_msg=name)


def test_mujoco_has_friction_rotors_and_springs():
    robot = pkm.robots.load("prs3").with_effect("friction_coulomb", "q1", coulomb=5.0).with_effect("spring", "q7", stiffness=3.0, rest=0.2)
    robot = robot.with_effect("torque_ripple", "q6", amplitude=1.0, order=3.0)
    model = mujoco.MjModel.from_xml_string(robot.to_mjcf())
    dof = model.joint("q1").dofadr[0]
    assert (model.dof_frictionloss[dof], model.dof_damping[dof], model.dof_armature[dof]) == (31.0, 180.0, 20.0)
    assert (model.joint("q7").stiffness[0], model.joint("q7").qpos_spring[0]) == (3.0, pytest.approx(0.2))
    assert model.joint("q1").range.tolist() == [0.0, 0.3]
    assert model.actuator("q1").ctrlrange.tolist() == [-1500.0, 1500.0]
    assert "effect torque_ripple at \"q6\" is left out" in robot.to_mjcf()


def test_mujoco_holds_the_loops_together_in_motion():
    robot = pkm.robots.load("prs3")
    model = mujoco.MjModel.from_xml_string(robot.to_mjcf())
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] = [160.0, 90.0, 120.0]
    for _ in range(300):
        mujoco.mj_step(model, data)
    assert np.ptp(data.qpos[:3]) > 1e-3
    rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert np.abs(data.efc_pos[rows]).max() < 1e-4


def test_a_follower_of_two_joints_is_a_tendon(tmp_path):
    robot = drawn_robots.coupled(tmp_path, 2, {"j0": -0.7, "j1": 2.0})
    there = InMujoco(robot)
    for q, motions in closed_poses(robot):
        there.at(q, np.zeros(robot.nv))
        error, jacobian = there.constraints()
        assert len(error) == 1 and abs(error[0]) < 1e-9
        assert np.abs(jacobian @ motions).max() < 1e-9 and np.abs(jacobian).max() > 0.5
    with pytest.raises(ValueError, match=r'coupling of "j3": it follows 2 independent joints'):
        robot.to_gepetto()


def test_loops_that_mujoco_has_not_are_refused(tmp_path):
    for constrain, n in LOOSE.values():
        with pytest.raises(ValueError, match=rf'loop "yoke": {" ".join(constrain)} cannot be closed by MuJoCo'):
            drawn_robots.joined_chains(tmp_path, 3, constrain, n).to_mjcf()


# ---- Pinocchio

pin = pytest.importorskip("pinocchio", reason="the package pin is not installed")
