"""Writes *_forward.json of tests/golden/loops.rs: Pinocchio's forward dynamics of closed-loop robots, `pin.constraintDynamics`.

Run here with `pip install pin numpy`, after make_golden.py: `python make_loops.py`. Four robots are those of make_golden.py at the same
states, four are drawn here. Efforts act on every joint of the tree. How Pinocchio states each loop: `x y z` is a CONTACT_3D, all six a
CONTACT_6D, a pin is two CONTACT_3D on its axis, on both sides of its centre. Signs: Pinocchio's force acts on its first joint, link a;
pkm-dyn's on link b, `M·a + nle = tau + J'·lambda`, in a's axes about b's origin.
"""
import json
import tomllib
from pathlib import Path

import numpy as np
import pinocchio as pin

import make_golden as base
from make_golden import LWA, drawn, se3, toml_frame, urdf
from mechanisms import Tree, mass_matrix, restart, save

AXES = ["x", "y", "z", "rx", "ry", "rz"]
ARM = 0.1
GRAVITY = (0.4, -0.7, -9.7)
# Redundant rows (a pin's sixth, a planar loop's z) need Pinocchio's proximal iteration; it ends after two or three steps.
PROXIMAL = pin.ProximalSettings(1e-15, 1e-8, 50)


class Loop:
    """A loop: its frames in Pinocchio's model, the relative motions it forbids, and the contacts that say so."""

    def __init__(self, model, spec, pin_points):
        self.ends, self.rows, self.contacts = [], [AXES.index(axis) for axis in spec["constrain"]], []
        for side in "ab":
            frame = model.frames[model.getFrameId(spec[side]["link"])]
            self.ends.append(model.addFrame(pin.Frame(f"{spec['name']}_{side}", frame.parentJoint, frame.placement * se3(spec[side]), pin.OP_FRAME)))
        # Rows that come with the points and are none of pkm-dyn's forbid nothing more: z in a plane, the distance of two points.
        shifts = {2: [0.0], 3: [0.0], 4: [], 5: pin_points, 6: [None]}[len(self.rows)]
        a, b = (model.frames[f] for f in self.ends)
        for shift in shifts:
            at = pin.SE3(np.eye(3), np.array([0.0, 0.0, shift or 0.0]))
            kind = pin.ContactType.CONTACT_6D if shift is None else pin.ContactType.CONTACT_3D
            self.contacts.append((at, pin.RigidConstraintModel(kind, model, a.parentJoint, a.placement * at, b.parentJoint, b.placement * at, pin.LOCAL)))

    def gap(self, data):
        a, b = (data.oMf[f] for f in self.ends)
        between = a.actInv(b)
        return np.append(between.translation, pin.log3(between.rotation))[self.rows]

    def jacobian(self, model, data):
        """Rows of the relative twist in a's axes: exact where the loop is closed."""
        a, b = self.ends
        relative = pin.getFrameJacobian(model, data, b, LWA) - pin.getFrameJacobian(model, data, a, LWA)
        to_a = data.oMf[a].rotation.T
        return np.vstack([to_a @ relative[:3], to_a @ relative[3:]])[self.rows]

    def wrench(self, contact_data):
        """Of link a on link b, about b's origin in a's axes."""
        total = np.zeros(6)
        for (at, _), contact in zip(self.contacts, contact_data):
            total -= at.act(contact.contact_force).vector
        return total

    def efforts(self, data, wrench):
        """pkm-dyn's rows for turns are rates of the rotation vector from a to b: `rate = Jlog3·R'·omega`."""
        a, b = (data.oMf[f] for f in self.ends)
        turn = a.rotation.T @ b.rotation
        moments = (pin.Jlog3(turn) @ turn.T)[[k - 3 for k in self.rows if k > 2]].T
        forces = wrench[[k for k in self.rows if k < 3]]
        if moments.size == 0:
            return forces
        efforts = np.linalg.lstsq(moments, wrench[3:], rcond=None)[0]
        assert np.abs(moments @ efforts - wrench[3:]).max() < 1e-9 * max(1.0, np.abs(wrench).max())
        return np.append(forces, efforts)


def freedoms(jacobian):
    """Orthonormal tree velocities that keep the loops closed, as columns."""
    _, s, vt = np.linalg.svd(jacobian)
    rank = int((s > 1e-9 * s[0]).sum())
    assert s[rank - 1] > 0.1, "near a singular pose"
    return vt[rank:].T


class Mechanism:
    def __init__(self, text, toml, pin_points=(-ARM, ARM)):
        spec = tomllib.loads(toml)
        self.tree = Tree(text, spec["gravity"])
        self.model = self.tree.model
        self.loops = [Loop(self.model, loop, pin_points) for loop in spec["loop"]]
        self.tree.set_armature({a["joint"]: a["rotor_inertia"] for a in spec["actuator"]})
        self.data = self.model.createData()

    def at(self, q):
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        return np.concatenate([loop.gap(self.data) for loop in self.loops]), np.vstack([loop.jacobian(self.model, self.data) for loop in self.loops])

    def close(self, q):
        for _ in range(60):
            gap, jacobian = self.at(q)
            if np.abs(gap).max() < 2e-15:
                break
            q = pin.integrate(self.model, q, -np.linalg.lstsq(jacobian, gap, rcond=1e-10)[0])
        assert np.abs(gap).max() < 1e-13, np.abs(gap).max()
        return q

    def reactions(self, q, v, a, tau, wrenches):
        """Wrench each joint of the tree transmits to its body, at the root's origin in the root's axes, loops closed."""
        m, d = self.model, self.data
        loads = [pin.Force.Zero() for _ in range(m.njoints)]
        for loop, wrench in zip(self.loops, wrenches):
            at = pin.SE3(d.oMf[loop.ends[0]].rotation, d.oMf[loop.ends[1]].translation)
            for end, sign in zip(loop.ends, (-1.0, 1.0)):
                joint = m.frames[end].parentJoint
                loads[joint] += d.oMi[joint].actInv(at.act(pin.Force(sign * wrench)))
        forces = pin.StdVec_Force()
        forces.extend(loads)
        assert np.abs(pin.rnea(m, d, q, v, a, forces) - tau).max() < 1e-12 * np.abs(tau).max()
        return [d.oMi[k].act(d.f[k]).vector.copy() for k in range(1, m.njoints)]

    def state(self, x, v=None):
        m, d = self.model, self.data
        q = self.tree.q(x)
        gap, jacobian = self.at(q)
        assert np.abs(gap).max() < 1e-12
        free = freedoms(jacobian)
        v = free @ base.RNG.uniform(-2, 2, free.shape[1]) if v is None else v
        assert np.abs(jacobian @ v).max() < 1e-11
        tau = base.RNG.uniform(-20, 20, m.nv)
        contacts, contact_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for loop in self.loops:
            for _, contact in loop.contacts:
                contacts.append(contact)
                contact_data.append(contact.createData())
        data = m.createData()
        pin.initConstraintDynamics(m, data, contacts, contact_data)
        a = pin.constraintDynamics(m, data, q, v, tau, contacts, contact_data, PROXIMAL).copy()
        efforts, wrenches, at = [], [], 0
        for loop in self.loops:
            wrench = loop.wrench(list(contact_data)[at:at + len(loop.contacts)])
            at += len(loop.contacts)
            wrenches.append(wrench)
            efforts.append(loop.efforts(d, wrench))
        reactions = self.reactions(q, v, a, tau, wrenches)
        tree = pin.rnea(m, d, q, v, a).copy()
        mass = mass_matrix(m, d, q)
        # Pinocchio's forces, brought to the rows of the loops, must keep the equation of motion: signs, frames, redundant rows.
        carried = jacobian.T @ np.concatenate([w[loop.rows] for loop, w in zip(self.loops, wrenches)])
        assert np.abs(tree - tau - carried).max() < 1e-13 * np.abs(tree).max()
        return {"q": x, "v": v, "tau": tau, "a": a, "tree": tree, "lambda": np.concatenate(efforts), "wrench": wrenches, "reaction": reactions,
                "freedoms": free, "mass": free.T @ mass @ free}


def forward_of(name, **how):
    """A robot of make_golden.py at its own states, with other efforts."""
    golden = json.loads((Path(__file__).parent / f"{name}.json").read_text())
    robot = Mechanism(golden["urdf"], golden["toml"], **how)
    order = [golden["joints"].index(c) for c in robot.tree.coordinates]
    states = [robot.state(np.array(s["q"])[order], np.array(s["v"])[order]) for s in golden["states"][:6]]
    save(f"{name}_forward", {"toml": golden["toml"], "urdf": golden["urdf"], "joints": robot.tree.coordinates, "bodies": robot.tree.bodies, "states": states})


def drawn_toml(name, tree, closures, drives):
    """robot.toml and the assembly: the tree closed where it stands at drawn coordinates; closures: (name, link a, link b, axes, b in a)."""
    home = base.RNG.uniform(-0.6, 0.6, tree.model.nv)
    pin.framesForwardKinematics(tree.model, tree.data, tree.q(home))
    pose = lambda link: tree.data.oMf[tree.model.getFrameId(link)]
    toml = f'name = "{name}"\nurdf = "{name}.urdf"\ngravity = {list(GRAVITY)}\n'
    for closure, link_a, link_b, axes, between in closures:
        in_a = pin.SE3(pin.rpy.rpyToMatrix(*base.RNG.uniform(-1, 1, 3)), base.RNG.uniform(-0.2, 0.2, 3))
        in_b = pose(link_b).actInv(pose(link_a) * in_a * between)
        toml += f'[[loop]]\nname = "{closure}"\na = {toml_frame(link_a, in_a)}\nb = {toml_frame(link_b, in_b)}\nconstrain = {json.dumps(axes)}\n'
    toml += "".join(f'[[actuator]]\njoint = "{drive}"\nrotor_inertia = {0.05 * (k + 1)}\n' for k, drive in enumerate(drives))
    return toml + "[assembly]\n" + "".join(f'"{c}" = {float(x)!r}\n' for c, x in zip(tree.coordinates, home)), home


def save_drawn(name, text, toml, tree, states):
    save(f"{name}_forward", {"toml": toml, "urdf": text, "joints": tree.coordinates, "bodies": tree.bodies, "states": states})


def forward_drawn(name, joints, closures, drives, spread):
    text = urdf(name, joints)
    toml, home = drawn_toml(name, Tree(text, GRAVITY), closures, drives)
    robot, states = Mechanism(text, toml), []
    for _ in range(6):
        near = robot.tree.q(home + base.RNG.uniform(-spread, spread, len(home)))
        states.append(robot.state(robot.tree.x(robot.close(near))))
    save_drawn(name, text, toml, robot.tree, states)


def turned():
    """A ball lets b stand turned against a."""
    return pin.SE3(pin.exp3(base.RNG.uniform(-1, 1, 3)), np.zeros(3))


def chain(prefix, root, kinds, end=None):
    """A chain of joints of the kinds given; links are <prefix>0, <prefix>1, ..., the last one `end`."""
    links = [root] + [f"{prefix}{k}" for k in range(len(kinds))]
    links[-1] = end or links[-1]
    return [drawn(f"{prefix}j{k}", kind, links[k], links[k + 1]) for k, kind in enumerate(kinds)]


def three_loops():
    """A platform on a leg with a ball joint in the tree, held by two legs that end in balls; a fourth leg hangs on the third."""
    restart(4)
    joints = chain("a", "base", ["revolute", "prismatic", "spherical"], "platform")
    for leg in "bc":
        joints += chain(leg, "base", ["revolute", "revolute", "prismatic"])
    joints += chain("d", "base", ["revolute", "revolute", "prismatic", "revolute"])
    ball = ["x", "y", "z"]
    forward_drawn("three_loops", joints, [("ball_b", "platform", "b2", ball, turned()), ("ball_c", "c2", "platform", ball, turned()),
                  ("ball_d", "d3", "c1", ball, turned())], ["aj0", "bj0"], 0.06)


def flying():
    """A platform that flies, held by three legs that end in balls; one leg stands on a table that slides and turns."""
    restart(6)
    joints = chain("a", "base", ["floating"], "platform") + [(*drawn("table", "planar", "base", "c0")[:6], (0, 0, 1))]
    joints += chain("b", "base", ["revolute", "revolute", "prismatic"]) + [drawn("cj1", "revolute", "c0", "c1")]
    joints += chain("d", "platform", ["revolute", "prismatic"])
    ball = ["x", "y", "z"]
    forward_drawn("flying", joints, [("ball_b", "platform", "b2", ball, turned()), ("ball_c", "c1", "platform", ball, turned()),
                  ("ball_d", "base", "d1", ball, turned())], ["bj0", "bj1"], 0.06)


def weld():
    """Two chains, one with a ball, grown together: all six motions are forbidden, two freedoms are left without a drive."""
    restart(5)
    joints = chain("a", "base", ["revolute", "spherical", "prismatic"]) + chain("b", "base", ["revolute", "prismatic", "revolute", "revolute"])
    forward_drawn("weld", joints, [("weld", "a2", "b3", AXES, pin.SE3.Identity())], ["bj0"], 0.06)


def cylinder():
    """Two chains joined by a joint that slides and turns, which no contact of Pinocchio says: `M·a + nle = tau + J'·lambda` is solved here,
    with make_golden's rows and drift, from Pinocchio's frame accelerations. Its turns are products of directions: `y·z_b` per unit turns
    b about -x, `x·z_b` about y."""
    restart(7)
    text = urdf("cylinder", chain("a", "base", ["revolute", "revolute", "prismatic", "revolute"]) + chain("b", "base", ["revolute", "prismatic", "revolute"]))
    between = pin.SE3(pin.exp3(np.array([0.0, 0.0, 2.0])), np.array([0.0, 0.0, 0.3]))
    toml, home = drawn_toml("cylinder", Tree(text, GRAVITY), [("sleeve", "a3", "b2", ["x", "y", "rx", "ry"], between)], ["aj0"])
    robot, closed, states = Mechanism(text, toml), base.Closed(text, toml), []
    assert closed.names == robot.tree.coordinates
    m, d, n = robot.model, robot.data, robot.model.nv
    for _ in range(6):
        q = closed.close(home + base.RNG.uniform(-0.06, 0.06, n))
        free = freedoms(closed.rows(q, np.zeros(n))[1])
        v, tau = free @ base.RNG.uniform(-2, 2, free.shape[1]), base.RNG.uniform(-20, 20, n)
        _, jacobian, drift = closed.rows(q, v)
        mass, bias = mass_matrix(m, d, q), pin.nonLinearEffects(m, d, q, v).copy()
        both = np.linalg.solve(np.block([[mass, -jacobian.T], [jacobian, np.zeros((4, 4))]]), np.append(tau - bias, -drift))
        a, (x, y, about_y, about_minus_x) = both[:n], both[n:]
        wrench = np.array([x, y, 0.0, -about_minus_x, about_y, 0.0])
        robot.at(q)
        efforts, reactions = robot.loops[0].efforts(d, wrench), robot.reactions(q, v, a, tau, [wrench])
        states.append({"q": q, "v": v, "tau": tau, "a": a, "tree": mass @ a + bias, "lambda": efforts, "wrench": [wrench], "reaction": reactions,
                       "freedoms": free, "mass": free.T @ mass @ free})
    save_drawn("cylinder", text, toml, robot.tree, states)


if __name__ == "__main__":
    for robot in ("four_bar", "spatial_loop", "spatial_pin"):
        forward_of(robot)
    # In a plane one point says all; of a second, Pinocchio would share the force out to seven digits only.
    forward_of("five_bar", pin_points=(0.0,))
    three_loops()
    flying()
    weld()
    cylinder()
