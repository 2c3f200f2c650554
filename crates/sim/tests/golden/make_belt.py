"""Closed form of a block that a spring pulls at constant speed over a floor with two friction levels; writes belt.json.

With x the spring's stretch, a slip starts at k·x = static with the block at rest and ends when it is at rest again:
x'' = -w²·(x - kinetic/k), x(0) = static/k, x'(0) = pull. Run with Python 3 and scipy 1.
"""

import json
import pathlib

import numpy as np
from scipy.integrate import solve_ivp

MASS, STIFFNESS, PULL, STATIC, KINETIC = 2.0, 800.0, 0.05, 12.0, 7.0


def main():
    w = np.sqrt(STIFFNESS / MASS)
    over = (STATIC - KINETIC) / STIFFNESS
    # The block is at rest when the stretch grows at the speed of the pull again.
    slip = 2.0 * (np.pi - np.arctan2(over * w, PULL)) / w
    stick = 2.0 * over / PULL

    def rate(_, x):
        return [PULL - x[1], (STIFFNESS * x[0] - KINETIC) / MASS]

    def rest(t, x):
        return x[1] if t > 1e-4 else 1.0

    rest.terminal, rest.direction = True, -1
    run = solve_ivp(rate, (0.0, 1.0), [STATIC / STIFFNESS, 0.0], events=rest, rtol=1e-13, atol=1e-15, method="DOP853")
    assert abs(run.t_events[0][0] - slip) < 1e-10, (run.t_events, slip)
    distance = PULL * (slip + stick)
    out = {"mass": MASS, "stiffness": STIFFNESS, "pull": PULL, "static": STATIC, "kinetic": KINETIC}
    out |= {"slip_s": slip, "stick_s": stick, "period_s": slip + stick, "slip_m": distance}
    pathlib.Path(__file__).with_name("belt.json").write_text(json.dumps(out, indent=1) + "\n")
    print(out)


if __name__ == "__main__":
    main()
