#!/usr/bin/env python3
"""Writes stumpff_table.h beside itself: Stumpff functions and the coefficient of dexpinv with their derivatives, summed
in 80 digits (mpmath) at arguments that are exact doubles."""
import os
from mpmath import mp, mpf, factorial, pi, zeta

mp.dps = 80
ARGUMENTS = [0.0, 1e-18, 1e-8, 1e-4, 0.1, 1.0, 1.01, 4.0, 9.0, float(pi**2), 11.0, 12.5, 14.0, 15.2, 15.9, 16.1, 39.0]
MORE = [-1e-3, -0.7, -1.5, -9.0, -15.0, -17.0, -60.0, 0.5, 2.3, float(pi**2 / 4), 2.5, 12.0, 25.0, 50.0, 100.0, 240.0]


def stumpff(k, d, w):
    """d-th derivative of c_k at w"""
    w, total, i = mpf(w), mpf(0), 0
    while True:
        term = (-1) ** (i + d) * w**i * factorial(i + d) / factorial(i) / factorial(k + 2 * (i + d))
        total += term
        if i > abs(w) and abs(term) < mpf(10) ** -70:
            return total
        i += 1


def dexpinv(d, w):
    """d-th derivative of g2 = 2/(4 pi^2 - w) + 2/(16 pi^2 - w) + rest"""
    w, total = mpf(w), mpf(0)
    for m in (1, 2, 3):
        total += 2 * factorial(d) / ((2 * m * pi) ** 2 - w) ** (d + 1)
    for j in range(d, 260):
        c = 2 * (zeta(2 * j + 2) - sum(mpf(m) ** -(2 * j + 2) for m in (1, 2, 3))) / (2 * pi) ** (2 * j + 2)
        total += c * factorial(j) / factorial(j - d) * w ** (j - d)
    return total


def number(x):
    return mp.nstr(x, 25, min_fixed=0, max_fixed=0) if x else "0.0"


lines = ["/* Written by stumpff_table.py: do not edit. */", "/* clang-format off */", "#ifndef LG_STUMPFF_TABLE_H", "#define LG_STUMPFF_TABLE_H", ""]
lines += ["/* Arguments of the issue's list come first. c[k] is the derivative number `order` of c_k at w. */"]
lines += ["static const struct {", "    double w;", "    int order;", "    double c[9];", "} stumpff_table[] = {"]
for w in ARGUMENTS + MORE:
    for d in range(6):
        values = ", ".join(number(stumpff(k, d, w)) for k in range(9))
        lines.append(f"    {{{float(w).hex()}, {d}, {{{values}}}}},")
lines += ["};", "", "static const struct {", "    double w;", "    double g[6]; /* derivatives 0..5 of g2 */", "} dexpinv_table[] = {"]
for w in ARGUMENTS + [-1e-3, -0.7, -9.0, -44.0, -60.0, 2.3, 12.0, 25.0, 50.0, 100.0]:
    lines.append(f"    {{{float(w).hex()}, {{{', '.join(number(dexpinv(d, w)) for d in range(6))}}}}},")
lines += ["};", "", "#endif"]
with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "stumpff_table.h"), "w") as out:
    out.write("\n".join(lines) + "\n")
