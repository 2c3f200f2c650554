"""Robots drawn at random, as the texts of robot.toml and URDF: trees, and two chains that a loop joins."""

import json
from xml.sax.saxutils import quoteattr

import numpy as np
import pkm

# Two names that a careless writer of XML or YAML breaks.
NAMES = {"j2": 'the "second" joint & <co>', "l2": "l2: #{link}"}


def named(name):
    return NAMES.get(name, name)


def numbers(values):
    return " ".join(repr(float(x)) for x in values)


def rotation(rpy):
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array(
        [[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], [-sp, cp * sr, cp * cr]]
    )


def angles(r):
    """Roll, pitch, yaw of a rotation that is not upright."""
    return np.array([np.arctan2(r[2, 1], r[2, 2]), np.arcsin(-r[2, 0]), np.arctan2(r[1, 0], r[0, 0])])


def pose(xyz, rpy):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation(rpy), xyz
    return out


class Drawing:
    """Links and joints as they are added, and where every link is with all coordinates at zero."""

    def __init__(self, rng):
        self.rng, self.links, self.joints, self.toml = rng, ['<link name="base"/>'], [], []
        self.at = {"base": np.eye(4)}

    def inertial(self):
        rng = self.rng
        mass, edges = rng.uniform(0.5, 3.0), rng.uniform(0.05, 0.4, 3)
        ixx, iyy, izz = (mass / 12 * (edges @ edges - edges**2)).tolist()
        return (
            f'<inertial><origin xyz="{numbers(rng.uniform(-0.2, 0.2, 3))}" rpy="{numbers(rng.uniform(-1, 1, 3))}"/><mass value="{mass!r}"/>'
            f'<inertia ixx="{ixx!r}" ixy="0" ixz="0" iyy="{iyy!r}" iyz="0" izz="{izz!r}"/></inertial>'
        )

    def add(self, name, kind, ends, *, xyz=None, rpy=None, axis=None, massless=False, rotor=None):
        rng, (parent, child) = self.rng, ends
        xyz = rng.uniform(-0.4, 0.4, 3) if xyz is None else xyz
        rpy = rng.uniform(-1.5, 1.5, 3) if rpy is None else rpy
        axis = rng.normal(size=3) if axis is None else axis
        self.links.append(f"<link name={quoteattr(named(child))}>{'' if massless else self.inertial()}</link>")
        limit = "" if kind == "fixed" else f'<axis xyz="{numbers(axis)}"/><limit lower="-3" upper="3" effort="100" velocity="9"/>'
        dynamics = "" if kind == "fixed" else f'<dynamics damping="{rng.uniform(0, 1)!r}" friction="{rng.uniform(0, 1)!r}"/>'
        self.joints.append(
            f'<joint name={quoteattr(named(name))} type="{kind}"><parent link={quoteattr(named(parent))}/><child link={quoteattr(named(child))}/>'
            f'<origin xyz="{numbers(xyz)}" rpy="{numbers(rpy)}"/>{limit}{dynamics}</joint>'
        )
        self.at[child] = self.at[parent] @ pose(xyz, rpy)
        if rotor is not None:
            self.toml.append(f"[[actuator]]\njoint = {json.dumps(named(name))}\nrotor_inertia = {rotor!r}")

    def kind(self):
        return "prismatic" if self.rng.random() < 0.3 else "revolute"

    def close(self, name, ends, constrain, planar=False):
        """Frames that coincide with all coordinates at zero; in a planar robot but for a step across the plane."""
        rng, frames = self.rng, []
        rpy = np.array([0.0, 0.0, rng.uniform(-1, 1)]) if planar else rng.uniform(-1, 1, 3)
        a = pose(rng.uniform(-0.3, 0.3, 3), rpy)
        there = np.linalg.inv(self.at[ends[1]]) @ self.at[ends[0]] @ a
        if planar and "z" not in constrain:
            there[2, 3] += 0.07
        for link, frame in zip(ends, [a, there], strict=True):
            values = [frame[:3, 3].tolist(), angles(frame[:3, :3]).tolist()]
            frames.append(f"{{ link = {json.dumps(named(link))}, xyz = {values[0]}, rpy = {values[1]} }}")
        self.toml.append(f'[[loop]]\nname = "{name}"\na = {frames[0]}\nb = {frames[1]}\nconstrain = {json.dumps(constrain)}')

    def load(self, folder, gravity=(0.0, 0.0, -9.81)):
        (folder / "drawn.urdf").write_text(f'<robot name="drawn">{"".join(self.links)}{"".join(self.joints)}</robot>')
        head = f'name = "drawn"\nurdf = "drawn.urdf"\ngravity = {list(gravity)}\n'
        (folder / "drawn.toml").write_text(head + "\n".join(self.toml) + "\n")
        return pkm.load(folder / "drawn.toml")


def tree(folder, seed, gravity=(0.0, 0.0, -9.81)):
    """Chains and branches, a universal joint through a massless cross, a massless hub that branches, a mass fixed to a link."""
    d = Drawing(np.random.default_rng(seed))
    d.add("j0", d.kind(), ("base", "l0"), rotor=0.3)
    d.add("j1", "revolute", ("l0", "cross"), massless=True)
    d.add("j2", "revolute", ("cross", "l2"), rotor=0.1)
    d.add("flange", "fixed", ("l2", "tool"))
    d.add("j3", d.kind(), ("tool", "l3"), rotor=0.2)
    d.add("j4", "revolute", ("l0", "hub"), massless=True, rotor=0.2)
    d.add("j5", d.kind(), ("hub", "l5"), rotor=0.1)
    d.add("j6", d.kind(), ("hub", "l6"), rotor=0.05)
    d.add("j7", "continuous", ("l6", "l7"), rotor=0.0)
    d.toml.append('[[actuator]]\njoint = "j1"')
    return d.load(folder, gravity)


def coupled(folder, seed, of):
    """Four links in series; the last joint follows those named in `of`, with offset."""
    d = Drawing(np.random.default_rng(seed))
    for k in range(3):
        d.add(f"j{k}", "revolute", ("base" if k == 0 else f"l{k - 1}", f"l{k}"), rotor=0.1 * k)
    d.add("j3", "revolute", ("l2", "l3"))
    ratios = ", ".join(f"{json.dumps(named(name))} = {ratio}" for name, ratio in of.items())
    d.toml.append(f'[[coupling]]\njoint = "j3"\nof = {{ {ratios} }}\noffset = 0.2')
    return d.load(folder)


def of_several_coordinates(folder, seed):
    """A ball on an arm, a body that flies from the ground, one that flies from it, and one on a plane that lies askew."""
    d = Drawing(np.random.default_rng(seed))
    d.add("j0", "revolute", ("base", "l0"), rotor=0.1)
    d.add("ball", "spherical", ("l0", "head"))
    d.add("j1", "prismatic", ("head", "l1"), rotor=0.2)
    d.add("fly", "floating", ("base", "ship"))
    d.add("drone", "floating", ("ship", "boat"))
    d.add("table", "planar", ("l0", "plate"))
    return d.load(folder, gravity=(0.0, -9.0, -1.0))


def joined_chains(folder, seed, constrain, n_passive):
    """A driven chain of three joints and a passive one, joined at their ends in space; redrawn until far from a singularity."""
    return drawn_until_sound(folder, seed, lambda d: chains(d, constrain, n_passive, {}))


def planar_chains(folder, seed, constrain, n_passive):
    """The same in a plane that stands anywhere, links at different heights above it."""
    return drawn_until_sound(folder, seed, lambda d: chains(d, constrain, n_passive, {"axis": [0.0, 0.0, 1.0]}))


def chains(d, constrain, n_passive, how):
    start = "base"
    if how:
        d.add("mount", "fixed", ("base", "frame"), massless=True)
        start = "frame"
    ends = []
    # Rotations need joints that turn.
    turns_only = bool(how) or all(axis.startswith("r") for axis in constrain)
    for letter, n in [("a", 3), ("b", n_passive)]:
        parent = start
        for k in range(n):
            rpy = {"rpy": [0.0, 0.0, d.rng.uniform(-1, 1)]} if how else {}
            kind = "revolute" if turns_only or k % 3 else "prismatic"
            rotor = {"rotor": 0.1 + 0.1 * k} if letter == "a" else {}
            d.add(f"{letter}{k}", kind, (parent, f"{letter}link{k}"), **how, **rpy, **rotor)
            parent = f"{letter}link{k}"
        ends.append(parent)
    d.close("yoke", ends, constrain, planar=bool(how))


def drawn_until_sound(folder, seed, draw):
    while True:
        d = Drawing(np.random.default_rng(seed))
        draw(d)
        robot = d.load(folder, gravity=(1.0, -2.0, -9.0))
        seed += 1000
        if robot.mobility == robot.n_act and np.abs(reduction(robot, np.zeros(robot.n_act))[1]).max() < 8.0:
            return robot


def reduction(robot, offset):
    """Closed coordinates at the assembly's drives plus `offset` (or ValueError), and v_tree per v of each drive, (nv, n_act)."""
    drives = [robot.joints.index(name) for name in robot.actuators]
    q = np.tile(robot.assemble()[drives] + offset, (robot.n_act, 1))
    q_tree, v_tree, _ = robot.closed_loop_motion(q, np.eye(robot.n_act), np.zeros_like(q))
    return q_tree[0], v_tree.T
