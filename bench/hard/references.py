"""The rows of bench/hard/cases.txt that C measures (measure.c), made with mpmath at 50 digits: room, function, case, metric, kind of reference, what
conditioning allows, when it is run (ci or slow), inputs, references. Inputs are doubles, taken as exact. What conditioning
allows is roundings u (1 + kappa) + truncation: u is the unit roundoff of the type, kappa the componentwise condition number,
sum_j |x_j| max_i |df_i/dx_j| / max_i |f_i| by differences at 50 digits, or 0 where a function is to be accurate to rounding for
every input."""
import os
import struct
import sys

import mpmath as mp
import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "..", "tests", "golden"))
import riccati_table as riccati
mp.mp.dps = 50
U64, U32 = 2.0**-53, 2.0**-24
TINY = {U64: 2.0**-1074, U32: 2.0**-149}  # the spacing of subnormal numbers
PI = 3.141592653589793
ROWS = []


def single(x):
    return struct.unpack("f", struct.pack("f", x))[0]


def numbers(values):
    return [mp.mpf(v) for v in values]


def condition(function, inputs, metric, fixed=0, normwise=False):
    """Of all inputs but the first `fixed`, each changed by a part of itself, or normwise by a part of the largest of them; the
    absolute metric has no division by the size of the result."""
    base = numbers(function(*numbers(inputs)))
    size = max(abs(v) for v in base) if metric != "absolute" else mp.mpf(1)
    largest, total = max(abs(mp.mpf(x)) for x in inputs[fixed:]), mp.mpf(0)
    for j, x in enumerate(inputs):
        if j < fixed or (x == 0 and not normwise):
            continue
        moved = numbers(inputs)
        moved[j] += (largest if normwise else moved[j]) * mp.mpf(10)**-22
        ways = [abs(a - b) / (size if metric != "each" else abs(b)) for a, b in zip(numbers(function(*moved)), base) if a != b]
        total += max(ways, default=0) * mp.mpf(10)**22
    return total


def rows(room, function, reference, cases, metric="relative", roundings=4, exact=False, truncation=0, fixed=0, when="ci",
         how="50 digits"):
    """One row a case: name -> inputs. `reference`: mpmath numbers to mpmath numbers. `exact`: kappa is 0."""
    unit = U32 if "f32" in function else U64
    for case, inputs in cases.items():
        inputs = [single(x) if unit == U32 else float(x) for x in inputs]
        given = numbers(inputs)
        values = numbers(reference(*given))
        kappa = 0 if exact else condition(reference, inputs, metric, fixed)
        scale = 1 if metric != "absolute" else max([abs(v) for v in values] + [mp.mpf(0)])
        smallest = min((abs(v) for v in values if abs(v) > TINY[unit]), default=mp.mpf(1))
        underflow = 0 if metric == "absolute" else TINY[unit] / smallest
        allows = roundings * (unit * (scale + kappa) + underflow) + truncation
        written(room, function, case, metric, how, float(allows), when, inputs, values)


def told(room, function, cases, when="ci"):
    """Rows that end with a status: case -> (inputs, name of the status)."""
    for case, (inputs, status) in cases.items():
        written(room, function, case, "told", "refused", 0, when, inputs, status)


def written(room, function, case, metric, how, allows, when, inputs, reference):
    text = reference if isinstance(reference, str) else " ".join(mp.nstr(v, 20) for v in reference)
    ROWS.append("\t".join([room, function, case, metric, how, "%.3g" % allows, when, " ".join("%.17g" % x for x in inputs), text]))


# ---- elementwise functions, sums, products ----

ROOM = "kernels"
POINTS = {"0": 0.0, "1e-310": 1e-310, "1e-9": 1e-9, "pi": PI, "2 pi": 2 * PI, "1e8": 1e8}
listed = lambda cases: {name: [x] for name, x in cases.items()}
sigmoid = lambda x: 1 / (1 + mp.exp(-x))

rows(ROOM, "sin", lambda x: [mp.sin(x)], listed({**POINTS, "1e22": 1e22}), "each", 2, exact=True)
rows(ROOM, "sin, plan", lambda x: [mp.sin(x)], listed({"pi": PI, "1e8": 1e8}), "each", 2, exact=True)
rows(ROOM, "sin, f32", lambda x: [mp.sin(x)], listed({"pi": PI, "1e8": 1e8}), "each", 2, exact=True)
rows(ROOM, "cos", lambda x: [mp.cos(x)], listed({"pi/2": PI / 2, "1e8": 1e8}), "each", 2, exact=True)
rows(ROOM, "exp", lambda x: [mp.exp(x)], listed({"709.78": 709.78, "-700": -700.0, "1e-310": 1e-310}), "each", 2, exact=True)
rows(ROOM, "exp, plan", lambda x: [mp.exp(x)], listed({"709.78": 709.78}), "each", 2, exact=True)
rows(ROOM, "exp, f32", lambda x: [mp.exp(x)], listed({"88.7": 88.7, "-87": -87.0}), "each", 2, exact=True)
rows(ROOM, "log", lambda x: [mp.log(x)], listed({"1 + 2^-52": 1 + 2.0**-52, "1e-310": 1e-310, "1e308": 1e308}), "each", 2, exact=True)
rows(ROOM, "log, plan", lambda x: [mp.log(x)], listed({"1 + 2^-52": 1 + 2.0**-52}), "each", 2, exact=True)
rows(ROOM, "tanh", lambda x: [mp.tanh(x)], listed({"1e-310": 1e-310, "1e-9": 1e-9, "20": 20.0, "1e308": 1e308}), "each", 4, exact=True)
rows(ROOM, "tanh, plan", lambda x: [mp.tanh(x)], listed({"1e-9": 1e-9}), "each", 4, exact=True)
rows(ROOM, "tanh, f32", lambda x: [mp.tanh(x)], listed({"1e-9": 1e-9}), "each", 4, exact=True)
rows(ROOM, "sigmoid", lambda x: [sigmoid(x)], listed({"-700": -700.0, "40": 40.0, "-1e308": -1e308}), "each", 4, exact=True)
rows(ROOM, "sigmoid, plan", lambda x: [sigmoid(x)], listed({"-700": -700.0}), "each", 4, exact=True)
rows(ROOM, "swish", lambda x: [x * sigmoid(x)], listed({"-600": -600.0}), "each", 4, exact=True)
rows(ROOM, "atan2", lambda a, b: [mp.atan2(a, b)], {"1e-310, -1": [1e-310, -1.0], "1e300, 1e-300": [1e300, 1e-300]}, "each", 2, exact=True)
softmax = lambda *x: [v - max(x) - mp.log(mp.fsum(mp.exp(w - max(x)) for w in x)) for v in x]
rows(ROOM, "log softmax", softmax, {"1000, 0, -1000": [1000.0, 0, -1000], "one class": [1e300]}, "each", 4, exact=True)

# ---- maps of Lie groups ----

ROOM = "Lie maps"
hat = lambda u: mp.matrix([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
flat = lambda R: [R[i, j] for i in range(R.rows) for j in range(R.cols)]
cross = lambda a, b: mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def stumpff(k, w):
    """c_k(w); the series near 0, else by recursion from the sine and cosine."""
    if abs(w) < 1:
        return mp.nsum(lambda j: (-w)**int(j) / mp.factorial(k + 2 * int(j)), [0, 40], method="d")
    x = mp.sqrt(w)
    c = [mp.cos(x), mp.sin(x) / x]
    for i in range(2, k + 1):
        c.append((1 / mp.factorial(i - 2) - c[i - 2]) / w)
    return c[k]


def so3_exp(*u):
    w, U = mp.fsum(v * v for v in u), hat(u)
    return mp.eye(3) + stumpff(1, w) * U + stumpff(2, w) * U * U


def dexp(u, b):
    w, b = mp.fsum(v * v for v in u), mp.matrix(b)
    first = cross(u, b)
    return b + stumpff(2, w) * first + stumpff(3, w) * cross(u, first)


def dexpinv(u, b):
    w, b = mp.fsum(v * v for v in u), mp.matrix(b)
    x = mp.sqrt(w)
    g = (1 - x / 2 * mp.cot(x / 2)) / w if x > mp.mpf(10)**-8 else mp.mpf(1) / 12 + w / 720
    first = cross(u, b)
    return b - first / 2 + g * cross(u, first)


AXIS = (0.48, -0.64, 0.6)
ANGLES = {"angle 0": 0.0, "angle 1e-310": 1e-310, "angle 1e-9": 1e-9, "angle 3.7": 3.7, "angle pi": PI, "angle 2 pi": 2 * PI,
          "angle 1e8": 1e8, "angle 1e14": 1e14}
along = lambda angle: [a * angle for a in AXIS]
B = [0.3, -1.7, 2.2]
rows(ROOM, "exp of so(3)", lambda *u: flat(so3_exp(*u)), {k: along(v) for k, v in ANGLES.items()})
rows(ROOM, "exp of so(3) on a vector", lambda *x: list(so3_exp(*x[:3]) * mp.matrix(x[3:])),
     {k: along(ANGLES[k]) + B for k in ("angle 1e-310", "angle pi", "angle 1e8")})
TURNS = {"pi - 1e-3": PI - 1e-3, "pi - 1e-8": PI - 1e-8, "pi - 1e-12": PI - 1e-12, "1e-9": 1e-9, "1e-300": 1e-300}
for name, angle in TURNS.items():
    u = numbers(along(angle))
    R = [float(v) for v in flat(so3_exp(*u))]
    written(ROOM, "log of SO(3)", "angle " + name, "absolute", "closed form", 8 * U64 * min(angle, 1) + 4 * U64 * angle, "ci", R, u)
rows(ROOM, "dexp of so(3)", lambda *x: list(dexp(x[:3], x[3:])), {k: along(ANGLES[k]) + B for k in ("angle 1e-9", "angle pi", "angle 2 pi")})
rows(ROOM, "dexpinv of so(3)", lambda *x: list(dexpinv(x[:3], x[3:])),
     {"angle 1e-9": along(1e-9) + B, "angle pi": along(PI) + B, "angle 2 pi - 1e-6": along(2 * PI - 1e-6) + B})


def project(*entries):
    """The orthogonal polar factor."""
    R = mp.matrix(3, 3)
    for i in range(9):
        R[i // 3, i % 3] = entries[i]
    U, _, V = mp.svd_r(R / max(abs(v) for v in entries))
    return flat(U * V)


near = [float(v) for v in flat(so3_exp(*numbers(along(2.0))))]
near[1] += 3e-3
rows(ROOM, "projection to SO(3)", project, {"scaled by %g" % s: [s * v for v in near] for s in (1.0, 1e100, 1e-100, 1e-300)}, roundings=8)

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


# ---- the free rigid body: Jacobi's elliptic functions (Landau & Lifshitz, Mechanics, section 37) ----

ROOM = "integrators"


def rigid_body(t0, T, tolerance, *x):
    """mu(T) of mu' = mu x Omega, Omega = mu/I, for three different moments of inertia and components all positive."""
    I, mu = x[:3], x[3:]
    order = sorted(range(3), key=lambda i: I[i])
    sense = 1 if (order[1] - order[0]) % 3 == 1 else -1  # of an even permutation the cross product keeps its sign
    energy, square = mp.fsum(m * m / i for m, i in zip(mu, I)), mp.fsum(m * m for m in mu)
    if square < energy * I[order[1]]:
        order.reverse()
    a, b, c = (I[i] for i in order)
    high, low = energy * c - square, square - energy * a
    sizes = [mp.sqrt(high / (a * (c - a))) * a, mp.sqrt(high / (b * (c - b))) * b, mp.sqrt(low / (c * (c - a))) * c]
    m = (b - a) * high / ((c - b) * low)
    rate = mp.sqrt((c - b) * low / (a * b * c))
    phase = mp.ellipf(mp.asin(mu[order[1]] / sizes[1]), m) + sense * rate * T
    out = [None] * 3
    for i, kind in enumerate(("cn", "sn", "dn")):
        out[order[i]] = sizes[i] * mp.ellipfun(kind, phase, m=m)
    return out


def integrated(function, reference, cases, fixed, state, **options):
    """Rows of runs from the last `state` inputs: the truncation is the tolerance, input 2, grown as a change of the state grows."""
    for case, inputs in cases.items():
        tolerance, growth = max(inputs[2], 0), condition(reference, inputs, "relative", len(inputs) - state, True)
        rows(ROOM, function, reference, {case: inputs}, truncation=tolerance * float(1 + growth), fixed=fixed, roundings=16, **options)


MIDDLE = [1e-3, 2.0, 1e-3]
integrated("rigid body", rigid_body,
           {"tumbling, T = 10": [0, 10, 1e-12, 1, 2, 3, 0.5, 1.5, 0.7],
            "from the middle axis, T = 100": [0, 100, 1e-12, 1, 2, 3, *MIDDLE],
            "1e-9 from the middle axis, T = 30": [0, 30, 1e-12, 1, 2, 3, 1e-9, 2.0, 1e-9],
            "t0 = 1e9, T = 100": [1e9, 100, 1e-12, 1, 2, 3, 0.5, 1.5, 0.7],
            "inertia and mu times 1e-9": [0, 10, 1e-12, 1e-9, 2e-9, 3e-9, 0.5e-9, 1.5e-9, 0.7e-9],
            "inertia and mu times 1e9": [0, 10, 1e-12, 1e9, 2e9, 3e9, 0.5e9, 1.5e9, 0.7e9],
            "inertia 1e-12, 1, 3": [0, 10, 1e-12, 1e-12, 1, 3, 1e-12, 1e-6, 1e-6]}, 3, 3, how="closed form")


def main():
    with open(os.path.join(HERE, "cases.txt"), "w") as out:
        out.write("\n".join(ROWS) + "\n")
    print("%d rows" % len(ROWS))


if __name__ == "__main__":
    main()
