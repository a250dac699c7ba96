/* Learned Hamiltonians as C: value, gradient, field and one step of a scheme. These are functions of the
 * model's program; code/hamiltonian has the code around them. */
#include "lg-export/export.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- kinetic energy ---- */

/* W = m^-1 by Cholesky's factor, NaN where m is not positive definite. */
static void invert(size_t k, const double *m, double *W) {
    double *l = app_alloc(k * k, sizeof *l);
    for (size_t j = 0; j < k; j++)
        for (size_t i = j; i < k; i++) {
            double sum = m[i * k + j];
            for (size_t p = 0; p < j; p++) sum -= l[i * k + p] * l[j * k + p];
            l[i * k + j] = i == j ? (sum > 0.0 ? sqrt(sum) : (double)NAN) : sum / l[j * k + j];
        }
    for (size_t c = 0; c < k; c++) {
        for (size_t i = 0; i < k; i++) {
            double sum = i == c ? 1.0 : 0.0;
            for (size_t p = 0; p < i; p++) sum -= l[i * k + p] * W[p * k + c];
            W[i * k + c] = sum / l[i * k + i];
        }
        for (size_t i = k; i-- > 0;) {
            for (size_t p = i + 1; p < k; p++) W[i * k + c] -= l[p * k + i] * W[p * k + c];
            W[i * k + c] /= l[i * k + i];
        }
    }
    free(l);
}

/* W = m^-1 (k, k). Returns max_i m_ii W_ii >= 1, which multiplies the rounding of what is solved with W: how
 * nearly the rows of m depend on each other, whatever their scale. */
static double invert_mass(const lg_hamiltonian *model, const double *theta, double *W) {
    const size_t k = model->n;
    double condition = 1.0, *m = app_alloc(k * k, sizeof *m);
    (void)lg_hamiltonian_mass(model, theta, m);
    invert(k, m, W);
    for (size_t i = 0; i < k; i++) condition = fmax(condition, m[i * k + i] * W[i * k + i]);
    free(m);
    return condition;
}

/* What the tolerance has room for without a condition. */
enum { LEAST_CONDITION = 20 };

/* The condition of a chain's mass matrix. False: its inverse has numbers that the type cannot hold. */
static bool chain_condition(export_source *source, const lg_hamiltonian *model, const double *theta) {
    const size_t k = model->n;
    double *W = app_alloc(k * k, sizeof *W);
    bool fits = true;
    source->condition = fmax(1.0, invert_mass(model, theta, W) / LEAST_CONDITION);
    for (size_t i = 0; i < k * k; i++) fits = fits && isfinite(export_round(source->options, W[i]));
    free(W);
    return fits;
}

/* ---- what NAME.h says ---- */

/* "state (6)     words" */
static void tell_numbers(text *about, const char *what, unsigned count, const char *words) {
    char label[32];
    (void)snprintf(label, sizeof label, "%s (%u)", what, count);
    lg_text_add(about, "%-12s  %s\n", label, words);
}

static void tell_chain(export_source *source, unsigned k) {
    text *about = &source->about;
    lg_text_add(about,
                "Learned Hamiltonian H(q, p) = 1/2 p.M(q)^-1 p + V(q) of a chain of %u link%s on T*S^2.\n\n",
                k, k == 1 ? "" : "s");
    tell_numbers(about, "state", 6 * k,
                 k == 1 ? "q p, three numbers each: |q| = 1, q.p = 0"
                        : "q_1 p_1 q_2 p_2 ..., three numbers each: |q_i| = 1, q_i.p_i = 0");
    tell_numbers(about, "input", 3 * k,
                 k == 1 ? "tau: spatial torque about the link's joint, conjugate to its angular\n"
                          "              velocity; NULL for none"
                        : "tau_1 tau_2 ...: spatial torques about the links' own joints, conjugate to\n"
                          "              their angular velocities; NULL for none");
    tell_numbers(about, "field", 6 * k,
                 k == 1 ? "xi eta in se(3): q' = xi x q, p' = xi x p + eta x q; xi is the angular velocity"
                        : "xi_1 eta_1 xi_2 eta_2 ... in se(3): q_i' = xi_i x q_i,\n"
                          "              p_i' = xi_i x p_i + eta_i x q_i; xi_i is the angular velocity");
    export_units(source, "those of the training data");
    lg_text_add(about,
                "time          as in the dt of the training data\nmanifold      A state off the manifold is "
                "not projected: value, gradient and field are those\n              of the formulas, and "
                "steps keep the distance up to rounding.\n");
}

static void tell_separable(export_source *source, unsigned n) {
    text *about = &source->about;
    lg_text_add(about, "Learned Hamiltonian H(q, p) = 1/2 |A p|^2 + V(q) on R^%u.\n\n", 2 * n);
    tell_numbers(about, "state", 2 * n, n == 1 ? "q p" : "q_1 q_2 ... p_1 p_2 ...");
    tell_numbers(about, "input", n, "forces: p' = -dV/dq + input; NULL for none");
    tell_numbers(about, "field", 2 * n, n == 1 ? "q' p'" : "q_1' q_2' ... p_1' p_2' ...");
    export_units(source, "those of the training data");
    lg_text_add(about, "time          as in the dt of the training data\n");
}

/* ---- golden states, as in training data ---- */

/* q_i uniform on the sphere, p_i = q_i x u, u ~ U[0, 1]^3. */
static void draw_chain(uint32_t k, lg_rng *rng, double *y) {
    for (uint32_t i = 0; i < k; i++, y += 6) {
        double u[3], norm = 0.0;
        for (int c = 0; c < 3; c++) y[c] = lg_rng_normal(rng);
        for (int c = 0; c < 3; c++) norm += y[c] * y[c];
        for (int c = 0; c < 3; c++) y[c] /= sqrt(norm), u[c] = lg_rng_uniform(rng);
        for (int c = 0; c < 3; c++)
            y[3 + c] = y[(c + 1) % 3] * u[(c + 2) % 3] - y[(c + 2) % 3] * u[(c + 1) % 3];
    }
}

/* U[-1, 1]. */
static void draw_separable(uint32_t n, lg_rng *rng, double *y) {
    for (uint32_t i = 0; i < 2 * n; i++) y[i] = lg_rng_uniform_in(rng, -1.0, 1.0);
}

/* ---- families of which more is known than their functions ---- */

typedef struct family_kind {
    const char *family, *copies;
    void (*tell)(export_source *source, unsigned n);
    void (*draw)(uint32_t n, lg_rng *rng, double *y); /* a golden state */
    /* Sets source->condition. False: the exported type cannot hold the parameters. NULL: it stays 1. */
    bool (*condition)(export_source *source, const lg_hamiltonian *model, const double *theta);
    const char *arrive;                   /* code that writes the state after a step */
    bool manifold;                        /* states are points of T*S^2 */
    bool steps[LG_SCHEME_KINDS], ambient; /* schemes whose step is explicit; in an ambient space, too */
    const char *others;                   /* follows the name of another scheme */
} family_kind;

static const family_kind kinds[] = {
    {.family = "chain",
     .copies = "k",
     .tell = tell_chain,
     .draw = draw_chain,
     .condition = chain_condition,
     .arrive = "arrive_ts2",
     .manifold = true,
     .steps = {[LG_SCHEME_RKMK] = true, [LG_SCHEME_COMMUTATOR_FREE] = true},
     .others = " is not an explicit Lie group scheme, which a step on T*S^2 needs: use cf4, rkmk4, "
               "lie-euler, or another scheme or file of the kinds rkmk and commutator-free"},
    {.family = "separable",
     .copies = "n",
     .tell = tell_separable,
     .draw = draw_separable,
     .arrive = "arrive",
     .steps = {[LG_SCHEME_RKMK] = true, [LG_SCHEME_COMMUTATOR_FREE] = true, [LG_SCHEME_SPLITTING] = true},
     .ambient = true,
     .others = " is not explicit: use stormer-verlet, rk4, cf4, or another scheme or file of the kinds "
               "splitting, runge-kutta, rkmk and commutator-free"},
};

static const family_kind *kind_of(const lg_hamiltonian *model) {
    for (size_t i = 0; i < LG_COUNT(kinds); i++)
        if (strcmp(kinds[i].family, model->family->name) == 0) return &kinds[i];
    return NULL;
}

static const char *scheme_name(const lg_scheme *scheme) {
    return scheme->name != NULL ? scheme->name : "a scheme without a name";
}

static void tell_scheme(text *about, const lg_scheme *scheme, size_t evaluations) {
    lg_text_add(about, "step          %s, order %d: %zu evaluation%s of the %s\n", scheme_name(scheme),
                scheme->order, evaluations, evaluations == 1 ? "" : "s",
                scheme->kind == LG_SCHEME_SPLITTING ? "gradient of V" : "field");
}

static void tell_test_set(text *about, const lg_hamiltonian_file *file) {
    const lg_test_set *test = &file->test;
    const bool own = test->sha256[0] != '\0' && strcmp(test->sha256, file->run.data_sha256) == 0;
    if (test->trajectories > 0)
        lg_text_add(about, "test set      %llu trajectories", (unsigned long long)test->trajectories);
    else
        lg_text_add(about, "test set      of unknown size");
    if (test->points > 0) lg_text_add(about, " of %llu points", (unsigned long long)test->points);
    if (test->t_end > 0) lg_text_add(about, " over a time of %g", test->t_end);
    lg_text_add(about, "%s\n", own ? ": THE TRAINING DATA" : "");
    if (test->sha256[0] != '\0') lg_text_add(about, "test SHA-256  %s\n", test->sha256);
}

static void tell_test(text *about, const lg_hamiltonian_file *file) {
    if (file->has_e1)
        lg_text_add(
            about,
            "E1            %.4e: mean squared error of the learned flow, integrated accurately from\n"
            "              the starts of the test set, over its trajectories, coordinates and points\n",
            file->e1);
    if (file->has_e2)
        lg_text_add(about, "E2            %.4e: mean |d - mean d|, d = true H - learned H at these starts\n",
                    file->e2);
    if (file->has_e1 || file->has_e2)
        tell_test_set(about, file);
    else
        lg_text_add(about, "test set      none recorded\n");
}

static void tell_training(text *about, const lg_hamiltonian_file *file) {
    const lg_hamiltonian_run *run = &file->run;
    const double *loss = file->history[LG_FIT_LOSS];
    lg_text_add(about, "\n");
    if (run->system[0] != '\0') lg_text_add(about, "system        %s\n", run->system);
    if (run->trajectories > 0)
        lg_text_add(
            about,
            "trained on    %llu trajectories of %llu points %g apart, through %s with %u step%s between "
            "two points\n",
            (unsigned long long)run->trajectories, (unsigned long long)run->points, run->dt,
            run->scheme->name, (unsigned)run->substeps, run->substeps == 1 ? "" : "s");
    if (file->epochs_done > 0)
        lg_text_add(about, "epochs        %zu, in %s precision\n", file->epochs_done,
                    run->training.dtype == LG_F32 ? "single" : "double");
    if (file->epochs_done > 0 && loss != NULL && isfinite(loss[file->epochs_done - 1]))
        lg_text_add(about, "last loss     %.4e (mean squared error of the predicted points)\n",
                    loss[file->epochs_done - 1]);
    tell_test(about, file);
}

static const char declarations[] =
    "/* H(state) = NAME_eval */\n"
    "NAME_real NAME_hamiltonian(const NAME_real *state, NAME_real *work);\n"
    "\n"
    "/* The field of the flow with an input, or NULL; both as said at the top. */\n"
    "void NAME_field(const NAME_real *state, const NAME_real *input, NAME_real *field, NAME_real *work);\n"
    "\n"
    "/* One step of length h, which may be negative, the input held constant over it, or NULL. next may be\n"
    " * state; h = 0 copies it. Differences from the library stay below NAME_TOLERANCE\n"
    " * NAME_STEP_EVALUATIONS relative to the state while rotations are a few turns a step and less. */\n"
    "void NAME_step(NAME_real h, const NAME_real *state, const NAME_real *input, NAME_real *next,\n"
    "               NAME_real *work);\n";

static void tell(export_source *source, const lg_hamiltonian_file *file, size_t evaluations) {
    const lg_hamiltonian *model = &file->run.model;
    kind_of(model)->tell(source, model->n);
    tell_scheme(&source->about, source->options->scheme, evaluations);
    if (source->condition > 1.0)
        lg_text_add(
            &source->about,
            "condition     %.1f: the mass matrix is nearly singular, which multiplies rounding and the\n    "
            "          tolerance by this factor\n",
            source->condition);
    tell_training(&source->about, file);
    export_provenance(source, &file->provenance, file->run.data_sha256);
    export_size(source, "LINKS", model->n, kind_of(model)->copies);
    export_size(source, "STATE_SIZE", lg_hamiltonian_state_dim(model), "numbers in state, next and field");
    export_size(source, "INPUT_SIZE", lg_hamiltonian_input_dim(model), "numbers in an input");
    export_size(source, "STEP_EVALUATIONS", evaluations, "of the network's gradient in a step");
    lg_text_add_named(&source->declarations, source->options->name, declarations);
}

/* ---- golden vectors ---- */

static double norm(const double *x, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) sum += x[i] * x[i];
    return sqrt(sum);
}

/* The training data's dt, halved until no golden state moves by more than its own length: a model that is too
 * fast for dt would be compared where steps multiply rounding. */
static double golden_step(const export_source *source, double dt) {
    const export_golden *golden = &source->golden;
    const size_t n = source->inputs;
    double h = dt > 0.0 && dt <= 1.0 ? dt : 0.01;
    for (int halved = 0; halved < 60; halved++) {
        bool fits = true;
        for (size_t i = 0; i < golden->count; i++)
            fits = fits && h * norm(golden->extra + 2 * n * i, n) <= norm(golden->x + n * i, n);
        if (fits) break;
        h *= 0.5;
    }
    return export_round(source->options, h);
}

/* Values, gradients and fields, then steps of `h`, which is chosen between. */
static lg_status compute_golden(const export_source *source, const lg_model *model, double dt,
                                const double *input, void *work, lg_stepper *stepper, double *h) {
    const export_golden *golden = &source->golden;
    const size_t n = source->inputs;
    lg_status status = LG_OK;
    for (size_t i = 0; i < golden->count && status == LG_OK; i++) {
        const double *x = golden->x + i * n;
        lg_model_jacobian(model, x, golden->y + i, golden->jacobian + i * n, work);
        status = lg_model_field(model, x, input, golden->extra + 2 * n * i, work);
    }
    *h = golden_step(source, dt);
    for (size_t i = 0; i < golden->count && status == LG_OK; i++)
        status = lg_step(stepper, 0.0, *h, golden->x + i * n, input, golden->extra + (2 * i + 1) * n);
    return status;
}

/* Golden states, and the input of `extra`; numbers of the exported type. */
static void draw_golden(export_source *source, const lg_hamiltonian *model, double *input, size_t m) {
    const export_options *options = source->options;
    const size_t n = source->inputs, count = source->golden.count;
    double *x = source->golden.x;
    lg_rng rng;
    lg_rng_seed(&rng, options->seed, 0);
    for (size_t i = 0; i < count; i++) kind_of(model)->draw(model->n, &rng, x + i * n);
    for (size_t i = 0; i < count * n; i++) x[i] = export_round(options, x[i]);
    for (size_t i = 0; i < m; i++) input[i] = export_round(options, lg_rng_uniform_in(&rng, -1.0, 1.0));
}

static void write_golden(export_source *source, const double *input, size_t m, double h) {
    lg_text_add(&source->test, "static const real golden_step = ");
    lg_text_add_real(&source->test, source->options->dtype, h);
    lg_text_add(&source->test, ";\nstatic const real golden_input[%zu] = {\n", m);
    lg_text_add_reals(&source->test, source->options->dtype, 4, input, m);
    lg_text_add(&source->test, "};\n");
    export_test_code(source, "test_hamiltonian");
}

static lg_status golden_vectors(export_source *source, const lg_hamiltonian_file *trained,
                                const lg_model *model) {
    const lg_scheme *scheme = source->options->scheme;
    const size_t m = lg_model_input_dim(model), bytes = lg_model_stepper_size(model, scheme);
    double h, *input = app_alloc(m, sizeof *input);
    void *memory = app_alloc(bytes > 0 ? bytes : 1, 1), *work = app_alloc(lg_model_work_size(model), 1);
    lg_stepper *stepper;
    export_golden_make(source, true, 2 * source->inputs, "field and step");
    draw_golden(source, &trained->run.model, input, m);
    lg_status status = lg_model_stepper_init(model, scheme, &stepper, memory, bytes);
    if (status == LG_OK) status = compute_golden(source, model, trained->run.dt, input, work, stepper, &h);
    if (status == LG_OK) write_golden(source, input, m, h);
    free(work);
    free(memory);
    free(input);
    return status;
}

/* ---- code ---- */

/* Schemes without an explicit step on the model's space: a sentence and APP_EXIT_USAGE. */
static int check_scheme(const app *self, const family_kind *kind, const lg_scheme *scheme) {
    lg_error error = {LG_OK, ""};
    if (lg_scheme_check(scheme, &error) != LG_OK) return app_usage(self, "%s", error.message);
    if (kind->steps[scheme->kind] && (kind->ambient || !scheme->ambient)) return APP_EXIT_OK;
    return app_usage(self, "%s%s", scheme_name(scheme), kind->others);
}

/* Bytes of the frames of code/hamiltonian, gcc and clang, -O0 to -O3, and how many there are. */
enum { STACK = 1024, CALLS = 2 };

/* The program's functions, and around them the ones of NAME.h. */
static int add_code(const app *self, export_source *source, const lg_hamiltonian_file *trained,
                    lg_program *program) {
    export_function functions[] = {{.function = "value", .name = "eval"},
                                   {.function = "grad", .name = "grad"},
                                   {.function = "field", .name = "flow", .hidden = true},
                                   {.function = "step", .name = "advance", .hidden = true}};
    const lg_hamiltonian *model = &trained->run.model;
    const int code = export_bundle(self, source, program, true, functions, LG_COUNT(functions));
    if (code != APP_EXIT_OK) return code;
    lg_text_add(&source->code, "\n");
    export_constant(source, "LINKS", model->n);
    export_constant(source, "STATE", lg_hamiltonian_state_dim(model));
    export_constant(source, "INPUT", lg_hamiltonian_input_dim(model));
    if (kind_of(model)->manifold)
        export_real(source, "manifold_rounding", source->options->dtype == LG_F32 ? 5e-5 : 1e-13);
    export_code(source, kind_of(model)->arrive);
    export_code(source, "hamiltonian");
    source->work += lg_hamiltonian_state_dim(model);
    source->stack += STACK;
    source->calls += CALLS;
    return APP_EXIT_OK;
}

/* Of the network's gradient in a step: a scheme's step calls the field, or the force. */
static size_t evaluations_of(const lg_program *program) {
    static const char *const callees[] = {"field", "force"};
    size_t step, callee, count = 0;
    if (lg_program_find(program, "step", &step) != LG_OK) return 0;
    for (size_t i = 0; i < LG_COUNT(callees); i++)
        if (lg_program_find(program, callees[i], &callee) == LG_OK)
            count += lg_program_calls(program, step, callee);
    return count;
}

/* ---- all together ---- */

static int export_known(const app *self, const lg_model_file *file, lg_program *program,
                        export_source *source) {
    const lg_hamiltonian_file *trained = &file->hamiltonian;
    const lg_hamiltonian *model = &trained->run.model;
    const char *path = self->arguments[0];
    source->inputs = lg_hamiltonian_state_dim(model);
    source->outputs = 1;
    source->depth = (size_t)model->net.layers + 1;
    source->parameters = trained->parameters;
    const int code = add_code(self, source, trained, program);
    if (code != APP_EXIT_OK) return code;
    const lg_status status = golden_vectors(source, trained, file->model);
    if (status != LG_OK)
        return app_fail(self, status, "%s: golden vectors of its field and step: %s", path,
                        lg_status_sentence(status));
    tell(source, trained, evaluations_of(program));
    return APP_EXIT_OK;
}

int export_hamiltonian(const app *self, const lg_model_file *file, export_source *source) {
    const lg_hamiltonian_file *trained = &file->hamiltonian;
    const lg_hamiltonian *model = &trained->run.model;
    const char *path = self->arguments[0];
    const family_kind *kind = kind_of(model);
    lg_error error = {LG_OK, ""};
    lg_program *program;
    int code = kind != NULL ? check_scheme(self, kind, source->options->scheme) : APP_EXIT_OK;
    if (code != APP_EXIT_OK) return code;
    source->condition = 1.0;
    if (kind != NULL && kind->condition != NULL && !kind->condition(source, model, trained->theta))
        return app_fail(self, LG_FORMAT,
                        "%s: the mass matrix is not positive definite, or its inverse is not a number of the "
                        "exported type",
                        path);
    const lg_status status = lg_hamiltonian_program(self->context, model, trained->theta,
                                                    source->options->scheme, &program, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    if (kind == NULL) {
        source->parameters = 0; /* export_whole counts them */
        return export_whole(self, path, program, source);
    }
    code = export_known(self, file, program, source);
    lg_program_destroy(program);
    return code;
}
