"""Structured singular value: known numbers, systems, and what is refused."""

import numpy as np
import pkm
import pytest

REAL, COMPLEX = {"kind": "real"}, {"kind": "complex"}


def test_skogestad_postlethwaite_example_8_5():
    matrix = [[2, 2], [-1, -1]]
    full = pkm.mu(matrix, [{"kind": "full", "rows": 2, "cols": 2}])
    assert full.upper == pytest.approx(10**0.5, rel=1e-6)
    assert full.lower == pytest.approx(10**0.5, rel=1e-6)
    diagonal = pkm.mu(matrix, [COMPLEX, COMPLEX])
    assert diagonal.upper == pytest.approx(3, rel=1e-6)
    assert diagonal.lower <= diagonal.upper
    delta = np.diag(diagonal.worst)
    assert abs(np.linalg.det(np.eye(2) - matrix @ delta)) < 1e-9
    assert pkm.mu(matrix, [COMPLEX, COMPLEX], bounds="upper").worst is None


def test_de_gaston_safonov_over_all_frequencies():
    a = [[0, 0, -800, 6400], [1, -4, 0, 0], [0, 1, -6, 0], [0, 0, 1, -10]]
    b = [[80, 0, 0], [0, -0.2, 0], [0, 0, -0.3], [0, 0, 0]]
    c = [[0, 0, -1, 8], [0, 1, 0, 0], [0, 0, 1, 0]]
    bounds = pkm.mu((a, b, c, np.zeros((3, 3))), [REAL] * 3, slack=1e-6)
    assert 1 / bounds.upper <= 3.41739554 < 1 / bounds.lower + 1e-6
    assert 1 / bounds.upper > 3.4173
    assert bounds.guaranteed == (0.0, np.inf)
    assert bounds.w == pytest.approx(8.2282, abs=1e-4)
    assert np.sign(bounds.worst).tolist() == [1, -1, -1]
    assert np.all(np.diff(bounds.frequencies) > 0)
    assert np.all(bounds.lowers <= bounds.uppers * (1 + 1e-12))
    assert "guaranteed on [0, inf]" in repr(bounds)


def test_a_discrete_system_ends_at_half_the_sample_rate():
    bounds = pkm.mu(([[0.5]], [[1.0]], [[1.0]], [[0.0]]), [COMPLEX], dt=0.1)
    assert bounds.upper == pytest.approx(2, rel=1e-3)
    assert bounds.guaranteed == pytest.approx((0, np.pi / 0.1))


@pytest.mark.parametrize(
    ("system", "blocks", "options", "words"),
    [
        ([[1, 2], [3, 4]], [REAL], {}, "2 x 2 (must be 1 x 1)"),
        ([[np.nan]], [REAL], {}, "(must be finite)"),
        ([[1]], [], {}, "no block"),
        ([[1]], [{"kind": "reel"}], {}, 'blocks[0]: kind "reel"'),
        ([[1]], [{"kind": "full", "repeats": 2}], {}, '"repeats" is not known'),
        ([[1]], [{"kind": "real", "repeats": 0}], {}, "repeats = 0"),
        ([[1]], [REAL], {"dt": 0.1}, "not for a matrix"),
        ([[1]], [REAL], {"bounds": "lower"}, '"both" or "upper"'),
        (([[1]], [[1]], [[1]]), [REAL], {}, "3 parts"),
        (([[-1]], [[1]], [[1]], [[0]]), [REAL], {"dt": -1}, "sample time: -1 s"),
        (([[-1]], [[1]], [[1]], [[0]]), [REAL], {"frequencies": (2, 1)}, "lower < upper"),
        (([[0]], [[1]], [[1]], [[0]]), [REAL], {}, "pole at 0 rad/s"),
    ],
)
def test_what_is_refused(system, blocks, options, words):
    with pytest.raises(ValueError, match="^[^\n]*$") as error:
        pkm.mu(system, blocks, **options)
    assert words in str(error.value)
