"""Papers done again and motions followed, from Python."""

import numpy as np
import pkm
import pytest


def test_a_simulated_robot_follows_the_reference_it_is_given():
    robot = pkm.robots.load("five_bar")
    time = np.arange(401) / 200.0
    wanted = {j: 0.1 * np.sin(3.0 * time + k) ** 2 - 0.1 * np.sin(k) ** 2 for k, j in enumerate(robot.actuators)}
    given = pkm.Recording(time, {f"q_ref.{j}": x for j, x in wanted.items()}, name="wave")
    run = pkm.simulate(robot, robot, reference=given, rate_hz=200.0)
    assert run.duration == pytest.approx(2.0) and len(run) == len(given)
    for j, x in wanted.items():
        np.testing.assert_allclose(run[f"q_ref.{j}"], x, atol=1e-9)
        # The controller knows the weight only: it follows, and not exactly.
        assert 0.0 < np.abs(run[f"q.{j}"] - x).max() < 0.05
    # A recording without references is followed along its positions.
    again = pkm.simulate(robot, robot, reference=pkm.Recording(time, {f"q.{j}": x for j, x in wanted.items()}), rate_hz=200.0)
    np.testing.assert_array_equal(again[f"q_ref.{robot.actuators[0]}"], run[f"q_ref.{robot.actuators[0]}"])


def test_references_that_cannot_be_followed_are_refused():
    robot = pkm.robots.load("five_bar")
    first, second = robot.actuators
    with pytest.raises(ValueError, match=f"no q_ref.{second} and no q.{second}"):
        pkm.simulate(robot, robot, reference=pkm.Recording([0.0, 1.0], {f"q.{first}": [0.0, 0.0]}, name="half"))
    far = {f"q.{j}": np.linspace(0.0, 2.0, 200) for j in robot.actuators}
    with pytest.raises(ValueError, match=first) as error:
        pkm.simulate(robot, robot, reference=pkm.Recording(np.arange(200) / 50.0, far, name="far"))
    assert "\n" not in str(error.value)


def test_every_row_of_a_paper_follows_from_its_gate():
    assert pkm.papers() == ["valera2017", "armas", "arceo2021", "mcdaid"]
    shares = []
    done = pkm.reproduce("arceo2021", progress=shares.append)
    assert "motoBOTTE" in done["title"] and done["rows"] and shares[-1] == 1.0
    for row in done["rows"]:
        is_met = {
            "within": lambda r: abs(r["ours"] - r["target"]) <= r["limit"],
            "at most": lambda r: r["ours"] <= r["limit"],
            "at least": lambda r: r["ours"] >= r["limit"],
            "told": lambda r: np.isfinite(r["ours"]),
        }[row["gate"]](row)
        assert row["verdict"] != "reproduced" or is_met, row
        assert row["verdict"] in ("reproduced", "MISSED") or row["why"], row
        assert row["verdict"] != "MISSED", row
    for picture in done["plots"]:
        assert picture["x_label"] and picture["y_label"] and 1 <= len(picture["lines"]) <= 3
        assert all(line["x"].shape == line["y"].shape and len(line["x"]) for line in picture["lines"])
    with pytest.raises(ValueError, match='no paper "newton1687" '):
        pkm.reproduce("newton1687")
