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
    with pytest.raises(tc.TelloError, match=r"seeds\[1\]: expected a whole number in 0\.\..*, given -1"):
        tc.Simulators([1, -1])
    with pytest.raises(tc.TelloError, match="controllers: expected numbers below 1, given 7"):
        tc.Controllers(1).reset([7])
    with pytest.raises(tc.TelloError, match="settings: .*windy"):
        tc.Simulators([1], {"windy": 1})


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


def with_seeds(task, seeds, **settings):
    """Environments that take their episodes' seeds from these lists, one for each environment."""
    environments = tello_ctl.envs.TelloVectorEnv(len(seeds), task=task, **settings)
    left = [list(of) for of in seeds]

    def draw(count):
        over = getattr(environments, "_over", np.ones(len(seeds), bool))
        return [left[row].pop(0) for row in np.flatnonzero(over)]

    environments._seeds = draw
    return environments


def test_a_vector_of_environments_is_as_many_single_ones():
    seeds = [range(first, 60, 3) for first in range(3)]
    vector = with_seeds("track", seeds)
    singles = [with_seeds("track", [of]) for of in seeds]
    first, _ = vector.reset()
    assert first.shape == (3, tello_ctl.envs.OBSERVATIONS)
    assert np.array_equal(first, np.concatenate([single.reset()[0] for single in singles]))
    # At three paces, until each has left its box and started anew.
    sticks = np.float32([[0, 1, 0, 0], [0, 0.8, 0, 0], [0.9, 0, 0.2, 0]])
    ended = np.zeros(3, int)
    for _ in range(600):
        *stepped, info = vector.step(sticks)
        alone = [single.step(sticks[row : row + 1]) for row, single in enumerate(singles)]
        for position, together in enumerate(stepped):
            assert np.array_equal(together, np.concatenate([one[position] for one in alone])), position
        for name, together in info.items():
            assert np.array_equal(together, np.concatenate([one[4][name] for one in alone])), name
        ended += stepped[2] | stepped[3]
    assert (ended >= 2).all(), ended


def test_an_episode_begins_alike_after_a_reset_and_after_another_episode():
    def begun(seed):
        environments = with_seeds("square", [[seed, seed]], max_episode_steps=2)
        neutral = np.zeros((1, 4))
        fresh, _ = environments.reset()
        first, second = environments.step(neutral), environments.step(neutral)
        assert second[3][0], "the episode is over"
        again, reward, terminated, truncated, info = environments.step(neutral)
        assert np.array_equal(again, fresh)
        assert reward[0] == 0.0 and info["corners"][0] == 0 and not terminated[0] and not truncated[0]
        for step in (first, second):
            assert all(map(np.array_equal, step[:4], environments.step(neutral)))
        return first[4]["corners"][0], first[1][0]

    corners, rewards = zip(*[begun(seed) for seed in range(20)])
    # Some begin at the first corner and are paid for it.
    assert 0 < sum(corners) < 20
    assert all((reward > 0.9) == (reached == 1) for reached, reward in zip(corners, rewards))


def test_the_expert_flies_the_square_from_every_start():
    count = 64
    environments = tello_ctl.envs.TelloVectorEnv(count, task="square", profile="clean")
    environments.reset(seed=1)
    corners, done = np.zeros(count, int), np.zeros(count, bool)
    for _ in range(1000):
        _, _, terminated, truncated, info = environments.step(environments.expert_action())
        corners[~done] = info["corners"][~done]
        done |= terminated | truncated
        if done.all():
            break
    assert (corners == 5).all(), np.bincount(corners)


@pytest.mark.parametrize(("task", "steps"), [("hover", 3700), ("track", 1700)])
def test_the_expert_flies_as_long_as_the_episode(task, steps):
    env = tello_ctl.envs.TelloVectorEnv(1, task=task, profile="clean", max_episode_steps=steps)
    env.reset(seed=1)
    for _ in range(steps):
        _, _, terminated, truncated, info = env.step(env.expert_action())
        assert not terminated[0]
    assert truncated[0] and info["distance"][0] < 0.1


def test_wrong_actions_are_refused():
    environments = tello_ctl.envs.TelloVectorEnv(8)
    environments.reset(seed=1)
    for shape in [(4, 8), (8, 3), (32,), (8, 4, 1)]:
        with pytest.raises(tc.TelloError, match="actions: expected"):
            environments.step(np.zeros(shape))
    with pytest.raises(tc.TelloError, match="task: expected one of"):
        tello_ctl.envs.TelloVectorEnv(1, task="race")
