#!/usr/bin/env python3
"""Writes tree_table.h beside itself: classification trees of scikit-learn with their cost-complexity pruning paths.

Values are multiples of 1/1024, exact in single precision, in which scikit-learn keeps them. The trees `leaf` have
leaves of eight rows and more, so that no two splits are equally good: scikit-learn, which tries features in random order,
gives the same tree for every seed (checked here). The tree `full` on whole numbers is full of ties: only its pruning
path is compared."""
import os
import numpy as np
import sklearn
from sklearn.tree import DecisionTreeClassifier

rng = np.random.default_rng(6)
n, d, classes = 160, 3, 3
x = np.round(rng.normal(size=(n, d)) * 1024) / 1024
y = np.clip(np.floor(1.5 + x[:, 0] + 0.7 * x[:, 1] * x[:, 2] + 0.5 * rng.normal(size=n)), 0, 2).astype(int)
test = np.round(rng.normal(size=(40, d)) * 1024) / 1024
coarse = np.round(x * 2)


def numbers(values):
    return ", ".join(repr(float(v)) for v in values)


def tree(out, name, model, data):
    t = model.tree_
    path = model.cost_complexity_pruning_path(data, y)
    counts = np.round(t.value[:, 0, :] * t.n_node_samples[:, None]).astype(int)
    out.append(f"static const lg_tree_node {name}_node[{t.node_count}] = {{")
    for i in range(t.node_count):
        leaf = t.children_left[i] < 0
        f, l, r, h = (0, 0, 0, 0.0) if leaf else (t.feature[i], t.children_left[i], t.children_right[i], t.threshold[i])
        out.append(f"    {{{f}, {l}, {r}, {float(h)!r}, {float(t.impurity[i])!r}, {t.n_node_samples[i]}}},")
    out.append("};")
    out.append(f"static const uint32_t {name}_counts[{t.node_count}][{classes}] = {{"
               + ", ".join("{" + ", ".join(map(str, row)) + "}" for row in counts) + "};")
    out.append(f"static const double {name}_alpha[{len(path.ccp_alphas)}] = {{{numbers(path.ccp_alphas)}}};")
    out.append(f"static const double {name}_impurity[{len(path.impurities)}] = {{{numbers(path.impurities)}}};")
    return path


out = [f"/* Written by tree_table.py with scikit-learn {sklearn.__version__}: do not edit. */", "/* clang-format off */",
       "#ifndef LG_TREE_TABLE_H", "#define LG_TREE_TABLE_H", "", "#include \"liegrad/classify.h\"", "",
       f"enum {{ TABLE_ROWS = {n}, TABLE_FEATURES = {d}, TABLE_CLASSES = {classes}, TABLE_TESTS = 40 }};", "",
       f"static const double table_x[{n * d}] = {{{numbers(x.ravel())}}};",
       f"static const uint32_t table_y[{n}] = {{{', '.join(map(str, y))}}};",
       f"static const double table_test[{40 * d}] = {{{numbers(test.ravel())}}};", ""]
for criterion in ("gini", "entropy"):
    models = [DecisionTreeClassifier(criterion=criterion, min_samples_leaf=8, random_state=s).fit(x, y) for s in range(20)]
    for m in models:
        assert (m.tree_.threshold == models[0].tree_.threshold).all() and (m.tree_.feature == models[0].tree_.feature).all()
    path = tree(out, f"leaf_{criterion}", models[0], x)
    probability = models[0].predict_proba(test)
    out.append(f"static const double leaf_{criterion}_probability[{40 * classes}] = {{{numbers(probability.ravel())}}};")
    middle = float(0.5 * (path.ccp_alphas[3] + path.ccp_alphas[4]))
    pruned = DecisionTreeClassifier(criterion=criterion, min_samples_leaf=8, ccp_alpha=middle, random_state=0).fit(x, y)
    out.append(f"static const double leaf_{criterion}_ccp_alpha = {middle!r};")
    out.append(f"static const uint32_t leaf_{criterion}_ccp_nodes = {pruned.tree_.node_count}, "
               f"leaf_{criterion}_ccp_depth = {pruned.get_depth()}, leaf_{criterion}_depth = {models[0].get_depth()};")
    out.append("")
tree(out, "full", DecisionTreeClassifier(random_state=0).fit(coarse, y), coarse)
out += ["", "#endif", ""]
with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "tree_table.h"), "w", encoding="ascii") as file:
    file.write("\n".join(out))
