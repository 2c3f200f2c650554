"""Numbers of scipy that pkm-ident is compared with: filters, differentiation, minimisers, tails of distributions.

    python make_scipy.py        # rewrites scipy.json beside this file

Needs numpy and scipy.
"""

import json
from pathlib import Path

import numpy as np
import scipy
from scipy import interpolate, optimize, signal, special, stats

rng = np.random.default_rng(20240607)
dt = 0.004
t = dt * np.arange(400)
x = np.sin(3.1 * t) + 0.4 * np.cos(9.7 * t + 0.3) + 0.02 * rng.standard_normal(t.size)

# Zero-phase Butterworth of order four, padded as pkm pads: three periods of the cut-off, odd.
cutoff = 12.0
pad = max(int(3 / (cutoff * 2 * dt)), 12)
filtered = signal.sosfiltfilt(signal.butter(4, cutoff * 2 * dt, output="sos"), x, padtype="odd", padlen=pad)

savgol = [signal.savgol_filter(x, 21, 4, deriv=d, delta=dt, mode="interp") for d in range(3)]

# Quintic least-squares spline with uniform knots, as many as pkm's rounding gives.
spacing = 0.05
span = dt * (t.size - 1)
parts = round(span / spacing)
knots = np.concatenate([np.zeros(5), np.linspace(0, span, parts + 1), np.full(5, span)])
lsq = interpolate.make_lsq_spline(t, x, knots, k=5)
spline = [lsq.derivative(d)(t) if d else lsq(t) for d in range(3)]

# Two problems of Moré, Garbow and Hillstrom (1981) by MINPACK, one of them with a bound.
bard_y = np.array([0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39])


def bard(p):
    u = np.arange(1, 16)
    v = 16 - u
    return bard_y - (p[0] + u / (v * p[1] + np.minimum(u, v) * p[2]))


osborne_y = np.array(
    [0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718, 0.685, 0.658, 0.628, 0.603, 0.580, 0.558, 0.538]
    + [0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448, 0.438, 0.431, 0.424, 0.420, 0.414, 0.411, 0.406]
)


def osborne(p):
    s = 10.0 * np.arange(33)
    return osborne_y - (p[0] + p[1] * np.exp(-s * p[3]) + p[2] * np.exp(-s * p[4]))


tight = dict(xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=20000)
b = optimize.least_squares(bard, [1, 1, 1], method="lm", **tight)
o = optimize.least_squares(osborne, [0.5, 1.5, -1, 0.01, 0.02], method="lm", x_scale=[0.5, 1.5, 1, 0.01, 0.02], **tight)
bounded = optimize.least_squares(bard, [0, 1, 1], bounds=([-1, -np.inf, -np.inf], [0.05, np.inf, np.inf]), **tight)


def wood(p):
    a, b_, c, d = p
    return (
        100 * (b_ - a * a) ** 2 + (1 - a) ** 2 + 90 * (d - c * c) ** 2 + (1 - c) ** 2
        + 10.1 * ((b_ - 1) ** 2 + (d - 1) ** 2) + 19.8 * (b_ - 1) * (d - 1)
    )


nm = optimize.minimize(wood, [-3, -1, -3, -1], method="Nelder-Mead", options=dict(xatol=1e-9, fatol=1e-13, maxfev=20000, maxiter=20000))

out = {
    "scipy": scipy.__version__,
    "dt": dt,
    "x": x.tolist(),
    "cutoff_hz": cutoff,
    "filtered": filtered.tolist(),
    "savgol_half": 10,
    "savgol_order": 4,
    "savgol": [y.tolist() for y in savgol],
    "spline_spacing": spacing,
    "spline": [y.tolist() for y in spline],
    "bard": {"y": bard_y.tolist(), "x": b.x.tolist(), "square": float(2 * b.cost)},
    "bard_bounded": {"x": bounded.x.tolist(), "square": float(2 * bounded.cost)},
    "osborne": {"y": osborne_y.tolist(), "x": o.x.tolist(), "square": float(2 * o.cost)},
    "wood": {"x": nm.x.tolist(), "cost": float(nm.fun)},
    "ln_gamma": [[v, float(special.gammaln(v))] for v in (0.3, 1.7, 12.3, 500.0)],
    "chi_square": [[v, m, float(stats.chi2.sf(v, m))] for v, m in ((0.5, 1), (3.84, 1), (18.3, 10), (2.0, 10), (400.0, 300), (90.0, 7))],
    "f": [[v, m, n, float(stats.f.sf(v, m, n))] for v, m, n in ((1.0, 3, 20), (4.2, 2, 50), (0.3, 8, 900), (2.1, 22, 4000), (30.0, 1, 5))],
    "normal": [[z, float(2 * stats.norm.sf(abs(z)))] for z in (0.1, -1.96, 3.5, 6.0)],
}
Path(__file__).with_name("scipy.json").write_text(json.dumps(out) + "\n")
