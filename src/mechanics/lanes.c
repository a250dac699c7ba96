/* The fields of the systems on lanes, and the integration loops that use them. This file is compiled once for
 * each instruction set, with LG_KERNEL_ISA = baseline, avx2, avx512 or neon, and LG_KERNEL_ISA_<set> defined.
 * The only external symbol is the table lg_lanes_<set>. */
#define LG_KERNEL_f64
#include <string.h>

#include "core/portions.h"
#include "integrators/event_search.h"
#include "integrators/groups.h"
#include "integrators/lanes.h"
#include "integrators/series.h"
#include "kernels/kernels.h"
#include "kernels/stumpff.h"

#include "kernels/common.inc"
#include "kernels/math.inc"

#include "kernels/lanes.inc"

#include "integrators/lanes.inc"

/* ---- the fields ---- */

typedef lanes number;

/* x in lanes where it is positive and finite, else NaN */
INLINE lanes field_positive(lanes x) {
    const lanes zero = {0};
    const lane_test sound = lane_lt(zero, x) & lane_le(x, lie_all(DBL_MAX));
    return lane_choose(sound, x, lie_all(NAN));
}

#include "mechanics/fields/chain_numbers.inc"
#include "mechanics/fields/vectors.inc"

#include "mechanics/fields/chain.inc"
#include "mechanics/fields/chain_hamiltonian.inc"
#include "mechanics/fields/chain_lagrangian.inc"

#define FIELD_ON_LANES
#define FIELD_NUMBER(x) lie_all(x)
#include "mechanics/fields/written.inc"

#define SEPARABLE(name, n)                                                                                   \
    INLINE void name##_lanes(const lane_problem *problem, const lanes *y, lanes *out) {                      \
        name##_velocity(y + (n), NULL, NULL, out, NULL);                                                     \
        name##_force(y, NULL, NULL, out + (n), NULL);                                                        \
    }
SEPARABLE(oscillator, 1)
SEPARABLE(quartic, 2)
SEPARABLE(coupled_oscillators, 2)

/* Rigid bodies, whose fields use no constants and no workspace, X(function, system, form, numbers of an
 * algebra element, kind of the first factor, loop): the ambient field is the generator of the LIE field, on
 * one copy of this kind followed by R^n. */
#define BODIES(X)                                                                                            \
    X(rigid_body, "rigid-body", NULL, 3, SO3_DUAL, rigid_body_ambient_lanes_loop)                            \
    X(rigid_body_attitude, "rigid-body-attitude", NULL, 6, SO3, NULL)                                        \
    X(heavy_top_cotangent, "heavy-top", "cotangent", 6, SE3, NULL)                                           \
    X(heavy_top_direct, "heavy-top", "direct", 6, SO3, NULL)                                                 \
    X(heavy_top_lie_poisson, "heavy-top", "lie-poisson", 6, SE3_DUAL, NULL)                                  \
    X(heavy_top_quadratic, "heavy-top", "quadratic", 12, SE3, NULL)
#define BODY(name, system, form, m, kind, loop)                                                              \
    INLINE void name##_lanes(const lane_problem *problem, const lanes *y, lanes *out) {                      \
        name##_field(y, problem->parameter, NULL, out, NULL);                                                \
    }                                                                                                        \
    INLINE void name##_ambient_lanes(const lane_problem *problem, const lanes *y, lanes *out) {              \
        lanes a[m];                                                                                          \
        name##_lanes(problem, y, a);                                                                         \
        lane_generate_copy(LG_SPACE_##kind, a, y, out);                                                      \
        const size_t own = lane_kinds[LG_SPACE_##kind].algebra, at = lane_kinds[LG_SPACE_##kind].state;      \
        memcpy(out + at, a + own, ((m)-own) * sizeof *a);                                                    \
    }
BODIES(BODY)

INLINE void write_lie(const lanes *y, const lanes *a, lanes *out) {
    const lanes along = field_dot(y, a);
    for (int c = 0; c < 3; c++) {
        out[c] = y[3 + c];
        out[3 + c] = y[c] * along - a[c];
    }
}

/* Fields of chains, of the chain's numbers. */
#define CHAIN(name, call)                                                                                    \
    INLINE void name##_lanes(const lane_problem *problem, const lanes *y, lanes *out) {                      \
        const lg_chain chain = chain_view(problem->links, problem->parameter, problem->constant);            \
        call;                                                                                                \
    }
CHAIN(pendulum_lie, pendulum_lie(&chain, y, out))
CHAIN(pendulum_ambient, pendulum_ambient(&chain, y, out))
CHAIN(lagrangian_lie, chain_field(&chain, y, problem->work, out, write_lie))
CHAIN(lagrangian_ambient, chain_field(&chain, y, problem->work, out, write_ambient))
CHAIN(hamiltonian_lie, hamiltonian_lie_of(&chain, y, problem->work, out))
CHAIN(hamiltonian_ambient, hamiltonian_ambient_of(&chain, y, problem->work, out))

/* ---- the loops ---- */

/* A loop for one field, which is inlined: for fields that cost no more than a function call. */
#define CLASSICAL_LOOP(name, dim)                                                                            \
    static void name##_loop(lane_run *r) {                                                                   \
        r->field = name;                                                                                     \
        lane_run_members(r, GROUPS, LANE_CLASSICAL, dim, name);                                              \
    }
CLASSICAL_LOOP(oscillator_lanes, 2)
CLASSICAL_LOOP(quartic_lanes, 4)
CLASSICAL_LOOP(coupled_oscillators_lanes, 4)
CLASSICAL_LOOP(pendulum_ambient_lanes, 6)
CLASSICAL_LOOP(rigid_body_ambient_lanes, 3)

static void classical_loop(lane_run *r) {
    lane_run_members(r, 1, LANE_CLASSICAL, r->dim, r->field);
}

static void rkmk_loop(lane_run *r) {
    lane_run_members(r, 1, LANE_RKMK, r->dim, r->field);
}

static void free_loop(lane_run *r) {
    lane_run_members(r, 1, LANE_FREE, r->dim, r->field);
}

typedef struct lane_entry {
    const char *name, *form;   /* of the system */
    size_t links;              /* 0: any number */
    lane_field field[2];       /* index: lg_coordinates */
    void (*loop)(lane_run *r); /* for classical schemes; NULL: classical_loop */
} lane_entry;

#define ENTRY(name, system, form, m, kind, loop)                                                             \
    {system, form, 0, {name##_lanes, name##_ambient_lanes}, loop},
static const lane_entry entries[] = {
    {"oscillator", NULL, 0, {oscillator_lanes, oscillator_lanes}, oscillator_lanes_loop},
    {"quartic", NULL, 0, {quartic_lanes, quartic_lanes}, quartic_lanes_loop},
    {"coupled-oscillators",
     NULL,
     0,
     {coupled_oscillators_lanes, coupled_oscillators_lanes},
     coupled_oscillators_lanes_loop},
    {"pendulum-chain",
     "lagrangian",
     1,
     {pendulum_lie_lanes, pendulum_ambient_lanes},
     pendulum_ambient_lanes_loop},
    {"pendulum-chain", "lagrangian", 0, {lagrangian_lie_lanes, lagrangian_ambient_lanes}, NULL},
    {"pendulum-chain", "hamiltonian", 0, {hamiltonian_lie_lanes, hamiltonian_ambient_lanes}, NULL},
    BODIES(ENTRY)};

static const lane_entry *entry_of(const lg_lane_plan *plan) {
    for (size_t i = 0; i < LG_COUNT(entries); i++)
        if (strcmp(entries[i].name, plan->name) == 0 &&
            (entries[i].form == NULL || strcmp(entries[i].form, plan->form) == 0) &&
            (entries[i].links == 0 || entries[i].links == plan->links))
            return &entries[i];
    return NULL;
}

static bool knows(const lg_lane_plan *plan) {
    return entry_of(plan) != NULL;
}

static size_t memory(const lg_lane_plan *plan, size_t room) {
    lane_run r[GROUPS];
    return lane_lay_out(r, plan, room, NULL);
}

static void run(const lg_lane_plan *plan, const lg_lane_block *block) {
    const lane_entry *entry = entry_of(plan);
    const bool flat = plan->ambient || lg_space_is_abelian(&plan->space);
    lane_run r[GROUPS] = {{.field = entry->field[plan->ambient]}};
    lane_prepare(r, plan, block);
    if (plan->run.scheme->kind == LG_SCHEME_COMMUTATOR_FREE)
        free_loop(r);
    else if (!flat)
        rkmk_loop(r);
    else if (entry->loop)
        entry->loop(r);
    else
        classical_loop(r);
}

#define PASTE_(a, b) a##b
#define PASTE(a, b)  PASTE_(a, b)
#define TABLE        PASTE(lg_lanes_, LG_KERNEL_ISA)

extern const lg_lane_table TABLE;
const lg_lane_table TABLE = {.lanes = LANES, .knows = knows, .memory = memory, .run = run};
