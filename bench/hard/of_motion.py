"""References of motion.c: runs of mechanical systems."""
import time

import mpmath as mp
from scipy.integrate import solve_ivp

from core import PI, condition, numbers, rows

ROOM = "integrators"
# ---- the free rigid body: Jacobi's elliptic functions (Landau & Lifshitz, Mechanics, section 37) ----



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


def integrated(function, reference, cases, fixed, state, quick=None, **options):
    """Rows of runs from the last `state` inputs: the truncation is the tolerance, input 2, grown as a change of the state grows.
    `quick`: the same in double precision, for the condition numbers."""
    for case, inputs in cases.items():
        begin = time.time()
        how = dict(change=mp.mpf(10)**-22) if quick is None else dict(change=1e-9)
        kappa = condition(quick or reference, inputs, "relative", fixed, **how)
        growth = condition(quick or reference, inputs, "relative", len(inputs) - state, True, **how)
        rows(ROOM, function, reference, {case: inputs}, truncation=max(inputs[2], 0) * float(1 + growth), fixed=fixed, roundings=16,
             kappa=kappa, **options)
        print("%s, %s: %.1f s" % (function, case, time.time() - begin), flush=True)


MIDDLE = [1e-3, 2.0, 1e-3]
integrated("rigid body", rigid_body,
           {"tumbling, T = 10": [0, 10, 1e-12, 1, 2, 3, 0.5, 1.5, 0.7],
            "from the middle axis, T = 100": [0, 100, 1e-12, 1, 2, 3, *MIDDLE],
            "1e-9 from the middle axis, T = 30": [0, 30, 1e-12, 1, 2, 3, 1e-9, 2.0, 1e-9],
            "t0 = 1e9, T = 100": [1e9, 100, 1e-12, 1, 2, 3, 0.5, 1.5, 0.7],
            "inertia and mu times 1e-9": [0, 10, 1e-12, 1e-9, 2e-9, 3e-9, 0.5e-9, 1.5e-9, 0.7e-9],
            "inertia and mu times 1e9": [0, 10, 1e-12, 1e9, 2e9, 3e9, 0.5e9, 1.5e9, 0.7e9],
            "inertia 1e-12, 1, 3": [0, 10, 1e-12, 1e-12, 1, 3, 1e-12, 1e-6, 1e-6]}, 3, 3, how="closed form")

# ---- runs without a closed form: extrapolation of the midpoint rule (Gragg 1965; Bulirsch & Stoer 1966) in 40 digits ----


def extrapolated(field, y, T, columns=14, digits=28):
    """y(T) of y' = field(y); steps are halved until the last two columns agree."""
    with mp.workdps(42):
        y, T, t, H = [mp.mpf(v) for v in y], mp.mpf(T), mp.mpf(0), mp.mpf(T) / 8
        while t < T:
            H = min(H, T - t)
            table, f0 = [], field(y)
            for k in range(columns):
                n = 2 * (k + 1)
                h, before, now = H / n, y, [a + H / n * b for a, b in zip(y, f0)]
                for _ in range(n - 1):
                    before, now = now, [a + 2 * h * b for a, b in zip(before, field(now))]
                now = [(a + b + h * c) / 2 for a, b, c in zip(before, now, field(now))]
                line = [now]
                for j in range(k):
                    factor = mp.mpf(n)**2 / mp.mpf(2 * (k - j))**2 - 1
                    line.append([a + (a - b) / factor for a, b in zip(line[j], table[j])])
                error = max(abs(a - b) for a, b in zip(line[-1], table[-1])) if k else mp.inf
                table, size = line, max(abs(v) for v in line[-1])
                if error < mp.mpf(10)**-digits * size:
                    break
            if error > mp.mpf(10)**-digits * size:
                H /= 2
                continue
            t, y = t + H, table[-1]
            if k < columns - 3:
                H *= 2
    return y


def both(field, start=lambda x: x, end=lambda x, y: y):
    """The run of rows (t0, T, tolerance, parameters and state) in 40 digits, and in double precision. field(x) -> f(y)."""
    def exact(*x):
        return end(x, extrapolated(field(x), start(x), x[1]))

    def quick(*x):
        x = [float(v) for v in x]
        f, y = field(x), [float(v) for v in start(x)]
        run = solve_ivp(lambda t, y: f([float(v) for v in y]), (0, x[1]), y, "DOP853", rtol=1e-13,
                        atol=1e-14 * max(abs(v) for v in y))
        return end(x, list(run.y[:, -1]))
    return exact, quick


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def chain(links):
    """docs/simulate.md: pendulum-chain, lagrangian."""
    def field(x):
        g, m, L = x[3], x[4:4 + links], x[4 + links:4 + 2 * links]

        def f(y):
            q, w = [y[6 * i:6 * i + 3] for i in range(links)], [y[6 * i + 3:6 * i + 6] for i in range(links)]
            d = [1 / m[i] + (1 / m[i - 1] if i else 0) for i in range(links)]
            e = [-dot(q[i], q[i + 1]) / m[i] for i in range(links - 1)]
            b = [L[i] * dot(w[i], w[i]) - (g * q[0][2] if i == 0 else 0) for i in range(links)]
            for i in range(1, links):
                part = e[i - 1] / d[i - 1]
                d[i], b[i] = d[i] - part * e[i - 1], b[i] - part * b[i - 1]
            tension = [0] * (links + 1)
            for i in reversed(range(links)):
                tension[i] = (b[i] - (e[i] * tension[i + 1] if i < links - 1 else 0)) / d[i]
            out, last = [], [0, 0, 0]
            for i in range(links):
                after = q[i + 1] if i < links - 1 else [0, 0, 0]
                a = [(tension[i + 1] * after[k] - tension[i] * q[i][k]) / m[i] - (g if k == 2 else 0) for k in range(3)]
                out += cross(w[i], q[i]) + cross(q[i], [(a[k] - last[k]) / L[i] for k in range(3)])
                last = a
            return out
        return f
    return both(field, start=lambda x: list(x[4 + 2 * links:]))


def hanging(*links):
    """q and omega of links by (inclination from below, azimuth, rate across)."""
    out = []
    for angle, azimuth, rate in links:
        q = [float(mp.sin(angle) * mp.cos(azimuth)), float(mp.sin(angle) * mp.sin(azimuth)), -float(mp.cos(angle))]
        w = [float(v) for v in (-rate * mp.sin(azimuth), rate * mp.cos(azimuth), 0)]
        out += q + w
    return out


TWO = hanging((1.0, 0.3, 0.5), (0.4, 1.1, -0.7))
for links, function, cases in (
        (1, "spherical pendulum", {
            "1e-8 from the upright, T = 6": [0, 6, 1e-12, 9.81, 1, 1, *hanging((PI - 1e-8, 0.3, 0.0))],
            "passes the upright by 1e-9 in energy": [0, 2, 1e-12, 1, 1, 1, *hanging((0.0, 0.0, 2.000000001))],
            "mass 1e9, length 1e-9": [0, 1e-4, 1e-12, 9.81, 1e9, 1e-9, *hanging((1.0, 0.3, 1e4))],
            "mass 1e-9, length 1e9": [0, 1e5, 1e-12, 9.81, 1e-9, 1e9, *hanging((1.0, 0.3, 1e-4))]}),
        (2, "two links", {
            "masses 1, 1e-12": [0, 3, 1e-12, 9.81, 1, 1e-12, 1, 0.8, *TWO],
            "masses 1e-12, 1": [0, 1e-2, 1e-12, 9.81, 1e-12, 1, 1, 0.8, *TWO],
            "masses 1e12, 1": [0, 3, 1e-12, 9.81, 1e12, 1, 1, 0.8, *TWO],
            "lengths 1, 1e-3": [0, 0.3, 1e-12, 9.81, 1, 1, 1, 1e-3, *TWO],
            "chaos, T = 12": [0, 12, 1e-13, 9.81, 1, 1, 1, 1, *hanging((2.5, 0.3, 0.5), (2.9, 1.1, -0.7))]}),
        (3, "three links", {"chaos, T = 4": [0, 4, 1e-13, 9.81, 1, 1, 1, 1, 1, 1, *hanging((2.5, 0.3, 0.5), (2.9, 1.1, -0.7), (2.0, -1, 0))]})):
    exact, quick = chain(links)
    integrated(function, exact, cases, 3, 6 * links, quick=quick)


def position(x, y):
    return list(y[:3])


def rates(x):
    """(q, p) of a row -> (q, omega)."""
    q, p = list(x[6:9]), list(x[9:])
    return q + [v / (x[4] * x[5]**2) for v in cross(q, p)]


single_field = lambda x: (lambda y: cross(y[3:], y[:3]) + cross(y[:3], [0, 0, -x[3] / x[5]]))
exact, quick = both(single_field, rates, position)
integrated("spherical pendulum, Hamiltonian", exact,
           {"mass %g" % m: [0, 5, 1e-12, 9.81, m, 1, *hanging((1.0, 0.3, 0.0))[:3], *(m * v for v in (0.0, 0.5, 0.0))] for m in (1e-9, 1e9)},
           3, 6, quick=quick)


def top(x):
    """Gamma, Pi of the heavy top in its body: docs/simulate.md, lie-poisson."""
    I, weight, chi = x[3:6], x[6] * x[7], x[8:11]

    def f(y):
        G, P = y[:3], y[3:]
        w = [P[i] / I[i] for i in range(3)]
        return cross(G, w) + [a + weight * b for a, b in zip(cross(P, w), cross(G, chi))]
    return f


exact, quick = both(top, start=lambda x: list(x[14:]))
SYMMETRIC = [0.46875, 0.234375, 0.46875, 15, 2, 0, 1, 0, 0, 0, -9.81]
tilted = lambda angle: [9.81 * float(mp.sin(angle)), 9.81 * float(mp.cos(angle)), 0.0]
integrated("heavy top", exact,
           {"asleep at 1.001 of its critical spin": [0, 3, 1e-12, *SYMMETRIC, *tilted(1e-6), 0, 1.001 * 2 * (0.46875 * 15 * 2 * 9.81)**0.5, 0],
            "falls from 1e-8 off the upright": [0, 0.6, 1e-12, *SYMMETRIC, *tilted(1e-8), 0, 1.0, 0],
            "spin 1e4": [0, 0.02, 1e-12, *SYMMETRIC, *tilted(0.5), 0, 1e4 * 0.234375, 0]}, 3, 6, quick=quick)
for name, state in {"upright and at rest": [0, 0, 1.0, 0, 0, 0]}.items():
    rows(ROOM, "spherical pendulum", lambda *x: list(x[6:]), {name: [0, 100, 1e-9, 9.81, 1, 1, *state]}, exact=True, how="closed form")

# ---- oscillators: closed forms of the schemes themselves ----


def verlet(t0, T, steps, q, p):
    """Kick, drift, kick: a rotation by 2 asin(h/2) after scaling."""
    n, h = -steps, T / -steps
    turn, scale = n * 2 * mp.asin(h / 2), mp.sqrt(1 - h * h / 4)
    return [q * mp.cos(turn) + p / scale * mp.sin(turn), p * mp.cos(turn) - q * scale * mp.sin(turn)]


def midpoint(t0, T, steps, q, p):
    turn = -steps * 2 * mp.atan(T / -steps / 2)
    return [q * mp.cos(turn) + p * mp.sin(turn), p * mp.cos(turn) - q * mp.sin(turn)]


for function, reference in (("oscillator, stormer-verlet", verlet), ("oscillator, variational", midpoint)):
    rows(ROOM, function, reference, {"h = 0.1, T = 1e4": [0, 1e4, -100000, 1.0, 0.0], "h = 1.9": [0, 1900, -1000, 1.0, 0.0]}, fixed=3,
         roundings=100000, how="closed form")
rows(ROOM, "oscillator, stormer-verlet", verlet, {"h = 0.1, T = 1e7": [0, 1e7, -100000000, 1.0, 0.0]}, fixed=3, roundings=1e8, when="slow", how="closed form")
