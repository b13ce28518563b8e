"""Design of the flight of `tello-ctl excite`: sums of sines for x and y that tell most about the nominal vehicle.

design.py            bounds of the built-in design, of designs that a random search finds, and of flights by hand
Needs numpy. Two minutes.

The bound of a parameter's standard deviation is the root of the diagonal of the inverse Fisher information (Ljung,
System Identification, section 13.3) of the velocities, whose disturbance is the simulator's: a first-order process of
0.05 m/s and 0.25 s. The heading is constant; poses have no noise.
"""
import numpy as np

DT = 0.02
NOMINAL = {"lambda_h": 1.9, "tau_h": 0.64, "dead_time": 0.32, "dead_zone": 0.07, "a_max": 1.1, "theta_0": -0.06}
STEPS = {"lambda_h": 0.01, "tau_h": 0.005, "dead_time": 0.01, "dead_zone": 0.005, "a_max": 0.01, "theta_0": 0.01}
DISTURBANCE_MPS, DISTURBANCE_S = 0.05, 0.25
DURATION_S = 60.0
# Reference: half width m, speed m/s, acceleration m/s^2.
LIMITS = (1.5, 1.5, 1.2)
PERIODS = ([6, 8, 13, 22], [7, 9, 14, 23])
ALTERNATIVES = [([5, 9, 14, 20], [6, 10, 15, 21]), ([4, 7, 12, 19], [5, 8, 13, 20]), ([6, 11, 23], [7, 12, 24])]
# crates/eval/src/excitation.rs: amplitudes in m, phases in rad.
BUILT_IN = (
    np.array([[0.426, 0.671, 0.041, 0.114], [1.298, 0.181, 0.064, 0.076]]),
    np.array([[2.93, 5.74, 2.14, 1.93], [3.70, 0.33, 5.16, 0.50]]),
)


def velocity(u, p):
    """Velocity of the vehicle for sticks u of shape (flights, ticks, 2): dead time, dead zone, gain, limited lag."""
    shift = p["dead_time"] / DT
    whole, part = int(shift), shift - int(shift)
    n = u.shape[1]
    padded = np.concatenate([np.zeros_like(u[:, : whole + 1]), u], axis=1)[:, : n + 1]
    applied = (1 - part) * padded[:, 1:] + part * padded[:, :-1]
    gain = p["lambda_h"] * np.sign(applied) * np.maximum(np.abs(applied) - p["dead_zone"], 0)
    c, s = np.cos(p["theta_0"]), np.sin(p["theta_0"])
    target = np.stack([c * gain[..., 0] - s * gain[..., 1], s * gain[..., 0] + c * gain[..., 1]], axis=-1)
    v, x = np.zeros_like(target), np.zeros_like(target[:, 0])
    for k in range(n):
        step = (1 - np.exp(-DT / p["tau_h"])) * (target[:, k] - x)
        size = np.linalg.norm(step, axis=-1, keepdims=True) + 1e-12
        x = x + step * np.minimum(1, p["a_max"] * DT / size)
        v[:, k] = x
    return v


def bounds(u):
    """Lower bounds of the standard deviations, shape (flights, parameters), by central differences."""
    def slope(name):
        low, high = dict(NOMINAL), dict(NOMINAL)
        low[name] -= STEPS[name]
        high[name] += STEPS[name]
        return (velocity(u, high) - velocity(u, low)) / (2 * STEPS[name])

    s = np.stack([slope(name) for name in NOMINAL], axis=-1)
    white = (np.diff(s, axis=1) / DT + s[:, 1:] / DISTURBANCE_S) / (DISTURBANCE_MPS * np.sqrt(2 / DISTURBANCE_S))
    information = np.einsum("bnap,bnaq->bpq", white, white) * DT
    weak_prior = 1e-4 * np.eye(len(NOMINAL))
    return np.sqrt(np.diagonal(np.linalg.inv(information + weak_prior), axis1=1, axis2=2))


def by_hand(duration_s, rng):
    """Sticks of four flights by hand as in the thesis: keys held for 0.3 to 1.8 s, pauses between them."""
    n = int(duration_s / DT)
    u = np.zeros((4, n, 2))
    for flight in range(4):
        for axis, pause_s in ((0, 2.0), (1, 3.0)):
            key, last, stick, left = 0, 1, 0.0, rng.exponential(pause_s)
            for k in range(n):
                left -= DT
                if left <= 0 and key == 0:
                    key = last = -last
                    left = rng.uniform(0.3, 1.8)
                elif left <= 0:
                    key, left = 0, rng.exponential(pause_s)
                stick += 0.015 * (key - stick)
                u[flight, k, axis] = stick
    return u


def reference(periods, amplitudes, phases, scaled=True):
    """Positions of designs, amplitudes of shape (designs, 2, tones), as large as LIMITS allow. m"""
    t = np.arange(int(DURATION_S / DT)) * DT
    grown = np.clip(np.minimum(t, DURATION_S - t) / 4, 0, 1)
    grown = grown**2 * (3 - 2 * grown)
    turns = 2 * np.pi * np.array(periods)[None, :, :, None] / DURATION_S * t
    x = np.moveaxis((amplitudes[..., None] * np.sin(turns + phases[..., None])).sum(2) * grown, 1, 2)
    if not scaled:
        return x
    v = np.gradient(x, DT, axis=1)
    a = np.gradient(v, DT, axis=1)
    sizes = [np.abs(x).max((1, 2)), np.linalg.norm(v, axis=-1).max(1), np.linalg.norm(a, axis=-1).max(1)]
    return x / np.max([size / limit for size, limit in zip(sizes, LIMITS)], axis=0)[:, None, None]


def sticks(x):
    """Sticks that fly x without dead time and limits, cut at 1."""
    v = np.gradient(x, DT, axis=1)
    target = v + NOMINAL["tau_h"] * np.gradient(v, DT, axis=1)
    dead = NOMINAL["dead_zone"] * np.clip(np.abs(target) / 0.02, 0, 1)
    return np.clip(np.sign(target) * (np.abs(target) / NOMINAL["lambda_h"] + dead), -1, 1)


def search(periods, rng, designs=120, generations=14, parents=6):
    """The design with the smallest geometric mean of the bounds."""
    tones = len(periods[0])
    amplitudes = np.exp(rng.normal(0, 0.4, (designs, 2, tones))) / np.array(periods)
    phases = rng.uniform(0, 2 * np.pi, (designs, 2, tones))
    best = None
    for generation in range(generations):
        found = bounds(sticks(reference(periods, amplitudes, phases)))
        order = np.argsort(np.log(found).mean(1))[:parents]
        if best is None or np.log(found[order[0]] / best).mean() < 0:
            best = found[order[0]]
        kept = [np.repeat(values[order], designs // parents, 0) for values in (amplitudes, phases)]
        amplitudes = kept[0] * np.exp(rng.normal(0, 0.15, kept[0].shape))
        phases = kept[1] + rng.normal(0, 0.4 / (1 + generation / 2), kept[1].shape)
    return best


def show(name, row):
    print(f"{name:44}" + "".join(f"{value:11.4f}" for value in row), flush=True)


def main():
    print(" " * 44 + "".join(f"{name:>11}" for name in NOMINAL))
    for duration_s in (60, 300, 368):
        show(f"by hand, {duration_s} s", bounds(by_hand(duration_s, np.random.default_rng(0))).mean(0))
    built_in = reference(PERIODS, BUILT_IN[0][None], BUILT_IN[1][None], scaled=False)
    show("built in, 60 s", bounds(sticks(built_in))[0])
    for seed, periods in enumerate([PERIODS, *ALTERNATIVES]):
        show(f"found {periods[0]} {periods[1]}", search(periods, np.random.default_rng(seed)))


if __name__ == "__main__":
    main()
