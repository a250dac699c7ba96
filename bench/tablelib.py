"""Tables for bench/tables: each function gives names, training rows and test rows; the last columns are outputs."""

import numpy as np


def split(x, y, seed=0, test=0.25):
    """Training and test part of a table, drawn by the seed."""
    y = y.reshape(len(x), -1)
    order = np.random.default_rng(seed).permutation(len(x))
    held = int(round(test * len(x)))
    return (x[order[held:]], y[order[held:]]), (x[order[:held]], y[order[:held]])


def named(x):
    return [f"x{i}" for i in range(x.shape[1])]


def bundled(loader):
    data = loader()
    names = [str(name).replace(" ", "_") for name in data.feature_names]
    return names, data.data, data.target


def housing_like(rows=20640):
    """Median house values as a function of eight columns with the scales of California's districts: smooth in place and
    income, cut off at 5, with noise."""
    r = np.random.default_rng(11)
    lon, lat = r.uniform(-124, -114, rows), r.uniform(32.5, 42, rows)
    income = np.clip(r.lognormal(1.25, 0.45, rows), 0.5, 15)
    age, rooms = r.integers(1, 53, rows).astype(float), r.lognormal(1.65, 0.3, rows)
    bedrooms, people = rooms * r.normal(0.2, 0.02, rows), r.lognormal(7, 0.7, rows)
    household = r.lognormal(1.05, 0.25, rows)
    coast = np.exp(-((lon + 124 - 1.1 * (42 - lat)) ** 2) / 4) + 0.8 * np.exp(
        -((lon + 118.3) ** 2 + (lat - 34) ** 2) / 0.6) + np.exp(-((lon + 122.3) ** 2 + (lat - 37.7) ** 2) / 0.5)
    y = 0.35 * income + 1.1 * coast + 0.006 * age - 0.25 * np.log(household) + 0.1 * rooms - 0.4 * bedrooms
    y = np.minimum(y * np.exp(0.2 * r.normal(size=rows)), 5.0)
    names = ["MedInc", "HouseAge", "AveRooms", "AveBedrms", "Population", "AveOccup", "Latitude", "Longitude"]
    return names, np.column_stack([income, age, rooms, bedrooms, people, household, lat, lon]), y


def scales():
    """Inputs from 1e-9 to 1e9, an output of 1e7."""
    r = np.random.default_rng(1)
    x = r.normal(size=(800, 4)) * [1e-9, 1e-3, 1.0, 1e9] + [5e-9, 0.0, 1e3, -3e9]
    u = (x - x.mean(0)) / x.std(0)
    y = 1e7 * (np.sin(u[:, 0]) + u[:, 1] * u[:, 2] + 0.3 * u[:, 3] + 0.05 * r.normal(size=len(x)))
    return named(x), x, y


def one_input():
    r = np.random.default_rng(2)
    x = r.uniform(-3, 3, (300, 1))
    return named(x), x, np.sin(3 * x[:, 0]) * np.exp(-0.2 * x[:, 0] ** 2) + 0.05 * r.normal(size=300)


def fifty_inputs():
    r = np.random.default_rng(3)
    x = r.normal(size=(1500, 50))
    y = x[:, :6] @ [1, -2, 0.5, 1.5, -1, 0.7] + x[:, 0] * x[:, 1] + np.tanh(2 * x[:, 2]) + 0.3 * r.normal(size=1500)
    return named(x), x, y


def twenty_thousand():
    """Heat of a mixer: a rational function of five inputs, 20000 rows, 1 % of noise."""
    r = np.random.default_rng(4)
    x = r.uniform(0.1, 2, (20000, 5))
    y = x[:, 0] * x[:, 1] / (0.3 + x[:, 2]) + np.cos(3 * x[:, 3]) * x[:, 4]
    return named(x), x, y + 0.01 * y.std() * r.normal(size=len(y))


def discrete():
    """Inputs of a few values each, the output a table of their combinations with noise."""
    r = np.random.default_rng(5)
    x = np.column_stack([r.integers(0, k, 1200) for k in (2, 3, 4, 5, 2, 7)]).astype(float)
    y = x[:, 0] * (x[:, 1] - 1) + (x[:, 2] == 2) * x[:, 3] + 0.4 * x[:, 5] * (x[:, 4] - 0.5) + 0.2 * r.normal(size=1200)
    return named(x), x, y


def generated(make, **options):
    x, y = make(random_state=0, **options)
    return named(x), x, y


OWN = [
    ("housing-like", "noise 20 % of the value, cut off", housing_like),
    ("scales", "1e-9 to 1e9", scales),
    ("one input", "noise 0.05", one_input),
    ("fifty inputs", "6 of use, noise 0.3", fifty_inputs),
    ("20000 rows", "noise 1 %", twenty_thousand),
    ("discrete", "2 to 7 values each, noise 0.2", discrete),
]


def tables(sklearn=True):
    """Name, what it is, and a function of no arguments; the bundled and generated ones need scikit-learn."""
    if not sklearn:
        return OWN
    from sklearn import datasets as d

    return [
        ("diabetes", "bundled", lambda: bundled(d.load_diabetes)),
        ("linnerud", "bundled, 3 outputs", lambda: bundled(d.load_linnerud)),
        ("friedman1", "noise 1", lambda: generated(d.make_friedman1, n_samples=500, noise=1.0)),
        ("friedman2", "no noise", lambda: generated(d.make_friedman2, n_samples=500)),
        ("friedman3", "noise 0.1", lambda: generated(d.make_friedman3, n_samples=500, noise=0.1)),
        ("make_regression", "10 of use, noise 10",
         lambda: generated(d.make_regression, n_samples=500, n_features=100, n_informative=10, noise=10.0)),
    ] + OWN
