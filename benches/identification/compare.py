"""Identification of a six-axis arm by pkm and by its peers, on the same recordings, in one run.

    python compare.py ROBOT_FOLDER TABLE.md [ROUNDS]     # `cargo xtask identify-peers` does it

Needs pkm, numpy, scipy, pin, cvxpy with Clarabel, and figaroh. Two motions of the arm are simulated, 60 s at 1 kHz each, with other friction and a load
that the model does not have, encoder and effort noise; one is fitted, one judged. The peers' way is the usual one: positions through a
zero-phase Butterworth filter and central differences, Pinocchio's regressor in a Python loop, columns and effort through one more filter
and thinned, QR, and then least squares (scipy) or a semidefinite program over pseudo-inertias (cvxpy, Clarabel); figaroh assembles and
decomposes with its own functions. All estimates are judged by one evaluator, the peers' own.
"""

import concurrent.futures
import os
import sys
import time
import types
from pathlib import Path

for library in ("OMP", "OPENBLAS", "MKL"):  # one thread of linear algebra
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

import cvxpy  # noqa: E402
import numpy as np
import pinocchio as pin
import pkm
import scipy.linalg
import scipy.signal
from figaroh.identification.physical_fit import build_problem, solve_direct_effort_fit
from figaroh.tools.qrdecomposition import QRDecomposer
from figaroh.tools.regressor import build_regressor_basic

BAND = 5.0  # Hz, efforts are compared below it
CUTOFF = 25.0  # Hz, of positions before they are differentiated
PULL = 1e-5  # weight of the nominal robot in the semidefinite program


def recordings(robot):
    """A minute to fit and a minute to judge, and the truth behind them."""
    truth = robot.with_effect("payload", "flange", mass=1.5)
    for joint, coulomb, viscous in zip(robot.actuators, (4, 3, 2, 0.6, 0.4, 0.2), (3, 4, 2, 0.5, 0.3, 0.1), strict=True):
        truth = truth.with_effect("friction_coulomb", joint, coulomb=coulomb).with_effect("friction_viscous", joint, viscous=viscous)
    return [pkm.simulate(truth, robot, seed=seed, duration_s=60.0, rate_hz=1000.0) for seed in (1, 2)]


def motion(recording, names):
    """Positions, velocities, accelerations and efforts, (n, drives) each, as one does it with scipy."""
    t = recording.time
    dt = (t[-1] - t[0]) / (len(t) - 1)
    sos = scipy.signal.butter(4, CUTOFF, fs=1 / dt, output="sos")
    q = scipy.signal.sosfiltfilt(sos, np.column_stack([recording[f"q.{j}"] for j in names]), axis=0)
    v = np.gradient(q, dt, axis=0)
    return q, v, np.gradient(v, dt, axis=0), np.column_stack([recording[f"tau.{j}"] for j in names]), dt


def pinocchio_loop(model, data, q, v, a):
    """Pinocchio's regressor sample by sample."""
    out = np.empty((len(q), model.nv, 10 * model.nv))
    for i in range(len(q)):
        out[i] = pin.computeJointTorqueRegressor(model, data, q[i], v[i], a[i])
    return out


def whole(inertial, v, a):
    """All columns: rotor, viscous, Coulomb and offset after the inertial ones."""
    parts = [x[:, :, None] * np.eye(v.shape[1]) for x in (a, v, np.sign(v), np.ones_like(v))]
    return np.concatenate([inertial, *parts], 2)


def rows(w, tau, dt):
    """Columns and effort, filtered and thinned."""
    n, drives, p = w.shape
    sos = scipy.signal.butter(2, BAND, fs=1 / dt, output="sos")
    step = int(1 / (2.5 * BAND * dt))
    inside = slice(int(1 / (BAND * dt)), n - int(1 / (BAND * dt)), step)
    low = lambda x: scipy.signal.sosfiltfilt(sos, x, axis=0)[inside]
    return low(w.reshape(n, -1)).reshape(-1, drives, p), low(tau)


def figaroh_columns(model, data, q, v, a):
    """The same columns as figaroh assembles them, in the order of `whole`."""
    drives = model.nv
    terms = {"has_friction": True, "has_actuator_inertia": True, "has_joint_offset": True, "act_idxv": list(range(drives))}
    stacked = build_regressor_basic(types.SimpleNamespace(model=model, data=data), q, v, a, terms)
    w = stacked.reshape(drives, len(q), -1).transpose(1, 0, 2)
    inertial, viscous, coulomb, rotor, offset = np.split(w, [10 * drives, 11 * drives, 12 * drives, 13 * drives], axis=2)
    return np.concatenate([inertial, rotor, viscous, coulomb, offset], 2)


def figaroh_estimate(w, tau):
    """figaroh's base parameters by QR with pivoting and least squares; eliminated parameters are zero."""
    flat = w.reshape(-1, w.shape[2])
    acting = np.flatnonzero((flat**2).sum(0) >= 1e-6)
    decomposer = QRDecomposer()
    values = decomposer.double_decomposition(tau.ravel(), flat[:, acting], [str(k) for k in acting])[3]
    theta = np.zeros(w.shape[2])
    theta[acting[decomposer.base_indices]] = values
    return theta


def figaroh_physical(w, tau, nominal, names):
    """figaroh's effort fit with pseudo-inertias."""
    inertial = [f"{k}_{j}" for j in names for k in ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")]
    columns = inertial + [f"{k}_{j}" for k in ("Ia", "fv", "fs", "off") for j in names]
    flat = w.transpose(1, 0, 2).reshape(-1, w.shape[2])
    row_weight = np.repeat(weights(w, tau)[0], len(w))
    problem = build_problem(flat, tau.T.ravel(), columns, names, prior=nominal, row_weight=row_weight)
    record = solve_direct_effort_fit(problem)
    assert record.accepted, record.solver_status
    return record.theta


def weights(w, tau):
    """Inverse standard deviations of what plain least squares leaves of every drive."""
    weight = 1 / np.sqrt(np.mean(tau**2, axis=0))
    for _ in range(2):
        x = scipy.linalg.lstsq((w * weight[:, None]).reshape(-1, w.shape[2]), (tau * weight).ravel(), cond=1e-8)[0]
        weight = 1 / (tau - w @ x).std(0)
    return weight, x


def triangle(w, tau, weight):
    return np.linalg.qr(np.column_stack([(w * weight[:, None]).reshape(-1, w.shape[2]), (tau * weight).ravel()]), mode="r") / np.sqrt(tau.size)


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


def semidefinite(w, tau, nominal):
    """The nearest robot that can exist: bodies, rotors and friction."""
    drives, p = w.shape[1:]
    r = triangle(w, tau, weights(w, tau)[0])
    scale = np.maximum(np.linalg.norm(r[:, :p], axis=0), 1e-9)
    theta = cvxpy.Variable(p)
    cost = cvxpy.sum_squares(r[:, :p] @ theta - r[:, p]) + PULL * cvxpy.sum_squares(cvxpy.multiply(scale, theta - nominal))
    bounds = [pseudo(theta[10 * k : 10 * k + 10]) >> 0 for k in range(drives)]
    bounds.append(theta[10 * drives : 13 * drives] >= 0)
    cvxpy.Problem(cvxpy.Minimize(cost), bounds).solve(solver=cvxpy.CLARABEL)
    return theta.value


def errors(w, tau, theta):
    e = tau - w @ theta
    return np.sqrt(np.mean(e**2, axis=0) / np.mean(tau**2, axis=0))


def pooled(e):
    return 100 * np.sqrt(np.mean(e**2))


def filled_by_all(array):
    """One number into all of an array, every processor a part of it: numpy lets go of the interpreter meanwhile."""
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(lambda part: part.fill(1.0), np.array_split(array, os.cpu_count())))


def best(rounds, functions):
    """Least time of each function [s], taking turns, and what it gave."""
    times, answers = [np.inf] * len(functions), [None] * len(functions)
    for _ in range(rounds):
        for k, function in enumerate(functions):
            answers[k] = None
            start = time.perf_counter()
            answers[k] = function()
            times[k] = min(times[k], time.perf_counter() - start)
    return times, answers


def our_theta(estimate, robot):
    """Learned parameters in the order of the peers' columns."""
    learned = dict(zip(estimate.names_, estimate.theta_, strict=True))
    links = [name for name in robot.links if f"{name}.mass" in learned]
    inertial = ("mass", "mx", "my", "mz", "ixx", "ixy", "iyy", "ixz", "iyz", "izz")
    drives = [[learned[f"{j}.{what}"] for j in robot.actuators] for what in ("rotor_inertia", "viscous", "coulomb", "offset")]
    return np.array([learned[f"{link}.{what}"] for link in links for what in inertial] + [x for part in drives for x in part])


def is_physical(theta, drives):
    """Whether bodies, rotors and friction of these numbers exist."""
    low = min(np.linalg.eigvalsh(pseudo_inertia(theta[10 * k : 10 * k + 10])).min() for k in range(drives))
    return low > -1e-9 and theta[10 * drives : 13 * drives].min() > -1e-9


def pseudo_inertia(x):
    """The same in numbers."""
    m, h = x[0], x[1:4]
    inertia = np.array([[x[4], x[5], x[7]], [x[5], x[6], x[8]], [x[7], x[8], x[9]]])
    return np.block([[0.5 * np.trace(inertia) * np.eye(3) - inertia, h[:, None]], [h[None, :], np.array([[m]])]])


def main(folder, table, rounds):
    robot = pkm.load(folder / "robot.toml")
    model = pin.buildModelFromUrdf(str(next(folder.glob("*.urdf"))))
    assert list(model.names)[1:] == robot.actuators, "one chain, in the same order"
    data = model.createData()
    train, test = recordings(robot)
    nominal = np.concatenate([robot.parameters(), robot.armature, model.damping, model.upperDryFrictionLimit, np.zeros(6)])

    q, v, a, tau, dt = motion(train, robot.actuators)
    room = robot.actuated_regressor(q, v, a)
    other = np.empty_like(room)
    tau_of = lambda y: (y.reshape(-1, y.shape[2]).T @ y.reshape(-1, y.shape[2]), y.reshape(-1, y.shape[2]).T @ tau.ravel())
    (ours, into, written, shared, products, theirs, with_products), (y, _, _, _, sums, y_pin, sums_pin) = best(
        rounds,
        [
            lambda: robot.actuated_regressor(q, v, a),
            lambda: robot.actuated_regressor(q, v, a, out=room),
            lambda: other.fill(1.0),
            lambda: filled_by_all(other),
            lambda: robot.regressor_products(q, v, a, tau),
            lambda: pinocchio_loop(model, data, q, v, a),
            lambda: tau_of(pinocchio_loop(model, data, q, v, a)),
        ],
    )
    apart = np.abs(y - y_pin).max() / np.abs(y_pin).max()
    assert apart < 1e-9, f"regressors differ by {apart}"
    sums_apart = max(np.abs(x - z).max() / np.abs(z).max() for x, z in zip(sums, sums_pin, strict=False))
    assert sums_apart < 1e-9, f"products differ by {sums_apart}"
    out = [
        f"| regressor of {len(q)} samples | time | beside the next row of Pinocchio |",
        "|---|---|---|",
        f"| `pkm`, `robot.actuated_regressor(q, v, a)` | {1e3 * ours:.0f} ms | {theirs / ours:.1f} × as fast |",
        f"| the same with `out=` | {1e3 * into:.0f} ms | {theirs / into:.1f} × as fast |",
        f"| numpy writing one number {room.size:,} times: {room.nbytes / 1e6:.0f} MB, one thread, nothing computed | {1e3 * written:.0f} ms | {theirs / written:.1f} × as fast |",
        f"| the same on every processor at once: nothing that returns this array is faster | {1e3 * shared:.0f} ms | {theirs / shared:.1f} × as fast |",
        f"| Pinocchio, `computeJointTorqueRegressor` in a loop | {1e3 * theirs:.0f} ms | numbers apart: {apart:.0e} |",
        f"| `pkm`, `robot.regressor_products(q, v, a, tau)`, nothing stored | {1e3 * products:.0f} ms | {with_products / products:.1f} × as fast |",
        f"| Pinocchio in a loop, then `W.T @ W` and `W.T @ tau` of numpy | {1e3 * with_products:.0f} ms | numbers apart: {sums_apart:.0e} |",
        "",
    ]
    del y, y_pin

    def prepared(recording):
        q, v, a, tau, dt = motion(recording, robot.actuators)
        return rows(whole(pinocchio_loop(model, data, q, v, a), v, a), tau, dt)

    def by_figaroh(fit):
        q, v, a, tau, dt = motion(train, robot.actuators)
        return fit(*rows(figaroh_columns(model, data, q, v, a), tau, dt))

    physical = lambda w, tau: figaroh_physical(w, tau, nominal, robot.actuators)

    judge = prepared(test)
    estimate = lambda method: lambda: our_theta(pkm.Identification(robot, method=method, band_hz=BAND).fit(train, holdout=test), robot)
    names = ["pkm, `sdp`", "pkm, `wls`", "cvxpy, Clarabel: pseudo-inertias", "scipy, `lstsq`", "figaroh, double QR", "figaroh, `solve_direct_effort_fit`"]
    functions = [estimate("sdp"), estimate("wls"), lambda: semidefinite(*prepared(train), nominal), lambda: weights(*prepared(train))[1]]
    functions += [lambda: by_figaroh(figaroh_estimate), lambda: by_figaroh(physical)]
    times, thetas = best(rounds, functions)
    w, t = prepared(train)
    fitted, _ = best(rounds, [lambda: semidefinite(w, t, nominal), lambda: weights(w, t), lambda: figaroh_estimate(w, t), lambda: physical(w, t)])
    fits = ["", "", *(f"{x:.2f} s" for x in fitted)]
    out += ["| identification | recordings to parameters | of which the fit | can exist | held-out error, by drive, % | pooled, % |", "|---|---|---|---|---|---|"]
    held = {"nominal robot": nominal} | dict(zip(names, thetas, strict=True))
    for name, theta in held.items():
        e = errors(*judge, theta)
        k = names.index(name) if name in names else None
        spent = ["", ""] if k is None else [f"{times[k]:.2f} s", fits[k]]
        can = "yes" if is_physical(theta, len(robot.actuators)) else "no"
        out.append(f"| {name} | {spent[0]} | {spent[1]} | {can} | {', '.join(f'{100 * x:.2f}' for x in e)} | {pooled(e):.3f} |")
    table.write_text("\n".join(out) + "\n")
    print("\n".join(out))
    if pooled(errors(*judge, thetas[0])) > 1.01 * pooled(errors(*judge, thetas[2])):
        sys.exit("the estimate of pkm predicts worse than that of cvxpy")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 3)
