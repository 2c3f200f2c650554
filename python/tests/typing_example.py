"""Every name of the package as a user's typed program meets it; checked by mypy, never run."""

from pathlib import Path
from typing import assert_type

import numpy
import pkm
from numpy.typing import ArrayLike, NDArray
from pkm import fleet

robot = pkm.robots.load(pkm.robots.names()[0])
assert_type(robot, pkm.Robot)
names: list[str] = robot.joints + robot.actuators + robot.passive + robot.links + [robot.name]
counts: int = robot.nv + robot.n_act + robot.mobility

q = numpy.zeros((10, robot.n_act))
assert_type(robot.inverse_dynamics(q, q, q.tolist()), NDArray[numpy.float64])
assert_type(robot.actuated_regressor(q, q, q) @ robot.parameters(), NDArray[numpy.float64])
q_tree, v_tree, a_tree = robot.closed_loop_motion(q, q, q)
tau: NDArray[numpy.float64] = robot.rnea(q_tree, v_tree, a_tree)
wide: NDArray[numpy.float64] = robot.joint_torque_regressor(q_tree, v_tree, a_tree)
start: NDArray[numpy.float64] = robot.assemble() + robot.armature

columns: NDArray[numpy.float64] = robot.energy_regressors(q_tree, v_tree)[0] + robot.frame_motion("platform", q_tree, v_tree, a_tree)[1]
strains: NDArray[numpy.float64] = robot.internal_efforts([robot.mid_pose()]) + robot.joint_wrenches(q, q, q)

exported: str = robot.to_mjcf() + robot.to_gepetto()[0]

truth = robot.with_effect("friction_coulomb", "q1", coulomb=12.0)
coulomb: float = truth.effects[0]["parameters"]["coulomb"]
required: bool = pkm.effects()[0]["parameters"][0]["default"] is None

recording = pkm.simulate(truth, pkm.load("robot.toml"), seed=1, duration_s=5.0, rate_hz=250.0)
signal: NDArray[numpy.float64] = recording["q.q1"] + recording.time
pkm.write(Path("a.mcap"), pkm.Recording(recording.time, {"q.q1": recording["q.q1"]}, name="a"))

estimate = pkm.Identification(robot, method="wls", band_hz=8.0, hold=["offset"]).fit([recording], holdout=recording)
assert_type(estimate, pkm.Identification)
spread: NDArray[numpy.float64] = estimate.theta_base_ / numpy.sqrt(numpy.diag(estimate.covariance_))
better: pkm.Robot = estimate.robot_
words: list[str] = [estimate.status_, *estimate.notes_, *estimate.names_, *estimate.names_base_]

report = pkm.diagnose(robot, [pkm.read("a.csv")], holdout=recording, band_hz=8.0, without=["spring"], seed=1, progress=print)
assert_type(report, pkm.Report)
text: str = str(report) + report.html() + report.findings[0]["says"]
after: float = report.verdict["heldout"]["rms_final"]
series: pkm.evidence.JointSeries = report.evidence["joints"][0]
verdict: pkm.verdict.Verdict = report.verdict
report.save("out.json", html=Path("out.html"))
toml, urdf = report.refined("refined.urdf")
assert_type(report.refined_robot(), pkm.Robot)
pkm.plot.joint(report, "q1").set_title("q1")
pkm.plot.finding(report, 1)
pkm.plot.chain(report)
pkm.plot.residual(report, "q1", recording="first")
pkm.plot.regimes(report, which="after")
pkm.plot.dependence(report, "q1", "temp.q1")
pkm.plot.isolability(report, effects=["payload"])
pkm.plot.friction({"as given": robot, "refined": better}, "q1", recording=recording, speed=0.1)
axes: dict[str, ArrayLike] = {"x": numpy.linspace(0.0, 1.0, 5), "y": [0.0, 0.5]}
pkm.plot.workspace(robot.workspace(axes), axes, which="serial", robot=robot)
pkm.plot.mu(pkm.mu(numpy.eye(2), [{"kind": "full", "rows": 2, "cols": 2}]))
top, bottom = pkm.plot.bode({"one": (numpy.ones(3), numpy.ones(3) + 0j)})
pkm.plot.tracking(recording, "q.q1", "q_ref.q1", unit="m", ax=bottom)
pkm.plot.detection(pkm.prove.results("proof/results.json"))

effort: NDArray[numpy.float64] = robot.joint_effort("q1", [0.1, 0.2], q=0.1, load=3.0)
unit: str | None = robot.unit("tau.q1")
assert_type(pkm.Robot.from_texts(*robot.texts()), pkm.Robot)
estimate.fit(recording, progress=True).get_params()
followed = pkm.simulate(robot, robot, reference=recording, progress=lambda share: None)
assert_type(pkm.Recording.from_pandas(followed.to_pandas(robot)), pkm.Recording)
assert_type(pkm.Recording.from_xarray(followed.to_xarray()), pkm.Recording)
rows = pkm.reproduce(pkm.papers()[0])["rows"]
misses: list[str] = [row["what"] for row in rows if row["verdict"] == "MISSED"]
marks: list[pkm.prove.Marks] = pkm.prove.trials("proof", cases=3, seed=2, levels=["L1"])
alarms: float = pkm.prove.count(marks)["false_alarms"].share

plant = pkm.Plant(robot, q[0], kind="reduced")
assert_type(plant.step(q[0], 1e-3), tuple[NDArray[numpy.float64], NDArray[numpy.float64]])
rows_of_q: NDArray[numpy.float64] = plant.run(q, 1e-3)[0] + plant.q

controller = pkm.Controller.from_text(robot, 'law = "pd_gravity"', name="mine.toml")
assert_type(controller.run(q_meas=q), NDArray[numpy.float64])

work = fleet.find("memory://robots")
assert_type(work, list[fleet.Task])
verdicts = fleet.diagnose([*work, fleet.Task(robot, (recording,), unit="one")], "t.parquet", settings={"band_hz": 8.0}, workers=2)
changes = fleet.compare(verdicts, "one", since="2026-03-01")
moved: list[str] = changes[changes["what"] == "moved"]["quantity"].tolist()
