"""What changed on a robot: against scipy's tests, and how often nothing is taken for something."""

import datetime

import numpy as np
import pytest

pytest.importorskip("pandas", reason="the package pandas is not installed")
pytest.importorskip("pyarrow", reason="the package pyarrow is not installed")
stats = pytest.importorskip("scipy.stats", reason="the package scipy is not installed")

from pkm import fleet  # noqa: E402

Z = stats.norm.ppf(0.975)


def row(unit, taken, values, sd, *, rms=0.1, status="ok", kind="identify"):
    """A row as a worker would have made it; quantities with 95 % intervals of normal numbers."""
    spread = {name: sd.get(name, 0.1) if isinstance(sd, dict) else sd for name in values}
    quantities = [
        {"name": n, "value": float(v), "lower": float(v - Z * spread[n]), "upper": float(v + Z * spread[n]), "unit": "N"} for n, v in values.items()
    ]
    return {
        "key": f"{unit}{taken}{sorted(values.items())}{rms}",
        "unit": unit,
        "taken": taken,
        "kind": kind,
        "status": status,
        "rms_nominal": rms,
        "recordings": [f"{unit}/{taken}/A.csv"],
        "quantities": quantities,
    }


def table(rows):
    return fleet._table.frame(rows)


def of(changes, name):
    return changes[changes["quantity"] == name].iloc[0]


def test_intervals_alone_are_a_z_test():
    rows = table([row("r7", "2026-02-01", {"a": 1.0}, 0.1), row("r7", "2026-03-01", {"a": 1.5}, 0.2)])
    found = of(fleet.compare(rows, "r7", since="2026-03-01"), "a")
    assert (found["before"], found["after"]) == (1.0, 1.5)
    assert found["sd"] == pytest.approx(np.hypot(0.1, 0.2))
    assert found["p_value"] == pytest.approx(2 * stats.norm.sf(0.5 / np.hypot(0.1, 0.2)))
    assert found["what"] == "moved" and (found["n_before"], found["n_after"]) == (1, 1)


def test_rows_that_scatter_are_welchs_test():
    rng = np.random.default_rng(7)
    x, y = rng.normal(10.0, 1.0, 6), rng.normal(11.0, 2.0, 9)
    rows = [row("r7", f"2026-02-{k + 1:02}", {"a": v}, 1e-6) for k, v in enumerate(x)]
    rows += [row("r7", f"2026-03-{k + 1:02}", {"a": v}, 1e-6) for k, v in enumerate(y)]
    found = of(fleet.compare(table(rows), "r7", since="2026-03-01"), "a")
    expected = stats.ttest_ind(y, x, equal_var=False)
    assert found["p_value"] == pytest.approx(expected.pvalue, rel=1e-9)
    # The error over effort has no interval: what it shows itself is all there is.
    assert of(fleet.compare(table(rows), "r7", since="2026-03-01"), fleet._compare.ERROR)["p_value"] == 1.0


def test_several_quantities_are_corrected_by_holm():
    values = {"a": 0.30, "b": 0.26, "c": 0.05}
    rows = table([row("r7", "2026-02-01", dict.fromkeys(values, 0.0), 0.0), row("r7", "2026-03-01", values, 0.1)])
    changes = fleet.compare(rows, "r7", since="2026-03-01")
    p = np.array([2 * stats.norm.sf(v / 0.1) for v in values.values()])
    # Holm by hand: 3 p(1), then 2 p(2), then p(3), never falling.
    expected = np.maximum.accumulate(np.minimum(1.0, [3 * p[0], 2 * p[1], p[2]]))
    assert [of(changes, n)["p_holm"] for n in values] == pytest.approx(expected)
    assert [of(changes, n)["what"] for n in values] == ["moved", "moved", "same"]
    assert list(changes["quantity"][:2]) == ["a", "b"]


def test_nothing_is_rarely_taken_for_something():
    rng = np.random.default_rng(11)
    names, n = [f"p{k}" for k in range(8)], 100
    alarms = 0
    for _ in range(n):
        rows = []
        for day in ("2026-02-01", "2026-02-02", "2026-03-01", "2026-03-02"):
            rows.append(row("r7", day, {name: rng.normal(5.0, 0.3) for name in names}, 0.3))
        changes = fleet.compare(table(rows), "r7", since="2026-03-01")
        alarms += bool((changes[changes["quantity"] != fleet._compare.ERROR]["what"] == "moved").any())
    # A family-wise level of 5 %, and three standard deviations of counting.
    assert alarms / n < 0.05 + 3 * np.sqrt(0.05 * 0.95 / n)


def test_findings_appear_and_go():
    rows = table([row("r7", "2026-02-01", {"old": 1.0, "both": 2.0}, 0.1), row("r7", "2026-03-01", {"new": 1.0, "both": 2.0}, 0.1)])
    changes = fleet.compare(rows, "r7", since="2026-03-01")
    assert {q: of(changes, q)["what"] for q in ("old", "new", "both")} == {"old": "gone", "new": "appeared", "both": "same"}
    assert of(changes, fleet._compare.ERROR)["what"] == "unknown"


def test_robots_and_spans_are_compared():
    rows = [row("r3", "2026-03-01", {"a": 1.0}, 0.1), row("r7", "2026-03-01", {"a": 2.0}, 0.1)]
    rows += [row("r7", "2026-03-09T10:00:00", {"a": 3.0}, 0.1), row("r7", "2026-03-20", {"a": 9.0}, 0.1), row("r7", "", {"a": 99.0}, 0.1)]
    rows.append(row("r7", "2026-03-02", {"a": 50.0}, 0.1, status="unusable"))
    assert of(fleet.compare(table(rows[:2]), "r7", against="r3"), "a")["change"] == pytest.approx(1.0)
    spans = {"before": ("2026-03-01", "2026-03-08"), "after": ("2026-03-09", "2026-03-09")}
    found = of(fleet.compare(table(rows), "r7", **spans), "a")
    assert (found["before"], found["after"]) == (2.0, 3.0)
    by_week = fleet.weeks(table(rows), "r7")
    # ISO weeks by the calendar: 1 March 2026 is a Sunday, the 9th a Monday, the 20th a Friday.
    assert list(by_week[by_week["quantity"] == "a"]["week"]) == ["2026-W11", "2026-W12"]
    assert list(by_week[by_week["quantity"] == "a"]["change"]) == pytest.approx([1.0, 6.0])
    long = fleet.history(table(rows), "r7")
    assert sorted(long[long["quantity"] == "a"]["value"]) == [2.0, 3.0, 9.0, 99.0]


def test_a_recording_counts_once():
    """What another build, robot file or settings made of the same bytes is no second measurement."""
    days = {"2026-02-01": 1.0, "2026-02-02": 1.1, "2026-03-01": 1.3, "2026-03-02": 1.4}
    once = [{**row("r7", day, {"a": v}, 0.1), "recordings_sha256": [day], "finished": stamp(9)} for day, v in days.items()]
    # Made before, by an engine that was wrong, and after, where nothing came of it.
    before = [{**row("r7", day, {"a": 5.0}, 0.1), "recordings_sha256": [day], "finished": stamp(8)} for day in days]
    after = [{**row("r7", day, {}, 0.1, status="error", rms=7.0), "recordings_sha256": [day], "finished": stamp(10)} for day in days]
    rows, only = table([*before, *once, *after]), table(once)
    for ask in (lambda t: fleet.compare(t, "r7", since="2026-03-01"), lambda t: fleet.weeks(t, "r7")):
        assert ask(rows).equals(ask(only))
    assert of(fleet.compare(rows, "r7", since="2026-03-01"), "a")["n_before"] == 2
    # The history is all there is.
    assert len(fleet.history(rows, "r7").query("quantity == 'a'")) == 8
    # Nor is what the other kind of work says of the model as given.
    judged = [{**r, "kind": "diagnose", "key": r["key"] + "d", "quantities": []} for r in once]
    both = fleet.compare(table([*once, *judged]), "r7", since="2026-03-01")
    errors = both[both["quantity"].str.startswith(fleet._compare.ERROR)]
    assert len(errors) == 2 and set(errors["n_before"]) == {2}


def stamp(hour):
    return datetime.datetime(2026, 4, 1, hour, tzinfo=datetime.timezone.utc)


def test_bad_questions_are_refused(tmp_path):
    rows = table([row("r7", "2026-02-01", {"a": 1.0}, 0.1)])
    for wrong, told in [
        ({}, "one of since"),
        ({"since": "2026-03-01", "against": "r3"}, "one of since"),
        ({"before": ("2026-01-01", "2026-02-01")}, "one of since"),
        ({"since": "March"}, "'March' is no day"),
        ({"since": "2026-03-01"}, "unit 'r7': no usable rows after (usable: 2026-02-01)"),
        ({"against": "r3"}, "no unit 'r3' in the table (has: r7)"),
        ({"since": "2026-01-01", "level": 2.0}, "level = 2.0"),
    ]:
        with pytest.raises(ValueError) as error:
            fleet.compare(rows, "r7", **wrong)
        assert told in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(ValueError, match=r"usable rows of 1 weeks \(two are needed; usable: 2026-02-01\)"):
        fleet.weeks(rows, "r7")


def test_what_lacks_usable_rows_is_named_and_told_why():
    rows = [row("r7", "2026-03-03", {"a": 1.0}, 0.1), row("r7", "2026-02-17", {}, 0.1, status="error")]
    rows += [row("r3", "2026-02-16", {}, 0.1, status="error"), row("r3", "2026-02-17", {}, 0.1, status="unusable")]
    rows.append(row("r3", "", {}, 0.1, status="error"))
    for unit, wrong, told in [
        # Whichever of the two it is.
        ("r7", {"against": "r3"}, "unit 'r3': no usable rows (error: 2026-02-16, undated; unusable: 2026-02-17)"),
        ("r3", {"against": "r7"}, "unit 'r3': no usable rows (error: 2026-02-16, undated; unusable: 2026-02-17)"),
        ("r7", {"since": "2026-03-01"}, "unit 'r7': no usable rows before (usable: 2026-03-03; error: 2026-02-17)"),
        ("r3", {"since": "2026-03-01"}, "unit 'r3': no usable rows before (error: 2026-02-16, undated; unusable: 2026-02-17)"),
        ("r7", {"since": "2026-03-01", "kind": "diagnose"}, "no usable rows before (kind 'identify': 2026-02-17, 2026-03-03)"),
        ("r7", {"before": ("2026-03-01", "2026-03-09"), "after": ("2026-04-01", "2026-04-02")}, "rows after (usable: 2026-03-03; error: "),
    ]:
        with pytest.raises(ValueError) as error:
            fleet.compare(table(rows), unit, **wrong)
        assert told in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(ValueError, match=r"'r7': usable rows of 1 weeks \(two are needed; usable: 2026-03-03; error: 2026-02-17\)"):
        fleet.weeks(table(rows), "r7")
