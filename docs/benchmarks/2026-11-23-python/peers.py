"""Our solvers and environments beside those of others, from Python.

    pip install target/wheels/tello_ctl-*.whl casadi==3.8.2 do-mpc==5.1.2 crazyflow==0.4.0 gymnasium==1.4.0
    python peers.py solvers
    python peers.py environments

`solvers`: the optimal control problem of the notebook `pendulum` (30 stages, bounded input) for the 250 states that our
controller flies through. Every solver starts from its own shifted plan. The processor's time of a state is the shortest
of PASSES flights; median and 95 % are those of all states. Costs of the planned inputs are computed anew, divided by
ours, less 1; the last column counts the states in which ours is higher by more than 1e-6.

`environments`: 4,096 drones hover on the CPU, both sides in turn, random actions. `DroneReachPos-v0` of crazyflow has no
dead time, no motion capture and no faults; its step lasts 2 ms, or 20 ms like ours (`freq=50`).
"""

import sys
import time
import warnings

import numpy as np

DT, STAGES, LENGTH, STATES, PASSES = 0.04, 30, 0.45, 250, 5
WEIGHT, WEIGHT_END, WEIGHT_INPUT, LIMIT = np.ones(4), np.array([3.0, 30.0, 3.0, 6.0]), 0.1, 8.0
GOAL = np.array([0.5, 0.0, 0.0, 0.0])
DRONES, STEPS, ROUNDS = 4096, 50, 15


def step(s, u, length, dt, lib=np):
    x, angle, v, rate = s[0], s[1], s[2], s[3]
    rate = rate + (9.81 * lib.sin(angle) - lib.cos(angle) * u) / length * dt
    v = v + u * dt
    return [x + v * dt, angle + rate * dt, v, rate]


def cost(s, plan):
    total = 0.0
    for k, u in enumerate(np.clip(plan, -LIMIT, LIMIT)):
        s = np.array(step(s, u, LENGTH, DT))
        weight = WEIGHT_END if k == STAGES - 1 else WEIGHT
        total += 0.5 * (WEIGHT_INPUT * u) ** 2 + 0.5 * np.sum((weight * (s - GOAL)) ** 2)
    return total


def timed(call):
    # The processor's time, which neighbours on the machine change less.
    start = time.process_time()
    result = call()
    return time.process_time() - start, result


def passes(start, solve, states):
    """Shortest time of each state and its plan; `start` makes a new solver, `solve(solver, s)` a plan."""
    times, plans = np.full(len(states), np.inf), []
    for _ in range(PASSES):
        solver = start()
        plans = []
        for k, s in enumerate(states):
            took, plan = timed(lambda: solve(solver, s))
            times[k] = min(times[k], took)
            plans.append(np.asarray(plan, dtype=float).ravel()[:STAGES])
    return times, np.array([cost(s, plan) for s, plan in zip(states, plans)])


class Ours:
    def __init__(self):
        import tello_ctl as tc

        own = lambda s, u, p, dt: step(s, u[0], p[0], dt)
        self.model = tc.Model(own, lambda s: s[:2], states=4, inputs=1, observations=2, parameters=1)
        ends = {"C_s_end": list(WEIGHT_END), "u_lb": [-LIMIT], "u_ub": [LIMIT]}
        self.mpc = tc.Mpc(self.model, DT, horizon_steps=STAGES, **ends)
        self.p, self.u = np.array([LENGTH]), np.zeros(1)

    def solve(self, s):
        self.mpc.solve(s, self.p, GOAL, self.u)
        plan = self.mpc.plan
        self.u = plan[0]
        self.mpc.shift()
        return plan

    def states(self):
        s, states = np.array([0.0, 0.2, 0.0, 0.0]), []
        for k in range(STATES):
            states.append(s.copy())
            u = self.solve(s)[0]
            s = np.asarray(self.model.step(s, u, self.p, DT))
            # Without it the last states would be equal.
            s = s + 0.002 * np.sin([3.1 * k, 5.3 * k, 7.7 * k, 9.1 * k])
        return states


class Casadi:
    """Multiple shooting; variables in the order of the stages, as fatrop wants them."""

    def __init__(self, solver, options):
        import casadi as ca

        s0, s = ca.SX.sym("s0", 4), ca.SX.sym("s_0", 4)
        w, lower, g, total = [s], [-np.inf] * 4, [], 0
        for k in range(STAGES):
            u, s_next = ca.SX.sym(f"u_{k}"), ca.SX.sym(f"s_{k + 1}", 4)
            g.append(s_next - ca.vertcat(*step(s, u, LENGTH, DT, ca)))
            g += [w[0] - s0] if k == 0 else []
            weight = WEIGHT_END if k == STAGES - 1 else WEIGHT
            total += 0.5 * (WEIGHT_INPUT * u) ** 2 + 0.5 * ca.sumsqr(weight * (s_next - GOAL))
            w += [u, s_next]
            lower += [-LIMIT] + [-np.inf] * 4
            s = s_next
        if solver == "fatrop":
            equal = [True] * (4 * STAGES + 4)
            options = dict(options, structure_detection="auto", equality=equal)
        problem = {"x": ca.vertcat(*w), "f": total, "g": ca.vertcat(*g), "p": s0}
        self.solver = ca.nlpsol("solver", solver, problem, dict(options, print_time=False, expand=True))
        self.lower, self.start = np.array(lower), np.zeros(len(lower))

    def restart(self):
        self.start = np.zeros(len(self.lower))
        return self

    def solve(self, s):
        found = self.solver(x0=self.start, p=s, lbx=self.lower, ubx=-self.lower, lbg=0, ubg=0)
        x = np.array(found["x"]).ravel()
        self.start = np.concatenate([x[5:], x[-5:]])
        return x[4::5]


class DoMpc:
    def __init__(self):
        import casadi as ca
        import do_mpc

        model = do_mpc.model.Model("discrete", "SX")
        s, u = model.set_variable("_x", "s", (4, 1)), model.set_variable("_u", "u")
        model.set_rhs("s", ca.vertcat(*step([s[i] for i in range(4)], u, LENGTH, DT, ca)))
        model.setup()
        self.mpc = mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon, mpc.settings.t_step = STAGES, DT
        mpc.settings.store_full_solution = False
        mpc.settings.supress_ipopt_output()
        # The cost of the first state, which no plan changes, is included.
        stage = 0.5 * ca.sumsqr(WEIGHT * (s - GOAL)) + 0.5 * (WEIGHT_INPUT * u) ** 2
        mpc.set_objective(mterm=0.5 * ca.sumsqr(WEIGHT_END * (s - GOAL)), lterm=stage)
        mpc.set_rterm(u=0.0)
        mpc.bounds["lower", "_u", "u"], mpc.bounds["upper", "_u", "u"] = -LIMIT, LIMIT
        mpc.setup()
        mpc.x0 = np.array([0.0, 0.2, 0.0, 0.0])
        mpc.set_initial_guess()

    def solve(self, s):
        self.mpc.make_step(s.reshape(4, 1))
        return self.mpc.opt_x_num["_u", :, 0]


def solvers():
    states = Ours().states()
    times, ours = passes(Ours, Ours.solve, states)
    own = np.median(times)

    def show(name, times, costs):
        ratio = costs / ours - 1.0
        print(
            f"| {name} | {1e6 * np.median(times):.0f} | {1e6 * np.percentile(times, 95):.0f} "
            f"| {np.median(times) / own:.0f} | {np.median(ratio):.0e} | {ratio.min():.0e} to {ratio.max():.0e} "
            f"| {np.sum(ratio < -1e-6)} |",
            flush=True,
        )

    print("| solver | median, us | 95 %, us | times ours | cost, median | cost, all | ours higher |")
    print("|---|---|---|---|---|---|---|")
    show("ours", times, ours)
    quiet = {"print_header": False, "print_iteration": False, "print_status": False}
    qrqp = {"print_time": False, "print_iter": False, "print_header": False}
    for name, solver, options in [
        ("CasADi SQP, qrqp", "sqpmethod", dict(quiet, qpsol="qrqp", qpsol_options=qrqp)),
        ("CasADi, fatrop", "fatrop", {"fatrop": {"print_level": 0}}),
        (
            "CasADi SQP, HPIPM",
            "sqpmethod",
            dict(quiet, qpsol="hpipm", qpsol_options={"print_time": False}, convexify_strategy="regularize"),
        ),
        ("CasADi, IPOPT", "ipopt", {"ipopt": {"print_level": 0, "sb": "yes"}}),
    ]:
        peer = Casadi(solver, options)
        show(name, *passes(peer.restart, Casadi.solve, states))
    show("do-mpc", *passes(DoMpc, DoMpc.solve, states))


def environments():
    import crazyflow.envs  # noqa: F401
    import gymnasium
    import jax
    import tello_ctl.envs  # noqa: F401

    random = np.random.default_rng(0)
    ours = gymnasium.make_vec("TelloHover-v0", num_envs=DRONES, profile="clean")
    sides = {"ours, 20 ms": (ours, None)}
    for freq in (50, 500):
        peer = gymnasium.make_vec("DroneReachPos-v0", num_envs=DRONES, freq=freq, device="cpu")
        sides[f"crazyflow, {1000 // freq} ms"] = (peer, jax.block_until_ready)
    rates = {name: [] for name in sides}
    actions = {}
    for name, (envs, _) in sides.items():
        envs.reset(seed=1)
        space = envs.single_action_space
        actions[name] = random.uniform(space.low, space.high, (16, DRONES, 4)).astype(np.float32)
    for attempt in range(ROUNDS + 1):
        for name, (envs, ready) in sides.items():
            start, used = time.perf_counter(), time.process_time()
            for k in range(STEPS):
                result = envs.step(actions[name][k % 16])
                if ready:
                    ready(result[:4])
            took = time.perf_counter() - start, time.process_time() - used
            # The first round compiles.
            if attempt:
                rates[name].append(1e-6 * DRONES * STEPS / np.array(took))
    print("| environments | median, million steps/s | best | median, million steps per s of one core |")
    print("|---|---|---|---|")
    for name, rate in rates.items():
        (mid, core), best = np.median(rate, axis=0), np.max(rate, axis=0)[0]
        print(f"| {name} | {mid:.2f} | {best:.2f} | {core:.2f} |")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    {"solvers": solvers, "environments": environments}[sys.argv[1]]()
