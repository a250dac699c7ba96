/* Machines: kinds of friction beyond viscous and Coulomb friction. docs/mechanics.md has the formulas.
 *
 * A kind changes the friction of its base, "diagonal" or "coulomb": if the machine has such a term, its
 * coefficients are taken and only what the kind adds is the term's force. Otherwise, and with values, the
 * term has coefficients of its own. Parameters and values are blocks of one number per velocity, first the
 * block of its own coefficients, if there is one. All forces have v.f <= 0 for any parameters: each for
 * itself, or together with the base. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

/* ---- coefficients ---- */

const lg_machine_term *lg_machine_base(const lg_machine *machine, const lg_machine_term *term) {
    if (term->kind->base == NULL || term->value_count > 0) return NULL;
    for (const lg_machine_term *base = NULL; lg_machine_next_term(machine, term->part, &base);)
        if (strcmp(base->kind->name, term->kind->base) == 0) return base;
    return NULL;
}

/* Whether the term has coefficients of its own. */
static bool is_whole(const lg_machine *machine, const lg_machine_term *term) {
    return lg_machine_base(machine, term) == NULL;
}

/* Blocks of a kind besides its own coefficients. */
static uint32_t blocks_of(const lg_machine *machine, const lg_machine_term *term) {
    if (!lg_term_has(term, LG_TERM_OF | LG_TERM_INPUTS)) return term->kind->blocks;
    return term->of_count > 0 ? lg_machine_feature_numbers(machine, term) : 1;
}

static size_t count_parameters(const lg_machine *machine, const lg_machine_term *term) {
    return (size_t)machine->velocities * (blocks_of(machine, term) + is_whole(machine, term));
}

/* Unit of a scaled coefficient of velocity k in the units of the log: a force, divided by the speed to the
 * given power. */
static double unit_of(const lg_machine *machine, uint32_t k, int power) {
    return lg_machine_drag_unit(machine, k, k, power);
}

/* The speed of velocity k that is 1 in scaled units. */
static double speed_of(const lg_machine *machine, uint32_t k) {
    return machine->scales.velocity[k] / machine->scales.time;
}

/* Block `index` besides the coefficients: of theta, (1, n). */
static lg_var block(const lg_term_at *r, uint32_t index) {
    const uint32_t first = (index + is_whole(r->machine, r->term)) * r->n;
    return lg_reshape(r->tape, lg_slice(r->tape, r->theta, 0, first, r->n), lg_shape2(1, r->n));
}

static lg_var row_of(const lg_term_at *r, const double *numbers) {
    return lg_input_f64(r->tape, lg_shape2(1, r->n), numbers);
}

/* Block `index` of the values, with the coefficients as block 0, divided by `unit`. */
static lg_var known(const lg_term_at *r, uint32_t index, const double *unit) {
    double scaled[LG_MACHINE_VELOCITIES];
    for (uint32_t k = 0; k < r->n; k++) scaled[k] = r->term->values[index * r->n + k] / unit[k];
    return row_of(r, scaled);
}

static void units(const lg_term_at *r, int power, double *out) {
    for (uint32_t k = 0; k < r->n; k++) out[k] = unit_of(r->machine, k, power);
}

/* The same of forces, divided by the speed to the given power. */
static lg_var known_force(const lg_term_at *r, uint32_t index, int power) {
    double unit[LG_MACHINE_VELOCITIES];
    units(r, power, unit);
    return known(r, index, unit);
}

/* The coefficients of the friction that the term changes, (1, n). */
static lg_var coefficients(const lg_term_at *r, int power) {
    const lg_machine_term *base = lg_machine_base(r->machine, r->term);
    if (base != NULL) {
        const lg_term_at of = lg_term_at_of(r->tape, r->vars, base, r->seen);
        return lg_machine_record_drag(&of, power);
    }
    if (r->term->value_count > 0) return known_force(r, 0, power);
    return lg_exp(r->tape, lg_reshape(r->tape, lg_slice(r->tape, r->theta, 0, 0, r->n), lg_shape2(1, r->n)));
}

/* What the blocks of a kind are, the coefficients first. Where blocks belong to features, the second one
 * stands for all of them. */
struct lg_friction {
    const char *names[5];
    double start[5];   /* of the parameters */
    const char *rules; /* of the values, a letter for each block; see fault_of */
    const char *fault; /* the sentence about values that break a rule */
    /* Block `index` in scaled units, (1, n); `unit` (n) becomes their units. */
    lg_var (*at)(const lg_term_at *r, uint32_t index, double *unit);
};

static uint32_t block_row(const lg_machine_term *term, uint32_t block) {
    return term->kind->blocks == 0 && block > 1 ? 1 : block;
}

static void put_numbers(lg_number_list *l, const lg_machine *machine, const lg_machine_term *term,
                        const double *theta) {
    const struct lg_friction *of = term->kind->friction;
    double x[LG_MACHINE_VELOCITIES], unit[LG_MACHINE_VELOCITIES] = {0.0};
    char name[48], by[64] = "";
    const lg_term_at r = lg_term_at_of(l->tape, &l->vars, term, NULL);
    const uint32_t count = blocks_of(machine, term);
    for (uint32_t b = is_whole(machine, term) ? 0 : 1; b <= count; b++) {
        const bool features = term->of_count > 0 && b > 0 && count > 1;
        lg_numbers_read(l, l->status == LG_OK ? of->at(&r, b, unit) : LG_NONE, r.n, x);
        if (features) lg_machine_feature_name(machine, term, b - 1, by, sizeof by);
        for (uint32_t k = 0; k < r.n; k++) {
            lg_machine_velocity_name(machine, k, name, sizeof name);
            lg_numbers_put(l, x[k] * unit[k], "%s.%s%s%s", of->names[block_row(term, b)], name,
                           features ? "." : "", by);
        }
    }
}

/* ---- functions of the velocity ---- */

static void widths(const lg_term_at *r, double *out) {
    for (uint32_t k = 0; k < r->n; k++)
        out[k] = lg_machine_width(r->machine, r->term, k) / speed_of(r->machine, k);
}

/* tanh(v/w). */
static lg_var soft_sign(const lg_term_at *r, lg_var v) {
    double steep[LG_MACHINE_VELOCITIES];
    widths(r, steep);
    for (uint32_t k = 0; k < r->n; k++) steep[k] = 1.0 / steep[k];
    return lg_act(r->tape, lg_mul(r->tape, v, row_of(r, steep)), LG_TANH);
}

static bool jumps(const lg_term_at *r) {
    return !r->vars->soft && lg_machine_term_sticks(r->machine, r->term);
}

/* S: without a width the sign of v, 0 at v = 0. */
static lg_var sign_of(const lg_term_at *r) {
    const lg_var v = r->seen->v;
    if (!jumps(r)) return soft_sign(r, v);
    if (!lg_is_none(r->seen->sign)) return r->seen->sign;
    const lg_var zero = lg_full(r->tape, lg_shape2(1, 1), 0.0);
    return lg_sub(r->tape, lg_ge(r->tape, v, zero), lg_ge(r->tape, zero, v));
}

lg_var lg_machine_record_rubbing(const lg_term_at *r) {
    return lg_neg(r->tape, lg_mul(r->tape, r->term->kind->limit(r), sign_of(r)));
}

/* ---- friction without a width ---- */

bool lg_machine_term_sticks(const lg_machine *machine, const lg_machine_term *term) {
    return machine->sticks != 0 && lg_term_has(term, LG_TERM_WIDTH) && term->width == 0.0;
}

/* Whether friction of the term may act on velocity k: its numbers there are not known to be 0. */
static bool may_rub(const lg_machine *machine, const lg_machine_term *term, uint32_t k) {
    const lg_machine_term *base = lg_machine_base(machine, term), *from = base != NULL ? base : term;
    const uint32_t index = k + (base == NULL && term->kind->blocks > 0 ? machine->velocities : 0);
    return lg_machine_is_entry_of(from, index) || from->value_count == 0 || from->values[index] != 0.0;
}

uint32_t lg_machine_find_sticking(const lg_machine *machine) {
    uint32_t found = 0;
    if (machine->places != machine->velocities || machine->rotations > 0) return 0;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        if (!lg_term_has(term, LG_TERM_WIDTH) || term->width > 0.0) continue;
        for (uint32_t k = 0; k < machine->velocities; k++)
            if (may_rub(machine, term, k)) found |= 1U << k;
    }
    return found;
}

/* ---- asymmetric: -(b v + d (sqrt(v^2 + w^2) - w)), d = b tanh y; without a width -(b + d S) v ---- */

/* |v|, rounded if there is a width. */
static lg_var speed_size(const lg_term_at *r) {
    const lg_var v = r->seen->v;
    double w[LG_MACHINE_VELOCITIES], square[LG_MACHINE_VELOCITIES];
    if (jumps(r)) return lg_mul(r->tape, v, sign_of(r));
    widths(r, w);
    for (uint32_t k = 0; k < r->n; k++) square[k] = w[k] * w[k];
    const lg_var size = lg_sqrt(r->tape, lg_add(r->tape, lg_square(r->tape, v), row_of(r, square)));
    return lg_sub(r->tape, size, row_of(r, w));
}

static lg_var difference(const lg_term_at *r, lg_var b) {
    return r->term->value_count > 0 ? known_force(r, 1, 1)
                                    : lg_mul(r->tape, b, lg_act(r->tape, block(r, 0), LG_TANH));
}

/* b, d */
static lg_var asymmetric_at(const lg_term_at *r, uint32_t index, double *unit) {
    const lg_var b = coefficients(r, 1);
    units(r, 1, unit);
    return index == 0 ? b : difference(r, b);
}

static lg_var asymmetric(const lg_term_at *r) {
    const lg_var b = coefficients(r, 1);
    lg_var f = lg_mul(r->tape, difference(r, b), speed_size(r));
    if (is_whole(r->machine, r->term)) f = lg_add(r->tape, f, lg_mul(r->tape, b, r->seen->v));
    return lg_neg(r->tape, f);
}

/* ---- stribeck: -(c + (cs - c) e^(-(v/vs)^2)) S, cs = c (1 + 2/(1 + e^-y)) ---- */

/* log vs is between the logs of 2 w and a third of the largest speed (at least 4 w). */
static void speed_range(const lg_machine *machine, const lg_machine_term *term, uint32_t k, double *low,
                        double *high) {
    static const double most = 0.3;
    *low = 2.0 * lg_machine_width(machine, term, k);
    *high = fmax(most * machine->scales.fastest[k], 2.0 * *low);
}

static lg_var stribeck_speed(const lg_term_at *r) {
    double start[LG_MACHINE_VELOCITIES], range[LG_MACHINE_VELOCITIES], unit[LG_MACHINE_VELOCITIES];
    for (uint32_t k = 0; k < r->n; k++) {
        double low, high;
        speed_range(r->machine, r->term, k, &low, &high);
        unit[k] = speed_of(r->machine, k);
        start[k] = low / unit[k];
        range[k] = log(high / low);
    }
    if (r->term->value_count > 0) return known(r, 2, unit);
    const lg_var above = lg_mul(r->tape, row_of(r, range), lg_act(r->tape, block(r, 1), LG_SIGMOID));
    return lg_mul(r->tape, row_of(r, start), lg_exp(r->tape, above));
}

/* cs - c. */
static lg_var breakaway(const lg_term_at *r, lg_var c) {
    if (r->term->value_count > 0) return lg_sub(r->tape, known_force(r, 1, 0), c);
    return lg_mul(r->tape, c, lg_scale(r->tape, lg_act(r->tape, block(r, 0), LG_SIGMOID), 2.0));
}

/* e^(-(v/vs)^2). */
static lg_var fading(lg_tape *tape, lg_var v, lg_var vs) {
    return lg_exp(tape, lg_neg(tape, lg_square(tape, lg_div(tape, v, vs))));
}

static lg_var stribeck_limit(const lg_term_at *r) {
    const lg_var c = coefficients(r, 0);
    const lg_var size = lg_mul(r->tape, breakaway(r, c), fading(r->tape, r->seen->v, stribeck_speed(r)));
    return is_whole(r->machine, r->term) ? lg_add(r->tape, size, c) : size;
}

/* ---- lugre: -(s0 z + s1 z'), z' = v - s0 |v| z/g, g as for stribeck, s0 = c/d ---- */

/* Steady sliding bends the bristles by d; log d is within log(1e5) below the log of the way that the largest
 * speed goes in the unit of time. */
static const double deflections = 11.512925464970229;

static lg_var stiffness(const lg_term_at *r) {
    double number[LG_MACHINE_VELOCITIES];
    for (uint32_t k = 0; k < r->n; k++)
        number[k] = r->term->value_count > 0 ? unit_of(r->machine, k, 0) / r->machine->scales.velocity[k]
                                             : r->machine->scales.velocity[k] /
                                                   (r->machine->scales.fastest[k] * r->machine->scales.time);
    if (r->term->value_count > 0) return known(r, 3, number);
    const lg_var share = lg_act(r->tape, block(r, 2), LG_SIGMOID),
                 most = lg_exp(r->tape, lg_scale(r->tape, share, deflections));
    return lg_mul(r->tape, coefficients(r, 0), lg_mul(r->tape, row_of(r, number), most));
}

bool lg_machine_find_bristles(lg_machine *machine) {
    uint32_t count = 0;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);)
        count += term->kind->bristles;
    machine->bristles = count > 0 ? machine->velocities : 0;
    return count <= 1;
}

static lg_term_at bristles_of(lg_tape *tape, const lg_machine_vars *vars) {
    const lg_machine_term *term = vars->machine->terms;
    while (!term->kind->bristles) term++;
    return lg_term_at_of(tape, vars, term, NULL);
}

enum { SLIDING, MORE, SPEED, SPRING, DAMPER };

void lg_machine_bind_bristles(lg_tape *tape, lg_machine_vars *vars) {
    const lg_term_at r = bristles_of(tape, vars);
    lg_var *b = vars->bristles;
    b[SLIDING] = coefficients(&r, 0);
    b[MORE] = breakaway(&r, b[SLIDING]);
    b[SPEED] = stribeck_speed(&r);
    b[SPRING] = stiffness(&r);
    b[DAMPER] = r.term->value_count > 0 ? known_force(&r, 4, 1) : lg_exp(tape, block(&r, 3));
}

/* g(v) */
static lg_var sliding(lg_tape *tape, const lg_machine_vars *vars, lg_var v) {
    const lg_var *b = vars->bristles;
    return lg_add(tape, b[SLIDING], lg_mul(tape, b[MORE], fading(tape, v, b[SPEED])));
}

/* s0 (|v| + least)/g */
static lg_var relaxing(lg_tape *tape, const lg_machine_vars *vars, lg_var v, double least) {
    const lg_var speed = lg_add_scalar(tape, lg_abs(tape, v), least);
    return lg_div(tape, lg_mul(tape, speed, vars->bristles[SPRING]), sliding(tape, vars, v));
}

lg_var lg_machine_bristle_rate(lg_tape *tape, const lg_machine_vars *vars, lg_var v, lg_var z) {
    return lg_sub(tape, v, lg_mul(tape, relaxing(tape, vars, v, 0.0), z));
}

lg_var lg_machine_bristle_steady(lg_tape *tape, const lg_machine_vars *vars, lg_var v) {
    const lg_term_at r = bristles_of(tape, vars);
    const lg_var most = lg_div(tape, sliding(tape, vars, v), vars->bristles[SPRING]);
    return lg_mul(tape, soft_sign(&r, v), most);
}

/* With x = s0 |v| h/g and t = tanh(x/2): e^-x = (1 - t)/(1 + t), and zs (1 - e^-x) = v h 2 t/((1 + t) x),
 * which is smooth where v changes its sign. `least` keeps x above 0. */
lg_var lg_machine_bristle_after(lg_tape *tape, const lg_machine_vars *vars, lg_var v, lg_var z, lg_var h) {
    static const double least = 1e-15;
    const lg_var x = lg_mul(tape, relaxing(tape, vars, v, least), h);
    const lg_var t = lg_act(tape, lg_scale(tape, x, 0.5), LG_TANH), below = lg_add_scalar(tape, t, 1.0);
    const lg_var kept = lg_mul(tape, z, lg_add_scalar(tape, lg_neg(tape, t), 1.0));
    const lg_var bent = lg_mul(tape, lg_mul(tape, v, h), lg_div(tape, lg_scale(tape, t, 2.0), x));
    return lg_div(tape, lg_add(tape, kept, bent), below);
}

static lg_var lugre(const lg_term_at *r) {
    lg_tape *tape = r->tape;
    const lg_var *b = r->vars->bristles, z = r->seen->parts[lg_machine_parts(r->machine).z],
                 rate = lg_machine_bristle_rate(tape, r->vars, r->seen->v, z);
    return lg_neg(tape, lg_add(tape, lg_mul(tape, z, b[SPRING]), lg_mul(tape, rate, b[DAMPER])));
}

/* c, cs, vs, and of LuGre friction s0, s1 */
static lg_var stribeck_at(const lg_term_at *r, uint32_t index, double *unit) {
    const lg_var c = coefficients(r, 0);
    units(r, index == DAMPER ? 1 : 0, unit);
    for (uint32_t k = 0; k < r->n; k++)
        unit[k] = index == SPEED    ? speed_of(r->machine, k)
                  : index == SPRING ? unit[k] / r->machine->scales.velocity[k]
                                    : unit[k];
    return index == SLIDING  ? c
           : index == MORE   ? lg_add(r->tape, c, breakaway(r, c))
           : index == SPEED  ? stribeck_speed(r)
           : index == SPRING ? stiffness(r)
                             : r->vars->bristles[DAMPER];
}

bool lg_machine_set_bristles(const lg_machine *machine, double part, double *theta) {
    static const double end = 0.02;
    const size_t n = machine->velocities;
    const double y = fmin(fmax(part, end), 1.0 - end);
    bool any = false;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        if (!term->kind->bristles || term->value_count > 0) continue;
        any = true;
        for (size_t k = 0; k < n; k++) theta[term->offset + 3 * n + k] = log(y / (1.0 - y));
    }
    return any;
}

/* ---- load and position: -c g S, where g = 1 + k |load|, or the positive part of 1 + k q, rounded ---- */

/* The positive part of 1 + x, which is rounded near x = -1. */
static const double rounding = 0.05;

static lg_var positive_part(lg_tape *tape, lg_var x) {
    const lg_var y = lg_add_scalar(tape, x, 1.0);
    const lg_var size = lg_sqrt(tape, lg_add_scalar(tape, lg_square(tape, y), rounding * rounding));
    return lg_scale(tape, lg_add(tape, y, size), 0.5);
}

/* The loads of the term, (B, F), in scaled units: inputs, or the force of the potential on each velocity.
 * LG_NONE: there is none. */
static lg_var loads_of(const lg_term_at *r) {
    const lg_var loads = r->term->of_count == 0   ? lg_machine_record_pull(r->tape, r->vars, r->seen->parts)
                         : lg_is_none(r->seen->u) ? LG_NONE
                                                  : lg_machine_record_features(r);
    return lg_is_none(loads) ? loads : lg_abs(r->tape, loads);
}

/* c, then k of each feature. */
static lg_var factor_at(const lg_term_at *r, uint32_t index, double *unit) {
    double scales[LG_MACHINE_FEATURE_NUMBERS];
    units(r, 0, unit);
    if (index == 0) return coefficients(r, 0);
    if (r->term->of_count > 0) (void)lg_machine_feature_scales(r->machine, r->term, scales);
    /* Scaled units of the loads or positions, and of the potential's force on velocity k. */
    for (uint32_t k = 0; k < r->n; k++) unit[k] = 1.0 / (r->term->of_count > 0 ? scales[index - 1] : unit[k]);
    return r->term->value_count > 0 ? known(r, index, unit) : block(r, index - 1);
}

static lg_var load_at(const lg_term_at *r, uint32_t index, double *unit) {
    const lg_var x = factor_at(r, index, unit);
    return index == 0 || r->term->value_count > 0 ? x : lg_exp(r->tape, x);
}

/* sum_f k_f x_f, (B, n), of the features x (B, F); for the potential's force k_k x_k. */
static lg_var weighted(const lg_term_at *r, lg_var x) {
    double unit[LG_MACHINE_VELOCITIES];
    const uint32_t count = blocks_of(r->machine, r->term);
    lg_var sum = LG_NONE;
    for (uint32_t f = 0; f < count; f++) {
        const lg_var factor = r->term->kind->friction->at(r, f + 1, unit);
        const lg_var each = r->term->of_count > 0 ? lg_machine_columns(r->tape, x, f, 1) : x;
        sum = lg_add_or(r->tape, sum, lg_mul(r->tape, each, factor));
    }
    return sum;
}

/* c g of a whole term, else c (g - 1). */
static lg_var scaled_limit(const lg_term_at *r, lg_var g) {
    const lg_var size = is_whole(r->machine, r->term) ? g : lg_add_scalar(r->tape, g, -1.0);
    return lg_mul(r->tape, coefficients(r, 0), size);
}

static lg_var load_limit(const lg_term_at *r) {
    const lg_var loads = loads_of(r), none = lg_full(r->tape, lg_shape2(1, r->n), 1.0);
    return scaled_limit(r, lg_is_none(loads) ? none : lg_add_scalar(r->tape, weighted(r, loads), 1.0));
}

static lg_var position_limit(const lg_term_at *r) {
    return scaled_limit(r, positive_part(r->tape, weighted(r, lg_machine_record_features(r))));
}

/* ---- starts, and the direction of scale ---- */

static void start(const lg_machine *machine, const lg_machine_term *term, double *theta) {
    const uint32_t first = is_whole(machine, term) ? 0 : 1;
    for (uint32_t i = 0; i < term->parameters; i++)
        theta[i] = term->kind->friction->start[block_row(term, first + i / machine->velocities)];
}

/* The deflection of bristles does not change, so that s0 z is scaled as c is. */
static void scale(const lg_machine *machine, const lg_machine_term *term, const double *theta,
                  double *direction) {
    const uint32_t first = is_whole(machine, term) ? 0 : 1;
    for (uint32_t i = 0; i < term->parameters; i++) {
        const uint32_t b = block_row(term, first + i / machine->velocities);
        direction[i] = b == SLIDING || b == DAMPER ? 1.0 : 0.0;
    }
}

/* ---- values ---- */

/* Rules: 0 not below 0; + above 0; > not below the coefficient; | not larger than it in size; * any. */
static const char *fault_of(const lg_machine *machine, const lg_machine_term *term) {
    const struct lg_friction *of = term->kind->friction;
    for (uint32_t i = 0; i < term->value_count; i++) {
        const double x = term->values[i], c = term->values[i % machine->velocities];
        const char rule = of->rules[block_row(term, i / machine->velocities)];
        const bool good = rule == '0'   ? x >= 0.0
                          : rule == '+' ? x > 0.0
                          : rule == '>' ? x >= c
                          : rule == '|' ? fabs(x) <= c
                                        : true;
        if (!good) return of->fault;
    }
    return NULL;
}

/* ---- the table ---- */

/* Coefficients start at 0.01 in scaled units, as those of the other kinds; breakaway at 1.5 times the
 * friction of sliding; its speed at a tenth of the largest one, three quarters of its range, because from a
 * smaller one fits see too few rows. At first, sliding bends the bristles by a hundredth of the most. */
#define OWN      (-4.605170185988091)
#define SLIPS    OWN, -1.0986122886681098, 1.27
#define STRIBECK "coulomb", "breakaway", "stribeck_speed"
static const struct lg_friction
    as_asymmetric = {.names = {"damping", "asymmetric"},
                     .start = {OWN, 0.0},
                     .rules = "*|",
                     .fault =
                         "the difference must not exceed the viscous friction: friction would give energy",
                     .at = asymmetric_at},
    as_stribeck = {.names = {STRIBECK},
                   .start = {SLIPS},
                   .rules = "0>+",
                   .fault =
                       "the values are three rows: friction of sliding (not below 0), friction at rest (not "
                       "below that), and the speed between them (above 0)",
                   .at = stribeck_at},
    as_lugre = {.names = {STRIBECK, "bristle_stiffness", "bristle_damping"},
                .start = {SLIPS, -0.4054651081081644, OWN},
                .rules = "+>++0",
                .fault =
                    "the values are five rows: friction of sliding (above 0), friction at rest (not below "
                    "that), the speed between them, the stiffness of the bristles (above 0) and their "
                    "damping (not below 0)",
                .at = stribeck_at},
    as_load = {.names = {"coulomb", "load"},
               .start = {OWN, -2.302585092994046},
               .rules = "00",
               .fault = "friction and its factors must not be below 0",
               .at = load_at},
    as_position = {.names = {"coulomb", "position"},
                   .start = {OWN, 0.0},
                   .rules = "0*",
                   .fault = "friction must not be below 0",
                   .at = factor_at};

#define FRICTION(what)                                                                                       \
    .part = LG_MACHINE_DAMPING, .parameters = count_parameters, .scaling = scale, .initialise = start,       \
    .numbers = put_numbers, .fault = fault_of, .friction = &(what)
const lg_term_kind lg_machine_friction_kinds[] = {
    {.name = "asymmetric",
     .options = LG_TERM_WIDTH | LG_TERM_VALUES,
     .base = "diagonal",
     .blocks = 1,
     .record = asymmetric,
     FRICTION(as_asymmetric)},
    {.name = "stribeck",
     .options = LG_TERM_WIDTH | LG_TERM_VALUES,
     .base = "coulomb",
     .blocks = 2,
     .limit = stribeck_limit,
     .record = lg_machine_record_rubbing,
     FRICTION(as_stribeck)},
    {.name = "lugre",
     .options = LG_TERM_VALUES,
     .blocks = 4,
     .record = lugre,
     .bristles = true,
     FRICTION(as_lugre)},
    {.name = "load",
     .options = LG_TERM_WIDTH | LG_TERM_VALUES | LG_TERM_SOME | LG_TERM_INPUTS,
     .base = "coulomb",
     .limit = load_limit,
     .record = lg_machine_record_rubbing,
     FRICTION(as_load)},
    {.name = "position",
     .options = LG_TERM_WIDTH | LG_TERM_VALUES | LG_TERM_OF,
     .base = "coulomb",
     .limit = position_limit,
     .record = lg_machine_record_rubbing,
     FRICTION(as_position)},
    {.name = NULL}};
