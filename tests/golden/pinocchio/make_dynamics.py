"""Writes *_dynamics.json of tests/golden/dynamics.rs: everything a tree has, on robots drawn at random.

Run here with `pip install pin numpy`: `python make_dynamics.py`. Rotor inertia is Pinocchio's `armature`: in its mass matrix, inverse and
forward dynamics. Of its kinetic energy the files hold that of the bodies: Pinocchio 4.1.0 adds the rotors' too, except those of
JointModelRevoluteUnaligned, which does not store its velocity. The total is compared with its mass matrix. Time variations of Jacobians
are those of universal joints written as two revolute ones: Pinocchio's JointModelUniversal moves both axes with the child, finite
differences of its own Jacobian say otherwise.
"""
import numpy as np
import pinocchio as pin

import make_golden as base
from make_golden import drawn, urdf
from mechanisms import Tree, mass_matrix, restart, save

FRAMES = {"world": pin.WORLD, "local": pin.LOCAL, "aligned": pin.LOCAL_WORLD_ALIGNED}


def kinetic_energy_of_bodies(model, data, q, v):
    stored = [j for j in list(model.joints)[1:] if j.shortname() != "JointModelRevoluteUnaligned"]
    rotors = sum(0.5 * model.armature[k] * v[k] ** 2 for j in stored for k in range(j.idx_v, j.idx_v + j.nv))
    with_rotors, armature = pin.computeKineticEnergy(model, data, q, v), model.armature.copy()
    model.armature = np.zeros(model.nv)
    bodies = pin.computeKineticEnergy(model, data, q, v)
    model.armature = armature
    assert abs(with_rotors - rotors - bodies) < 1e-12 * with_rotors, "rotors in Pinocchio's energy are not as the top of this file says"
    return bodies


def time_variations(tree, in_series, q, v, link):
    out = {}
    for name, reference in FRAMES.items():
        both = []
        for m, d in ((tree.model, tree.data), (in_series.model, in_series.data)):
            pin.computeJointJacobiansTimeVariation(m, d, q, v)
            pin.updateFramePlacements(m, d)
            both.append(pin.getFrameJacobianTimeVariation(m, d, m.getFrameId(link), reference).copy())
        differs = np.abs(both[0] - both[1]).max(axis=0) > 1e-12
        assert [c for c, is_other in zip(tree.coordinates, differs) if is_other] == list(tree.universal), "as the top of this file says"
        out[f"variation_{name}"] = both[1]
    return out


def state(tree, in_series, link):
    m, d, rng = tree.model, tree.data, base.RNG
    x, to = rng.uniform(-1.2, 1.2, m.nv), rng.uniform(-1.2, 1.2, m.nv)
    v, a, effort, step = (rng.uniform(-s, s, m.nv) for s in (3.0, 10.0, 20.0, 0.8))
    q = tree.q(x)
    out = {"q": x, "v": v, "a": a, "effort": effort, "to": to, "step": step}
    out["tau"] = pin.rnea(m, d, q, v, a).copy()
    out["mass"] = mass_matrix(m, d, q)
    out["ddq"] = pin.aba(m, d, q, v, effort).copy()
    out["nle"] = pin.nonLinearEffects(m, d, q, v).copy()
    out["gravity"] = pin.computeGeneralizedGravity(m, d, q).copy()
    out["kinetic"] = [kinetic_energy_of_bodies(m, d, q, v)]
    out["potential"] = [pin.computePotentialEnergy(m, d, q)]
    out["centre"] = pin.centerOfMass(m, d, q).copy()
    out["centre_jacobian"] = pin.jacobianCenterOfMass(m, d, q).copy()
    out["torque_regressor"] = pin.computeJointTorqueRegressor(m, d, q, v, a).copy()
    out["kinetic_regressor"] = pin.computeKineticEnergyRegressor(m, d, q, v).copy().ravel()
    out["potential_regressor"] = pin.computePotentialEnergyRegressor(m, d, q).copy().ravel()
    out["joint_jacobians"] = pin.computeJointJacobians(m, d, q).copy()
    pin.updateFramePlacements(m, d)
    out |= {f"jacobian_{name}": pin.getFrameJacobian(m, d, m.getFrameId(link), reference).copy() for name, reference in FRAMES.items()}
    out |= time_variations(tree, in_series, q, v, link)
    pin.forwardKinematics(m, d, q, v, a)
    pin.updateFramePlacements(m, d)
    motion = (pin.getFrameVelocity, pin.getFrameClassicalAcceleration)
    out["velocity"], out["acceleration"] = (f(m, d, m.getFrameId(link), pin.LOCAL_WORLD_ALIGNED).vector.copy() for f in motion)
    out["difference"] = pin.difference(m, q, tree.q(to))
    pin.forwardKinematics(m, d, pin.integrate(m, q, step))
    out["moved"] = [np.append(pose.rotation.ravel(), pose.translation) for pose in list(d.oMi)[1:]]
    return out


def golden(name, joints, gravity, last, armature, count, massless=(), universal=()):
    text = urdf(name, joints, massless)
    tree = Tree(text, gravity, universal)
    tree.set_armature(armature)
    toml = f'name = "{name}"\nurdf = "{name}.urdf"\ngravity = {list(gravity)}\n'
    toml += "".join(f'[[actuator]]\njoint = "{c}"\nrotor_inertia = {rotor!r}\n' for c, rotor in armature.items())
    states = [state(tree, Tree(text, gravity), last) for _ in range(count)]
    save(f"{name}_dynamics", {"toml": toml, "urdf": text, "joints": tree.coordinates, "bodies": tree.bodies, "last_link": last, "states": states})
    return text


def arm():
    restart(1)
    joints = [drawn(f"j{k}", "revolute", "base" if k == 0 else f"l{k - 1}", f"l{k}") for k in range(7)]
    joints.append(drawn("flange", "fixed", "l6", "tool"))
    text = golden("arm7", joints, (0.0, 0.0, -9.81), "tool", {"j1": 0.4, "j5": 0.02}, 6)
    # The reader of this folder against Pinocchio's own.
    own, theirs = Tree(text, (0.0, 0.0, -9.81)).model, pin.buildModelFromXML(text)
    assert all(a.isApprox(b, 1e-14) for a, b in zip(own.inertias, theirs.inertias))
    assert all(a.isApprox(b, 1e-14) for a, b in zip(own.jointPlacements, theirs.jointPlacements))


def branched():
    restart(2)
    joints = [drawn("waist", "revolute", "base", "torso"), drawn("zlift", "prismatic", "torso", "mast"),
              drawn("right", "revolute", "mast", "r1"), drawn("rslide", "prismatic", "r1", "r2"),
              drawn("left", "revolute", "mast", "l1"), drawn("elbow", "revolute", "l1", "l2"),
              drawn("bracket", "fixed", "l2", "plate"), drawn("aslide", "prismatic", "plate", "l3"),
              drawn("camera", "revolute", "torso", "eye")]
    golden("branched", joints, (1.3, -2.1, -9.4), "plate", {"zlift": 1.5, "left": 0.1}, 6)


def mixed():
    """Joints of every kind, each between others; a universal joint is JointModelUniversal there, two revolute joints here."""
    restart(3)
    u1 = (*drawn("cross1", "revolute", "arm", "cross")[:6], (0.6, 0.8, 0.0))
    u2 = ("cross2", "revolute", "cross", "wrist", np.zeros(3), np.zeros(3), (-0.8, 0.6, 0.0))
    joints = [drawn("waist", "revolute", "base", "torso"), drawn("ball", "spherical", "torso", "arm"), u1, u2,
              drawn("table", "planar", "wrist", "plate"), drawn("lift", "prismatic", "plate", "mast"),
              drawn("wrist_mount", "fixed", "mast", "tool"), drawn("hip", "spherical", "torso", "leg"),
              drawn("knee", "revolute", "leg", "shin"), drawn("flight", "floating", "base", "drone"), drawn("rotor", "revolute", "drone", "blade")]
    # A plane's axis is its normal, always z.
    joints = [(*j[:6], (0, 0, 1)) if j[1] == "planar" else j for j in joints]
    rotors = {"waist": 0.3, "cross1": 0.05, "cross2": 0.08, "lift": 0.9, "knee": 0.2, "rotor": 0.01}
    golden("mixed", joints, (0.8, 1.1, -9.6), "tool", rotors, 6, massless=("cross",), universal=(("cross1", "cross2"),))


if __name__ == "__main__":
    arm()
    branched()
    mixed()
