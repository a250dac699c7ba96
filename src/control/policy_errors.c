/* Policies: what each kind of coordinate contributes to errors, costs, features and starts. One row a kind.
 */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "control/policy.h"
#include "liegrad/integrators.h"
#include "model/record.h"

typedef struct motion {
    lg_policy_motion_row sizes;
    uint32_t features;
    /* q is (B, position). `sine` are the errors times cos(a/2) with the angle a from the goal; without
     * `cosine` they are the errors. The cost is 2 (1 - cos a), or the square. A row whose position has no
     * errors has no sine. */
    lg_var (*sine)(lg_tape *tape, const double *goal, const double *basis, lg_var q);
    lg_var (*cosine)(lg_tape *tape, const double *goal, lg_var q);      /* cos a (B, 1); NULL: a line */
    lg_var (*features_of)(lg_tape *tape, const double *goal, lg_var q); /* NULL: errors of a line, or q */
    /* The position from the controller's, and the controller's from the position; NULL: the same numbers. */
    lg_var (*given)(lg_tape *tape, lg_var q), (*sensed)(lg_tape *tape, lg_var q);
    lg_var (*noisy)(lg_tape *tape, lg_var q, lg_var n); /* q with the noise n */
    lg_var (*place)(lg_tape *tape, const double *goal, const double *basis, lg_var z); /* q from errors */
} motion;

/* ---- lines and angles ---- */

lg_var lg_policy_filled(lg_tape *tape, lg_var x, uint32_t n, double value) {
    const lg_var full = lg_full(tape, lg_shape2(lg_var_shape(tape, x).dims[0], n), value);
    lg_tape_mark_rows(tape, full);
    return full;
}

static lg_var from_goal(lg_tape *tape, const double *goal, const double *basis, lg_var q) {
    return lg_add_scalar(tape, q, -goal[0]);
}

static lg_var line_place(lg_tape *tape, const double *goal, const double *basis, lg_var z) {
    return lg_add_scalar(tape, z, goal[0]);
}

static lg_var line_noisy(lg_tape *tape, lg_var q, lg_var n) {
    return lg_add(tape, q, n);
}

static lg_var free_place(lg_tape *tape, const double *goal, const double *basis, lg_var z) {
    return lg_policy_filled(tape, z, 1, goal[0]);
}

static lg_var angle_sine(lg_tape *tape, const double *goal, const double *basis, lg_var q) {
    return lg_sin(tape, from_goal(tape, goal, basis, q));
}

static lg_var angle_cosine(lg_tape *tape, const double *goal, lg_var q) {
    return lg_cos(tape, from_goal(tape, goal, NULL, q));
}

static lg_var angle_features(lg_tape *tape, const double *goal, lg_var q) {
    const lg_var from = from_goal(tape, goal, NULL, q);
    return lg_concat(tape, (lg_var[]){lg_sin(tape, from), lg_cos(tape, from)}, 2, 1);
}

/* ---- directions ---- */

static lg_var direction_sine(lg_tape *tape, const double *goal, const double *basis, lg_var q) {
    return lg_matmul(tape, q, lg_input_f64(tape, lg_shape2(3, 2), basis));
}

static lg_var direction_cosine(lg_tape *tape, const double *goal, lg_var q) {
    return lg_matmul(tape, q, lg_input_f64(tape, lg_shape2(3, 1), goal));
}

/* q/|q|: sensors give unit vectors only to rounding. */
static lg_var direction_given(lg_tape *tape, lg_var q) {
    return lg_div(tape, q, lg_sqrt(tape, lg_rownorm2(tape, q)));
}

static lg_var direction_noisy(lg_tape *tape, lg_var q, lg_var n) {
    return direction_given(tape, lg_add(tape, q, lg_cross(tape, n, q)));
}

static lg_var along(lg_tape *tape, const double *basis, lg_var z) {
    return lg_matmul_nt(tape, z, lg_input_f64(tape, lg_shape2(3, 2), basis));
}

/* cos|z| goal + sin|z|/|z| z, z in the plane across the goal */
static lg_var direction_place(lg_tape *tape, const double *goal, const double *basis, lg_var z) {
    const lg_var c = lg_stumpff_functions(tape, lg_rownorm2(tape, z), 1);
    return lg_add(tape, lg_mul(tape, along(tape, basis, z), lg_slice(tape, c, 1, 1, 1)),
                  lg_mul(tape, lg_slice(tape, c, 1, 0, 1), lg_input_f64(tape, lg_shape2(1, 3), goal)));
}

/* ---- rotations ---- */

/* The 9 columns of S = goal^T R as a linear map of R: (9, 9) with S_ij = sum_k goal_ki R_kj. */
static lg_var turned(lg_tape *tape, const double *goal, lg_var q) {
    double map[81] = {0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++) map[(3 * k + j) * 9 + 3 * i + j] = goal[3 * k + i];
    return lg_matmul(tape, q, lg_input_f64(tape, lg_shape2(9, 9), map));
}

static lg_var rotation_sine(lg_tape *tape, const double *goal, const double *basis, lg_var q) {
    static const double vee[27] = {[5 * 3 + 0] = -0.5, [7 * 3 + 0] = 0.5,  [2 * 3 + 1] = 0.5,
                                   [6 * 3 + 1] = -0.5, [1 * 3 + 2] = -0.5, [3 * 3 + 2] = 0.5};
    return lg_matmul(tape, turned(tape, goal, q), lg_input_f64(tape, lg_shape2(9, 3), vee));
}

static lg_var rotation_cosine(lg_tape *tape, const double *goal, lg_var q) {
    const lg_var trace = lg_matmul(tape, q, lg_input_f64(tape, lg_shape2(9, 1), goal));
    return lg_add_scalar(tape, lg_scale(tape, trace, 0.5), -0.5);
}

/* R exp(z) - R, rows t_i = r_i x z given: row i is c_1 t_i + c_2 t_i x z with Stumpff functions of |z|^2. */
static lg_var turn_by(lg_tape *tape, const lg_var *t, lg_var z) {
    const lg_var c = lg_stumpff_functions(tape, lg_rownorm2(tape, z), 2);
    lg_var rows[3];
    for (uint32_t i = 0; i < 3; i++)
        rows[i] = lg_add(tape, lg_mul(tape, t[i], lg_slice(tape, c, 1, 1, 1)),
                         lg_mul(tape, lg_cross(tape, t[i], z), lg_slice(tape, c, 1, 2, 1)));
    return lg_concat(tape, rows, 3, 1);
}

static lg_var rotation_noisy(lg_tape *tape, lg_var q, lg_var n) {
    lg_var t[3];
    for (uint32_t i = 0; i < 3; i++) t[i] = lg_cross(tape, lg_slice(tape, q, 1, 3 * i, 3), n);
    return lg_add(tape, q, turn_by(tape, t, n));
}

static lg_var rotation_place(lg_tape *tape, const double *goal, const double *basis, lg_var z) {
    static const double hat[9][3] = {{0},        {0, 0, -1}, {0, 1, 0}, {0, 0, 1}, {0},
                                     {-1, 0, 0}, {0, -1, 0}, {1, 0, 0}, {0}};
    double T[27] = {0};
    lg_var t[3];
    for (int i = 0; i < 27; i++)
        for (int k = 0; k < 3; k++) T[i] += goal[i / 9 * 3 + k] * hat[3 * k + i / 3 % 3][i % 3];
    const lg_var first = lg_matmul_nt(tape, z, lg_input_f64(tape, lg_shape2(9, 3), T));
    for (uint32_t i = 0; i < 3; i++) t[i] = lg_slice(tape, first, 1, 3 * i, 3);
    return lg_add(tape, turn_by(tape, t, z), lg_input_f64(tape, lg_shape2(1, 9), goal));
}

/* The products ww wx wy wz xx xy xz yy yz zz of a unit quaternion -> R row-major. */
static const double rotation_map[90] = {
    1, 0, 0, 0, 1,  0, 0,  0, 1,  /* ww */ 0,  0,  0, 0, 0,  -2, 0, 2, 0,  /* wx */
    0, 0, 2, 0, 0,  0, -2, 0, 0,  /* wy */ 0,  -2, 0, 2, 0,  0,  0, 0, 0,  /* wz */
    1, 0, 0, 0, -1, 0, 0,  0, -1, /* xx */ 0,  2,  0, 2, 0,  0,  0, 0, 0,  /* xy */
    0, 0, 2, 0, 0,  0, 2,  0, 0,  /* xz */ -1, 0,  0, 0, 1,  0,  0, 0, -1, /* yy */
    0, 0, 0, 0, 0,  2, 0,  2, 0,  /* yz */ -1, 0,  0, 0, -1, 0,  0, 0, 1 /* zz */};

/* R from a quaternion w x y z of any length but 0: products of two numbers of it, then a linear map. */
static lg_var rotation_given(lg_tape *tape, lg_var q) {
    static const uint32_t first[10] = {0, 0, 0, 0, 1, 1, 1, 2, 2, 3},
                          second[10] = {0, 1, 2, 3, 1, 2, 3, 2, 3, 3};
    lg_var product[10];
    for (int k = 0; k < 10; k++)
        product[k] = lg_mul(tape, lg_slice(tape, q, 1, first[k], 1), lg_slice(tape, q, 1, second[k], 1));
    const lg_var R =
        lg_matmul(tape, lg_concat(tape, product, 10, 1), lg_input_f64(tape, lg_shape2(10, 9), rotation_map));
    return lg_div(tape, R, lg_rownorm2(tape, q));
}

/* The unit quaternion q of R: the row of 4 q q^T with the largest number on the diagonal, scaled to length 1.
 * The products of q are linear in R, by the transpose of the map of rotation_given. */
static lg_var rotation_sensed(lg_tape *tape, lg_var R) {
    static const double half[10] = {1, 0.5, 0.5, 0.5, 1, 0.5, 0.5, 1, 0.5, 1},
                        one[10] = {1, 0, 0, 0, 1, 0, 0, 1, 0, 1};
    static const uint32_t of_row[4][4] = {{0, 1, 2, 3}, {1, 4, 5, 6}, {2, 5, 7, 8}, {3, 6, 8, 9}};
    const lg_shape row = lg_shape2(1, 10);
    const lg_var linear = lg_matmul_nt(tape, R, lg_input_f64(tape, lg_shape2(10, 9), rotation_map)),
                 products = lg_add(tape, lg_mul(tape, linear, lg_input_f64(tape, row, half)),
                                   lg_input_f64(tape, row, one));
    lg_var best[4], most = LG_NONE;
    for (uint32_t i = 0; i < 4; i++) {
        const lg_var own = lg_columns(tape, products, of_row[i][i], 1),
                     keep = i == 0 ? LG_NONE : lg_ge(tape, most, own);
        for (uint32_t j = 0; j < 4; j++) {
            const lg_var number = lg_columns(tape, products, of_row[i][j], 1);
            best[j] = i == 0 ? number : lg_select(tape, keep, best[j], number);
        }
        most = i == 0 ? own : lg_max(tape, most, own);
    }
    return direction_given(tape, lg_concat(tape, best, 4, 1));
}

/* The row behind the motions is of free lines and angles. */
enum { FREE = LG_POLICY_MOTION_COUNT };

static const motion motions[LG_POLICY_MOTION_COUNT + 1] = {
    [LG_POLICY_LINE] = {{"line", 1, 1, 1, 1, 1}, 1, from_goal, .noisy = line_noisy, .place = line_place},
    [LG_POLICY_ANGLE] = {{"angle", 1, 1, 1, 1, 1},
                         2,
                         angle_sine,
                         angle_cosine,
                         angle_features,
                         .noisy = line_noisy,
                         .place = line_place},
    [LG_POLICY_DIRECTION] = {{"direction", 3, 3, 3, 2, 2},
                             3,
                             direction_sine,
                             direction_cosine,
                             NULL,
                             direction_given,
                             NULL,
                             direction_noisy,
                             direction_place},
    [LG_POLICY_ROTATION] = {{"rotation", 9, 4, 3, 3, 3},
                            9,
                            rotation_sine,
                            rotation_cosine,
                            turned,
                            rotation_given,
                            rotation_sensed,
                            rotation_noisy,
                            rotation_place},
    [FREE] = {{"free", 1, 1, 1, 0, 1}, .noisy = line_noisy, .place = free_place}};

const lg_policy_motion_row *lg_policy_motion_row_of(lg_policy_motion kind) {
    return (uint32_t)kind < LG_POLICY_MOTION_COUNT ? &motions[kind].sizes : NULL;
}

static const motion *motion_of(const lg_policy_coordinate *c) {
    return &motions[c->free ? FREE : c->motion];
}

const lg_policy_motion_row *lg_policy_row_of(const lg_policy_coordinate *c) {
    return (uint32_t)c->motion < LG_POLICY_MOTION_COUNT ? &motion_of(c)->sizes : NULL;
}

/* ---- layout ---- */

static bool moves(const lg_policy_coordinate *c) {
    return c->velocity[0] != '\0';
}

/* Two unit vectors across g, from the basis of the tangent space. */
static void plane_across(const double *g, double *E) {
    const double y[6] = {g[0], g[1], g[2]};
    double basis[6 * 4];
    lg_space_kind_entry(LG_SPACE_TS2)->basis(y, 4, basis);
    for (int i = 0; i < 3; i++) E[2 * i] = basis[4 * i + 1], E[2 * i + 1] = -basis[4 * i];
}

void lg_policy_lay_out(const lg_policy_task *task, lg_policy_layout *out) {
    memset(out, 0, sizeof *out);
    for (uint32_t i = 0; i < task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &task->coordinate[i];
        const lg_policy_motion_row *sizes = lg_policy_row_of(c);
        out->at[i] = (lg_policy_place){out->positions, out->given, out->velocities, out->errors, 0};
        out->positions += sizes->position, out->given += sizes->given, out->noise += sizes->velocity;
        for (uint32_t k = 0; k < sizes->errors; k++) out->owner[out->errors++] = i;
        if (moves(c)) out->velocities += sizes->velocity, out->noise += sizes->velocity;
        if (c->motion == LG_POLICY_DIRECTION) plane_across(c->goal, out->basis[i]);
    }
    for (uint32_t i = 0; i < task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &task->coordinate[i];
        out->at[i].rate = out->errors;
        for (uint32_t k = 0; moves(c) && k < lg_policy_row_of(c)->rates; k++) out->owner[out->errors++] = i;
    }
}

/* ---- what a task asks for ---- */

bool lg_policy_is_disturbed(const lg_policy_task *task) {
    bool noisy = false;
    for (uint32_t i = 0; i < task->coordinate_count; i++)
        noisy = noisy || task->coordinate[i].noise > 0.0 || task->coordinate[i].noise_velocity > 0.0;
    return noisy || task->delay > 0.0 || task->draws > 0;
}

uint32_t lg_policy_tracked(const lg_policy_task *task) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < task->coordinate_count; i++) n += task->coordinate[i].track;
    return n;
}

/* ---- recordings ---- */

/* cos(a/2)^2 = (1 + cos a)/2, kept above 0 by 1e-6, also in single precision: the errors are finite on
 * the opposite side. */
static lg_var half_cosine(lg_tape *tape, lg_var cosine) {
    return lg_sqrt(tape, lg_add_scalar(tape, lg_scale(tape, cosine, 0.5), 0.5 + 1e-6));
}

lg_var lg_policy_record_errors(lg_tape *tape, const lg_policy *p, bool counted, lg_policy_seen seen) {
    lg_var parts[2 * LG_POLICY_COORDINATES];
    uint32_t n = 0;
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        const motion *m = counted && c->motion == LG_POLICY_ANGLE ? &motions[LG_POLICY_LINE] : motion_of(c);
        if (c->free) continue;
        const lg_var q = lg_columns(tape, seen.q, p->layout.at[i].position, m->sizes.position);
        parts[n] = m->sine(tape, c->goal, p->layout.basis[i], q);
        if (m->cosine != NULL)
            parts[n] = lg_div(tape, parts[n], half_cosine(tape, m->cosine(tape, c->goal, q)));
        n++;
    }
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        if (!moves(c)) continue;
        parts[n] = lg_columns(tape, seen.v, p->layout.at[i].velocity, lg_policy_row_of(c)->velocity);
        if (c->motion == LG_POLICY_DIRECTION)
            parts[n] = direction_sine(tape, c->goal, p->layout.basis[i], parts[n]);
        n++;
    }
    return lg_joined(tape, parts, n);
}

static lg_var position_cost(lg_tape *tape, const lg_policy_coordinate *c, lg_var q) {
    const motion *m = motion_of(c);
    if (m->cosine == NULL) return lg_square(tape, m->sine(tape, c->goal, NULL, q));
    return lg_add_scalar(tape, lg_scale(tape, m->cosine(tape, c->goal, q), -2.0), 2.0);
}

/* Exactly opposite to the goal an error has no direction and is 0. */
lg_var lg_policy_record_lost(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var z,
                             const double *factors) {
    lg_var terms[2 * LG_POLICY_COORDINATES];
    double weights[2 * LG_POLICY_COORDINATES];
    uint32_t n = 0;
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        const motion *m = motion_of(c);
        if (m->cosine == NULL) continue;
        weights[n] = factors[i];
        terms[n++] =
            position_cost(tape, c, lg_columns(tape, seen.q, p->layout.at[i].position, m->sizes.position));
        weights[n] = -factors[i];
        terms[n++] = lg_rownorm2(tape, lg_columns(tape, z, p->layout.at[i].error, m->sizes.errors));
    }
    return n == 0 ? LG_NONE : lg_linear_combination(tape, terms, weights, n);
}

lg_var lg_policy_record_stage(lg_tape *tape, const lg_policy *p, lg_policy_seen seen) {
    lg_var terms[2 * LG_POLICY_COORDINATES];
    double weights[2 * LG_POLICY_COORDINATES];
    uint32_t n = 0;
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        const lg_policy_motion_row *sizes = lg_policy_row_of(c);
        if (c->weight > 0.0) {
            weights[n] = c->weight;
            terms[n++] =
                position_cost(tape, c, lg_columns(tape, seen.q, p->layout.at[i].position, sizes->position));
        }
        if (c->weight_velocity > 0.0 && moves(c)) {
            weights[n] = c->weight_velocity;
            terms[n++] =
                lg_rownorm2(tape, lg_columns(tape, seen.v, p->layout.at[i].velocity, sizes->velocity));
        }
    }
    return lg_linear_combination(tape, terms, weights, n);
}

uint32_t lg_policy_features(const lg_policy_task *task) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < task->coordinate_count; i++) {
        const motion *m = motion_of(&task->coordinate[i]);
        n += m->features + (moves(&task->coordinate[i]) ? m->sizes.velocity : 0);
    }
    return n;
}

/* `scales`: of each error; a line's position and all velocities are divided by theirs. */
lg_var lg_policy_record_features(lg_tape *tape, const lg_policy *p, const double *scales,
                                 lg_policy_seen seen) {
    lg_var parts[2 * LG_POLICY_COORDINATES];
    uint32_t n = 0;
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        const motion *m = motion_of(c);
        const lg_policy_place *at = &p->layout.at[i];
        if (!c->free) {
            const lg_var q = lg_columns(tape, seen.q, at->position, m->sizes.position);
            parts[n++] = m->features_of != NULL ? m->features_of(tape, c->goal, q)
                         : m->cosine != NULL
                             ? q
                             : lg_scale(tape, from_goal(tape, c->goal, NULL, q), 1.0 / scales[at->error]);
        }
        if (moves(c))
            parts[n++] = lg_scale(tape, lg_columns(tape, seen.v, at->velocity, m->sizes.velocity),
                                  1.0 / scales[at->rate]);
    }
    return lg_joined(tape, parts, n);
}

void lg_policy_noise_sizes(const lg_policy_task *task, double *sizes) {
    for (int rate = 0; rate < 2; rate++)
        for (uint32_t i = 0; i < task->coordinate_count; i++) {
            const lg_policy_coordinate *c = &task->coordinate[i];
            for (uint32_t k = 0; k < lg_policy_row_of(c)->velocity && (rate == 0 || moves(c)); k++)
                *sizes++ = rate ? c->noise_velocity : c->noise;
        }
}

lg_policy_seen lg_policy_record_noise(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var noise) {
    lg_var parts[LG_POLICY_COORDINATES];
    uint32_t at = 0;
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const motion *m = motion_of(&p->task.coordinate[i]);
        parts[i] = m->noisy(tape, lg_columns(tape, seen.q, p->layout.at[i].position, m->sizes.position),
                            lg_columns(tape, noise, at, m->sizes.velocity));
        at += m->sizes.velocity;
    }
    seen.q = lg_joined(tape, parts, p->task.coordinate_count);
    if (p->layout.velocities > 0)
        seen.v = lg_add(tape, seen.v, lg_columns(tape, noise, at, p->layout.velocities));
    return seen;
}

lg_policy_seen lg_policy_record_place(lg_tape *tape, const lg_policy *p, lg_var z) {
    lg_var q[LG_POLICY_COORDINATES], v[LG_POLICY_COORDINATES];
    uint32_t n = 0;
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        const lg_policy_motion_row *sizes = lg_policy_row_of(c);
        const lg_var own = c->free ? z : lg_columns(tape, z, p->layout.at[i].error, sizes->errors);
        q[i] = motion_of(c)->place(tape, c->goal, p->layout.basis[i], own);
        if (!moves(c)) continue;
        v[n] = lg_columns(tape, z, p->layout.at[i].rate, sizes->rates);
        if (c->motion == LG_POLICY_DIRECTION) { /* omega stays across q */
            v[n] = along(tape, p->layout.basis[i], v[n]);
            v[n] = lg_sub(tape, v[n], lg_mul(tape, q[i], lg_rowdot(tape, v[n], q[i])));
        }
        n++;
    }
    return (lg_policy_seen){lg_joined(tape, q, p->task.coordinate_count),
                            n > 0 ? lg_joined(tape, v, n) : LG_NONE};
}

lg_var lg_policy_record_positions(lg_tape *tape, const lg_policy *p, bool given, lg_var q) {
    lg_var parts[LG_POLICY_COORDINATES];
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const motion *m = motion_of(&p->task.coordinate[i]);
        const lg_policy_place *at = &p->layout.at[i];
        lg_var (*const converted)(lg_tape *, lg_var) = given ? m->sensed : m->given;
        parts[i] = given ? lg_columns(tape, q, at->position, m->sizes.position)
                         : lg_columns(tape, q, at->given, m->sizes.given);
        if (converted != NULL) parts[i] = converted(tape, parts[i]);
    }
    return lg_joined(tape, parts, p->task.coordinate_count);
}

static void draw_axis(lg_rng *rng, uint32_t n, double length, double *z) {
    double x[3] = {0, 0, 0}, sum = 0.0;
    for (uint32_t i = 0; i < n; i++) x[i] = lg_rng_normal(rng), sum += x[i] * x[i];
    for (uint32_t i = 0; i < n; i++) z[i] = length * x[i] / sqrt(fmax(sum, 1e-300));
}

void lg_policy_draw(const lg_policy *p, lg_rng *rng, double *z) {
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        const lg_policy_motion_row *sizes = lg_policy_row_of(c);
        const double far = c->free ? 0.0 : lg_rng_uniform_in(rng, c->start[0], c->start[1]);
        if (sizes->errors == 1)
            z[p->layout.at[i].error] = far;
        else if (sizes->errors > 1)
            draw_axis(rng, sizes->errors, far, z + p->layout.at[i].error);
        for (uint32_t k = 0; moves(c) && k < sizes->rates; k++)
            z[p->layout.at[i].rate + k] = lg_rng_uniform_in(rng, c->start_velocity[0], c->start_velocity[1]);
    }
}

/* What `cosine` records, of one position. */
static double cosine_at(const lg_policy_coordinate *c, const double *q) {
    double product = 0.0;
    if (c->motion == LG_POLICY_ANGLE) return cos(q[0] - c->goal[0]);
    for (uint32_t k = 0; k < lg_policy_row_of(c)->position; k++) product += c->goal[k] * q[k];
    return c->motion == LG_POLICY_ROTATION ? 0.5 * (product - 1.0) : product;
}

bool lg_policy_inside(const lg_policy *p, const double *q, const double *z) {
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        const lg_policy_motion_row *sizes = lg_policy_row_of(c);
        double far = 0.0, fast = 0.0;
        for (uint32_t k = 0; k < sizes->errors; k++) far = hypot(far, z[p->layout.at[i].error + k]);
        for (uint32_t k = 0; moves(c) && k < sizes->rates; k++)
            fast = hypot(fast, z[p->layout.at[i].rate + k]);
        if (motion_of(c)->cosine != NULL) { /* errors are exact near the goal, cosines far from it */
            const double cosine = cosine_at(c, q + p->layout.at[i].position);
            far = cosine > 0.0 ? 2.0 * asin(fmin(far / 2.0, 1.0)) : acos(fmax(cosine, -1.0));
        }
        if (!(far < c->success) || !(fast < c->success_velocity)) return false;
    }
    return true;
}
