"""Many spherical pendulums from given starts to t = 10 by diffrax: vmap over members, jit, float64, no steps kept. Prints one
JSON object: seconds of the clock and of the processor (the compiling counted apart), steps a member.

  ensemble.py STARTS METHOD TOL MEMBERS SAMPLE OUT [--cores N]     METHOD: Tsit5, Dopri5, Dopri8

STARTS: (n, 6) doubles; the ends of the first SAMPLE members go to OUT. Members beyond those of the file begin again with its
first ones."""
import argparse
import json
import os
import sys
import time

sys.dont_write_bytecode = True
parser = argparse.ArgumentParser()
parser.add_argument("starts")
parser.add_argument("method")
parser.add_argument("tolerance", type=float)
parser.add_argument("members", type=int)
parser.add_argument("sample", type=int)
parser.add_argument("out")
parser.add_argument("--cores", type=int, default=1)
args = parser.parse_args()
allowed = sorted(os.sched_getaffinity(0))
os.sched_setaffinity(0, set(allowed[-args.cores:]))
os.environ["JAX_PLATFORMS"] = "cpu"

import jax

jax.config.update("jax_enable_x64", True)
import diffrax
import jax.numpy as jnp
import numpy as np

G = 9.81


def field(t, y, args):
    q, w = y[:3], y[3:]
    return jnp.concatenate([jnp.cross(w, q), jnp.array([-G * q[1], G * q[0], 0.0])])


def solve(y0):
    end = diffrax.diffeqsolve(diffrax.ODETerm(field), getattr(diffrax, args.method)(), 0.0, 10.0, None, y0,
                              saveat=diffrax.SaveAt(t1=True), max_steps=None, throw=False,
                              stepsize_controller=diffrax.PIDController(rtol=args.tolerance, atol=args.tolerance))
    return end.ys[-1], end.stats["num_steps"]


starts = np.fromfile(args.starts).reshape(-1, 6)
starts = jnp.asarray(np.resize(starts, (args.members, 6)))
begin = time.perf_counter()
run = jax.jit(jax.vmap(solve)).lower(starts).compile()
compiling = time.perf_counter() - begin
begin, cpu = time.perf_counter(), time.process_time()
ends, steps = jax.block_until_ready(run(starts))
seconds, cpu = time.perf_counter() - begin, time.process_time() - cpu
np.asarray(ends)[:args.sample].tofile(args.out)
print(json.dumps({"seconds": seconds, "cpu": cpu, "compiling": compiling, "steps": float(np.mean(steps)),
                  "version": "diffrax %s, jax %s" % (diffrax.__version__, jax.__version__)}))
