"""Errors of predicted logs, as published benchmarks define them."""
import csv
from math import cos, exp, log, sin, sqrt

LENGTHS = {1: [1.17215149], 2: [1.03590655, 1.08221070], 3: [1.11671529, .93892384, 1.03590655],
           5: [.90675322, 1.37093021, 1.31341840, .95006977, 1.11671529]}
CENTRE = .2217285  # of the gyroscope, along its axis


def runs(path):
    """The runs of a log, each a list of rows {column: number}."""
    found = {}
    with open(path) as file:
        for row in csv.DictReader(file):
            found.setdefault(row["run"], []).append({key: float(x) for key, x in row.items() if x})
    return list(found.values())


def columns(*names):
    """The columns of SymODEN: of an angle its cosine and sine."""
    return lambda r: [x for n in names for x in ([cos(r[n]), sin(r[n])] if n in ("theta", "q1", "q2") else [r[n]])]


def chain(links, angle="a", rate="w"):
    """Positions and velocities of the nodes; joints' angles (j, r) add up."""
    def nodes(r):
        x, y, vx, vy, a, w, z = 0, 0, 0, 0, 0, 0, []
        for i, length in enumerate(LENGTHS[links], 1):
            before, spin = (a, w) if angle == "j" else (0, 0)
            a, w = before + r["%s%d" % (angle, i)], spin + r["%s%d" % (rate, i)]
            x, y, vx, vy = x + length * sin(a), y - length * cos(a), vx + length * w * cos(a), vy + length * w * sin(a)
            z += [x, y, vx, vy]
        return z
    return nodes


def gyroscope(r):
    """Centre of mass and the ends of three unit vectors from there along the body's axes: positions and velocities."""
    R = [[r["r%d%d" % (i, j)] for j in (1, 2, 3)] for i in (1, 2, 3)]
    wx, wy, wz = r["wx"], r["wy"], r["wz"]
    z = []
    for b in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)):
        b = (b[0], b[1], b[2] + CENTRE)
        turned = (wy * b[2] - wz * b[1], wz * b[0] - wx * b[2], wx * b[1] - wy * b[0])
        z += [sum(p * q for p, q in zip(row, c)) for c in (b, turned) for row in R]
    return z


def squares(log_file, predicted, shown):
    """The mean over runs of the sum of squared errors over rows and columns."""
    each = [sum((x - y)**2 for a, b in zip(left, right) for x, y in zip(shown(a), shown(b)))
            for left, right in zip(runs(log_file), runs(predicted))]
    return sum(each) / len(each)


def relative(log_file, predicted, nodes):
    """The geometric mean over rows, then runs, of |z - z'|/|z + z'| + 1e-8."""
    norm = lambda z: sqrt(sum(x * x for x in z))
    logs = []
    for left, right in zip(runs(log_file), runs(predicted)):
        pairs = [(nodes(a), nodes(b)) for a, b in zip(left, right)]
        errors = [norm([x - y for x, y in zip(a, b)]) / norm([x + y for x, y in zip(a, b)]) + 1e-8 for a, b in pairs]
        logs.append(sum(map(log, errors)) / len(errors))
    return exp(sum(logs) / len(logs))
