"""Recordings: from arrays, through files, and read by the packages ROS 2 users have."""

import gc

import numpy as np
import pkm
import pytest


@pytest.fixture
def recording():
    time = np.arange(50) / 100.0
    signals = {"q.q1": np.sin(time), "tau.q1": np.cos(time), "q_ref.q1": np.sin(time), "temp.q1": 20.0 + time}
    signals["tau.q1"][7] = np.nan
    load = {"link": "platform", "mass": 2.0, "xyz": [0.0, 0.0, 0.1]}
    meta = {"tau": "measured", "gravity": [0.1, 0.0, -9.8], "session": "2021-03-03", "load": load, "note": "a = b"}
    return pkm.Recording(time, signals, name="bench", meta=meta)


def test_what_goes_in_comes_out(recording):
    assert recording.name == "bench"
    assert len(recording) == 50
    assert recording.duration == pytest.approx(0.49)
    assert recording.signals == ["q.q1", "q_ref.q1", "tau.q1", "temp.q1"]
    assert "q.q1" in recording and "q.q2" not in recording
    assert list(recording) == recording.signals
    np.testing.assert_array_equal(recording["q.q1"], np.sin(recording.time))
    assert recording.meta["load"] == {"link": "platform", "mass": 2.0, "xyz": [0.0, 0.0, 0.1]}
    assert recording.meta["gravity"] == [0.1, 0.0, -9.8]
    assert "bench" in repr(recording) and "50 samples" in repr(recording)


def test_arrays_cannot_be_written_in_place(recording):
    for array in [recording.time, recording["q.q1"]]:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_signals_are_the_memory_of_the_recording():
    n = 100_000
    recording = pkm.Recording(np.arange(n) / 1000.0, {"q.q1": np.sin(np.arange(n))})
    first, second = recording["q.q1"], recording["q.q1"]
    assert np.shares_memory(first, second) and np.shares_memory(recording.time, recording.time)
    # Nobody may make it writable again, and the numbers outlive the name.
    with pytest.raises(ValueError, match="WRITEABLE"):
        first.flags.writeable = True
    del recording, second
    gc.collect()
    np.testing.assert_array_equal(first, np.sin(np.arange(n)))


@pytest.mark.parametrize("name", ["a.csv", "a.mcap"])
def test_round_trip(recording, tmp_path, name):
    path = tmp_path / name
    pkm.write(path, recording)
    back = pkm.read(path)
    assert back.name == str(path)
    assert back.signals == recording.signals
    np.testing.assert_array_equal(back.time, recording.time)
    for signal in recording.signals:
        np.testing.assert_array_equal(back[signal], recording[signal])
    assert recording.meta.items() <= back.meta.items()


def test_ros2_packages_read_the_mcap_file(recording, tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="the package mcap is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="the package mcap-ros2-support is not installed")
    path = tmp_path / "a.mcap"
    pkm.write(path, recording)
    with open(path, "rb") as file:
        mcap = reader.make_reader(file, validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
        assert mcap.get_header().profile == "ros2"
        metadata = {m.name: m.metadata for m in mcap.iter_metadata()}
        messages = [(s.name, c.topic, m.log_time, d) for s, c, m, d in mcap.iter_decoded_messages(topics=["/joint_states"])]
    assert metadata["pkm"]["tau"] == "measured"
    assert len(messages) == len(recording)
    for i, (schema, _, stamp_ns, state) in enumerate(messages):
        assert schema == "sensor_msgs/msg/JointState"
        assert stamp_ns == round(recording.time[i] * 1e9)
        assert list(state.name) == ["q1"]
        np.testing.assert_array_equal(state.position, recording["q.q1"][i : i + 1])
        np.testing.assert_array_equal(state.effort, recording["tau.q1"][i : i + 1])


def test_simulated_recordings_are_the_same_every_time():
    robot = pkm.robots.load("five_bar")
    first, again, other = (pkm.simulate(robot, robot, seed=s, duration_s=1.0, rate_hz=200.0) for s in (1, 1, 2))
    assert len(first) == 201
    np.testing.assert_array_equal(first["tau.shoulder_left"], again["tau.shoulder_left"])
    assert np.abs(first["q.shoulder_left"] - other["q.shoulder_left"]).max() > 1e-3
    assert {f"{kind}.{joint}" for kind in ("q", "tau", "q_ref", "dq_ref") for joint in robot.actuators} <= set(first.signals)
