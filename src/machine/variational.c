/* Variational steps of machines with a constant mass; symplectic where the potential's are the only forces.
 *
 * kick (h/2) - drift (h) - kick (h/2), of order 2. liegrad/machine.h has the formulas.
 *
 * Kick: positions do not change; momenta change by h/2 f(q, v, u) with all forces f. Where forces depend on
 * v, v is the velocity in the middle of the change (implicit midpoint). So the kinetic energy changes by h/2
 * v.f, which is never above 0 for damping.
 *
 * Drift: free motion. With M constant, lines, angles and directions move exactly. Bodies, g = (x, R), move by
 * the variational integrator on the group with the discrete Lagrangian h/2 v^T M v, g1 = g0 exp(h v)
 * (Bou-Rabee and Marsden, Hamilton-Pontryagin integrators on Lie groups, 2009):
 *   p0 = (dexp_{h v}^-1)^T M v,  p1 = Ad_{exp(h v)}^T p0.
 * Newton's method finds v. Momenta in space are constant to rounding error, whatever v is. Momenta of a body
 * transform as pairs (l, m) under SE(3): (dexp_u^-1)^T is dexp_{-u}^-1 of the pair (liegrad/geometry.h). */
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

typedef struct motion {
    const lg_machine_vars *vars;
    const lg_taped_span *over;
    lg_var *parts;
    size_t count; /* of parts */
    /* For the kick: forces that do not depend on velocities, (B, velocities), or LG_NONE; inputs. */
    lg_var still, u;
} motion;

const char *lg_machine_variational_fault(const lg_machine *machine) {
    if (machine->bristles > 0)
        return "variational has no LuGre friction: take cf4, rkmk4 or another explicit Lie group scheme";
    if (lg_machine_mass_moves(machine))
        return "variational is for masses that do not depend on the state (known, diagonal, constant); take "
               "cf4, rkmk4 or another explicit Lie group scheme";
    if (lg_machine_tied(machine) || (machine->grey.system != NULL && machine->directions > 1))
        return "variational is for directions that each have a mass of their own; here a mass matrix couples "
               "them: take cf4, rkmk4 or another explicit Lie group scheme";
    return NULL;
}

/* c h x */
static lg_var paced(lg_tape *tape, const motion *s, double c, lg_var x) {
    return lg_taped_by_rows(tape, s->over, lg_scale(tape, x, c * s->over->h));
}

/* ---- kick ---- */

/* Whether any force depends on velocities. */
static bool drags(const lg_machine *machine) {
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        if (term->part == LG_MACHINE_DAMPING) return true;
        for (uint32_t k = 0; k < term->of_count; k++)
            if (term->of[k].kind == LG_FEATURE_VELOCITY) return true;
    }
    return false;
}

/* The sum of forces `sum` (LG_NONE: 0) and the forces of one part of the machine at velocities v. */
static lg_var plus(lg_tape *tape, const motion *s, lg_var sum, lg_machine_part part, lg_var v) {
    if (part == LG_MACHINE_INPUT_MAP && lg_is_none(s->u)) return sum;
    const lg_var more = lg_machine_record_force(tape, s->vars, part, s->parts, v, s->u);
    return lg_add_or(tape, sum, more);
}

/* All forces of the kick at velocities v, (B, velocities), or LG_NONE. */
static lg_var forces(lg_tape *tape, const motion *s, lg_var v) {
    return plus(tape, s, plus(tape, s, s->still, LG_MACHINE_DAMPING, v), LG_MACHINE_RESIDUAL, v);
}

/* Equation of the midpoint velocity: r = v - v(p + h/4 f(v)). */
static lg_status middle(void *user, lg_tape *tape, lg_var v, lg_var *r) {
    const motion *s = user;
    lg_var pushed[LG_TAPED_MAX_PARTS];
    memcpy(pushed, s->parts, s->count * sizeof *pushed);
    lg_machine_push(tape, s->vars->machine, paced(tape, s, 0.25, forces(tape, s, v)), pushed);
    *r = lg_sub(tape, v, lg_machine_record_rates(tape, s->vars, pushed));
    return lg_tape_status(tape);
}

static lg_status kick(lg_tape *tape, motion *s, lg_var u) {
    lg_var v = lg_machine_record_rates(tape, s->vars, s->parts);
    s->u = u;
    s->still = plus(tape, s, lg_machine_record_pull(tape, s->vars, s->parts), LG_MACHINE_INPUT_MAP, v);
    s->still = plus(tape, s, s->still, LG_MACHINE_OFFSET, v);
    if (drags(s->vars->machine))
        LG_TRY(lg_taped_root(tape, &(lg_root){.equations = middle, .user = s, .scale = 1.0}, v, &v));
    const lg_var f = forces(tape, s, v);
    if (!lg_is_none(f)) lg_machine_push(tape, s->vars->machine, paced(tape, s, 0.5, f), s->parts);
    return lg_tape_status(tape);
}

/* ---- drift ---- */

/* -h x for the three columns of v (B, momenta) from `first` on. */
static lg_var back(lg_tape *tape, const motion *s, lg_var v, uint32_t first) {
    return paced(tape, s, -1.0, lg_machine_columns(tape, v, first, 3));
}

/* A map of the momenta of bodies: of one vector, and the second half of a pair. */
typedef struct momentum_map {
    lg_var (*vector)(lg_tape *tape, lg_var turn, lg_var x);
    lg_var (*pair)(lg_tape *tape, lg_var turn, lg_var shift, lg_var l, lg_var m);
} momentum_map;
/* (dexp_{h v}^-1)^T and Ad_{exp(h v)}^T, with turn = -h Omega and shift = -h w. */
static const momentum_map at_start = {lg_so3_dexpinv_rows, lg_se3_dexpinv_rows},
                          carried = {lg_so3_exp_rows, lg_se3_act_rows};

/* Maps the momenta p (B, momenta) of bodies, and leaves the momenta of lines and angles unchanged. */
static lg_var each_momentum(lg_tape *tape, const motion *s, lg_var v, lg_var p, const momentum_map *map) {
    const lg_machine *machine = s->vars->machine;
    lg_var each[2 * LG_MACHINE_COORDINATES];
    uint32_t count = 0;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        const uint32_t first = at.momentum, second = first + at.places;
        if (at.directions > 0) continue;
        if (at.rotations == 0) {
            each[count++] = lg_machine_columns(tape, p, first, 1);
            continue;
        }
        const lg_var turn = back(tape, s, v, second), m = lg_machine_columns(tape, p, second, 3);
        if (at.places == 0) {
            each[count++] = map->vector(tape, turn, m);
            continue;
        }
        const lg_var shift = back(tape, s, v, first), l = lg_machine_columns(tape, p, first, 3);
        each[count++] = map->vector(tape, turn, l);
        each[count++] = map->pair(tape, turn, shift, l, m);
    }
    return lg_joined(tape, each, count);
}

static lg_status legendre(void *user, lg_tape *tape, lg_var v, lg_var *r) {
    const motion *s = user;
    const lg_var p = s->parts[lg_machine_parts(s->vars->machine).m];
    const lg_var mv = lg_matmul(tape, v, s->vars->mass);
    *r = lg_sub(tape, each_momentum(tape, s, v, mv, &at_start), p);
    return lg_tape_status(tape);
}

/* x + R dexp_{h Omega}(h w). */
static lg_var shifted(lg_tape *tape, lg_var turn, lg_var shift, lg_var x, lg_var R) {
    const uint32_t rows = lg_rows_of(tape, x);
    const lg_var way = lg_neg(tape, lg_so3_dexp_rows(tape, lg_neg(tape, turn), shift));
    const lg_var column = lg_reshape(tape, way, lg_shape3(rows, 3, 1));
    return lg_add(tape, x, lg_reshape(tape, lg_matmul(tape, R, column), lg_shape2(rows, 3)));
}

/* R after the step. The rows of R turn like vectors: r_i' = r_i x Omega. */
static lg_var turned(lg_tape *tape, lg_var turn, lg_var R) {
    const lg_shape shape = lg_var_shape(tape, R);
    const lg_var each = lg_reshape(tape, turn, lg_shape3(shape.dims[0], 1, 3));
    return lg_so3_exp_rows(tape, lg_broadcast_to(tape, each, shape), R);
}

/* Moves places and rotations, of which there is one at least, by the step h v; v is (B, momenta). */
static void move_positions(lg_tape *tape, const motion *s, lg_var v) {
    const lg_machine *machine = s->vars->machine;
    const lg_machine_places at = lg_machine_parts(machine);
    const uint32_t rows = lg_rows_of(tape, v);
    lg_var x[LG_MACHINE_COORDINATES], R[LG_MACHINE_COORDINATES];
    uint32_t xs = 0, Rs = 0;
    for (lg_machine_offsets offset = {0}; lg_machine_next(machine, &offset);) {
        if (offset.directions > 0) continue;
        const lg_var place = offset.places > 0
                                 ? lg_machine_columns(tape, s->parts[at.x], offset.place, offset.places)
                                 : LG_NONE;
        if (offset.rotations == 0) {
            const lg_var way = paced(tape, s, 1.0, lg_machine_columns(tape, v, offset.momentum, 1));
            x[xs++] = lg_add(tape, place, way);
            continue;
        }
        const lg_var old =
            lg_reshape(tape, lg_slice(tape, s->parts[at.R], 1, offset.rotation, 1), lg_shape3(rows, 3, 3));
        const lg_var turn = back(tape, s, v, offset.momentum + offset.places);
        if (offset.places > 0) x[xs++] = shifted(tape, turn, back(tape, s, v, offset.momentum), place, old);
        R[Rs++] = lg_reshape(tape, turned(tape, turn, old), lg_shape3(rows, 1, 9));
    }
    if (xs > 0) s->parts[at.x] = lg_joined(tape, x, xs);
    s->parts[at.R] = lg_joined(tape, R, Rs);
}

static lg_status move_bodies(lg_tape *tape, motion *s) {
    const lg_machine *machine = s->vars->machine;
    const lg_machine_places at = lg_machine_parts(machine);
    const lg_var p = s->parts[at.m];
    lg_var v = lg_matmul(tape, p, s->vars->inverse);
    if (at.R < 0) { /* only lines and angles: p = M v */
        s->parts[at.x] = lg_add(tape, s->parts[at.x], paced(tape, s, 1.0, v));
        return lg_tape_status(tape);
    }
    LG_TRY(lg_taped_root(tape, &(lg_root){.equations = legendre, .user = s, .scale = 1.0}, v, &v));
    move_positions(tape, s, v);
    s->parts[at.m] = each_momentum(tape, s, v, p, &carried);
    return lg_tape_status(tape);
}

/* Directions move on great circles: q and p turn by h omega with omega = q x p/M. */
static void move_directions(lg_tape *tape, const motion *s) {
    const lg_machine_places at = lg_machine_parts(s->vars->machine);
    const lg_var q = s->parts[at.q], p = s->parts[at.p];
    const lg_var omega = lg_div(tape, lg_cross(tape, q, p), s->vars->direction_mass);
    const lg_var turn = paced(tape, s, 1.0, omega);
    s->parts[at.q] = lg_so3_exp_rows(tape, turn, q);
    s->parts[at.p] = lg_so3_exp_rows(tape, turn, p);
}

lg_status lg_machine_variational_step(lg_tape *tape, const lg_machine_flow *flow, const lg_taped_span *over,
                                      const lg_var u[2], lg_var *parts) {
    const lg_machine_places at = lg_machine_parts(flow->vars->machine);
    lg_machine_vars soft = *flow->vars;
    soft.soft = true;
    motion s = {.vars = &soft, .over = over, .parts = parts, .count = lg_taped_parts(&flow->space)};
    LG_TRY(kick(tape, &s, u[0]));
    if (at.m >= 0) LG_TRY(move_bodies(tape, &s));
    if (at.q >= 0) move_directions(tape, &s);
    return kick(tape, &s, u[1]);
}
