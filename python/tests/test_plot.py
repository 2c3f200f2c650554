"""Pictures: what is on the axes are the numbers of the objects, and every axis says what it shows."""

import inspect
from types import SimpleNamespace

import numpy as np
import pkm
import pytest

matplotlib = pytest.importorskip("matplotlib", reason="the package matplotlib is not installed")
matplotlib.use("Agg")

from matplotlib import pyplot  # noqa: E402
from pkm import plot  # noqa: E402


@pytest.fixture(autouse=True)
def closed():
    """Every picture is drawn to the end, which finds what only drawing finds; nothing of it is cut off at its edges; and closed."""
    yield
    for number in pyplot.get_fignums():
        figure = pyplot.figure(number)
        figure.canvas.draw()
        drawn, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
        edges = (drawn.x0, drawn.y0, width - drawn.x1, height - drawn.y1)
        assert min(edges) > -0.02, f"cut off by {edges} inches at left, bottom, right, top"
    pyplot.close("all")


def line(ax, words):
    """x and y of the line whose label begins with these words."""
    [one] = [candidate for candidate in ax.lines if str(candidate.get_label()).startswith(words)]
    return np.asarray(one.get_xdata(), float), np.asarray(one.get_ydata(), float)


def assert_line(ax, words, x, y):
    there_x, there_y = line(ax, words)
    np.testing.assert_array_equal(there_x, x)
    np.testing.assert_array_equal(there_y, y)


def series_of(report, name, recording):
    return next(s for s in report.evidence["joints"] if (s["joint"], s["recording"]) == (name, recording))


def test_joint_and_residual_are_the_evidence(hidden):
    _, _, report, _ = hidden
    series = series_of(report, "q1", "second")
    ax = plot.joint(report, "q1", recording="second")
    for words, key in [("measured", "measured"), ("as given", "nominal"), ("refined", "refined")]:
        assert_line(ax, words, series["time"], series[key])
    assert ax.get_ylabel() == "effort of q1 [N]"
    left = plot.residual(report, "q1", recording="second")
    assert_line(left, "as given", series["time"], series["measured"] - series["nominal"])
    assert_line(left, "refined", series["time"], series["measured"] - series["refined"])
    # The number in the legend is that of the held-out samples, which are shaded.
    [span] = series["heldout_spans"]
    held = (series["time"] >= span[0]) & (series["time"] <= span[1])
    rms = np.sqrt(np.mean((series["measured"] - series["nominal"])[held] ** 2))
    assert series["rms_nominal"] == pytest.approx(rms, rel=0.02)
    assert any(f"as given: {series['rms_nominal']:.3g} N rms" == str(one.get_label()) for one in left.lines)
    [patch] = [p for p in left.patches if p.get_label() == "held out"]
    assert (patch.get_x(), patch.get_x() + patch.get_width()) == pytest.approx(tuple(span))


def test_the_map_of_regimes_is_the_evidence(hidden):
    robot, _, report, _ = hidden
    for which in ("before", "after"):
        ax = plot.regimes(report, which=which)
        values = np.ma.filled(ax.images[0].get_array().astype(float), np.nan)
        joints = [t.get_text() for t in ax.get_yticklabels()]
        regimes = [t.get_text() for t in ax.get_xticklabels()]
        assert sorted(joints) == sorted(robot.actuators)
        for cell in report.evidence["regimes"]:
            drawn = values[joints.index(cell["joint"]), regimes.index(cell["regime"])]
            assert np.isnan(drawn) if cell["share"] == 0 else drawn == cell[which]
        written = {(t.get_position()[1], t.get_position()[0]): t.get_text() for t in ax.texts}
        assert written[(joints.index("q1"), regimes.index("moving"))] == f"{values[joints.index('q1'), regimes.index('moving')]:.2f}"
    # The concealed friction is at q1 and shows when it moves: after, it is gone.
    before, after = ({(c["joint"], c["regime"]): c[w] for c in report.evidence["regimes"]} for w in ("before", "after"))
    assert after["q1", "moving"] < 0.5 * before["q1", "moving"]
    limits = [plot.regimes(report, which=w).images[0].get_clim() for w in ("before", "after")]
    assert limits[0] == limits[1]


def test_isolability_is_the_matrix_of_the_verdict(hidden):
    _, _, report, _ = hidden
    found = report.verdict["isolability"]
    every = [f"{e['effect']} at {' '.join(e['where'])}" for e in found["effects"]]
    cosines = np.abs(found["cosines"])
    for effects in (None, [], ["friction_coulomb", "payload"]):
        ax = plot.isolability(report, effects=effects)
        labels = [t.get_text() for t in ax.get_yticklabels()]
        assert labels == [t.get_text() for t in ax.get_xticklabels()]
        # An effect may be there twice at one place, in two forms: places in the matrix, not labels, tell them apart.
        if effects is None:
            like = cosines[:, every.index("friction_coulomb at q1")]
            at = sorted(np.argsort(-like, kind="stable")[:20])
        else:
            at = [k for k, e in enumerate(found["effects"]) if not effects or e["effect"] in effects]
        assert labels == [every[k] for k in at]
        np.testing.assert_array_equal(ax.images[0].get_array(), cosines[np.ix_(at, at)])
        bold = [t.get_text() for t in ax.get_yticklabels() if t.get_fontweight() == "bold"]
        assert bold == [every[k] for k in at if found["effects"][k]["found"]] == ["friction_coulomb at q1"]
    with pytest.raises(ValueError, match="no effect 'magic'"):
        plot.isolability(report, effects=["magic"])


@pytest.fixture(scope="module")
def unexplained():
    """A 3-PRS with a force that the catalogue has no name for: it follows the battery, which is a column of the recording."""
    robot, runs = pkm.robots.load("prs3"), []
    for seed, name in ((3, "first"), (4, "second")):
        r = pkm.simulate(robot, robot, seed=seed, duration_s=10.0, rate_hz=250.0)
        battery = np.sin(2 * np.pi * (0.23 + 0.05 * seed) * r.time)
        signals = {s: r[s] for s in r.signals} | {"battery": battery}
        signals["tau.q6"] = signals["tau.q6"] + 40.0 * battery**2
        runs.append(pkm.Recording(r.time, signals, name=name))
    return pkm.diagnose(robot, runs[:1], holdout=runs[1:])


def test_dependence_is_the_evidence(unexplained):
    known = unexplained.evidence["dependences"]
    assert known, unexplained
    for data in known:
        ax = plot.dependence(unexplained, data["joint"], data["signal"])
        x, y = ax.lines[0].get_data()
        np.testing.assert_array_equal(x, data["x"])
        np.testing.assert_array_equal(y, data["mean"])
        [[low, high]] = [bars.get_segments() for bars in ax.collections][0][:1]
        np.testing.assert_allclose([low[1], high[1]], [data["mean"][0] - data["error"][0], data["mean"][0] + data["error"][0]])
        assert ax.get_xlabel() == data["signal"] and data["unit"] in ax.get_ylabel()
    with pytest.raises(ValueError, match="no dependence of 'q99' on 'x'"):
        plot.dependence(unexplained, "q99", "x")


def test_dependence_draws_either_direction_of_motion():
    x, unit = [0.0, 0.1, 0.2], {"joint": "q8", "unit": "N", "error": [0.5, 0.5, 0.5]}
    curves = {"forwards": [1.0, 7.0, 2.0], "backwards": [-1.0, -6.0, -2.0]}
    known = [unit | {"signal": f"q.q8 by direction, {way}", "x": x, "mean": mean} for way, mean in curves.items()]
    known.append(unit | {"signal": "q.q8", "x": x, "mean": [0.0, 0.5, 0.0]})
    ax = plot.dependence(SimpleNamespace(evidence={"dependences": known}), "q8", "q.q8 by direction")
    for bars, label in zip(*ax.get_legend_handles_labels(), strict=True):
        np.testing.assert_array_equal(bars.lines[0].get_data(), [x, curves[label]])
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["forwards", "backwards"]
    assert ax.get_xlabel() == "q.q8 by direction"
    # A signal without directions has one curve and needs no legend.
    assert plot.dependence(SimpleNamespace(evidence={"dependences": known}), "q8", "q.q8").get_legend() is None


def test_findings_and_chain_are_the_evidence(hidden):
    _, _, report, _ = hidden
    data = report.evidence["findings"][0]
    ax = plot.finding(report, data["rank"])
    assert_line(ax, "measured, held out", data["x"][data["is_heldout"]], data["y"][data["is_heldout"]])
    assert_line(ax, "friction_coulomb at q1", data["x"], data["model"])
    assert ax.get_xlabel() == data["x_label"] and ax.get_ylabel() == data["y_label"]
    bars = plot.chain(report)
    assert [p.get_width() for p in bars.patches] == [s["heldout_rms"] for s in report.evidence["chain"]]
    for call, told in [
        (lambda: plot.joint(report, "q99"), "no joint 'q99'"),
        (lambda: plot.residual(report, "q1", recording="none"), "no recording 'none'"),
        (lambda: plot.finding(report, 99), "rank 99"),
        (lambda: plot.regimes(report, which="during"), "which = 'during'"),
    ]:
        with pytest.raises(ValueError, match=told):
            call()


def marks(seed=1, n=60):
    """Trials whose chance of being detected rises with size."""
    rng = np.random.default_rng(seed)
    sizes = rng.choice([0.5, 1.0, 2.0, 4.0], n)
    seen = rng.uniform(size=n) < sizes / 5
    return [{"size": float(s), "is_detected": bool(d), "is_in_set": bool(d and s > 1), "is_first_right": bool(d and s > 2)} for s, d in zip(sizes, seen, strict=True)]


def test_detection_curves_are_counted_shares():
    stats = pytest.importorskip("scipy.stats", reason="the package scipy is not installed")
    all_marks = [*marks(), {"size": None, "is_detected": True, "is_in_set": True, "is_first_right": True}]
    ax = plot.detection(all_marks)
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["anything said", "among the names", "first name right"]
    for container, key, shift in zip(ax.containers, ("is_detected", "is_in_set", "is_first_right"), (-1, 0, 1), strict=True):
        points, _, (bars,) = container
        for x, y, segment, size in zip(*points.get_data(), bars.get_segments(), (0.5, 1.0, 2.0, 4.0), strict=True):
            group = [m for m in all_marks if m["size"] == size]
            assert x == pytest.approx(size * 1.04**shift)
            yes = sum(m[key] for m in group)
            assert y == pytest.approx(yes / len(group))
            interval = stats.binomtest(yes, len(group)).proportion_ci(method="wilson")
            np.testing.assert_allclose(segment[:, 1], [interval.low, interval.high], atol=1e-12)
    with pytest.raises(ValueError, match="no trial with a size"):
        plot.detection(all_marks[-1:])
    with pytest.raises(ValueError, match="bins = "):
        plot.detection(all_marks, bins=[1.0, 0.5])


def test_friction_curves_are_the_laws(hidden):
    bare, recording, _, _ = hidden
    robot = bare.with_effect("friction_stribeck", "q1", coulomb=12.0, stiction=21.0, stribeck_velocity=0.01)
    ax = plot.friction({"as given": bare, "true": robot}, "q1", speed=0.1)
    v, tau = line(ax, "true")
    moving = v != 0.0
    assert np.isnan(tau[~moving]).all() and np.abs(v).max() == pytest.approx(0.1)
    # 26 N and 180 N s/m stand in the URDF (robots/prs3/README.md); the peak is docs/FORMATS.md's formula.
    s = np.sign(v[moving])
    urdf = 26.0 * s + 180.0 * v[moving]
    peak = (12.0 + (21.0 - 12.0) * np.exp(-((v[moving] / 0.01) ** 2))) * s
    np.testing.assert_allclose(line(ax, "as given")[1][moving], urdf, rtol=1e-12)
    np.testing.assert_allclose(tau[moving], urdf + peak, rtol=1e-12)
    assert ax.get_xlabel() == "velocity of q1 [m/s]" and ax.get_ylabel() == "effort at q1 [N]"
    # As in the pictures of a report: before orange, after blue.
    colours = {found.get_label(): found.get_color() for found in ax.lines}
    assert (colours["as given"], colours["true"]) == ("#d55e00", "#0072b2")
    # Behind it, a recording of a robot with 90 N more: that is how far its points lie outside.
    ax = plot.friction(bare, "q1", recording=recording)
    x, y = line(ax, "measured")
    dots = next(found for found in ax.get_legend().get_lines() if found.get_linestyle() == "None")
    assert dots.get_markersize() >= 6.0 and dots.get_alpha() == 1.0
    fast = np.abs(x) > 0.3 * np.abs(x).max()
    assert np.median((y - bare.joint_effort("q1", x))[fast] * np.sign(x[fast])) == pytest.approx(90.0, rel=0.1)
    with pytest.raises(ValueError, match="no joint 'q99'"):
        plot.friction(bare, "q99")
    with pytest.raises(ValueError, match="not driven"):
        plot.friction(bare, "q7", recording=recording)


def test_workspaces_are_coloured_by_their_singular_values():
    robot = pkm.robots.load("five_bar")
    axes = {"x": np.linspace(-0.3, 0.3, 13), "y": np.linspace(0.1, 0.5, 9)}
    found = robot.workspace(axes)
    assert 10 < found["reachable"].sum() < found["reachable"].size
    for which in ("parallel", "serial", "condition"):
        ax = plot.workspace(found, axes, which=which)
        mesh = ax.collections[0]
        drawn = np.ma.filled(mesh.get_array().astype(float), np.nan).reshape(9, 13).T
        np.testing.assert_array_equal(drawn, np.where(found["reachable"], found[which], np.nan))
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [m]", "y [m]")
        # A cell is where its pose is: the colours' corners lie around the values of the axes.
        corners = mesh.get_coordinates()
        assert corners[0, 0, 0] < axes["x"][0] < corners[0, 1, 0] and corners[0, 0, 1] < axes["y"][0] < corners[1, 0, 1]
    with pytest.raises(ValueError, match="must be two, alike"):
        plot.workspace(found, {"x": axes["x"], "y": axes["x"]})


def test_a_workspace_over_drives_has_the_units_of_the_drives():
    for name, unit in (("five_bar", "rad"), ("prs3", "m")):
        robot = pkm.robots.load(name)
        drives = robot.actuators[:2]
        middle = robot.assemble()[[robot.joints.index(drive) for drive in drives]]
        step = 1e-3 * np.arange(-1, 2)
        axes = dict(zip(drives, middle[:, None] + step, strict=True))
        found = robot.workspace(axes)
        ax = plot.workspace(found, axes, robot=robot)
        assert (ax.get_xlabel(), ax.get_ylabel()) == tuple(f"{drive} [{unit}]" for drive in drives)
        # Whose drives these are cannot be known from the numbers.
        assert plot.workspace(found, axes).get_xlabel() == f"{drives[0]} [m or rad]"
        with pytest.raises(ValueError, match=f"no drive '{drives[0]}' in the robot"):
            plot.workspace(found, axes, robot=pkm.robots.load("serial_arm"))


def test_bounds_of_mu_are_drawn_as_computed():
    a, b, c, d = [[-0.1, 1.0], [-1.0, -0.1]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]
    found = pkm.mu((a, b, c, d), [{"kind": "complex"}])
    ax = plot.mu(found)
    order = np.argsort(found.frequencies)
    shown = order[found.frequencies[order] > 0]
    assert_line(ax, "upper", found.frequencies[shown], found.uppers[shown])
    assert_line(ax, "lower", found.frequencies[shown], found.lowers[shown])
    assert (line(ax, "proved")[1] == found.upper).all()
    # One complex scalar: mu is the size of the response, by its formula.
    w = found.frequencies[shown]
    np.testing.assert_allclose(line(ax, "upper")[1], np.abs(1.0 / ((1j * w + 0.1) ** 2 + 1.0)), rtol=1e-3)
    with pytest.raises(ValueError, match="bounds of a matrix"):
        plot.mu(pkm.mu(np.eye(2), [{"kind": "complex"}] * 2))


def test_bode_is_size_and_phase():
    w = np.geomspace(0.1, 100.0, 50)
    top, bottom = plot.bode({"lag": (w, 1.0 / (1.0 + 1j * w)), "two": (w, 1.0 / (1.0 + 1j * w) ** 3)})
    # A first-order lag by its formulas: 10 log10 (1 + w^2), atan w.
    np.testing.assert_allclose(line(top, "lag")[1], -10.0 * np.log10(1.0 + w**2), atol=1e-12)
    np.testing.assert_allclose(bottom.lines[0].get_ydata(), -np.rad2deg(np.arctan(w)), atol=1e-9)
    np.testing.assert_allclose(bottom.lines[1].get_ydata(), -3 * np.rad2deg(np.arctan(w)), atol=1e-9)
    assert top.get_xscale() == bottom.get_xscale() == "log"
    # Who brings axes brings both.
    brought = tuple(pyplot.subplots(2, 1, layout="constrained")[1])
    assert plot.bode({"lag": (w, 1.0 / (1.0 + 1j * w))}, axes=brought) == brought
    with pytest.raises(ValueError, match="response 'x'"):
        plot.bode({"x": (w, w[:3])})


def test_tracking_shows_reference_measured_and_error():
    time = np.arange(100) / 100.0
    force, wanted = 20.0 + np.sin(9 * time), np.full(100, 20.0)
    force[5] = np.nan
    recording = pkm.Recording(time, {"wrench.foot.fz": force, "fz_ref": wanted}, name="press")
    ax = plot.tracking(recording, "wrench.foot.fz", "fz_ref", unit="N")
    assert_line(ax, "wrench.foot.fz", time, force)
    assert_line(ax, "fz_ref", time, wanted)
    [right] = [other for other in ax.figure.axes if other is not ax]
    assert_line(right, "error", time, wanted - force)
    rms = np.sqrt(np.nanmean((wanted - force) ** 2))
    assert f"error: {rms:.3g} N rms" in ax.get_legend().get_texts()[-1].get_text()
    assert right.get_ylabel() == "error [N]"
    with pytest.raises(KeyError, match="no signal"):
        plot.tracking(recording, "wrench.foot.fz", "nothing")


def test_what_is_said_of_axes_holds_for_every_picture():
    def taken(name):
        # Without a default, the axes are those of the workspace.
        parameters = inspect.signature(getattr(plot, name)).parameters.values()
        return [p.name for p in parameters if p.name in ("ax", "axes") and p.default is None]

    assert {name: taken(name) for name in plot.__all__} == {name: ["axes"] if name == "bode" else ["ax"] for name in plot.__all__}
    assert "draws into `ax`" in plot.__doc__ and "`bode` alone draws into two, takes them as `axes` and returns both" in plot.__doc__


def test_pictures_go_where_they_are_told(hidden):
    _, _, report, _ = hidden
    # Who brings axes brings their layout.
    figure, (left, right) = pyplot.subplots(1, 2, layout="constrained")
    assert plot.residual(report, "q1", ax=left) is left and plot.regimes(report, ax=right) is right
    assert left.figure is figure
