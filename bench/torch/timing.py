"""The discipline of lg-bench in Python: pinning, warm-up, medians over samples, short calls timed many at a time; and the
arguments that bench/compare gives to a peer."""
import argparse
import gc
import json
import math
import os
import statistics
import time


def arguments():
    parser = argparse.ArgumentParser()
    parser.add_argument("case")
    parser.add_argument("--batch", type=int, default=0)
    parser.add_argument("--width", type=int, default=0)
    parser.add_argument("--dtype", choices=("f64", "f32"), default="f64")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=0)
    parser.add_argument("--patience", type=float, default=4.0)
    parser.add_argument("--epochs", type=int, default=20)
    parser.add_argument("--inputs", help="prefix that lg-bench --out wrote to; classify: file with /X, /y")
    parser.add_argument("--out", help="where the trained parameters go, as doubles")
    return parser.parse_args()


def pin(threads):
    """One thread: the core that lg-bench takes too."""
    if threads == 1:
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def begin():
    """The arguments of a peer, which runs on its core from now on."""
    args = arguments()
    pin(args.threads)
    return args


def row(samples_us, **more):
    s = sorted(samples_us)
    at = lambda f: s[max(0, math.ceil(f * len(s)) - 1)]
    return dict(median_us=statistics.median(s), min_us=s[0], p10_us=at(0.1), p90_us=at(0.9), samples=len(s), **more)


def measure(call, repeats=0, patience=4.0, **more):
    clock = time.perf_counter
    start, calls, one = clock(), 1, 0.0
    while True:
        t = clock()
        for _ in range(calls):
            call()
        one = (clock() - t) / calls
        if repeats == 1 or clock() - start > 0.3:
            break
        calls *= 2
    inner = max(1, math.ceil(4e-4 / one))
    samples = repeats or max(5, min(101, int(patience / (one * inner))))
    times = []
    gc.collect()
    gc.disable()
    for _ in range(samples):
        t = clock()
        for _ in range(inner):
            call()
        times.append((clock() - t) * 1e6 / inner)
    gc.enable()
    return row(times, inner=inner, **more)


def report(args, rows, **more):
    import torch
    settings = {k: os.environ[k] for k in ("MKL_DEBUG_CPU_TYPE", "ATEN_CPU_CAPABILITY") if k in os.environ}
    print(json.dumps(dict(peer="torch " + torch.__version__, case=args.case, dtype=args.dtype, threads=args.threads,
                          settings=settings, rows=rows, **rows[0], **more)))
