#!/usr/bin/env python3
"""Writes logistic_table.h beside itself: coefficients of scikit-learn's LogisticRegression (unpenalised intercept,
tol 1e-12) on the table of tests/anomaly/test_logistic.c."""
import os
import numpy as np
from sklearn.linear_model import LogisticRegression

CASES = [(2, 40, 3, 1.0), (2, 40, 3, 100.0), (3, 60, 2, 1.0), (4, 20, 30, 1.0), (2, 12, 20, 10.0)]


def table(classes, n, d):
    i, j = np.arange(n)[:, None], np.arange(d)[None, :]
    label = np.arange(n) % classes
    return np.sin(0.7 * (i + 1) * (j + 1) + 0.3 * j) + 0.4 * np.cos((label[:, None] + 1.0) * (j + 2)), label


lines = ["/* Written by logistic_table.py: do not edit. */", "/* clang-format off */", "#ifndef LG_LOGISTIC_TABLE_H"]
lines += ["#define LG_LOGISTIC_TABLE_H", "", "/* rows of (weight, intercept), one below the other */"]
lines += ["static const struct {", "    uint32_t classes, n, d;", "    double c;", "    double row[124];"]
lines += ["} logistic_table[] = {"]
for classes, n, d, c in CASES:
    x, y = table(classes, n, d)
    m = LogisticRegression(C=c, tol=1e-12, max_iter=100000, solver="newton-cg").fit(x, y)
    rows = np.hstack([m.coef_, m.intercept_[:, None]]).ravel()
    lines.append(f"    {{{classes}, {n}, {d}, {c}, {{{', '.join(repr(float(v)) for v in rows)}}}}},")
lines += ["};", "", "#endif"]
with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "logistic_table.h"), "w") as out:
    out.write("\n".join(lines) + "\n")
