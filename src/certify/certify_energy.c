/* Torque-limited pendulums: checks in one dimension. */
#include <float.h>
#include <math.h>
#include <stdio.h>

#include "certify/certify.h"

void lg_certify_energy_spec_init(lg_certify_energy_spec *spec) {
    if (spec != NULL) *spec = (lg_certify_energy_spec){.size = sizeof *spec, .period = 6.283185307179586};
}

typedef struct checking {
    lg_interval *g;
    void *work;
    lg_certify_energy_result *r;
    double side; /* 1: q > 0, and g must be positive; -1: the other side */
} checking;

/* Bounds of side g and of g' for side q in [low, high]. Returns what holds of g there; only if it is
 * Lipschitz continuous, the bounds of g' contain all slopes. */
static uint8_t bound(checking *c, double low, double high, double g_low[2], double g_high[2]) {
    const double from = c->side > 0 ? low : -high, to = c->side > 0 ? high : -low;
    double l[2], h[2];
    uint8_t flags[2];
    (void)lg_interval_eval(c->g, 1, &from, &to, l, h, flags, c->work, NULL);
    g_low[0] = c->side > 0 ? l[0] : -h[0];
    g_high[0] = c->side > 0 ? h[0] : -l[0];
    g_low[1] = l[1];
    g_high[1] = h[1];
    c->r->boxes++;
    return flags[1] == LG_INTERVAL_UNDEFINED ? flags[1] : flags[0];
}

static bool fail(checking *c, double low, double high, const char *reason) {
    c->r->failed_low = c->side > 0 ? low : -high;
    c->r->failed_high = c->side > 0 ? high : -low;
    (void)snprintf(c->r->reason, sizeof c->r->reason, "%s", reason);
    return false;
}

enum { MOST_BOXES = 1000000, DEPTH = 64 };

/* Proves side g > 0 on [from, to]; *margin becomes at most the least value, to 1e-3. The mean value form is
 * used where it helps. Intervals lie on a stack, the lower half on top. */
static bool is_positive(checking *c, double from, double to, double *margin) {
    double low[DEPTH], high[DEPTH], value = (double)INFINITY; /* value: the least g at a point so far */
    size_t count = 1;
    low[0] = from;
    high[0] = to;
    while (count > 0) {
        const double a = low[count - 1], b = high[count - 1], m = 0.5 * a + 0.5 * b;
        double l[2], h[2], pl[2], ph[2];
        const uint8_t flag = bound(c, a, b, l, h);
        (void)bound(c, m, m, pl, ph);
        const double steep = fmax(-l[1], h[1]), wide = fmax(m - a, b - m) * (1 + 1e-15);
        const double mean = pl[0] - (steep * wide + fabs(pl[0]) * 1e-15) * (1 + 1e-14);
        const bool slopes = flag >= LG_INTERVAL_LIPSCHITZ;
        const double least = slopes ? fmax(mean, l[0]) : -DBL_MAX;
        if (ph[0] <= 0.0) return fail(c, m, m, "the torque does not exceed the potential's");
        value = fmin(value, ph[0]);
        if (least > 0.0 && least >= fmin(value, *margin) * (1 - 1e-3)) {
            *margin = fmin(*margin, least);
            count--;
            continue;
        }
        if (count == DEPTH || c->r->boxes > MOST_BOXES || !(a < m && m < b))
            return fail(c, a, b,
                        slopes                          ? "the sign of the torque could not be decided"
                        : flag < LG_INTERVAL_DEFINED    ? "the torque may be undefined there"
                        : flag < LG_INTERVAL_CONTINUOUS ? "the torque may jump there"
                                                        : "the torque may have an infinite slope there");
        low[count] = a;
        high[count] = m;
        low[count - 1] = m;
        count++;
    }
    return true;
}

/* The largest `near` = limit/2^k with g' > 0 on [0, near] */
static bool find_near(checking *c, double limit, double *near) {
    double l[2], h[2];
    (void)bound(c, 0, 0, l, h);
    if (l[0] != 0.0 || h[0] != 0.0) return fail(c, 0, 0, "q = 0 is no exact equilibrium");
    for (*near = limit; *near > 1e-12 * limit; *near *= 0.5) {
        if (bound(c, 0, *near, l, h) >= LG_INTERVAL_LIPSCHITZ && l[1] > 0.0) return true;
    }
    return fail(c, 0, *near, "the loop is not stiff enough at q = 0");
}

static bool check_side(checking *c, const lg_certify_energy_spec *spec, double side) {
    double near, between = (double)INFINITY, far = (double)INFINITY;
    c->side = side;
    if (!find_near(c, spec->saturated, &near)) return false;
    if (near < spec->saturated && !is_positive(c, near, spec->saturated, &between)) return false;
    if (!is_positive(c, spec->saturated, spec->saturated + spec->period * (1 + 1e-12), &far)) return false;
    c->r->near = side > 0 ? near : fmin(near, c->r->near);
    c->r->margin = side > 0 ? far : fmin(far, c->r->margin);
    return true;
}

static void say(const lg_certify_energy_spec *spec, lg_certify_energy_result *r) {
    char margin[128] = "";
    if (r->verified)
        (void)lg_format(margin, sizeof margin,
                        "; the torque exceeds the potential's by at least %s for |q| >= %s",
                        LG_DIGITS(r->margin, -1), LG_DIGITS(spec->saturated, 1));
    (void)lg_format(
        r->claim, sizeof r->claim,
        "%s: from every state, with the angle counted on the real line and the torque inside one limit, "
        "motions converge to q = 0 (continuous inputs, damping at least %s, no model error beyond it)%s.",
        r->verified ? "Proved" : "Not proved", LG_DIGITS(spec->damping, -1), margin);
}

static lg_status check(const lg_certify_energy_spec *spec, lg_error *error) {
    if (spec->size != sizeof *spec || !(spec->damping > 0 && isfinite(spec->damping)) ||
        !(spec->gain >= 0 && isfinite(spec->gain)) || !(spec->saturated > 0 && isfinite(spec->saturated)) ||
        !(spec->period > 0 && isfinite(spec->period)))
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the damping, the angle of saturation and the period must be positive, the gain at least 0");
    return LG_OK;
}

/* Copies g into a new program, where it is differentiated. */
static lg_status prepare(const lg_certify_energy_spec *spec, lg_program **program, lg_interval **g,
                         lg_error *error) {
    size_t function, inputs, outputs;
    LG_TRY(lg_program_find(spec->program, spec->slope, &function, error));
    const lg_port *from = lg_program_inputs(spec->program, function, &inputs);
    const lg_port *to = lg_program_outputs(spec->program, function, &outputs);
    if (inputs != 1 || outputs != 1 || lg_shape_count(from[0].shape) != 1 || lg_shape_count(to[0].shape) != 1)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the function '%s' needs one number in and one out",
                       spec->slope);
    LG_TRY(lg_program_flat(spec->program, function, program, error));
    LG_TRY(lg_program_jacobian(*program, spec->slope, error));
    return lg_interval_create(*program, (const size_t[]){0, 1}, 2, NULL, g, error);
}

lg_status lg_certify_energy(const lg_context *context, const lg_certify_energy_spec *spec,
                            lg_certify_energy_result *result, lg_error *error) {
    lg_certify_energy_result r = {.verified = false};
    LG_CLEAN(lg_program_destroy_at) lg_program *program = NULL;
    LG_CLEAN(lg_interval_destroy_at) lg_interval *g = NULL;
    LG_NEEDS(error, spec, result);
    LG_NEEDS(error, spec->program, spec->slope);
    LG_TRY(check(spec, error));
    LG_TRY(prepare(spec, &program, &g, error));
    LG_TRY_SCRATCH(char, work, context, lg_interval_work_size(g), lg_no_memory(error));
    checking c = {g, work, &r, 1};
    r.verified = check_side(&c, spec, 1) && check_side(&c, spec, -1);
    if (!r.verified) r.margin = 0;
    say(spec, &r);
    *result = r;
    return LG_OK;
}
