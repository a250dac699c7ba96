"""The rows of bench/hard-cases that drive commands."""
import json
import math
import os
import shlex
import subprocess
import tempfile

ROWS = []


class Row:
    """Files (texts, or functions of the path) that are written into an empty folder, commands that are run there one after the
    other, and what is asked of the last one: a number of its JSON object, or an exit code and a sentence on stderr."""

    def __init__(self, room, case, lines, files, how, metric, allows, ask):
        self.room, self.case, self.lines, self.files, self.how = room, case, lines, files, how
        self.metric, self.allows, self.ask = metric, allows, ask
        ROWS.append(self)

    def measure(self, programs, cache):
        with tempfile.TemporaryDirectory(dir=cache) as folder:
            for name, content in self.files.items():
                path = os.path.join(folder, name)
                if callable(content):
                    content(path)
                    continue
                with open(path, "w") as file:
                    file.write(content)
            for line in self.lines:
                words = shlex.split(line)
                words[0] = os.path.join(programs, words[0])
                done = subprocess.run(words + ["--json"], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                      timeout=900)
        return [self.case, self.how, self.metric, self.ask(done), self.allows, ("command", self.case)]


def at(value, path):
    """A number of an object by its path, "identified/damping.x/value"."""
    for name in path.split("/"):
        value = value[int(name) if isinstance(value, list) else name]
    return value


def number(room, case, path, want, allows, *lines, metric="relative", how="closed form", size=1.0, **files):
    """`path` of the last command's JSON is `want`; absolute errors are divided by `size`."""
    def ask(done):
        if done.returncode:
            return float("inf")
        got = at(json.loads(done.stdout), path)
        if got is None:
            return float("inf")
        return abs(got - want) / (abs(want) if metric == "relative" else size)
    Row(room, case, lines, renamed(files), how, metric, allows, ask)


def told(room, case, code, sentence, *lines, **files):
    """The last command ends with the exit code and says the sentence; "!sentence": does not say it."""
    def ask(done):
        said = (sentence.lstrip("!") in done.stderr) != sentence.startswith("!")
        return 0.0 if done.returncode == code and said else float("inf")
    Row(room, case, lines, renamed(files), "exit %d, told" % code, "told", 0, ask)


def arrays(attributes=None, **sets):
    """A file of HDF5 with these data sets; needs h5py."""
    def write(path):
        import h5py
        with h5py.File(path, "w") as file:
            for name, values in sets.items():
                file[name] = values
            file.attrs.update(attributes or {})
    return write


def renamed(files):
    """scene_yaml -> scene.yaml"""
    return {".".join(name.rsplit("_", 1)): text for name, text in files.items()}


# ---- Hamiltonians: a spherical pendulum of mass M, its potential M g L e3.q learned, starts in [0, M] ----

PENDULUM = """system: pendulum-chain
form: hamiltonian
gravity: %.17g
masses: [%.17g]
lengths: [%.17g]
t_end: 1
starts: {kind: box, low: %.17g, high: %.17g}
"""


def learned(mass=1.0, length=1.0, second=1.0, low=0.0, trajectories=30):
    """A scene in units of mass, length and time, and the commands that learn it."""
    momentum = mass * length**2 / second
    scene = PENDULUM % (9.81 * length / second**2, mass, length, low * momentum, momentum)
    return scene, ("lg-hamiltonian generate s.yaml --trajectories %d --points 5 --t-end %.17g --out d.h5" % (trajectories, 0.1 * second),
                   "lg-hamiltonian train d.h5 --preset best --potential linear --substeps 4 --out m.h5",
                   "lg-hamiltonian evaluate m.h5 d.h5")


for name, units in {"M = 1e-9": dict(mass=1e-9), "M = 1e-6": dict(mass=1e-6), "M = 1": {}, "M = 100": dict(mass=100.0),
                    "M = 1000": dict(mass=1000.0), "M = 1e6": dict(mass=1e6), "M = 1e9": dict(mass=1e9), "L = 1e-9": dict(length=1e-9),
                    "seconds in 1e-9": dict(second=1e9)}.items():
    scene, lines = learned(**units)
    momentum = units.get("mass", 1.0) * units.get("length", 1.0)**2 / units.get("second", 1.0)
    number("Hamiltonians", "pendulum, E1/max(1, p^2), " + name, "E1", 0, 1e-11, *lines, metric="absolute", how="data", size=max(1.0, momentum)**2,
           s_yaml=scene)
scene, lines = learned(trajectories=1)
told("Hamiltonians", "one trajectory of a conservative system", 0, "!not conservative", *lines[:2], s_yaml=scene)


def swings(count, start=0.5, friction=0.0, spread=0.0, points=20):
    """Trajectories of one harmonic oscillator in the file of a pair of them, whose other half rests."""
    t = [0.1 * i for i in range(points)]
    sizes = [start * (1 + spread * i / count) for i in range(count)]
    runs = [[[a * math.exp(-friction * s) * x for x in (math.cos(s), 0.0, -math.sin(s), 0.0)] for s in t] for a in sizes]
    return arrays(dict(system="coupled-oscillators", layout="q p"), t=t, trajectories=runs)


LEARN = "lg-hamiltonian train d.h5 --preset best --epochs 100 --out m.h5"
for name, sentence, data in (("one trajectory 30 times", "!not conservative", swings(30)), ("one trajectory 30 times, told", "repeat another one", swings(30)),
                             ("at rest", "nothing moves", swings(30, 0.0)), ("friction", "does not explain", swings(30, 0.5, 0.3, 2.0))):
    told("Hamiltonians", name, 0, sentence, LEARN, d_h5=data)

# ---- machines: x'' = -k x - c x', k = 4, c = 0.3 ----

MACHINE = """columns: {time: t}
coordinates: [{name: x, kind: line, velocity: vx}]
mass: {kind: known, values: 1}
potential: {kind: quadratic, of: x}
damping: diagonal
"""


def decay(k=4.0, c=0.3, rows=200, dt=0.05, X=1.0, T=1.0, x0=1.0, cell=None):
    """A log of the free motion from x0 at rest; X and T: units. `cell`: (row, text of x)."""
    w, lines = math.sqrt(k - c * c / 4), ["t,x,vx"]
    for i in range(rows):
        t = i * dt
        e = x0 * math.exp(-c / 2 * t)
        x, v = e * (math.cos(w * t) + c / 2 / w * math.sin(w * t)), -e * k / w * math.sin(w * t)
        lines.append("%.17g,%s,%.17g" % (t * T, cell[1] if cell and cell[0] == i else "%.17g" % (x * X), v * X / T))
    return "\n".join(lines) + "\n"


FIT = "lg-identify fit m.yaml l.csv --substeps 4 --out m.h5"
for name, X, T in (("SI", 1.0, 1.0), ("x in 1e-9", 1e9, 1.0), ("x in 1e9", 1e-9, 1.0), ("t in 1e-9", 1.0, 1e9), ("t in 1e9", 1.0, 1e-9)):
    number("machines", "damping of an oscillator, " + name, "identified/damping.x/value", 0.3 / T, 3e-8, FIT, m_yaml=MACHINE,
           l_csv=decay(X=X, T=T))
for name, code, sentence, log in (
        ("at rest", 3, "nothing moves", decay(x0=0)), ("two rows", 3, "has 2 rows", decay(rows=2)),
        ("a cell of 1e308", 3, "line 52: column x: 1e+308 is so large", decay(cell=(50, "1e308"))), ("a cell of nan", 0, "", decay(cell=(50, "nan"))),
        ("a cell of 9,81", 3, "line 52", decay(cell=(50, "9,81"))), ("a time twice", 3, "line 3: column t: time does not increase", decay(dt=0.0)),
        ("no potential in the model of a spring", 0, "the model does not explain the logs", decay())):
    told("machines", name, code, sentence, FIT, m_yaml=MACHINE if "no potential" not in name else MACHINE.replace(
        "{kind: quadratic, of: x}", "none"), l_csv=log)
told("machines", "a log 1e6 times as large as those of the fit", 0, "column x goes to 1e+06", FIT, "lg-identify evaluate m.h5 far.csv", m_yaml=MACHINE, l_csv=decay(),
     far_csv=decay(x0=1e6))

# ---- tables ----

def table(rows=200, cell=None, row=50, unit=1.0):
    """a, b, y = 2 a - b, of a lattice, a in a unit; `cell` in one row."""
    lines = ["a,b,y"]
    for i in range(rows):
        a, b = round((0.618034 * i) % 1 * 2 - 1, 6), round((0.414214 * i) % 1 * 2 - 1, 6)
        lines.append("%.17g,%.6f,%s" % (a * unit, b, "%.17g" % (2 * a - b) if cell is None or i != row else cell))
    return "\n".join(lines) + "\n"


TRAIN = "lg-fit train t.csv --outputs y --out m.h5 --epochs 50"
number("tables", "y = 2 a - b", "rmse/y", 0, 1e-6, TRAIN, metric="absolute", t_csv=table())
number("tables", "y = 2 a - b, y in 1e-9", "rmse/y", 0, 1e3, TRAIN, metric="absolute",
       t_csv=table().replace("\n", "e9\n").replace("ye9", "y"))
for name, code, sentence, text in (
        ("a cell of 1e308", 0, "1e+308", table(cell="1e308")), ("an input of 1e-310", 3, "give the column in a smaller unit", table(unit=1e-310)),
        ("constant output", 0, "column y is constant", "a,b,y\n" + "".join("%d,%d,3\n" % (i, i * i % 7) for i in range(50))),
        ("constant input", 0, "column a is constant", "a,b,y\n" + "".join("5,%d,%d\n" % (i * i % 7, i) for i in range(50))),
        ("every row the same", 3, "all inputs are constant", "a,b,y\n" + "1,2,3\n" * 50), ("one row", 3, "has 1 complete row", "a,b,y\n1,2,3\n"),
        ("every row twice", 0, "200 rows repeat other rows", table() + table().split("\n", 1)[1]), ("a row too short", 3, "line 202", table() + "1,2\n"),
        ("a column twice", 3, "there are two columns 'a'", "a,a,y\n1,2,3\n"), ("9,81 for 9.81", 3, "line 52", table(cell="9,81")), ("no rows", 3, "no rows", "a,b,y\n")):
    told("tables", name, code, sentence, TRAIN, t_csv=text)
told("detectors", "a table of one class", 3, "one class only", "lg-fit train t.csv --class y --out m.h5",
     t_csv="a,b,y\n" + "".join("%d,%d,one\n" % (i, i * i % 7) for i in range(50)))


def windows(count=40, classes=2, cell=None):
    """Windows of two channels, of which the second is constant; the first one's amplitude tells the classes."""
    x = [[[(1 + i % classes) * math.sin(0.1 * t + i) for t in range(100)], [7.0] * 100] for i in range(count)]
    if cell is not None:
        x[3][0][5] = cell
    return arrays(X=x, y=[i % classes for i in range(count)])


for method in ("logistic --features std", "tree --features std", "svm-linear --features std"):
    number("detectors", "a constant channel, " + method, "train_accuracy", 1, 0, "lg-anomaly train w.h5 --out m.h5 --method " + method, w_h5=windows())
TREE = "lg-anomaly train w.h5 --out m.h5 --method tree --features std"
told("detectors", "windows of one class", 2, "all windows are of one class", TREE, w_h5=windows(classes=1))
told("detectors", "a sample of 1e308", 3, "beyond single precision in window 3", TREE, w_h5=windows(cell=1e308))
told("detectors", "a sample of NaN", 3, "NaN in window 3", TREE, w_h5=windows(cell=math.nan))

# ---- files: scenes ----

BODY = """system: rigid-body
inertia: [1, 2, 3]
initial: {mu: [%s]}
t_end: 10
"""
RUN = "lg-simulate s.yaml --tol 1e-10"
for name, code, sentence, text in (
        ("a number with its unit", 3, "line 4", (BODY % "1, 2, 3").replace("t_end: 10", "t_end: 10s")),
        ("9,81 for 9.81", 3, "line 2", "system: pendulum-chain\ngravity: 9,81\nt_end: 1\ninitial: {q: [0, 0, 1], omega: [0, 0, 0]}\n"),
        ("NaN", 3, "line 3", BODY % "1, .nan, 3"), ("infinity", 3, "line 3", BODY % "1, .inf, 3"), ("1e309", 3, "line 3", BODY % "1, 1e309, 3"),
        ("a key twice", 3, "stands twice", BODY % "1, 2, 3" + "t_end: 5\n"), ("an unknown key", 3, "t_ende", (BODY % "1, 2, 3").replace("t_end", "t_ende")),
        ("two moments", 3, "line 2", (BODY % "1, 2, 3").replace("[1, 2, 3]", "[1, 2]")), ("a moment of 0", 3, "line 2", (BODY % "1, 2, 3").replace("[1, 2, 3]", "[1, 0, 3]")),
        ("empty", 3, "is empty", ""), ("a direction of length 2", 3, "off the sphere", "system: pendulum-chain\ngravity: 9.81\nt_end: 1\ninitial: {q: [0, 0, 2], omega: [0, 0, 0]}\n")):
    told("files", "scene: " + name, code, sentence, RUN, s_yaml=text)
number("files", "scene: mu of 1e-310", "y/2", 1e-310, 1e-13, RUN, s_yaml=BODY % "0, 0, 1e-310")
number("files", "scene: 17 digits come back", "y/2", 0.1 + 0.2, 0, RUN, s_yaml=BODY % "0, 0, 0.30000000000000004")
told("files", "a model that is no file of HDF5", 3, "is not an HDF5 file", "lg-fit evaluate m.h5 t.csv", m_h5="hello\n", t_csv=table())

# ---- integrators: what has to be told ----

TWO = """system: pendulum-chain
gravity: 9.81
masses: [1, 1]
lengths: [1, 1]
initial: {q: [[%s], [%s]], omega: [[0, 0.1, 0], [0, 0, 0.2]]}
t_end: %g
"""
UP = TWO % ("0, 0, 1", "1, 0, 0", 3)
told("integrators", "two links, rkmk4, 20 steps for 3 s", 0, "steps", "lg-simulate s.yaml --method rkmk4 --steps 20", s_yaml=UP)
told("integrators", "two links, chaos, T = 100", 0, "the result is not reliable", "lg-simulate s.yaml --tol 1e-8", s_yaml=TWO % ("0, 0, 1", "1, 0, 0", 100))
