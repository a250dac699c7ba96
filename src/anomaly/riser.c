/* Riser scene: parameters, matrices, periods, the standard runs. */
#include <math.h>
#include <string.h>

#include "anomaly/riser.h"

#define PI 3.14159265358979323846

const char *lg_riser_channel(uint32_t index) {
    static const char *const names[LG_RISER_CHANNELS] = {"acc_lower_x", "acc_lower_y", "acc_upper_x",
                                                         "acc_upper_y", "moment_x",    "moment_y"};
    return index < LG_RISER_CHANNELS ? names[index] : NULL;
}

/* ---- parameters ---- */

typedef enum limit { POSITIVE, NOT_NEGATIVE, ANY } limit;

/* The standard values of the parameters, and their ranges. */
static const struct range {
    const char *name;
    size_t offset;
    double value;
    limit limit;
} ranges[] = {
#define ROW(member, value, range)                                                                            \
    { #member, offsetof(lg_riser_parameters, member), value, range }
    ROW(depth, 100.0, POSITIVE),
    ROW(rho, 1025.0, NOT_NEGATIVE),
    ROW(gravity, 9.81, POSITIVE),
    ROW(bop_mass, 200e3, POSITIVE),
    ROW(bop_added_mass, 120e3, NOT_NEGATIVE),
    ROW(bop_height, 10.0, POSITIVE),
    ROW(bop_centre, 5.0, NOT_NEGATIVE),
    ROW(bop_weight, 1.6e6, ANY),
    ROW(bop_diameter, 4.5, NOT_NEGATIVE),
    ROW(bop_drag, 1.8, NOT_NEGATIVE),
    ROW(bop_volume, 60.0, NOT_NEGATIVE),
    ROW(riser_mass, 550.0, POSITIVE),
    ROW(hydro_diameter, 0.9, NOT_NEGATIVE),
    ROW(drag, 1.1, NOT_NEGATIVE),
    ROW(added_mass, 1.0, NOT_NEGATIVE),
    ROW(bending_stiffness, 2.7e8, NOT_NEGATIVE),
    ROW(submerged_weight, 1.5e3, ANY),
    ROW(flex_joint, 2.3e6, NOT_NEGATIVE),
    ROW(top_tension, 1.4e6, POSITIVE),
    ROW(housing_stiffness, 150e6, POSITIVE),
    ROW(housing_factor, 2.0, POSITIVE),
    ROW(housing_gap, 60e3, NOT_NEGATIVE),
    ROW(softening, 0.03, POSITIVE),
    ROW(soil_stiffness, 1.2e8, POSITIVE),
    ROW(soil_strength, 3e6, POSITIVE),
    ROW(damping_rotation, 0.04, NOT_NEGATIVE),
    ROW(damping_offset, 0.08, NOT_NEGATIVE),
    ROW(damping_riser, 0.01, NOT_NEGATIVE),
    ROW(sensor_moment, 1.0, ANY),
    ROW(sensor_lower, 9.0, ANY),
    ROW(sensor_upper, 2.0, ANY),
    ROW(noise_acceleration, 3e-4, NOT_NEGATIVE),
    ROW(noise_moment, 500.0, NOT_NEGATIVE),
    ROW(current, 0.35, ANY),
    ROW(severity, 1.0, POSITIVE),
    ROW(relief_stiffness, 0.0, NOT_NEGATIVE),
    ROW(relief_height, 8.0, NOT_NEGATIVE),
#undef ROW
};

void lg_riser_parameters_init(lg_riser_parameters *out) {
    *out = (lg_riser_parameters){.size = sizeof(*out), .housing = LG_HOUSING_SLACK};
    for (size_t i = 0; i < LG_COUNT(ranges); i++)
        memcpy((char *)out + ranges[i].offset, &ranges[i].value, sizeof ranges[i].value);
}

void lg_riser_complete(lg_riser_parameters *p) {
    const double mass = 50e3, added_mass = 25e3, volume = 10.0, weight = 390e3, height = 4.0;
    const double lighter = 0.19 * (1350.0 - 1050.0); /* kg/m: brine in place of mud */
    const double bop = p->bop_mass + p->bop_added_mass, tree = mass + added_mass;
    p->bop_centre = (bop * (p->bop_centre + height) + tree * height / 2.0) / (bop + tree);
    p->bop_mass += mass;
    p->bop_added_mass += added_mass;
    p->bop_volume += volume;
    p->bop_weight += weight;
    p->bop_height += height;
    p->sensor_lower += height;
    p->relief_height += height;
    p->riser_mass -= lighter;
    p->submerged_weight -= lighter * p->gravity;
}

static bool within(double x, limit kind) {
    return isfinite(x) && (kind == ANY || x > 0.0 || (kind == NOT_NEGATIVE && x == 0.0));
}

/* ---- matrices ---- */

double lg_riser_segment(const lg_riser_parameters *p) {
    return (p->depth - p->bop_height) / (LG_RISER_NODES + 1);
}

double lg_riser_height(const lg_riser_parameters *p, size_t station) {
    return station == 0 ? p->bop_centre : p->bop_height + (double)(station - 1) * lg_riser_segment(p);
}

/* matrix += factor d d^T */
static void add_square(double factor, const double *d, double *matrix) {
    for (size_t i = 0; i < LG_RISER_DOF; i++)
        for (size_t j = 0; j < LG_RISER_DOF; j++) matrix[i * LG_RISER_DOF + j] += factor * d[i] * d[j];
}

/* Row i of y expresses an offset by the degrees of freedom: row 0 the offset of the flex joint, rows 1..12 of
 * riser node i, row 13 of the fixed top (zero). */
static void offsets(const lg_riser_parameters *p, double y[LG_RISER_NODES + 2][LG_RISER_DOF]) {
    memset(y, 0, (LG_RISER_NODES + 2) * sizeof *y);
    y[0][0] = 1.0;
    y[0][1] = p->bop_height;
    for (size_t i = 1; i <= LG_RISER_NODES; i++) y[i][i + 1] = 1.0;
}

static double tension(const lg_riser_parameters *p, double z) {
    return p->top_tension - p->submerged_weight * (p->depth - z);
}

/* Adds the stiffness from tension, bending and flex joint. */
static void add_riser_stiffness(const lg_riser_parameters *p, double y[][LG_RISER_DOF], double *k) {
    const double l = lg_riser_segment(p);
    double d[LG_RISER_DOF];
    for (size_t i = 0; i <= LG_RISER_NODES; i++) {
        for (size_t j = 0; j < LG_RISER_DOF; j++) d[j] = y[i + 1][j] - y[i][j];
        add_square(tension(p, p->bop_height + ((double)i + 0.5) * l) / l, d, k);
    }
    for (size_t i = 1; i <= LG_RISER_NODES; i++) {
        for (size_t j = 0; j < LG_RISER_DOF; j++)
            d[j] = (y[i - 1][j] - 2.0 * y[i][j] + y[i + 1][j]) / (l * l);
        add_square(p->bending_stiffness * l, d, k);
    }
    for (size_t j = 0; j < LG_RISER_DOF; j++) d[j] = (y[1][j] - y[0][j]) / l;
    d[1] -= 1.0;
    add_square(p->flex_joint, d, k);
}

void lg_riser_matrices_make(const lg_riser_parameters *p, lg_riser_matrices *out) {
    enum { N = LG_RISER_DOF };
    const double m = p->bop_mass + p->bop_added_mass, h = p->bop_centre, L = p->bop_height;
    const double area = PI / 4.0 * p->hydro_diameter * p->hydro_diameter;
    const double lump = (p->riser_mass + p->rho * area * p->added_mass) * lg_riser_segment(p);
    double y[LG_RISER_NODES + 2][LG_RISER_DOF];
    memset(out, 0, sizeof *out);
    offsets(p, y);
    add_square(lump / 2.0, y[0], out->mass);
    for (size_t i = 1; i <= LG_RISER_NODES; i++) add_square(lump, y[i], out->mass);
    out->mass[0] += m;
    out->mass[1] += m * h;
    out->mass[N] += m * h;
    out->mass[N + 1] += m * (L * L / 12.0 + h * h);
    add_riser_stiffness(p, y, out->stiffness);
    for (size_t i = 0; i < LG_RISER_MATRIX; i++) out->damping[i] = p->damping_riser * out->stiffness[i];
    out->damping[0] += 2.0 * p->damping_offset * sqrt(p->soil_stiffness * out->mass[0]);
    out->damping[N + 1] += 2.0 * p->damping_rotation * sqrt(p->housing_stiffness * out->mass[N + 1]);
    out->stiffness[N + 1] += tension(p, L) * L - p->bop_weight * h;
    add_square(p->relief_stiffness, (const double[N]){1.0, p->relief_height}, out->stiffness);
}

/* ---- check ---- */

/* Whether mass and stiffness are positive definite with the housing at its stiffest, beyond its gap. */
static bool stands(const lg_riser_parameters *p) {
    const lg_kernels *k = lg_kernels_for(LG_F64);
    double l[LG_RISER_MATRIX];
    lg_riser_matrices m;
    lg_wellhead w;
    lg_riser_matrices_make(p, &m);
    lg_wellhead_make(p, &w);
    m.stiffness[0] += p->soil_stiffness;
    m.stiffness[LG_RISER_DOF + 1] += w.outer;
    return k->spd_factor(1, LG_RISER_DOF, m.mass, l) == 0 &&
           k->spd_factor(1, LG_RISER_DOF, m.stiffness, l) == 0;
}

lg_status lg_riser_parameters_check(const lg_riser_parameters *p, lg_error *error) {
    static const char *const words[] = {"positive", "zero or positive", "finite"};
    if (!p || p->size != sizeof(*p))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "riser: the parameters were not initialised: their size is unknown");
    for (size_t i = 0; i < LG_COUNT(ranges); i++) {
        double x;
        memcpy(&x, (const char *)p + ranges[i].offset, sizeof x);
        if (!within(x, ranges[i].limit))
            return lg_fail(error, LG_INVALID_ARGUMENT, "riser: %s is %g, it must be %s", ranges[i].name, x,
                           words[ranges[i].limit]);
    }
    if ((unsigned)p->housing >= LG_HOUSING_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "riser: housing %d is unknown", (int)p->housing);
    if (p->severity > 1.0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "riser: severity is %g, it must not exceed 1 (intact)",
                       p->severity);
    if (!(p->bop_height < p->depth))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "riser: bop_height is %g, it must be below the surface (depth %g)", p->bop_height,
                       p->depth);
    if (!stands(p))
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "riser: with these parameters the structure does not stand (its stiffness is negative)");
    return lg_fail(error, LG_OK, "%s", "");
}

/* ---- the standard runs ---- */

enum { STREAM_SEA_STATE = 0x5ea, STREAM_WAVES = 0x3a7e, STREAM_NOISE = 0x2015e };

lg_sea_state lg_sea_state_draw(uint32_t index, lg_rng *rng) {
    static const double heights[6] = {1.5, 2.0, 2.5, 3.0, 3.5, 4.5}, directions[3] = {20.0, 45.0, 70.0};
    const double height = heights[index / 3 % 6];
    const double stretch = lg_rng_uniform_in(rng, 0.95, 1.25), turn = lg_rng_uniform_in(rng, -10.0, 10.0);
    return (lg_sea_state){.height = height,
                          .period = 4.2 * sqrt(height) * stretch + 1.0,
                          .direction = (directions[index % 3] + turn) * PI / 180.0};
}

void lg_riser_standard_run(uint32_t index, uint64_t seed, double severity, lg_riser_parameters *parameters,
                           lg_riser_run *run, uint32_t *label, uint32_t *sea_state) {
    static const double tensions[3] = {1.1e6, 1.4e6, 1.7e6}, joints[3] = {2e6, 2.3e6, 2.6e6};
    const uint32_t condition = index % LG_RISER_RUNS / 2, sea = condition % LG_SEA_STATES;
    lg_rng rng;
    lg_riser_parameters_init(parameters);
    parameters->top_tension = tensions[condition / LG_SEA_STATES];
    parameters->flex_joint = joints[condition / LG_SEA_STATES];
    parameters->severity = index % 2 ? severity : 1.0;
    lg_riser_run_init(run);
    lg_rng_seed(&rng, seed, STREAM_SEA_STATE + ((uint64_t)sea << 32));
    run->sea = lg_sea_state_draw(sea, &rng);
    lg_rng_seed(&rng, seed, STREAM_WAVES + ((uint64_t)condition << 32));
    run->seed = lg_rng_next(&rng);
    lg_rng_seed(&rng, seed, STREAM_NOISE + ((uint64_t)(index % LG_RISER_RUNS) << 32));
    run->noise_seed = lg_rng_next(&rng);
    *label = index % 2;
    *sea_state = sea;
}
