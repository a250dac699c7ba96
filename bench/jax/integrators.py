"""diffrax on the free rigid body of scenes/rigid-body.yaml, mu' = mu x I^-1 mu on [0, 100]: seconds of CPU and relative
error at the end for each tolerance, f64, one core. Prints one JSON object. One solve is timed, and a batch of them under vmap
(seconds of each). The reference is Dopri8 at 1e-14."""
import argparse
import json
import os
import sys

sys.dont_write_bytecode = True
sys.path[1:1] = [os.path.dirname(os.path.dirname(os.path.abspath(__file__)))]

import peerlib
from peerlib import clock

peerlib.pin_jax()

import diffrax
import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

INERTIA, START, T_END = (1.0, 2.0, 3.0), (0.01, 2.0, 0.01), 100.0
SOLVERS = {"Dopri5": diffrax.Dopri5, "Tsit5": diffrax.Tsit5, "Dopri8": diffrax.Dopri8}
BATCH = 1000


def solver(method):
    term = diffrax.ODETerm(lambda t, mu, args: jnp.cross(mu, mu / jnp.array(INERTIA)))

    def solve(mu, tolerance):
        control = diffrax.PIDController(rtol=tolerance, atol=1e-4 * tolerance)
        found = diffrax.diffeqsolve(term, method(), 0.0, T_END, None, mu, stepsize_controller=control, max_steps=100000,
                                    saveat=diffrax.SaveAt(t1=True), adjoint=diffrax.ForwardMode())
        return found.ys[-1], found.stats["num_accepted_steps"]

    return solve


def compiled(function, *example):
    start = clock()
    out = jax.jit(function).lower(*example).compile()
    return out, clock() - start


def least(call, *given):
    times, begun = [], clock()
    while len(times) < 3 or (clock() - begun < 0.3 and len(times) < 100):
        start = clock()
        jax.block_until_ready(call(*given))
        times.append(clock() - start)
    return min(times)


parser = argparse.ArgumentParser()
parser.add_argument("--tolerances", default="1e-3,1e-6,1e-9")
args = parser.parse_args()
mu = jnp.array(START)
batch = mu * (1 + 1e-3 * jnp.arange(BATCH)[:, None] / BATCH)
exact = jax.jit(solver(diffrax.Dopri8))(mu, jnp.asarray(1e-14))[0]
points = []
for name, method in SOLVERS.items():
    one, seconds = compiled(solver(method), mu, jnp.asarray(1e-6))
    many, more = compiled(jax.vmap(solver(method), (0, None)), batch, jnp.asarray(1e-6))
    for text in args.tolerances.split(","):
        tolerance = jnp.asarray(float(text))
        y, steps = one(mu, tolerance)
        error = float(jnp.linalg.norm(y - exact) / jnp.linalg.norm(exact))
        common = dict(tolerance=float(text), error=error, steps=int(steps))
        points.append(dict(common, method="diffrax, " + name, seconds=least(one, mu, tolerance), compile_seconds=seconds))
        points.append(dict(common, method="diffrax, %s, each of %d under vmap" % (name, BATCH), compile_seconds=more,
                           seconds=least(many, batch, tolerance) / BATCH))
print(json.dumps(dict(peer="diffrax " + diffrax.__version__, points=points)))
