"""The simulator step by step, and the Gymnasium environments."""

import numpy as np
import pytest
import tello_ctl as tc

gymnasium = pytest.importorskip("gymnasium")
import tello_ctl.envs  # noqa: E402, F401  registers

TASKS = ["TelloHover-v0", "TelloTrack-v0", "TelloSquare-v0"]


def test_one_seed_is_one_flight():
    sticks = np.random.default_rng(1).uniform(-0.5, 0.5, (100, 8, 4))

    def poses(seeds):
        drones = tc.Simulators(seeds)
        return np.stack([drones.step(u).pose for u in sticks])

    first = poses(range(8))
    assert np.array_equal(first, poses(range(8)))
    assert not np.allclose(first[:, 0], first[:, 1])
    # A drone does not depend on those beside it.
    drones = tc.Simulators([3])
    alone = np.stack([drones.step(u[3:4]).pose[0] for u in sticks])
    assert np.array_equal(alone, first[:, 3])


def test_sticks_act_after_the_dead_time():
    settings = {"profile": "clean", "has_spread": False}
    drones = tc.Simulators([1, 1], {**settings, "plant": {"disturbance_h_mps": 0.0, "disturbance_v_mps": 0.0}})
    pushed = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
    moved = [np.diff(drones.step(pushed).velocity[:, 0])[0] for _ in range(40)]
    assert all(abs(v) < 1e-9 for v in moved[:15]), moved
    assert moved[20] > 0.05


def test_wrong_sticks_are_refused():
    drones = tc.Simulators([1, 2])
    with pytest.raises(tc.TelloError, match=r"sticks: expected shape \(2, 4\), given \(3, 4\)"):
        drones.step(np.zeros((3, 4)))
    with pytest.raises(tc.TelloError, match="sticks: NaN"):
        drones.step(np.full((2, 4), np.nan))
    with pytest.raises(tc.TelloError, match="numbers below 2, given 5"):
        drones.reset([5], [1])
    with pytest.raises(tc.TelloError, match="seeds"):
        tc.Simulators([])


@pytest.mark.parametrize("task", TASKS)
def test_gymnasium_accepts_the_environment(task):
    from gymnasium.utils.env_checker import check_env

    check_env(gymnasium.make(task, render_mode="rgb_array").unwrapped, skip_render_check=False)


@pytest.mark.parametrize(("task", "bound"), list(zip(TASKS, [0.05, 0.05, None])))
def test_the_expert_flies_the_task(task, bound):
    env = gymnasium.make(task)
    env.reset(seed=3)
    distances = []
    for _ in range(1000):
        _, _, terminated, truncated, info = env.step(env.unwrapped.expert_action())
        distances.append(info["distance"])
        if terminated or truncated:
            break
    if bound is None:
        assert terminated and info["corners"] == 5
    else:
        assert truncated and np.median(distances) < bound


def test_a_vector_of_environments_is_as_many_single_ones():
    vector = gymnasium.make_vec("TelloHover-v0", num_envs=3)
    first, _ = vector.reset(seed=5)
    again, _ = gymnasium.make_vec("TelloHover-v0", num_envs=3).reset(seed=5)
    assert first.shape == (3, tello_ctl.envs.OBSERVATIONS) and np.array_equal(first, again)
    # Full forward until each has left its box and started anew.
    forward = np.tile(np.float32([0, 1, 0, 0]), (3, 1))
    ended = np.zeros(3, int)
    for _ in range(600):
        observation, reward, terminated, truncated, _ = vector.step(forward)
        ended += terminated | truncated
        assert np.isfinite(observation).all() and np.isfinite(reward).all()
    assert (ended >= 2).all()
