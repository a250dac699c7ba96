"""References of methods.c: Riccati equations, held inputs, minimisers, elastica."""
import os
import sys

import mpmath as mp
import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

from core import PI, U64, condition, numbers, rows, told, written
from of_maths import flat

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "tests", "golden"))
import riccati_table as riccati

# ---- Riccati equations: the collections CAREX and DAREX, and held inputs ----

ROOM = "control"
CARE = ("CAREX 1.2", "CAREX 2.1, 1e-06", "CAREX 2.2, 1e-08", "CAREX 2.3, 1e+06", "CAREX 2.3, 1e-06", "CAREX 2.4, 1e-06",
        "CAREX 2.4, 1e-07", "CAREX 2.5, 0.0001", "CAREX 2.6, 1e+06", "one state")
DARE = ("DAREX 1.3, R = 0", "DAREX 1.5, A singular", "DAREX 2.3, 1e+06", "double integrator, 0.0001")


def riccati_rows(function, discrete, every, wanted):
    """The solution P of A, B, Q, R, S, from SciPy's by Newton's method."""
    every = {name: [None if x is None else np.array(x, dtype=float) for x in given] for name, *given in every}
    for name in wanted:
        a, b, q, r, s = every[name]
        n, m = b.shape
        shapes = [(n, n), (n, m), (n, n), (m, m)] + [(n, m)] * (s is not None)
        start = mp.matrix((solve_discrete_are if discrete else solve_continuous_are)(a, b, q, r, s=s).tolist())

        def solution(*x):
            parts, given = [], list(x[3:])
            for rows_, columns in shapes:
                part, given = given[:rows_ * columns], given[rows_ * columns:]
                parts.append(mp.matrix(rows_, columns))
                for k, v in enumerate(part):
                    parts[-1][k // columns, k % columns] = v
            return flat(riccati.newton(discrete, *parts[:4], parts[4] if len(parts) > 4 else mp.zeros(n, m), start))

        start = mp.matrix(n, n) + mp.matrix([solution(n, m, 0, *np.concatenate([x.ravel() for x in (a, b, q, r, s)
                                                                              if x is not None]))[i * n:i * n + n] for i in range(n)])
        rows(ROOM, function, solution, {name: [n, m, s is not None, *(v for x in (a, b, q, r, s) if x is not None for v in x.ravel())]},
             roundings=4 * n, fixed=3)


TENTH = ("CAREX 2.4, 1e-07", [[1 + 1e-7, 1], [1, 1 + 1e-7]], np.eye(2), 1e-14 * np.eye(2), np.eye(2), None)
riccati_rows("Riccati, continuous", False, [*riccati.care_cases(), TENTH], CARE)
riccati_rows("Riccati, discrete", True, riccati.dare_cases(), DARE)


def hold(n, m, h, *x):
    n, m = int(n), int(m)
    M = mp.zeros(n + m)
    for i in range(n):
        for j in range(n):
            M[i, j] = x[i * n + j] * h
        for j in range(m):
            M[i, n + j] = x[n * n + i * m + j] * h
    with mp.workdps(150):
        E = mp.expm(M, method="taylor")
    return [E[i, j] for i in range(n) for j in range(n)] + [E[i, n + j] for i in range(n) for j in range(m)]


rows(ROOM, "zero-order hold", hold,
     {"double integrator, 1e-9 s": [2, 1, 1e-9, 0, 1, 0, 0, 0, 1], "h = 1e-310": [2, 1, 1e-310, 0, 1, -1, 0, 0, 1],
      "1e6 above the diagonal": [2, 1, 1, 1, 1e6, 0, -1, 1, 1], "stiff, 1e4 and 1": [2, 1, 1e-2, 0, 1, -1e4, -1e4 - 1, 0, 1],
      "fast oscillator, 1000 rad": [2, 1, 1, 0, 1000, -1000, 0, 0, 1],
      "decay by e^-700": [1, 1, 1, -700, 1], "unstable, e^300": [2, 1, 1, 300, 1, 0, -300, 1, 1]},
     roundings=16, fixed=2)


# ---- least squares: NIST's Statistical Reference Datasets, More, Garbow & Hillstrom (1981), units ----

ROOM = "minimisers"
exp, root = mp.exp, mp.sqrt


def ninth(b, i, x, y):
    e = b[i] / x
    return y * (e - 1 + e**3 - 1)


MODELS = [lambda b, i, x, y: b[0] * (1 - exp(-b[1] * x)) - y,
          lambda b, i, x, y: b[0] * exp(b[1] / (x + b[2])) - y,
          lambda b, i, x, y: b[0] * (x * x + b[1] * x) / (x * x + b[2] * x + b[3]) - y,
          lambda b, i, x, y: b[0] + b[1] * exp(-b[3] * x) + b[2] * exp(-b[4] * x) - y,
          lambda b, i, x, y: sum(b[k] * exp(-b[k + 1] * x) for k in range(0, len(b), 2)) - y,
          lambda b, i, x, y: (10 * (b[1] - b[0]**2), 1 - b[0])[i],
          lambda b, i, x, y: (b[0] - 10**6, b[1] - mp.mpf(2e-6), b[0] * b[1] - 2)[i],
          lambda b, i, x, y: (10000 * b[0] * b[1] - 1, exp(-b[0]) + exp(-b[1]) - mp.mpf(1.0001))[i],
          lambda b, i, x, y: (b[0] + 10 * b[1], root(5) * (b[2] - b[3]), (b[1] - 2 * b[2])**2, root(10) * (b[0] - b[3])**2)[i],
          ninth]
MISRA = ([77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0],
         [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78])
BOX = ([1, 2, 3, 5, 7, 10], [109, 149, 149, 191, 213, 224])
MGH10 = ([50 + 5 * i for i in range(16)], [34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744, 8261, 7030, 6005, 5147, 4427, 3820, 3307,
                                         2872])
MGH09 = ([4, 2, 1, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625],
         [0.1957, 0.1947, 0.1735, 0.16, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246])
MGH17 = ([10 * i for i in range(33)],
         [0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718, 0.685, 0.658, 0.628, 0.603, 0.580, 0.558,
          0.538, 0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448, 0.438, 0.431, 0.424, 0.420, 0.414, 0.411, 0.406])
LANCZOS = ([0.05 * i for i in range(24)], [0.0951 * np.exp(-0.05 * i) + 0.8607 * np.exp(-0.15 * i) + 1.5576 * np.exp(-0.25 * i) for i in range(24)])
NONE = lambda m: ([0.0] * m, [0.0] * m)
TASKS = {  # model, data, starts, near the solution
    "Misra1a": (0, MISRA, [[500, 1e-4], [250, 5e-4]], [238.94, 5.5016e-4]),
    "BoxBOD": (0, BOX, [[1, 1], [100, 0.75]], [213.81, 0.54724]),
    "MGH10": (1, MGH10, [[2, 4e5, 2.5e4], [0.02, 4000, 250]], [5.60964e-3, 6181.35, 345.224]),
    "MGH09": (2, MGH09, [[25, 39, 41.5, 39], [0.25, 0.39, 0.415, 0.39]], [0.192807, 0.191282, 0.123057, 0.136062]),
    "MGH17": (3, MGH17, [[50, 150, -100, 1, 2], [0.5, 1.5, -1, 0.01, 0.02]], [0.37541, 1.93585, -1.46469, 0.0128675, 0.0221227]),
    "Lanczos": (4, LANCZOS, [[1.2, 0.3, 5.6, 5.5, 6.5, 7.6]], [0.0951, 1, 0.8607, 3, 1.5576, 5]),
    "Rosenbrock": (5, NONE(2), [[-1.2, 1], [-120, 100]], [1, 1]),
    "Brown badly scaled": (6, NONE(3), [[1, 1]], [1e6, 2e-6]),
    "Powell badly scaled": (7, NONE(2), [[0, 1]], [1.0981593297e-5, 9.106146739]),
    "x in 1e-12, y in 1e12": (9, ([1e-12, 1e12], [1.0, 1.0]), [[3e-12, 0.2e12]], [1e-12, 1e12]),
    "f of 1e-60": (9, ([1.0, 1.0], [1e-30, 1e-30]), [[3, 0.2]], [1, 1]),
    "f of 1e200": (9, ([1.0, 1.0], [1e100, 1e100]), [[3, 0.2]], [1, 1])}


def solution(model, data, near):
    """The minimum in 40 digits by Newton's method, and what conditioning allows of each number: the change that rounding
    of f and of the residuals hides, and what rounding of r does through the pseudoinverse of J; over the size of the number."""
    xs, ys = numbers(data[0]), numbers(data[1])
    n, m = len(near), len(xs)
    r = lambda b: [MODELS[model](b, i, xs[i], ys[i]) for i in range(m)]
    scale = numbers(near)

    def jacobian(b):
        J = mp.matrix(m, n)
        for k in range(n):
            h = scale[k] * mp.mpf(10)**-25
            up, down = ([v + (d if j == k else 0) for j, v in enumerate(b)] for d in (h, -h))
            for i, (p, q) in enumerate(zip(r(up), r(down))):
                J[i, k] = (p - q) / (2 * h)
        return J

    with mp.workdps(80):
        gradient = lambda *z: [v / w for v, w in zip(jacobian([a * s for a, s in zip(z, scale)]).T * mp.matrix(r([a * s for a, s in zip(z, scale)])), weights)]
        J = jacobian(scale)
        weights = [mp.sqrt(mp.fsum(J[i, k]**2 for i in range(m))) * mp.mpf("1") for k in range(n)]
        z = mp.findroot(gradient, [mp.mpf(1)] * n, tol=1e-60, maxsteps=60, verify=False)
        b = [a * s for a, s in zip(z, scale)]
        J = jacobian(b)
        inverse = mp.inverse(J.T * J)
        pseudo, hidden = inverse * J.T, U64 * mp.fsum(m * v * v + 4 * abs(v * y) for v, y in zip(r(b), ys))
    allows = 0
    for k in range(n):
        width = mp.sqrt(hidden * inverse[k, k])
        rounding = mp.fsum(abs(pseudo[k, i]) * (abs(ys[i]) or 1) for i in range(m)) * U64 * 4
        allows = max(allows, (width + rounding) / abs(b[k]))
    return b, float(allows) + 64 * U64


def fits(function, wanted, *also):
    for name in wanted:
        model, data, starts, near = TASKS[name]
        b, allows = solution(model, data, near)
        for number, start in enumerate(starts):
            case = name if len(starts) == 1 else "%s, start %d" % (name, number + 1)
            written(ROOM, function, case, "each", "50 digits", allows, "ci", [model, len(b), len(data[0]), *start, *data[0], *data[1]], b)
    for case, start in also:
        written(ROOM, function, "Powell singular" + case, "absolute", "closed form", U64**0.25, "ci", [8, 4, 4, *start] + [0] * 8, [mp.mpf(0)] * 4)


fits("least squares", TASKS, ("", [3, -1, 0, 1]), (" from x 100", [300, -100, 0, 100]))
fits("ssbroyden", [t for t in TASKS if t not in ("MGH17", "Lanczos")], ("", [3, -1, 0, 1]))
fits("lbfgs", ("Misra1a", "BoxBOD", "MGH10", "Rosenbrock", "x in 1e-12, y in 1e12", "f of 1e-60"))

# ---- linear least squares from sums ----

ROOM = "tables"


def normal(n, ridge, *x):
    n = int(n)
    A, scale = mp.matrix(n, n), [1 / mp.sqrt(x[i * n + i]) for i in range(n)]
    for i in range(n):
        for j in range(n):
            A[i, j] = x[max(i, j) * n + min(i, j)] * (1 + ridge if i == j else 1) * scale[i] * scale[j]
    solved = mp.lu_solve(A, mp.matrix([v * w for v, w in zip(x[n * n:], scale)]))
    return [v * w for v, w in zip(solved, scale)]


gram = lambda A: [float(v) for v in flat(mp.matrix(A).T * mp.matrix(A))]
T = [i / 10 for i in range(11)]
VANDERMONDE = [[t**k for k in range(6)] for t in T]
rows(ROOM, "normal equations", normal,
     {"polynomial of degree 5 on 0..1": [6, 1e-12, *gram(VANDERMONDE), *(sum(t**k for t in T) for k in range(6))],
      "a column twice": [2, 1e-12, 11, 11, 11, 11, 22, 22],
      "columns of 1e-150 and 1e150": [2, 1e-12, 1e-300, 0.5, 0.5, 1e300, 2e-150, 1e150]}, fixed=2)
written(ROOM, "normal equations", "a column of zeros", "each", "closed form", 1e-11, "ci", [2, 1e-12, 0, 0, 0, 3, 0, 6], numbers([0, 2]))

# ---- elastica: clamped ends (Love, Treatise, section 263), circular arcs ----

ROOM = "elastica"


def buckled(L, EI, x0, y0, x1, y1, *rest):
    """Energy and force of the first mode: the distance of the ends over L is 2 E(m)/K(m) - 1."""
    d = (x1 - x0) / L
    m = mp.findroot(lambda m: (2 * mp.ellipe(m) / mp.ellipk(m) - 1 - d) / (1 - d), 1 - d if d > 0.5 else 0.6)
    K, E = mp.ellipk(m), mp.ellipe(m)
    return [8 * EI * (4 * K / L) * (E - (1 - m) * K), -(4 * K / L)**2 * EI]


beam = lambda d, L=1.0, EI=1.0, N=50: [L, EI, 0, 0, d * L, 0, 0, 0, N]
rows(ROOM, "elastica", buckled,
     {"shortened by %g" % e: beam(1 - e) for e in (0.5, 1e-2, 1e-4, 1e-6, 1e-9)} |
     {"L = 1e-9, EI = 1e9": beam(0.9, 1e-9, 1e9), "L = 1e9, EI = 1e-9": beam(0.9, 1e9, 1e-9)}, "each", roundings=64, truncation=1e-11)
for name, w, L, EI in (("of 1e-4", 1e-4, 1.0, 1.0), ("of 1e-2", 1e-2, 1.0, 1.0), ("of 3", 3.0, 1.0, 1.0), ("of 3, L = 1e-9", 3.0, 1e-9, 1.0), ("of a whole circle", mp.pi, 1.0, 1.0)):
    chord = float(L * mp.sin(w) / w) if w != mp.pi else 0.0
    written(ROOM, "elastica", "arc " + name, "each", "closed form", 1e-10, "ci", [L, EI, 0, 0, chord, 0, -float(w), 2 * float(w), 50],
            [2 * mp.mpf(w)**2 * EI / L])


def discrete(L, EI, x0, y0, x1, y1, theta0, rotation, N):
    """Newton's method for dE/dtheta = 0 of elastica.h, from the first mode."""
    N, h = int(N), L / N
    P = 18 * EI * N**2 / L**3

    def slopes(*inner):
        t = [theta0, *inner, theta0 + rotation]
        w = [h / 2 if k in (0, N) else h for k in range(N + 1)]
        rx, ry = x1 - x0 - sum(a * mp.cos(v) for a, v in zip(w, t)), y1 - y0 - sum(a * mp.sin(v) for a, v in zip(w, t))
        return [EI / h * (mp.sin(t[k] - t[k - 1]) - mp.sin(t[k + 1] - t[k])) + 2 * P * h * (rx * mp.sin(t[k]) - ry * mp.cos(t[k])) for k in range(1, N)]

    size = 2 * mp.sqrt(1 - (x1 - x0) / L)
    t = [theta0, *mp.findroot(slopes, [size * mp.sin(2 * mp.pi * k / N) for k in range(1, N)], tol=1e-70, maxsteps=60), theta0 + rotation]
    w = [h / 2 if k in (0, N) else h for k in range(N + 1)]
    rx, ry = x1 - x0 - sum(a * mp.cos(v) for a, v in zip(w, t)), y1 - y0 - sum(a * mp.sin(v) for a, v in zip(w, t))
    return [EI / h * sum(1 - mp.cos(b - a) for a, b in zip(t, t[1:])) + P * (rx**2 + ry**2), 2 * P * rx]


rows(ROOM, "elastica, discrete", discrete, {"N = 8, shortened by %g" % e: beam(1 - e, N=8) for e in (0.1, 1e-3, 1e-6)}, "each", roundings=64,
     fixed=8, kappa=1e4)
told(ROOM, "elastica", {"ends as far apart as L": (beam(1.0), "INVALID_ARGUMENT"), "length NaN": ([float("nan"), 1, 0, 0, 0.5, 0, 0, 0, 50], "NOT_FINITE")})

# ---- control: what has no solution ----

told("control", "Riccati, continuous", {"not stabilisable": ([1, 1, 0, 1, 0, 1, 1], "CHECK_FAILED"),
                                        "eigenvalues on the axis": ([2, 1, 0, 0, 1, -1, 0, 0, 1e-12, 0, 0, 0, 0, 1], "CHECK_FAILED"),
                                        "R not positive": ([1, 1, 0, 1, 1, 1, -1], "INVALID_ARGUMENT"),
                                        "NaN": ([1, 1, 0, float("nan"), 1, 1, 1], "NOT_FINITE")})
told("control", "zero-order hold", {"e^710": ([1, 1, 1, 710, 1], "NOT_FINITE")})

# ---- detectors ----

ROOM = "detectors"
given = lambda function, cases, allows=4 * U64: [written(ROOM, function, case, "absolute", "closed form", allows, "ci", inputs, numbers(want))
                                                for case, (inputs, want) in cases.items()]
given("area under the curve", {"one class": ([0.1, 0.5, 0.3, 1, 1, 1], [mp.nan]), "all scores equal": ([1, 1, 1, 1, 0, 1, 0, 1], [0.5]),
                               "scores 1e308, -1e308, inf": ([1e308, -1e308, float("inf"), 0.0, 1, 0, 1, 0], [1]),
                               "NaN scores are least": ([float("nan"), 1, 2, 3, 0, 0, 1, 1], [1])})
given("accuracy, precision, recall, f1", {"one class": ([0, 0, 0, 5], [1, 1, 1, 1]), "a class that is never given": ([5, 0, 5, 0], [0.5, 0, 0, 0]),
                                          "a class that does not occur": ([4, 1, 0, 0], [0.8, 0, 0, 0])})
given("powers of a spectrum", {"zeros": ([0.0] * 16, [0] * 4)}, 64 * 9 * U64)
