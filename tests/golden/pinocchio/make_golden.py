"""Writes the golden files of tests/against_pinocchio.rs: numbers of Pinocchio for robots drawn at random.

Run here with `pip install pin numpy`: `python make_golden.py`. Version and seed are in every file. The closed-loop numbers use no
finite differences: Pinocchio gives Jacobians and classical accelerations of points, and the loops are written as dot products of
directions here, where pkm-dyn has rotation vectors. The spatial robot is checked once more against Pinocchio's own forward dynamics.
"""
import itertools
import json
import tomllib
from pathlib import Path

import numpy as np
import pinocchio as pin

SEED = 20260917
RNG = np.random.default_rng(SEED)
HERE = Path(__file__).parent
LWA = pin.LOCAL_WORLD_ALIGNED


def numbers(values):
    return " ".join(repr(float(x)) for x in values)


def inertial():
    """A feasible body: centre of mass, principal inertia of a box, and a turned inertial frame."""
    mass, edges = float(RNG.uniform(0.5, 3.0)), RNG.uniform(0.05, 0.4, 3)
    ixx, iyy, izz = (float(mass / 12 * (edges @ edges - edges[k] ** 2)) for k in range(3))
    product = 0.05 * min(ixx, iyy, izz)
    return (f'<inertial><origin xyz="{numbers(RNG.uniform(-0.2, 0.2, 3))}" rpy="{numbers(RNG.uniform(-1, 1, 3))}"/>'
            f'<mass value="{mass!r}"/><inertia ixx="{ixx!r}" ixy="{product!r}" ixz="{-product / 2!r}" iyy="{iyy!r}" iyz="{product / 3!r}" izz="{izz!r}"/></inertial>')


def joint(name, kind, parent, child, xyz, rpy, axis):
    limit = '<limit lower="-3" upper="3" effort="100" velocity="10"/>' if kind != "fixed" else ""
    axis = f'<axis xyz="{numbers(np.array(axis) / np.linalg.norm(axis))}"/>' if kind != "fixed" else ""
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{numbers(xyz)}" rpy="{numbers(rpy)}"/>{axis}{limit}</joint>\n')


def urdf(name, joints, massless=()):
    """joints: (name, kind, parent, child, xyz, rpy, axis)."""
    links = "".join(f'<link name="{j[3]}">{"" if j[3] in massless else inertial()}</link>\n' for j in joints)
    return f'<robot name="{name}">\n<link name="base"/>\n{links}{"".join(joint(*j) for j in joints)}</robot>\n'


def built(text):
    """Pinocchio's model; a URDF part it cannot parse would silently leave a massless link."""
    model = pin.buildModelFromXML(text)
    assert abs(pin.computeTotalMass(model)) > 0.5 * (text.count("<link ") - 1)
    return model


def drawn(name, kind, parent, child):
    return (name, kind, parent, child, RNG.uniform(-0.4, 0.4, 3), RNG.uniform(-1.5, 1.5, 3), RNG.normal(size=3))


def save(name, content):
    head = {"pin": pin.__version__, "seed": SEED}
    # One line per state: a table of numbers is read by programs, and reviewed by the script above it.
    states = ",\n".join(json.dumps(s) for s in content.pop("states"))
    text = json.dumps({**head, **content}, indent=1)[:-2] + f',\n "states": [\n{states}\n ]\n}}\n'
    (HERE / f"{name}.json").write_text(text)


# ---------------------------------------------------------------- trees

def tree_golden(name, joints, gravity, last):
    text = urdf(name, joints)
    toml = f'name = "{name}"\nurdf = "{name}.urdf"\ngravity = {list(gravity)}\n'
    model = built(text)
    model.gravity.linear = np.array(gravity)
    data, states = model.createData(), []
    names = list(model.names)[1:]
    toml += "".join(f'[[actuator]]\njoint = "{j}"\n' for j in names)
    for _ in range(12):
        q, v, a = RNG.uniform(-2, 2, model.nv), RNG.uniform(-3, 3, model.nv), RNG.uniform(-10, 10, model.nv)
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        regressor = pin.computeJointTorqueRegressor(model, data, q, v, a).copy()
        gravity_effort = pin.computeGeneralizedGravity(model, data, q).copy()
        tau = pin.rnea(model, data, q, v, a).copy()
        pin.framesForwardKinematics(model, data, q)
        pose = data.oMf[model.getFrameId(last)]
        states.append({"q": q.tolist(), "v": v.tolist(), "a": a.tolist(), "tau": tau.tolist(), "gravity": gravity_effort.tolist(),
                       "mass": mass.tolist(), "regressor": regressor.tolist(),
                       "rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()})
    save(name, {"toml": toml, "urdf": text, "joints": names, "last_link": last, "states": states})


def arm():
    joints = [drawn(f"j{k}", "revolute", "base" if k == 0 else f"l{k - 1}", f"l{k}") for k in range(7)]
    joints.append(drawn("flange", "fixed", "l6", "tool"))
    tree_golden("arm7", joints, (0.0, 0.0, -9.81), "tool")


def branched():
    """Names against the alphabet on purpose: Pinocchio sorts children by joint name, pkm-dyn keeps the file's order."""
    joints = [drawn("waist", "revolute", "base", "torso"), drawn("zlift", "prismatic", "torso", "mast"),
              drawn("right", "revolute", "mast", "r1"), drawn("rslide", "prismatic", "r1", "r2"),
              drawn("left", "revolute", "mast", "l1"), drawn("elbow", "revolute", "l1", "l2"),
              drawn("bracket", "fixed", "l2", "plate"), drawn("aslide", "prismatic", "plate", "l3"),
              drawn("camera", "revolute", "torso", "eye")]
    tree_golden("branched", joints, (1.3, -2.1, -9.4), "l3")


# ---------------------------------------------------------------- closed loops

def se3(frame):
    return pin.SE3(pin.rpy.rpyToMatrix(*map(float, frame.get("rpy", (0, 0, 0)))), np.array(frame["xyz"], float))


class Closed:
    """A robot.toml with loops; rows of the constraints as dot products of directions with offsets of points."""

    def __init__(self, text, toml):
        spec = tomllib.loads(toml)
        self.model = built(text)
        self.model.gravity.linear = np.array(spec["gravity"])
        self.names = list(self.model.names)[1:]
        self.active = [self.model.joints[self.model.getJointId(a["joint"])].idx_v for a in spec.get("actuator", [])]
        self.rotor = np.array([a["rotor_inertia"] for a in spec.get("actuator", [])])
        self.passive = [i for i in range(self.model.nv) if i not in self.active]
        self.loops = []
        for loop in spec["loop"]:
            ends = []
            for side in "ab":
                frame = self.model.frames[self.model.getFrameId(loop[side]["link"])]
                ends.append(self.model.addFrame(pin.Frame(f"{loop['name']}_{side}", frame.parentJoint, frame.placement * se3(loop[side]), pin.OP_FRAME)))
            self.loops.append((ends, loop["constrain"]))
        self.data = self.model.createData()

    def rows(self, q, v):
        """Value, Jacobian and exact drift of every row, with world-frame Jacobians and classical accelerations of Pinocchio."""
        m, d = self.model, self.data
        pin.forwardKinematics(m, d, q, v, np.zeros(m.nv))
        pin.computeJointJacobians(m, d, q)
        pin.updateFramePlacements(m, d)
        value, jac, drift = [], [], []
        for (a, b), axes in self.loops:
            pa, pb = d.oMf[a], d.oMf[b]
            ja, jb = (pin.getFrameJacobian(m, d, f, LWA) for f in (a, b))
            va, vb = (pin.getFrameVelocity(m, d, f, LWA) for f in (a, b))
            aa, ab = (pin.getFrameClassicalAcceleration(m, d, f, LWA) for f in (a, b))
            e, ej = pb.translation - pa.translation, jb[:3] - ja[:3]
            ed, edd = vb.linear - va.linear, ab.linear - aa.linear
            for axis in axes:
                if axis in "xyz":
                    # Offset of the points along a direction n fixed in a.
                    n, w, wd = pa.rotation[:, "xyz".index(axis)], va.angular, aa.angular
                    nd, ndd = np.cross(w, n), np.cross(wd, n) + np.cross(w, np.cross(w, n))
                    value.append(n @ e)
                    jac.append(n @ ej + np.cross(n, e) @ ja[3:])
                    drift.append(ndd @ e + 2 * nd @ ed + n @ edd)
                else:
                    # A pin about z: b's z axis stays square to a's x and y axes.
                    assert axes[-2:] == ["rx", "ry"]
                    n, c = pa.rotation[:, "xy".index(axis[1])], pb.rotation[:, 2]
                    nd, cd = np.cross(va.angular, n), np.cross(vb.angular, c)
                    ndd, cdd = np.cross(aa.angular, n) + np.cross(va.angular, nd), np.cross(ab.angular, c) + np.cross(vb.angular, cd)
                    value.append(n @ c)
                    jac.append(np.cross(n, c) @ ja[3:] + np.cross(c, n) @ jb[3:])
                    drift.append(ndd @ c + 2 * nd @ cd + n @ cdd)
        return np.array(value), np.array(jac), np.array(drift)

    def close(self, q):
        q = q.copy()
        for _ in range(60):
            value, jac, _ = self.rows(q, np.zeros_like(q))
            if np.abs(value).max() < 2e-15:
                break
            q[self.passive] -= np.linalg.lstsq(jac[:, self.passive], value, rcond=1e-10)[0]
        assert np.abs(value).max() < 1e-13, np.abs(value).max()
        return q

    def state(self, q_start):
        m, act, pas = self.model, self.active, self.passive
        q = self.close(q_start)
        solve = lambda jac, rhs: np.linalg.lstsq(jac[:, pas], rhs, rcond=1e-10)[0]
        v, a = np.zeros(m.nv), np.zeros(m.nv)
        v[act], a[act] = RNG.uniform(-1, 1, len(act)), RNG.uniform(-4, 4, len(act))
        _, jac, _ = self.rows(q, v)
        v[pas] = solve(jac, -jac[:, act] @ v[act])
        _, jac, drift = self.rows(q, v)
        a[pas] = solve(jac, -drift - jac[:, act] @ a[act])
        # Efforts: drives and loop forces together carry the tree's inverse dynamics.
        tree = pin.rnea(m, self.data, q, v, a).copy()
        tree[act] += self.rotor * a[act]
        loop_force = np.linalg.lstsq(jac[:, pas].T, tree[pas], rcond=1e-10)[0]
        assert np.abs(jac[:, pas].T @ loop_force - tree[pas]).max() < 1e-8
        tau = tree[act] - jac[:, act].T @ loop_force
        return q, v, a, tau

    def check_with_forward_dynamics(self, q, v, a, tau):
        """Pinocchio's constrained forward dynamics must return the accelerations (loops of kind x y z only)."""
        plain, contacts, contact_data = self.model, pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for (fa, fb), axes in self.loops:
            assert axes == ["x", "y", "z"]
            f1, f2 = plain.frames[fa], plain.frames[fb]
            contacts.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, plain, f1.parentJoint, f1.placement, f2.parentJoint, f2.placement, pin.LOCAL))
        for contact in contacts:
            contact_data.append(contact.createData())
        model = plain.copy()
        armature = np.zeros(model.nv)
        armature[self.active] = self.rotor
        model.armature = armature
        data = model.createData()
        full = np.zeros(model.nv)
        full[self.active] = tau
        pin.initConstraintDynamics(model, data, contacts, contact_data)
        got = pin.constraintDynamics(model, data, q, v, full, contacts, contact_data, pin.ProximalSettings(1e-14, 0.0, 1))
        error = np.abs(got - a).max() / np.abs(a).max()
        assert error < 1e-9, error
        return error


def frame_at(model, data, link, target):
    """The placement in `link` of a frame whose world pose is `target`."""
    frame = data.oMf[model.getFrameId(link)]
    return frame.actInv(target)


def toml_frame(link, pose):
    rpy = pin.rpy.matrixToRpy(pose.rotation)
    return f'{{ link = "{link}", xyz = [{", ".join(map(repr, pose.translation.tolist()))}], rpy = [{", ".join(map(repr, rpy.tolist()))}] }}'


def best_drives(text, toml, home, count):
    """The joints to drive so that the others follow best: a drawn mechanism may be singular for any other choice."""
    robot = Closed(text, toml)
    _, jac, _ = robot.rows(home, np.zeros_like(home))
    follow = lambda drives: np.linalg.svd(np.delete(jac, drives, axis=1), compute_uv=False)[-1]
    best = max(itertools.combinations(range(len(home)), count), key=follow)
    print("  smallest singular value of the followers", follow(best))
    return [robot.names[k] for k in best]


def closed_golden(name, joints, closures, drives, gravity, spread):
    """Closes the tree where it stands at drawn coordinates; closures: (name, link a, link b, axes, free turn about a's z)."""
    text = urdf(name, joints)
    model = built(text)
    data = model.createData()
    home = RNG.uniform(-0.5, 0.5, model.nv)
    pin.framesForwardKinematics(model, data, home)
    toml = f'name = "{name}"\nurdf = "{name}.urdf"\ngravity = {list(gravity)}\n'
    for closure, link_a, link_b, axes, turn in closures:
        in_a = pin.SE3(np.eye(3), RNG.uniform(-0.2, 0.2, 3)) if turn is None else pin.SE3(np.eye(3), np.append(RNG.uniform(0.2, 0.4, 2), 0.0))
        at = data.oMf[model.getFrameId(link_a)] * in_a
        free = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, turn or 0.0), np.zeros(3))
        a, b = toml_frame(link_a, in_a), toml_frame(link_b, frame_at(model, data, link_b, at * free))
        toml += f'[[loop]]\nname = "{closure}"\na = {a}\nb = {b}\nconstrain = {json.dumps(list(axes))}\n'
    for k, drive in enumerate(best_drives(text, toml, home, drives)):
        toml += f'[[actuator]]\njoint = "{drive}"\nrotor_inertia = {0.05 * (k + 1)}\n'
    names = list(model.names)[1:]
    toml += "[assembly]\n" + "".join(f"{n} = {float(home[k])!r}\n" for k, n in enumerate(names))
    robot, states, errors = Closed(text, toml), [], []
    for _ in range(12):
        start = home.copy()
        start[robot.active] += RNG.uniform(-spread, spread, len(robot.active))
        q, v, a, tau = robot.state(start)
        if all(c[3] == ["x", "y", "z"] for c in closures):
            errors.append(robot.check_with_forward_dynamics(q, v, a, tau))
        states.append({"q": q.tolist(), "v": v.tolist(), "a": a.tolist(), "tau": tau.tolist()})
    print(name, "rows", len(robot.rows(home, home)[0]), "joints", len(names), "against Pinocchio's forward dynamics", max(errors, default=None))
    save(name, {"toml": toml, "urdf": text, "joints": names, "states": states})


def spatial():
    """A platform on a six-joint leg, held by two more three-joint legs with ball joints: 12 - 6 = 6 drives."""
    leg1 = ["base", "a1", "a2", "a3", "a4", "a5", "platform"]
    joints = [drawn(f"p{k}", "prismatic" if k == 2 else "revolute", leg1[k], leg1[k + 1]) for k in range(6)]
    for leg in "bc":
        links = ["base", f"{leg}1", f"{leg}2", f"{leg}3"]
        joints += [drawn(f"{leg}{k}", "prismatic" if k == 2 else "revolute", links[k], links[k + 1]) for k in range(3)]
    closures = [("ball_b", "platform", "b3", ["x", "y", "z"], None), ("ball_c", "c3", "platform", ["x", "y", "z"], None)]
    closed_golden("spatial_loop", joints, closures, 6, (0.0, 0.0, -9.81), 0.08)


def planar(name, left, right, axes, drives):
    """Two planar chains from the base, pinned together about z."""
    joints = []
    for side, kinds, x in (("left", left, 0.0), ("right", right, 0.7)):
        parent = "base"
        for k, kind in enumerate(kinds):
            child = f"{side}{k}"
            xyz = (x, 0.0, 0.0) if k == 0 else (*RNG.uniform(0.2, 0.5, 2), 0.0)
            axis = (0, 0, 1) if kind == "revolute" else (1, 0, 0)
            joints.append((f"{side}_joint{k}", kind, parent, child, xyz, (0.0, 0.0, RNG.uniform(-0.4, 0.4)), axis))
            parent = child
    closures = [("pin", f"left{len(left) - 1}", f"right{len(right) - 1}", axes, 2.5)]
    closed_golden(name, joints, closures, drives, (0.0, -9.81, 0.0), 0.08)


def main():
    arm()
    branched()
    spatial()
    planar("four_bar", ["revolute", "revolute"], ["revolute"], ["x", "y"], 1)
    # Overdetermined on purpose: in space a pin forbids five motions, of which a planar loop leaves two to forbid.
    planar("five_bar", ["revolute", "revolute"], ["prismatic", "revolute"], ["x", "y", "z", "rx", "ry"], 2)
    # A single spatial loop closed by a pin: seven joints less five rows leave two drives.
    chain = ["base", "s1", "s2", "s3", "s4"]
    other = ["base", "t1", "t2", "t3"]
    joints = [drawn(f"s{k}", "revolute", chain[k], chain[k + 1]) for k in range(4)]
    joints += [drawn(f"t{k}", "prismatic" if k == 1 else "revolute", other[k], other[k + 1]) for k in range(3)]
    closed_golden("spatial_pin", joints, [("pin", "s4", "t3", ["x", "y", "z", "rx", "ry"], 2.0)], 2, (0.0, 0.0, -9.81), 0.06)


if __name__ == "__main__":
    main()
