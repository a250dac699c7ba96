/* A recipe as a user outside the project would write it, in one file. It learns a Hamiltonian on R x S^1 with
 * a network V,
 *   H = (p_x^2 + p_a^2)/2 + V(x, cos a, sin a),
 * from a table of pairs: a state (x, a, p_x, p_a) and the state `h` seconds later. */
#include <math.h>
#include <string.h>

#include "liegrad/ops.h"
#include "liegrad/table.h"
#include "liegrad/taped.h"
#include "model/files/training.h"
#include "settings/training.h"

#ifdef ROTOR_planted /* planted error: the force has the wrong sign */
#define FORCE_SIGN 1.0
#else
#define FORCE_SIGN -1.0
#endif
enum { D = 4, PAIR = 2 * D };

/* ---- the run, the file, the options ---- */

typedef struct lg_rotor_run {
    lg_fit_settings training;
    lg_wholes hidden;
    double h;
    char data_sha256[LG_SHA256_TEXT];
} lg_rotor_run;

typedef struct lg_rotor_file {
    LG_MODEL_FILE(lg_rotor_run);
} lg_rotor_file;

static const lg_field facts[] = {LG_FACT(lg_rotor_run, "run", "data_sha256", TEXT, data_sha256, .low = 0),
                                 LG_FIELD_END};
static const lg_field lg_rotor_fields[] = {
    LG_FIELD(lg_rotor_run, "model", "hidden", WHOLES, hidden, .low = 1, .high = 1024, .most = 8,
             .value = "16", .unit = "W,...", .meaning = "Widths of the hidden layers"),
    LG_FIELD(lg_rotor_run, "model", "h", REAL, h, .high = 1e3, .above = true, .value = "0.1", .unit = "S",
             .meaning = "Seconds between the states of a pair, and the step of rk4"),
    TRAINING_ROWS(lg_rotor_run, "method", squares, "Pairs", 0, CONSTANT, CONSTANT),
    VALIDATION(lg_rotor_run, .value = "0"), LG_FIELD_END};
static const lg_rotor_run defaults;

static lg_status net_of(const lg_rotor_run *run, lg_mlp *net) {
    return lg_mlp_init(net, 3, run->hidden.values, (uint32_t)run->hidden.count, 1, LG_TANH, true);
}

/* ---- the mathematics ---- */

static lg_var energy(lg_tape *t, const lg_mlp *net, lg_var theta, lg_var x) {
    const lg_var a = lg_slice(t, x, 1, 1, 1), p = lg_slice(t, x, 1, 2, 2);
    const lg_var seen[] = {lg_slice(t, x, 1, 0, 1), lg_cos(t, a), lg_sin(t, a)};
    const lg_var kinetic = lg_scale(t, lg_rownorm2(t, p), 0.5);
    return lg_add(t, kinetic, lg_mlp_record(t, net, theta, 0, lg_concat(t, seen, 3, 1)));
}

typedef struct motion {
    lg_mlp net;
    lg_var theta;
} motion;

/* (q, p)' = (dH/dp, -dH/dq) */
static lg_status field_of(void *user, lg_tape *t, lg_taped_time time, const lg_var *x, lg_var input,
                          lg_var *out) {
    const motion *m = user;
    lg_var g;
    (void)time, (void)input;
    LG_TRY(lg_grad(t, lg_sum(t, energy(t, &m->net, m->theta, *x)), x, 1, &g));
    const lg_var halves[] = {lg_slice(t, g, 1, 2, 2), lg_scale(t, lg_slice(t, g, 1, 0, 2), FORCE_SIGN)};
    *out = lg_concat(t, halves, 2, 1);
    return lg_tape_status(t);
}

static lg_status value(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = energy(t, user, theta[0], x[0]);
    return lg_tape_status(t);
}

static lg_status gradient(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    LG_TRY(value(user, t, theta, x, y));
    return lg_grad(t, lg_sum(t, y[0]), x, 1, &y[1]);
}

static lg_status field(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    motion m = {*(const lg_mlp *)user, theta[0]};
    return field_of(&m, t, (lg_taped_time){0}, x, LG_NONE, y);
}

static lg_status program(const lg_context *context, const void *file, const lg_scheme *scheme,
                         lg_program **out, lg_error *error) {
    lg_mlp net;
    LG_TRY(net_of(&((const lg_rotor_file *)file)->run, &net));
    const lg_port x = {.name = "x", .shape = lg_shape1(D)}, y[] = {{.name = "y"}, {.name = "g"}},
                  f = {.name = "f"};
    const lg_function_spec functions[] = {{"value", &x, 1, y, 1, value, &net},
                                          {"grad", &x, 1, y, 2, gradient, &net},
                                          {"field", &x, 1, &f, 1, field, &net}};
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&net)),
                                       ((const lg_rotor_file *)file)->theta};
    lg_program_spec spec;
    (void)scheme;
    lg_program_spec_init(&spec);
    spec.parameters = &weights, spec.parameter_count = 1;
    spec.functions = functions, spec.function_count = LG_COUNT(functions);
    return lg_program_build(context, &spec, out, error);
}

/* ---- files ---- */

static lg_status make(void *run, lg_error *why) {
    lg_mlp net;
    const lg_status status = net_of(run, &net);
    return status == LG_OK ? LG_OK : lg_fail(why, status, "hidden is out of range");
}
static size_t parameters(const void *run) {
    lg_mlp net;
    return net_of(run, &net) == LG_OK ? lg_mlp_parameters(&net) : 0;
}
static bool slice(const void *run, uint32_t index, lg_slice_info *out) {
    *out = (lg_slice_info){.name = "weights", .rank = 1, .dims = {parameters(run)}, .count = parameters(run)};
    return index == 0;
}
static lg_status space(const void *run, lg_space *out) {
    (void)run;
    return lg_space_init_rn(out, D);
}

/* ---- learning ---- */

typedef struct state {
    lg_table_data pairs;
    motion motion;
    double h;
} state;

static lg_status read_pairs(lg_training *self, lg_error *error) {
    static const char *const names[PAIR] = {"x", "a", "px", "pa", "x2", "a2", "px2", "pa2"};
    state *s = self->state;
    LG_TRY(lg_table_read(self->context, self->paths[0], names, PAIR, NULL, NULL, &s->pairs, error));
    memcpy(self->sha256, s->pairs.sha256, sizeof self->sha256);
    return LG_OK;
}
static void close_pairs(lg_training *self) {
    lg_table_data_destroy(&((state *)self->state)->pairs);
}
static lg_status describe(lg_training *self, lg_error *error) {
    lg_rotor_run *run = self->run;
    state *s = self->state;
    memcpy(run->data_sha256, s->pairs.sha256, sizeof run->data_sha256);
    s->h = run->h;
    return net_of(run, &s->motion.net) == LG_OK ? LG_OK
                                                : lg_fail(error, LG_INVALID_ARGUMENT, "--hidden: no network");
}

/* The errors of one step (count, D), divided such that the sum of their squares is a mean over the batch. */
static lg_status residuals_of(void *user, lg_tape *t, lg_var theta, const uint32_t *samples, size_t count,
                              size_t batch, lg_var *r) {
    const state *s = user;
    motion m = {s->motion.net, theta};
    lg_taped_ode ode = {.field = field_of, .user = &m};
    LG_TRY(lg_space_init_rn(&ode.space, D));
    const lg_var all = lg_input_f64(t, lg_shape2((uint32_t)s->pairs.rows, PAIR), s->pairs.values);
    const lg_var pairs = lg_gather(t, all, samples, (uint32_t)count);
    lg_var now = lg_slice(t, pairs, 1, 0, D), next;
    LG_TRY(lg_taped_step(t, lg_scheme_find("rk4"), &ode, &(lg_taped_interval){.h = s->h}, &now, &next));
    *r = lg_scale(t, lg_sub(t, next, lg_slice(t, pairs, 1, D, D)), 1.0 / sqrt((double)batch * D));
    return lg_tape_status(t);
}

static lg_status loss_of(void *user, lg_tape *t, lg_var theta, const uint32_t *samples, size_t count,
                         size_t batch, lg_var *loss) {
    lg_var r;
    LG_TRY(residuals_of(user, t, theta, samples, count, batch, &r));
    *loss = lg_sum(t, lg_square(t, r));
    return lg_tape_status(t);
}

static lg_status make_problem(lg_training *self, lg_error *error) {
    state *s = self->state;
    lg_rng rng;
    self->problem = (lg_fit_problem){.parameters = parameters(self->run),
                                     .samples = s->pairs.rows,
                                     .loss = loss_of,
                                     .residuals = residuals_of,         /* for lm */
                                     .observations = s->pairs.rows * D, /* for --prior */
                                     .user = s};
    LG_TRAINING_ARRAY(self, self->theta, self->problem.parameters, error);
    lg_rng_seed(&rng, lg_training_settings(self)->seed, 1);
    lg_mlp_initialise(&s->motion.net, &rng, self->theta);
    return LG_OK;
}

/* Computes the loss over all pairs, and the loss of predicting that the state does not change. */
static lg_status judge(lg_training *self, double *theta, lg_error *error) {
    state *s = self->state;
    const size_t rows = s->pairs.rows;
    double loss = 0, unchanged = 0;
    LG_TRY(lg_fit_problem_loss(self->context, &self->problem, theta, &loss, error));
    for (size_t i = 0; i < rows * D; i++) {
        const double *row = s->pairs.values + i / D * PAIR + i % D;
        unchanged += (row[D] - row[0]) * (row[D] - row[0]) / (double)(rows * D);
    }
    LG_TELL(self, LG_REAL("loss", loss, "mean square of one step's error"),
            LG_WHOLE("parameters", parameters(self->run), NULL));
    self->first_count = self->result_count;
    self->verdict =
        (lg_training_verdict){"mean squared error", "a state that does not change", loss, unchanged, false};
    return LG_OK;
}

static const char *const sizes[] = {"8", "16", "32", NULL};
static const lg_trainer trainer = {.data = "PAIRS.csv",
                                   .state_size = sizeof(state),
                                   .held_out = "validation-fraction",
                                   .sizes = sizes,
                                   .read = read_pairs,
                                   .describe = describe,
                                   .problem = make_problem,
                                   .judge = judge,
                                   .close = close_pairs};

extern const lg_recipe lg_recipe_rotor;
const lg_recipe lg_recipe_rotor = {LG_RECIPE_LAYOUT(rotor),
                                   .checkpoint = "rotor-checkpoint",
                                   .facts = facts,
                                   .defaults = &defaults,
                                   .make = make,
                                   .slice = slice,
                                   .program = program,
                                   .space = space,
                                   .trainer = &trainer};
