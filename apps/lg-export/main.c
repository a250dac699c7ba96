/* lg-export: writes a trained model as C sources for control code. */
#include <stdlib.h>
#include <string.h>

#include "lg-export/faces.h"
#include "liegrad/policy.h"

static export_options given;

/* The rows of all targets (export_target_NAME), each in its own file; the first target is plain C. */
#define EXPORT_TARGET_LIST(ROW)                                                                              \
    ROW(c) ROW(casadi) ROW(fmu2) ROW(fmu3) ROW(simulink) ROW(onnx) ROW(safetensors) ROW(package)
#define DECLARE(name) extern const export_target export_target_##name;
EXPORT_TARGET_LIST(DECLARE)
#define NAME(name)   #name,
#define TARGET(name) &export_target_##name,
static const char *const target_names[] = {EXPORT_TARGET_LIST(NAME) NULL};
static const export_target *const targets[] = {EXPORT_TARGET_LIST(TARGET)};
const export_target export_target_c = {.build = NULL};

static const char *const dtypes[] = {"f64", "f32", NULL};

static const lg_field options[] = {
    APP_OUT(export_options, "DIR",
            "Folder for the files (required); it is made if it does not exist, but its parent folder must "
            "exist. A folder with a file of these names is rejected, unless lg-export wrote the file for "
            "the same NAME: each model needs its own folder"),
    LG_OPTION(export_options, name, STRING, "NAME",
              "Name of the functions and files (default: the model file's name as a C identifier)"),
    APP_DTYPE(export_options, "Type of the numbers in the code: f64 (default) or f32", .names = dtypes),
    LG_OPTION(
        export_options, target, NAME, NULL,
        "What reads the result: c (default), C99 sources; casadi, libNAME.so for casadi.external with first "
        "and second derivatives; fmu2 and fmu3, NAME.fmu for model exchange and co-simulation. make builds "
        "them in the folder. simulink, C Function blocks and an S-function; onnx, NAME.onnx of one function "
        "(default value); safetensors, the weights; package, C with CMakeLists.txt and package.xml for CMake "
        "and ROS 2",
        .names = target_names),
    LG_FIELD(
        export_options, NULL, "scheme", STRING, scheme_name, .unit = "NAME",
        .meaning =
            "Hamiltonians and machines: the scheme of NAME_step, a name of liegrad/integrators.h or a YAML "
            "file (default: the family's; of a machine that of its training)"),
    LG_OPTION(
        export_options, functions, STRING, "NAMES",
        "Programs, and all models for another target than c: functions to export, separated by commas "
        "(default: all; of models value, field, velocity, step). Models that move, in C: linearise adds "
        "NAME_linearise, which takes several times the code and work memory. Controllers: default control; "
        "observe adds an observer for plants of which positions alone are measured, adapt finds friction and "
        "payloads"),
    LG_OPTION(
        export_options, sensor, REALS, "S[,S...]",
        "Controllers with --functions observe: standard deviation of the measured positions, one for all or "
        "one each, in the log's units (default 0.001)",
        .option = "noise", .high = 1e300, .above = true, .most = LG_POLICY_COORDINATES),
    LG_OPTION(
        export_options, drift, REALS, "S[,S...]",
        "Controllers with --functions observe: by how much velocities stray from the machine's in a second "
        "(default 0.1)",
        .high = 1e300, .above = true, .most = LG_POLICY_COORDINATES),
    LG_OPTION(export_options, forget, REAL, "SECONDS",
              "Controllers with --functions adapt: time in which measurements are forgotten", LG_POSITIVE,
              .value = "10"),
    LG_OPTION(export_options, compact, SWITCH, NULL,
              "Programs: write loops for small tensors too, not straight code; this gives less, slower code"),
    LG_OPTION(export_options, golden, U64, "N", "Number of golden vectors of the self-test", .low = 1,
              .high = 1000, .value = "8"),
    LG_FIELD_END};

/* The model that is being exported, and what has to be freed. */
typedef struct job {
    const app *self;
    const char *path; /* The model's file. */
    char *name;
    lg_scheme *scheme; /* Read from a file, to be freed; or NULL. */
    lg_model_file file;
    export_options options;
    export_source source;
    const char *kind;
} job;

/* ---- options ---- */

static void choose_name(job *j) {
    j->options.file = app_name_of(j->path);
    const char *problem = given.name != NULL ? export_name_problem(given.name) : NULL;
    if (problem != NULL)
        app_stop_usage(j->self, "--name: '%s' cannot be the name of functions and files: %s", given.name,
                       problem);
    j->name = given.name != NULL ? app_format("%s", given.name) : export_name_from(j->options.file);
    if (j->name == NULL) app_stop_usage(j->self, "'%s' gives no valid name: use --name", j->options.file);
    j->options.name = j->name;
}

static bool is_text(const char *path) {
    const char *dot = strrchr(path, '.');
    return dot != NULL && dot != path &&
           (strcmp(dot, ".yaml") == 0 || strcmp(dot, ".yml") == 0 || strcmp(dot, ".json") == 0);
}

static void unknown_scheme(const job *j) {
    text names = app_text();
    for (size_t i = 0; i < lg_scheme_count(); i++)
        lg_text_add(&names, "%s%s", i > 0 ? ", " : "", lg_scheme_at(i)->name);
    app_stop_usage(j->self, "--scheme: '%s' is neither a file (.yaml, .yml, .json) nor one of %s",
                   given.scheme_name, names.data);
}

static void choose_scheme(job *j) {
    if (given.scheme_name == NULL) return;
    j->options.scheme = lg_scheme_find(given.scheme_name);
    if (j->options.scheme != NULL) return;
    if (strchr(given.scheme_name, '/') == NULL && !is_text(given.scheme_name)) unknown_scheme(j);
    APP_FILE(j->self, given.scheme_name, lg_scheme_read, &j->scheme);
    j->options.scheme = j->scheme;
}

/* ---- kinds of models ---- */

static void refuse_scheme(const job *j) {
    if (given.scheme_name != NULL)
        app_stop_usage(j->self, "--scheme is for Hamiltonians and machines; %s is a %s", j->path, j->kind);
}

static void refuse_functions(const job *j) {
    app_stop_usage(j->self,
                   "%s is a %s: --compact is for programs, and --functions for programs, for targets other "
                   "than c, and, with the name linearise, for models that move",
                   j->path, j->kind);
}

/* Rejects options that faces do not have: --compact, and --functions unless the model moves and the only name
 * is `linearise`. */
static void check_functions(const job *j) {
    const bool moves = lg_model_space(j->file.model) != NULL;
    if (given.compact || (given.functions != NULL && !moves)) refuse_functions(j);
    if (given.functions != NULL && strcmp(given.functions, "linearise") != 0)
        app_stop_usage(j->self,
                       "--functions: '%s'; a model that moves is exported with its usual functions; only "
                       "linearise can be added",
                       given.functions);
}

/* Writes the C of the model's faces; *none: the model has no face. */
static void build_faces(job *j, bool *none) {
    if (j->file.recipe != NULL) check_functions(j);
    if (lg_model_space(j->file.model) == NULL) refuse_scheme(j);
    if (j->options.scheme == NULL) j->options.scheme = lg_model_file_scheme(&j->file);
    export_faces(j->self, &j->file, &j->source, none);
}

/* Writes a model that has no faces. */
static void build_whole(job *j, const char *kind,
                        void (*build)(const app *self, const char *path, export_source *source)) {
    j->kind = kind;
    if (build == export_classifier && (given.functions != NULL || given.compact)) refuse_functions(j);
    if (!j->source.scene) refuse_scheme(j);
    build(j->self, j->path, &j->source);
}

/* Writes a model by its faces. A file of an unknown kind is written as a program if it has no face or if the
 * options ask for something else. */
static void build_model(job *j, const char *kind) {
    lg_error error = {LG_OK, ""};
    bool none = false;
    const bool known = lg_recipe_find(kind) != NULL,
               more = given.compact || (given.functions != NULL && strcmp(given.functions, "linearise") != 0);
    const lg_status status = lg_model_load(j->self->context, j->path, NULL, &j->file, &error);
    if (known) app_must_file(j->self, status, &error, j->path);
    if (status != LG_OK || (!known && more)) {
        if (status == LG_OK) lg_model_file_destroy(&j->file);
        if (status != LG_OK) export_warn_program(j->self, &error);
        build_whole(j, "program", export_program);
        return;
    }
    j->kind = kind;
    build_faces(j, &none);
    lg_model_file_destroy(&j->file);
    if (none) build_whole(j, "program", export_program);
}

/* Rejects a file without functions that can be exported, with the error of the reader for its kind. */
static void check_file(const job *j, const char *kind) {
    lg_error error = {LG_OK, ""};
    lg_program *program = NULL;
    lg_model_file file;
    lg_status status = lg_program_load(j->self->context, j->path, NULL, &program, &error);
    if (status != LG_OK && strcmp(kind, "program") != 0)
        status = lg_model_load(j->self->context, j->path, NULL, &file, &error);
    app_must_file(j->self, status, &error, j->path);
    lg_program_destroy(program);
}

/* Writes a target other than C: the model, whatever its kind, is loaded as a program. A scene too becomes a
 * program; an FMU can have the scene's parameters as tunable parameters. */
static void build_target(job *j, const char *kind) {
    lg_program *program;
    const export_target *target = targets[given.target];
    if (strcmp(kind, "classifier") == 0)
        app_stop_usage(j->self, "--target %s: %s is a classifier, which can be exported as C only",
                       target_names[given.target], j->path);
    if (target->wide != NULL && j->options.dtype != LG_F64)
        app_stop_usage(j->self, "--target %s: %s in double precision, so --dtype f32 is not possible",
                       target_names[given.target], target->wide);
    j->kind = kind;
    j->options.compact = true;
    if (j->source.scene)
        export_load_scene(j->self, j->path, target->tunable, &j->source, &program);
    else
        export_load(j->self, j->path, kind, &j->source, &program);
    if (!j->source.scene && j->source.start == NULL) refuse_scheme(j);
    target->build(j->self, j->path, program, &j->source);
    lg_program_destroy(program);
}

static void build(job *j) {
    static char own[64] = "scene";
    const bool scene = is_text(j->path), other = targets[given.target]->build != NULL;
    if (!scene) APP_FILE(j->self, j->path, lg_model_file_kind, NULL, own, sizeof own);
    const bool classifier = strcmp(own, "classifier") == 0, policy = strcmp(own, "policy") == 0;
    if (!scene && lg_recipe_find(own) == NULL && !classifier) check_file(j, own);
    if (!scene) export_read_units(j->self, j->path, &j->options);
    if (policy && j->options.functions == NULL) j->options.functions = "control";
    j->source.scene = scene;
    if (other)
        build_target(j, own);
    else if (scene || policy || classifier || strcmp(own, "program") == 0)
        build_whole(j, own, policy ? export_policy : classifier ? export_classifier : export_program);
    else
        build_model(j, own);
}

/* Rule for a shared library of the C code, for programs that load it. The library is not made if the
 * compiler's target has no operating system. */
static const char library[] =
    "libNAME_.so: NAME_.c NAME_weights.c NAME_.h\n"
    "\t$(CC) $(CFLAGS) -fPIC -shared NAME_.c NAME_weights.c $(LDFLAGS) -lm -o libNAME_.so\n";

static void build_files(job *j) {
    build(j);
    if (targets[given.target]->build != NULL) return;
    export_add_rules(&j->source, "$(if $(findstring -none-,$(shell $(CC) -dumpmachine)),,libNAME_.so)",
                     library);
    export_compose(&j->source);
    if (targets[given.target]->add != NULL) targets[given.target]->add(&j->source);
}

/* ---- report ---- */

static size_t real_bytes(const job *j) {
    return j->options.dtype == LG_F32 ? sizeof(float) : sizeof(double);
}

static void report(const job *j) {
    const export_source *source = &j->source;
    const size_t parameters = source->parameters > 0 ? source->parameters : source->numbers;
    const lg_scheme *scheme = j->options.scheme;
    app_json *out = j->self->out;
    APP_PUT(out, LG_TEXT("name", j->name, NULL), LG_TEXT("kind", j->kind, NULL),
            LG_TEXT("dtype", dtypes[j->source.single ? 1 : given.dtype], NULL),
            LG_TEXT("scheme", scheme != NULL ? scheme->name : NULL, "of the step"));
    app_json_open(out, "files", '[');
    for (size_t i = 0; i < source->file_count; i++) {
        app_json_text(out, NULL, source->files[i].name);
        app_result_line(out, "  %s/%s", given.out, source->files[i].name);
    }
    app_json_close(out, ']');
    if (source->bundle) {
        app_json_size(out, "functions", source->functions);
    } else {
        APP_PUT(out, LG_AS_WHOLE("inputs", source->inputs), LG_AS_WHOLE("outputs", source->outputs));
    }
    APP_PUT(out, LG_WHOLE("parameters", parameters, NULL),
            LG_WHOLE("weights_bytes", source->numbers * real_bytes(j) + source->integer_bytes, NULL),
            LG_AS_WHOLE("work_size", source->work),
            LG_WHOLE("work_bytes", source->work * real_bytes(j), NULL),
            LG_WHOLE("stack_size", source->stack, "bytes at most"), LG_WHOLE("depth", source->depth, NULL),
            LG_REAL("tolerance", export_tolerance(source), "of the self-test; make test runs it"));
}

/* Warns about results that rounding spoils, and about numbers that become 0 or lose digits in single
 * precision, for example a guard against division by 0. */
static void warn_lost(const job *j) {
    const export_source *source = &j->source;
    const size_t lost = source->lost + source->weights.lost + source->code.lost;
    if (source->coarse || (!source->bundle && !(export_tolerance(source) < EXPORT_MOST_TOLERANCE)))
        app_warn(j->self,
                 "%s: rounding may change results by a tenth of their size; then the self-test fails: "
                 "export it with --dtype f64",
                 j->options.file);
    if (lost > 0)
        app_warn(j->self,
                 "%s: %zu of the numbers are below 1.2e-38 and lose digits or become 0 in single precision: "
                 "export it with --dtype f64, or choose units in which they are larger",
                 j->options.file, lost);
}

static void export_run(app *self) {
    job j = {.self = self, .path = self->arguments[0], .options = given};
    j.options.seed = self->seed;
    export_source_begin(&j.source, &j.options);
    if (given.out == NULL || given.out[0] == '\0')
        app_stop_usage(self, "--out is missing: give a folder for the files");
    choose_name(&j);
    choose_scheme(&j);
    lg_error why = {LG_OK, ""};
    lg_sha256 state;
    lg_sha256_init(&state);
    const lg_status hashed = app_hash_file(j.path, &state, &why);
    lg_sha256_finish(&state, j.options.sha256);
    build_files(&j); /* says why the file cannot be read at all */
    app_must_file(self, hashed, &why, j.path);
    export_write(self, &j.source, given.out);
    warn_lost(&j);
    report(&j);
    export_source_free(&j.source);
    lg_scheme_destroy(j.scheme);
    free(j.name);
}

APP_PROGRAM(lg_export) {
    const app_command commands[] = {
        {.name = NULL,
         .arguments = "MODEL.h5 | SCENE.yaml",
         .summary = "Writes a trained model as C99 sources for control code",
         .details =
             "NAME.h, NAME.c, NAME_weights.c, NAME_test.c and a Makefile: code that is C99 and C++14, needs "
             "libm (and memcpy, memmove and memset if the compiler inserts them), allocates nothing, keeps "
             "no state and works in the caller's memory. NAME.h describes the inputs and outputs of the "
             "functions with order and units.\n\nAll models except programs: NAME_eval, NAME_grad (gradient "
             "or Jacobian by the inputs). Hamiltonians and machines: NAME_hamiltonian, NAME_field, "
             "NAME_step; with --functions linearise NAME_linearise; machines also NAME_state, "
             "NAME_positions, NAME_velocities. Surrogates of beams: NAME_curve. Detectors, classifiers and "
             "classifications of tables: NAME_classify, NAME_class_names; classifiers also NAME_features. "
             "Controllers of lg-control: NAME_control; with --functions NAME_observe, NAME_adapt. Programs: "
             "NAME_<function> for each of their functions.\n\nIn the folder, make test compares the code "
             "with golden vectors of the library, make stack checks the stated bound on the stack, and make "
             "size shows the size of the objects.",
         .settings = APP_SETTINGS(APP_GIVEN(options, given)),
         .run = export_run},
        {.run = NULL}};
    return app_main(argc, argv, "lg-export", "Writes a trained model as C sources", commands);
}
