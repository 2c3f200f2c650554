"""Trajectory of the ankle robot of [Arceo2021] as a differential-algebraic system with multipliers, by scipy; writes motobotte.json.

Nothing of pkm is used: masses, geometry and friction are the paper's (fitted l3 and gamma1), the equations its (2) and (3) with the
corrected M13 and M23. Run with Python 3, numpy 2 and scipy 1.
"""

import json
import pathlib

import numpy as np
import scipy
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

L1, L2, L3, L4, L5 = 0.35, 0.125, 0.4646, 0.1014, 0.15
GAMMA1 = np.radians(132.0)
M1, M2, M3 = 6.1514, 2.1398, 2.8684
FRICTION = ((56.3869, -2.8211), (-9.3843, -0.6755), (-0.0841, 0.0440))


def arms(t1, t2):
    return L2 * np.cos(t1) + L3 * np.sin(t1), L4 * np.cos(t2), L3 * np.cos(t1) - L2 * np.sin(t1), -L4 * np.sin(t2)


def gap(q):
    z1, z2, z3, z4 = arms(q[1], q[2])
    return np.array([q[0] + L1 - z3 - z4 + L5 * np.sin(GAMMA1), z1 + z2 + L5 * np.cos(GAMMA1)])


def accelerations(q, v, push, has_friction):
    z1, z2, z3, z4 = arms(q[1], q[2])
    mass = np.array([
        [M1 + M2 + M3, (M2 + M3) * z1, M3 * z2],
        [(M2 + M3) * z1, (M2 + M3) * (L2**2 + L3**2), M3 * (z1 * z2 + z3 * z4)],
        [M3 * z2, M3 * (z1 * z2 + z3 * z4), M3 * L4**2],
    ])
    coriolis = np.array([
        (M2 + M3) * z3 * v[1] ** 2 + M3 * z4 * v[2] ** 2,
        M3 * (z1 * z4 - z2 * z3) * v[2] ** 2,
        M3 * (z2 * z3 - z1 * z4) * v[1] ** 2,
    ])
    friction = np.array([a * x**2 + b * x for (a, b), x in zip(FRICTION, v)]) if has_friction else np.zeros(3)
    jacobian = np.array([[1, z1, z2], [0, z3, z4]])
    drift = np.array([z3 * v[1] ** 2 + z4 * v[2] ** 2, -z1 * v[1] ** 2 - z2 * v[2] ** 2])
    system = np.block([[mass, -jacobian.T], [jacobian, np.zeros((2, 2))]])
    right = np.concatenate([np.array([push, 0, 0]) - coriolis - friction, -drift])
    return np.linalg.solve(system, right)[:3]


def closed(d, near):
    rest = fsolve(lambda x: gap([d, *x]), near, xtol=1e-15)
    for _ in range(3):
        z1, z2, z3, z4 = arms(*rest)
        rest = rest - np.linalg.solve(np.array([[z1, z2], [z3, z4]]), gap([d, *rest]))
    return np.array([d, *rest])


def main():
    start = closed(0.0747226294, [0.0752798005, -2.1944531247])
    z1, z2, z3, z4 = arms(start[1], start[2])
    rates = np.linalg.solve(np.array([[z1, z2], [z3, z4]]), [-0.03, 0.0])
    velocity = np.array([0.03, *rates])
    out = {"scipy": scipy.__version__, "numpy": np.__version__, "push": "2·sin(5·t) N", "start": start.tolist(), "runs": []}
    out["acceleration"] = accelerations(start, velocity, 0.0627 * 5.0, True)[0]
    for has_friction in (False, True):

        def rate(t, x):
            return np.concatenate([x[3:], accelerations(x[:3], x[3:], 2.0 * np.sin(5.0 * t), has_friction)])

        times = np.linspace(0.0, 1.5, 16)
        first = np.concatenate([start, np.zeros(3)])
        run = solve_ivp(rate, (0.0, times[-1]), first, method="DOP853", rtol=3e-14, atol=1e-15, t_eval=times)
        gaps = max(np.abs(gap(x)).max() for x in run.y[:3].T)
        assert run.success and gaps < 1e-11, gaps
        out["runs"].append({"has_friction": has_friction, "time": times.tolist(), "q": run.y[:3].T.tolist(), "v": run.y[3:].T.tolist()})
    pathlib.Path(__file__).with_name("motobotte.json").write_text(json.dumps(out, indent=1) + "\n")
    print(out["acceleration"], [run["q"][-1] for run in out["runs"]])


if __name__ == "__main__":
    main()
