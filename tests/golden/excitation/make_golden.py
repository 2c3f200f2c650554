"""Condition numbers of an exported observation matrix by numpy.

From the root of the workspace:
    cargo run -q -p pkm-ident --example observation > tests/golden/excitation/observation.csv
    python tests/golden/excitation/make_golden.py
"""

import json
from pathlib import Path

import numpy as np

here = Path(__file__).parent
w = np.loadtxt(here / "observation.csv", delimiter=",", skiprows=1)
unit = w / np.linalg.norm(w, axis=0)
golden = {
    "numpy": np.__version__,
    "shape": list(w.shape),
    "condition": float(np.linalg.cond(unit)),
    "condition_raw": float(np.linalg.cond(w)),
    "log_determinant": float(np.linalg.slogdet(w.T @ w / w.shape[0])[1]),
}
(here / "golden.json").write_text(json.dumps(golden, indent=2) + "\n")
