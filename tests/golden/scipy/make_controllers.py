"""Writes controllers.json: references of the motoBOTTE along its drive, and step responses of linear ADRC as transfer functions.

Python 3, numpy and scipy; versions are in the file. Run: python make_controllers.py > controllers.json
"""

import json
import platform

import numpy as np
import scipy
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter, ss2tf

# Arceo2021, Table 1, with l3 and gamma1 as the printed initial states need them (robots/motobotte/README.md).
L1, L2, L3, L4, L5, G1, G2 = 0.35, 0.125, 0.4646, 0.1014, 0.15, np.radians(132.0), 2.0952


def drive(phi):
    """Piston position of an ankle angle: equation (4) without its misprints."""
    delta = phi + G2 - np.pi / 2
    a1 = L2 * np.cos(delta) + L3 * np.sin(delta) + L4
    a2 = L2 * np.sin(delta) - L3 * np.cos(delta)
    t2 = np.arcsin(-L5 * np.cos(G1) / np.hypot(a1, a2)) - np.arctan2(a1, -a2)
    t1 = delta + t2
    z3, z4 = L3 * np.cos(t1) - L2 * np.sin(t1), -L4 * np.sin(t2)
    return -L1 + z3 + z4 - L5 * np.sin(G1)


def gait(t):
    """Periodic cubic spline through Table 3; the printed polynomial leaves it after 1.75 s."""
    knots = [0, 0.36, 1.96, 2.48, 3.56, 4.0]
    values = [1.6179, 1.5874, 1.863, 1.45, 1.6895, 1.6179]
    return CubicSpline(knots, values, bc_type="periodic")(t % 4)


def isokinetic(t):
    """Equation (12), repeated every 7.5 s."""
    t = t % 7.5
    pieces = [t < 0.75, t < 2.25, t < 3.75, t < 4.5]
    values = [np.pi * (7 - 2 * t) / 9, 0 * t + 11 * np.pi / 18, np.pi * (31 - 4 * t) / 36, 0 * t + 4 * np.pi / 9]
    return np.select(pieces, values, np.pi * (2 * t - 1) / 18)


def ladrc(wc, wo, b0, b, dt, n):
    """Step response of linear ADRC on y'' = b·u, both as transfer functions: nothing here is a recursion of the observer's state."""
    a_d, b_d, *_ = cont2discrete((np.array([[0, 1, 0], [0, 0, 1], [0, 0, 0.0]]), np.array([[0], [b0], [0.0]]), np.eye(3), np.zeros((3, 1))), dt)
    p = np.exp(-wo * dt)
    gain = np.array([[1 - p**3], [1.5 * (1 - p) ** 2 * (1 + p) / dt], [(1 - p) ** 3 / dt**2]])
    c = np.array([[1.0, 0, 0]])
    left = np.eye(3) - gain @ c
    # x[k] = left·(A·x[k−1] + B·u[k−1]) + gain·y[k], u = (wc²·(r − x1) − 2·wc·x2 − x3)/b0.
    k = np.array([[wc**2, 2 * wc, 1.0]]) / b0
    # With u eliminated, x[k] = F·x[k−1] + left·B·(wc²/b0)·r[k−1] + gain·y[k]: transfer functions from r and y to u.
    f = left @ (a_d - b_d @ k)
    num_y, den = ss2tf(f, gain, -k @ f, -k @ gain)
    g_r = left @ b_d * (wc**2 / b0)
    num_r, _ = ss2tf(f, g_r, -k, np.array([[wc**2 / b0]]))
    plant_num, plant_den = np.array([0, b * dt**2 / 2, b * dt**2 / 2]), np.array([1.0, -2, 1])
    closed = np.polysub(np.polymul(den, plant_den), np.polymul(num_y[0], plant_num))
    response = np.polymul(num_r[0], plant_num)
    numerator = np.concatenate([np.zeros(len(closed) - len(response)), response])
    y = lfilter(numerator, closed, np.ones(n))
    return {"bandwidth": wc, "observer": wo, "b0": b0, "b": b, "dt": dt, "y": y.tolist()}


def main():
    t = np.arange(0, 7.5 - 1e-9, 0.01)
    print(json.dumps({
        "made_with": f"numpy {np.__version__}, scipy {scipy.__version__}, python {platform.python_version()}",
        "dt": 0.01,
        "gait": drive(gait(t[:400])).tolist(),
        "isokinetic": drive(isokinetic(t)).tolist(),
        "ladrc": [ladrc(4.0, 20.0, 1.0, 1.0, 0.01, 200), ladrc(6.0, 25.0, 2.0, 2.6, 0.005, 300), ladrc(3.0, 30.0, 0.5, 0.4, 0.02, 150)],
    }))


main()
