"""What is refused is refused with the right type, in one line, with the numbers."""

import numpy as np
import pkm
import pytest
from motions import driven, motion_about


def refused(kind, call, *words):
    with pytest.raises(kind) as error:
        call()
    assert type(error.value) is kind
    text = str(error.value)
    assert "\n" not in text
    for word in words:
        assert word in text, text


@pytest.fixture
def prs3():
    return pkm.robots.load("prs3")


@pytest.fixture
def motion(prs3):
    return motion_about(prs3.assemble()[driven(prs3)])


def test_wrong_shapes(prs3, motion):
    q, v, a = motion
    refused(ValueError, lambda: prs3.inverse_dynamics(q[0], v, a), "q has shape (3,)", "(n_samples, 3)")
    refused(ValueError, lambda: prs3.inverse_dynamics(q, v[:, :2], a), "v has shape (200, 2)", "(n_samples, 3)")
    refused(ValueError, lambda: prs3.actuated_regressor(q, v, a[:7]), "a has 7 samples, q has 200")
    refused(ValueError, lambda: prs3.rnea(q, v, a), "(200, 3)", "(n_samples, 9)", "robot.joints")
    refused(ValueError, lambda: prs3.inverse_dynamics(np.zeros((2, 3, 4)), v, a), "(2, 3, 4)")
    single = np.zeros(prs3.actuated_regressor(q, v, a).shape, dtype=np.float32)
    refused(ValueError, lambda: prs3.actuated_regressor(q, v, a, out=single), "out must be an array of numpy, float64")


def test_numbers_that_are_none(prs3, motion):
    q, v, a = motion
    v[3, 1] = np.nan
    refused(ValueError, lambda: prs3.inverse_dynamics(q, v, a), "v[3, 1] = NaN")
    with pytest.raises((TypeError, ValueError)):
        prs3.inverse_dynamics([["a", "b", "c"]], v, a)


def test_loops_that_do_not_close(prs3, motion):
    q, v, a = motion
    q[5:, 0] += 3.0
    refused(ValueError, lambda: prs3.inverse_dynamics(q, v, a), "sample 5", "open")


def test_files_of_robots(tmp_path):
    bad = tmp_path / "robot.toml"
    refused(FileNotFoundError, lambda: pkm.load(bad), "robot.toml")
    bad.write_text('name = "x"\nurdf = "x.urdf"\nwheels = 4\n')
    refused(ValueError, lambda: pkm.load(bad), "robot.toml", "line 3", "wheels")
    bad.write_text('name = "x"\nurdf = "x.urdf"\n')
    refused(FileNotFoundError, lambda: pkm.load(bad), "x.urdf")
    (tmp_path / "x.urdf").write_text("<robot")
    refused(ValueError, lambda: pkm.load(str(bad)), "x.urdf")
    (tmp_path / "x.urdf").write_text('<robot name="x">\n<link name="a"><inertial><mass value="1,4"/></inertial></link></robot>')
    refused(ValueError, lambda: pkm.load(str(bad)), "x.urdf: line 2: <mass>: value", "no comma")
    refused(FileNotFoundError, lambda: pkm.load("prs3"), "pkm.robots.load(\"prs3\")")
    refused(ValueError, lambda: pkm.robots.load("hexapod"), "hexapod", "prs3")


def test_files_of_recordings(tmp_path):
    refused(FileNotFoundError, lambda: pkm.read(tmp_path / "a.csv"), "a.csv")
    refused(ValueError, lambda: pkm.read(tmp_path / "a.xls"), ".csv, .mcap")
    (tmp_path / "a.csv").write_text("t,q.q1\n0.0,1\n0.1,abc\n")
    refused(ValueError, lambda: pkm.read(tmp_path / "a.csv"), "line 3, column q.q1", "abc")
    (tmp_path / "a.mcap").write_bytes(b"not an mcap file")
    refused(ValueError, lambda: pkm.read(tmp_path / "a.mcap"), "not an MCAP file")
    recording = pkm.Recording([0.0, 1.0], {"q.q1": [1.0, 2.0]})
    refused(OSError, lambda: pkm.write(tmp_path / "no" / "a.csv", recording), "a.csv")


def test_recordings_from_arrays():
    refused(ValueError, lambda: pkm.Recording([0.0, 1.0, 1.0], {}), "time[2] = 1 s", "before it: 1 s")
    refused(ValueError, lambda: pkm.Recording([[0.0]], {}), "time has shape (1, 1)")
    refused(ValueError, lambda: pkm.Recording([0.0, 1.0], {"q.q1": [1.0]}), '"q.q1"', "(1,)", "(2,)")
    refused(ValueError, lambda: pkm.Recording([0.0], {"q.q1": [np.inf]}), '"q.q1"', "sample 0 is infinite")
    refused(ValueError, lambda: pkm.Recording([0.0], {}, meta={"tau": "guessed"}), "guessed", "commanded")
    refused(ValueError, lambda: pkm.Recording([0.0], {}, meta={"load": {"mass": 1.0}}), "load", "link")
    refused(KeyError, lambda: pkm.Recording([0.0], {"q.q1": [1.0]})["q.q2"], "q.q2", "q.q1")


def test_effects_that_cannot_be(prs3):
    refused(ValueError, lambda: prs3.with_effect("friction_magic", "q1"), "friction_magic")
    refused(ValueError, lambda: prs3.with_effect("friction_coulomb", "q99", coulomb=1.0), "q99", "a joint")
    refused(ValueError, lambda: prs3.with_effect("friction_coulomb", "q1"), "coulomb", "missing")
    refused(ValueError, lambda: prs3.with_effect("friction_coulomb", "q1", coulomb=-1.0), "-1", ">= 0")
    refused(ValueError, lambda: prs3.with_effect("friction_coulomb", "q1", coulomb=1.0, colour=2.0), "colour")


def test_scenarios_and_diagnoses_that_cannot_be(prs3):
    refused(ValueError, lambda: pkm.simulate(prs3, prs3, duration_s=-1.0), "duration_s = -1")
    refused(ValueError, lambda: pkm.simulate(prs3, pkm.robots.load("five_bar")), "differ in their joints")
    refused(ValueError, lambda: pkm.diagnose(prs3, []), "no recording")
    short = pkm.Recording([0.0, 1.0], {"q.q1": [1.0, 2.0]}, name="short")
    refused(ValueError, lambda: pkm.diagnose(prs3, short), "short")
    refused(ValueError, lambda: pkm.diagnose(prs3, short, floor=2.0), "floor = 2")
    refused(ValueError, lambda: pkm.diagnose(prs3, short, without=["grease"]), '"grease"')
    refused(TypeError, lambda: pkm.diagnose(prs3, "a.csv"), "recordings holds str", "Recording")
    refused(TypeError, lambda: pkm.diagnose(prs3, short, holdout=[short, 3]), "holdout holds int")
    with pytest.raises(TypeError):
        pkm.Robot()


def test_an_unnamed_recording_is_called_something_and_its_columns_are_told():
    recording = pkm.Recording(np.arange(500) / 100.0, {"pos_q1": np.zeros(500)})
    with pytest.raises(ValueError, match=r'^recording: no column "q.q1" \(required .*; columns: pos_q1\)$'):
        pkm.diagnose(pkm.robots.load("prs3"), recording)


def test_a_name_alone_is_a_list_of_one(prs3):
    for given in ("offset", ["offset"]):
        assert pkm.Identification(prs3, hold=given).get_params()["hold"] == ["offset"]
    assert pkm.Identification(prs3).get_params()["hold"] == []
    refused(ValueError, lambda: pkm.Identification(prs3, hold="gravity"), "hold names \"gravity\"")
    made = pkm.simulate(prs3, prs3, seed=1, duration_s=2.0)
    refused(ValueError, lambda: pkm.diagnose(prs3, made, without="warp"), "warp")
