#!/usr/bin/env python3
"""Writes hold_table.h into its own folder: exponentials exp((A, B; 0, 0) h), of 50 digits by mpmath. `condition` is the
relative condition number of the exponential in the Frobenius norm, |exp's derivative| |M| / |exp(M)|, of the matrix
scaled by powers of 2; `scipy` is the larger relative error, of Ad and Bd, of SciPy's expm."""
import os
import mpmath as mp
import numpy as np
from scipy.linalg import expm, expm_cond, matrix_balance

mp.mp.dps = 50


def cases():
    chain = np.eye(4, k=1)
    push = np.eye(4)[:, -1:]
    yield "chain of integrators", chain, push, 0.25
    yield "chain, tiny h", chain, push, 1e-12
    yield "chain, h = 1e5", chain, push, 1e5
    swing = np.array([[0, 1], [-4, -0.4]])
    one = np.array([[0], [1.0]])
    for h in (1e-300, 1e-9, 1e-3, 1.0, 30.0, 1000.0):
        yield f"oscillator, {h:g}", swing, one, h
    yield "rotation, 1e4", np.array([[0, 1], [-1, 0.0]]), one, 1e4
    yield "overscaling, 1e6", np.array([[1, 1e6], [0, -1.0]]), one, 1.0
    yield "overscaling, 1e12", np.array([[1, 1e12], [0, -1.0]]), one, 0.5
    yield "Jordan block", 0.5 * np.eye(5) + 1e3 * np.eye(5, k=1), np.eye(5)[:, -1:], 1.0
    yield "stiff", np.diag([-1e6, -1e3, -1.0]) + np.diag([1.0, 1.0], 1), np.ones((3, 1)), 0.1
    yield "stiff, turned", turned(np.diag([-1e5, -1e2, -1e-2])), np.ones((3, 1)), 0.01
    yield "growing", turned(np.diag([30.0, -10.0, 2.0])), np.ones((3, 1)), 1.0
    yield "large input", swing, 1e9 * one, 0.01
    yield "small input", swing, 1e-9 * one, 0.01
    yield "Ward 1", np.array([[4, 2, 0], [1, 4, 1], [1, 1, 4.0]]), np.ones((3, 1)), 1.0
    yield ("Ward 2", np.array([[29.87942128909879, 0.7815750847907159, -2.289519314033932],
                               [0.7815750847907159, 25.72656945571064, 8.680737820540137],
                               [-2.289519314033932, 8.680737820540137, 34.39400925519054]]), np.ones((3, 1)), 1.0)
    yield "Ward 3", np.array([[-131, 19, 18], [-390, 56, 54], [-387, 57, 52.0]]), np.ones((3, 1)), 1.0
    rng = np.random.default_rng(3)
    for n, m, size, decades in ((3, 2, 1, 0), (6, 1, 1, 0), (6, 2, 30, 0), (5, 1, 3, 4), (6, 2, 1, 8)):
        d = 10.0 ** np.round(rng.uniform(-decades, decades, n))
        yield (f"random {n} {m}, size {size}, 1e{decades}", size * np.round(rng.normal(size=(n, n)), 3) * d[:, None] / d,
               np.round(rng.normal(size=(n, m)), 3) * d[:, None], 1.0)


def turned(d):
    v = np.eye(3) - 2.0 / 3.0 * np.ones((3, 3))
    return np.round(v @ d @ v, 6)


def main():
    lines = ["/* Written by hold_table.py: do not edit. */", "/* clang-format off */", "#ifndef LG_HOLD_TABLE_H",
             "#define LG_HOLD_TABLE_H", "", "/* A, B, and Ad, Bd of 50 digits, row-major, one after the other. */",
             "typedef struct hold_case {", "    const char *name;", "    uint32_t n, m;",
             "    double h, condition, scipy;", "    const double *numbers;", "} hold_case;", "",
             "static const hold_case hold_table[] = {"]
    for label, a, b, h in cases():
        a, b = np.array(a, dtype=float), np.array(b, dtype=float)
        n, m = b.shape
        big = mp.zeros(n + m)
        for i in range(n):
            for j in range(n):
                big[i, j] = mp.mpf(float(a[i, j])) * mp.mpf(h)
            for j in range(m):
                big[i, n + j] = mp.mpf(float(b[i, j])) * mp.mpf(h)
        with mp.workdps(120):
            exact = mp.expm(big, method="taylor")
        M = np.array([[float(big[i, j]) for j in range(n + m)] for i in range(n + m)])
        top = max(np.abs(M[:n, :n]).sum(axis=1).max(), 1e-300)
        for j in range(n, n + m):  # as the library does
            M[:, j] *= 2.0 ** round(np.log2(top / np.abs(M[:, j]).max()))
        scaled = matrix_balance(M, permute=False)[0]
        with np.errstate(all="ignore"):
            condition = expm_cond(scaled)
            near = expm(np.array([[float(big[i, j]) for j in range(n + m)] for i in range(n + m)]))
        right = np.array([[float(exact[i, j]) for j in range(n + m)] for i in range(n)])
        off = near[:n] - right
        error = max(float(np.linalg.norm(off[:, k]) / np.linalg.norm(right[:, k])) for k in (slice(n), slice(n, None)))
        print(f"{label:28s} condition {condition:.1e}  SciPy {error:.1e}")
        numbers = [repr(float(v)) for v in a.ravel()] + [repr(float(v)) for v in b.ravel()]
        numbers += [repr(float(exact[i, j])) for i in range(n) for j in range(n)]
        numbers += [repr(float(exact[i, n + j])) for i in range(n) for j in range(m)]
        lines.append(f'    {{"{label}", {n}, {m}, {h!r}, {condition:.2g}, {error:.2g},')
        lines.append(f"     (const double[]){{{', '.join(numbers)}}}}},")
    lines += ["};", "", "#endif"]
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "hold_table.h"), "w") as out:
        out.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
