/* Internals of a system, and lg_system_row, the table row that describes one form of a system.
 *
 * A new system is a file with a row per form, which is also listed in LG_SYSTEM_ROWS (docs/adding.md). Its
 * parameters and the parts of its state are tables, which scenes, messages, layouts and gradients read.
 */
#ifndef LG_SYSTEM_H
#define LG_SYSTEM_H

#include "core/core.h"
#include "liegrad/mechanics.h"
#include "liegrad/taped.h"

/* How the field follows from the energy H, which is the first invariant. A test checks this for all rows. */
typedef enum lg_structure {
    LG_STRUCTURE_UNSTATED, /* allowed only for systems without an energy */
    /* y' = {y, H} with the Poisson bracket of the space:
     * - R^2n and T*S^2: canonical in (q, p);
     * - T*SO(3): (R, pi) with the spatial momentum pi, as SE(3) or SO(3) x R^3;
     * - so(3)*: the body momentum, mu' = mu x dH/dmu;
     * - se(3)*: (Gamma, Pi), Gamma' = Gamma x dH/dPi, Pi' = Pi x dH/dPi + Gamma x dH/dGamma. */
    LG_STRUCTURE_HAMILTONIAN,
    /* Euler-Lagrange equations of L = K - V, V(q) = H(q, 0), K = H - V; y is (q, q') on R^2n and (q, omega)
     * on TS^2. */
    LG_STRUCTURE_LAGRANGIAN,
    LG_STRUCTURE_OTHER /* the field conserves H; nothing more is known */
} lg_structure;

typedef struct lg_system_row {
    const char *name, *form;              /* form is NULL if the system has one form only */
    const lg_energy_row *energy;          /* of a derived row: M and V */
    const lg_parameter_entry *parameters; /* the list ends with a NULL key */
    const lg_state_entry *state;          /* the list ends with a NULL key */
    size_t unreported;                    /* numbers at the end of the state that are not reported */
    /* The factors of the space; the list ends with zeros. A count of 0 is one copy per link. */
    lg_space_factor factor[LG_SPACE_MAX_FACTORS + 1];
    uint32_t vectors; /* lg_space.vectors */
    /* Two counts, of which a system with links has as many per link: numbers that `prepare` derives from the
     * parameters, and doubles of workspace. */
    size_t constants, work;
    void (*prepare)(lg_system *system, double *constants);
    const char *const *invariants; /* names, ended by NULL; "energy" is first if the system has one */
    double (*invariant)(const lg_system *system, size_t index, const double *y, double *work);
    /* Number (with links: per link) and values of what lg_system_observe writes. 0 and NULL: the reported
     * part of the state. */
    size_t observed;
    lg_status (*observe)(const lg_system *system, const double *y, double *out, double *work);
    /* Draws a start of kind LG_STARTS_PLANE; NULL: not supported. */
    lg_status (*plane)(const lg_system *system, lg_rng *rng, double *y);
    lg_structure structure;
    /* The function H of y' = {y, H} (lg_structure), where it is not the energy; NULL: it is the energy. */
    double (*generating)(const lg_system *system, const double *y, double *work);
    /* Index: lg_coordinates; user: lg_system_user. If AMBIENT is NULL, the generator of LIE is used. */
    lg_vector_field field[2];
    /* Off the manifold field[AMBIENT] differs from the generator of field[LIE]; it has no taped form. */
    bool extended;
    /* Separable systems on R^2n have these instead of `field`: y' = (velocity(p), force(q)), y = (q, p). */
    lg_half_field force, velocity;
    lg_variational_step step; /* NULL: not available; its user is an lg_system_user */
    /* The LIE field on a tape, for batches as in liegrad/taped.h. `parameters` (P) holds all parameters in
     * the order of the table. Differentiable to any order in both, unless the row's file says otherwise. */
    lg_status (*taped)(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                       lg_var parameters, lg_var *algebra);
    /* The energy (B, 1) on a tape, if it is recorded. */
    lg_var (*taped_energy)(const lg_system *system, lg_tape *tape, const lg_var *y, lg_var parameters);
    /* Separable systems have these instead of `taped`: force(q) and velocity(p) on a tape, (B, n) each. */
    lg_var (*taped_force)(lg_tape *tape, lg_var q, lg_var parameters);
    lg_var (*taped_velocity)(lg_tape *tape, lg_var p, lg_var parameters);
} lg_system_row;

/* The arrays follow in the same block of memory. */
struct lg_system {
    const lg_context *context;
    const lg_system_row *row;
    size_t links; /* 0 if the system has no links */
    lg_space space;
    char *layout;
    size_t parameter_count;
    double *parameters; /* in the order of the table */
    double *constants;
    const struct lg_written *written; /* field and energy as C (recorded.c), or NULL: as plans */
    lg_plan *plan[2];
    size_t recorded_work; /* doubles that they need */
};

size_t lg_system_constants(const lg_system *system);
/* The doubles of workspace that the row needs. */
size_t lg_system_own_work(const lg_system *system);

/* ---- tables of parameters, which end with a NULL key ---- */

/* How many values the parameter has. */
size_t lg_parameter_numbers(const lg_parameter_entry *parameter, size_t links);
/* LG_INVALID_ARGUMENT if the table has no such key; the message names `system` and lists the keys. */
lg_status lg_parameter_find(const char *system, const lg_parameter_entry *table, const char *key,
                            const lg_parameter_entry **out, lg_error *error);
/* Checks the n values x against the rule of the parameter. */
lg_status lg_parameter_check(const lg_parameter_entry *p, const double *x, size_t n, lg_error *error);
/* Checks the values of all parameters of the system. */
LG_API lg_status lg_system_check_parameters(const lg_system *system, const double *values, lg_error *error);
/* Writes the label, such as "m2", of value `index`, where the values of all parameters are counted together.
 * Empty if index is too large. */
#define LG_PARAMETER_LABEL 32
void lg_parameter_label(const lg_parameter_entry *table, size_t links, size_t index, char *text);

/* The reason why the options are wrong, or NULL. */
const char *lg_trajectory_fault(const lg_trajectory_options *options);
/* Adds the noise of trajectory `number` to its points of d numbers. */
void lg_trajectory_disturb(const lg_trajectory_options *options, size_t d, size_t number, double *trajectory);

/* The rows, lg_system_row_NAME. The forms of a system are neighbours; the first one is its default. */
#define LG_SYSTEM_ROWS(X)                                                                                    \
    X(oscillator)                                                                                            \
    X(quartic)                                                                                               \
    X(coupled)                                                                                               \
    X(chain_lagrangian)                                                                                      \
    X(chain_hamiltonian)                                                                                     \
    X(rigid_body)                                                                                            \
    X(attitude)                                                                                              \
    X(top_cotangent)                                                                                         \
    X(top_direct)                                                                                            \
    X(top_lie_poisson)                                                                                       \
    X(top_quadratic)                                                                                         \
    X(satellite)                                                                                             \
    X(quadrotors)                                                                                            \
    X(quadrotor_bodies)
#define LG_DECLARE_ROW(name) extern const lg_system_row lg_system_row_##name;
LG_SYSTEM_ROWS(LG_DECLARE_ROW)

/* Systems that are given by their energies alone, lg_energy_NAME (derived.c): their rows and fields follow.
 * The state is R, pi of rotations, then q, p of directions, then x, px of lines and angles, as in the
 * families of learned Hamiltonians; of lines and angles alone q, p on R^2n. The coordinates of the energies
 * have this order, and M has a row for each velocity: three for a rotation and for a direction. */
#define LG_DERIVED_SYSTEMS(X) X(cart_pole) X(rotary) X(arm)
/* Their energies, after those of systems with a field of their own. */
#define LG_ENERGIES(X)                                                                                       \
    X(oscillator)                                                                                            \
    X(quartic)                                                                                               \
    X(coupled)                                                                                               \
    X(attitude)                                                                                              \
    X(top)                                                                                                   \
    X(chain)                                                                                                 \
    LG_DERIVED_SYSTEMS(X)
#define LG_DECLARE_ENERGY(name) extern const lg_energy_row lg_energy_##name;
LG_ENERGIES(LG_DECLARE_ENERGY)
const lg_system_row *lg_derived_row(size_t index); /* NULL beyond the last */

/* ---- fields from their recordings (recorded.c) ----
 *
 * Rows with LG_RECORDED write their field on a tape only. In double it is straight C that a test writes from
 * the recording (fields/written.inc), or a plan if that file does not have the system yet. */
lg_status lg_recorded_field(void *user, double t, const double *y, const double *input, double *out);
lg_status lg_recorded_velocity(void *user, double t, const double *p, const double *input, double *out);
lg_status lg_recorded_force(void *user, double t, const double *q, const double *input, double *out);
/* The energy: lg_system_row.invariant of rows that have taped_energy. It does not use `index`. */
double lg_recorded_energy(const lg_system *system, size_t index, const double *y, double *work);
/* The program with the functions field (y, parameters, t) and energy, where the row has it; of a separable
 * system velocity (p, parameters, t) and force (q, parameters, t). */
lg_status lg_recorded_program(const lg_system *system, lg_program **out, lg_error *error);
/* Make the code or the plans of a system whose row uses them. */
lg_status lg_recorded_create(lg_system *system);

#define LG_TAPED_FIELD(name)                                                                                 \
    static lg_status name(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,          \
                          lg_var input, lg_var numbers, lg_var *algebra)
#define LG_RECORDED(name) .field = {lg_recorded_field, NULL}, .taped = name

/* 1/2 x.I^-1 x, the energy of a body with the momentum x in its own frame. */
double lg_body_energy(const double *I, const double *x);

#endif
