#!/usr/bin/env python3
"""Writes tpe_table.h beside itself: densities of the tree-structured Parzen estimator by Optuna's formulas, in the units of the
range, in 60 digits (erf by its series). Univariate: weights 1 for fewer than 25 trials, else a ramp and 25 ones; prior weight 1;
sigma is the larger distance to a neighbour (at the ends, to the only one: consider_endpoints is false), clipped to
[range/min(100, 1 + kernels), range] (magic clip); truncated normal kernels, over intervals of 1 for integers; rows of a choice
with the prior weight 1/kernels. Python's standard library only."""
import os
from decimal import Decimal, getcontext
import random

getcontext().prec = 60


def erf(x):
    """erf in 60 digits by its Taylor series (|x| < 9), else +-1."""
    x = Decimal(x)
    if abs(x) > 9:
        # 1 - erfc by the continued fraction
        t = erfc_far(abs(x))
        return (1 - t) * (1 if x > 0 else -1)
    getcontext().prec = 140
    term, total, n = x, x, 0
    while abs(term) > Decimal(10) ** -110 * max(abs(total), Decimal(10) ** -60):
        n += 1
        term = -term * x * x / n
        total += term / (2 * n + 1)
    total = total * 2 / Decimal(PI).sqrt()
    getcontext().prec = 60
    return +total


def erfc_far(x):
    f = Decimal(0)
    for k in range(200, 0, -1):
        f = Decimal(k) / 2 / (x + f)
    return (-x * x).exp() / (x + f) / Decimal(PI).sqrt()


PI = "3.14159265358979323846264338327950288419716939937510582097494459230781640628620899862803482534211706798214808651"


def cdf_between(a, b):
    """Probability of a standard normal number in [a, b]."""
    root = Decimal(2).sqrt()
    if a > 0:
        a, b = -b, -a
    if b < -9 * root:
        return (erfc_far(-b / root) - erfc_far(-a / root)) / 2
    getcontext().prec = 140
    low, high = erf(Decimal(a) / root), erf(Decimal(b) / root)
    out = (high - low) / 2
    getcontext().prec = 60
    return +out


def weights(n):
    if n < 25:
        return [1.0] * n
    m = n - 25
    ramp = [1.0 / n + (1 - 1.0 / n) * i / (m - 1) if m > 1 else 1.0 / n for i in range(m)]
    return ramp + [1.0] * 25


def numerical(observations, low, high, step):
    """Kernels (mu, sigma), the prior last."""
    mus = [Decimal(x) for x in observations] + [(Decimal(low) + Decimal(high)) / 2]
    order = sorted(range(len(mus)), key=lambda i: mus[i])
    ends = [Decimal(low) - Decimal(step) / 2] + [mus[i] for i in order] + [Decimal(high) + Decimal(step) / 2]
    sigma = [max(ends[i] - ends[i - 1], ends[i + 1] - ends[i]) for i in range(1, len(ends) - 1)]
    if len(ends) >= 4:
        sigma[0] = ends[2] - ends[1]
        sigma[-1] = ends[-2] - ends[-3]
    out = [None] * len(mus)
    for place, i in enumerate(order):
        out[i] = sigma[place]
    width = Decimal(high) - Decimal(low) + Decimal(step)
    least = width / min(Decimal(100), Decimal(1 + len(mus)))
    out = [min(max(s, least), width) for s in out[:-1]] + [width]
    return list(zip(mus, out))


def density(kind, low, high, observations, x):
    w = [Decimal(v) for v in weights(len(observations))] + [Decimal(1)]
    w = [v / sum(w) for v in w]
    if kind == "choice":
        n, kernels = int(high), len(w)
        total = Decimal(0)
        for k, v in enumerate(w):
            row = [Decimal(1) / kernels] * n
            if k < len(observations):
                row[int(observations[k])] += 1
            total += v * row[int(x)] / sum(row)
        return total
    if kind == "log":
        low, high, x = Decimal(low).ln(), Decimal(high).ln(), Decimal(x).ln()
        observations = [Decimal(o).ln() for o in observations]
    step = 1 if kind == "integer" else 0
    half = Decimal(step) / 2
    low, high, x = Decimal(low), Decimal(high), Decimal(x)
    total = Decimal(0)
    for v, (mu, sigma) in zip(w, numerical(observations, low, high, step)):
        inside = cdf_between((low - half - mu) / sigma, (high + half - mu) / sigma)
        if step:
            here = cdf_between((x - half - mu) / sigma, (x + half - mu) / sigma)
        else:
            z = (x - mu) / sigma
            here = (-z * z / 2).exp() / (2 * Decimal(PI)).sqrt() / sigma
        total += v * here / inside
    # The C code measures places in fractions of the range.
    return total if step else total * (high - low)


SPACES = [("uniform", -2.0, 3.0), ("log", 1e-4, 1e-1), ("integer", -3, 12), ("integer", 0, 1000), ("choice", 0, 4)]


def draw(rng, kind, low, high):
    if kind == "uniform":
        return round(rng.uniform(low, high), 6)
    if kind == "log":
        return float("%.6g" % (10 ** rng.uniform(-4, -1)))
    if kind == "integer":
        return float(rng.randint(low, high))
    return float(rng.randrange(high))


def wrapped(words):
    """Lines of at most 100 columns."""
    lines = [""]
    for word in words:
        if len(lines[-1]) + len(word) > 100:
            lines.append("")
        lines[-1] += word + ", "
    return "\n".join("    " + line.rstrip() for line in lines)


def main():
    rng = random.Random(5)
    all_values, rows = [], []
    for count in (1, 2, 3, 24, 25, 26, 27, 60, 120):
        for s, (kind, low, high) in enumerate(SPACES):
            values = [draw(rng, kind, low, high) for _ in range(count)]
            if count == 3:
                values[1] = values[0]
            probe = [draw(rng, kind, low, high) for _ in range(4)] + [float(values[0])]
            if kind != "choice":
                probe += [float(low), float(high)]
            for x in probe:
                d = density(kind, low, high, values, x)
                rows.append("{%d, %d, %d, %r, %.16e}" % (s, len(all_values), count, x, d))
            all_values += values
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "tpe_table.h"), "w") as out:
        out.write("/* Written by tpe_table.py. Density at x, in fractions of the range, from `count` values. */\n"
                  "#ifndef LG_TPE_TABLE_H\n#define LG_TPE_TABLE_H\n\n#include <stddef.h>\n\n"
                  "static const double tpe_values[] = {\n" + wrapped(map(repr, all_values)) + "\n};\n\n"
                  "/* space: 0 uniform -2..3, 1 log-uniform 1e-4..1e-1, 2 integer -3..12, 3 integer 0..1000, 4 choice of 4 */\n"
                  "static const struct {\n    int space;\n    size_t first, count;\n    double x, density;\n} tpe_rows[] = {\n"
                  + wrapped(rows) + "\n};\n\n#endif\n")


main()
