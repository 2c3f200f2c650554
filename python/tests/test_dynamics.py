"""Identities of mechanics through numpy, on every shipped robot."""

import threading
import time

import numpy as np
import pkm
import pytest
from motions import driven, motion_about


def test_regressor_times_parameters_is_inverse_dynamics(robot, drives_motion):
    q, v, a = drives_motion
    regressor = robot.actuated_regressor(q, v, a)
    assert regressor.shape == (len(q), robot.n_act, 10 * robot.nv)
    assert regressor.flags.c_contiguous
    tau = regressor @ robot.parameters() + robot.armature[driven(robot)] * a
    np.testing.assert_allclose(robot.inverse_dynamics(q, v, a), tau, rtol=1e-10, atol=1e-9)


def test_tree_regressor_times_parameters_is_rnea(robot):
    q, v, a = motion_about(robot.assemble())
    tau = robot.joint_torque_regressor(q, v, a) @ robot.parameters() + robot.armature * a
    np.testing.assert_allclose(robot.rnea(q, v, a), tau, rtol=1e-10, atol=1e-9)


def test_power_of_the_drives_is_power_of_the_tree(robot, drives_motion):
    q, v, a = drives_motion
    q_tree, v_tree, a_tree = robot.closed_loop_motion(q, v, a)
    of_drives = np.sum(robot.inverse_dynamics(q, v, a) * v, axis=1)
    of_tree = np.sum(robot.rnea(q_tree, v_tree, a_tree) * v_tree, axis=1)
    np.testing.assert_allclose(of_drives, of_tree, rtol=1e-9, atol=1e-9)


def test_tree_motion_is_a_motion_of_the_drives(robot):
    q, v, a = motion_about(robot.assemble()[driven(robot)], n_samples=4001)
    q_tree, v_tree, a_tree = robot.closed_loop_motion(q, v, a)
    for tree, drives in [(q_tree, q), (v_tree, v), (a_tree, a)]:
        assert tree.shape == (len(q), robot.nv)
        np.testing.assert_array_equal(tree[:, driven(robot)], drives)
    # Passive joints as well: velocities are derivatives of positions only if the loops stay closed on one branch.
    step = 2.0 / (len(q) - 1)
    for value, slope in [(q_tree, v_tree), (v_tree, a_tree)]:
        inside = slope[1:-1]
        error = np.abs((value[2:] - value[:-2]) / (2.0 * step) - inside).max()
        assert error < 1e-4 * (1.0 + np.abs(inside).max())


def five_bar_tips(q):
    """Ends of the two arms of the shipped five-bar [m] in its plane, from the numbers of its URDF and nothing of the library."""
    tips = []
    arms = [(-0.15, 2.007128639793479, -1.255300645817396), (0.15, 1.134464013796314, 1.255300645817396)]
    for k, (base, shoulder, elbow) in enumerate(arms):
        first = shoulder + q[:, 2 * k]
        second = first + elbow + q[:, 2 * k + 1]
        tips.append(base + 0.25 * np.exp(1j * first) + 0.35 * np.exp(1j * second))
    return tips


def test_loops_close():
    robot = pkm.robots.load("five_bar")
    assert robot.joints == ["shoulder_left", "elbow_left", "shoulder_right", "elbow_right"]
    q, _, _ = robot.closed_loop_motion(*motion_about(robot.assemble()[driven(robot)], amplitude=0.3))
    left, right = five_bar_tips(q)
    assert np.ptp(left.real) > 0.05
    np.testing.assert_allclose(left, right, atol=1e-9)


def test_a_long_way_between_samples_stays_on_the_branch():
    robot = pkm.robots.load("prs3")
    start = robot.assemble()[driven(robot)]
    way = start + np.linspace(0.0, 0.1, 201)[:, None] * np.array([1.0, 0.2, -0.4])
    zero = np.zeros_like(way)
    step_by_step, _, _ = robot.closed_loop_motion(way, zero, zero)
    jump, _, _ = robot.closed_loop_motion(way[[0, -1]], zero[:2], zero[:2])
    np.testing.assert_allclose(jump[-1], step_by_step[-1], atol=1e-9)


def test_names_and_numbers_of_a_robot(robot):
    assert robot.nv == len(robot.joints)
    assert robot.n_act == len(robot.actuators) == robot.mobility
    assert sorted(robot.actuators + robot.passive) == sorted(robot.joints)
    assert len(set(robot.links)) == len(robot.links) > robot.n_act
    assert robot.parameters().shape == (10 * robot.nv,)
    assert robot.armature.shape == (robot.nv,)
    assert robot.name in repr(robot)


def test_numbers_of_other_types_are_accepted():
    robot = pkm.robots.load("serial_arm")
    q, v, a = motion_about(robot.assemble())
    expected = robot.inverse_dynamics(q, v, a)
    np.testing.assert_array_equal(robot.inverse_dynamics(np.asfortranarray(q), v.tolist(), a), expected)
    assert robot.inverse_dynamics(q.astype(np.float32), v, a).dtype == np.float64
    assert robot.inverse_dynamics(q[:0], v[:0], a[:0]).shape == (0, robot.n_act)


def test_an_effect_gives_another_robot():
    robot = pkm.robots.load("prs3")
    heavy = robot.with_effect("payload", "platform", mass=2.0).with_effect("friction_coulomb", "q1", coulomb=3.0)
    assert robot.effects == []
    assert [e["effect"] for e in heavy.effects] == ["payload", "friction_coulomb"]
    assert heavy.effects[1] == {"effect": "friction_coulomb", "where": ["q1"], "parameters": {"coulomb": 3.0}}
    at = robot.assemble()[None, driven(robot)]
    zero = np.zeros_like(at)
    added = heavy.inverse_dynamics(at, zero, zero) - robot.inverse_dynamics(at, zero, zero)
    assert added.sum() == pytest.approx(2.0 * 9.81, rel=0.2)


def test_the_catalogue_is_complete():
    entries = {e["name"]: e for e in pkm.effects()}
    assert {"friction_coulomb", "friction_stribeck", "payload", "time_delay"} <= set(entries)
    coulomb = entries["friction_coulomb"]
    assert coulomb["place"] == "a driven joint" and coulomb["energy"] == "dissipates"
    assert coulomb["parameters"] == [
        {"name": "coulomb", "unit": {"prismatic": "N", "revolute": "N·m"}, "lower": 0.0, "upper": np.inf, "default": None}
    ]
    assert all(e["sentence"] and e["equation"] and e["look_alikes"] for e in entries.values())


def test_python_runs_while_rust_computes():
    robot = pkm.robots.load("prs3")
    n = 60_000
    q = np.tile(robot.assemble()[driven(robot)], (n, 1))
    zero = np.zeros_like(q)
    worker = threading.Thread(target=robot.actuated_regressor, args=(q, zero, zero))
    ticks = 0
    worker.start()
    while worker.is_alive():
        ticks += 1
        time.sleep(0.001)
    # With the interpreter held there would be one or two.
    assert ticks > 5


def test_closed_loop_forward_dynamics_undoes_inverse_dynamics():
    robot = pkm.robots.load("prs3")
    drives = driven(robot)
    q, v, a = motion_about(np.array([0.15, 0.15, 0.15]), n_samples=20)
    tree = robot.closed_loop_motion(q, v, a)
    tau = np.zeros_like(tree[0])
    tau[:, drives] = robot.inverse_dynamics(q, v, a)
    acceleration, efforts = robot.forward_dynamics(tree[0], tree[1], tau)
    np.testing.assert_allclose(acceleration, tree[2], atol=1e-8)
    np.testing.assert_allclose(efforts, robot.loop_efforts(q, v, a), atol=1e-7)
    gap, jacobian = robot.loop_gap(tree[0])
    assert np.abs(gap).max() < 1e-10
    assert np.abs(np.einsum("nij,nj->ni", jacobian, tree[1])).max() < 1e-11
    # Through the null space of the loops the tree's mass matrix is the closed loop's.
    mass, reduced = robot.crba(tree[0]), robot.reduced_mass_matrix(q)
    power = np.einsum("ni,nij,nj->n", v, reduced, v)
    np.testing.assert_allclose(power, np.einsum("ni,nij,nj->n", tree[1], mass, tree[1]), rtol=1e-10)
    assert robot.independent == robot.actuators


def test_friction_columns_reach_the_drives():
    robot = pkm.robots.load("five_bar")
    q, v, a = motion_about(robot.assemble()[driven(robot)], n_samples=20, amplitude=0.1)
    _, v_tree, a_tree = robot.closed_loop_motion(q, v, a)
    columns = robot.friction_regressor(q, v, a).reshape(len(q), robot.n_act, 3, robot.nv)
    lost = np.einsum("nk,nkj->nj", v, columns[:, :, 1, :])
    np.testing.assert_allclose(lost, v_tree**2, atol=1e-10)
    np.testing.assert_allclose(np.einsum("nk,nkj->nj", v, columns[:, :, 0, :]), v_tree * a_tree, atol=1e-9)


def test_a_misspelt_link_or_reference_is_named():
    robot = pkm.robots.load("serial_arm")
    q = np.zeros((1, robot.nv))
    with pytest.raises(ValueError, match="elbw"):
        robot.frame_jacobian("elbw", q)
    with pytest.raises(ValueError, match="sideways"):
        robot.frame_jacobian(robot.links[-1], q, reference="sideways")


def test_products_of_the_regressor_are_those_of_numpy_and_memory_is_written_where_it_is(robot, drives_motion):
    q, v, a = drives_motion
    w, tau = robot.actuated_regressor(q, v, a), robot.inverse_dynamics(q, v, a)
    flat = w.reshape(-1, w.shape[2])
    gram, product, square = robot.regressor_products(q, v, a, tau)
    np.testing.assert_allclose(gram, flat.T @ flat, atol=1e-12 * np.abs(gram).max())
    np.testing.assert_allclose(product, flat.T @ tau.ravel(), atol=1e-12 * np.abs(product).max())
    assert square == pytest.approx((tau**2).sum())
    # Many samples are summed in parts.
    many = [np.tile(x, (60, 1)) for x in (q, v, a, tau)]
    np.testing.assert_allclose(robot.regressor_products(*many)[0], 60 * gram, atol=1e-10 * np.abs(gram).max())
    out = np.full_like(w, np.nan)
    assert robot.actuated_regressor(q, v, a, out=out) is out
    np.testing.assert_array_equal(out, w)
    with pytest.raises(ValueError, match="out has shape"):
        robot.actuated_regressor(q, v, a, out=out[:-1])
    with pytest.raises(ValueError, match="out"):
        robot.actuated_regressor(q, v, a, out=np.lib.stride_tricks.as_strided(out, writeable=False))
    with pytest.raises(ValueError, match="tau has"):
        robot.regressor_products(q, v, a, tau[:-1])


def test_wrenches_of_driven_joints_are_their_efforts(robot, drives_motion):
    """The part of a joint's wrench along its axis is what the drive supplies, rotors apart; passive joints carry nothing along theirs."""
    q, v, a = drives_motion
    q_tree, _, _ = robot.closed_loop_motion(q, v, a)
    wrenches = robot.joint_wrenches(q, v, a)
    expected = np.zeros((len(q), robot.nv))
    expected[:, driven(robot)] = robot.inverse_dynamics(q, v, a) - robot.armature[driven(robot)] * a
    # A joint's axis as a motion about the root's origin is its column of the world Jacobian of the body it moves.
    bodies = {}
    for link in robot.links:
        columns = np.abs(robot.frame_jacobian(link, q_tree[:1], reference="world")[0]).max(axis=0)
        moved = np.flatnonzero(columns > 0)
        if len(moved):
            bodies.setdefault(int(moved[-1]), link)
    for joint, link in bodies.items():
        axis = robot.frame_jacobian(link, q_tree, reference="world")[:, :, joint]
        power = np.einsum("nk,nk->n", wrenches[:, joint], axis)
        if robot.armature[joint] == 0.0 or joint in driven(robot):
            np.testing.assert_allclose(power, expected[:, joint], atol=1e-7 * (1.0 + np.abs(wrenches).max()), err_msg=robot.joints[joint])


def test_efforts_that_move_nothing_are_orthonormal_and_do_no_work():
    robot = pkm.robots.load("ups4")
    motion = pkm.excite(robot, period_s=8.0, restarts=1, draws=4, iterations=1)
    _, q, v, _ = motion.grid(50.0)
    strain = robot.internal_efforts(q)
    assert strain.shape == (len(q), robot.n_act, robot.n_act - robot.mobility)
    np.testing.assert_allclose(np.einsum("nij,nik->njk", strain, strain), np.eye(1)[None].repeat(len(q), 0), atol=1e-12)
    np.testing.assert_allclose(np.einsum("nij,ni->nj", strain, v), 0, atol=1e-9)
    assert pkm.robots.load("prs3").internal_efforts(np.tile(pkm.robots.load("prs3").mid_pose(), (3, 1))).shape == (3, 3, 0)


def test_energy_columns_times_parameters_are_energies(robot):
    q, v, _ = motion_about(robot.assemble())
    kinetic, potential = robot.energy_regressors(q, v)
    theta = robot.parameters()
    ours, held = robot.energies(q, v)
    np.testing.assert_allclose(kinetic @ theta + 0.5 * v**2 @ robot.armature, ours, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(potential @ theta, held, rtol=1e-10, atol=1e-10)


def test_frame_motion_is_the_derivative_of_the_pose(robot, drives_motion):
    q, v, a = drives_motion
    q_tree, v_tree, a_tree = robot.closed_loop_motion(q, v, a)
    link = robot.links[-1]
    velocity, acceleration = robot.frame_motion(link, q_tree, v_tree, a_tree)
    jacobian = robot.frame_jacobian(link, q_tree)
    np.testing.assert_allclose(velocity, np.einsum("nij,nj->ni", jacobian, v_tree), atol=1e-12)
    rate = robot.frame_jacobian(link, q_tree, v_tree)
    np.testing.assert_allclose(acceleration, np.einsum("nij,nj->ni", jacobian, a_tree) + np.einsum("nij,nj->ni", rate, v_tree), atol=1e-9)
