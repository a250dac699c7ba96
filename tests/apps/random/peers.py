"""Checks exports with the tools that they are for, for random_exports. The first argument is what to check, onnx or fmu. Each
line of the standard input is FOLDER NAME ROWS.

onnx: FOLDER/out/NAME.onnx is checked by onnx and run by onnxruntime: inputs FOLDER/<input>.bin, outputs FOLDER/<output>.bin, all
doubles. The answer is "f32" or "f64", the type of the file's numbers.
fmu: FOLDER/out/NAME.fmu is validated by FMPy, also by the schema of the standard, and simulated as model exchange and
co-simulation. The answer is "ok".

Any other answer says what is wrong. The exit code is 77 if a package is missing."""
import os
import sys
import warnings

warnings.filterwarnings("ignore")
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)  # what the tools print is no answer
try:
    if sys.argv[1] == "onnx":
        import numpy as np
        import onnx
        import onnxruntime as ort
    else:
        import fmpy
        from fmpy.validation import validate_fmu
except ImportError as error:
    print(error, file=answers, flush=True)
    sys.exit(77)


def check_onnx(folder, name, rows):
    path = os.path.join(folder, "out", name + ".onnx")
    onnx.checker.check_model(onnx.load(path), full_check=True)
    options = ort.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 3
    session = ort.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    types = {node.type for node in session.get_inputs() + session.get_outputs()}
    if len(types) != 1 or not types <= {"tensor(float)", "tensor(double)"}:
        return "types %s" % types
    single = "tensor(float)" in types
    feed = {}
    for node in session.get_inputs():
        values = np.fromfile(os.path.join(folder, node.name + ".bin"))
        feed[node.name] = values.reshape([rows if d == "rows" else d for d in node.shape]).astype(np.float32 if single else float)
    for node, value in zip(session.get_outputs(), session.run(None, feed)):
        shape = tuple(rows if d == "rows" else d for d in node.shape)
        if value.shape != shape:
            return "%s has the shape %s, not %s" % (node.name, value.shape, shape)
        np.ascontiguousarray(value, float).tofile(os.path.join(folder, node.name + ".bin"))
    return "f32" if single else "f64"


def check_fmu(folder, name, rows):
    path = os.path.join(folder, "out", name + ".fmu")
    problems = validate_fmu(path)
    if problems:
        return "; ".join(" ".join(p.split()) for p in problems)
    for kind in ("ModelExchange", "CoSimulation"):
        try:  # not CVode, which cannot follow rates that jump
            fmpy.simulate_fmu(path, fmi_type=kind, solver="Euler", step_size=0.01, stop_time=0.05)
        except Exception as error:  # a step to numbers that are not finite is refused
            if "DoStep failed with status 3" not in str(error):
                raise
    return "ok"


check = {"onnx": check_onnx, "fmu": check_fmu}[sys.argv[1]]
print("ready", file=answers, flush=True)
for line in sys.stdin:
    words = line.split()
    try:
        answer = check(words[0], words[1], int(words[2]))
    except Exception as error:  # whatever the tools raise is a finding
        answer = "%s: %s" % (type(error).__name__, " ".join(str(error).split()))
    print(answer, file=answers, flush=True)
