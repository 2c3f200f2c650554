"""What the tool is for, from Python: hidden friction is found, proven, and the report says so in every form."""

import json
import os
from pathlib import Path

import numpy as np
import pkm
import pytest


def test_hidden_friction_is_found(hidden):
    _, recording, report, _ = hidden
    verdict = report.verdict
    assert verdict["schema"] == "pkm.verdict/1"
    assert verdict["status"] == "ok" and not verdict["nothing_missing"]
    first = report.findings[0]
    assert (first["effect"], first["where"]) == ("friction_coulomb", ["q1"])
    # 26 N stand in the URDF: the finding states the whole of the joint's dry friction.
    assert first["parameters"]["coulomb"]["value"] == pytest.approx(26.0 + 90.0, rel=0.05)
    for told in (first["says"], first["equation"], first["compensation"]["says"]):
        assert "(26.00 N in the robot's file)" in told
    assert "add only what the controller does not do already" in first["compensation"]["says"]
    assert verdict["heldout"]["rms_final"] < 0.5 * verdict["heldout"]["rms_nominal"]
    assert verdict["recordings"][0]["path"] == recording.name


def test_what_is_left_out_is_neither_found_nor_an_alias(hidden):
    robot, recording, report, _ = hidden
    left_out = ["friction_coulomb", "friction_presliding"]
    verdict = pkm.diagnose(robot, recording, without=left_out).verdict
    said = [e["effect"] for f in verdict["findings"] for e in [f, *f["cannot_tell_from"]]]
    assert not set(said) & set(left_out) and "friction_coulomb" in {f["effect"] for f in report.findings}
    assert "friction_coulomb, friction_presliding" in verdict["notes"][0]
    assert not verdict["nothing_missing"]


def test_a_report_reads_as_text(hidden):
    _, _, report, _ = hidden
    text = str(report)
    assert "prs3" in text and "q1" in text and "\x1b" not in text
    assert len(text.splitlines()) > 10
    assert "friction_coulomb at q1" in repr(report) and "\n" not in repr(report)


def test_a_report_is_a_page(hidden):
    _, _, report, _ = hidden
    page = report.html()
    assert page.startswith("<!DOCTYPE html>") and "<svg" in page
    frame = report._repr_html_()
    assert frame.startswith("<iframe srcdoc=") and frame.count('"') == 4


def test_a_saved_report_is_a_verdict_beside_a_robot(hidden, tmp_path):
    _, _, report, _ = hidden
    report.save(tmp_path / "out.json", html=tmp_path / "out.html")
    saved = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert saved.pop("refined_model") == "out.robot.toml"
    verdict = report.verdict
    verdict.pop("refined_model")
    assert saved == verdict
    refined = pkm.load(tmp_path / "out.robot.toml")
    assert refined.joints == report.refined_robot().joints
    assert "<svg" in (tmp_path / "out.html").read_text(encoding="utf-8")
    with pytest.raises(OSError):
        report.save(tmp_path / "no" / "out.json")


def test_a_report_never_takes_the_place_of_its_robot(hidden, tmp_path):
    robot, _, report, _ = hidden
    toml, urdf = robot.texts()
    own = {"out.robot.toml": toml, "out.robot.urdf": urdf, "prs3.urdf": urdf}
    for name, text in own.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"out.robot.toml: would overwrite the robot's own file"):
        report.save(tmp_path / "out.json")
    with pytest.raises(ValueError, match=r"prs3.urdf: would overwrite"):
        report.save(tmp_path / "other.json", html=tmp_path / "prs3.urdf")
    assert {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == own
    # Named as the robot, as one is likely to do: its URDF stays.
    report.save(tmp_path / "prs3.json")
    assert (tmp_path / "prs3.urdf").read_text(encoding="utf-8") == urdf and (tmp_path / "prs3.robot.urdf").exists()


def test_a_copy_confirms_nothing(hidden):
    robot, recording, _, _ = hidden
    copy = pkm.Recording(recording.time, {name: recording[name] for name in recording.signals}, name="copy")
    with pytest.raises(ValueError, match=r"copy: the same samples as .*first"):
        pkm.diagnose(robot, [recording], holdout=[copy])


def test_the_refined_robot_explains_the_recording(hidden):
    robot, recording, report, _ = hidden
    toml, urdf = report.refined("mine.urdf")
    assert 'urdf = "mine.urdf"' in toml and urdf.lstrip().startswith("<")
    again = pkm.diagnose(report.refined_robot(), recording).verdict
    before = pkm.diagnose(robot, recording).verdict
    assert again["heldout"]["rms_nominal"] < 0.5 * before["heldout"]["rms_nominal"]


def test_evidence_is_arrays(hidden):
    robot, _, report, _ = hidden
    evidence = report.evidence
    assert {s["joint"] for s in evidence["joints"]} == set(robot.actuators)
    for series in evidence["joints"]:
        assert series["measured"].shape == series["nominal"].shape == series["refined"].shape == series["time"].shape
        assert series["heldout_spans"].ndim == 2 and series["heldout_spans"].shape[1] == 2
    for finding in evidence["findings"]:
        assert finding["x"].shape == finding["y"].shape == finding["model"].shape == finding["is_heldout"].shape
        assert finding["is_heldout"].dtype == np.bool_
    steps = [step["heldout_rms"] for step in evidence["chain"]]
    assert steps[0] > steps[-1]


def test_progress_is_told(hidden):
    _, _, _, shares = hidden
    assert shares[-1] == 1.0
    assert all(0.0 <= x <= 1.0 for x in shares)


def test_what_progress_raises_comes_back(hidden):
    robot, recording, _, _ = hidden

    def interrupt(_share):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        pkm.diagnose(robot, recording, progress=interrupt)


def test_where_long_series_wait_changes_no_number(hidden, tmp_path):
    robot, recording, _, _ = hidden
    usual, kept, elsewhere = (pkm.diagnose(robot, recording, **how) for how in ({}, {"scratch": None}, {"scratch": tmp_path}))
    assert usual.verdict == kept.verdict == elsewhere.verdict
    for series, other in zip(usual.evidence["joints"], kept.evidence["joints"], strict=True):
        assert all(np.array_equal(series[key], other[key]) for key in ("measured", "nominal", "refined"))
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match=r"scratch = .*nowhere \(must be a folder that is there, or None\)"):
        pkm.diagnose(robot, recording, scratch=tmp_path / "nowhere")


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="files without a name are seen in /proc")
def test_long_recordings_wait_in_the_folder_that_is_given(tmp_path):
    """A recording long enough for its series to leave memory: while it is diagnosed a nameless file of that folder is open."""
    robot = pkm.robots.load("five_bar")
    recording = pkm.simulate(robot, robot, seed=3, duration_s=590.0, rate_hz=1000.0)

    class Seen(Exception):
        """Enough of this diagnosis."""

    def look(_share):
        links = (os.readlink(fd) for fd in Path("/proc/self/fd").iterdir() if fd.is_symlink())
        if any(link.startswith(str(tmp_path)) and "(deleted)" in link for link in links):
            raise Seen

    with pytest.raises(Seen):
        pkm.diagnose(robot, recording, scratch=tmp_path, progress=look)
