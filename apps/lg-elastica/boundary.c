/* Reads boundary conditions from the command line. */
#include <math.h>

#include "lg-elastica/beam.h"

static const double pi = 3.14159265358979323846;
static const double rotation_tolerance = 1e-9; /* radians */

const char *const case_names[] = {"both-ends", "right-end", NULL};

double wrap_angle(double angle) {
    const double w = remainder(angle, 2 * pi);
    return w <= -pi ? w + 2 * pi : w;
}

void boundary_vector(const lg_elastica *problem, double x[8]) {
    const double end = problem->theta0 + problem->rotation;
    const double values[8] = {problem->q0[0],
                              problem->q0[1],
                              cos(problem->theta0),
                              sin(problem->theta0),
                              problem->qN[0],
                              problem->qN[1],
                              cos(end),
                              sin(end)};
    for (size_t i = 0; i < 8; i++) x[i] = values[i];
}

void boundary_rotations(double theta0, double thetaN, boundary *out) {
    static const double turns[BOUNDARY_ROTATIONS] = {0, -1, 1};
    const double middle = wrap_angle(thetaN - theta0);
    for (size_t k = 0; k < BOUNDARY_ROTATIONS; k++) out->rotation[k] = middle + 2 * pi * turns[k];
    out->count = BOUNDARY_ROTATIONS;
    out->chosen = (double)NAN;
    out->problem.theta0 = theta0;
    out->problem.rotation = out->rotation[0];
}

static void read_point(const app *self, const char *option, const lg_reals *given, double point[2]) {
    if (given->count == 0) return;
    if (given->count != 2)
        app_stop_usage(self, "--%s: expected two numbers x,y, not %zu", option, given->count);
    point[0] = given->values[0];
    point[1] = given->values[1];
}

static void read_ends(const app *self, const end_values *values, lg_elastica *problem) {
    read_point(self, "q0", &values->q0, problem->q0);
    read_point(self, "qN", &values->qN, problem->qN);
}

lg_elastica beam_problem(const app *self, const beam_values *beam, const end_values *ends) {
    lg_elastica problem;
    lg_elastica_init(&problem);
    problem.length = beam->length;
    problem.stiffness = beam->stiffness;
    problem.intervals = (uint32_t)beam->intervals;
    read_ends(self, ends, &problem);
    return problem;
}

/* Keeps only the rotation of --rotation, which must be B - A + 2 pi k for a whole number k. */
static void fix_rotation(const app *self, double wanted, boundary *out) {
    const double turns = round((wanted - out->rotation[0]) / (2 * pi));
    const double nearest = out->rotation[0] + 2 * pi * turns;
    if (!(fabs(wanted - nearest) <= rotation_tolerance))
        app_stop_usage(self,
                       "--rotation: %.12g does not lead from the first angle to the second; the nearest "
                       "rotations that do are %.12g and %.12g",
                       wanted, nearest, nearest + (wanted > nearest ? 2 * pi : -2 * pi));
    out->count = 1;
    out->rotation[0] = out->chosen = out->problem.rotation = nearest;
}

static void read_angles(const app *self, const boundary_values *values, boundary *out) {
    const bool last = app_given(self, "thetaN");
    if (!app_given(self, "theta0")) app_stop_usage(self, "--theta0 A is missing");
    if (!last && !app_given(self, "rotation")) app_stop_usage(self, "--thetaN B is missing");
    boundary_rotations(values->theta0, last ? values->thetaN : values->theta0 + values->rotation, out);
}

static void read_case(const app *self, const boundary_values *values, lg_elastica_case kind, boundary *out) {
    if (!app_given(self, "x")) app_stop_usage(self, "--x X is missing");
    if (app_given(self, "case")) kind = (lg_elastica_case)values->kind;
    lg_elastica_set_case(&out->problem, kind, values->x);
    const double rotation = out->problem.rotation;
    boundary_rotations(out->problem.theta0, out->problem.theta0 + rotation, out);
    out->chosen = out->problem.rotation = rotation;
}

void boundary_read(const app *self, const boundary_values *values, const lg_elastica *problem,
                   lg_elastica_case kind, boundary *out) {
    const bool family = app_given(self, "case") || app_given(self, "x");
    const bool angles = app_given(self, "theta0") || app_given(self, "thetaN");
    *out = (boundary){.problem = *problem};
    if (family && angles)
        app_stop_usage(self, "--case with --x and --theta0 with --thetaN cannot be given together");
    if (!family && !angles)
        app_stop_usage(self, "no boundary conditions: give --case and --x, or --theta0 and --thetaN");
    read_ends(self, &values->ends, &out->problem);
    if (family)
        read_case(self, values, kind, out);
    else
        read_angles(self, values, out);
    if (app_given(self, "rotation")) fix_rotation(self, values->rotation, out);
    APP_MUST(self, lg_elastica_check(&out->problem, &error));
}
