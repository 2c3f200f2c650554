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
    # With more drives than freedoms most lengths at random are those of no pose: only near the assembly is one within reach.
    size = 0.03 if len(robot.independent) == robot.n_act else 5e-4
    for step in RNG.uniform(-size, size, (n, robot.n_act)):
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
        return data.efc_pos[rows], data.efc_J.reshape(data.nefc, self.model.nv)[rows][:, self.dof]


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
            assert n_rows == robot.nv - len(robot.independent), name
            n_closed += len(error) > 0
    assert n_closed > 60


def test_mujoco_moves_as_our_efforts_say(tmp_path):
    # Drawn chains joined by a pin or rigidly give way too much: MuJoCo's softness is measured against the mean mobility of the bodies.
    well_held = [*pkm.robots.names(), *(f"planar {name} {seed}" for name in ("x y", "five of six") for seed in (0, 1))]
    for name, robot in [(name, robot) for name, robot in robots(tmp_path) if name in well_held]:
        there = InMujoco(robot)
        drives = [robot.joints.index(joint) for joint in robot.actuators]
        q, _ = reduction(robot, np.zeros(robot.n_act))
        a = RNG.uniform(-1, 1, (1, robot.n_act))
        rest = np.zeros_like(a)
        # Of more drives than freedoms some follow the others.
        a = robot.closed_loop_motion(q[None, drives], rest, a)[2][:, drives]
        tau = robot.inverse_dynamics(q[None, drives], rest, a)[0]
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
    assert np.abs(data.efc_pos[rows]).max() < 2e-6


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


class InPinocchio:
    """An exported robot, its constraints built from the loop file as toolbox-parallel-robots builds them."""

    def __init__(self, robot, folder, *, mimic=False):
        self.pin = pytest.importorskip("pinocchio", reason="the package pin is not installed")
        urdf, text = robot.to_gepetto()
        (folder / "robot.urdf").write_text(urdf)
        self.loops = yaml.safe_load(text)
        self.model = self.pin.buildModelFromUrdf(str(folder / "robot.urdf"), mimic=mimic)
        assert self.loops["name_mot"] == robot.actuators
        # The direction is that of Pinocchio; the size need not be.
        assert np.abs(self.loops["gravity"][:2]).max() < 1e-12 and self.loops["gravity"][2] <= 0
        self.default_gravity = self.model.gravity.linear.copy()
        self.model.gravity.linear = np.array(self.loops["gravity"])
        for joint, inertia in self.loops["armature"].items():
            self.model.armature[self.column(joint)] = inertia
        self.data = self.model.createData()
        self.ours = [self.column(name) for name in robot.joints if name in list(self.model.names)]
        self.others = [k for k in range(self.model.nv) if k not in self.ours]
        self.constraints = [self.constraint(*loop) for loop in zip(self.loops["closed_loop"], self.loops["type"], strict=True)]
        self.constraint_data = [c.createData() for c in self.constraints]

    def column(self, joint):
        return self.model.joints[self.model.getJointId(joint)].idx_v

    def constraint(self, frames, kind):
        assert all(self.model.existFrame(name) for name in frames)
        ends = [self.model.frames[self.model.getFrameId(name)] for name in frames]
        places = [place for end in ends for place in (end.parentJoint, end.placement)]
        types = {"3d": self.pin.ContactType.CONTACT_3D, "6d": self.pin.ContactType.CONTACT_6D}
        return self.pin.RigidConstraintModel(types[kind], self.model, *places, self.pin.ReferenceFrame.LOCAL)

    def configuration(self, coordinates):
        """Pinocchio counts the turns of a continuous joint by cosine and sine."""
        return self.pin.integrate(self.model, self.pin.neutral(self.model), coordinates)

    def mass_and_bias(self, q, v):
        full_q, full_v = np.zeros(self.model.nv), np.zeros(self.model.nv)
        full_q[self.ours], full_v[self.ours] = q, v
        full_q = self.configuration(full_q)
        mass = self.pin.crba(self.model, self.data, full_q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = self.pin.nonLinearEffects(self.model, self.data, full_q, full_v)
        return mass, bias

    def error(self, q):
        """How far the loops are open, by the frames alone."""
        self.pin.framesForwardKinematics(self.model, self.data, self.configuration(q))
        out = []
        for (a, b), kind in zip(self.loops["closed_loop"], self.loops["type"], strict=True):
            frame_a, frame_b = (self.data.oMf[self.model.getFrameId(name)] for name in (a, b))
            between = frame_a.actInv(frame_b)
            out.extend(between.translation)
            if kind == "6d":
                out.extend(self.pin.log3(between.rotation))
        return np.array(out)

    def jacobian(self, q):
        self.pin.computeJointJacobians(self.model, self.data, self.configuration(q))
        for constraint, data in zip(self.constraints, self.constraint_data, strict=True):
            constraint.calc(self.model, self.data, data)
        if not self.constraints:
            return np.zeros((0, self.model.nv))
        return self.pin.getConstraintsJacobian(self.model, self.data, self.constraints, self.constraint_data)

    def closed(self, q, guess):
        """`q` with the coordinates of the massless joints that close the loops, by Gauss-Newton from `guess`."""
        full = np.array(guess)
        full[self.ours] = q
        for _ in range(20):
            if self.others:
                slope = numeric_slope(self.error, full, self.others)
                full[self.others] -= np.linalg.lstsq(slope, self.error(full), rcond=None)[0]
        return full


def numeric_slope(function, q, columns):
    out = []
    for k in columns:
        ahead, behind = np.array(q), np.array(q)
        ahead[k] += 1e-6
        behind[k] -= 1e-6
        out.append((function(ahead) - function(behind)) / 2e-6)
    return np.array(out).T


def test_pinocchio_need_not_be_told_where_down_is(tmp_path):
    # The five-bar's own gravity is along -y.
    there = InPinocchio(pkm.robots.load("five_bar"), tmp_path)
    np.testing.assert_allclose(there.loops["gravity"], there.default_gravity, rtol=0, atol=1e-12)


def loose_robots(folder):
    for seed in range(2):
        for name, (constrain, n) in LOOSE.items():
            yield f"{name} {seed}", drawn_robots.joined_chains(folder, seed, constrain, n)


def test_pinocchio_has_the_same_mass_matrix_and_bias(tmp_path):
    for name, robot in [*robots(tmp_path), *loose_robots(tmp_path)]:
        there = InPinocchio(robot, tmp_path)
        for _ in range(4):
            q, v = RNG.uniform(-1, 1, robot.nv), RNG.uniform(-2, 2, robot.nv)
            mass, bias = there.mass_and_bias(q, v)
            our_mass, our_bias = mass_and_bias(robot, q, v)
            assert_same(our_mass, mass[np.ix_(there.ours, there.ours)])
            assert_same(our_bias, bias[there.ours])
            assert np.abs(mass[there.others]).max(initial=0.0) == 0.0, name
            assert np.abs(bias[there.others]).max(initial=0.0) == 0.0, name


def test_pinocchio_closes_the_same_loops(tmp_path):
    n_closed = 0
    for name, robot in [*robots(tmp_path), *loose_robots(tmp_path)]:
        if name == "follower":
            continue
        there = InPinocchio(robot, tmp_path)
        guess = np.zeros(there.model.nv)
        for joint, q in there.loops["home"].items():
            guess[there.column(joint)] = q
        np.testing.assert_allclose(guess[there.ours], robot.assemble(), atol=1e-9)
        assert np.abs(there.error(guess)).max(initial=0.0) < 1e-9, name
        for q, motions in closed_poses(robot):
            full = there.closed(q, guess)
            assert np.abs(there.error(full)).max(initial=0.0) < 1e-9, name
            jacobian = there.jacobian(full)
            # Our motions, with those of the massless joints that follow, keep their loops closed, and theirs leave no others.
            left = jacobian[:, there.ours] @ motions
            followed = np.linalg.lstsq(jacobian[:, there.others], -left, rcond=None)[0] if there.others else np.zeros((0, robot.n_act))
            left = left + jacobian[:, there.others] @ followed
            assert np.abs(left).max(initial=0.0) < 1e-8 * (1 + np.abs(motions).max()), name
            n_rows = np.linalg.matrix_rank(jacobian, tol=1e-7) if len(jacobian) else 0
            assert n_rows == there.model.nv - len(robot.independent), name
            n_closed += len(jacobian) > 0
    assert n_closed > 90


def test_pinocchio_couples_a_follower(tmp_path):
    robot = drawn_robots.coupled(tmp_path, 1, {"j0": -0.7})
    there = InPinocchio(robot, tmp_path, mimic=True)
    assert there.model.nv == robot.nv - 1
    q, v, a = RNG.uniform(-1, 1, (3, 1, robot.n_act))
    # Rotors included: the model knows them.
    tau = there.pin.rnea(there.model, there.data, q[0], v[0], a[0])
    ours = robot.inverse_dynamics(q, v, a)[0]
    columns = [there.column(name) for name in robot.actuators]
    np.testing.assert_allclose(tau[columns], ours, rtol=1e-9, atol=1e-9)


def test_a_rotation_about_one_axis_alone_is_refused(tmp_path):
    robot = drawn_robots.joined_chains(tmp_path, 3, ["rz"], 1)
    for export in (robot.to_gepetto, robot.to_mjcf):
        with pytest.raises(ValueError, match=r'loop "yoke": rz cannot be closed by'):
            export()


# ---- joints with several coordinates


def skew(w):
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def turned(vector):
    """Rotation of a rotation vector."""
    angle = np.linalg.norm(vector)
    s = skew(vector)
    return np.eye(3) + np.sin(angle) / angle * s + (1 - np.cos(angle)) / angle**2 * s @ s


def quaternion(vector):
    """w x y z of a rotation vector."""
    angle = np.linalg.norm(vector)
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) / angle * np.array(vector))])


def test_mujoco_has_balls_planes_and_flying_bodies(tmp_path):
    robot = drawn_robots.of_several_coordinates(tmp_path, 4)
    model = mujoco.MjModel.from_xml_string(robot.to_mjcf())
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    data, at = mujoco.MjData(model), robot.joints.index
    mujoco.mj_resetDataKeyframe(model, data, 0)
    np.testing.assert_allclose(data.qpos, model.qpos0, atol=1e-12)
    for _ in range(4):
        q, v = RNG.uniform(-1, 1, robot.nv), RNG.uniform(-2, 2, robot.nv)
        # Their velocities are `map @ v`: those of slides and of a free body stand still while the body turns.
        to_theirs, rate = np.zeros((model.nv, robot.nv)), np.zeros((model.nv, robot.nv))

        def place(joint, first, turn=None, spin=(0.0, 0.0, 0.0), maps=(to_theirs, rate), *, n):
            rows = model.joint(joint).dofadr[0] + np.arange(n)
            turn = np.eye(n) if turn is None else turn
            maps[0][np.ix_(rows, first + np.arange(n))] = turn
            maps[1][np.ix_(rows, first + np.arange(n))] = turn @ skew(spin)[:n, :n]

        for name in ["j0", "j1"]:
            data.qpos[model.joint(name).qposadr[0]] = q[at(name)]
            place(name, at(name), n=1)
        ball, fly, drone, table = at("ball.rx"), at("fly.x"), at("drone.x"), at("table.x")
        data.qpos[model.joint("ball").qposadr[0] + np.arange(4)] = quaternion(q[ball : ball + 3])
        place("ball", ball, n=3)
        # A body that flies from the world: its pose there, and its velocity along the world's axes.
        start = model.joint("fly").qposadr[0]
        origin = np.zeros(9)
        mujoco.mju_quat2Mat(origin, model.qpos0[start + 3 : start + 7])
        origin = origin.reshape(3, 3)
        data.qpos[start : start + 3] = model.qpos0[start : start + 3] + origin @ q[fly : fly + 3]
        turn = np.zeros(4)
        mujoco.mju_mulQuat(turn, model.qpos0[start + 3 : start + 7], quaternion(q[fly + 3 : fly + 6]))
        data.qpos[start + 3 : start + 7] = turn
        place("fly", fly, origin @ turned(q[fly + 3 : fly + 6]), v[fly + 3 : fly + 6], n=3)
        rows = model.joint("fly").dofadr[0] + 3
        to_theirs[rows : rows + 3, fly + 3 : fly + 6] = np.eye(3)
        for k, axis in enumerate("xyz"):
            data.qpos[model.joint(f"drone.{axis}").qposadr[0]] = q[drone + k]
        data.qpos[model.joint("drone").qposadr[0] + np.arange(4)] = quaternion(q[drone + 3 : drone + 6])
        place("drone.x", drone, turned(q[drone + 3 : drone + 6]), v[drone + 3 : drone + 6], n=3)
        place("drone", drone + 3, n=3)
        for k, coordinate in enumerate(["x", "y", "rz"]):
            data.qpos[model.joint(f"table.{coordinate}").qposadr[0]] = q[table + k]
        place("table.x", table, turned([0.0, 0.0, q[table + 2]])[:2, :2], [0.0, 0.0, v[table + 2]], n=2)
        place("table.rz", table + 2, n=1)
        data.qvel[:] = to_theirs @ v
        mujoco.mj_forward(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        our_mass, our_bias = mass_and_bias(robot, q, v)
        assert_same(our_mass, to_theirs.T @ mass @ to_theirs)
        assert_same(our_bias, to_theirs.T @ (mass @ rate @ v + data.qfrc_bias))


def test_pinocchio_has_balls_planes_and_flying_bodies(tmp_path):
    pin = pytest.importorskip("pinocchio", reason="the package pin is not installed")
    robot = drawn_robots.of_several_coordinates(tmp_path, 4)
    urdf, text = robot.to_gepetto()
    (tmp_path / "robot.urdf").write_text(urdf)
    home = yaml.safe_load(text)["home"]
    model = pin.buildModelFromUrdf(str(tmp_path / "robot.urdf"))
    data, at = model.createData(), robot.joints.index
    model.gravity.linear = np.array(yaml.safe_load(text)["gravity"])
    for joint, inertia in yaml.safe_load(text)["armature"].items():
        model.armature[model.joints[model.getJointId(joint)].idx_v] = inertia
    assert np.size(home["fly"]) == 7 and np.size(home["table"]) == 4 and np.size(home["ball_ry"]) == 1
    for _ in range(4):
        q, theirs = RNG.uniform(-1, 1, robot.nv), pin.neutral(model)
        to_theirs = np.zeros((model.nv, robot.nv))

        def place(joint, first, values, turn):
            j = model.joints[model.getJointId(joint)]
            theirs[j.idx_q : j.idx_q + j.nq] = values
            to_theirs[j.idx_v : j.idx_v + j.nv, first : first + np.shape(turn)[1]] = turn

        for name in ["j0", "j1"]:
            place(name, at(name), q[at(name)], np.eye(1))
        for name in ["fly", "drone"]:
            first = at(f"{name}.x")
            w, x, y, z = quaternion(q[first + 3 : first + 6])
            place(name, first, [*q[first : first + 3], x, y, z, w], np.eye(6))
        table, ball = at("table.x"), at("ball.rx")
        place("table", table, [q[table], q[table + 1], np.cos(q[table + 2]), np.sin(q[table + 2])], np.eye(3))
        turn = turned(q[ball : ball + 3])
        b = np.arcsin(turn[0, 2])
        a, c = np.arctan2(-turn[1, 2], turn[2, 2]), np.arctan2(-turn[0, 1], turn[0, 0])
        about_y, about_z = turned([0.0, b, 0.0]), turned([0.0, 0.0, c])
        rates = np.linalg.inv(np.array([about_z.T @ about_y.T[:, 0], about_z.T[:, 1], [0.0, 0.0, 1.0]]).T)
        for k, (axis, angle) in enumerate(zip("xyz", [a, b, c], strict=True)):
            place(f"ball_r{axis}", ball, angle, rates[k : k + 1])
        mass = pin.crba(model, data, theirs)
        mass = np.triu(mass) + np.triu(mass, 1).T
        our_mass, our_bias = mass_and_bias(robot, q, np.zeros(robot.nv))
        assert_same(our_mass, to_theirs.T @ mass @ to_theirs)
        assert_same(our_bias, to_theirs.T @ pin.computeGeneralizedGravity(model, data, theirs))
