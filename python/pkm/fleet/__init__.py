"""Many recordings of many robots on a Dask cluster: one Parquet table of verdicts, and what changed between rows of it.

    work = fleet.find("s3://bucket/robots")                      # every folder of recordings with its robot
    rows = fleet.diagnose(work, "s3://bucket/verdicts.parquet")  # this machine's processes; scheduler="tcp://..." for a cluster
    fleet.compare(rows, "robot7", since="2026-03-01")            # what changed on robot 7 since March?

Needs `pip install './python[fleet]'`, at the root of a clone of the project. The same from a shell: `python -m pkm.fleet --help`.
"""

from ._compare import compare, history, weeks
from ._run import diagnose, identify
from ._table import CIRCUMSTANCES, read
from ._work import Task, find

__all__ = ["CIRCUMSTANCES", "Task", "compare", "diagnose", "find", "history", "identify", "read", "weeks"]
