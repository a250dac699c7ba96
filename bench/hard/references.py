"""Writes cases.txt, the rows of bench/hard-cases that C measures (measure.c), with mpmath at 50 digits: room, function, case,
metric, kind of reference, what conditioning allows, when it is run (ci or slow), inputs, references. Inputs are doubles, taken
as exact. What conditioning allows is roundings u (1 + kappa) + truncation: u is the unit roundoff of the type, kappa the
componentwise condition number, sum_j |x_j| max_i |df_i/dx_j| / max_i |f_i| by differences at 50 digits, or 0 where a function is
to be accurate to rounding for every input."""
import os
import sys

sys.dont_write_bytecode = True

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
import core
import of_maths
import of_methods
import of_motion



if __name__ == "__main__":
    with open(os.path.join(HERE, "cases.txt"), "w") as out:
        out.write("\n".join(core.ROWS) + "\n")
    print("%d rows" % len(core.ROWS))
