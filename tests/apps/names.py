#!/usr/bin/env python3
"""names.py BIN [--seconds S] [--seed N] [--only WORD] [--keep]: hostile names in every place of every format where a name can stand.

Makes one input of each kind whose names are placeholders, and models from these. Each command then runs on copies whose
placeholders are replaced by hostile texts (CSV and YAML are quoted, in HDF5 the bytes are replaced), with the default list of texts, or
with --seconds by random texts, random commands and random strings of the HDF5 files. Of each command it checks:
- no program ran (each text tries to make the file RAN), and the command was not ended by a signal,
- nothing but its outputs is new in its folder, and nothing is new or changed above it,
- standard output and standard error have no control character, and text read with --json is JSON,
- a plot that was drawn shows each name that it must show.
Every program and verb of BIN (from --help) must be a row here or be named in NOT_RUN; every option --plot must be used.
"""
import argparse, ctypes, ctypes.util, glob, json, os, random, re, shutil, subprocess, sys, tempfile, time, html

LENGTH = 30  # bytes of a placeholder, and of each hostile text


def place(k):
    return ("Zq%02d" % k).ljust(LENGTH, "x")


PLACE = [place(k) for k in range(40)]
HOSTILE = [
    "a`touch RAN`b", "u'.system('touch RAN').'", "'.system(\"touch RAN\").'", "$(touch RAN)", '"; system "touch RAN"; "', "p\n!touch RAN\n#",
    "\033]0;title\007\033[31m", "\u009b31m\u202eevil", "%s%n%d%.2g{/Bold=40 x}_1^2", "@ARG1 \\n\\\"\\042", "x\ty\rz\x7f", "<touch RAN;", "|touch RAN",
    "../../RAN", "=cmd|' /C touch RAN'!A0", ",;\"'", "-rf --out=RAN", "<b>&amp;</b>", "#{`touch RAN`}", "nan", "1e400", "~", "[a, {b", "*a &b !c",
]


def fit_to(text, length=LENGTH):
    """The text with exactly `length` bytes of UTF-8, filled with x."""
    raw = text.encode("utf-8", "surrogateescape")[:length].decode("utf-8", "ignore")
    return raw + "x" * (length - len(raw.encode()))


# ---- the formats ----
def quoted_csv(text):
    return '"' + text.replace('"', '""') + '"'


def quoted_yaml(text):
    out = []
    for c in text:
        code = ord(c)
        if c in '"\\':
            out.append("\\" + c)
        elif code < 0x20 or 0x7f <= code < 0xa0 or code in (0x202e, 0x2028, 0x2029, 0xfeff):
            out.append("\\x%02x" % code if code < 0x100 else "\\u%04x" % code)
        else:
            out.append(c)
    return '"' + "".join(out) + '"'


def replace_all(text, texts, quote):
    for k, with_ in texts.items():
        text = text.replace(PLACE[k], quote(with_))
    return text


def patched(raw, texts):
    for k, with_ in texts.items():
        raw = raw.replace(PLACE[k].encode(), fit_to(with_).encode())
    return raw


class H5:
    """Just enough of the HDF5 library to give a file attributes of text."""

    def __init__(self):
        name = ctypes.util.find_library("hdf5_serial") or ctypes.util.find_library("hdf5")
        self.lib = ctypes.CDLL(name)
        for f in ("H5Fopen", "H5Tcopy", "H5Screate", "H5Acreate2"):
            getattr(self.lib, f).restype = ctypes.c_int64
        self.lib.H5open()
        self.text = ctypes.c_int64.in_dll(self.lib, "H5T_C_S1_g").value

    def attribute(self, path, name, value):
        lib, i64, none = self.lib, ctypes.c_int64, ctypes.c_int64(0)
        file = i64(lib.H5Fopen(path.encode(), ctypes.c_uint(1), none))
        lib.H5Adelete(file, name.encode())
        kind = i64(lib.H5Tcopy(i64(self.text)))
        lib.H5Tset_size(kind, ctypes.c_size_t(len(value.encode())))
        space = i64(lib.H5Screate(0))
        made = i64(lib.H5Acreate2(file, name.encode(), kind, space, none, none))
        assert made.value >= 0 and lib.H5Awrite(made, kind, value.encode()) >= 0
        lib.H5Aclose(made), lib.H5Fclose(file)


# ---- inputs ----
def table(rows=40):
    lines = [",".join(PLACE[k] for k in (0, 1, 2))]
    lines += ["%d,%d,%g" % (i, i * i % 17, i * 3 + i * i % 5) for i in range(1, rows)]
    return "\n".join(lines) + "\n"


def classes(rows=60):
    lines = [",".join(PLACE[k] for k in (0, 1, 3))]
    lines += ["%g,%g,%s" % (i % 3 + 0.01 * i, i * i % 7, PLACE[4 + i % 3]) for i in range(rows)]
    return "\n".join(lines) + "\n"


MACHINE = """columns: { time: %s }
coordinates:
  - { name: %s, kind: line, velocity: %s }
inputs: { columns: [%s], hold: zero }
mass: diagonal
potential: { kind: quadratic, of: %s }
damping: diagonal
input_map: { kind: known, values: [[1]] }
""" % (PLACE[7], PLACE[8], PLACE[9], PLACE[10], PLACE[8])
KNOWN = MACHINE.replace("mass: diagonal", "mass: { kind: known, values: [2] }").replace(
    "potential: { kind: quadratic, of: %s }" % PLACE[8], "potential: { kind: known, form: quadratic, of: %s, values: [-2.5] }" % PLACE[8]).replace(
    "damping: diagonal", "damping: { kind: known, values: [0.3] }")
TASK = """plant: known.yaml
period: 0.05
horizon: 1
starts: { %s: [-0.5, 0.5], %s: [-0.5, 0.5] }
limits: { %s: 10 }
cost: { %s: 1, %s: 0.1, %s: 0.01 }
success: { %s: 0.1, hold: 0.5, within: 3 }
controller: { kind: lqr }
""" % (PLACE[8], PLACE[9], PLACE[10], PLACE[8], PLACE[9], PLACE[10], PLACE[8])
SCHEME = """name: %s
kind: rkmk
order: 3
c: [0, 1/2, 1]
a: [[], [1/2], [-1, 2]]
b: [1/6, 2/3, 1/6]
dexpinv: exact
""" % PLACE[11]
SCENE = """system: pendulum-chain
form: hamiltonian
gravity: 1
masses: [1]
lengths: [1]
initial: { q: [[0.6, 0, 0.8]], p: [[0, 0.5, 0]] }
t_end: 1
"""
START = SCENE
GRID = """scene: scene.yaml
integrators: [euler, cf4]
N: [4]
M: [2]
repeats: 1
epochs: 1
hidden: [4]
test: { trajectories: 2, points: 3 }
"""
RANGES = {"table": "ranges: { hidden: { integer: [3, 6] } }\nfixed: { epochs: 2 }\n",
          "curves": "ranges: { lr: { log-uniform: [1e-3, 1e-1] } }\nfixed: { epochs: 1, hidden: 4, layers: 1 }\n",
          "well": "ranges: { lr: { log-uniform: [1e-3, 1e-1] } }\nfixed: { epochs: 1, method: cnn }\n"}


def log():
    """Rows of 2 x'' = -5 x - .3 x' + u, by small steps."""
    x, v, lines = 1.0, 0.0, [",".join(PLACE[k] for k in (7, 8, 9, 10))]
    for i in range(200):
        u = [1.0, -1.0, 0.5][i // 7 % 3]
        lines.append("%.3f,%.9g,%.9g,%g" % (i * 0.05, x, v, u))
        for _ in range(50):
            v += 0.001 * (-5 * x - 0.3 * v + u) / 2
            x += 0.001 * v
    return "\n".join(lines) + "\n"


def feed():
    rows = ["%s" % ",".join(PLACE[12:18])]
    rows += [",".join("%.6g" % (random.Random(7 * i + c).gauss(0, 1)) for c in range(6)) for i in range(700)]
    return "\n".join(rows) + "\n"


# A row: program, verb and arguments, the inputs that hold names, the names that its plot shows (None: there is no --plot).
# {pic} is the plot's name and {out} the output's. JSON is asked for where the row's last word is --json.
ROWS = [
    ("lg-fit", "train table.csv --outputs {2} --epochs 2 --hidden 4 --test table.csv --out {out}.h5 --history {out}.csv --plot {pic}", [2]),
    ("lg-fit", "train classes.csv --class {3} --epochs 2 --hidden 4 --test classes.csv --out {out}.h5 --plot {pic} --json", [4, 5, 6]),
    ("lg-fit", "evaluate fit.h5 table.csv --plot {pic}", [2]),
    ("lg-fit", "evaluate class.h5 classes.csv --plot {pic}", [4, 5, 6]),
    ("lg-fit", "predict class.h5 classes.csv --out {out}.csv", None),
    ("lg-fit", "predict fit.h5 table.csv", None),
    ("lg-fit", "search ranges_table.yaml table.csv --outputs {2} --trials 2 --out {out}.csv --plot {pic}", []),
    ("lg-learn", "train --recipe table table.csv --outputs {2} --epochs 2 --hidden 4 --out {out}.h5 --plot {pic}", []),
    ("lg-learn", "evaluate fit.h5 table.csv", None),
    ("lg-learn", "predict ham.h5 --initial 0.6,0,0.8,0,0.5,0 --points 4 --out {out}.csv", None),
    ("lg-learn", "search ranges_table.yaml table.csv --recipe table --outputs {2} --trials 2 --out {out}.csv --plot {pic}", []),
    ("lg-learn", "list", None),
    ("lg-identify", "check machine.yaml log.csv --plot {pic}", [8, 9, 10]),
    ("lg-identify", "fit machine.yaml log.csv --epochs 2 --out {out}.h5 --plot {pic} --suggest {out}.yaml", []),
    ("lg-identify", "evaluate machine.h5 log.csv --horizons 1 --plot {pic}", [8, 9]),
    ("lg-identify", "predict machine.h5 log.csv --out {out}.csv --plot {pic}", [8, 9]),
    ("lg-identify", "adapt machine.h5 log.csv --seconds 3 --out {out}.h5", None),
    ("lg-identify", "generate known.yaml --inputs multisine --runs 1 --t-end 5 --out {out}.csv --plot {pic}", [8, 9, 10]),
    ("lg-control", "train task.yaml --out {out}.h5", None),
    ("lg-control", "evaluate policy.h5 --starts 4 --runs {out}.csv --plot {pic}", [8, 10]),
    ("lg-control", "certify task.yaml --lyapunov quadratic --box {8}=1,{9}=3 --level 0.01 --certificate {out}.json", None),
    ("lg-control", "verify proof.json", None),
    ("lg-simulate", "scene.yaml --scheme scheme.yaml --steps 10 --out {out}.h5 --plot {pic}", []),
    ("lg-simulate", "scene.yaml --scheme scheme.yaml --work-precision --methods rk4 --plot {pic}", [11]),
    ("lg-simulate", "scene.yaml --ensemble 4 --steps 10 --out {out}.h5 --plot {pic}", []),
    ("lg-hamiltonian", "generate scene.yaml --trajectories 4 --points 3 --t-end 0.1 --out {out}.h5", None),
    ("lg-hamiltonian", "train data.h5 --epochs 1 --hidden 4 --out {out}.h5 --plot {pic}", []),
    ("lg-hamiltonian", "evaluate ham.h5 data.h5 --plot {pic}", []),
    ("lg-hamiltonian", "predict ham.h5 scene.yaml --points 4 --t-end 0.1 --out {out}.h5 --plot {pic}", []),
    ("lg-hamiltonian", "search ranges_table.yaml data.h5 --trials 2 --out {out}.csv --plot {pic}", []),
    ("lg-hamiltonian", "study grid.yaml --out {out}.csv --plot {pic}", []),
    ("lg-elastica", "solve --case both-ends --x 3 --intervals 10 --out {out}.csv --plot {pic}", []),
    ("lg-elastica", "generate --case both-ends --count 3 --intervals 10 --out {out}.h5 --plot {pic}", []),
    ("lg-elastica", "train curves.h5 --network discrete --epochs 1 --hidden 4 --layers 1 --out {out}.h5 --plot {pic}", []),
    ("lg-elastica", "evaluate beam.h5 curves.h5 --plot {pic}", []),
    ("lg-elastica", "predict beam.h5 --x 3 --out {out}.csv --plot {pic}", []),
    ("lg-elastica", "search ranges_curves.yaml curves.h5 --trials 2 --out {out}.csv --plot {pic}", []),
    ("lg-anomaly", "generate --runs 2 --hours 0.1 --noise 1 --window 30 --out {out}.h5 --plot {pic}", []),
    ("lg-anomaly", "feed --hours 0.01 --noise 1 --out {out}.csv", None),
    ("lg-anomaly", "train series.h5 --method tree --out {out}.h5 --plot {pic}", [12]),
    ("lg-anomaly", "train series.h5 --method cnn --epochs 1 --plane 2 --out {out}.h5 --plot {pic}", []),
    ("lg-anomaly", "evaluate detector.h5 series.h5 --plot {pic} --scores {out}.csv", []),
    ("lg-anomaly", "evaluate tree.h5 series.h5 --plot {pic}", []),
    ("lg-anomaly", "search ranges_well.yaml series.h5 --trials 1 --out {out}.csv --plot {pic}", []),
    ("lg-anomaly", "watch detector.h5 --input feed.csv --log {out}.log", None),
    ("lg-export", "fit.h5 --out {out}.dir", None),
    ("lg-export", "class.h5 --out {out}.dir --target onnx", None),
    ("lg-export", "machine.h5 --out {out}.dir --target fmu2", None),
    ("lg-export", "policy.h5 --out {out}.dir --target package", None),
    ("lg-export", "tree.h5 --out {out}.dir", None),
]
NOT_RUN = {"lg-bench": "reads no names", "lg-gradcheck": "reads no names", "demo": "reads no file",
           "merge": "reads parts that it wrote"}


class Names:
    def __init__(self, binaries, keep):
        self.bin, self.keep = binaries, keep
        self.top = tempfile.mkdtemp(prefix="lg-names-")
        self.base = None
        self.faults, self.runs, self.codes = [], 0, {}

    def run(self, folder, program, words, seconds=60):
        try:
            done = subprocess.run([os.path.join(self.bin, program)] + words, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE, timeout=seconds)
            return done.returncode, done.stdout, done.stderr
        except subprocess.TimeoutExpired:
            return 124, b"", b""

    def name(self, k):
        return self.names.get(k, PLACE[k])

    def words(self, line, texts, pic="", out=""):
        """The words of a line, in which {2} is a name, {pic} the plot and {out} the beginning of the outputs."""
        words = [word.replace("{pic}", pic).replace("{out}", out) for word in line.split()]
        return [re.sub(r"\{(\d+)\}", lambda m: texts.get(int(m.group(1)), self.name(int(m.group(1)))), word) for word in words]

    def must(self, line):
        words = self.words(line, {})
        code, out, err = self.run(self.base, words[0], words[1:])
        if code != 0:
            sys.exit("the base of the test: %s: exit code %d\n%s%s" % (line, code, out.decode("utf-8", "replace"), err.decode("utf-8", "replace")))

    def make_base(self, names=None):
        """The inputs, with these names instead of placeholders, and the models that the programs make of them."""
        if self.base:
            shutil.rmtree(self.base)
        self.base = os.path.join(self.top, "base")
        os.mkdir(self.base)
        self.names = names or {}
        texts = {"table.csv": table(), "classes.csv": classes(), "machine.yaml": MACHINE, "known.yaml": KNOWN, "task.yaml": TASK, "scheme.yaml": SCHEME,
                 "scene.yaml": SCENE, "grid.yaml": GRID, "log.csv": log(), "feed.csv": feed()}
        texts.update({"ranges_%s.yaml" % k: v for k, v in RANGES.items()})
        for name, text in texts.items():
            with open(os.path.join(self.base, name), "w") as f:
                f.write(replace_all(text, self.names, quoted_csv if name.endswith(".csv") else quoted_yaml))
        self.must("lg-fit train table.csv --outputs {2} --epochs 2 --hidden 4 --out fit.h5")
        self.must("lg-fit train classes.csv --class {3} --epochs 2 --hidden 4 --out class.h5")
        self.must("lg-identify fit machine.yaml log.csv --epochs 2 --out machine.h5")
        self.must("lg-control train task.yaml --out policy.h5")
        self.must("lg-control certify task.yaml --lyapunov quadratic --box {8}=1,{9}=3 --level 0.01 --certificate proof.json")
        self.must("lg-hamiltonian generate scene.yaml --trajectories 4 --points 3 --t-end 0.1 --out data.h5")
        self.must("lg-hamiltonian train data.h5 --epochs 1 --hidden 4 --out ham.h5")
        self.must("lg-elastica generate --case both-ends --count 12 --intervals 10 --out curves.h5")
        self.must("lg-elastica train curves.h5 --network discrete --epochs 1 --hidden 4 --layers 1 --out beam.h5")
        self.must("lg-anomaly generate --runs 4 --hours 0.1 --noise 1 --window 30 --out series.h5")
        h5 = H5()
        h5.attribute(os.path.join(self.base, "series.h5"), "channels", "|".join(self.name(k) for k in range(12, 18)))
        h5.attribute(os.path.join(self.base, "series.h5"), "classes", "|".join(self.name(k) for k in range(18, 20)))
        h5.attribute(os.path.join(self.base, "series.h5"), "healthy", self.name(18))
        self.must("lg-anomaly train series.h5 --method logistic --out detector.h5")
        self.must("lg-anomaly train series.h5 --method tree --out tree.h5")

    # ---- one command ----
    def copy(self, folder, texts, spoil=None):
        for name in os.listdir(self.base):
            raw = open(os.path.join(self.base, name), "rb").read()
            if name.endswith(".csv"):
                raw = replace_all(raw.decode(), texts, quoted_csv).encode()
            elif name.endswith(".yaml"):
                raw = replace_all(raw.decode(), texts, quoted_yaml).encode()
            else:
                raw = patched(raw, texts)
                raw = spoil(raw) if spoil else raw
            with open(os.path.join(folder, name), "wb") as f:
                f.write(raw)

    def fault(self, line, texts, what):
        self.faults.append("%s\n    names: %s\n    %s" % (line, texts or getattr(self, "names", {}), what))
        print("FAULT", self.faults[-1], flush=True)

    def check_text(self, line, texts, name, raw):
        try:
            text = raw.decode("utf-8")
        except UnicodeDecodeError as error:
            return self.fault(line, texts, "%s is not UTF-8: %s" % (name, error))
        bad = re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", text)
        if bad:
            self.fault(line, texts, "%s has the control character %r: %r" % (name, bad.group(), text[max(0, bad.start() - 60):bad.end() + 20]))

    def one(self, row, texts, pic, out, spoil=None, want_success=False):
        program, line, shown = row
        top = tempfile.mkdtemp(prefix="run-", dir=self.top)
        folder = os.path.join(top, "work")
        os.mkdir(folder)
        self.copy(folder, texts, spoil)
        with open(os.path.join(top, "sentinel"), "w") as f:
            f.write("sentinel")
        before = set(os.listdir(folder))
        words = self.words(line, texts, pic, out)
        code, stdout, stderr = self.run(folder, program, words)
        self.runs += 1
        self.codes[code] = self.codes.get(code, 0) + 1
        told = " ".join([program] + words)
        if code not in (0, 1, 2, 3, 4, 5):
            self.fault(told, texts, "exit code %d: %s" % (code, stderr[-300:]))
        if self.keep and code != 0:
            print("refused", code, told[:50], stderr[:300])
        if want_success and code != 0:
            self.fault(told, texts, "exit code %d, not 0: %s" % (code, stderr[-600:]))
        for root, folders, files in os.walk(self.top):
            if "RAN" in files or "RAN" in folders:
                self.fault(told, texts, "a name ran a program or left its folder: %s" % root)
                os.remove(os.path.join(root, "RAN"))
        stem = pic[:-4]
        for name in set(os.listdir(folder)) - before:
            if not name.startswith((out, stem)):
                self.fault(told, texts, "the new file %r is no output" % name)
        if os.listdir(top) != ["work", "sentinel"] and set(os.listdir(top)) != {"work", "sentinel"}:
            self.fault(told, texts, "something new above the folder: %s" % os.listdir(top))
        self.check_text(told, texts, "standard output", stdout)
        self.check_text(told, texts, "standard error", stderr)
        if "--json" in words and code == 0:
            try:
                json.loads(stdout)
            except ValueError as error:
                self.fault(told, texts, "--json: %s" % error)
        plot = os.path.join(folder, pic)
        if want_success and code == 0 and "{pic}" in line:
            if not os.path.exists(plot):
                self.fault(told, texts, "no plot: %s" % stderr[-300:])
            elif shown and pic.endswith(".svg"):
                seen = re.sub("\\s", "", html.unescape("".join(re.findall("<text>(.*?)</text>", open(plot, encoding="utf-8", errors="replace").read(), re.S))))
                for k in shown:
                    name = re.sub("[\x00-\x20\x7f]", "", texts.get(k, self.name(k)))
                    if name and name not in seen:
                        self.fault(told, texts, "the plot does not show %r" % name)
        if not self.keep:
            shutil.rmtree(top)

    # ---- all programs ----
    def verbs(self, program):
        out = self.run(self.top, program, ["--help"])[1].decode()
        found = re.search(r"^Commands:\n((?:.+\n)*)", out + "\n", re.M)
        return re.findall(r"^  ([a-z]\S*)", found.group(1), re.M) if found else [""]

    def check_complete(self):
        count = plots = 0
        for path in sorted(glob.glob(os.path.join(self.bin, "lg-*"))):
            program = os.path.basename(path)
            for verb in self.verbs(program):
                if program in NOT_RUN or verb in NOT_RUN:
                    continue
                rows = [r for r in ROWS if r[0] == program and (verb == "" or r[1].split()[0] == verb)]
                count += 1
                if not rows:
                    self.fault("%s %s" % (program, verb), {}, "no row runs this command")
                text = self.run(self.top, program, ([verb] if verb else []) + ["--help-all"])[1].decode()
                if "--plot=" in text:
                    plots += 1
                    if not any("{pic}" in r[1] for r in rows):
                        self.fault("%s %s" % (program, verb), {}, "no row uses --plot")
        print("%d commands, %d of them with --plot, %d rows" % (count, plots, len(ROWS)))


def names_of(turn):
    """Names that all readers take, different from each other: hostile texts without control characters, of one length. Names of
    coordinates (8) have letters only; names of channels and classes (12 to 19) have no |, which separates them in a file."""
    safe = [t for t in HOSTILE if t.isprintable() and not t.startswith("-")]
    names = {k: fit_to("%s%d" % (safe[(k + 5 * turn) % len(safe)], k)) for k in range(40) if k != 8}
    return {k: t.replace("|", "!") if 12 <= k < 20 else t for k, t in names.items()}


def table_test(names, only):
    """Each row with names as the programs take them, with names that were put into their files, and with hostile names of plots."""
    for turn in range(3):
        names.make_base(names_of(turn) if turn > 0 else None)
        for n, row in enumerate(ROWS):
            if only and only not in row[0] + " " + row[1]:
                continue
            names.one(row, {}, "plain.svg", "result", want_success=True)
            if turn == 0:
                names.one(row, {k: fit_to("%s%d" % (HOSTILE[(k + n) % len(HOSTILE)], k)) for k in range(40)}, "p.svg", "result")
                for pic in ("<touch RAN;.svg", "p\n!touch RAN\n#.svg", "a`touch RAN`'.\"$(touch RAN).svg", "|touch RAN;.png"):
                    if "{pic}" in row[1]:
                        names.one(row, {}, pic, "result", want_success=True)


PIECES = list("`'\"\\$()|<>;&\n\t\r\033\007\x7f%@#{}[]_^!*~=,.:/- ") + ["touch RAN", "RAN", "..", "system", "\u009b", "\u202e", "%s", "%n", "\\n", "\\042", "a", "x",
                                                                  "1", "nan", "é", "漢", "\U0001f600", "//", "/*", "*/", "]]>", "</text>", "$(", "${", "\\\n", "\u2028"]


def random_text(rng, most):
    return "".join(rng.choice(PIECES) for _ in range(rng.randint(1, most)))


def fuzz(names, seconds, seed, only):
    end, n = time.time() + seconds, 0
    while time.time() < end:
        rng = random.Random(seed * 1000003 + n)
        n += 1
        row = rng.choice([r for r in ROWS if not only or only in r[0] + " " + r[1]])
        texts = {k: random_text(rng, 12) for k in range(40) if rng.random() < 0.7} if rng.random() < 0.7 else {}

        def spoil(raw):
            """Replaces some strings of an HDF5 file by hostile texts of the same length."""
            for _ in range(rng.randint(1, 3)):
                found = [m for m in re.finditer(rb"[ -~]{6,}", raw)]
                at = rng.choice(found)
                with_ = random_text(rng, 30) if rng.random() < 0.5 else rng.choice(HOSTILE)
                begin = at.start() + rng.randint(0, 4)
                raw = raw[:begin] + fit_to(with_, at.end() - begin).encode() + raw[at.end():]
            return raw

        stem = re.sub("[/\0]", "", random_text(rng, 10))[:60] or "p"
        pic = stem + rng.choice([".svg", ".png"]) if rng.random() < 0.4 and not stem.startswith("-") else "p.svg"
        names.one(row, texts, pic, "result", spoil if rng.random() < 0.5 else None)
        if n % 200 == 0:
            print("%d runs, exit codes %s, %d faults" % (names.runs, names.codes, len(names.faults)), flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("bin")
    parser.add_argument("--seconds", type=float, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="")
    parser.add_argument("--keep", action="store_true")
    args = parser.parse_args()
    names = Names(os.path.abspath(args.bin), args.keep)
    try:
        names.check_complete()
        names.make_base()
        if args.seconds > 0:
            fuzz(names, args.seconds, args.seed, args.only)
        else:
            table_test(names, args.only)
        print("%d runs, exit codes %s, %d faults" % (names.runs, dict(sorted(names.codes.items())), len(names.faults)))
    finally:
        if not args.keep:
            shutil.rmtree(names.top, ignore_errors=True)
    sys.exit(1 if names.faults else 0)


main()
