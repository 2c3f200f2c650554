"""`python -m pkm.fleet`: many recordings of many robots from a shell."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from typing import Any

import pkm
from pkm import fleet
from pkm.fleet._run import run

EXAMPLES = """\
DIR holds a folder per robot: robot.toml and its URDF, and below them folders of recordings (.csv, .mcap), best named by their day:
  fleet/robot7/robot.toml  fleet/robot7/2026-03-02/A.csv  fleet/robot7/2026-03-02/holdout.csv

examples:
  python -m pkm.fleet diagnose fleet --table verdicts.parquet
  python -m pkm.fleet identify s3://bucket/fleet --table s3://bucket/parameters.parquet --scheduler tcp://10.0.0.1:8786
  python -m pkm.fleet compare verdicts.parquet robot7 --since 2026-03-01
  python -m pkm.fleet compare parameters.parquet robot7 --against robot3
  python -m pkm.fleet --bench --workers 2

exit status: 0 done (whatever was found), 1 recordings whose rows are errors or lost, 2 bad usage or bad input
"""


def _arguments() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(
        prog="python -m pkm.fleet",
        description="Identifies or diagnoses many recordings of many robots on a Dask cluster, into one Parquet table; goes on where it was stopped.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=f"pkm {pkm.__build__}")
    top.add_argument("--bench", action="store_true", help="measure what the workers gain over one process, and stop")
    top.add_argument("--tasks", type=_positive, default=16, metavar="N", help="of --bench: diagnoses [16]")
    top.add_argument("--rounds", type=_positive, default=3, metavar="N", help="of --bench: rounds, of which the median counts [3]")
    top.add_argument("--workers", type=int, metavar="N", help="of --bench: processes [one per processor]")
    verbs = top.add_subparsers(dest="verb", metavar="VERB")
    for kind, says in (("diagnose", "what is missing in each robot's model"), ("identify", "each robot's parameters")):
        verb = verbs.add_parser(kind, help=says, description=f"{kind}: {says}.")
        verb.add_argument("root", metavar="DIR", help="folder of robots, a path of fsspec")
        verb.add_argument("--table", required=True, metavar="FILE", help="the Parquet table, a path of fsspec")
        verb.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler [processes of this machine]")
        verb.add_argument("--workers", type=int, metavar="N", help="processes of this machine [one per processor; 0: this one alone]")
        verb.add_argument("--retries", type=int, default=3, metavar="N", help="how often a task is tried again [3]")
        verb.add_argument("--settings", default="{}", metavar="JSON", help=f"keywords of pkm's {kind}, such as '{{\"band_hz\": 8.0}}'")
        verb.add_argument("--quiet", action="store_true", help="no bar")
    verb = verbs.add_parser("compare", help="what changed on a robot, or between two", description="compare: what changed, the surest first.")
    verb.add_argument("table", metavar="FILE", help="the Parquet table, a path of fsspec")
    verb.add_argument("unit", metavar="UNIT", help="the robot: its folder below DIR")
    ways = verb.add_mutually_exclusive_group(required=True)
    ways.add_argument("--since", metavar="DAY", help="rows before this day against those from then on")
    ways.add_argument("--against", metavar="UNIT", help="another robot")
    ways.add_argument("--weeks", action="store_true", help="every week against the one before")
    verb.add_argument("--all", action="store_true", help="also what stayed the same")
    return top


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} (must be >= 1)")
    return value


def main(arguments: list[str] | None = None) -> int:
    """Does what the command line says; the exit status."""
    parser = _arguments()
    given = parser.parse_args(arguments)
    try:
        if given.bench:
            return _bench(given)
        if given.verb is None:
            parser.print_help()
            return 2
        return _compare(given) if given.verb == "compare" else _work(given)
    except (ValueError, OSError, ImportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _work(given: argparse.Namespace) -> int:
    try:
        settings: dict[str, Any] = json.loads(given.settings)
        if not isinstance(settings, dict):
            raise ValueError("not an object")
    except ValueError as error:
        raise ValueError(f"--settings: {error}") from None
    rows, keys = run(
        given.verb,
        fleet.find(given.root),
        given.table,
        settings=settings,
        scheduler=given.scheduler,
        workers=given.workers,
        retries=given.retries,
        progress=not given.quiet and sys.stderr.isatty(),
    )
    # The table may hold those of other folders, of other builds and of files as they were: they have been told.
    rows = rows[rows["key"].isin(keys)]
    for row in rows.to_dict("records"):
        words = row["error"] if row["status"] in ("error", "lost") else ", ".join(row["findings"] if row["findings"] is not None else ()) or row["says"]
        print(f"{row['unit']}  {row['taken'] or '-'}  {row['status']}  {words}")
    return 1 if rows["status"].isin(("error", "lost")).any() else 0


def _compare(given: argparse.Namespace) -> int:
    rows = fleet.read(given.table)
    if given.weeks:
        changes = fleet.weeks(rows, given.unit)
    else:
        changes = fleet.compare(rows, given.unit, since=given.since, against=given.against)
    shown = changes if given.all else changes[changes["what"] != "same"]
    print(shown.to_string(index=False) if len(shown) else "nothing changed")
    return 0


def _bench(given: argparse.Namespace) -> int:
    if os.environ.get("RAYON_NUM_THREADS") != "1":
        # The engine reads this when it first starts a thread: a process of its own has not.
        environment = {**os.environ, "RAYON_NUM_THREADS": "1"}
        return subprocess.call([sys.executable, "-m", "pkm.fleet", *sys.argv[1:]], env=environment)
    from ._bench import bench

    print(bench(given.tasks, given.workers, given.rounds))
    return 0


if __name__ == "__main__":
    sys.exit(main())
