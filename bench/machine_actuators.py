#!/usr/bin/env python3
"""machine_actuators.py [--repeats N] [--build FOLDER] [CASE...]

Simulates logs of a mass on a spring behind an actuator (20 s at 100 Hz, held steps, noise .002 and .01), fits them with
lg-identify, and prints for each number how many of N fits are within two stated errors of the truth. `--list` names the
cases."""
import argparse
import os
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor

from benchlib import ROOT, run, say

COLUMNS = "columns: {time: t}\ncoordinates:\n  - {name: x, kind: line, velocity: v}\ninputs: {columns: [u], %s}\n"
KNOWN = COLUMNS + """mass: {kind: known, values: [2]}
damping: {kind: known, values: [0.8]}
potential: {kind: known, form: quadratic, of: x, values: [3]}
input_map: {kind: known, values: [[1]]}
"""
LEARNED = COLUMNS + """mass: constant
damping: diagonal
potential: {kind: quadratic, of: x}
input_map: {kind: known, values: [[1]]}
"""
MACHINE = {"mass.1.1": 2, "damping.x": .8, "potential.x^2": 3}
# The actuator of the truth, of the machine that is fitted, and its true numbers.
CASES = {
    "lag-.02": ("lag: 0.02", "lag: unknown", {"lag.u": .02}),
    "lag-.05": ("lag: 0.05", "lag: unknown", {"lag.u": .05}),
    "lag-.1": ("lag: 0.1", "lag: unknown", {"lag.u": .1}),
    "lag-.3": ("lag: 0.3", "lag: unknown", {"lag.u": .3}),
    "dead-zone": ("curve: {dead_zone: 1}", "curve: {dead_zone: unknown}", {"dead_zone.u": 1}),
    "square": ("curve: {degree: 2, values: 0.05}", "curve: {degree: 2}", {"curve.u.2": .05}),
    "cubic": ("curve: {degree: 3, values: [0.05, -0.01]}", "curve: {degree: 3}", {"curve.u.2": .05, "curve.u.3": -.01}),
    "lag-dead-zone": ("lag: 0.1, curve: {dead_zone: 1}", "lag: unknown, curve: {dead_zone: unknown}",
                      {"lag.u": .1, "dead_zone.u": 1}),
    "lag-cubic": ("lag: 0.1, curve: {degree: 3, values: [0.05, -0.01]}", "lag: unknown, curve: {degree: 3}",
                  {"lag.u": .1, "curve.u.2": .05, "curve.u.3": -.01}),
}


def fit(program, case, seed):
    truth, learned, numbers = CASES[case]
    with tempfile.TemporaryDirectory() as folder:
        path = lambda name: os.path.join(folder, name)
        for name, text in (("truth.yaml", KNOWN % truth), ("machine.yaml", LEARNED % learned)):
            with open(path(name), "w") as file:
                file.write(text)
        subprocess.run([program, "generate", path("truth.yaml"), "--inputs", "steps:0.3", "--amplitude", "4", "--t-end", "20",
                        "--dt", "0.01", "--noise", "0.002,0.01", "--runs", "1", "--seed", str(seed), "--out", path("log.csv")],
                       check=True, stdout=subprocess.DEVNULL)
        done = run([program, "fit", path("machine.yaml"), path("log.csv"), "--out", path("m.h5"), "--json"])
    if done is None:
        return None
    found = done["identified"]
    return {name: (found[name]["value"], found[name]["error"], want) for name, want in {**numbers, **MACHINE}.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE")
    parser.add_argument("--repeats", type=int, default=40)
    parser.add_argument("--build", default=os.path.join(ROOT, "build"))
    parser.add_argument("--list", action="store_true")
    options = parser.parse_args()
    if options.list:
        print("\n".join(CASES))
        return
    program = os.path.join(options.build, "bin", "lg-identify")
    print("case           number          within     mean       error")
    for case in options.cases or CASES:
        with ThreadPoolExecutor(2) as pool:
            fits = list(pool.map(lambda seed: fit(program, case, seed), range(1, options.repeats + 1)))
        good = [found for found in fits if found is not None]
        if len(good) < len(fits):
            say("%s: %d of %d fits failed" % (case, len(fits) - len(good), len(fits)))
        for name in good[0] if good else ():
            each = [found[name] for found in good]
            within = sum(abs(value - want) <= 2 * error for value, error, want in each)
            print("%-14s %-15s %2d/%2d %10.5g %10.2g" % (case, name, within, len(fits), sum(e[0] for e in each) / len(each),
                                                         sum(e[1] for e in each) / len(each)), flush=True)


if __name__ == "__main__":
    main()
