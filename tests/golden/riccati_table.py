#!/usr/bin/env python3
"""Writes riccati_table.h beside itself: Riccati equations with their solutions. The start is SciPy's
solve_continuous_are or solve_discrete_are; Newton's method takes it to 40 digits with mpmath. `scipy` is the relative
error of SciPy's own result. Equations: the collections CAREX and DAREX (Benner, Laub & Mehrmann 1995), and random ones
of mixed scales."""
import os
import mpmath as mp
import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

mp.mp.dps = 60
V = np.eye(3) - 2.0 / 3.0 * np.ones((3, 3))


def care_cases():
    yield "CAREX 1.1", [[0, 1], [0, 0]], [[0], [1]], [[1, 0], [0, 2]], [[1]], None
    yield "CAREX 1.2", [[4, 3], [-4.5, -3.5]], [[1], [-1]], [[9, 6], [6, 4]], [[1]], None
    yield ("CAREX 1.3", [[0, 1, 0, 0], [0, -1.89, 0.39, -5.53], [0, -0.034, -2.98, 2.43], [0.034, -0.0011, -0.99, -0.21]],
           [[0, 0], [0.36, -1.6], [-0.95, -0.032], [0.03, 0]],
           [[2.313, 2.727, 0.688, 0.023], [2.727, 4.271, 1.148, 0.323], [0.688, 1.148, 0.313, 0.102],
            [0.023, 0.323, 0.102, 0.083]], np.eye(2), None)
    for e in (1.0, 1e-2, 1e-4, 1e-6):
        yield f"CAREX 2.1, {e:g}", [[1, 0], [0, -2]], [[e], [0]], np.ones((2, 2)), [[1]], None
    for e in (1.0, 1e-4, 1e-8):
        yield (f"CAREX 2.2, {e:g}", [[-0.1, 0], [0, -0.02]], [[0.1, 0], [0.001, 0.01]], [[100, 1000], [1000, 10000]],
               [[1 + e, 1], [1, 1]], None)
    for e in (1e6, 1.0, 1e-3, 1e-6):
        yield f"CAREX 2.3, {e:g}", [[0, e], [0, 0]], [[0], [1]], np.eye(2), [[1]], None
    for e in (1.0, 1e-3, 1e-6, 1e-7):
        yield f"CAREX 2.4, {e:g}", [[1 + e, 1], [1, 1 + e]], np.eye(2), e * e * np.eye(2), np.eye(2), None
    for e in (1.0, 1e-2, 1e-4):
        yield (f"CAREX 2.5, {e:g}", [[3 - e, 1], [4, 2 - e]], [[1], [1]],
               [[4 * e - 11, 2 * e - 5], [2 * e - 5, 2 * e - 2]], [[1]], None)
    for e in (1.0, 1e3, 1e6):
        q = V @ np.diag([1 / e, 1, e]) @ V
        a = V @ np.diag([e, 2 * e, 3 * e]) @ V
        yield f"CAREX 2.6, {e:g}", a, np.eye(3), (q + q.T) / 2, e * np.eye(3), None
    n = 16
    yield ("CAREX 3.2", -2 * np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1) + np.eye(n, k=n - 1) + np.eye(n, k=1 - n),
           np.eye(n), np.eye(n), np.eye(n), None)
    for n in (5, 10):
        q = np.zeros((n, n))
        q[0, 0] = 1
        yield f"CAREX 4.1, {n}", np.eye(n, k=1), np.eye(n)[:, -1:], q, [[1]], None
    yield "one state", [[-3e5]], [[2e-4]], [[7.0]], [[1e-3]], [[1e-3]]
    yield from random_cases(1)


def dare_cases():
    yield "DAREX 1.1", [[4, 3], [-4.5, -3.5]], [[1], [-1]], [[9, 6], [6, 4]], [[1]], None
    yield ("DAREX 1.2", [[0.9512, 0], [0, 0.9048]], [[4.877, 4.877], [-1.1895, 3.569]], [[0.005, 0], [0, 0.02]],
           [[1 / 3, 0], [0, 3]], None)
    yield "DAREX 1.3, R = 0", [[2, -1], [1, 0]], [[1], [0]], [[0, 0], [0, 1]], [[0]], None
    yield "DAREX 1.5, A singular", [[0, 1], [0, 0]], [[0], [1]], [[1, 2], [2, 4]], [[1]], None
    for e in (1.0, 1e3, 1e6):
        yield f"DAREX 2.3, {e:g}", [[0, e], [0, 0]], [[0], [1]], np.eye(2), [[1]], None
    n = 20
    yield "DAREX 4.1", np.eye(n, k=1), np.eye(n)[:, -1:], np.eye(n), [[1]], None
    for h in (1e-2, 1e-4):
        yield f"double integrator, {h:g}", [[1, h], [0, 1]], [[h * h / 2], [h]], np.eye(2) * h, [[h]], None
    yield "one state", [[1.7]], [[3e-3]], [[1e-6]], [[1e3]], None
    yield from random_cases(2)


def random_cases(seed):
    rng = np.random.default_rng(seed)
    for n, m, decades in ((4, 2, 0), (6, 1, 0), (5, 3, 3), (6, 2, 6), (8, 3, 6)):
        scale = 10.0 ** rng.uniform(-decades, decades, n)
        a = np.round(rng.normal(size=(n, n)), 3) * scale[:, None] / scale[None, :]
        b = np.round(rng.normal(size=(n, m)), 3) * scale[:, None]
        c = np.round(rng.normal(size=(n + m, n + m)), 3)
        w = c @ c.T
        q = w[:n, :n] / scale[:, None] / scale[None, :]
        yield (f"random {n} {m}, 1e{decades}", a, b, (q + q.T) / 2, w[n:, n:], w[:n, n:] / scale[:, None])


def newton(discrete, a, b, q, r, s, p):
    """X += correction, of vec'd linear equations; all mpmath."""
    n = a.rows
    size = lambda x: mp.mnorm(x, "f")
    for _ in range(60):
        if discrete:
            w, right, rest = r + b.T * p * b, b.T * p * a + s.T, a.T * p * a - p + q
        else:
            w, right, rest = r, b.T * p + s.T, a.T * p + p * a + q
        k = mp.inverse(w) * right
        f, rest = a - b * k, rest - right.T * k
        M = mp.zeros(n * n)
        for i in range(n):
            for j in range(n):
                for l in range(n):
                    if discrete:
                        for h in range(n):
                            M[i * n + j, l * n + h] += f[l, i] * f[h, j]
                    else:
                        M[i * n + j, l * n + j] += f[l, i]
                        M[i * n + j, i * n + l] += f[l, j]
                if discrete:
                    M[i * n + j, i * n + j] -= 1
        x = mp.lu_solve(M, mp.matrix([-rest[i, j] for i in range(n) for j in range(n)]))
        step = mp.matrix(n, n)
        for i in range(n):
            for j in range(n):
                step[i, j] = (x[i * n + j] + x[j * n + i]) / 2
        p = p + step
        if size(step) <= mp.mpf(10) ** -40 * size(p):
            return p
    raise SystemExit("Newton's method does not converge")


def emit(name, discrete, cases, lines):
    lines += [f"static const riccati_case {name}[] = {{"]
    for label, *given in cases:
        a, b, q, r, s = (None if x is None else np.array(x, dtype=float) for x in given)
        n, m = b.shape
        solver = solve_discrete_are if discrete else solve_continuous_are
        start = solver(a, b, q, r, s=s)
        exact = mp.matrix(start.tolist())
        big = lambda x: mp.matrix(x.tolist())
        if n <= 10:
            exact = newton(discrete, big(a), big(b), big(q), big(r), big(s if s is not None else np.zeros((n, m))), exact)
        elif discrete:  # DAREX 4.1
            exact = mp.diag(list(range(1, n + 1)))
        else:  # CAREX 3.2: circulant matrices commute
            eigen = [-2 + 2 * mp.cos(2 * mp.pi * k / n) for k in range(n)]
            values = [e + mp.sqrt(e * e + 1) for e in eigen]
            exact = mp.matrix(n, n)
            for i in range(n):
                for j in range(n):
                    exact[i, j] = sum(v * mp.cos(2 * mp.pi * k * (i - j) / n) for k, v in enumerate(values)) / n
        error = float(mp.mnorm(big(start) - exact, "f") / mp.mnorm(exact, "f"))
        print(f"{label:28s} SciPy {error:.1e}")
        numbers = []
        for x in (a, b, q, r, s if s is not None else np.zeros((0, 0))):
            numbers += [repr(float(v)) for v in x.ravel()]
        numbers += [repr(float(exact[i, j])) for i in range(n) for j in range(n)]
        lines.append(f'    {{"{label}", {n}, {m}, {"true" if s is not None else "false"}, {error:.2g},')
        lines.append(f"     (const double[]){{{', '.join(numbers)}}}}},")
    lines += ["};", ""]


def main():
    lines = ["/* Written by riccati_table.py: do not edit. */", "/* clang-format off */", "#ifndef LG_RICCATI_TABLE_H"]
    lines += ["#define LG_RICCATI_TABLE_H", "", "/* A, B, Q, R, S (if it has one) and P, row-major, one after the other;"]
    lines += [" * scipy: the relative error of SciPy's P. */"]
    lines += ["typedef struct riccati_case {", "    const char *name;", "    uint32_t n, m;", "    bool cross;"]
    lines += ["    double scipy;", "    const double *numbers;", "} riccati_case;", ""]
    emit("care_table", False, care_cases(), lines)
    emit("dare_table", True, dare_cases(), lines)
    lines += ["#endif"]
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "riccati_table.h"), "w") as out:
        out.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
