"""What others would say of the blind trials: usual methods on the public files of every case, in the form of verdicts.

    python benches/trials/baselines.py PROOF [NAME ...]

reads PROOF/cases and nothing else of the folder, and writes PROOF/baselines/NAME/verdicts/CASE.json and runs/CASE.json;
`pkm prove --out PROOF --score-only` then scores them beside the diagnosis. `cargo xtask prove-baselines PROOF` does both.

nominal   the robot as given; names nothing
refit     inertias, frictions and offsets by least squares; names nothing
sindy     sequentially thresholded least squares (pysindy) on what the nominal robot leaves, one joint at a time
bic       forward selection over a library of effects with all of `refit` refitted at every step, stopped by the BIC
box       bounded least squares of inertias, armature, damping, friction, bias and delay, as MuJoCo's sysid poses it
boosting  gradient-boosted trees (scikit-learn) on what `refit` leaves; names nothing

All of them are given the rigid-body regressor of this project, so that they differ in what they make of a mismatch, not in mechanics. Thresholds are
the methods' usual ones and were fixed before the first scores.
"""

import json
import sys
import tempfile
import time
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pkm
from scipy.optimize import lsq_linear
from scipy.signal import butter, filtfilt, medfilt

BAND_HZ = 10.0
"""Low-pass of effort, model and every column [Hz]."""

MOTION_HZ = 30.0
"""Low-pass of positions before they are differentiated [Hz]."""


def low_pass(x, dt, hz):
    """Zero-phase Butterworth of fourth order along the first axis."""
    b, a = butter(2, min(2 * hz * dt, 0.95))
    return filtfilt(b, a, x, axis=0)


def mended(t, x, grid):
    """Samples on an even grid; what is missing or wild is interpolated."""
    x = np.array(x, float)
    good = np.isfinite(x)
    x = np.interp(t, t[good], x[good])
    step = np.abs(x - medfilt(x, 5))
    x[step > 20 * np.median(step) + 6 * x.std()] = np.nan
    good = np.isfinite(x)
    return np.interp(grid, t[good], x[good])


class Bench:
    """A recording of a robot: everything a method may use, filtered alike."""

    def __init__(self, robot, frictions, tilted, path):
        rec = pkm.read(path)
        t, dt = np.array(rec.time), np.median(np.diff(rec.time))
        grid = t[0] + dt * np.arange(int((t[-1] - t[0]) / dt))
        column = lambda kind: np.stack([mended(t, rec[f"{kind}.{j}"], grid) for j in robot.actuators], axis=1)
        self.q = low_pass(column("q"), dt, MOTION_HZ)
        self.v = np.gradient(self.q, dt, axis=0)
        self.a = np.gradient(self.v, dt, axis=0)
        self.t, self.dt, self.robot = grid - grid[0], dt, robot
        self.every = max(1, round(1 / (2.5 * BAND_HZ * dt)))
        self.motion = (self.q, self.v, self.a)
        self.tau = self.rows(column("tau"))
        rigid = robot.inverse_dynamics(*self.motion)
        friction = robot.friction_regressor(*self.motion)
        nv = robot.nv
        self.model = rigid + friction[:, :, nv : 2 * nv] @ frictions[0] + friction[:, :, 2 * nv :] @ frictions[1]
        self.nominal = self.rows(self.model)
        self.left = self.tau - self.nominal
        self.rigid = self.rows(robot.actuated_regressor(*self.motion))
        self.friction = self.rows(friction)
        self.tilt = [self.rows(other.inverse_dynamics(*self.motion) - rigid) / 0.01 for other in tilted]

    def rows(self, x):
        """Filtered, without the ends of the filter, at 2.5 samples per period of the band."""
        y = low_pass(x.reshape(len(x), -1), self.dt, BAND_HZ).reshape(x.shape)
        return y[4 * self.every : -4 * self.every : self.every]

    def at(self, k, series):
        """A column at drive k."""
        out = np.zeros_like(self.q)
        out[:, k] = series
        return self.rows(out)


class Case:
    """The public files of one case."""

    def __init__(self, folder):
        manifest = tomllib.loads((folder / "case.toml").read_text())
        text = (folder / "robot.toml").read_text()
        spec = tomllib.loads(text)
        self.robot = pkm.load(folder / "robot.toml")
        names, nv = self.robot.joints, self.robot.nv
        self.frictions = np.zeros((2, nv))
        urdf = ET.parse(folder / spec["urdf"]).getroot()
        for joint in urdf.findall("joint"):
            dynamics = joint.find("dynamics")
            if dynamics is not None and joint.get("name") in names:
                values = [float(dynamics.get(key, 0)) for key in ("damping", "friction")]
                self.frictions[:, names.index(joint.get("name"))] = values
        child = {j.get("name"): j.find("child").get("link") for j in urdf.findall("joint")}
        parents = {j.find("child").get("link") for j in urdf.findall("joint")}
        self.root = next(link.get("name") for link in urdf.findall("link") if link.get("name") not in parents)
        self.links = [child.get(n, n) for n in names]
        self.end = "platform" if "platform" in self.links else self.links[-1]
        tilted = self.tilted(folder, text, spec)
        bench = lambda name: Bench(self.robot, self.frictions, tilted, folder / name)
        self.learn = [bench(name) for name in manifest["recordings"]]
        self.judge = [bench(name) for name in manifest["holdouts"]]

    def tilted(self, folder, text, spec):
        """The robot with gravity turned by 0.01 rad about x and about y."""
        g = np.array(spec.get("gravity", [0.0, 0.0, -9.81]), float)
        if not g.any():
            return []
        out = []
        kept = "\n".join(line for line in text.splitlines() if not line.startswith("gravity"))
        with tempfile.TemporaryDirectory() as room:
            (Path(room) / spec["urdf"]).parent.mkdir(parents=True, exist_ok=True)
            (Path(room) / spec["urdf"]).write_text((folder / spec["urdf"]).read_text())
            for axis in ([1, 0, 0], [0, 1, 0]):
                turned = g + 0.01 * np.cross(axis, g)
                (Path(room) / "robot.toml").write_text(f"gravity = {list(map(float, turned))}\n" + kept)
                out.append(pkm.load(Path(room) / "robot.toml"))
        return out

    def refit_columns(self, b):
        """What a refit may change: inertias, the frictions that the robot has, offsets."""
        nv, has = self.robot.nv, self.frictions > 0
        drives = np.eye(len(self.robot.actuators))
        offsets = np.broadcast_to(drives, (len(b.tau), *drives.shape))
        parts = [b.rigid, b.friction[:, :, nv : 2 * nv][:, :, has[0]], b.friction[:, :, 2 * nv :][:, :, has[1]], offsets]
        return np.concatenate(parts, axis=2)


def stacked(benches, of):
    """Rows of all recordings, drives one below the other; the weight of a drive is one over its effort."""
    weight = 1 / rms([b.tau for b in benches])
    parts = []
    for b in benches:
        x = np.asarray(of(b))
        x = x * (weight[None, :, None] if x.ndim == 3 else weight[None, :])
        parts.append(x.reshape(x.shape[0] * x.shape[1], *x.shape[2:]))
    return np.concatenate(parts)


def rms(series):
    return np.maximum(np.sqrt(np.mean(np.concatenate(series) ** 2, axis=0)), 1e-12)


def error(benches, left):
    """docs/FORMATS.md: per drive the error over the effort, then the root mean square over drives."""
    share = rms([left(b) for b in benches]) / rms([b.tau for b in benches])
    return float(np.sqrt(np.mean(share**2)))


def library(case, b, scale):
    """Effects as columns: name, places, names that this column cannot tell it from, columns (rows, drives, n)."""
    robot, nv = case.robot, case.robot.nv
    out = []
    for k, joint in enumerate(robot.actuators):
        q, v, a, model = b.q[:, k], b.v[:, k], b.a[:, k], b.model[:, k]
        middle, reach, speed, peak = (scale[key][k] for key in ("middle", "reach", "speed", "peak"))
        s, x = np.sign(v), (q - middle) / reach
        slope = np.gradient(model, b.dt)
        over = lambda u: np.maximum(u, 0)
        wave = lambda n: [np.sin(n * np.pi * x), np.cos(n * np.pi * x)]
        shift = b.q.copy()
        shift[:, k] += 1e-4
        moved = (robot.inverse_dynamics(shift, b.v, b.a) - robot.inverse_dynamics(*b.motion)) / 1e-4
        own = [
            ("friction_viscous", [v], []),
            ("friction_coulomb", [s], []),
            ("friction_asymmetric", [np.abs(s), np.abs(v)], ["torque_offset"]),
            ("friction_stribeck", [s * np.exp(-((v / (0.12 * speed)) ** 2))], ["friction_presliding"]),
            ("friction_quadratic", [v * np.abs(v)], []),
            ("friction_position", [x * s], []),
            ("friction_load", [np.abs(model) * s], ["directional_efficiency"]),
            ("friction_thermal", [b.t * v], []),
            ("rotor_inertia", [a], []),
            ("spring", [x], []),
            ("cable_force", [x**2, x**3], []),
            ("torque_constant", [model], []),
            ("torque_offset", [np.ones_like(v)], []),
            ("time_delay", [slope], ["actuator_lag"]),
            ("saturation", [np.sign(model) * over(np.abs(model) - 0.9 * peak)], []),
            ("dead_zone", [np.sign(model)], []),
            ("sensor_drift", [b.t], []),
            ("contact", [over(x - 0.55) ** 1.5], []),
            ("contact", [-(over(-x - 0.55) ** 1.5)], []),
        ]
        own += [("torque_ripple", wave(n), ["encoder_eccentricity"]) for n in (3, 4, 5, 6, 7)]
        out += [(name, [joint], alike, np.stack([b.at(k, c) for c in columns], axis=2)) for name, columns, alike in own]
        out.append(("encoder_offset", [joint], [], b.rows(moved)[:, :, None]))
    for i, joint in enumerate(robot.joints):
        if joint in robot.passive:
            out.append(("friction_passive", [joint], [], b.friction[:, :, [nv + i, 2 * nv + i]]))
    end = case.links.index(case.end)
    out.append(("payload", [case.end], [], b.rigid[:, :, 10 * end : 10 * end + 4]))
    if b.tilt:
        out.append(("gravity_tilt", [case.root], [], np.stack(b.tilt, axis=2)))
    return out


def scales(case):
    """Sizes of the motion that columns are scaled with, from the recordings to learn from."""
    q, v = (np.concatenate([getattr(b, key) for b in case.learn]) for key in "qv")
    model = np.concatenate([b.model for b in case.learn])
    low, high = q.min(axis=0), q.max(axis=0)
    peak = np.abs(model).max(axis=0)
    return {"middle": (low + high) / 2, "reach": np.maximum((high - low) / 2, 1e-9), "speed": v.std(axis=0), "peak": peak}


def verdict(case, left, findings):
    nominal = error(case.judge, lambda b: b.left)
    heldout = {"rms_nominal": nominal, "rms_final": error(case.judge, left), "band_hz": BAND_HZ}
    return {
        "schema": "pkm.verdict/1",
        "status": "ok",
        "nothing_missing": not findings,
        "findings": [
            {"rank": i + 1, "effect": name, "where": where, "cannot_tell_from": [{"effect": n, "where": where} for n in alike]}
            for i, (name, where, alike) in enumerate(findings)
        ],
        "unexplained": {"present": False},
        "heldout": heldout,
    }


def nominal(case):
    return verdict(case, lambda b: b.left, [])


def solved(x, y):
    """Least squares with columns of one length and small singular values cut."""
    size = np.maximum(np.sqrt((x**2).sum(axis=0)), 1e-12)
    return np.linalg.lstsq(x / size, y, rcond=1e-6)[0] / size


def refit(case):
    theta = solved(stacked(case.learn, case.refit_columns), stacked(case.learn, lambda b: b.left))
    return verdict(case, lambda b: b.left - case.refit_columns(b) @ theta, [])


def sindy(case):
    import pysindy

    scale = scales(case)
    names = ["torque_offset", "spring", "friction_viscous", "rotor_inertia", "friction_coulomb", "friction_quadratic"]
    names += ["cable_force", "friction_asymmetric", "friction_position", "friction_load", "torque_constant", "unnamed"]

    def terms(b, k):
        x, v, a = (b.q[:, k] - scale["middle"][k]) / scale["reach"][k], b.v[:, k] / scale["speed"][k], b.a[:, k]
        s, model = np.sign(v), b.model[:, k] / max(scale["peak"][k], 1e-12)
        a = a / max(np.std(case.learn[0].a[:, k]), 1e-12)
        columns = [np.ones_like(x), x, v, a, s, v * np.abs(v), x**2, np.abs(v), x * s, np.abs(model) * s, model, x * v]
        return b.rows(np.stack(columns, axis=1))

    found, weights = [], []
    size = rms([b.tau for b in case.learn])
    for k, joint in enumerate(case.robot.actuators):
        x = np.concatenate([terms(b, k) for b in case.learn])
        y = np.concatenate([b.left[:, k] for b in case.learn]) / size[k]
        fit = pysindy.STLSQ(threshold=0.02, alpha=1e-6, max_iter=30)
        fit.fit(x, y[:, None])
        w = np.asarray(fit.coef_)[0]
        weights.append(w)
        found += [(abs(c) * x[:, i].std(), names[i], joint) for i, c in enumerate(w) if c != 0]
    predict = lambda b: np.stack([terms(b, k) @ w * size[k] for k, w in enumerate(weights)], axis=1)
    findings = [(name, [joint], []) for _, name, joint in sorted(found, reverse=True) if name != "unnamed"]
    return verdict(case, lambda b: b.left - predict(b), findings)


def bic(case):
    scale = scales(case)
    y = stacked(case.learn, lambda b: b.left)
    base = stacked(case.learn, case.refit_columns)
    size = np.maximum(np.sqrt((base**2).sum(axis=0)), 1e-12)
    u, s, _ = np.linalg.svd(base / size, full_matrices=False)
    q = u[:, s > 1e-6 * s[0]]
    beside = lambda x: x - q @ (q.T @ x)
    effects = {id(b): library(case, b, scale) for b in case.learn}
    heads = [(name, where, alike) for name, where, alike, _ in effects[id(case.learn[0])]]
    blocks = [stacked(case.learn, lambda b, i=i: effects[id(b)][i][3]) for i in range(len(heads))]
    chosen, left, n = [], beside(y), len(y)
    score = n * np.log(left @ left / n)
    for _ in range(12):
        best = None
        for i, block in enumerate(blocks):
            z = beside(block)
            # What the refit and earlier choices take already is no candidate.
            if i in chosen or (z**2).sum() < 1e-4 * (block**2).sum():
                continue
            rest = left - z @ np.linalg.lstsq(z, left, rcond=1e-8)[0]
            value = n * np.log(rest @ rest / n) + np.log(n) * z.shape[1]
            if best is None or value < best[0]:
                best = (value, i, z)
        if best is None or best[0] >= score:
            break
        chosen.append(best[1])
        extra, strength, _ = np.linalg.svd(best[2], full_matrices=False)
        q = np.concatenate([q, extra[:, strength > 1e-8 * strength[0]]], axis=1)
        left = beside(y)
        score = n * np.log(left @ left / n)
    effects.update({id(b): library(case, b, scale) for b in case.judge})
    columns = lambda b: np.concatenate([case.refit_columns(b), *(effects[id(b)][i][3] for i in chosen)], axis=2)
    theta = solved(stacked(case.learn, columns), y)
    return verdict(case, lambda b: b.left - columns(b) @ theta, [heads[i] for i in chosen])


def box(case):
    robot, nv = case.robot, case.robot.nv
    drives = [robot.joints.index(j) for j in robot.actuators]
    inertial, size = robot.parameters(), rms([b.tau for b in case.learn])
    heads, low, high = [], [], []

    def bound(head, now, ends):
        heads.append((head, now))
        low.append(ends[0] - now - 1e-12)
        high.append(ends[1] - now + 1e-12)

    has = np.flatnonzero(inertial)
    for p in has:
        bound(("inertia_error", case.links[p // 10]), inertial[p], sorted((0.5 * inertial[p], 2 * inertial[p])))
    armature = np.broadcast_to(robot.armature, (nv,)) if len(robot.armature) == nv else np.zeros(nv)
    for i in drives:
        bound(("rotor_inertia", robot.joints[i]), armature[i], (0, np.inf))
    for kind, row in (("friction_viscous", 0), ("friction_coulomb", 1)):
        for i in drives:
            bound((kind, robot.joints[i]), case.frictions[row, i], (0, np.inf))
    for k, i in enumerate(drives):
        bound(("torque_offset", robot.joints[i]), 0, (-size[k], size[k]))
    for i in drives:
        bound(("time_delay", robot.joints[i]), 0, (0, 0.02))

    def columns(b):
        kinds = [b.friction[:, :, [part * nv + i for i in drives]] for part in range(3)]
        eye = np.broadcast_to(np.eye(len(drives)), (len(b.tau), len(drives), len(drives)))
        late = np.stack([b.at(k, np.gradient(b.model[:, k], b.dt)) for k in range(len(drives))], axis=2)
        return np.concatenate([b.rigid[:, :, has], *kinds, eye, late], axis=2)

    x, y = stacked(case.learn, columns), stacked(case.learn, lambda b: b.left)
    length = np.maximum(np.sqrt((x**2).sum(axis=0)), 1e-12)
    fit = lsq_linear(x / length, y, (np.array(low) * length, np.array(high) * length), method="trf", max_iter=200)
    change = fit.x / length
    found = {}
    for i, ((head, now), c) in enumerate(zip(heads, change)):
        share = np.sqrt(np.mean((x[:, i] * c) ** 2))
        # Moved by a tenth, and by one per cent of the effort: what an engineer would remark on.
        if share > 0.01 and abs(c) > 0.1 * abs(now):
            found[head] = max(found.get(head, 0), share)
    findings = [(name, [where], []) for name, where in sorted(found, key=found.get, reverse=True)]
    return verdict(case, lambda b: b.left - columns(b) @ change, findings)


def boosting(case):
    from sklearn.ensemble import HistGradientBoostingRegressor

    theta = solved(stacked(case.learn, case.refit_columns), stacked(case.learn, lambda b: b.left))
    left = lambda b: b.left - case.refit_columns(b) @ theta
    features = lambda b: b.rows(np.concatenate([b.q, b.v, b.a, np.sign(b.v), b.model], axis=1))
    x = np.concatenate([features(b) for b in case.learn])
    trees = []
    for k in range(len(case.robot.actuators)):
        y = np.concatenate([left(b)[:, k] for b in case.learn])
        trees.append(HistGradientBoostingRegressor(max_iter=150, early_stopping=True, random_state=0).fit(x, y))
    predict = lambda b: np.stack([m.predict(features(b)) for m in trees], axis=1)
    return verdict(case, lambda b: left(b) - predict(b), [])


METHODS = {f.__name__: f for f in (nominal, refit, sindy, bic, box, boosting)}


def write(path, value):
    """Complete or not at all: a run that is stopped can go on."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(value, indent=1) + "\n")
    part.replace(path)


def main(root, names):
    unknown = [n for n in names if n not in METHODS]
    if unknown:
        sys.exit(f"error: no baseline {unknown[0]}; there are {', '.join(METHODS)}")
    if not (root / "cases").is_dir():
        sys.exit(f"error: {root}: no folder cases")
    wanted = names or list(METHODS)
    for folder in sorted(p for p in (root / "cases").iterdir() if (p / "case.toml").is_file()):
        path = lambda name, kind: root / "baselines" / name / kind / f"{folder.name}.json"
        left = [n for n in wanted if not path(n, "runs").exists()]
        if not left:
            continue
        case = Case(folder)
        for name in left:
            begin = time.perf_counter()
            ran = {"exit": 0, "error": "", "engine": name}
            try:
                write(path(name, "verdicts"), METHODS[name](case))
            except (np.linalg.LinAlgError, ValueError) as e:
                # Counted as a miss, like a diagnosis that fails.
                ran = {"exit": 1, "error": f"{type(e).__name__}: {e}", "engine": name}
            ran["seconds"] = time.perf_counter() - begin
            write(path(name, "runs"), ran)
        print(f"{folder.name}: {', '.join(left)}", flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), sys.argv[2:])
