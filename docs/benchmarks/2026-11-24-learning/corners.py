#!/usr/bin/env python3
"""Errors of a yaw axis identified with rounded corners of the dead zone, by least squares. Needs numpy."""

import numpy as np

DT_S = 0.02
TRUTH = np.array([1.43, 0.12, 0.08, 0.04])  # gain rad/s, lag s, dead zone 1, dead time s
RNG = np.random.default_rng(1)


def sticks(steps):
    """Keys by hand, smoothed."""
    key, stick, left_s, out = 0.0, 0.0, RNG.exponential(2.0), []
    for _ in range(steps):
        left_s -= DT_S
        if left_s <= 0 and key == 0:
            key, left_s = RNG.choice([-1, 1]), RNG.uniform(0.3, 1.8)
        elif left_s <= 0:
            key, left_s = 0.0, RNG.exponential(2.0)
        stick += (key - stick) * 0.015
        out.append(stick)
    return np.array(out)


def excess(u, dead, width):
    return u + 0.5 * (np.hypot(u - dead, width) - np.hypot(u + dead, width))


def heading(u, gain, tau_s, dead, dead_time_s, width):
    steps = dead_time_s / DT_S
    late = [np.r_[np.zeros(n), u[: len(u) - n]] for n in (int(steps), int(steps) + 1)]
    target = gain * excess((1 - steps % 1) * late[0] + steps % 1 * late[1], dead, width)
    rate, rates = 0.0, np.empty(len(u))
    for k, wanted in enumerate(target):
        rate += (1 - np.exp(-DT_S / tau_s)) * (wanted - rate)
        rates[k] = rate
    return np.r_[0, np.cumsum(rates)[:-1] * DT_S]


def fit(flights, width):
    """Estimate and standard deviations; each 6 s have an offset of their own."""
    p = np.array([1.4, 0.12, 0.08, 0.045])
    centred = lambda values: np.concatenate([v - v.mean() for v in np.split(values[:4500], 15)])
    for _ in range(8):
        residuals, jacobian = [], []
        for u, y in flights:
            at = heading(u, *p, width)
            residuals.append(centred(y - at))
            jacobian.append(np.array([centred(heading(u, *(p + d), width) - at) / 1e-5 for d in 1e-5 * np.eye(4)]).T)
        r, j = np.concatenate(residuals), np.concatenate(jacobian)
        p = p + np.linalg.solve(j.T @ j, j.T @ r)
    return p, np.sqrt(np.diag(np.linalg.inv(j.T @ j)) * r.var())


inputs = [sticks(4600) for _ in range(4)]
print("width  errors of gain, lag, dead zone, dead time; standard deviations")
for width in (0.01, 0.005, 0.002, 0.0):
    flights = [(u, heading(u, *TRUTH, 0.0) + 3e-3 * RNG.standard_t(3, len(u))) for u in inputs]
    p, std = fit(flights, width)
    print(width, np.round(p - TRUTH, 5), np.round(std, 5))
