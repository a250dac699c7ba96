"""What bench/compare and bench/report share: running lg-bench and its peers, settings, tables."""
import csv
import json
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(HERE)

# Variables that would tie a peer or us to other kernels than each finds best by itself.
NEUTRAL = ("OPENBLAS_CORETYPE", "OPENBLAS_NUM_THREADS", "OPENBLAS_L2_SIZE", "OMP_NUM_THREADS", "MKL_NUM_THREADS",
           "MKL_DEBUG_CPU_TYPE", "ATEN_CPU_CAPABILITY", "LIEGRAD_ISA", "NVPL_BLAS_DEBUG_CPU_TYPE")

BATCHED = ("mlp2", "mlp2-small", "jvp")  # cases with a row a batch
NAMED = ("elastica-discrete", "elastica-continuous", "elastica-angle")  # with several rows; of the others the first counts


def say(*words):
    print(*words, file=sys.stderr, flush=True)


def environment(extra=None):
    env = {k: v for k, v in os.environ.items() if k not in NEUTRAL}
    env.update(extra or {})
    return env


def run(command, extra=None):
    """The JSON object that the command prints, or None (and why, on stderr)."""
    done = subprocess.run(command, env=environment(extra), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines()
        say("  failed: %s: %s" % (" ".join(command[:4]), lines[-1] if lines else done.returncode))
        return None
    return json.loads(done.stdout)


def linked(build):
    """The words that link a program with the shared libraries of a build folder."""
    folder = os.path.join(os.path.abspath(build), "lib")
    return ["-L" + folder, "-Wl,-rpath," + folder, "-lliegrad_io", "-lliegrad", "-lm"]


def compiled(name, build, out, *flags):
    """Compiles bench/c/NAME.c with the libraries of a build folder. Returns `out`, the path of the result."""
    subprocess.run([os.environ.get("CC", "cc"), "-std=gnu11", "-O2", *flags, os.path.join(HERE, "c", name + ".c"), "-o", out,
                    "-I" + os.path.join(ROOT, "include"), *linked(build)], check=True)
    return out


def find_lg_bench(build):
    for folder in ([build] if build else []) + [os.environ.get("LIEGRAD_BUILD", ""), os.path.join(ROOT, "build")]:
        path = os.path.join(folder, "bin", "lg-bench")
        if folder and os.access(path, os.X_OK):
            return os.path.abspath(path)
    raise SystemExit("lg-bench is not built; scripts/configure build && cmake --build build (or --build FOLDER)")


class Ours:
    def __init__(self, path, extra=None):
        self.path, self.extra = path, extra

    def __call__(self, case, *options):
        return run([self.path, case, "--json", *map(str, options)], self.extra)


def find_beside(lg_bench, name):
    """The executable of that name beside lg-bench: its arguments to its JSON; None if it is not there."""
    path = os.path.join(os.path.dirname(os.path.abspath(lg_bench)), name)
    return (lambda *arguments: run([path, *map(str, arguments), "--json"])) if os.access(path, os.X_OK) else None


class Torch:
    """PyTorch under LIEGRAD_PYTHON, with the settings that make it fast on this machine. MKL takes processors of other
    makers for old ones. `usual`: what its users set, MKL_DEBUG_CPU_TYPE=5 (AVX2 in releases that read it) and ATen's own
    instruction set. `forced`: MKL made to use AVX-512 by the undocumented type 7, or by answering for it that the
    processor is Intel's."""

    GROUPS = ("usual", "forced")
    module = "torch"

    def __init__(self, folder, quick=False):
        self.python = os.environ.get("LIEGRAD_PYTHON", "python3")
        self.version = version_of(self.python, "torch")
        self.chosen = {}
        self.quick = quick
        wide = {"ATEN_CPU_CAPABILITY": "avx512"}
        self.settings = {"usual": [{"MKL_DEBUG_CPU_TYPE": "5"}], "forced": [{"MKL_DEBUG_CPU_TYPE": "7", **wide}]}
        if quick:
            return
        self.settings["usual"] += [{}, {"MKL_DEBUG_CPU_TYPE": "5", **wide}]
        shim = os.path.join(folder, "mkl.so")
        source = "int mkl_serv_intel_cpu_true(void) { return 1; }\n"
        if self.version and shutil.which("cc") and subprocess.run(
            ["cc", "-shared", "-fPIC", "-x", "c", "-", "-o", shim], input=source, text=True).returncode == 0:
            self.settings["forced"] += [{"LD_PRELOAD": shim, **wide}]

    def __call__(self, case, setting, *options):
        return run([self.python, os.path.join(HERE, "torch", "peer.py"), case, *map(str, options)], setting)

    def best(self, case, dtype, threads, group, *options):
        """The setting of a group under which this case is fastest, by a short run of each; none if there is no choice."""
        if len(self.settings[group]) == 1:
            return self.settings[group][0]
        key = (case, dtype, threads, group, options)
        if key not in self.chosen:
            tried = []
            brief = ("--epochs", 4) if case.startswith("hamiltonian") else ("--patience", 0.3)
            if case in NAMED:
                brief += ("--epochs", 2)
            for setting in self.settings[group]:
                result = self(case, setting, "--dtype", dtype, "--threads", threads, *brief, *options)
                if result:
                    tried.append((sum(r["min_us"] for r in matching(result)), setting))
            self.chosen[key] = min(tried, key=lambda t: t[0])[1] if tried else {}
        return self.chosen[key]


class Jax:
    """JAX under LIEGRAD_JAX (default LIEGRAD_PYTHON, python3): compiled by jit, in the fastest of several forms."""

    CASES = ("mlp2", "mlp2-small", "hamiltonian", "hamiltonian-small")
    module = "jax"

    def __init__(self):
        self.python = os.environ.get("LIEGRAD_JAX", os.environ.get("LIEGRAD_PYTHON", "python3"))
        self.version = version_of(self.python, "jax")

    def __call__(self, case, *options):
        return run([self.python, os.path.join(HERE, "jax", "cases.py"), case, *map(str, options)])


def peer_name(group):
    return "PyTorch, " + group if group in Torch.GROUPS else group or "-"


def version_of(python, module):
    """None where that Python does not have it."""
    try:
        done = subprocess.run([python, "-c", "import %s; print(%s.__version__)" % (module, module)], stdout=subprocess.PIPE,
                              stderr=subprocess.DEVNULL, text=True)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def matching(result):
    """The rows that count: all batches, or the fastest way, which comes first."""
    return result["rows"] if result["case"] in BATCHED else result["rows"][:1]


def describe(setting):
    return ", ".join("%s=%s" % (k.replace("MKL_DEBUG_CPU_TYPE", "MKL type").replace("ATEN_CPU_CAPABILITY", "ATen"),
                                os.path.basename(v)) for k, v in setting.items()) or "defaults"


def cpp_peers(folder):
    """Compiles bench/cpp/scalar.cpp with whatever is installed; the path, or None."""
    compiler = shutil.which("g++") or shutil.which("c++") or shutil.which("clang++")
    if not compiler:
        say("C++ peers: skipped, no C++ compiler")
        return None
    flags, libraries = [], []
    for name, header, library in (("ADOLC", "adolc/adolc.h", "-ladolc"), ("ADEPT", "adept.h", "-ladept"),
                                  ("CPPAD", "cppad/cppad.hpp", None)):
        test = "#include <%s>\nint main() { return 0; }\n" % header
        probe = [compiler, "-std=c++17", "-x", "c++", "-", "-o", os.path.join(folder, "probe")]
        found = subprocess.run(probe + ([library] if library else []), input=test, text=True, stderr=subprocess.DEVNULL)
        if found.returncode == 0:
            flags.append("-DHAVE_" + name)
            libraries += [library] if library else []
        else:
            say("%s: skipped, not installed" % name)
    out = os.path.join(folder, "scalar")
    command = [compiler, "-O3", "-march=native", "-std=c++17", *flags, os.path.join(HERE, "cpp", "scalar.cpp"), "-o", out,
               *libraries]
    return out if subprocess.run(command).returncode == 0 else None


def ode_peers(folder, lg_bench):
    """Compiles bench/c/ode_peers.c against the static library beside lg-bench, with ARKODE where it is installed; the
    path, or None."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    library = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(lg_bench))), "libliegrad.a")
    if not compiler or not os.path.exists(library):
        say("peers of ode: skipped, no %s" % ("C compiler" if not compiler else library))
        return None
    blas = subprocess.run(["pkg-config", "--libs", "openblas"], stdout=subprocess.PIPE, text=True).stdout.split()
    libraries, flags = [*(blas or ["-lopenblas"]), "-lpthread", "-lm"], []
    test = "#include <arkode/arkode_erkstep.h>\n#include <nvector/nvector_serial.h>\nint main(void) { return 0; }\n"
    arkode = ["-lsundials_arkode", "-lsundials_nvecserial"]
    probe = [compiler, "-x", "c", "-", "-o", os.path.join(folder, "probe"), *arkode, "-lm"]
    if subprocess.run(probe, input=test, text=True, stderr=subprocess.DEVNULL).returncode == 0:
        flags, libraries = ["-DHAVE_ARKODE"], arkode + libraries
    else:
        say("ARKODE: skipped, not installed")
    out = os.path.join(folder, "ode_peers")
    command = [compiler, "-O3", "-march=native", "-std=gnu11", *flags, "-I", os.path.join(ROOT, "include"),
               os.path.join(HERE, "c", "ode_peers.c"), "-o", out, library, *libraries]
    return out if subprocess.run(command).returncode == 0 else None


def at_error(points, target, key):
    """What `key` is where the error falls to the target: both logarithms interpolated between the last tolerance that
    misses it and the next one. None when the points do not enclose it."""
    points = sorted(points, key=lambda p: -p["tolerance"])
    for before, after in reversed(list(zip(points, points[1:]))):
        if before["error"] > target >= after["error"] > 0:
            share = math.log(before["error"] / target) / math.log(before["error"] / after["error"])
            x, y = max(before[key], 1e-17), max(after[key], 1e-17)  # manifold errors may be 0
            return math.exp((1 - share) * math.log(x) + share * math.log(y))
    return None


def median_rows(results, case):
    """Rows of several runs of the same: medians of medians, least of least; other fields of the first run. By batch, by
    name, or only the first row, under None."""
    if case in NAMED:
        return median_by_name(results)
    out = {}
    for result in results:
        for r in result["rows"] if case in BATCHED else result["rows"][:1]:
            out.setdefault(r["batch"] if case in BATCHED else None, []).append(r)
    return {key: median_row(rows) for key, rows in out.items()}


def median_by_name(results):
    out = {}
    for result in results:
        for r in result["rows"]:
            out.setdefault(r["name"], []).append(r)
    return {key: median_row(rows) for key, rows in out.items()}


def median_row(rows):
    return dict(rows[0], median_us=statistics.median(r["median_us"] for r in rows), min_us=min(r["min_us"] for r in rows))


def number(x, digits=3):
    if x is None or x != x:
        return "-"
    return ("%." + str(digits) + "g") % x if abs(x) < 10**digits and abs(x) >= 1e-4 or x == 0 else (
        "%.0f" % x if abs(x) >= 1 else "%.1e" % x)


def table(head, rows):
    """Markdown, aligned."""
    cells = [head] + [[c if isinstance(c, str) else number(c) for c in row] for row in rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    line = lambda row: "| " + " | ".join(c.ljust(w) if i == 0 else c.rjust(w)
                                         for i, (c, w) in enumerate(zip(row, widths))) + " |"
    rule = "|" + "|".join("-" * (w + 1) + ("-" if i == 0 else ":") for i, w in enumerate(widths)) + "|"
    return "\n".join([line(cells[0]), rule] + [line(row) for row in cells[1:]])


def save_csv(path, head, rows):
    """The rows of `table` as a CSV file, numbers as the table shows them."""
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows([c if isinstance(c, str) else number(c) for c in row] for row in rows)


def workspace():
    return tempfile.TemporaryDirectory(prefix="liegrad-bench-")
