"""Plants, one step at a time: a pendulum against its integral, other programs' dynamics, and what is refused."""

import re

import numpy as np
import pkm
import pytest

LINK = """<link name="{name}"><inertial><origin xyz="0.3 0 0"/><mass value="2"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial></link>"""
TOML = 'name = "pendulum"\nurdf = "robot.urdf"\n\n[[actuator]]\njoint = "j"\n'
URDF = f"""<robot name="pendulum"><link name="base"/>{LINK.format(name="arm")}
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="50" effort="100"/></joint></robot>"""
INERTIA, MOMENT = 0.03 + 2 * 0.3**2, 2 * 0.3 * 9.81


@pytest.fixture
def pendulum():
    return pkm.Robot.from_texts(TOML, URDF)


@pytest.mark.parametrize("kind", ["reduced", "constrained"])
def test_a_pendulum_swings_as_its_equation_says(pendulum, kind):
    integrate = pytest.importorskip("scipy.integrate", reason="the package scipy is not installed")
    dt, n = 1e-3, 2000
    plant = pkm.Plant(pendulum, [0.3], kind=kind)
    q, v = plant.run(np.zeros((n, 1)), dt)
    # About y, with the arm along x: gravity turns it down, which is positive.
    rate = lambda _, x: [x[1], MOMENT * np.cos(x[0]) / INERTIA]
    expected = integrate.solve_ivp(rate, (0, n * dt), [0.3, 0.0], t_eval=dt * np.arange(1, n + 1), rtol=1e-10, atol=1e-12).y
    assert np.abs(q[:, 0] - expected[0]).max() < 2e-4 and np.abs(v[:, 0] - expected[1]).max() < 2e-3
    assert plant.kind == kind and plant.joints == ["j"] and plant.time == pytest.approx(n * dt)


def test_arrays_are_single_steps(robot):
    first, second = pkm.Plant(robot), pkm.Plant(robot)
    rng = np.random.default_rng(2)
    tau = 5.0 * rng.normal(size=(40, robot.n_act))
    q, v = first.run(tau, 1e-3)
    for i, row in enumerate(tau):
        for mine, theirs in zip(second.step(row, 1e-3), (q[i], v[i]), strict=True):
            np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(first.q, second.q)


def test_it_begins_with_the_acceleration_of_forward_dynamics():
    """One small step from rest against the closed loops' own forward dynamics, friction taken away."""
    robot = pkm.robots.load("prs3")
    toml, urdf = robot.texts()
    bare = pkm.Robot.from_texts(toml, without_friction(urdf))
    plant, dt = pkm.Plant(bare), 1e-5
    start, drives = plant.q, [bare.joints.index(name) for name in bare.actuators]
    q_tree, v_tree, _ = bare.closed_loop_motion([start], [np.zeros(3)], [np.zeros(3)])
    tau = np.array([300.0, 100.0, 200.0])
    whole = np.zeros((1, bare.nv))
    whole[0, drives] = tau
    expected = bare.forward_dynamics(q_tree, v_tree, whole)[0][0, drives]
    _, v = plant.step(tau, dt)
    np.testing.assert_allclose(v / dt, expected, rtol=1e-4)


def without_friction(urdf):
    return re.sub(r"<dynamics[^>]*/>", "", urdf)


def test_a_controller_of_ones_own_holds_the_robot():
    robot = pkm.robots.load("five_bar")
    plant = pkm.Plant(robot.with_effect("friction_coulomb", "shoulder_left", coulomb=0.5))
    goal, dt = plant.q + 0.1, 1e-3
    for _ in range(3000):
        weight = robot.inverse_dynamics([plant.q], [np.zeros(2)], [np.zeros(2)])[0]
        plant.step(weight + 120.0 * (goal - plant.q) - 12.0 * plant.v, dt)
    # Dry friction alone, its own and the file's, may hold it away from its goal.
    assert np.abs(plant.q - goal).max() < (0.5 + 0.7) / 120.0 + 1e-3 and np.abs(plant.v).max() < 1e-3


def test_more_drives_than_freedoms_take_the_constrained_one():
    robot = pkm.robots.load("ups4")
    plant = pkm.Plant(robot)
    assert plant.kind == "constrained"
    plant.run(np.zeros((20, robot.n_act)), 1e-3)
    q, v = plant.tree
    gap, jacobian = robot.loop_gap([q])
    assert np.abs(gap).max() < 1e-9 and np.abs(jacobian[0] @ v).max() < 1e-6
    assert pkm.Plant(pkm.robots.load("prs3")).tree is None


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda p: pkm.Plant(p, [0.0, 0.0]), r"q has shape \(2,\)"),
        (lambda p: pkm.Plant(p, [float("nan")]), r"q\[0\] = NaN"),
        (lambda p: pkm.Plant(p, kind="exact"), "auto, reduced or constrained"),
        (lambda p: pkm.Plant(p).step([1.0], 0.0), "dt = 0 s"),
        (lambda p: pkm.Plant(p).step([float("inf")], 1e-3), r"tau\[0\] = inf"),
        (lambda p: pkm.Plant(p).run([[1.0, 2.0]], 1e-3), "one column per drive"),
        (lambda p: pkm.Plant(p).run([[1.0]], 2.0), "dt = 2 s"),
        (lambda p: pkm.Plant(pkm.robots.load("ups4"), kind="reduced"), "drives"),
    ],
)
def test_bad_input_is_refused(pendulum, call, told):
    with pytest.raises(ValueError, match=told) as error:
        call(pendulum)
    assert "\n" not in str(error.value)
