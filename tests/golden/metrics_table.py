#!/usr/bin/env python3
"""Writes metrics_table.h beside itself: metrics, receiver operating characteristics and areas of scikit-learn, on scores
with ties (multiples of 1/8)."""
import os
import numpy as np
import sklearn
from sklearn import metrics

rng = np.random.default_rng(2)
n = 60


def numbers(values):
    return ", ".join(repr(float(v)) for v in values)


def whole(values):
    return ", ".join(str(int(v)) for v in values)


out = [f"/* Written by metrics_table.py with scikit-learn {sklearn.__version__}: do not edit. */", "/* clang-format off */",
       "#ifndef LG_METRICS_TABLE_H", "#define LG_METRICS_TABLE_H", "", f"enum {{ TABLE_WINDOWS = {n} }};", ""]
for name, classes in (("two", 2), ("four", 4)):
    truth = rng.integers(0, classes, size=n)
    score = np.round((rng.normal(size=(n, classes)) + 1.2 * (truth[:, None] == np.arange(classes))) * 8) / 8
    if classes == 2:
        score[:, 0] = -score[:, 1]
        given = (score[:, 1] >= score[:, 0]).astype(int)
        average = {"average": "binary"}
        auc = metrics.roc_auc_score(truth, score[:, 1])
    else:
        given = score.argmax(axis=1)
        average = {"average": "macro"}
        auc = np.mean([metrics.roc_auc_score(truth == k, score[:, k]) for k in range(classes)])
    fpr, tpr, threshold = metrics.roc_curve(truth == 1, score[:, 1], drop_intermediate=False)
    precision, recall, f1, _ = metrics.precision_recall_fscore_support(truth, given, zero_division=0, **average)
    out += [f"static const uint32_t {name}_truth[{n}] = {{{whole(truth)}}};",
            f"static const uint32_t {name}_given[{n}] = {{{whole(given)}}};",
            f"static const double {name}_score[{n * classes}] = {{{numbers(score.ravel())}}};",
            f"static const uint64_t {name}_confusion[{classes * classes}] = "
            f"{{{whole(metrics.confusion_matrix(truth, given).ravel())}}};",
            f"static const double {name}_metrics[4] = "
            f"{{{numbers([metrics.accuracy_score(truth, given), precision, recall, f1])}}};",
            f"static const double {name}_auc = {float(auc)!r};",
            f"static const double {name}_fpr[{len(fpr)}] = {{{numbers(fpr)}}};",
            f"static const double {name}_tpr[{len(tpr)}] = {{{numbers(tpr)}}};",
            f"static const double {name}_threshold[{len(tpr) - 1}] = {{{numbers(threshold[1:])}}}; /* from the second on */", ""]
out += ["#endif", ""]
with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "metrics_table.h"), "w", encoding="ascii") as file:
    file.write("\n".join(out))
