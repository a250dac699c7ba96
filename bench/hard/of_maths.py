"""References of maths.c: elementwise functions, products and sums, maps of Lie groups, derivatives."""
import mpmath as mp

from core import PI, U64, condition, numbers, rows, told, written

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
rows(ROOM, "cross entropy", lambda *x: [-softmax(*x)[0]], {"1e4 against 0": [0.0, 1e4], "40 against 0": [40.0, 0]}, "absolute", 4, exact=True)
rows(ROOM, "binary cross entropy", lambda x: [mp.log1p(mp.exp(-x))], listed({"700": 700.0, "-1e300": -1e300}), "absolute", 4, exact=True)
total = lambda *x: [mp.fsum(x)]
rows(ROOM, "sum", total, {"1e16, 1, -1e16": [1e16, 1, -1e16]}, roundings=2)
rows(ROOM, "mean", lambda *x: [mp.fsum(x) / len(x)], {"1e308, 1e308": [1e308, 1e308]}, roundings=2)
rows(ROOM, "sum, f32", total, {"2^24 and 64 ones": [2.0**24] + [1.0] * 64}, roundings=1, exact=True)
dot = lambda *x: [mp.fsum(a * b for a, b in zip(x[:len(x) // 2], x[len(x) // 2:]))]
rows(ROOM, "dot product", dot, {"cancels to 1e-8": [1.0, 1e8, 1.0, 1e8, 1.0, -1e8 + 1e-8], "1e200 and 1e-200": [1e200, 1e-200, 1e-200, 1e200]})


def hilbert(n):
    """The Hilbert matrix, rounded, and its row sums."""
    A = [[1.0 / (i + j + 1) for j in range(n)] for i in range(n)]
    return [v for row in A for v in row] + [sum(row) for row in A]


def solve(*x):
    k = next(k for k in range(1, 100) if k * k + k == len(x))
    A = mp.matrix(k, k)
    for i in range(k):
        for j in range(k):
            A[i, j] = (x[i * k + j] + x[j * k + i]) / 2
    return list(mp.lu_solve(A, mp.matrix(x[k * k:])))


rows(ROOM, "spd solve", solve, {"Hilbert 5": hilbert(5), "Hilbert 8": hilbert(8), "Hilbert 11": hilbert(11),
                                "1e12, 1, 1e-12": [1e12, 1, 0, 1, 1, 1e-7, 0, 1e-7, 1e-12, 1, 1, 1]}, roundings=4)
rows(ROOM, "spd solve, f32", solve, {"Hilbert 4": hilbert(4)}, roundings=4)

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

se3_exp = lambda *x: flat(so3_exp(*x[:3])) + list(dexp(x[:3], x[3:]))
rows(ROOM, "exp of se(3)", se3_exp, {"angle %s" % k: along(v) + B for k, v in {"0": 0.0, "1e-310": 1e-310, "2 pi": 2 * PI}.items()})
for name, angle in {"1e-9": 1e-9, "pi - 1e-8": PI - 1e-8}.items():
    a = numbers(along(angle) + B)
    given = [float(v) for v in se3_exp(*a)]
    written(ROOM, "log of SE(3)", "angle " + name, "absolute", "closed form", 32 * U64 * 4, "ci", given, a)


def series(a, b, coefficient, terms=400):
    """sum_k coefficient(k) ad_a^k b of se(3)."""
    total, power = mp.zeros(6, 1), mp.matrix(b)
    for k in range(terms):
        total += coefficient(k) * power
        u, v, p, q = mp.matrix(a[:3]), mp.matrix(a[3:]), power[:3], power[3:]
        power = mp.matrix(list(cross(u, p)) + list(cross(u, q) + cross(v, p)))
    return list(total)


TWIST = [0.7, -0.2, 1.1, *B]
PAIRS = {"angle " + k: along(v) + [1.5, 0.2, -0.8] + TWIST for k, v in {"1e-9": 1e-9, "pi": PI, "6": 6.0}.items()}
with mp.workdps(80):
    rows(ROOM, "dexp of se(3)", lambda *x: series(x[:6], x[6:], lambda k: 1 / mp.factorial(k + 1)), PAIRS, roundings=8)
BERNOULLI = [mp.bernoulli(k) / mp.factorial(k) for k in range(400)]
SHORT = {k: v for k, v in PAIRS.items() if k != "angle 6"}
rows(ROOM, "dexpinv of se(3)", lambda *x: series(x[:6], x[6:], lambda k: BERNOULLI[k]), SHORT, roundings=8)
defect = lambda *u: [mp.mpf(0)]
rows(ROOM, "exp of so(3), R^T R - I", defect, {k: along(ANGLES[k]) for k in ANGLES if k in ("angle pi", "angle 1e8", "angle 1e14")}, "absolute",
     exact=True, roundings=32, how="closed form")

# ---- tape and derivatives ----

ROOM = "derivatives"
rows(ROOM, "tanh^(8)", lambda x: [mp.diff(mp.tanh, x, 8)], listed({"1e-9": 1e-9, "20": 20.0, "0.3": 0.3}), "absolute", 64)
atan2 = lambda a, b: [b / (a * a + b * b), -a / (a * a + b * b)]
rows(ROOM, "atan2, gradient", atan2, {"1e-200, 1e-200": [1e-200, 1e-200], "1e200, 1e200": [1e200, 1e200], "1e-9, -1": [1e-9, -1.0]}, "each", 4)
norm = lambda *x: [v / mp.sqrt(mp.fsum(w * w for w in x)) for v in x]
rows(ROOM, "norm, gradient", norm, {"1e-150": [3e-150, 4e-150], "1e150": [3e150, 4e150]}, roundings=8)
shares = lambda *x: [mp.exp(v) - (i == 0) for i, v in enumerate(softmax(*x))]
rows(ROOM, "cross entropy, gradient", shares, {"1e4 against 0": [0.0, 1e4], "40 against 0": [40.0, 0]}, "absolute", 4, exact=True)
rows(ROOM, "binary cross entropy, gradient", lambda x: [-sigmoid(-x)], listed({"700": 700.0, "-1e300": -1e300}), "absolute", 4, exact=True)
five = lambda w: [stumpff(k, w) for k in range(5)]
WS = {"0": 0.0, "1e-310": 1e-310, "pi^2": PI * PI, "16 - 1e-9": 16 - 1e-9, "16 + 1e-9": 16 + 1e-9, "1e16": 1e16}
rows("Lie maps", "Stumpff c_0..c_4", five, listed(WS), roundings=8)
rows("Lie maps", "Stumpff c_0..c_4, plan", five, listed({"pi^2": PI * PI}), roundings=8)
slopes = lambda w: [mp.fsum((k * stumpff(k + 2, w) - stumpff(k + 1, w)) / 2 for k in range(5))]
rows(ROOM, "Stumpff, gradient", slopes, listed({k: WS[k] for k in ("0", "1e-310", "pi^2", "16 - 1e-9")}), roundings=16)


def g2(w):
    x = mp.sqrt(w)
    return [(1 - x / 2 * mp.cot(x / 2)) / w] if w > 1e-20 else [mp.mpf(1) / 12 + w / 720]


NEAR = {"1e-18": 1e-18, "pi^2": PI * PI, "4 pi^2 (1 - 1e-9)": 4 * PI * PI * (1 - 1e-9)}
rows("Lie maps", "dexpinv g_2", g2, listed(NEAR), roundings=8)
rows(ROOM, "dexpinv g_2, gradient", lambda w: [mp.diff(lambda v: g2(v)[0], w, h=w * mp.mpf(10)**-20)] if w > 1e-10 else [mp.mpf(1) / 720 + w / 15120],
     listed(NEAR), roundings=16)
rows(ROOM, "sqrt behind select, gradient", lambda *x: [1 / (2 * mp.sqrt(v)) if v > 0 else mp.mpf(0) for v in x], {"-1, 0, 1e-300": [-1.0, 0, 1e-300]})
twice = lambda *x: [mp.cos(2.25 * mp.sin(v)) for v in x]
rows(ROOM, "cos(a/4 + 2 b), a = b = sin x", twice, {"%d rows" % n: [0.1 * i for i in range(n)] for n in (1, 15, 16, 200)}, "absolute", 8)
