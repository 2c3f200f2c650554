"""Designs by SciPy, for tests/design.rs: sampled systems, regulators, poles, Lyapunov equations.

    python tests/golden/scipy/make_golden.py        writes tests/golden/scipy/design.json

Matrices have four decimals, so that the file holds what was computed with.
"""

import json
import pathlib

import numpy
import scipy
from scipy import linalg, signal

SEED = 7


def rows(matrix):
    return [[float(x) for x in row] for row in numpy.atleast_2d(matrix)]


def drawn(random, *shape):
    return numpy.round(random.standard_normal(shape), 4)


def sampled(random):
    """Continuous systems, some of them stiff, under both rules."""
    for n, m, p, dt, stiff in [(2, 1, 1, 0.1, 1.0), (4, 2, 3, 0.05, 1.0), (6, 3, 2, 0.01, 200.0), (1, 1, 1, 1.0, 30.0)]:
        a, b, c, d = stiff * drawn(random, n, n) - 3.0 * stiff * numpy.eye(n), drawn(random, n, m), drawn(random, p, n), drawn(random, p, m)
        case = {"dt": dt, "a": rows(a), "b": rows(b), "c": rows(c), "d": rows(d)}
        for name, method in [("zoh", "zoh"), ("tustin", "bilinear")]:
            ad, bd, cd, dd, _ = signal.cont2discrete((a, b, c, d), dt, method)
            case[name] = [rows(ad), rows(bd), rows(cd), rows(dd)]
        yield case


def regulators(random):
    for n, m in [(2, 1), (4, 2), (6, 2), (8, 3)]:
        a, b, root, r = drawn(random, n, n), drawn(random, n, m), drawn(random, n, n), numpy.diag(numpy.round(random.uniform(0.1, 3.0, m), 4))
        q = root @ root.T
        x = linalg.solve_discrete_are(a, b, q, r)
        k = numpy.linalg.solve(r + b.T @ x @ b, b.T @ x @ a)
        y = linalg.solve_continuous_are(a, b, q, r)
        yield {
            "a": rows(a), "b": rows(b), "q": rows(q), "r": rows(r),
            "discrete": {"cost": rows(x), "gain": rows(k)},
            "continuous": {"cost": rows(y), "gain": rows(numpy.linalg.solve(r, b.T @ y))},
        }


def placed(random):
    """With one input the gain is unique; with several only the poles are, and the conditioning of the eigenvectors says how good it is."""
    wanted = [
        (3, 1, [-1.0, -2.0 + 1.0j, -2.0 - 1.0j]),
        (5, 1, [-1.0, -1.5, -3.0, -2.0 + 2.0j, -2.0 - 2.0j]),
        (4, 2, [-1.0, -2.0, -3.0, -4.0]),
        (6, 3, [-1.0, -1.0, -2.0 + 1.0j, -2.0 - 1.0j, -5.0 + 3.0j, -5.0 - 3.0j]),
        (6, 2, [0.1, 0.2, 0.5 + 0.2j, 0.5 - 0.2j, 0.3, 0.4]),
    ]
    for n, m, poles in wanted:
        a, b = drawn(random, n, n), drawn(random, n, m)
        found = signal.place_poles(a, b, numpy.array(poles))
        condition = numpy.linalg.norm(found.X) * numpy.linalg.norm(numpy.linalg.inv(found.X))
        yield {
            "a": rows(a), "b": rows(b), "poles": [[complex(p).real, complex(p).imag] for p in poles],
            "gain": rows(found.gain_matrix), "gain_norm": float(numpy.linalg.norm(found.gain_matrix)), "condition": float(condition),
        }


def lyapunov(random):
    for n, radius in [(2, 0.9), (5, 0.999), (6, 0.5), (3, 1.7)]:
        a, root = drawn(random, n, n), drawn(random, n, n)
        a = numpy.round(a * radius / max(abs(numpy.linalg.eigvals(a))), 4)
        q = root @ root.T
        yield {"a": rows(a), "q": rows(q), "x": rows(linalg.solve_discrete_lyapunov(a, q))}


def main():
    random = numpy.random.default_rng(SEED)
    golden = {
        "made_by": f"make_golden.py with SciPy {scipy.__version__}, NumPy {numpy.__version__}, seed {SEED}",
        "sampled": list(sampled(random)),
        "regulators": list(regulators(random)),
        "placed": list(placed(random)),
        "lyapunov": list(lyapunov(random)),
    }
    pathlib.Path(__file__).with_name("design.json").write_text(json.dumps(golden, indent=1) + "\n")


if __name__ == "__main__":
    main()
