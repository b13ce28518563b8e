"""Packaged solvers of quadratic programs on the subproblems of our controller.

    qp.py FILE daqp|osqp|piqp

FILE: `problems horizon`, then per problem p, s_0, s_ref and the inputs u_0 .. u_{L-1} around which the problem is
linearized. DAQP gets the condensed problem over the inputs alone, OSQP and PIQP the sparse one over inputs and
states, updated in place; OSQP starts from its last solution. Linearizing and
condensing are not timed: what counts are the solvers' own timers of update (DAQP: set-up) and solution. Prints per
problem the time in ns, the iterations and the change of the cost.
"""

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


class Problem:
    """One subproblem: dynamics by step, gradients, room of the inputs."""

    def __init__(self, p, s_0, s_ref, u):
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


def inputs(z):
    """The inputs among inputs and states."""
    return z.reshape(-1, 8)[:, :4].ravel()


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
        p, q, a = problem.sparse()
        low, high = problem.boxes(np.inf)
        zeros = np.zeros(a.shape[0])
        whole = sparse.vstack([a, sparse.eye(a.shape[1])], format="csc")
        l, u = np.concatenate([zeros, low]), np.concatenate([zeros, high])
        if solver is None:
            solver = osqp.OSQP()
            solver.setup(p, q, whole, l, u, verbose=False, eps_abs=TOLERANCE, eps_rel=TOLERANCE,
                         polishing=True, warm_starting=True)
        else:
            solver.update(q=q, l=l, u=u, Ax=whole.data)
        result = solver.solve()
        info = result.info
        return (info.update_time + info.run_time) * 1e9, info.iter, inputs(result.x)

    return solve


def piqp_solver():
    import piqp

    solver = None

    def solve(problem):
        nonlocal solver
        p, q, a = problem.sparse()
        low, high = problem.boxes(1e30)
        b = np.zeros(a.shape[0])
        if solver is None:
            solver = piqp.SparseSolver()
            solver.settings.compute_timings = True
            solver.settings.preconditioner_reuse_on_update = True
            solver.settings.eps_abs = solver.settings.eps_rel = TOLERANCE
            solver.setup(p, q, a, b, None, None, None, low, high)
            before = solver.result.info.setup_time
        else:
            solver.update(c=q, A=a, b=b, x_l=low, x_u=high)
            before = solver.result.info.update_time
        solver.solve()
        info = solver.result.info
        return (before + info.solve_time) * 1e9, info.iter, inputs(np.array(solver.result.x))

    return solve


def main():
    path, name = sys.argv[1:]
    with open(path, encoding="ascii") as file:
        count, steps = map(int, file.readline().split())
        values = np.array(file.read().split(), dtype=float).reshape(count, 12 + 4 * steps)
    solve = {"daqp": daqp_solver, "osqp": osqp_solver, "piqp": piqp_solver}[name]()
    for row in values:
        problem = Problem(row[:4], row[4:8], row[8:12], row[12:].reshape(-1, 4))
        ns, iterations, du = solve(problem)
        hessian, f = problem.condensed()
        print(ns, iterations, 0.5 * du @ hessian @ du + f @ du)


if __name__ == "__main__":
    main()
