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

/* W = m^-1 (k, k), inside (divided by the scales). *condition = max_i m_ii W_ii >= 1, which multiplies the
 * rounding of what is solved with W: how nearly the rows of m depend on each other, whatever their scale.
 * False: the family has no mass. */
static bool invert_mass(const lg_hamiltonian *model, const double *theta, double *W, double *condition) {
    const size_t k = model->n;
    double *m = app_alloc(k * k, sizeof *m);
    lg_hamiltonian inner = *model;
    inner.scales = (lg_hamiltonian_scales){1.0, {1.0, 1.0}};
    const bool has_mass = lg_hamiltonian_mass(&inner, theta, m) == LG_OK;
    *condition = 1.0;
    if (has_mass) invert(k, m, W);
    for (size_t i = 0; has_mass && i < k; i++) *condition = fmax(*condition, m[i * k + i] * W[i * k + i]);
    free(m);
    return has_mass;
}

/* What the tolerance has room for without a condition. */
enum { LEAST_CONDITION = 20 };

/* The condition of a mass matrix, where the family has one. False: its inverse has numbers that the type
 * cannot hold. */
static bool find_condition(export_source *source, const lg_hamiltonian *model, const double *theta) {
    const size_t k = model->n;
    double condition, *W = app_alloc(k * k, sizeof *W);
    bool fits = true;
    const bool has_mass = invert_mass(model, theta, W, &condition);
    source->condition = fmax(1.0, condition / LEAST_CONDITION);
    for (size_t i = 0; has_mass && i < k * k; i++)
        fits = fits && isfinite(export_round(source->options, W[i]));
    free(W);
    return fits;
}

/* ---- what NAME.h says ---- */

/* "state (6)     words" */
void export_tell_numbers(text *about, const char *what, size_t count, const char *words) {
    char label[32];
    (void)snprintf(label, sizeof label, "%s (%zu)", what, count);
    lg_text_add(about, "%-12s  %s\n", label, words);
}

/* "q1 p1 q2 p2 ..., each with |q| = 1 and q.p = 0" */
static void tell_state(export_source *source, const lg_hamiltonian *model) {
    const lg_hamiltonian_family *family = model->family;
    const uint32_t groups = !family->numbered || model->n == 1 ? 0 : 2; /* written out */
    text *words = &source->state;
    for (const char *const *part = family->layout; groups == 0 && *part != NULL; part++)
        lg_text_add(words, "%s%s", part > family->layout ? " " : "", *part);
    for (uint32_t i = 1; i <= groups; i++)
        for (const char *const *part = family->layout; *part != NULL; part++)
            lg_text_add(words, "%s%s%u", i > 1 || part > family->layout ? " " : "", *part, i);
    lg_text_add(words, "%s", groups > 0 && model->n > groups ? " ..." : "");
    if (family->manifold != NULL)
        lg_text_add(words, ", %s%s", groups > 0 ? "each with " : "", family->manifold);
}

void export_tell_hamiltonian(export_source *source, const lg_hamiltonian *model) {
    const char *meaning = model->family->input_meaning;
    tell_state(source, model);
    if (lg_hamiltonian_input_dim(model) > 0 && meaning != NULL) lg_text_add(&source->input, "%s", meaning);
}

static void tell_model(export_source *source, const lg_hamiltonian *model) {
    const lg_hamiltonian_family *family = model->family;
    text *about = &source->about;
    const size_t d = lg_hamiltonian_state_dim(model), m = lg_hamiltonian_input_dim(model);
    char input[256];
    lg_text_add(about, "Learned Hamiltonian, family %s, of %u %s%s%s%s.\n\n", family->name, model->n,
                family->copy, model->n == 1 ? "" : "s", family->formula != NULL ? ": H = " : "",
                family->formula != NULL ? family->formula : "");
    export_tell_hamiltonian(source, model);
    export_tell_numbers(about, "state", d, source->state.data);
    (void)snprintf(input, sizeof input, "%s%sNULL for none",
                   family->input_meaning != NULL ? family->input_meaning : "",
                   family->input_meaning != NULL ? "; " : "");
    export_tell_numbers(about, "input", m, m > 0 ? input : "none: NULL");
    export_tell_numbers(about, "field", d,
                        family->field_meaning != NULL ? family->field_meaning : "an element of the algebra");
    export_units(source, "those of the training data");
    lg_text_add(about, "time          as in the dt of the training data\n");
    if (family->manifold != NULL)
        lg_text_add(
            about,
            "manifold      A state off it is not projected: value, gradient and field are those of the\n"
            "              formulas as they stand, and steps keep the distance but for rounding.\n");
}

static const char *scheme_name(const lg_scheme *scheme) {
    return scheme->name != NULL ? scheme->name : "a scheme without a name";
}

void export_tell_scheme(text *about, const lg_scheme *scheme, size_t evaluations, const char *what) {
    lg_text_add(about, "step          %s, order %d: %zu evaluation%s of the %s\n", scheme_name(scheme),
                scheme->order, evaluations, evaluations == 1 ? "" : "s", what);
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

const char export_motion_declarations[] =
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
    tell_model(source, model);
    export_tell_scheme(&source->about, source->options->scheme, evaluations,
                       source->options->scheme->kind == LG_SCHEME_SPLITTING ? "gradient of V" : "field");
    if (source->condition > 1.0)
        lg_text_add(
            &source->about,
            "condition     %.1f: the mass matrix is nearly singular, which multiplies rounding and the\n    "
            "          tolerance by this factor\n",
            source->condition);
    tell_training(&source->about, file);
    export_provenance(source, &file->provenance, file->run.data_sha256);
    char copies[64];
    (void)snprintf(copies, sizeof copies, "copies, each a %s", model->family->copy);
    export_size(source, "LINKS", model->n, copies);
    export_size(source, "STATE_SIZE", lg_hamiltonian_state_dim(model), "numbers in state, next and field");
    export_size(source, "INPUT_SIZE", lg_hamiltonian_input_dim(model), "numbers in an input");
    export_size(source, "STEP_EVALUATIONS", evaluations, "of the network's gradient in a step");
    lg_text_add_named(&source->declarations, source->options->name, export_motion_declarations);
}

/* ---- golden vectors ---- */

static double norm(const double *x, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) sum += x[i] * x[i];
    return sqrt(sum);
}

double export_golden_step(const export_source *source, double dt, size_t field) {
    const export_golden *golden = &source->golden;
    const size_t n = source->inputs;
    double h = dt > 0.0 && dt <= 1.0 ? dt : 0.01;
    for (int halved = 0; halved < 60; halved++) {
        bool fits = true;
        for (size_t i = 0; i < golden->count; i++)
            fits = fits && h * norm(golden->extra + golden->extras * i, field) <= norm(golden->x + n * i, n);
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
    *h = export_golden_step(source, dt, n);
    for (size_t i = 0; i < golden->count && status == LG_OK; i++)
        status = lg_step(stepper, 0.0, *h, golden->x + i * n, input, golden->extra + (2 * i + 1) * n);
    return status;
}

/* Golden states, and the input of `extra`; numbers of the exported type. */
static void draw_golden(export_source *source, const lg_hamiltonian *model, double *input, size_t m) {
    const export_options *options = source->options;
    const size_t n = source->inputs, count = source->golden.count;
    double *x = source->golden.x;
    lg_space space;
    lg_rng rng;
    (void)lg_hamiltonian_space(model->family, model->n, &space);
    lg_rng_seed(&rng, options->seed, 0);
    for (size_t i = 0; i < count; i++) (void)lg_space_start(&space, NULL, &rng, x + i * n);
    for (size_t i = 0; i < count * n; i++) x[i] = export_round(options, x[i]);
    for (size_t i = 0; i < m; i++) input[i] = export_round(options, lg_rng_uniform_in(&rng, -1.0, 1.0));
}

void export_write_motion(export_source *source, const double *input, size_t m, double h,
                         const char *fragment) {
    static const double none = 0.0;
    lg_text_add(&source->test, "static const real golden_step = ");
    lg_text_add_real(&source->test, source->options->dtype, h);
    lg_text_add(&source->test, ";\nstatic const real golden_input[%zu] = {\n", m > 0 ? m : 1);
    lg_text_add_reals(&source->test, source->options->dtype, 4, m > 0 ? input : &none, m > 0 ? m : 1);
    lg_text_add(&source->test, "};\n");
    export_test_code(source, fragment);
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
    if (status == LG_OK) export_write_motion(source, input, m, h, "test_hamiltonian");
    free(work);
    free(memory);
    free(input);
    return status;
}

/* ---- code ---- */

int export_check_scheme(const app *self, const lg_space *space, bool separable, const lg_scheme *scheme) {
    lg_error error = {LG_OK, ""};
    if (lg_scheme_check(scheme, &error) != LG_OK) return app_usage(self, "%s", error.message);
    const bool flat = lg_space_is_abelian(space);
    const bool lie = scheme->kind == LG_SCHEME_RKMK || scheme->kind == LG_SCHEME_COMMUTATOR_FREE;
    if ((lie && (flat || !scheme->ambient)) || (scheme->kind == LG_SCHEME_SPLITTING && separable))
        return APP_EXIT_OK;
    return app_usage(
        self,
        flat ? "%s is not explicit: rk4, cf4 and other rows or files of the kinds runge-kutta, rkmk and "
               "commutator-free can be had%s"
             : "%s is no explicit Lie group scheme, which a step of this model needs: cf4, rkmk4, lie-euler "
               "and other rows or files of the kinds rkmk and commutator-free can be had%s",
        scheme_name(scheme), separable ? ", or stormer-verlet and other splittings" : "");
}

/* Numbers of a copy, and copies; SE(3) is a rotation and three numbers. */
static void add_factor(export_source *source, const lg_space_factor *factor) {
    const size_t numbers = lg_space_kind_entry(factor->kind)->state;
    if (factor->kind == LG_SPACE_TS2 || factor->kind == LG_SPACE_SO3)
        lg_text_add(&source->code, "{%zu, %zu}, ", numbers, factor->count);
    else if (factor->kind != LG_SPACE_SE3)
        lg_text_add(&source->code, "{1, %zu}, ", numbers * factor->count);
    for (size_t i = 0; factor->kind == LG_SPACE_SE3 && i < factor->count; i++)
        lg_text_add(&source->code, "{9, 1}, {1, 3}, ");
}

void export_arrive(export_source *source, const lg_space *space, bool factors) {
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
    if (!flat) export_real(source, "manifold_rounding", source->options->dtype == LG_F32 ? 5e-5 : 1e-13);
    export_code(source, flat ? "arrive" : "arrive_manifold");
}

/* Bytes of the frames of code/hamiltonian, gcc and clang, -O0 to -O3, and how many there are. */
enum { STACK = 1024, CALLS = 3 };

/* The program's functions, and around them the ones of NAME.h. */
static int add_code(const app *self, export_source *source, const lg_hamiltonian_file *trained,
                    lg_program *program) {
    export_function functions[] = {{.function = "value", .name = "eval"},
                                   {.function = "grad", .name = "grad"},
                                   {.function = "field", .name = "flow", .hidden = true},
                                   {.function = "step", .name = "advance", .hidden = true}};
    const lg_hamiltonian *model = &trained->run.model;
    const size_t m = lg_hamiltonian_input_dim(model);
    const int code = export_bundle(self, source, program, true, functions, LG_COUNT(functions));
    if (code != APP_EXIT_OK) return code;
    lg_text_add(&source->code, "\n");
    export_constant(source, "STATE", lg_hamiltonian_state_dim(model));
    if (m > 0) export_constant(source, "INPUT", m);
    lg_space space;
    (void)lg_hamiltonian_space(model->family, model->n, &space);
    export_arrive(source, &space, false);
    export_code(source, m > 0 ? "forced" : "unforced");
    lg_text_add(&source->code, "\n");
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
    const lg_hamiltonian_file *trained = lg_model_file_of(file, &lg_recipe_hamiltonian);
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

/* A field with as many numbers as the state: NAME_field and NAME_step can be had. */
static bool is_known(const lg_hamiltonian *model) {
    lg_space space;
    return lg_hamiltonian_space(model->family, model->n, &space) == LG_OK && space.algebra_dim == space.dim;
}

int export_hamiltonian(const app *self, const lg_model_file *file, export_source *source) {
    const lg_hamiltonian_file *trained = lg_model_file_of(file, &lg_recipe_hamiltonian);
    const lg_hamiltonian *model = &trained->run.model;
    const char *path = self->arguments[0];
    lg_error error = {LG_OK, ""};
    lg_program *program;
    lg_space space;
    (void)lg_hamiltonian_space(model->family, model->n, &space);
    int code = export_check_scheme(self, &space, model->family->force != NULL, source->options->scheme);
    if (code != APP_EXIT_OK) return code;
    if (!find_condition(source, model, trained->theta))
        return app_fail(self, LG_FORMAT,
                        "%s: the mass matrix is not positive definite, or its inverse is not a number of the "
                        "exported type",
                        path);
    const lg_status status = lg_model_file_program(file, source->options->scheme, &program, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    code = is_known(model) ? export_known(self, file, program, source)
                           : export_whole(self, path, program, NULL, source);
    lg_program_destroy(program);
    return code;
}
