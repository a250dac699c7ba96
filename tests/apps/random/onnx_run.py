"""Runs ONNX files for random_exports. Each line of the standard input is: FOLDER NAME ROWS. The file is
FOLDER/out/NAME.onnx, its inputs are FOLDER/<input>.bin (doubles). Checks the file with onnx, runs it with onnxruntime, writes
FOLDER/<output>.bin (doubles), and answers with "f32" or "f64", the type of its numbers, or with a line that says what is wrong.
Exit code 77: a package is missing."""
import os
import sys

try:
    import numpy as np
    import onnx
    import onnxruntime as ort
except ImportError as error:
    print(error, flush=True)
    sys.exit(77)


def run(folder, name, rows):
    path = os.path.join(folder, "out", name + ".onnx")
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
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


print("ready", flush=True)
for line in sys.stdin:
    words = line.split()
    try:
        answer = run(words[0], words[1], int(words[2]))
    except Exception as error:  # whatever onnx and onnxruntime raise is a finding
        answer = "%s: %s" % (type(error).__name__, " ".join(str(error).split()))
    print(answer, flush=True)
