"""What changed: on one robot from one day to another, or between two robots of one kind."""

from __future__ import annotations

import datetime
import math
from typing import TYPE_CHECKING, Any

from ._needs import need
from ._table import read

if TYPE_CHECKING:
    import pandas

# Half the width of a 95 % interval in standard deviations.
HALF_WIDTH = 1.959963984540054
# Rows whose quantities mean nothing.
MUTE = ("error", "lost", "unusable", "not_identified")
# Errors of the model as given: how far a robot is from its files, whatever the reason.
ERROR = "held-out error of the model as given"
Span = tuple[str, str]


def history(rows: pandas.DataFrame | str, unit: str | None = None, *, kind: str | None = None) -> pandas.DataFrame:
    """Every quantity of every row in long form: unit, taken, kind, quantity, value, lower, upper (95 % interval) and its unit of measure.

    `rows`: a table, or its path. Rows with an error, and recordings that could not be used, have none.
    """
    table = read(rows) if isinstance(rows, str) else rows
    chosen = table[~table["status"].isin(MUTE)]
    if unit is not None:
        _known(table, unit)
        chosen = chosen[chosen["unit"] == unit]
    if kind is not None:
        chosen = chosen[chosen["kind"] == kind]
    out: list[dict[str, Any]] = []
    for row in chosen.to_dict("records"):
        base = {"unit": row["unit"], "taken": row["taken"], "kind": row["kind"], "key": row["key"]}
        quantities = [dict(q) for q in row["quantities"]] if row["quantities"] is not None else []
        for q in quantities:
            out.append(
                {**base, "quantity": q["name"], "value": q["value"], "lower": q["lower"], "upper": q["upper"], "measure": q["unit"]}
            )
        out.append({**base, "quantity": ERROR, "value": row["rms_nominal"], "lower": math.nan, "upper": math.nan, "measure": "1"})
    columns = ["unit", "taken", "kind", "key", "quantity", "value", "lower", "upper", "measure"]
    frame: pandas.DataFrame = need("pandas").DataFrame(out, columns=columns)
    return frame


def compare(
    rows: pandas.DataFrame | str,
    unit: str,
    *,
    since: str | None = None,
    before: Span | None = None,
    after: Span | None = None,
    against: str | None = None,
    kind: str | None = None,
    level: float = 0.05,
) -> pandas.DataFrame:
    """What is different, quantity by quantity, the surest change first.

    One of: `since`, a day: that unit's rows from before it against those from then on; `before` and `after`, two spans of days, ends
    included; `against`: another unit, which takes the place of before. `kind`: "diagnose" or "identify" rows alone.

    A recording counts once in each kind: with the usable row that was finished last, whatever build of pkm, robot file or settings it is of.

    Columns: `quantity`, `measure`, `before`, `after`, `change`, `sd` (of the change), `p_value` (Welch), `p_holm` (over all quantities),
    `n_before`, `n_after`, and `what`: "moved" (`p_holm < level`), "same", "appeared" and "gone" (a finding on one side alone, whose
    certainty is that of its verdict), "unknown" (one row without an interval on a side). The spread of a side is the larger of what its
    intervals say and what its rows show.
    """
    ways = [since is not None, before is not None or after is not None, against is not None]
    if sum(ways) != 1 or (before is None) != (after is None):
        raise ValueError("one of since, before with after, or against must be given")
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level} (must be > 0 and < 1)")
    full = read(rows) if isinstance(rows, str) else rows
    _known(full, unit)
    table = _measured(full, kind)
    ours = table[table["unit"] == unit]
    names, words = [unit, unit], [" before", " after"]
    if against is not None:
        _known(full, against)
        names, words = [against, unit], ["", ""]
        sides = [table[table["unit"] == against], ours]
    elif since is not None:
        day = _day(since)
        sides = [ours[(ours["taken"] != "") & (ours["taken"] < day)], ours[ours["taken"] >= day]]
    else:
        sides = [_within(ours, span) for span in (before, after) if span is not None]
    for name, when, side in zip(names, words, sides, strict=True):
        if side.empty:
            raise ValueError(f"unit {name!r}: no usable rows{when} ({_worth(full, name, kind)})")
    return _changes(sides[0], sides[1], level)


def weeks(rows: pandas.DataFrame | str, unit: str, *, kind: str | None = None, level: float = 0.05) -> pandas.DataFrame:
    """Every week of a unit against the last one before it that has rows: as `compare`, with a column `week` in front (`2026-W10`)."""
    full = read(rows) if isinstance(rows, str) else rows
    _known(full, unit)
    table = _measured(full, kind)
    dated = table[(table["unit"] == unit) & (table["taken"] != "")].copy()
    dated["week"] = [_week(day) for day in dated["taken"]]
    names = sorted(set(dated["week"]))
    if len(names) < 2:
        raise ValueError(f"unit {unit!r}: usable rows of {len(names)} weeks (two are needed; {_worth(full, unit, kind)})")
    parts = []
    for earlier, later in zip(names, names[1:], strict=False):
        part = _changes(dated[dated["week"] == earlier], dated[dated["week"] == later], level)
        part.insert(0, "week", later)
        parts.append(part)
    out: pandas.DataFrame = need("pandas").concat(parts, ignore_index=True)
    return out


def _measured(rows: pandas.DataFrame, kind: str | None) -> pandas.DataFrame:
    """`history` with every recording once: what another build or other settings made of the same bytes is no second measurement."""
    usable = rows[~rows["status"].isin(MUTE)].sort_values("finished", kind="stable", na_position="first")
    same = [
        (row["unit"], row["kind"], row["key"] if row["recordings_sha256"] is None else tuple(row["recordings_sha256"]))
        for row in usable.to_dict("records")
    ]
    last = {work: i for i, work in enumerate(same)}
    table = history(usable.iloc[sorted(last.values())], kind=kind)
    if table["kind"].nunique() > 1:
        # Both kinds judge the model as given on the same recordings.
        table["quantity"] = [f"{q} ({k})" if q == ERROR else q for q, k in zip(table["quantity"], table["kind"], strict=True)]
    return table


def _worth(table: pandas.DataFrame, unit: str, kind: str | None) -> str:
    """Days of a unit's rows by what they are worth: usable, or the status or the kind for which they are not."""
    days: dict[str, set[str]] = {}
    for row in table[table["unit"] == unit].to_dict("records"):
        is_other = kind not in (None, row["kind"])
        what = f"kind {row['kind']!r}" if is_other else row["status"] if row["status"] in MUTE else "usable"
        days.setdefault(what, set()).add(row["taken"] or "undated")
    ordered = sorted(days.items(), key=lambda item: (item[0] != "usable", item[0]))
    return "; ".join(f"{what}: {', '.join(sorted(of))}" for what, of in ordered)


def _known(table: pandas.DataFrame, unit: str) -> None:
    if unit not in set(table["unit"]):
        raise ValueError(f"no unit {unit!r} in the table (has: {', '.join(sorted(set(table['unit']))) or 'none'})")


def _day(text: str) -> str:
    try:
        return datetime.date.fromisoformat(text).isoformat()
    except ValueError:
        raise ValueError(f"{text!r} is no day (must be like 2026-03-01)") from None


def _within(table: pandas.DataFrame, span: Span) -> pandas.DataFrame:
    first, last = (_day(day) for day in span)
    # A time of day on the last day is later than the day's name.
    return table[(table["taken"] >= first) & (table["taken"].str[:10] <= last)]


def _week(day: str) -> str:
    year, week, _ = datetime.date.fromisoformat(day[:10]).isocalendar()
    return f"{year}-W{week:02d}"


def _changes(before: pandas.DataFrame, after: pandas.DataFrame, level: float) -> pandas.DataFrame:
    groups = [{str(name): group for name, group in side.groupby("quantity")} for side in (before, after)]
    rows = []
    for name in sorted({*groups[0], *groups[1]}):
        sides = [_side(group.get(name)) for group in groups]
        measure = next(g[name]["measure"].iloc[0] for g in groups if name in g)
        (x, var_x, dof_x, n_x), (y, var_y, dof_y, n_y) = sides
        # Means of equal numbers differ in their last digits, and so little that their spread is rounding as well.
        p = _welch(y - x, (var_x, var_y), (dof_x, dof_y), 1e-12 * max(abs(x), abs(y)))
        what = "gone" if n_y == 0 else "appeared" if n_x == 0 else "unknown" if math.isnan(p) else ""
        rows.append(
            {
                "quantity": name,
                "measure": measure,
                "before": x,
                "after": y,
                "change": y - x,
                "sd": math.sqrt(var_x + var_y),
                "p_value": p,
                "n_before": n_x,
                "n_after": n_y,
                "what": what,
            }
        )
    _holm(rows, level)
    order = {"moved": 0, "appeared": 1, "gone": 1, "same": 2, "unknown": 3}
    rows.sort(key=lambda r: (order[r["what"]], r["p_value"] if not math.isnan(r["p_value"]) else 1.0, r["quantity"]))
    columns = ["quantity", "measure", "before", "after", "change", "sd", "p_value", "p_holm", "n_before", "n_after", "what"]
    out: pandas.DataFrame = need("pandas").DataFrame(rows, columns=columns)
    return out


def _side(group: pandas.DataFrame | None) -> tuple[float, float, float, int]:
    """Mean, variance of the mean, its degrees of freedom, rows."""
    if group is None or group.empty:
        return math.nan, math.nan, math.nan, 0
    values = group["value"].to_numpy(float)
    n = len(values)
    stated = ((group["upper"] - group["lower"]).to_numpy(float) / (2 * HALF_WIDTH)) ** 2
    within = float(stated.mean()) / n
    shown = float(values.var(ddof=1)) / n if n > 1 else math.nan
    if math.isnan(within) or shown > within:
        return float(values.mean()), shown, n - 1, n
    return float(values.mean()), within, math.inf, n


def _welch(change: float, variances: tuple[float, float], dofs: tuple[float, float], rounding: float) -> float:
    total = sum(variances)
    if math.isnan(change) or math.isnan(total):
        return math.nan
    if abs(change) <= rounding:
        return 1.0
    if total == 0.0:
        return 0.0
    terms = sum(v**2 / d for v, d in zip(variances, dofs, strict=True) if math.isfinite(d) and d > 0)
    dof = total**2 / terms if terms > 0 else math.inf
    return float(2.0 * need("scipy.stats").t.sf(abs(change) / math.sqrt(total), dof))


def _holm(rows: list[dict[str, Any]], level: float) -> None:
    """Holm's step-down over the quantities that have a p-value."""
    tested = sorted((r for r in rows if not math.isnan(r["p_value"])), key=lambda r: r["p_value"])
    last = 0.0
    for i, row in enumerate(tested):
        last = max(last, min(1.0, (len(tested) - i) * row["p_value"]))
        row["p_holm"] = last
        row["what"] = "moved" if last < level else "same"
    for row in rows:
        row.setdefault("p_holm", math.nan)
