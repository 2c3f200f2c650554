"""Step responses of the screw drive with three masses, from its equations in motor angle and current, by a Runge-Kutta method of order 8.

The equations are those of McDaid's chapter with its misprints corrected, in the chapter's own variables: nothing is shared with the crate,
which carries everything at the rod and steps with a matrix exponential. Run with scipy; prints the constants of
crates/sim/tests/three_mass.rs.

    python tests/golden/three_mass/make_golden.py
"""

import numpy as np
from scipy.integrate import solve_ivp

JM, BM, RM = 2e-5, 4e-4, 0.006
JS, BS, RS = 2e-6, 1e-5, 0.030
GS = 2 * np.pi / 3.175e-3
KB, BB = 6e4, 6.0
MR, BR = 0.6, 200.0
KF, BF = 2e6, 300.0
KT, TAU = 0.05, 1e-3
KA = GS * RS / RM


def rates(t, x, i_c, load, load_velocity):
    """Motor angle, rod, their velocities, current, integral of the force on the load."""
    th_m, x_r, w_m, v_r, i, _ = x
    th_s, w_s = GS * x_r, GS * v_r
    f = KF * (x_r - load(t)) + BF * (v_r - load_velocity)
    a_m = (KT * i + 2 * RM * RS * (BB * w_s + KB * th_s) - (BM + 2 * RM**2 * BB) * w_m - 2 * RM**2 * KB * th_m) / JM
    belt = 2 * GS * RM * RS * (BB * w_m + KB * th_m) - 2 * GS**2 * RS**2 * (BB * v_r + KB * x_r)
    a_r = (belt - (BR + GS**2 * BS) * v_r - f) / (MR + GS**2 * JS)
    return [w_m, v_r, a_m, a_r, (i_c - i) / TAU, f]


def run(force, speed, times):
    """A wanted force stepped on at 0, the load moving evenly from 0."""
    out = solve_ivp(rates, (0, times[-1]), np.zeros(6), "DOP853", times, rtol=1e-13, atol=1e-18,
                    args=(force / (KT * KA), lambda t: speed * t, speed))
    assert out.success
    for t, x in zip(out.t, out.y.T):
        f = KF * (x[1] - speed * t) + BF * (x[3] - speed)
        print(f"    [{t}, {x[0]:.12e}, {x[1]:.12e}, {x[3]:.12e}, {f:.12e}, {x[5]:.12e}],")


for force, speed in [(40.0, 0.0), (0.0, 0.02), (-100.0, 0.01)]:
    print(f"force {force} N, load at {speed} m/s: t, motor angle, rod, rod velocity, force on the load, its integral")
    run(force, speed, [0.001, 0.002, 0.005, 0.01, 0.05, 0.2])
