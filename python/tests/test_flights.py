"""Logs, batches, identification, replay and report, beside the program."""

import json
import os
import signal
import subprocess
import threading
import time

import numpy as np
import pytest
import tello_ctl as tc

PROGRAM = os.environ.get("TELLO_CTL")
needs_program = pytest.mark.skipif(PROGRAM is None, reason="NOT CHECKED against the program: set TELLO_CTL")


def program(*arguments):
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    ended = tc.fly(path, seed=7)
    assert ended["phase"] == "landed" and ended["targets_reached"] == ended["targets_count"]
    return path


@needs_program
def test_a_batch_is_that_of_the_program():
    ours = tc.batch(3, seed=1001)
    theirs = json.loads(program("sim", "--batch", 3, "--seed", 1001, "--json"))
    assert ours == theirs
    assert list(ours.frame()["seed"]) == [1001, 1002, 1003]


@needs_program
def test_a_log_is_that_of_the_program(log, tmp_path):
    program("sim", "--seed", 7, "--log", tmp_path / "theirs.mcap")
    ours, theirs = tc.read_log(log), tc.read_log(tmp_path / "theirs.mcap")
    assert ours.channels.keys() == theirs.channels.keys()
    for topic, channel in ours.channels.items():
        for name, values in channel.columns.items():
            other = theirs[topic][name]
            if isinstance(values, list):
                assert values == other, (topic, name)
            else:
                assert np.array_equal(values, other, equal_nan=values.dtype.kind == "f"), (topic, name)


def test_a_log_is_what_mcap_reads(log):
    reader = pytest.importorskip("mcap.reader")
    pandas = pytest.importorskip("pandas")
    read = tc.read_log(log)
    assert read.torn is None and read.settings["cycle"]["dt_s"] == 0.02
    records = {}
    with open(log, "rb") as file:
        for _, channel, message in reader.make_reader(file).iter_messages():
            if channel.message_encoding == "json":
                records.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
    assert read.channels.keys() == records.keys()
    # Times in the file are since 1970, ours since the start of the log: here the same.
    compared = 0
    for topic, rows in records.items():
        channel = read[topic]
        assert list(channel.time_ns) == [time_ns for time_ns, _ in rows]
        theirs = pandas.json_normalize([record for _, record in rows])
        frame = channel.frame()
        for name in theirs.columns:
            if theirs[name].dtype.kind in "fib" and name in frame and frame[name].dtype.kind in "fib":
                assert np.array_equal(frame[name].to_numpy(float), theirs[name].to_numpy(float), equal_nan=True), (topic, name)
                compared += 1
    assert compared > 50


def test_channels_can_be_chosen(log):
    read = tc.read_log(log, ["/estim/state"])
    assert list(read.channels) == ["/estim/state"]
    assert len(read["/estim/state"]) > 100


def test_a_torn_log_is_read_up_to_its_tear(log, tmp_path):
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(log.read_bytes()[:-20_000])
    read = tc.read_log(torn)
    assert read.torn is not None and len(read["/estim/state"]) > 100


def test_what_is_no_log_is_refused(tmp_path):
    with pytest.raises(tc.TelloError, match="missing.mcap"):
        tc.read_log(tmp_path / "missing.mcap")
    (tmp_path / "text.mcap").write_text("no log")
    with pytest.raises(tc.TelloError, match="text.mcap"):
        tc.read_log(tmp_path / "text.mcap")


@needs_program
def test_identification_is_that_of_the_program(tmp_path):
    for seed in (1, 2):
        tc.fly(tmp_path / f"{seed}.mcap", seed=seed)
    ours = tc.identify(tmp_path)
    theirs = json.loads(program("ident", tmp_path, "--json"))
    for key in ("p", "std", "covariance", "dead_time_s", "cost", "iterations", "pieces", "verdict"):
        assert ours[key] == theirs[key], key
    assert len(ours["parameters"]) == 11


def test_another_kind_of_loss_replaces_the_built_in_one(log):
    def cost(loss):
        return tc.identify(log, settings={"map": {"observation_loss": loss}})["cost"]

    assert cost({"kind": "huber", "scale": 0.01}) < 0.9 * cost({"kind": "none"})


def test_a_flight_is_replayed_bit_by_bit_and_reported(log, tmp_path):
    replayed = tc.replay(log)
    assert replayed["is_equal"] is True
    numbers = tc.report(log, tmp_path / "report.html")
    assert not numbers["unusable"]
    assert (tmp_path / "report.html").read_text().startswith("<!")
    tc.report(log, tmp_path / "report.html")
    # A second log in the place of the page is a mistake.
    second = tmp_path / "second.mcap"
    second.write_bytes(log.read_bytes())
    with pytest.raises(tc.TelloError, match="second.mcap exists and is no page"):
        tc.report(log, second)
    assert second.read_bytes() == log.read_bytes()


def test_settings_reach_the_flight():
    calm = tc.batch(2, sim={"profile": "clean", "has_spread": False})
    assert calm["flights"][0]["by_truth"]["distance_max_m"] < 0.2
    with pytest.raises(tc.TelloError, match="fog"):
        tc.batch(1, sim={"profile": "fog"})
    with pytest.raises(tc.TelloError, match="windy"):
        tc.batch(1, sim={"windy": 1})
    with pytest.raises(tc.TelloError, match="count"):
        tc.batch(0)


def test_wrong_arguments_name_themselves(log, tmp_path):
    new = tmp_path / "new.mcap"
    for call, message in [
        (lambda: tc.fly(new, mission=tmp_path / "none.json"), "mission: .*none.json"),
        (lambda: tc.fly(new, mission=3), "mission: expected a path, given 3"),
        (lambda: tc.fly(new, mission={"square": 1}), "mission: "),
        (lambda: tc.fly(new, config={"cycl": 1}), "config: .*cycl"),
        (lambda: tc.fly(new, sim={"windy": 1}), "sim: .*windy"),
        (lambda: tc.fly(new, seed=-1), "seed: expected a whole number"),
        (lambda: tc.fly(3), "log: expected a path, given 3"),
        (lambda: tc.batch(1, seed=-1), "seed: expected a whole number"),
        (lambda: tc.batch(2, seed=2**64 - 1), "seed: expected a whole number"),
        (lambda: tc.batch(1.5), "count: expected a whole number"),
        (lambda: tc.identify(log, seed=2**64), "seed: expected a whole number"),
        (lambda: tc.identify(log, bootstrap=-1), "bootstrap: expected a whole number"),
        (lambda: tc.identify(log, settings={"mapp": {}}), "settings: .*mapp"),
        (lambda: tc.identify([]), "logs: expected at least 1 path"),
        (lambda: tc.replay([]), "logs: expected at least 1 path"),
        (lambda: tc.report([], tmp_path / "a.html"), "logs: expected at least 1 path"),
        (lambda: tc.read_log(log, ["/estim/stat"]), "topics: /estim/stat is none of .*/estim/state"),
        (lambda: tc.read_log(log, [3]), "topics: expected names of channels"),
        (lambda: tc.read_log([log, log]), "path: expected a path"),
    ]:
        with pytest.raises(tc.TelloError, match=message):
            call()
    assert not new.exists()
    assert tc.read_log(log, "/estim/state").channels.keys() == {"/estim/state"}


@pytest.fixture
def interrupted():
    """Runs a call, and Ctrl-C after some seconds; how long it went on after that comes back."""
    # A shell that starts its commands in the background has them ignore it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def run(call, after_s):
        timer = threading.Timer(after_s, lambda: os.kill(os.getpid(), signal.SIGINT))
        timer.start()
        began = time.monotonic()
        try:
            with pytest.raises(KeyboardInterrupt):
                call()
        finally:
            timer.cancel()
        return time.monotonic() - began - after_s

    yield run
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_ends_a_long_call(interrupted):
    assert interrupted(lambda: tc.batch(100_000), 1.0) < 19.0


def test_ctrl_c_ends_a_flight_a_replay_and_a_report_without_a_file(interrupted, tmp_path):
    hover = {"points": {"rows": [[0, 0, 0, 1.3, 0], [120, 0, 0, 1.3, 0]]}, "accel_max_mps2": 0.9}
    hover["follow"] = tc.defaults("mission")["waypoints"]["follow"]
    log = tmp_path / "long.mcap"

    def fly():
        return tc.fly(log, mission={"trajectory": hover})

    began = time.monotonic()
    fly()
    flew_s = time.monotonic() - began
    log.rename(tmp_path / "whole.mcap")
    assert interrupted(fly, 0.1) < 0.5 * flew_s
    assert not log.exists()
    began = time.monotonic()
    whole = tmp_path / "whole.mcap"
    assert tc.replay(whole)["is_equal"] is True
    replayed_s = time.monotonic() - began
    assert interrupted(lambda: tc.replay(whole), 0.1) < 0.5 * replayed_s
    interrupted(lambda: tc.report(whole, tmp_path / "page.html"), 0.1)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["whole.mcap"]


def test_other_threads_go_on_meanwhile():
    began, done = threading.Event(), threading.Event()

    def fly():
        began.set()
        tc.batch(40)
        done.set()

    flying = threading.Thread(target=fly)
    flying.start()
    assert began.wait(10.0)
    # Longer than a thread keeps the interpreter: were the batch over, `done` would be set by the end.
    count = sum(1 for _ in range(2_000_000))
    assert count == 2_000_000 and not done.is_set(), "this thread waited for the batch"
    flying.join()
    assert done.is_set()
