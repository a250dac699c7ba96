"""What bench/figures stands on: scenes, runs of lg-simulate and what they leave, exact solutions, plots by gnuplot."""
import json
import math
import os
import re
import shutil
import subprocess

import benchlib as lib

try:
    import h5py
    import numpy as np
except ImportError:
    np = None  # plots need neither

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#666666", "#000000", "#7a5c2e", "#b8242f")


def find_lg_simulate(build):
    for folder in ([build] if build else []) + [os.environ.get("LIEGRAD_BUILD", ""), os.path.join(lib.ROOT, "build")]:
        path = os.path.join(folder, "bin", "lg-simulate")
        if folder and os.access(path, os.X_OK):
            return path
    raise SystemExit("lg-simulate is not built; scripts/configure build && cmake --build build (or --build FOLDER)")


def rows_of(path):
    """The rows of numbers in the data of a plot, FILE.dat, as words; its texts begin with =."""
    with open(path) as file:
        return [line.split() for line in file if line.strip() and not line.startswith("=")]


class Simulate:
    """Runs of lg-simulate; scenes are dictionaries (JSON is YAML) or names of files in scenes/."""

    def __init__(self, path, folder):
        self.path, self.folder, self.scenes = path, folder, {}

    def scene(self, what):
        if isinstance(what, str):
            return os.path.join(lib.ROOT, "scenes", what)
        text = json.dumps(what)
        if text not in self.scenes:
            self.scenes[text] = os.path.join(self.folder, "scene%d.json" % len(self.scenes))
            with open(self.scenes[text], "w") as file:
                file.write(text)
        return self.scenes[text]

    def __call__(self, scene, *options):
        """The object it prints; of a run that fails {'failed': exit code, 'why': its last line}."""
        command = [self.path, self.scene(scene), "--json", *map(str, options)]
        done = subprocess.run(command, env=lib.environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if done.returncode == 0:
            return json.loads(done.stdout)
        lines = done.stderr.strip().splitlines()
        return {"failed": done.returncode, "why": lines[-1] if lines else ""}

    def end(self, scene, *options):
        result = self(scene, *options)
        if "failed" in result:
            raise SystemExit("lg-simulate %s: %s" % (" ".join(map(str, options)), result["why"]))
        return np.array(result["y"]), result

    def least(self, times, scene, *options):
        """The object of the fastest of several runs."""
        return min((self.end(scene, *options)[1] for _ in range(times)), key=lambda r: r["seconds"])

    def error(self, scene, reference, *options):
        """Distance from the reference at the end, and the object; NaN of a run that fails."""
        result = self(scene, *options)
        return (math.nan if "failed" in result else float(np.linalg.norm(np.array(result["y"]) - reference))), result

    def trajectory(self, scene, *options):
        """t, the states by row, the invariants by name, the object."""
        out = os.path.join(self.folder, "trajectory.h5")
        _, result = self.end(scene, "--out", out, *options)
        with h5py.File(out, "r") as file:
            invariants = {name: np.array(row) for name, row in file["invariants"].items()} if "invariants" in file else {}
            return np.array(file["t"]), np.array(file["trajectory"]), invariants, result

    def trace(self, scene, *options):
        """Of each step (of the largest of neighbours when there are many): t at its end, h, manifold error, drift of each
        invariant; 0 stands for what does not show on a logarithmic axis."""
        stem = os.path.join(self.folder, "steps")
        _, result = self.end(scene, "--plot", stem + ".svg", "--plot-kind", "steps", *options)
        rows = [[float(x) for x in row] for row in rows_of(stem + ".dat")]
        return np.nan_to_num(np.array(rows)), result

    def reference(self, scene, *options):
        """State at the end by rkmk54 at tolerance 1e-13, and its distance from dp54 at 1e-14."""
        y, _ = self.end(scene, "--method", "rkmk54", "--tol", "1e-13", *options)
        other, _ = self.end(scene, "--method", "dp54", "--tol", "1e-14", *options)
        return y, float(np.linalg.norm(y - other))

    def work(self, scene, methods, *options):
        """Points of --work-precision: method, steps, seconds of CPU, error relative to the state at the end, ..."""
        result = self(scene, "--work-precision", "--methods", ",".join(methods), *options)
        if "failed" in result:
            raise SystemExit("lg-simulate --work-precision: %s" % result["why"])
        for p in result["work_precision"]:
            p["h"] = result["t"] / p["steps"]
        return result

    def seconds(self, scene, method, *options):
        """CPU seconds of one run, the least of many."""
        return self.work(scene, [method], "--levels", 1, *options)["work_precision"][0]["seconds"]


# ---- scenes ----

HALF = math.sqrt(0.5)


def chain(links, length, start, t_end, **more):
    """Links of mass 1 and one length, all from the same (q, omega)."""
    return dict(system="pendulum-chain", gravity=9.81, masses=[1] * links, lengths=[length] * links,
                initial=dict(q=[start[:3]] * links, omega=[start[3:]] * links), t_end=t_end, **more)


# Both links of a double pendulum turn out of their common plane.
SPATIAL = dict(system="pendulum-chain", gravity=9.81, masses=[1, 1.3], lengths=[1, 0.8], t_end=3,
               initial=dict(q=[[0.6, 0, 0.8], [0, 0.8, -0.6]], omega=[[0, 1, 0], [1.2, 0.3, 0.4]]))


def heavy_top(form, t_end=1, spin=150.0):
    inertia = [0.234375, 0.46875, 0.234375]
    momentum = [0, inertia[1] * spin, -inertia[2] * 4.61538]
    gamma = [0, 0, -9.81]
    top = dict(system="heavy-top", form=form, inertia=inertia, mass=15, length=2, chi=[0, 1, 0], gamma0=gamma,
               t_end=t_end)
    start = dict(Gamma=gamma, Pi=momentum) if form == "lie-poisson" else dict(Q=[[1, 0, 0], [0, 1, 0], [0, 0, 1]], pi=momentum)
    return dict(top, initial=start)


def quadrotors(beside=0.0, t_end=5):
    """The published start; `beside`: metres of the payload across the plane of motion."""
    s, c = math.sin(math.radians(80)), math.cos(math.radians(80))
    return dict(system="quadrotors", payload=0.4, masses=[0.755, 0.755], lengths=[0.6, 0.8],
                gravity=9.81, kx=4, kv=4, kq=100, kw=20, beta=math.pi / 6, reference="parabola",
                initial=dict(y=[-2, beside, 0], v=[0, 0, 0], q=[[s, 0, c], [-s, 0, c]]), t_end=t_end)


# ---- exact solutions (Abramowitz and Stegun, 16.4 and 17.6: the arithmetic-geometric mean) ----

def amplitude(u, k_prime):
    """am(u | k), k'^2 = 1 - k^2 given."""
    a, b, c = 1.0, k_prime, math.sqrt(1 - k_prime * k_prime)
    rows = []
    while abs(c) > 1e-17 * a and len(rows) < 40:
        a, b, c = (a + b) / 2, math.sqrt(a * b), (a - b) / 2
        rows.append((a, c))
    phi = 2.0 ** len(rows) * a * u
    for a, c in reversed(rows):
        phi = (phi + math.asin(c / a * math.sin(phi))) / 2
    return phi


def rigid_body(mu, inertia, t):
    """Body momentum of a free body with I1 < I2 < I3 turning closer to axis 1 than the separatrix does: 2 E I2 > |mu|^2."""
    i1, i2, i3 = inertia
    two_e, m2 = sum(m * m / i for m, i in zip(mu, inertia)), sum(m * m for m in mu)
    above = mu[0] ** 2 * (i2 / i1 - 1) + mu[2] ** 2 * (i2 / i3 - 1)  # 2 E I2 - |mu|^2 without cancellation
    top, bottom = two_e * i3 - m2, m2 - two_e * i1
    sizes = (math.sqrt(i1 * top / (i3 - i1)), math.sqrt(i2 * bottom / (i2 - i1)), math.sqrt(i3 * bottom / (i3 - i1)))
    k_prime = math.sqrt((i3 - i1) * above / ((i2 - i1) * top))
    rate = math.sqrt((i2 - i1) * top / (i1 * i2 * i3))
    sign = math.copysign(1, mu[0])
    phi0 = math.atan2(mu[1] / sizes[1], mu[2] / sizes[2])
    low, high = -100.0, 100.0
    for _ in range(200):  # am is monotone
        middle = (low + high) / 2
        low, high = (middle, high) if amplitude(middle, k_prime) < phi0 else (low, middle)
    # mu2' = mu1 mu3 (1/I1 - 1/I3): the sign of mu1 gives the direction.
    phi = amplitude(low + sign * rate * t, k_prime)
    s, c = math.sin(phi), math.cos(phi)
    d = math.sqrt(c * c + k_prime * k_prime * s * s)
    return np.array([sign * sizes[0] * d, sizes[1] * s, sizes[2] * c])


def upright_pendulum(offset, gravity, length, t):
    """q and omega of a pendulum released at rest at sin(angle from upright) = offset in the x-z plane, e3 up: with
    the angle theta from hanging, sin(theta/2) = k sn(K - w t) and cos(theta0/2) = k'."""
    angle = math.asin(offset)
    k_prime = math.sin(angle / 2)
    k, w = math.cos(angle / 2), math.sqrt(gravity / length)
    a, b = 1.0, k_prime
    for _ in range(12):
        a, b = (a + b) / 2, math.sqrt(a * b)
    quarter = math.pi / (2 * a)
    phi = amplitude(quarter - w * t, k_prime)
    half = k * math.sin(phi)
    other = math.sqrt(math.cos(phi) ** 2 + (k_prime * math.sin(phi)) ** 2)  # dn = cos(theta/2)
    rate = -2 * w * k * math.cos(phi)  # theta'
    theta_sin, theta_cos = 2 * half * other, other * other - half * half
    # q = (sin theta, 0, -cos theta); q' = theta' (cos theta, 0, sin theta) = omega x q, omega = -theta' e2
    return np.array([theta_sin, 0, -theta_cos, 0, -rate, 0])


# ---- measures ----

def order(points):
    """Slope of log error against log h over errors in [1e-11, 1e-3], and how many points it is from."""
    rows = [(math.log(p["h"]), math.log(p["error"])) for p in points if 1e-11 <= p["error"] <= 1e-3]
    if len(rows) < 3:
        return None, len(rows)
    return float(np.polyfit(*zip(*rows), 1)[0]), len(rows)


def by_method(points):
    out = {}
    for p in points:
        out.setdefault(p["method"], []).append(p)
    return out


# ---- plots ----

def quoted(text):
    """The text as a string of gnuplot, in which nothing is a command: of ASCII only letters, blanks, commas and points stand as
    they are. (Doubled single quotes do not do: gnuplot 5.4 misreads a string that begins with one.)"""
    return '"%s"' % re.sub("[^A-Za-z ,.\x80-\U0010ffff]", lambda c: "\\%03o" % ord(c.group()), text)


class Panel:
    """A graph: settings of gnuplot, and curves (title, points, style). Titles and labels are any texts; settings and styles are
    commands, so they must hold no text of a file."""

    def __init__(self, title, x, y, *settings, space=False):
        self.settings = ["set title " + quoted(title), "set xlabel %s offset 0,0.5" % quoted(x), "set ylabel " + quoted(y),
                         *settings]
        self.space, self.curves = space, []

    def add(self, title, points, style=None, colour=None):
        style = style or "with lines lw 1.6"
        if colour != "":  # "": the style has its own
            style += " lc rgb '%s'" % COLOURS[(len(self.curves) if colour is None else colour) % len(COLOURS)]
        self.curves.append((title, points, style))
        return self

    def script(self, name):
        lines = ["reset", "set encoding utf8", "set grid lc rgb '#dddddd'", "set border lc rgb '#555555'",
                 "set tics nomirror", "set key below samplen 2 spacing 1.1", *self.settings]
        for i, (_, points, _) in enumerate(self.curves):
            lines += ["$%s%d << EOD" % (name, i)] + [" ".join(x if x == "" else "%.9g" % x for x in p) for p in points] + ["EOD"]
        draw = ", ".join("$%s%d %s %s" % (name, i, style, "title " + quoted(title) if title else "notitle")
                         for i, (title, _, style) in enumerate(self.curves))
        return lines + [("splot " if self.space else "plot ") + draw]


MARKS = "with linespoints pt 7 ps 0.5 lw 1.6"
LOG_X, LOG_Y = ("set logscale x", "set format x '10^{%L}'"), ("set logscale y", "set format y '10^{%L}'")
LOG = LOG_X + LOG_Y


def draw(path, columns, panels, width=560, height=400):
    """Draws a plot .svg or .png. gnuplot writes it to its standard output, so it never sees the name."""
    if not shutil.which("gnuplot"):
        lib.say("gnuplot is not installed: no %s" % os.path.basename(path))
        return
    rows = -(-len(panels) // columns)
    terminal = "pngcairo size %d,%d" if path.endswith(".png") else "svg size %d,%d background '#ffffff' font 'sans,13'"
    lines = ["set terminal " + terminal % (width * columns, height * rows), "set multiplot layout %d,%d" % (rows, columns)]
    for i, panel in enumerate(panels):
        lines += panel.script("p%dc" % i)
    with open(path, "wb") as plot:
        subprocess.run(["gnuplot", "-d"], input="\n".join(lines + ["unset multiplot", ""]).encode(), stdout=plot, check=True)


def thin(rows, most=700):
    """At most so many rows, evenly."""
    return rows[::max(1, -(-len(rows) // most))]


def largest(rows, most=500):
    """(t, value): of neighbours the one with the largest value, zeros raised to the bottom of double precision."""
    rows = [(t, max(float(v), 1e-17)) for t, v in rows]
    many = max(1, -(-len(rows) // most))
    return [max(rows[i:i + many], key=lambda r: r[1]) for i in range(0, len(rows), many)]
