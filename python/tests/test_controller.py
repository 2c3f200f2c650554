"""Controllers from files: direct formulas, arrays against single steps, health, and what is refused."""

from pathlib import Path

import numpy as np
import pkm
import pytest

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "controllers"

PD = 'law = "pd_gravity"\nrate_hz = 1000\nkp = [1e4, 2e4, 3e4]\nkd = 200\nfilter_s = 0\n'


@pytest.fixture
def prs3():
    return pkm.robots.load("prs3")


def written(tmp_path, text):
    path = tmp_path / "controller.toml"
    path.write_text(text)
    return path


def test_a_pd_is_its_formula(tmp_path, prs3):
    controller = pkm.Controller(prs3, written(tmp_path, PD))
    assert (controller.law, controller.rate_hz, controller.joints) == ("pd_gravity", 1000.0, ["q1", "q6", "q8"])
    rng = np.random.default_rng(1)
    n = 50
    q_meas = 0.15 + 1e-4 * np.cumsum(rng.standard_normal((n, 3)), axis=0)
    q_ref, v_ref = q_meas + 1e-3, 0.01 * rng.standard_normal((n, 3))
    tau_ff = 300 + rng.standard_normal((n, 3))
    v_hat = np.vstack([np.zeros(3), np.diff(q_meas, axis=0) * 1000])
    wanted = tau_ff + np.array([1e4, 2e4, 3e4]) * (q_ref - q_meas) + 200 * (v_ref - v_hat)
    assert np.abs(wanted).max() < 1500
    tau = controller.run(q_meas=q_meas, q_ref=q_ref, v_ref=v_ref, tau_ff=tau_ff)
    np.testing.assert_allclose(tau, wanted, rtol=1e-12)
    controller.reset()
    steps = [controller.step(q_meas=q_meas[i], q_ref=q_ref[i], v_ref=v_ref[i], tau_ff=tau_ff[i]) for i in range(n)]
    np.testing.assert_array_equal(steps, tau)
    assert controller.health == {"is_faulted": False, "is_saturated": False, "acted": [], "fault": None}


def test_computed_torque_at_rest_is_inverse_dynamics(tmp_path, prs3):
    text = 'law = "computed_torque"\nrate_hz = 1000\nbandwidth = 30\n[friction]\ncompensate = "none"\n'
    controller = pkm.Controller(prs3, written(tmp_path, text))
    q, a = np.array([0.15, 0.16, 0.14]), np.array([0.3, -0.2, 0.1])
    tau = controller.step(q_meas=q, a_ref=a)
    wanted = prs3.inverse_dynamics(q[None], np.zeros((1, 3)), a[None])[0]
    np.testing.assert_allclose(tau, wanted, rtol=1e-9)


def test_limits_and_faults_are_told(tmp_path, prs3):
    controller = pkm.Controller(prs3, written(tmp_path, PD + "[limits]\nq_upper = 0.2\ntau_limit = 100\n"))
    still = {"q_meas": [0.15] * 3, "tau_ff": [50.0] * 3}
    tau = controller.step(**still, q_ref=[0.15, 0.25, 0.15])
    assert tau.tolist() == [50.0, 100.0, 50.0]
    assert controller.health["acted"] == [{"limit": "Position", "where": "q6"}]
    assert controller.health["is_saturated"]
    tau = controller.step(**{**still, "q_meas": [0.15, 0.15, 0.3]})
    fault = controller.health["fault"]
    assert (fault["code"], fault["number"], fault["where"], fault["value"]) == ("Position", 8, "q8", 0.3)
    assert fault["limit"] == pytest.approx(0.21)
    # It latches, and carries the weight.
    assert controller.step(**still).tolist() == [50.0] * 3
    assert controller.health["is_faulted"]
    controller.reset()
    controller.step(**still)
    assert not controller.health["is_faulted"]
    controller.step(q_meas=[np.nan, 0.15, 0.15])
    assert controller.health["fault"]["code"] == "PositionNotFinite"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('law = "pid"\nrate_hz = 0\n', "controller.toml:2: rate_hz = 0 (must be 1 to 1e5 Hz)"),
        ('law = "pid"\nrate_hz = 100\n', "gains are missing"),
        ("law = 3\n", "rate_hz is missing"),
    ],
)
def test_wrong_files_are_refused(tmp_path, prs3, text, part):
    with pytest.raises(ValueError, match=".") as told:
        pkm.Controller(prs3, written(tmp_path, text))
    assert part in str(told.value)
    assert "\n" not in str(told.value)


def test_wrong_calls_are_refused(tmp_path, prs3):
    with pytest.raises(FileNotFoundError):
        pkm.Controller(prs3, tmp_path / "none.toml")
    controller = pkm.Controller(prs3, written(tmp_path, PD))
    with pytest.raises(ValueError, match="q_meas has shape"):
        controller.step(q_meas=[0.1, 0.2])
    with pytest.raises(ValueError, match="q_ref has 2 samples, q_meas has 3"):
        controller.run(q_meas=np.full((3, 3), 0.15), q_ref=np.full((2, 3), 0.15))
    with pytest.raises(ValueError, match=r"wrench_meas has shape \(3, 3\), must be \(n_samples, 6\)"):
        controller.run(q_meas=np.full((3, 3), 0.15), wrench_meas=np.zeros((3, 3)))


def test_wrenches_reach_a_controller_of_forces(prs3):
    """Row by row as in single steps; a measured force drives the robot away from where it would be without."""
    controller = pkm.Controller(prs3, EXAMPLES / "hybrid.toml")
    rng = np.random.default_rng(2)
    n = 200
    q = np.tile(prs3.mid_pose(), (n, 1))
    felt = np.zeros((n, 6))
    felt[:, 2] = 50.0 * np.sin(np.linspace(0, 3, n)) + rng.standard_normal(n)
    wanted = np.zeros((n, 6))
    wanted[:, 2] = 5.0
    tau = controller.run(q_meas=q, wrench_meas=felt, wrench_ref=wanted)
    controller.reset()
    steps = [controller.step(q_meas=q[i], wrench_meas=felt[i], wrench_ref=wanted[i]) for i in range(n)]
    np.testing.assert_array_equal(tau, steps)
    assert not controller.health["is_faulted"]
    controller.reset()
    assert np.abs(controller.run(q_meas=q) - tau).max() > 1.0
