"""What closes the loops and shares efforts among drives, against numpy's pseudo-inverse, finite differences and scipy's rotations."""

import numpy as np
import pkm
import pytest
from motions import motion_about


@pytest.fixture
def surplus():
    """The robot with more drives than freedoms, and poses, velocities, accelerations of its drives on one motion."""
    robot = pkm.robots.load("ups4")
    motion = pkm.excite(robot, period_s=8.0, restarts=1, draws=4, iterations=1)
    _, q, v, a = motion.grid(20.0)
    return robot, q, v, a


def test_the_reduction_moves_the_tree(robot, drives_motion):
    q, v, a = drives_motion
    _, v_tree, _ = robot.closed_loop_motion(q, v, a)
    reduction = robot.reduction(q)
    assert reduction.shape == (len(q), robot.nv, len(robot.independent))
    independent = robot.independent_at(q)
    assert (independent == [robot.joints.index(name) for name in robot.independent]).all()
    np.testing.assert_allclose(np.einsum("nij,nj->ni", reduction, v_tree[:, independent[0]]), v_tree, atol=1e-9)
    # As many drives as freedoms: nothing to share.
    np.testing.assert_array_equal(robot.drive_jacobian(q[:2]), np.eye(robot.n_act)[None].repeat(2, 0))
    np.testing.assert_array_equal(robot.distribution(q[:2]), np.eye(robot.n_act)[None].repeat(2, 0))
    np.testing.assert_array_equal(robot.drive_reduction(q), reduction)
    assert robot.reduction(np.zeros((0, robot.n_act))).shape == (0, robot.nv, robot.n_act)


def test_surplus_drives_share_the_smallest_efforts(surplus):
    robot, q, v, a = surplus
    _, v_tree, _ = robot.closed_loop_motion(q, v, a)
    # Which drives determine the motion changes on the way: each is slow somewhere.
    independent = robot.independent_at(q)
    assert independent.shape == (len(q), robot.mobility) and len(np.unique(independent, axis=0)) > 1
    moved = np.take_along_axis(v_tree, independent.astype(int), axis=1)
    drives = robot.drive_jacobian(q)
    assert drives.shape == (len(q), robot.n_act, robot.mobility) and robot.mobility < robot.n_act
    np.testing.assert_allclose(np.einsum("nij,nj->ni", drives, moved), v, atol=1e-9)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", robot.reduction(q), moved), v_tree, atol=1e-9)
    shares = robot.distribution(q)
    np.testing.assert_allclose(shares, np.linalg.pinv(np.swapaxes(drives, 1, 2)), atol=1e-9)
    # Efforts of the tree at rest against gravity, brought to the drives: what inverse dynamics says.
    weight = robot.generalized_gravity(robot.closed_loop_motion(q, 0 * v, 0 * a)[0])
    held = np.einsum("nji,nj->ni", robot.drive_reduction(q), weight)
    np.testing.assert_allclose(held, robot.inverse_dynamics(q, 0 * v, 0 * a), rtol=1e-8, atol=1e-8)


def test_projection_closes_the_loops_and_keeps_the_rest(robot, drives_motion):
    q, v, _ = robot.closed_loop_motion(*drives_motion)
    independent = [robot.joints.index(name) for name in robot.independent]
    passive = [j for j in range(robot.nv) if j not in independent]
    drifted, wild = q.copy(), v.copy()
    drifted[:, passive] += 1e-3
    wild[:, passive] += 0.1
    closed, moved = robot.project(drifted, wild)
    np.testing.assert_allclose(closed, q, atol=1e-8)
    np.testing.assert_allclose(moved, v, atol=1e-7)
    np.testing.assert_array_equal(closed[:, independent], drifted[:, independent])
    gap, jacobian = robot.loop_gap(closed)
    assert np.abs(gap).max(initial=0.0) < 1e-9
    assert np.abs(np.einsum("nij,nj->ni", jacobian, moved)).max(initial=0.0) < 1e-9


def test_stabilised_accelerations_close_gaps_of_velocity(robot):
    if not robot.passive:
        assert robot.forward_dynamics(*np.zeros((3, 1, robot.nv)), stabilisation=10.0)[0].shape == (1, robot.nv)
        return
    q = robot.assemble()[None]
    v = np.full((1, robot.nv), 0.01)
    tau = np.zeros_like(v)
    _, jacobian = robot.loop_gap(q)
    rate = 50.0
    free, _ = robot.forward_dynamics(q, v, tau)
    held, _ = robot.forward_dynamics(q, v, tau, stabilisation=rate)
    opening = jacobian[0] @ v[0]
    assert np.abs(opening).max() > 1e-4
    np.testing.assert_allclose(jacobian[0] @ (held - free)[0], -2.0 * rate * opening, atol=1e-6)
    with pytest.raises(ValueError, match=r"stabilisation = -1 1/s \(must be finite and >= 0\)"):
        robot.forward_dynamics(q, v, tau, stabilisation=-1.0)


def test_loop_wrenches_hold_what_the_tree_does_not(surplus):
    """The power of a loop's wrench on an opening of the loop is that of its efforts along the constraint's Jacobian."""
    robot, q, v, a = surplus
    wrenches, efforts = robot.loop_wrenches(q, v, a), robot.loop_efforts(q, v, a)
    q_tree, v_tree, a_tree = robot.closed_loop_motion(q, v, a)
    assert wrenches.shape == (len(q), 4, 6)
    # Spherical ends carry forces and no moments.
    assert not wrenches[:, :, 3:].any()
    _, jacobian = robot.loop_gap(q_tree)
    held = robot.rnea(q_tree, v_tree, a_tree) - np.einsum("nij,ni->nj", jacobian, efforts)
    passive = [robot.joints.index(name) for name in robot.passive]
    assert np.abs(held[:, passive]).max() < 1e-7 * np.abs(efforts).max()
    lengths = np.linalg.norm(wrenches[:, :, :3], axis=2)
    of_rows = np.linalg.norm(efforts.reshape(len(q), 4, 3), axis=2)
    np.testing.assert_allclose(lengths, of_rows, rtol=1e-12)


def test_the_output_is_the_pose_and_its_rates(robot, drives_motion):
    transform = pytest.importorskip("scipy.spatial.transform", reason="the package scipy is not installed")
    q, _, _ = robot.closed_loop_motion(*drives_motion)
    link = robot.links[-1]
    places, rates = robot.output_jacobian(q, link=link)
    pose = robot.frame_pose(link, q)
    np.testing.assert_allclose(places[:, :3], pose[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(transform.Rotation.from_euler("XYZ", places[:, 3:]).as_matrix(), pose[:, :3, :3], atol=1e-12)
    step = 1e-6
    for j in range(robot.nv):
        way = step * np.eye(robot.nv)[j]
        forth, back = (robot.output_jacobian(q + sign * way, link=link)[0] for sign in (1, -1))
        turned = np.angle(np.exp(1j * (forth - back)))
        np.testing.assert_allclose(rates[:, :, j], np.hstack([(forth - back)[:, :3], turned[:, 3:]]) / (2 * step), rtol=1e-4, atol=1e-6)
    with pytest.raises(ValueError, match='link "nothing": no such link, sensor or loop'):
        robot.output_jacobian(q, link="nothing")


def test_a_difference_is_the_way_that_integration_goes(robot):
    q, v, _ = motion_about(robot.assemble())
    np.testing.assert_allclose(robot.difference(q, robot.integrate(q, 0.3 * v)), 0.3 * v, atol=1e-12)



def test_a_wrong_number_of_drives_is_told(robot):
    with pytest.raises(ValueError, match=rf"q has shape .*must be \(n_samples, {robot.n_act}\)"):
        robot.reduction(np.zeros((2, robot.n_act + 1)))
