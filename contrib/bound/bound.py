"""Least time of a mission by optimal control: direct transcription, solved by Ipopt.

The horizontal vehicle of the model `lagged` without dead time, disturbance and estimation: acceleration
piecewise constant, |a| <= a_max, and the velocity that the sticks ask for, v + tau a, within full stick on
each body axis. The heading is that of the mission. The flight begins at rest at the first waypoint; its time ends
within `reach` of the last one, after which the vehicle must come to rest there without leaving `reach`.

Three problems for each mission:
  limits  speed and acceleration of the mission file, no lag, within the tube
  tube    the vehicle's limits, at most --tube from the path, corners within a disc of that radius
  reach   the vehicle's limits, each waypoint within its `reach`, no tube. A circle has no waypoints on the way: tube
          of `reach`.
A solution is a local minimum; the transcription is refined by --steps.
"""

import argparse
import json
import math
import pathlib
import sys
import time

import casadi as ca
import numpy as np

# Rows of `p_prior` of the model `lagged`.
LAMBDA_H, THETA_0, TAU_H, DEAD_H, A_MAX = 0, 3, 4, 7, 10


class Vehicle:
    """Limits of the horizontal motion; `tau_s` None: no lag, speed limited by its norm."""

    def __init__(self, speed_mps, accel_mps2, tau_s=None, axes_rad=0.0):
        self.speed_mps, self.accel_mps2, self.tau_s = speed_mps, accel_mps2, tau_s
        c, s = math.cos(axes_rad), math.sin(axes_rad)
        self.to_body = ca.DM([[c, s], [-s, c]])

    def limit(self, opti, v, v_next, a):
        opti.subject_to(ca.sumsqr(a) <= self.accel_mps2**2)
        if self.tau_s is None:
            opti.subject_to(ca.sumsqr(v_next) <= self.speed_mps**2)
            return
        for velocity in (v, v_next):  # linear in between
            asked = self.to_body @ (velocity + self.tau_s * a)
            opti.subject_to(opti.bounded(-self.speed_mps, asked, self.speed_mps))


class Flight:
    """A transcription that grows node by node."""

    def __init__(self, vehicle, start):
        self.opti, self.vehicle = ca.Opti(), vehicle
        self.p, self.v = ca.DM(start), ca.DM([0, 0])
        self.points, self.speeds, self.durations = [self.p], [self.v], []
        self.cost = 0

    def duration(self, guess_s, weight=1.0):
        h = self.opti.variable()
        self.opti.subject_to(h >= 1e-4)
        self.opti.set_initial(h, guess_s)
        return h, weight

    def step(self, h, weight, guess, guess_v):
        opti = self.opti
        p, v, a = opti.variable(2), opti.variable(2), opti.variable(2)
        opti.subject_to(p == self.p + h * self.v + h**2 / 2 * a)
        opti.subject_to(v == self.v + h * a)
        self.vehicle.limit(opti, self.v, v, a)
        opti.set_initial(p, guess)
        opti.set_initial(v, guess_v)
        self.cost += weight * h
        if weight == 1.0:
            self.durations.append(h)
        self.p, self.v = p, v
        self.points.append(p)
        self.speeds.append(v)

    def stop(self, end, along, reach, tube, steps):
        """Comes to rest at `end`; the time after the finish weighs next to nothing."""
        h, weight = self.duration(0.8 / steps, 1e-3)
        for _ in range(steps):
            self.step(h, weight, end, [0, 0])
            self.opti.subject_to(ca.sumsqr(self.p - end) <= reach**2)
            if tube is not None:
                self.beside(end, along, tube)
        self.opti.subject_to(self.p == end)
        self.opti.subject_to(self.v == 0)

    def beside(self, at, along, width):
        normal = ca.DM([-along[1], along[0]])
        self.opti.subject_to(self.opti.bounded(-width, ca.dot(normal, self.p - at), width))

    def solve(self):
        """Time to the finish, and the positions."""
        self.opti.minimize(self.cost)
        quiet = {"print_level": 0, "sb": "yes", "max_iter": 3000, "tol": 1e-8}
        self.opti.solver("ipopt", {"print_time": 0}, quiet)
        solution = self.opti.solve()
        value = lambda x: np.array(solution.value(x), dtype=float).reshape(-1)
        seconds = sum(float(solution.value(h)) for h in self.durations)
        return seconds, np.array([value(p) for p in self.points])


def unit(way):
    return way / np.linalg.norm(way)


def along_waypoints(vehicle, path, radius, tube, steps):
    """Legs of `steps` equal times; each ends within `radius` of its waypoint, the last within `reach`."""
    waypoints, reach = path["waypoints"], path["reach"]
    flight = Flight(vehicle, waypoints[0])
    for i, (a, b) in enumerate(zip(waypoints, waypoints[1:])):
        length, along = np.linalg.norm(b - a), unit(b - a)
        pace = 0.6 * vehicle.speed_mps
        h, weight = flight.duration(length / pace / steps)
        for k in range(steps):
            flight.step(h, weight, a + (b - a) * (k + 1) / steps, pace * along)
            if tube is not None:
                flight.beside(a, along, tube)
                progress = ca.dot(ca.DM(along), flight.p - a)
                flight.opti.subject_to(flight.opti.bounded(-tube, progress, length + tube))
        is_last = i + 2 == len(waypoints)
        flight.opti.subject_to(ca.sumsqr(flight.p - b) <= (reach if is_last else radius) ** 2)
    flight.stop(waypoints[-1], unit(waypoints[-1] - waypoints[-2]), reach, tube, steps)
    return flight.solve()


def along_curve(vehicle, path, tube, spacing_m):
    """Nodes on normals of the curve every `spacing_m`, each with a time of its own."""
    curve, reach = path["curve"], path["reach"]
    lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = lambda s: np.array([np.interp(s, lengths, curve[:, i]) for i in range(2)])
    tangent = lambda s: unit(at(min(s + 5e-3, lengths[-1])) - at(max(s - 5e-3, 0)))
    # The circle of `reach` around the end begins at `last`: the curve is all but straight in it.
    last = lengths[-1] - reach
    places = np.linspace(0, last, round(last / spacing_m) + 1)[1:]
    flight, pace = Flight(vehicle, curve[0]), 0.6 * vehicle.speed_mps
    for s in places:
        along = tangent(s)
        flight.step(*flight.duration(spacing_m / pace), at(s), pace * along)
        if s < places[-1]:
            flight.opti.subject_to(ca.dot(ca.DM(along), flight.p - at(s)) == 0)
            flight.beside(at(s), along, tube)
    end, along = curve[-1], tangent(lengths[-1])
    flight.opti.subject_to(ca.sumsqr(flight.p - end) <= reach**2)
    flight.beside(end, along, tube)
    flight.stop(end, along, reach, tube, 20)
    return flight.solve()


def natural_or_periodic(knots, is_closed):
    """The cubic spline over the chord length as a fine polyline (de Boor 1978, chapter IV)."""
    t = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    n, h = len(t) - 1, np.diff(t)
    rates = np.diff(knots, axis=0) / h[:, None]
    matrix, right = np.eye(n + 1), np.zeros((n + 1, 2))
    for i in range(0 if is_closed else 1, n):
        before, h_a = (n - 1, h[-1]) if i == 0 else (i - 1, h[i - 1])
        matrix[i, :] = 0
        matrix[i, before], matrix[i, i], matrix[i, i + 1] = h_a, 2 * (h_a + h[i]), h[i]
        right[i] = 6 * (rates[i] - rates[i - 1])
    if is_closed:
        matrix[n, 0], matrix[n, n] = -1, 1
    m = np.linalg.solve(matrix, right)
    points = [knots[0]]
    for i in range(n):
        for q in np.linspace(0, 1, 101)[1:]:
            r = 1 - q
            sag = (r**3 - r) * m[i] + (q**3 - q) * m[i + 1]
            points.append(r * knots[i] + q * knots[i + 1] + h[i] ** 2 / 6 * sag)
    return np.array(points)


def read(mission):
    """Path, limits and heading of a mission file."""
    (kind, table), = json.loads(pathlib.Path(mission).read_text()).items()
    if kind not in ("waypoints", "spline", "circle"):
        sys.exit(f"{mission}: missions of waypoints, splines and circles have a bound here, not {kind}")
    path = {"kind": kind, "reach": table.get("follow", {}).get("reach", 0.2), "limits": table["limits"]}
    if table["heading"] != "fixed":
        sys.exit(f"{mission}: the heading must be fixed")
    if kind == "circle":
        turns = table["turns"] * (1 if table["direction"] == "counter_clockwise" else -1)
        angles = table["begin_rad"] + 2 * math.pi * turns * np.linspace(0, 1, 2001)
        direction = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        heights, headings = [table["centre"][2]], [table["centre"][3]]
        path["curve"] = np.array(table["centre"][:2]) + table["radius_m"] * direction
    else:
        rows = np.array(table["waypoints"])
        heights, headings = rows[:, 2], rows[:, 3]
        path["waypoints"] = rows[:, :2]
        if kind == "spline":
            if table["closed"]:
                path["waypoints"] = np.vstack([rows[:, :2], rows[:1, :2]])
            path["curve"] = natural_or_periodic(path["waypoints"], table["closed"])
    if np.ptp(heights) > 0 or np.ptp(headings) > 0 or table.get("laps", 1) > 1:
        sys.exit(f"{mission}: one lap at constant height and heading is needed")
    path["heading_rad"] = float(headings[0])
    return path


def bounds(path, settings, args):
    """Time and positions of the three problems, by name."""
    cycle = settings["cycle"]
    p, u_ub = cycle["mhe"]["p_prior"], min(cycle["mpc"]["u_ub"][:2])
    axes_rad = 0.0 if args.square_axes else path["heading_rad"] + p[THETA_0]
    able = Vehicle(p[LAMBDA_H] * (u_ub - p[DEAD_H]), p[A_MAX], p[TAU_H], axes_rad)
    limits = path["limits"]
    written = Vehicle(limits["speed_max_mps"], limits["accel_max_mps2"])
    reach = path["reach"]
    if path["kind"] == "waypoints":
        tubed = lambda vehicle: along_waypoints(vehicle, path, args.tube, args.tube, args.steps)
    else:
        tubed = lambda vehicle: along_curve(vehicle, path, args.tube, 1.5 / args.steps)
    if path["kind"] == "circle":
        loose = lambda vehicle: along_curve(vehicle, path, reach, 1.5 / args.steps)
    else:
        steps = args.steps if path["kind"] == "waypoints" else max(args.steps // 2, 8)
        loose = lambda vehicle: along_waypoints(vehicle, path, reach, None, steps)
    return {
        "limits": lambda: tubed(written),
        "tube": lambda: tubed(able),
        "reach": lambda: loose(able),
    }


def svg(drawn, file):
    """The path (grey), the flight in the tube (blue) and that through `reach` (red), one panel a mission."""
    side, parts = 240, []
    for i, (name, path, solved) in enumerate(drawn):
        outline = path.get("curve", path.get("waypoints"))
        low, high = outline.min(axis=0) - 0.3, outline.max(axis=0) + 0.3
        scale = (side - 30) / (high - low).max()
        lines = [("#bbb", 3, outline), ("#0b62c4", 1.3, solved["tube"][1]), ("#c22", 1.3, solved["reach"][1])]
        for colour, width, points in lines:
            xy = (points - low) * scale
            dots = " ".join(f"{i * side + 10 + x:.1f},{side - 5 - y:.1f}" for x, y in xy)
            parts.append(f'<polyline points="{dots}" fill="none" stroke="{colour}" stroke-width="{width}"/>')
        text = f"{name}: {solved['tube'][0]:.2f} s, {solved['reach'][0]:.2f} s"
        parts.append(f'<text x="{i * side + 10}" y="16" font-size="12" font-family="sans-serif">{text}</text>')
    frame = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {side * len(drawn)} {side}">'
    ground = '<rect width="100%" height="100%" fill="white"/>'
    pathlib.Path(file).write_text("\n".join([frame, ground, *parts, "</svg>"]) + "\n")


def main():
    parser = argparse.ArgumentParser(prog="contrib/bound/run", description="Least time of missions by optimal control.")
    root = pathlib.Path(__file__).resolve().parents[2]
    parser.add_argument("missions", nargs="+", metavar="MISSION.json")
    parser.add_argument("--settings", default=root / "configs/fly.json", help="settings with the vehicle's parameters")
    parser.add_argument("--tube", type=float, default=0.1, help="distance from the path, m")
    parser.add_argument("--steps", type=int, default=30, help="per leg, and on curves per 1.5 m")
    parser.add_argument("--square-axes", action="store_true", help="the stick axes are those of the world")
    parser.add_argument("--svg", help="draws the flights into this file")
    args = parser.parse_args()
    settings = json.loads(pathlib.Path(args.settings).read_text())
    print(f"{'mission':<14} {'limits, s':>10} {'tube, s':>10} {'reach, s':>10} {'computed in, s':>15}")
    drawn, is_complete = [], True
    for mission in args.missions:
        path, began, solved, cells = read(mission), time.monotonic(), {}, []
        for kind, solve in bounds(path, settings, args).items():
            try:
                solved[kind] = solve()
                cells.append(f"{solved[kind][0]:10.3f}")
            except RuntimeError as error:
                print(f"{mission}, {kind}: {str(error).splitlines()[-1]}", file=sys.stderr)
                cells.append(f"{'-':>10}")
                is_complete = False
        name = pathlib.Path(mission).stem
        print(f"{name:<14} {' '.join(cells)} {time.monotonic() - began:15.1f}", flush=True)
        if len(solved) == 3:
            drawn.append((name, path, solved))
    if args.svg and drawn:
        svg(drawn, args.svg)
    sys.exit(0 if is_complete else 1)


main()
