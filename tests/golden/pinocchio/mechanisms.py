"""Robots with joints of several coordinates, in the coordinates of pkm-dyn; shared by make_dynamics.py and make_loops.py.

Pinocchio's URDF reader knows no `spherical`; `model_of` reads the same text and calls `addJoint`. Coordinates in the golden files are
pkm-dyn's: a rotation vector where Pinocchio has a quaternion, (x, y, angle) where it has (x, y, cos, sin). Velocities, efforts and
Jacobians need no change: both have those of the child in its own frame.
"""
import xml.etree.ElementTree as xml

import make_golden as base
import numpy as np
import pinocchio as pin

SEED = 20261126
PARTS = {"JointModelSpherical": ["rx", "ry", "rz"], "JointModelPlanar": ["x", "y", "rz"], "JointModelFreeFlyer": ["x", "y", "z", "rx", "ry", "rz"]}
KINDS = {"spherical": pin.JointModelSpherical, "planar": pin.JointModelPlanar, "floating": pin.JointModelFreeFlyer}


def restart(stream):
    """The drawing functions of make_golden with a seed of their own: one file's numbers do not hang on another's."""
    base.RNG = np.random.default_rng([SEED, stream])
    return base.RNG


def vector(element, name, default="0 0 0"):
    return np.array((default if element is None else element.get(name, default)).split(), float)


def origin(element):
    at = element.find("origin")
    return pin.SE3(pin.rpy.rpyToMatrix(*vector(at, "rpy")), vector(at, "xyz"))


def inertia(link):
    body = link.find("inertial")
    if body is None:
        return pin.Inertia.Zero()
    i = {k: float(body.find("inertia").get(k)) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
    about_centre = np.array([[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]])
    at = origin(body)
    return at.act(pin.Inertia(float(body.find("mass").get("value")), np.zeros(3), about_centre))


class Tree:
    """Pinocchio's model of a URDF text; `universal` pairs of joints in series become one JointModelUniversal."""

    def __init__(self, text, gravity, universal=()):
        root = xml.fromstring(text)
        self.links = {link.get("name"): link for link in root.findall("link")}
        self.joints = root.findall("joint")
        self.universal = dict(universal)
        self.model = pin.Model()
        self.model.gravity.linear = np.array(gravity, float)
        self.coordinates, self.bodies = [], []
        self.end("base", 0, pin.SE3.Identity())
        assert len(self.coordinates) == self.model.nv
        self.data = self.model.createData()

    def add_children(self, link, joint_id, link_pose):
        for joint in self.joints:
            if joint.find("parent").get("link") == link:
                self.add(joint, joint_id, link_pose * origin(joint))

    def add(self, joint, parent, placement):
        name, kind, child = joint.get("name"), joint.get("type"), joint.find("child").get("link")
        if kind == "fixed":
            self.model.appendBodyToJoint(parent, inertia(self.links[child]), placement)
            self.end(child, parent, placement)
            return
        axis = vector(joint.find("axis"), "xyz", "1 0 0")
        if name in self.universal:
            second = next(j for j in self.joints if j.get("name") == self.universal[name])
            what, names = pin.JointModelUniversal(axis, vector(second.find("axis"), "xyz")), [name, second.get("name")]
            assert origin(second).isIdentity() and self.links[child].find("inertial") is None
            child = second.find("child").get("link")
        elif kind in KINDS:
            what = KINDS[kind]()
            names = [f"{name}.{part}" for part in PARTS[what.shortname()]]
        else:
            what = (pin.JointModelRevoluteUnaligned if kind == "revolute" else pin.JointModelPrismaticUnaligned)(axis)
            names = [name]
        at = self.model.addJoint(parent, what, placement, name)
        self.model.appendBodyToJoint(at, inertia(self.links[child]), pin.SE3.Identity())
        self.coordinates += names
        # The body that has the mass is that of the last coordinate.
        self.bodies.append(names[-1])
        self.end(child, at, pin.SE3.Identity())

    def end(self, link, joint_id, pose):
        self.model.addFrame(pin.Frame(link, joint_id, pose, pin.BODY))
        self.add_children(link, joint_id, pose)

    def q(self, x):
        """Pinocchio's configuration for coordinates of pkm-dyn, both in the order of the velocities."""
        out, turn = np.zeros(self.model.nq), lambda r: pin.Quaternion(pin.exp3(r)).coeffs()
        for joint in list(self.model.joints)[1:]:
            own, kind = x[joint.idx_v:joint.idx_v + joint.nv], joint.shortname()
            if kind == "JointModelSpherical":
                own = turn(own)
            elif kind == "JointModelPlanar":
                own = [own[0], own[1], np.cos(own[2]), np.sin(own[2])]
            elif kind == "JointModelFreeFlyer":
                own = np.append(own[:3], turn(own[3:]))
            out[joint.idx_q:joint.idx_q + joint.nq] = own
        return out

    def x(self, q):
        """The way back."""
        out, turn = np.zeros(self.model.nv), lambda c: pin.log3(pin.Quaternion(np.array(c)).toRotationMatrix())
        for joint in list(self.model.joints)[1:]:
            own, kind = q[joint.idx_q:joint.idx_q + joint.nq], joint.shortname()
            if kind == "JointModelSpherical":
                own = turn(own)
            elif kind == "JointModelPlanar":
                own = [own[0], own[1], np.arctan2(own[3], own[2])]
            elif kind == "JointModelFreeFlyer":
                own = np.append(own[:3], turn(own[3:]))
            out[joint.idx_v:joint.idx_v + joint.nv] = own
        return out

    def set_armature(self, armature):
        """armature: by coordinate's name."""
        self.model.armature = np.array([armature.get(name, 0.0) for name in self.coordinates])
        self.data = self.model.createData()


def mass_matrix(model, data, q):
    mass = pin.crba(model, data, q)
    return np.triu(mass) + np.triu(mass, 1).T


def save(name, content):
    content = {"seed": SEED, **content}
    content["states"] = [{k: np.asarray(v).tolist() for k, v in state.items()} for state in content["states"]]
    base.save(name, content)
