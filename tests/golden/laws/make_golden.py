"""Numbers that the tests of crates/sim/src/laws/ compare with. Printed, and copied there by hand.

Made with Python 3, numpy and scipy:  python make_golden.py
"""

import numpy as np
import scipy
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import ellipk, lambertw

print("numpy", np.__version__, "scipy", scipy.__version__)

# LuGre [CanudasDeWit1995], v = 2e-3 sin(20 t): lugre.rs
stiffness, damping, viscous, coulomb, stiction, v_s = 1e5, 316.0, 0.4, 1.0, 1.5, 1e-3


def velocity(t):
    return 2e-3 * np.sin(20 * t)


def rate(t, z):
    v = velocity(t)
    g = coulomb + (stiction - coulomb) * np.exp(-((v / v_s) ** 2))
    return v - stiffness * abs(v) / g * z


times = [0.1, 0.3, 0.55, 0.9]
solution = solve_ivp(rate, (0, 1), [0.0], method="Radau", rtol=1e-11, atol=1e-18, t_eval=times, max_step=1e-3)
for t, z in zip(times, solution.y[0]):
    print("LUGRE", t, stiffness * z + damping * rate(t, z) + viscous * velocity(t))

# Period of a mass on a hardening spring: hardening_elasticity.rs
k, c, inertia, amplitude = 400.0, 4e6, 0.5, 0.01
stiff = k + c * amplitude**2
print("DUFFING", 4 * ellipk(c * amplitude**2 / (2 * stiff)) / np.sqrt(stiff / inertia))

# Two temperatures under constant heat: two_temperatures.rs
gear, motor, inward, outward = 30.0, 50.0, 0.5, 1.0
heat = np.array([100.0 * 0.3**2, 0.01 * 20.0**2])
A = np.array([[-(1 / inward + 1 / outward) / gear, 1 / inward / gear], [1 / inward / motor, -1 / inward / motor]])
b = heat / np.array([gear, motor])
print("WARMTH", np.linalg.solve(A, (expm(A * 20.0) - np.eye(2)) @ b))
print("BALANCE", 20 * lambertw(9 / 20).real)
