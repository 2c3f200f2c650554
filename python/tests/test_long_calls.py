"""Long calls: Ctrl-C ends them, other threads run meanwhile, progress is told."""

import _thread
import functools
import signal
import threading
import time

import numpy as np
import pkm
import pytest

# Each would take minutes if nothing ended it.
ROBOT = pkm.robots.load("prs3")


@functools.cache
def hour():
    """An hour of motion at 1 kHz."""
    n = 3_600_000
    wave = np.repeat(np.sin(np.arange(n) / 500.0)[:, None], ROBOT.n_act, axis=1)
    q = ROBOT.assemble()[[ROBOT.joints.index(j) for j in ROBOT.actuators]] + 0.01 * wave
    return q, 0.02 * wave, -0.04 * wave


@functools.cache
def long_recording():
    q, _, _ = hour()
    signals = {f"{kind}.{j}": q[:, k] for kind in ("q", "tau") for k, j in enumerate(ROBOT.actuators)}
    return pkm.Recording(np.arange(len(q)) / 1000.0, signals, name="hour")


def uncertain():
    """A system of many states whose bounds are slow."""
    rng = np.random.default_rng(3)
    n, m = 40, 12
    a = rng.normal(size=(n, n))
    a -= (np.abs(np.linalg.eigvals(a).real).max() + 0.05) * np.eye(n)
    return (a, rng.normal(size=(n, m)), rng.normal(size=(m, n)), np.zeros((m, m))), [{"kind": "real"}] * m


def grid(n):
    return {"z": np.linspace(0.3, 0.9, n), "rx": np.linspace(-0.5, 0.5, n), "ry": np.linspace(-0.5, 0.5, n)}


def controller():
    text = 'law = "computed_torque"\nrate_hz = 1000\nbandwidth = 30\n[friction]\ncompensate = "none"\n'
    return pkm.Controller.from_text(ROBOT, text)


LONG = {
    "simulate": lambda: pkm.simulate(ROBOT, ROBOT, duration_s=3600.0),
    "excite": lambda: pkm.excite(pkm.robots.load("serial_arm7"), harmonics=10, restarts=500, iterations=5000),
    "diagnose": lambda: pkm.diagnose(ROBOT, long_recording()),
    "fit": lambda: pkm.Identification(ROBOT).fit(long_recording()),
    "rnea": lambda: ROBOT.inverse_dynamics(*hour()),
    "workspace": lambda: ROBOT.workspace(grid(120)),
    "Plant.run": lambda: pkm.Plant(ROBOT).run(np.zeros((2_000_000, ROBOT.n_act)), 1e-3),
    "Controller.run": lambda: controller().run(q_meas=hour()[0]),
    "mu": lambda: pkm.mu(*uncertain()),
}


@pytest.fixture
def heard():
    """Ctrl-C is heard: a shell starts what it puts in the background deaf to it, and then nothing would end a long call."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heard")
@pytest.mark.parametrize("name", LONG)
def test_ctrl_c_ends_a_long_call(name):
    hour(), long_recording()
    # What a user's Ctrl-C does, from a thread that can only run if the interpreter is free.
    timer = threading.Timer(0.7, _thread.interrupt_main)
    timer.start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        LONG[name]()
    took = time.monotonic() - start
    timer.cancel()
    assert took < 15.0, f"{took:.1f} s"


def test_other_threads_run_meanwhile():
    counted, stop = [0], threading.Event()

    def count():
        while not stop.wait(0.002):
            counted[0] += 1

    thread = threading.Thread(target=count)
    thread.start()
    before, start = counted[0], time.monotonic()
    pkm.simulate(ROBOT, ROBOT, duration_s=20.0)
    took, after = time.monotonic() - start, counted[0]
    stop.set()
    thread.join()
    # Held, the interpreter would give the thread one turn or two; free, a turn every few milliseconds.
    assert after - before > 20 * took, (after - before, took)


def test_what_a_callback_raises_ends_the_call_at_once():
    def stop(_share):
        raise RuntimeError("enough")

    start = time.monotonic()
    with pytest.raises(RuntimeError, match="enough"):
        pkm.simulate(ROBOT, ROBOT, duration_s=3600.0, progress=stop)
    assert time.monotonic() - start < 30.0


PROGRESS = {
    "simulate": lambda p: pkm.simulate(ROBOT, ROBOT, duration_s=1.0, progress=p),
    "workspace": lambda p: ROBOT.workspace(grid(12), progress=p),
    "Plant.run": lambda p: pkm.Plant(ROBOT).run(np.zeros((3000, ROBOT.n_act)), 1e-5, progress=p),
    "Controller.run": lambda p: controller().run(q_meas=hour()[0][:3000], progress=p),
    "fit": None,
}


@pytest.mark.parametrize("call", PROGRESS.values(), ids=PROGRESS)
def test_progress_rises_to_the_end(call, hidden):
    robot, recording, _, _ = hidden
    call = call or (lambda p: pkm.Identification(robot, method="wls").fit(recording, progress=p))
    shares, threads = [], set()

    def told(share):
        shares.append(share)
        threads.add(threading.get_ident())

    call(told)
    assert shares == sorted(shares) and shares[-1] == 1.0 and 3 < len(shares) <= 502
    assert threads == {threading.get_ident()}


def test_a_bar_is_drawn(capsys):
    pytest.importorskip("tqdm", reason="the package tqdm is not installed")
    pkm.simulate(ROBOT, ROBOT, duration_s=1.0, progress=True)
    assert "simulating: 100 %" in capsys.readouterr().err
    pkm.simulate(ROBOT, ROBOT, duration_s=1.0, progress=False)
    assert capsys.readouterr().err == ""
    with pytest.raises(TypeError, match="progress is int"):
        pkm.simulate(ROBOT, ROBOT, duration_s=1.0, progress=3)


def test_two_threads_may_share_a_plant_and_a_controller():
    """Who has the interpreter waits for the plant, and whoever moves it waits for the interpreter: neither for ever."""
    plant, law = pkm.Plant(ROBOT), controller()
    calls = [
        lambda: plant.run(np.zeros((20_000, ROBOT.n_act)), 1e-6),
        lambda: [plant.step(np.zeros(ROBOT.n_act), 1e-6) for _ in range(2000)],
        lambda: law.run(q_meas=hour()[0][:20_000]),
        lambda: [law.step(q_meas=hour()[0][0]) for _ in range(2000)],
    ]
    threads = [threading.Thread(target=call, daemon=True) for call in calls]
    hour()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert not any(thread.is_alive() for thread in threads)
