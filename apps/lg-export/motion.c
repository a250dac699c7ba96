/* Faces of models that move: field and step, the state from positions and velocities of a log, and the
 * linearisation. They use functions of the model's program; code/hamiltonian and code/machine hold the code
 * around these functions. */

#include <math.h>
#include <string.h>

#include "lg-export/faces.h"

/* ---- scheme and space of a step ---- */

static const char *scheme_name(const lg_scheme *scheme) {
    return scheme->name != NULL ? scheme->name : "a scheme without a name";
}

void export_check_scheme(const app *self, const lg_space *space, bool separable, const lg_scheme *scheme) {
    lg_error error = {LG_OK, ""};
    if (lg_scheme_check(scheme, &error) != LG_OK) app_stop_usage(self, "%s", error.message);
    const bool flat = lg_space_is_abelian(space);
    const bool lie = scheme->kind == LG_SCHEME_RKMK || scheme->kind == LG_SCHEME_COMMUTATOR_FREE;
    if ((lie && (flat || !scheme->ambient)) || (scheme->kind == LG_SCHEME_SPLITTING && separable)) return;
    app_stop_usage(
        self,
        flat ? "%s is not explicit; possible are rk4, cf4 and other explicit schemes or files of the kinds "
               "runge-kutta, rkmk and commutator-free%s"
             : "%s is not an explicit Lie group scheme, which a step of this model needs; possible are cf4, "
               "rkmk4, lie-euler and other explicit schemes or files of the kinds rkmk and commutator-free%s",
        scheme_name(scheme), separable ? ", or stormer-verlet and other splittings" : "");
}

/* Adds {numbers per copy, copies} of a factor; SE(3) is written as a rotation and three numbers. */
static void add_factor(export_source *source, const lg_space_factor *factor) {
    const size_t numbers = lg_space_kind_entry(factor->kind)->state;
    if (factor->kind == LG_SPACE_TS2 || factor->kind == LG_SPACE_SO3)
        lg_text_add(&source->code, "{%zu, %zu}, ", numbers, factor->count);
    else if (factor->kind != LG_SPACE_SE3)
        lg_text_add(&source->code, "{1, %zu}, ", numbers * factor->count);
    for (size_t i = 0; factor->kind == LG_SPACE_SE3 && i < factor->count; i++)
        lg_text_add(&source->code, "{9, 1}, {1, 3}, ");
}

/* Adds `arrive`, the code that ends a step; on a manifold it corrects the rounding errors that leave the
 * manifold. `factors`: other code needs the table of factors even if `arrive` does not. */
static void add_arrival(export_source *source, const lg_space *space, bool factors) {
    bool flat = true;
    for (size_t f = 0; f < space->factors; f++)
        flat = flat && lg_space_kind_entry(space->factor[f].kind)->lift == NULL;
    if (!flat || factors) {
        lg_text_add(&source->code, "/* Numbers of a copy, and copies, of each factor of the state. */\n"
                                   "static const int factors[][2] = {");
        for (size_t f = 0; f < space->factors; f++) add_factor(source, &space->factor[f]);
        lg_text_add(&source->code, "};\nenum { FACTORS = sizeof factors / sizeof *factors, DIRECTION = 6, "
                                   "ROTATION = 9 };\n");
    }
    if (!flat)
        export_real(source, &source->code, "manifold_rounding",
                    source->options->dtype == LG_F32 ? 5e-5 : 1e-13);
    export_code(source, flat ? "arrive" : "arrive_manifold");
}

/* ---- field and step ---- */

static const char energy_declaration[] =
    "/* H(state) = NAME_eval */\n"
    "NAME_real NAME_hamiltonian(const NAME_real *state, NAME_real *work);\n\n";
/* Returns whether the program's `step` takes the state, the input of the field if there is one, and h, and
 * returns a state. */
static bool moves(const export_model *m) {
    const export_ports p = export_ports_of(m->program, "step");
    const size_t inputs = m->forces > 0;
    return m->space != NULL && p.ins == 2 + inputs && p.outs == 1 &&
           lg_shape_count(p.in[0].shape) == m->dim && lg_shape_count(p.in[1 + inputs].shape) == 1 &&
           lg_shape_count(p.out[0].shape) == m->dim && export_numbers(p.in + 1, inputs) == m->forces;
}

/* Evaluations of the field (or of the force, with splitting schemes) per step. */
static size_t evaluations_of(const export_model *m) {
    static const char *const callees[] = {"field", "force"};
    size_t step, callee, count = 0;
    if (lg_program_find(m->program, "step", &step, NULL) != LG_OK) return 0;
    for (size_t i = 0; i < LG_COUNT(callees); i++)
        if (lg_program_find(m->program, callees[i], &callee, NULL) == LG_OK)
            count += lg_program_calls(m->program, step, callee);
    return count;
}

static void motion_code(export_model *m) {
    export_source *source = m->source;
    const char *name = source->options->name;
    const bool energy = export_has(m, &export_face_value) && source->outputs == 1;
    lg_text_add(&source->code, "\n");
    export_constant(source, "STATE", m->dim);
    export_constant(source, "INPUT", m->forces);
    /* Functions of models without an input have no such argument. */
    lg_text_add(&source->code, m->forces > 0 ? "static const real no_input[INPUT] = {REAL(0.0)};\n"
                                               "#define GIVEN (input != NULL ? input : no_input),\n"
                                               "#define INTO(ju) ju,\n"
                                             : "#define GIVEN\n#define INTO(ju)\n");
    add_arrival(source, m->space, export_has(m, &export_face_linearise));
    if (energy) export_code(source, "hamiltonian");
    export_code(source, "motion");
    source->work += m->dim;
    export_size(source, "STATE_SIZE", m->dim, "numbers in state and next");
    export_size(source, "FIELD_SIZE", m->algebra, "numbers in field");
    export_size(source, "INPUT_SIZE", m->forces, "numbers in an input");
    export_size(source, "STEP_EVALUATIONS", evaluations_of(m),
                "of the field, or of the force, in a step; 0: not counted");
    if (energy) lg_text_add_named(&source->declarations, name, energy_declaration);
    lg_text_add_named(&source->declarations, name, export_fragment_text("motion.cin"));
}

static void states_code(export_model *m) {
    export_size(m->source, "POSITIONS", m->positions, "in the order of the log");
    export_size(m->source, "VELOCITIES", m->velocities, "likewise");
}

/* ---- the linearisation ---- */

static void linearise_code(export_model *m) {
    export_source *source = m->source;
    const size_t work = export_work_of(m, "jac_velocity") + m->dim * (m->dim + m->forces + 1) + m->tangent;
    export_constant(source, "TANGENT", m->tangent);
    export_code(source, "tangent");
    export_code(source, "linearise");
    if (work > source->work) source->work = work;
    export_size(source, "TANGENT", m->tangent, "coordinates of the linearisation");
    lg_text_add_named(&source->declarations, source->options->name, export_fragment_text("linearise.cin"));
}

/* ---- golden vectors ---- */

/* The step size of the golden steps: the training data's dt, halved until no golden state moves by more than
 * its own length. A model that is too fast for dt would otherwise be compared where a step multiplies
 * rounding errors. */
static double golden_step(const export_model *m, const double *field) {
    const export_golden *golden = &m->source->golden;
    const double dt = m->source->step;
    double h = dt > 0.0 && dt <= 1.0 ? dt : 0.01;
    for (int halved = 0; halved < 60; halved++) {
        bool fits = true;
        for (size_t i = 0; i < golden->count; i++)
            fits = fits && h * export_norm(field + i * m->algebra, NULL, m->algebra) <=
                               export_norm(golden->x + m->dim * i, NULL, m->dim);
        if (fits) break;
        h *= 0.5;
    }
    return export_round(m->source->options, h);
}

/* Evaluates a function of the program at the golden states, input and step size, or at `from`. The results of
 * a vector lie `stride` numbers behind those of the one before. */
static lg_status evaluate(const export_model *m, const char *function, const double *from, double *out,
                          size_t stride) {
    const size_t d = m->dim;
    export_evaluation e;
    APP_FREE double *row = app_alloc(d + m->forces + 1, sizeof *row);
    LG_TRY(export_evaluation_open(m->program, function, LG_F64, 0, &e, NULL));
    memcpy(row + d, m->input, m->forces * sizeof *row);
    row[d + m->forces] = m->h;
    for (size_t i = 0; i < m->source->golden.count; i++) {
        memcpy(row, m->source->golden.x + i * d, d * sizeof *row);
        export_evaluate(&e, from != NULL ? from + i * export_numbers(e.in, e.ins) : row, out + i * stride);
    }
    export_evaluation_close(&e);
    return LG_OK;
}

static lg_status motion_golden(export_model *m) {
    export_source *source = m->source;
    double *field = export_golden_further(source, m->algebra, NULL),
           *next = export_golden_further(source, m->dim, "field and step");
    for (size_t k = 0; k < m->forces; k++)
        m->input[k] = export_round(source->options, m->kind->draw_input != NULL
                                                        ? m->kind->draw_input(m, k)
                                                        : lg_rng_uniform_in(&m->rng, -1.0, 1.0));
    LG_TRY(evaluate(m, "field", NULL, field, m->algebra));
    m->h = golden_step(m, field);
    for (int halved = 0; halved < 10; halved++, m->h *= 0.5) { /* variational steps may be too long */
        LG_TRY(evaluate(m, "step", NULL, next, m->dim));
        if (isfinite(export_squares(source->options, next, source->golden.count * m->dim))) break;
    }
    export_real(source, &source->test, "golden_step", m->h);
    export_reals(source, &source->test, "golden_input", m->input, m->forces > 0 ? m->forces : 1);
    export_test_code(source, "test_motion");
    return LG_OK;
}

static lg_status states_golden(export_model *m) {
    const size_t both = m->positions + m->velocities;
    double *seen = export_golden_further(m->source, both, NULL),
           *state = export_golden_further(m->source, m->dim, "field, step, states");
    LG_TRY(evaluate(m, "positions", NULL, seen, both));
    LG_TRY(evaluate(m, "velocities", NULL, seen + m->positions, both));
    return evaluate(m, "momenta", seen, state, m->dim);
}

static lg_status linearise_golden(export_model *m) {
    const size_t square = m->tangent * m->tangent, size = square + m->tangent * m->forces;
    double *A = export_golden_further(m->source, size, NULL);
    for (size_t i = 0; i < m->source->golden.count; i++, A += size)
        LG_TRY(lg_model_linearise(m->file->model, m->source->golden.x + i * m->dim, m->input, A, A + square,
                                  NULL, m->work));
    return LG_OK;
}

/* ---- rows of the faces ---- */

static bool has_states(const export_model *m) {
    return export_has(m, &export_face_motion) && m->positions > 0;
}

static bool wants_linearise(const export_model *m) {
    return export_has(m, &export_face_motion) && m->source->options->functions != NULL;
}

const export_face export_face_motion = {.functions = {{"field", "flow", true}, {"step", "advance", true}},
                                        .fits = moves,
                                        .code = motion_code,
                                        .golden = motion_golden,
                                        .stack = 1024,
                                        .calls = 3};

const export_face export_face_states = {.functions = {{"momenta", "state", false},
                                                      {"velocities", "velocities", false},
                                                      {"positions", "positions", false}},
                                        .fits = has_states,
                                        .code = states_code,
                                        .golden = states_golden,
                                        .calls = 1};

const export_face export_face_linearise = {.functions = {{"jac_velocity", "linear", true}},
                                           .fits = wants_linearise,
                                           .code = linearise_code,
                                           .golden = linearise_golden,
                                           .stack = 1024};

/* ---- lines about the model ---- */

void export_tell_numbers(text *about, const char *what, size_t count, const char *words) {
    char label[32];
    (void)snprintf(label, sizeof label, "%s (%zu)", what, count);
    lg_text_add(about, "%-12s  %s\n", label, words != NULL ? words : "");
}

/* Describes the scheme, the evaluations per step, and the condition. */
void export_tell_motion(const export_model *m) {
    const lg_scheme *scheme = m->source->options->scheme;
    const size_t evaluations = evaluations_of(m);
    text *about = &m->source->about;
    if (scheme == NULL)
        lg_text_add(about, "step          as the file holds it\n");
    else if (evaluations == 0)
        lg_text_add(about, "step          %s, order %d\n", scheme_name(scheme), scheme->order);
    else
        lg_text_add(about, "step          %s, order %d: %zu evaluation%s of the %s\n", scheme_name(scheme),
                    scheme->order, evaluations, evaluations == 1 ? "" : "s",
                    scheme->kind == LG_SCHEME_SPLITTING ? "force" : "field");
    if (m->source->condition > 1.0)
        lg_text_add(about,
                    "condition     %.1f: by how much the model multiplies rounding, and the tolerance\n",
                    m->source->condition);
}
