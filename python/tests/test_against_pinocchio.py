"""Serial arms against the wheel `pin`, element by element."""

from pathlib import Path

import numpy as np
import pkm
import pytest
from motions import motion_about

pin = pytest.importorskip("pinocchio", reason="the package pin is not installed")


@pytest.fixture
def crooked(tmp_path):
    """Folder with an arm of three links whose centres of mass and inertias are nowhere on an axis."""
    links = "".join(
        f"""<link name="l{i}"><inertial><origin xyz="0.1 {0.05 * i} -0.2" rpy="0.3 -0.2 {i}"/><mass value="{1.5 + i}"/>
        <inertia ixx="0.03" ixy="0.002" ixz="-0.001" iyy="0.04" iyz="0.003" izz="0.05"/></inertial></link>"""
        for i in range(3)
    )
    kinds = ["revolute", "prismatic", "revolute"]
    joints = "".join(
        f"""<joint name="j{i}" type="{kind}"><parent link="{"base" if i == 0 else f"l{i - 1}"}"/><child link="l{i}"/>
        <origin xyz="0.2 0.1 {0.3 * i}" rpy="0.4 {0.5 * i} -0.2"/><axis xyz="{i} 1 0.5"/>
        <limit lower="-1" upper="1" velocity="2" effort="50"/></joint>"""
        for i, kind in enumerate(kinds)
    )
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm"><link name="base"/>{links}{joints}</robot>')
    actuators = "".join(f'[[actuator]]\njoint = "j{i}"\n' for i in range(3))
    (tmp_path / "arm.robot.toml").write_text(f'name = "arm"\nurdf = "arm.urdf"\n{actuators}')
    return tmp_path


def compare(robot, urdf):
    model = pin.buildModelFromUrdf(str(urdf))
    assert list(model.names)[1:] == robot.joints
    data = model.createData()
    q, v, a = motion_about(np.zeros(model.nv), amplitude=0.5)
    tau, regressor, of_drives = robot.inverse_dynamics(q, v, a), robot.joint_torque_regressor(q, v, a), robot.actuated_regressor(q, v, a)
    for i in range(len(q)):
        np.testing.assert_allclose(tau[i] - robot.armature * a[i], pin.rnea(model, data, q[i], v[i], a[i]), rtol=1e-10, atol=1e-10)
        expected = pin.computeJointTorqueRegressor(model, data, q[i], v[i], a[i])
        np.testing.assert_allclose(regressor[i], expected, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(of_drives[i], expected, rtol=1e-10, atol=1e-10)
    ours = robot.parameters().reshape(-1, 10)
    theirs = [inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]]
    np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-12)


def compare_dynamics(robot, urdf, link):
    model = pin.buildModelFromUrdf(str(urdf))
    bare = model.copy()
    model.armature = robot.armature
    data, bare_data = model.createData(), bare.createData()
    rng = np.random.default_rng(3)
    q, v, tau = (rng.uniform(-1, 1, (20, model.nv)) for _ in range(3))
    same = lambda ours, theirs: np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-10)
    mass, bias, weight, a = robot.crba(q), robot.nle(q, v), robot.generalized_gravity(q), robot.aba(q, v, tau)
    (kinetic, potential), (centre, centre_jacobian) = robot.energies(q, v), robot.center_of_mass(q)
    pose = robot.frame_pose(link, q)
    references = {"world": pin.WORLD, "local": pin.LOCAL, "local_world_aligned": pin.LOCAL_WORLD_ALIGNED}
    jacobians = {name: (robot.frame_jacobian(link, q, reference=name), robot.frame_jacobian(link, q, v, reference=name)) for name in references}
    frame = model.getFrameId(link)
    kinetic_columns, potential_columns = robot.energy_regressors(q, v)
    velocity, acceleration = robot.frame_motion(link, q, v, tau)
    wrenches = robot.joint_wrenches(q, v, tau)
    for i in range(len(q)):
        upper = np.triu(pin.crba(model, data, q[i]))
        same(mass[i], upper + np.triu(upper, 1).T)
        same(bias[i], pin.nonLinearEffects(model, data, q[i], v[i]))
        same(weight[i], pin.computeGeneralizedGravity(model, data, q[i]))
        same(a[i], pin.aba(model, data, q[i], v[i], tau[i]))
        same(kinetic[i], pin.computeKineticEnergy(model, data, q[i], v[i]))
        same(potential[i], pin.computePotentialEnergy(model, data, q[i]))
        same(kinetic_columns[i], np.ravel(pin.computeKineticEnergyRegressor(model, data, q[i], v[i])))
        same(potential_columns[i], np.ravel(pin.computePotentialEnergyRegressor(model, data, q[i])))
        pin.forwardKinematics(model, data, q[i], v[i], tau[i])
        pin.updateFramePlacements(model, data)
        same(velocity[i], pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector)
        same(acceleration[i], pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector)
        # An open chain: what its joints carry is what inverse dynamics passes on, without rotors.
        pin.forwardKinematics(bare, bare_data, q[i])
        pin.rnea(bare, bare_data, q[i], v[i], tau[i])
        same(wrenches[i], [bare_data.oMi[j].act(bare_data.f[j]).vector for j in range(1, model.njoints)])
        same(centre_jacobian[i], pin.jacobianCenterOfMass(model, data, q[i]))
        same(centre[i], pin.centerOfMass(model, data, q[i]))
        pin.computeJointJacobiansTimeVariation(model, data, q[i], v[i])
        pin.updateFramePlacements(model, data)
        same(pose[i], data.oMf[frame].homogeneous)
        for name, reference in references.items():
            same(jacobians[name][0][i], pin.getFrameJacobian(model, data, frame, reference))
            same(jacobians[name][1][i], pin.getFrameJacobianTimeVariation(model, data, frame, reference))


def test_dynamics_of_a_crooked_arm(crooked):
    compare_dynamics(pkm.load(crooked / "arm.robot.toml"), crooked / "arm.urdf", "l2")


def test_a_crooked_arm(crooked):
    compare(pkm.load(crooked / "arm.robot.toml"), crooked / "arm.urdf")


@pytest.mark.parametrize("name", ["serial_arm", "serial_arm7"])
def test_the_shipped_arms(name):
    # The sources of the shipped robots lie beside this folder; the wheel carries them inside.
    compare(pkm.robots.load(name), Path(__file__).parents[2] / "robots" / name / f"{name}.urdf")
