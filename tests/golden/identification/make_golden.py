"""A peer for `pkm identify`: physically consistent identification with cvxpy, its held-out errors.

    python make_golden.py DATA_FOLDER        # rewrites peer.json beside this file

Needs numpy, scipy, pinocchio (`pip install pin`) and cvxpy. DATA_FOLDER holds the recordings and `rigid.py`, the reader of robot.toml with
loops and couplings that comes with them; regressors are Pinocchio's, filters scipy's, the semidefinite program cvxpy's: nothing of pkm.
The program is: least squares, each drive weighted by what plain least squares leaves of it, pseudo-inertias positive semidefinite,
friction, rotors >= 0, and a weak pull to the nominal robot so that what is not seen stays.
"""

import json
import sys
from pathlib import Path

import cvxpy
import numpy as np

DATA = Path(sys.argv[1])
sys.path.insert(0, str(DATA))
from rigid import Robot, motion, read, solve  # noqa: E402

PULL = 1e-5


def columns(robot, q, v, a, waves):
    """Regressor (n, drives, parameters), the number of inertial ones, and which of the others have a lower bound of zero."""
    y, (qt, vt, _, g) = robot.actuated_regressor(q, v, a)
    n, drives = q.shape
    unit = lambda x, k: x[:, None] * np.eye(drives)[k]
    at = lambda name, x: x[:, None] * g[:, robot.column[name], :]
    joints = robot.actuators + [j for j in robot.joints if j not in robot.actuators]
    other, bounded = [], []
    for k in range(drives):
        other.append(unit(a[:, k], k))
        bounded.append(True)
    for j in joints:
        other += [at(j, vt[:, robot.column[j]]), at(j, np.sign(vt[:, robot.column[j]]))]
        bounded += [True, True]
    for k in range(drives):
        other.append(unit(np.ones(n), k))
        bounded.append(False)
    for j, orders in waves.items():
        for order in orders:
            other += [at(j, np.sin(order * qt[:, robot.column[j]])), at(j, np.cos(order * qt[:, robot.column[j]]))]
            bounded += [False, False]
    return np.concatenate([y, np.stack(other, 2)], 2), y.shape[2], np.array(bounded)


def pseudo(x):
    """Pseudo-inertia of ten parameters in Pinocchio's order, as an expression."""
    m, hx, hy, hz, xx, xy, yy, xz, yz, zz = (x[i] for i in range(10))
    return cvxpy.bmat(
        [
            [0.5 * (yy + zz - xx), -xy, -xz, hx],
            [-xy, 0.5 * (xx + zz - yy), -yz, hy],
            [-xz, -yz, 0.5 * (xx + yy - zz), hz],
            [hx, hy, hz, m],
        ]
    )


def identify(w, tau, n_inertial, bounded, nominal):
    n, drives, p = w.shape
    weight = 1 / np.sqrt(np.mean(tau**2, axis=0))
    for _ in range(2):
        x, rank = solve((w * weight[:, None]).reshape(-1, p), (tau * weight).ravel())
        weight = 1 / (tau - w @ x).std(0)
    a, b = (w * weight[:, None]).reshape(-1, p), (tau * weight).ravel()
    r = np.linalg.qr(np.column_stack([a, b]), mode="r") / np.sqrt(n * drives)
    scale = np.maximum(np.linalg.norm(r[:, :p], axis=0), 1e-9)
    theta = cvxpy.Variable(p)
    start = np.concatenate([nominal, np.zeros(p - n_inertial)])
    cost = cvxpy.sum_squares(r[:, :p] @ theta - r[:, p]) + PULL * cvxpy.sum_squares(cvxpy.multiply(scale, theta - start))
    bounds = [pseudo(theta[10 * i : 10 * i + 10]) >> 0 for i in range(n_inertial // 10)]
    bounds.append(theta[n_inertial:][bounded] >= 0)
    problem = cvxpy.Problem(cvxpy.Minimize(cost), bounds)
    problem.solve(solver=cvxpy.CLARABEL)
    return theta.value, rank, problem.status


def errors(w, tau, theta):
    e = tau - w @ theta
    return np.sqrt(np.mean(e**2, axis=0) / np.mean(tau**2, axis=0))


class FromHome(Robot):
    """A robot whose passive joints read zero in its assembly, whatever its drives read there."""

    def close(self, q_active, guess=None):
        return super().close(q_active, np.zeros(self.model.nv) if guess is None else guess)


def run(folder, train, test, cutoff, rate, waves=None, every=1):
    waves = waves or {}
    robot = (FromHome if folder.startswith("upv") else Robot)(DATA / folder / "robot.toml")
    load = lambda name: motion(read(DATA / folder / name), robot.actuators, cutoff, rate=rate, edge=int(rate / cutoff), every=every)
    q, v, a, tau, t = load(train)
    w, n_inertial, bounded = columns(robot, q, v, a, waves)
    if test:
        q2, v2, a2, tau2, _ = load(test)
        w2 = columns(robot, q2, v2, a2, waves)[0]
    else:  # every second of ten blocks of the recording
        whole = read(DATA / folder / train)["t"]
        odd = np.floor(10 * (t - whole[0]) / (whole[-1] - whole[0])).astype(int) % 2 == 1
        w, tau, w2, tau2 = w[~odd], tau[~odd], w[odd], tau[odd]
    theta, rank, status = identify(w, tau, n_inertial, bounded, robot.nominal)
    held = errors(w2, tau2, theta)
    print(folder, status, "rank", rank, "held-out", np.round(100 * held, 2), "pooled", round(100 * np.sqrt(np.mean(held**2)), 2))
    return {"robot": folder, "band_hz": cutoff, "waves": waves, "rank": rank, "joints": robot.actuators, "heldout": held.round(6).tolist()}


if __name__ == "__main__":
    out = {
        "made_with": {"cvxpy": cvxpy.__version__, "solver": "CLARABEL", "pull": PULL},
        "runs": [
            run("emps", "train.csv", "pulses.csv", 40.0, 1000.0, every=10),
            run("dvrk_mtm", "train.csv", "test.csv", 1.8, 200.0, {"wrist_pitch": [1, 2], "platform": [1, 2]}, every=4),
            run("upv_3ups_rpu", "ident_a.csv", None, 2.0, 100.0, every=4),
        ],
    }
    Path(__file__).with_name("peer.json").write_text(json.dumps(out, indent=1) + "\n")
