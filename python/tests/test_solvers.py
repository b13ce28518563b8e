"""Models in Python through the native solvers."""

import numpy as np
import pytest
import tello_ctl as tc

DT = 0.04


def step(s, u, p, dt):
    x, angle, v, rate = s
    rate = rate + (9.81 * np.sin(angle) - np.cos(angle) * u[0]) / p[0] * dt
    v = v + u[0] * dt
    return [x + v * dt, angle + rate * dt, v, rate]


def observe(s):
    return s[:2]


@pytest.fixture(scope="module")
def pendulum():
    return tc.Model(step, observe, states=4, inputs=1, observations=2, parameters=1)


def test_a_traced_model_computes_what_its_function_does(pendulum):
    generator = np.random.default_rng(1)
    for _ in range(100):
        s, u, p = generator.normal(size=4), generator.normal(size=1), generator.uniform(0.2, 1.0, 1)
        expected = np.array(step(s, u, p, DT), float)
        assert np.allclose(pendulum.step(s, u, p, DT), expected, rtol=0, atol=1e-14)
        assert np.array_equal(pendulum.observe(s), s[:2])


def test_a_pendulum_is_identified_estimated_and_balanced(pendulum):
    truth = np.array([0.45])
    noise = np.random.default_rng(2)
    s, swings_u, swings_o = np.array([0.0, np.pi, 0.0, 0.0]), [], []
    for k in range(200):
        u = np.array([1.5 * np.sin(3.0 * DT * k)])
        swings_u.append(u)
        swings_o.append(s[:2] + 0.001 * noise.normal(size=2))
        s = pendulum.step(s, u, truth, DT)
    fit = tc.fit(
        pendulum, [(swings_u, swings_o)], DT, p_prior=[0.6], p_lb=[0.1], p_ub=[2.0], C_o=[500.0] * 2, C_s=[10.0] * 4
    )
    assert abs(fit.parameter[0] - 0.45) < 3e-3
    assert 0 < fit.deviation[0] < 0.01
    assert fit.converged

    mhe = tc.Mhe(
        pendulum, DT, p_prior=fit.parameter, p_lb=[0.1], p_ub=[2.0],
        C_o=[500.0] * 2, C_s=[10.0] * 4, C_p=[1000.0], window_steps=20,
    )
    mpc = tc.Mpc(
        pendulum, DT, horizon_steps=30, C_s=[1.0] * 4, C_s_end=[3.0, 30.0, 3.0, 6.0], u_lb=[-8.0], u_ub=[8.0]
    )
    goal, s, u = np.array([0.5, 0.0, 0.0, 0.0]), np.array([0.0, 0.2, 0.0, 0.0]), np.zeros(1)
    mhe.start(s[:2])
    for _ in range(250):
        assert mpc.solve(mhe.state, mhe.parameter, goal, u).has_new_plan
        u = mpc.plan[0]
        mpc.shift()
        s = pendulum.step(s, u, truth, DT)
        assert mhe.update(u, s[:2] + 0.001 * noise.normal(size=2)).converged
    assert np.linalg.norm(mhe.state - s) < 0.05
    assert np.linalg.norm(s - goal) < 0.05
    assert mpc.plan.shape == (30, 1)
    assert mpc.planned_states.shape[1] == 4


def test_a_fit_that_ends_at_its_limit_of_iterations_says_so(pendulum):
    piece = (np.ones((20, 1)), np.linspace([0.0, 3.0], [1.0, 3.2], 21))
    fit = tc.fit(pendulum, [piece], DT, p_prior=[0.6], C_o=[500.0] * 2, C_s=[10.0] * 4, solver={"iterations_max": 1})
    assert fit.iterations == 1 and not fit.converged


def test_a_parameter_that_the_data_do_not_determine_has_no_deviation():
    generator = np.random.default_rng(0)
    for _ in range(50):
        weights = np.append(generator.normal(size=3), 0.0)

        def rate(s, u, p, dt):
            # A weighted sum of three parameters, one of its own, and one that makes no difference.
            return [s[0] + dt * (np.dot(weights, p[:4]) * u[0] + p[4] * u[1])]

        model = tc.Model(rate, lambda s: s, states=1, inputs=2, observations=1, parameters=5)
        u = generator.normal(size=(generator.integers(10, 60), 2))
        s = np.concatenate([[0.0], np.cumsum(0.1 * u @ [1.5, 0.5])[:-1]])
        found = tc.fit(model, [(u, s[:, None])], 0.1, p_prior=[0.5] * 5, C_o=[100.0], C_s=[10.0], C_p=[0.0] * 5)
        assert np.isnan(found.deviation[:4]).all(), found
        assert 0.0 < found.deviation[4] < 1.0 and abs(found.parameter[4] - 0.5) < 1e-6, found
        # With a prior they are determined, each by its own weight at most.
        found = tc.fit(model, [(u, s[:, None])], 0.1, p_prior=[0.5] * 5, C_o=[100.0], C_s=[10.0], C_p=[2.0] * 5)
        assert (found.deviation > 0.0).all() and (found.deviation <= 0.5 + 1e-9).all(), found


def test_missing_observations_are_bridged(pendulum):
    mhe = tc.Mhe(pendulum, DT, p_prior=[0.45], C_p=[1e4], C_o=[500.0] * 2, C_s=[10.0] * 4)
    s = np.array([0.0, np.pi - 0.3, 0.0, 0.0])
    mhe.start(s[:2])
    for k in range(100):
        s = pendulum.step(s, [0.0], [0.45], DT)
        mhe.update([0.0], None if 60 <= k < 65 else s[:2])
        if k == 64:
            assert abs(mhe.state[1] - s[1]) < 0.02


def test_a_row_that_is_nan_is_absent(pendulum):
    settings = dict(p_prior=[0.45], C_p=[1e4], C_o=[500.0] * 2, C_s=[10.0] * 4)
    by_row, by_nan, by_none = (tc.Mhe(pendulum, DT, **settings) for _ in range(3))
    s = np.array([0.0, np.pi - 0.3, 0.0, 0.0])
    inputs, seen = [], []
    for mhe in [by_row, by_nan, by_none]:
        mhe.start(s[:2])
    for k in range(100):
        inputs.append([1.5 * np.sin(3.0 * DT * k)])
        is_hidden = 60 <= k < 65
        seen.append([np.nan if is_hidden else s[0], s[1]])
        s = pendulum.step(s, inputs[-1], [0.45], DT)
        by_row.update(inputs[-1], [np.nan if is_hidden else s[0], s[1]])
        by_nan.update(inputs[-1], [np.nan] * 2 if is_hidden else s[:2])
        by_none.update(inputs[-1], None if is_hidden else s[:2])
        assert np.array_equal(by_nan.state, by_none.state)
        if k == 64:
            assert abs(by_row.state[1] - s[1]) < min(2e-3, abs(by_none.state[1] - s[1]))
    bounds = dict(p_lb=[0.1], p_ub=[2.0], C_o=[500.0] * 2, C_s=[10.0] * 4)
    assert abs(tc.fit(pendulum, [(inputs, seen)], DT, p_prior=[0.6], **bounds).parameter[0] - 0.45) < 3e-3


def test_every_function_of_numpy_that_a_model_may_use():
    def functions(s, u, p, dt):
        x = s[0]
        terms = [np.sin(x), np.cos(x), np.tan(x), np.arcsin(x), np.arccos(x), np.arctan(x), np.sinh(x), np.cosh(x)]
        terms += [np.tanh(x), np.exp(x), np.log(x), np.sqrt(x), np.abs(x), np.square(x), x**3, 2**x, 1 / x]
        terms += [np.arctan2(x, p[0]), np.hypot(x, p[0]), -x, +x, 1 - x, 3 * x - 2, np.power(x, p[0])]
        return [s[0] + dt * (np.sum(terms) + u[0])]

    model = tc.Model(functions, lambda s: s, states=1, inputs=1, observations=1, parameters=1)
    for x in [0.2, 0.5, 0.9]:
        expected = functions(np.array([x]), np.array([0.1]), np.array([0.7]), 0.1)[0]
        assert model.step([x], [0.1], [0.7], 0.1)[0] == pytest.approx(expected, abs=1e-13)


def test_branches_are_written_as_select():
    def branch(s, u, p, dt):
        return [tc.select(s[0] > 1.0, s[0] - dt, s[0] + u[0].minimum(0.5) * dt)]

    model = tc.Model(branch, lambda s: s, states=1, inputs=1, observations=1, parameters=0)
    assert model.step([2.0], [3.0], [], 0.1)[0] == pytest.approx(1.9)
    assert model.step([0.0], [3.0], [], 0.1)[0] == pytest.approx(0.05)


def test_what_is_not_taken_may_be_infinite_or_nan():
    def model(function):
        return tc.Model(function, lambda s: s, states=1, inputs=1, observations=1, parameters=0)

    def root(s, u, p, dt):
        return [tc.select(s[0] > 0.0, np.sqrt(s[0]), 0.0)]

    for x, y in [(-1.0, 0.0), (0.0, 0.0), (4.0, 2.0)]:
        assert model(root).step([x], [0.0], [], 0.1)[0] == y
    for other in [1e20, np.inf, np.nan]:
        assert model(lambda s, u, p, dt: [tc.select(s[0] > 0.0, 1.0, other)]).step([1.0], [0.0], [], 0.1)[0] == 1.0


def test_a_tank_that_runs_dry_is_estimated_and_controlled():
    # Torricelli's law; the root has no derivative where the tank is dry.
    def tank(s, u, p, dt):
        return [s[0] + dt * (u[0] - p[0] * np.sqrt(s[0].maximum(0.0)))]

    model = tc.Model(tank, lambda s: s, states=1, inputs=1, observations=1, parameters=1)
    mhe = tc.Mhe(model, 0.1, p_prior=[0.4], C_p=[10.0], C_o=[100.0], C_s=[10.0], window_steps=5)
    mhe.start([-0.05])
    mpc = tc.Mpc(model, 0.1, u_lb=[0.0], u_ub=[1.0])
    level = -0.05
    for _ in range(20):
        mhe.update([0.0], [level])
        mpc.solve(mhe.state, mhe.parameter, [0.5])
        assert np.isfinite(mhe.state).all() and np.isfinite(mpc.plan).all()
    assert abs(mhe.state[0] - level) < 1e-3 and mpc.plan[0] > 0.5


def test_what_cannot_be_traced_says_what_to_do_instead():
    def make(function):
        return tc.Model(function, lambda s: s, states=1, inputs=1, observations=1, parameters=1)

    for function, instead in [
        (lambda s, u, p, dt: [u[0] if s[0] == 0 else s[0]], "select"),
        (lambda s, u, p, dt: [u[0] if s[0] != p[0] else s[0]], "select"),
        (lambda s, u, p, dt: [u[0] if 0 == s[0] else s[0]], "select"),
        (lambda s, u, p, dt: [u[0] if s[0] >= 0 else s[0]], "< or >"),
        (lambda s, u, p, dt: [u[0] if s[0] <= 0 else s[0]], "< or >"),
        (lambda s, u, p, dt: [np.minimum(s[0], 1.0)], r"\.minimum"),
        (lambda s, u, p, dt: np.maximum(s, 0.0), r"\.maximum"),
        (lambda s, u, p, dt: np.clip(s, -1.0, 1.0), r"\.maximum"),
        (lambda s, u, p, dt: np.sign(s), r"\.sign"),
        (lambda s, u, p, dt: [min(s[0], 1.0)], r"\.minimum"),
    ]:
        with pytest.raises(TypeError, match=instead):
            make(function)
    with pytest.raises(TypeError, match="select"):
        make(lambda s, u, p, dt: [s[0] if s[0] > 0 else -s[0]])
    with pytest.raises(TypeError, match="numpy"):
        import math

        make(lambda s, u, p, dt: [math.sin(s[0])])
    with pytest.raises(tc.TelloError, match="step: expected 1 values, returned 2"):
        make(lambda s, u, p, dt: [s[0], s[0]])
    with pytest.raises(tc.TelloError, match="at most 12 states"):
        tc.Model(step, observe, states=40, inputs=1, observations=2, parameters=1)
    other = []
    make(lambda s, u, p, dt: other.append(s[0]) or [s[0]])
    with pytest.raises(TypeError, match="another model"):
        make(lambda s, u, p, dt: [s[0] + other[0]])


def test_wrong_arguments_name_themselves(pendulum):
    mhe = tc.Mhe(pendulum, DT, p_prior=[0.5])
    mpc = tc.Mpc(pendulum, DT)
    mhe.start([0.0, 0.0])
    goal = np.zeros(4)
    for call, message in [
        (lambda: tc.Mhe(pendulum, DT), "p_prior: expected 1 values, given 0"),
        (lambda: tc.Mhe(pendulum, DT, p_prior=[0.5], C_o=[1.0]), "C_o: expected 2 values, given 1"),
        (lambda: tc.Mhe(pendulum, DT, p_prior=[0.5], C_q=[1.0]), "C_q"),
        (lambda: tc.Mhe(pendulum, DT, p_prior=[float("nan")]), "settings"),
        (lambda: tc.Mhe(pendulum, DT, p_prior=[0.5], window_steps=1), "window_steps = 1"),
        (lambda: tc.Mhe(pendulum, -1.0, p_prior=[0.5]), "dt: expected a period above 0 s, given -1"),
        (lambda: mhe.update([0.0, 1.0], [0.0, 0.0]), "u: expected 1 values, given 2"),
        (lambda: mhe.update([0.0], [np.nan, np.inf]), "o: inf is not a finite number"),
        (lambda: mhe.update([np.nan], [0.0, 0.0]), "u: NaN is not a finite number"),
        (lambda: mhe.update([0.0], [[0.0, 0.0]]), "o: expected 1 dimensions"),
        (lambda: mhe.update(["a"], [0.0, 0.0]), "u: expected numbers"),
        (lambda: mpc.solve(np.zeros(3), [0.5], goal), "state: expected 4 values, given 3"),
        (lambda: mpc.solve(np.zeros(4), [0.5], np.zeros((7, 4))), r"reference: expected shape \(25, 4\), given \(7, 4\)"),
        (lambda: tc.Mpc(pendulum, DT, u_lb=[2.0], u_ub=[1.0]), "u_"),
        (lambda: tc.fit(pendulum, [], DT, p_prior=[0.5]), "pieces: expected at least one"),
        (lambda: tc.fit(pendulum, [3], DT, p_prior=[0.5]), r"pieces\[0\]: expected a pair"),
        (lambda: tc.fit(pendulum, [(np.zeros((5, 2)), np.zeros((5, 2)))], DT, p_prior=[0.5]), "inputs: expected shape"),
        (lambda: tc.Mhe(pendulum, DT, p_prior=[0.5], C_q=[1.0]), "Mhe: .*C_q"),
        (lambda: tc.fit(pendulum, [], DT, C_q=[1.0]), "fit: .*C_q"),
        (lambda: mpc.solve(np.zeros(4), [0.5], ["a", "b"]), "reference: expected numbers"),
        (lambda: tc.Model.vehicle("boat"), "expected one of kinematic"),
    ]:
        with pytest.raises(tc.TelloError, match=message):
            call()
    # It goes on after every refusal.
    mhe.update([0.0], [0.0, 0.0])


def test_an_estimator_that_has_not_started_says_so(pendulum):
    mhe = tc.Mhe(pendulum, DT, p_prior=[0.5])
    with pytest.raises(tc.TelloError, match="start"):
        mhe.update([0.0], [0.0, 0.0])


def test_many_constructions_leave_memory_as_it_was(pendulum):
    def resident():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096

    def construct(count):
        for _ in range(count):
            model = tc.Model(step, observe, states=4, inputs=1, observations=2, parameters=1)
            tc.Mhe(model, DT, p_prior=[0.5])
            tc.Mpc(model, DT)

    construct(500)
    before = resident()
    construct(10_000)
    assert resident() - before < 4e6
