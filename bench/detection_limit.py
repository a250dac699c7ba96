#!/usr/bin/env python3
"""detection_limit.py SERIES.h5 NOISE [--window SAMPLES]: JSON with the F1 of a detector that is told the condition.

It is told the condition that a window comes from (its recording, intact and broken) and knows mean and
autocovariance of both, estimated without noise on the other half of the recordings; the window, with white noise of NOISE
times the data sheet's, goes to the larger Gaussian likelihood. Exact in time: block Toeplitz covariances, Cholesky. "taken
off": the mean of the window carries no information. SERIES.h5 is made by `lg-anomaly generate --noise 0`, recordings 2i and 2i + 1
intact and broken in the same waves. A yardstick, not a strict bound: the covariances are estimates, and the well is not quite a
Gaussian process; but it knows more than a detector that has to do for all conditions."""
import argparse
import json

import h5py
import numpy as np
from scipy.linalg import cholesky, solve_triangular

SHEET = np.array([3e-4] * 4 + [500.0] * 2)  # of the sensors, m/s^2 and N m


def covariance(x, length):
    """Of `length` successive samples of x (n, c), stationary: (length c, length c), time before channels."""
    n, c = x.shape
    f = np.fft.rfft(x, 2 * n, axis=0)
    r = np.fft.irfft(f[:, :, None] * f[:, None].conj(), axis=0)[:length] / n
    lag = np.arange(length)[:, None] - np.arange(length)[None]
    blocks = np.where((lag >= 0)[:, :, None, None], r[abs(lag)], r[abs(lag)].transpose(0, 1, 3, 2))
    return blocks.transpose(0, 2, 1, 3).reshape(length * c, length * c)


def model(x, length):
    """Mean, and factor and log-determinant of the covariance with unit noise, without and with a free mean."""
    mean, c = x.mean(0), x.shape[1]
    q = covariance(x - mean, length) + np.eye(length * c)
    free = np.kron(np.ones((length, length)), np.eye(c)) * 1e4
    factors = {"kept": cholesky(q, lower=True), "taken off": cholesky(q + free, lower=True)}
    return mean, {name: (factor, 2 * np.log(np.diag(factor)).sum()) for name, factor in factors.items()}


def likelihood(windows, mean, factor, log_det):
    z = solve_triangular(factor, (windows - mean).reshape(len(windows), -1).T, lower=True)
    return -0.5 * (log_det + (z * z).sum(0))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("series")
    parser.add_argument("noise", type=float)
    parser.add_argument("--window", type=int, default=300)
    args = parser.parse_args()
    with h5py.File(args.series, "r") as file:
        x, run, group = file["X"][:].astype(float), file["run"][:], file["group"][:]
    x = x.transpose(0, 2, 1) / (SHEET * args.noise)
    rng = np.random.default_rng(1)
    counts = {}  # (mean, Hs): true and false positives, false negatives
    for pair in range(0, int(run.max()), 2):
        recordings = [x[run == pair + b].reshape(-1, x.shape[2]) for b in (0, 1)]
        half = len(recordings[0]) // 2
        for part in (0, 1):
            models = [model(r[half * (1 - part):half * (2 - part)], args.window) for r in recordings]
            for label, r in enumerate(recordings):
                seen = r[half * part:half * (part + 1)] + rng.standard_normal((half, x.shape[2]))
                seen = seen[:half // args.window * args.window].reshape(-1, args.window, x.shape[2])
                for name in ("kept", "taken off"):
                    broken = np.subtract(*(likelihood(seen, models[c][0], *models[c][1][name]) for c in (1, 0))) > 0
                    for key in ((name, "all"), (name, int(group[run == pair][0]) // 3)):
                        count = counts.setdefault(key, np.zeros(3))
                        count += (broken.sum(), 0, 0) if label else (0, broken.sum(), 0)
                        count[2] += (~broken).sum() if label else 0
    f1 = lambda c: 2 * c[0] / (2 * c[0] + c[1] + c[2])
    print(json.dumps({name: {"f1": f1(counts[name, "all"]),
                             "by_height": [f1(counts[name, h]) for h in sorted(h for n, h in counts if n == name and h != "all")]}
                      for name in ("kept", "taken off")}))


if __name__ == "__main__":
    main()
