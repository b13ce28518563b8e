"""Packaged solvers of quadratic programs on the subproblems of our controller.

    qp.py FILE daqp|hpipm|osqp|piqp [walls]

FILE: `problems horizon`, then per problem p, s_0, s_ref and the inputs u_0 .. u_{L-1} around which the problem is
linearized. DAQP gets the condensed problem over the inputs alone, OSQP and PIQP the sparse one over inputs and
states, updated in place; OSQP starts from its last solution. Linearizing and
condensing are not timed: what counts are the solvers' own timers of update (DAQP: set-up) and solution. Prints per
problem the time in ns, the iterations and the change of the cost.

With `walls` each state is penalized by 1/2 w max(0, excess)^2 for each wall: a slack variable each. HPIPM gets that problem by
CasADi with the slack variables as inputs of their stage; its time is the processor's in CasADi's call, conversions included.
"""

import contextlib
import os
import sys

import numpy as np
from scipy import sparse

DT_S = 0.02
# Weights multiply residuals.
C_U = np.array([1.2, 1.2, 0.8, 0.8])
C_S = np.array([1.5, 1.5, 1.0, 1.0])
C_S_END = np.array([15.0, 15.0, 10.0, 10.0])
U_MAX = np.array([0.8, 0.8, 1.0, 1.0])
TOLERANCE = 1e-6
# Row of the state, outward direction, wall along it; squared weight.
WALLS = [(0, 1.0, 1.4), (0, -1.0, -0.1), (1, 1.0, 1.4), (1, -1.0, -0.1)]
WALL_WEIGHT = 1e4


class Problem:
    """One subproblem: dynamics by step, gradients, room of the inputs."""

    def __init__(self, p, s_0, s_ref, u, has_walls):
        steps = len(u)
        self.a, self.b = np.zeros((steps, 4, 4)), np.zeros((steps, 4, 4))
        self.s_weight = np.tile(C_S**2, (steps, 1))
        self.s_weight[-1] = C_S_END**2
        s, states = s_0, []
        for k, (roll, pitch, yaw, throttle) in enumerate(u):
            c, d = np.cos(s[3] + p[3]), np.sin(s[3] + p[3])
            h = DT_S * p[0]
            dx, dy = h * (c * pitch + d * roll), h * (d * pitch - c * roll)
            self.a[k] = np.eye(4)
            self.a[k, 0, 3], self.a[k, 1, 3] = -dy, dx
            self.b[k, 0, :2], self.b[k, 1, :2] = (h * d, h * c), (-h * c, h * d)
            self.b[k, 2, 3], self.b[k, 3, 2] = DT_S * p[1], DT_S * p[2]
            s = s + np.array([dx, dy, DT_S * p[1] * throttle, DT_S * p[2] * yaw])
            states.append(s)
        self.s_gradient = self.s_weight * (np.array(states) - s_ref)
        walls = WALLS if has_walls else []
        self.wall_rows = np.array([np.eye(4)[row] * outwards for row, outwards, _ in walls]).reshape(-1, 4)
        self.excess = np.array(states) @ self.wall_rows.T - np.array([wall for _, _, wall in walls])
        self.u_gradient = C_U**2 * u
        self.low, self.high = (-U_MAX - u).ravel(), (U_MAX - u).ravel()

    def boxes(self, infinity):
        """Bounds of u_0, s_1, u_1, s_2, ..; those of the states are infinite."""
        high = np.full((len(self.a), 8), infinity)
        low = -high
        low[:, :4], high[:, :4] = self.low.reshape(-1, 4), self.high.reshape(-1, 4)
        return low.ravel(), high.ravel()

    def condensed(self):
        """Hessian and gradient over the inputs."""
        steps = len(self.a)
        by_u = np.zeros((4 * steps, 4 * steps))
        row = np.zeros((4, 4 * steps))
        for k in range(steps):
            row = self.a[k] @ row
            row[:, 4 * k : 4 * k + 4] = self.b[k]
            by_u[4 * k : 4 * k + 4] = row
        hessian = by_u.T @ (self.s_weight.ravel()[:, None] * by_u) + np.diag(np.tile(C_U**2, steps))
        return hessian, by_u.T @ self.s_gradient.ravel() + self.u_gradient.ravel()

    def sparse(self):
        """P, q, equality matrix over u_0, s_1, u_1, s_2, .. with every entry of A and B kept."""
        steps = len(self.a)
        diagonal = np.concatenate([np.tile(C_U**2, (steps, 1)), self.s_weight], axis=1).ravel()
        q = np.concatenate([self.u_gradient, self.s_gradient], axis=1).ravel()
        rows, columns, values = [], [], []

        def put(block, row, column):
            for i in range(4):
                for j in range(4):
                    rows.append(row + i)
                    columns.append(column + j)
                    values.append(block[i, j])

        for k in range(steps):
            put(self.b[k], 4 * k, 8 * k)
            if k > 0:
                put(self.a[k], 4 * k, 8 * k - 4)
            for i in range(4):
                rows.append(4 * k + i)
                columns.append(8 * k + 4 + i)
                values.append(-1.0)
        shape = (4 * steps, 8 * steps)
        return sparse.diags(diagonal, format="csc"), q, sparse.csc_matrix((values, (rows, columns)), shape)

    def slacks(self):
        """The problem of `sparse` with a slack variable for each wall behind it, and rows of `g ds - slack <= -excess`."""
        p, q, a = self.sparse()
        steps, count = len(self.a), self.excess.size
        select = sparse.kron(sparse.eye(steps), np.hstack([np.zeros((len(self.wall_rows), 4)), self.wall_rows]))
        g = sparse.hstack([select, -sparse.eye(count)], format="csc")
        p = sparse.block_diag([p, WALL_WEIGHT * sparse.eye(count)], format="csc")
        a = sparse.hstack([a, sparse.csc_matrix((a.shape[0], count))], format="csc")
        return p, np.concatenate([q, np.zeros(count)]), a, g, -self.excess.ravel()

    def cost(self, du):
        """By how much the cost changes."""
        ds, cost = np.zeros(4), 0.0
        for k, du_k in enumerate(du.reshape(-1, 4)):
            ds = self.a[k] @ ds + self.b[k] @ du_k
            cost += du_k @ (0.5 * C_U**2 * du_k + self.u_gradient[k]) + ds @ (0.5 * self.s_weight[k] * ds + self.s_gradient[k])
            after = np.maximum(self.excess[k] + self.wall_rows @ ds, 0.0)
            cost += 0.5 * WALL_WEIGHT * (after @ after - np.maximum(self.excess[k], 0.0) @ np.maximum(self.excess[k], 0.0))
        return cost


def inputs(z, steps):
    """The inputs among inputs, states and slack variables."""
    return z[: 8 * steps].reshape(-1, 8)[:, :4].ravel()


def daqp_solver():
    import daqp
    from ctypes import c_double

    def solve(problem):
        hessian, f = problem.condensed()
        count = len(f)
        sense = np.zeros(count, dtype=np.intc)
        none = np.zeros((0, count), dtype=c_double)
        du, _, flag, info = daqp.solve(hessian, f, none, problem.high, problem.low, sense)
        assert flag == 1, flag
        return (info["setup_time"] + info["solve_time"]) * 1e9, info["iterations"], np.array(du)

    return solve


def osqp_solver():
    import osqp

    solver = None

    def solve(problem):
        nonlocal solver
        p, q, a, g, h = problem.slacks()
        low, high = problem.boxes(np.inf)
        zeros = np.zeros(a.shape[0])
        whole = sparse.vstack([a, sparse.eye(len(low), a.shape[1]), g], format="csc")
        l, u = np.concatenate([zeros, low, np.full(len(h), -np.inf)]), np.concatenate([zeros, high, h])
        if solver is None:
            solver = osqp.OSQP()
            solver.setup(p, q, whole, l, u, verbose=False, eps_abs=TOLERANCE, eps_rel=TOLERANCE,
                         polishing=True, warm_starting=True)
        else:
            solver.update(q=q, l=l, u=u, Ax=whole.data)
        result = solver.solve()
        info = result.info
        return (info.update_time + info.run_time) * 1e9, info.iter, inputs(result.x, len(problem.a))

    return solve


def piqp_solver():
    import piqp

    solver = None

    def solve(problem):
        nonlocal solver
        p, q, a, g, h = problem.slacks()
        low, high = (np.concatenate([side, np.full(len(h), sign)]) for side, sign in zip(problem.boxes(1e30), (-1e30, 1e30)))
        b = np.zeros(a.shape[0])
        walls = (g, None, h) if len(h) else (None, None, None)
        if solver is None:
            solver = piqp.SparseSolver()
            solver.settings.compute_timings = True
            solver.settings.preconditioner_reuse_on_update = True
            solver.settings.eps_abs = solver.settings.eps_rel = TOLERANCE
            solver.setup(p, q, a, b, *walls, low, high)
            before = solver.result.info.setup_time
        else:
            solver.update(c=q, A=a, b=b, h_u=h if len(h) else None, x_l=low, x_u=high)
            before = solver.result.info.update_time
        solver.solve()
        info = solver.result.info
        return (before + info.solve_time) * 1e9, info.iter, inputs(np.array(solver.result.x), len(problem.a))

    return solve


@contextlib.contextmanager
def silent():
    """Without what a library prints."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    yield
    os.dup2(kept, 1)
    os.close(kept)
    os.close(nowhere)


def hpipm_solver():
    import casadi

    solver = None

    def solve(problem):
        nonlocal solver
        # Stage k: ds_k, then du_k (not the last) and the slack variables of ds_k (not the first). Only a stage that is not the last
        # one has inputs: an empty one follows.
        steps, walls = len(problem.a), len(problem.wall_rows)
        nx = [4] * (steps + 1) + [0]
        nu = [4] + [4 + walls] * (steps - 1) + [walls, 0]
        ng = [0] + [walls] * steps + [0]
        starts = np.cumsum([0] + [x + u for x, u in zip(nx, nu)])
        count = starts[-1]
        hessian, gradient = np.zeros(count), np.zeros(count)
        low, high = np.full(count, -np.inf), np.full(count, np.inf)
        low[:4] = high[:4] = 0.0
        rows, lower, upper = [], [], []
        for k in range(steps + 1):
            x, u = starts[k], starts[k] + 4
            slack = u
            if k < steps:
                slack = u + 4
                hessian[u:slack], gradient[u:slack] = C_U**2, problem.u_gradient[k]
                low[u:slack], high[u:slack] = problem.low[4 * k : 4 * k + 4], problem.high[4 * k : 4 * k + 4]
                block = np.zeros((4, count))
                block[:, x:u], block[:, u:slack] = problem.a[k], problem.b[k]
                block[:, starts[k + 1] : starts[k + 1] + 4] = -np.eye(4)
            if k > 0:
                hessian[x:u], gradient[x:u] = problem.s_weight[k - 1], problem.s_gradient[k - 1]
                hessian[slack : slack + walls] = WALL_WEIGHT
            else:
                hessian[x:u] = 1.0
            if k < steps:
                rows.append(block)
                lower.append(np.zeros(4))
                upper.append(np.zeros(4))
            if k > 0:
                block = np.zeros((walls, count))
                block[:, x:u], block[:, slack : slack + walls] = problem.wall_rows, -np.eye(walls)
                rows.append(block)
                lower.append(np.full(walls, -np.inf))
                upper.append(-problem.excess[k - 1])
        h, a = casadi.DM(casadi.Sparsity.diag(count), hessian), casadi.DM(sparse.csc_matrix(np.vstack(rows)))
        if solver is None:
            sizes = {"N": steps + 1, "nx": nx, "nu": nu, "ng": ng}
            tolerances = {f"res_{name}_max": TOLERANCE for name in "gbdm"}
            structure = {"h": h.sparsity(), "a": a.sparsity()}
            solver = casadi.conic("solver", "hpipm", structure, {**sizes, "hpipm": tolerances, "error_on_fail": False})
        bounds = {"lbx": low, "ubx": high, "lba": np.concatenate(lower), "uba": np.concatenate(upper)}
        with silent():
            answer = solver(h=h, g=gradient, a=a, **bounds)
        stats = solver.stats()
        z = np.array(answer["x"]).ravel()
        du = np.concatenate([z[starts[k] + 4 : starts[k] + 8] for k in range(steps)])
        return stats["t_proc_solver"] * 1e9, stats["iter_count"], du

    return solve


def main():
    path, name, *walls = sys.argv[1:]
    with open(path, encoding="ascii") as file:
        count, steps = map(int, file.readline().split())
        values = np.array(file.read().split(), dtype=float).reshape(count, 12 + 4 * steps)
    solve = {"daqp": daqp_solver, "hpipm": hpipm_solver, "osqp": osqp_solver, "piqp": piqp_solver}[name]()
    for row in values:
        problem = Problem(row[:4], row[4:8], row[8:12], row[12:].reshape(-1, 4), bool(walls))
        ns, iterations, du = solve(problem)
        print(ns, iterations, problem.cost(du))


if __name__ == "__main__":
    main()
