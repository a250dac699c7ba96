#!/usr/bin/env python3
"""potentials.py NAME --out DATA.h5 [--trajectories N] [--points M] [--t-end T] [--seed S]

Trajectories of a spherical pendulum, H = |p|^2/2 + V(q) on T*S^2 (m = L = 1), in a potential that no scene has, for
lg-hamiltonian: starts as in scenes/pendulum.yaml, q uniform on the sphere, p = q x u with u in [0,1]^3. Integrated by RK4 with
steps below 2.5e-4, brought back to the manifold at every point. Needs NumPy and h5py.

  spring    V = q_z + (a.q)^2 + 1/2 cos(3 b.q), a = (1, 0, 0), b = (0, 3, 4)/5: gravity, a spring that pulls to the plane
            x = 0, and a torque that changes its sign three times on the way across, as of cogging
  magnets   V = q_z - 1/5 sum_j 1/|q - r_j|: gravity, and three magnets that attract the bob, below its lowest point at the height
            -1.3 and half a length from the axis"""
import argparse
import json

import h5py
import numpy as np

STEP = 2.5e-4
A, B = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.8])
ANGLES = 2 * np.pi * np.arange(3) / 3
MAGNETS = np.stack([np.cos(ANGLES) / 2, np.sin(ANGLES) / 2, np.full(3, -1.3)], 1)
UP = np.array([0.0, 0.0, 1.0])


def spring(q):
    """V and its gradient at q (N, 3)."""
    return (q @ UP + (q @ A)**2 + np.cos(3 * (q @ B)) / 2,
            UP + 2 * (q @ A)[:, None] * A - 1.5 * np.sin(3 * (q @ B))[:, None] * B)


def magnets(q):
    apart = q[:, None] - MAGNETS
    inverse = 1 / np.linalg.norm(apart, axis=2)
    return q @ UP - inverse.sum(1) / 5, UP + (apart * inverse[:, :, None]**3).sum(1) / 5


POTENTIALS = dict(spring=spring, magnets=magnets)


def rate(potential, y):
    """q' = p, p' = -g + q (q.g) - q |p|^2 on y (2, N, 3)."""
    q, p = y
    g = potential(q)[1]
    return np.stack([p, q * ((q * g).sum(1) - (p * p).sum(1))[:, None] - g])


def project(y):
    q = y[0] / np.linalg.norm(y[0], axis=1)[:, None]
    return np.stack([q, y[1] - q * (q * y[1]).sum(1)[:, None]])


def advance(potential, y, time):
    count = int(np.ceil(time / STEP))
    h, f = time / count, lambda y: rate(potential, y)
    for _ in range(count):
        k1 = f(y)
        k2 = f(y + h / 2 * k1)
        k3 = f(y + h / 2 * k2)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(y + h * k3))
    return project(y)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("potential", choices=POTENTIALS)
    parser.add_argument("--trajectories", type=int, default=500)
    parser.add_argument("--points", type=int, default=5)
    parser.add_argument("--t-end", type=float, default=0.1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", required=True)
    args = parser.parse_args()
    potential, random = POTENTIALS[args.potential], np.random.default_rng(args.seed)
    q = random.standard_normal((args.trajectories, 3))
    q /= np.linalg.norm(q, axis=1)[:, None]
    points = [project(np.stack([q, np.cross(q, random.random(q.shape))]))]
    t = np.linspace(0, args.t_end, args.points)
    for _ in t[1:]:
        points.append(advance(potential, points[-1], t[1]))
    y = np.stack(points)  # (M, 2, N, 3)
    energy = (y[:, 1]**2).sum(2) / 2 + np.stack([potential(at[0])[0] for at in y])
    with h5py.File(args.out, "w") as file:
        file["t"], file["trajectories"] = t, y.transpose(2, 0, 1, 3).reshape(args.trajectories, args.points, 6)
        file["hamiltonian"] = energy[0]
        file.attrs.update(system=args.potential, layout="q1 p1", links=1)
    print(json.dumps(dict(out=args.out, drift=float(abs(energy - energy[0]).max()))))


if __name__ == "__main__":
    main()
