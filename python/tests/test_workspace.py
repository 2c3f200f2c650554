"""Singularities and workspace of the five-bar against its closed forms, through numpy."""

import numpy as np
import pkm
import pytest
from motions import driven


def five_bar(x, y):
    """dq/dx of the shipped five-bar with its elbows outside, from the numbers of its README and nothing of the library."""
    rows, distal = [], []
    for base, side in [(-0.15, 1.0), (0.15, -1.0)]:
        along = np.array([x - base, y])
        d = np.hypot(*along)
        a = (0.25**2 - 0.35**2 + d**2) / (2 * d)
        if abs(a) > 0.25:
            return None
        elbow = along * a / d + side * np.sqrt(0.25**2 - a**2) / d * np.array([-along[1], along[0]])
        e = (along - elbow) / 0.35
        rows.append(e / np.dot(e, [-elbow[1], elbow[0]]))
        distal.append(e)
    return np.array(rows), distal[0][0] * distal[1][1] - distal[0][1] * distal[1][0]


def test_singular_values_are_numpys():
    robot = pkm.robots.load("five_bar")
    q = robot.assemble()[driven(robot)] + 0.1 * np.array([[0, 0], [1, 0], [1, -1], [-2, 3], [3, 3]])
    got = robot.singularities(q)
    assert got["coordinates"] == ["x", "y"]
    assert got["loosest_motion"].shape == (5, 4) and got["loosest_output"].shape == (5, 2)
    zero = np.zeros_like(q)
    tree, _, _ = robot.closed_loop_motion(q, zero, zero)
    for k in range(5):
        first = 2.007128639793479 + tree[k, 0]
        second = first - 1.255300645817396 + tree[k, 1]
        pin = -0.15 + 0.25 * np.exp(1j * first) + 0.35 * np.exp(1j * second)
        values = np.linalg.svd(five_bar(pin.real, pin.imag)[0])[1]
        assert got["parallel"][k] == pytest.approx(values[1], rel=1e-9)
        assert got["serial"][k] == pytest.approx(1 / values[0], rel=1e-9)
        assert got["condition"][k] == pytest.approx(values[0] / values[1], rel=1e-9)


def test_the_scan_is_the_closed_form():
    robot = pkm.robots.load("five_bar")
    x, y = np.linspace(-0.2, 0.2, 9), np.linspace(0.3, 0.6, 13)
    scan = robot.workspace({"x": x, "y": y})
    assert scan["causes"][0] == "reachable"
    assert scan["reachable"].shape == (9, 13) and scan["reachable"].any() and not scan["reachable"].all()
    np.testing.assert_array_equal(scan["reachable"], scan["cause"] == 0)
    assert set(scan["home"]) == {"x", "y"}
    assert scan["home"]["y"] == pytest.approx(0.4656, abs=1e-4)
    seen = 0
    for i in range(9):
        for k in range(13):
            form = five_bar(x[i], y[k])
            if np.isnan(scan["parallel"][i, k]):
                continue
            values = np.linalg.svd(form[0])[1]
            assert scan["parallel"][i, k] == pytest.approx(values[1], rel=1e-7)
            seen += 1
    assert seen > 60


def test_limits_cut_the_workspace():
    robot = pkm.robots.load("ups3_rpu1")
    axes = {"ry": np.linspace(-0.4, 0.6, 11), "rz": np.linspace(-0.6, 0.2, 9), "z": [0.68, 0.7]}
    free = robot.workspace(axes)
    assert free["reachable"].shape == (11, 9, 2)
    cut = robot.workspace(axes, cone_deg=15.0)
    assert cut["reachable"].sum() < free["reachable"].sum()
    assert not (cut["reachable"] & ~free["reachable"]).any()
    assert (cut["cause"] == cut["causes"].index("cone limit")).any()
    far = robot.workspace(axes, singularity_limit=0.9 * np.nanmax(free["parallel"]))
    assert (far["cause"] == far["causes"].index("near a singularity")).any()


@pytest.mark.parametrize(
    ("axes", "keywords", "part"),
    [
        ({"w": [0.0]}, {}, "is no coordinate"),
        ({"x": []}, {}, "one or more finite values"),
        ({"x": [np.nan]}, {}, "one or more finite values"),
        ({"y": [0.0]}, {}, "follows from the other coordinates"),
        ({"x": [0.0]}, {"link": "nose"}, "no such link"),
        ({"x": [0.0]}, {"length": -1.0}, "must be finite and > 0"),
        ({}, {}, "from one to three"),
    ],
)
def test_bad_questions_are_refused(axes, keywords, part):
    robot = pkm.robots.load("ups3_rpu1")
    with pytest.raises(ValueError, match=part) as caught:
        robot.workspace(axes, **keywords)
    assert "\n" not in str(caught.value)
