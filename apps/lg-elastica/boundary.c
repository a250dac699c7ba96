/* Reads boundary conditions from the command line. */
#include <math.h>
#include <string.h>

#include "lg-elastica/beam.h"

static const double rotation_tolerance = 1e-9; /* radians */

const char *const case_names[] = {"both-ends", "right-end", NULL};

beam_values beam_given;

const lg_field beam_rows[] = {
    LG_OPTION(beam_values, length, REAL, "L", "Length of the beam", LG_POSITIVE, .value = "3.3"),
    LG_OPTION(beam_values, stiffness, REAL, "EI", "Bending stiffness", LG_POSITIVE, .value = "10"),
    LG_OPTION(beam_values, intervals, U64, "N", "Number of equal intervals between the nodes",
              .low = LG_ELASTICA_MIN_INTERVALS, .high = LG_ELASTICA_MAX_INTERVALS, .value = "50",
              .usual = true),
    LG_FIELD_END};

#define BEAM_POINT LG_ANY_REAL, .array = true, .least = 2, .most = 2
const lg_field end_rows[] = {
    LG_OPTION(beam_values, q0, REALS, "X,Y",
              "Where the beam begins (default 0,0; of a model: as in its training data)", BEAM_POINT),
    LG_OPTION(beam_values, qN, REALS, "X,Y",
              "Where it ends (default 3,0; of a model: as in its training data)", BEAM_POINT),
    LG_FIELD_END};

const lg_field boundary_rows[] = {
    BEAM_CASE(beam_values,
              "both-ends (theta0 = x, theta(L) = -x) or right-end (theta0 = 0, theta(L) = -x), x "
              "wrapped to (-pi, pi] (default both-ends; of a model: the family trained on)",
              .usual = true, .names = case_names, .without = "theta0,thetaN"),
    LG_OPTION(beam_values, x, REAL, "X", "The case's parameter, radians", .usual = true, .low = -1e6,
              .high = 1e6, .without = "theta0,thetaN"),
    LG_OPTION(beam_values, theta0, REAL, "A", "Instead of --case and --x: tangent angle at s = 0, radians",
              .option = "theta0", .usual = true, .low = -1e6, .high = 1e6),
    LG_OPTION(beam_values, thetaN, REAL, "B", "With --theta0: tangent angle at s = L, radians",
              .option = "thetaN", .usual = true, .low = -1e6, .high = 1e6, .needs = "theta0"),
    LG_OPTION(beam_values, rotation, REAL, "R",
              "Turning of the tangent along the beam: B - A plus whole turns (default: of B - A wrapped to "
              "(-pi, pi], one turn more and one less, the one with the lowest energy)",
              .low = -1e6, .high = 1e6),
    LG_FIELD_END};

void boundary_vector(const lg_elastica *problem, double x[8]) {
    const double end = problem->theta0 + problem->rotation;
    memcpy(x, problem->q0, sizeof problem->q0);
    x[2] = cos(problem->theta0);
    x[3] = sin(problem->theta0);
    memcpy(x + 4, problem->qN, sizeof problem->qN);
    x[6] = cos(end);
    x[7] = sin(end);
}

void boundary_rotations(double theta0, double thetaN, boundary *out) {
    static const double turns[BOUNDARY_ROTATIONS] = {0, -1, 1};
    const double middle = lg_elastica_wrap(thetaN - theta0);
    for (size_t k = 0; k < BOUNDARY_ROTATIONS; k++) out->rotation[k] = middle + 2 * LG_PI * turns[k];
    out->count = BOUNDARY_ROTATIONS;
    out->chosen = NAN;
    out->problem.theta0 = theta0;
    out->problem.rotation = out->rotation[0];
}

static void read_ends(const app *self, lg_elastica *problem) {
    if (app_given(self, "q0")) memcpy(problem->q0, beam_given.q0, sizeof problem->q0);
    if (app_given(self, "qN")) memcpy(problem->qN, beam_given.qN, sizeof problem->qN);
}

lg_elastica beam_problem(const app *self) {
    lg_elastica problem;
    lg_elastica_init(&problem);
    problem.length = beam_given.length;
    problem.stiffness = beam_given.stiffness;
    problem.intervals = (uint32_t)beam_given.intervals;
    read_ends(self, &problem);
    return problem;
}

/* Keeps only the rotation of --rotation, which must be B - A + 2 pi k for a whole number k. */
static void fix_rotation(const app *self, double wanted, boundary *out) {
    const double turns = round((wanted - out->rotation[0]) / (2 * LG_PI));
    const double nearest = out->rotation[0] + 2 * LG_PI * turns;
    if (!(fabs(wanted - nearest) <= rotation_tolerance))
        app_stop_usage(self,
                       "--rotation: %.12g does not lead from the first angle to the second; the nearest "
                       "rotations that do are %.12g and %.12g",
                       wanted, nearest, nearest + (wanted > nearest ? 2 * LG_PI : -2 * LG_PI));
    out->count = 1;
    out->rotation[0] = out->chosen = out->problem.rotation = nearest;
}

void boundary_read(const app *self, const lg_elastica *problem, lg_elastica_case kind, boundary *out) {
    const bool family = app_given(self, "case") || app_given(self, "x"), last = app_given(self, "thetaN");
    *out = (boundary){.problem = *problem};
    if (!family && !app_given(self, "theta0"))
        app_stop_usage(self, "no boundary conditions: give --case and --x, or --theta0 and --thetaN");
    read_ends(self, &out->problem);
    if (family) {
        if (!app_given(self, "x")) app_stop_usage(self, "--x X is missing");
        if (app_given(self, "case")) kind = (lg_elastica_case)beam_given.kind;
        lg_elastica_set_case(&out->problem, kind, beam_given.x);
        const double rotation = out->problem.rotation;
        boundary_rotations(out->problem.theta0, out->problem.theta0 + rotation, out);
        out->chosen = out->problem.rotation = rotation;
    } else {
        if (!last && !app_given(self, "rotation")) app_stop_usage(self, "--thetaN B is missing");
        boundary_rotations(beam_given.theta0,
                           last ? beam_given.thetaN : beam_given.theta0 + beam_given.rotation, out);
    }
    if (app_given(self, "rotation")) fix_rotation(self, beam_given.rotation, out);
    APP_MUST(self, lg_elastica_check(&out->problem, &error));
}
