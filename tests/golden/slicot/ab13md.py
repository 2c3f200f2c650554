"""Upper bounds of the structured singular value by SLICOT's AB13MD, for random mixed problems.

    python tests/golden/slicot/ab13md.py write              the golden file, 100 problems
    python tests/golden/slicot/ab13md.py compare [N [FILE]] N problems (2000), SLICOT and pkm in one run; needs the wheel `pkm`.
                                                            The table is printed, or written into FILE

AB13MD knows real scalars and square complex blocks, each once. It is called without a start value, in a child process with a time
limit: started from an earlier result it can hang on real blocks (SLICOT 5.8 through Slycot 0.7.1).
"""

import json
import multiprocessing
import pathlib
import sys
import time

import numpy
import slycot

SEED = 20
LIMIT_S = 5.0


def problems(n):
    """Matrices with four decimals, so that the file holds what was computed with, and their blocks ('real', 1) or ('full', size)."""
    random = numpy.random.default_rng(SEED)
    for _ in range(n):
        blocks = [("real", 1)] * int(random.integers(0, 5))
        blocks += [("full", 1)] * int(random.integers(0, 3))
        blocks += [("full", int(size)) for size in random.integers(2, 4, int(random.integers(0, 3)))]
        if not blocks:
            blocks = [("real", 1), ("full", 2)]
        blocks = [blocks[i] for i in random.permutation(len(blocks))]
        size = sum(b[1] for b in blocks)
        matrix = random.standard_normal((size, size)) + 1j * random.standard_normal((size, size))
        yield numpy.round(matrix, 4), blocks


def ab13md(matrix, blocks):
    """One cold call: the bound, and the seconds it took."""
    sizes = numpy.array([size for _, size in blocks])
    types = numpy.array([1 if kind == "real" else 2 for kind, _ in blocks])
    start = time.perf_counter()
    bound = slycot.ab13md(matrix, sizes, types)[0]
    return float(bound), time.perf_counter() - start


def serve(channel):
    """The child: answers one problem after the other."""
    while True:
        channel.send(ab13md(*channel.recv()))


class Child:
    """AB13MD in a process that can be given up."""

    def __init__(self):
        self.channel, self.process = None, None

    def ask(self, matrix, blocks):
        """The bound and its time, or None when the limit passed."""
        if self.process is None:
            self.channel, end = multiprocessing.Pipe()
            self.process = multiprocessing.Process(target=serve, args=(end,), daemon=True)
            self.process.start()
        self.channel.send((matrix, blocks))
        if self.channel.poll(LIMIT_S):
            return self.channel.recv()
        self.process.kill()
        self.process = None
        return None


def write():
    """The golden file beside this script."""
    child, out = Child(), []
    for matrix, blocks in problems(100):
        answer = child.ask(matrix, blocks)
        if answer is None:
            continue
        entries = [[float(x.real), float(x.imag)] for x in matrix.ravel()]
        out.append({"blocks": blocks, "matrix": entries, "ab13md": answer[0]})
    head = {"by": f"slycot {slycot.__version__}, AB13MD, cold", "seed": SEED, "problems": out}
    path = pathlib.Path(__file__).with_name("ab13md.json")
    path.write_text(json.dumps(head, separators=(",", ":")).replace('{"blocks"', '\n{"blocks"') + "\n")
    print(f"{path}: {len(out)} problems")


def ankle_like(n):
    """The structure of the ankle robot's analysis: three real scalars and two full 3 x 3 blocks."""
    random = numpy.random.default_rng(SEED + 1)
    for _ in range(n):
        yield random.standard_normal((9, 9)) + 1j * random.standard_normal((9, 9)), [("real", 1)] * 3 + [("full", 3)] * 2


def named(blocks):
    return [{"kind": "real"} if kind == "real" else {"kind": "full", "rows": size, "cols": size} for kind, size in blocks]


class Tally:
    """What a run over problems counts."""

    def __init__(self):
        self.n, self.hangs, self.zeros = 0, 0, 0
        self.excess, self.ratio, self.own_s, self.their_s = [], [], [], []

    def add(self, matrix, blocks, answer):
        self.n += 1
        start = time.perf_counter()
        upper = pkm.mu(matrix, named(blocks), bounds="upper").upper
        own_s = time.perf_counter() - start
        bounds = pkm.mu(matrix, named(blocks))
        assert bounds.lower <= bounds.upper * (1 + 1e-12), "bounds cross"
        if any(kind == "real" for kind, _ in blocks) and bounds.upper > 0:
            self.ratio.append(bounds.lower / bounds.upper)
        if answer is None:
            self.hangs += 1
            return
        self.own_s.append(own_s)
        self.their_s.append(answer[1])
        # AB13MD returns 0 or nonsense for a few real problems whose bound is 0.
        if answer[0] <= 1e-6:
            self.zeros += 1
            return
        self.excess.append(upper / answer[0])
        assert answer[0] >= bounds.lower * (1 - 1e-3), ("AB13MD below a verified lower bound", answer[0], bounds.lower)

    def row(self, name):
        median = lambda x: numpy.median(x)
        own, theirs = 1e3 * median(self.own_s), 1e3 * median(self.their_s)
        cells = [name, self.n, f"{min(self.excess):.6f}", f"{median(self.excess):.6f}", f"{max(self.excess):.6f}"]
        cells += [f"{numpy.quantile(self.ratio, q):.4f}" for q in (0.01, 0.1, 0.5)]
        cells += [f"{own:.3f}", f"{theirs:.3f}", f"{own / theirs:.3f}", self.zeros, self.hangs]
        return "| " + " | ".join(str(c) for c in cells) + " |"


HEAD = """\
| problems | number | upper / AB13MD, min | median | max | lower / upper with real blocks, 1 % | 10 % | median | pkm, ms | AB13MD, ms | ours / theirs | AB13MD 0 | gave up |
|---|---|---|---|---|---|---|---|---|---|---|---|---|
"""


def compare(n, path):
    """Bounds and times of both, in turn on the same problems."""
    child, rows = Child(), []
    for name, source in [("mixed, 1 to 14 rows", problems(n)), ("3 real + two full 3 x 3", ankle_like(max(n // 10, 1)))]:
        tally = Tally()
        for matrix, blocks in source:
            tally.add(matrix, blocks, child.ask(matrix, blocks))
        rows.append(tally.row(name))
        assert max(tally.excess) <= 1.001 and numpy.median(tally.ratio) >= 0.99, rows
    text = HEAD + "\n".join(rows) + "\n"
    if path is None:
        print(text)
    else:
        pathlib.Path(path).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] == ["write"]:
        write()
    elif sys.argv[1:2] == ["compare"]:
        import pkm

        compare(int(sys.argv[2]) if len(sys.argv) > 2 else 2000, sys.argv[3] if len(sys.argv) > 3 else None)
    else:
        sys.exit(__doc__)
