/* Harnesses of HDF5 files, which are made from trees. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/classifier_file.h"
#include "files/h5.h"
#include "model/files/recipe.h"
#include "fuzz.h"
#include "liegrad/elastica.h"
#include "liegrad/files.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/machine.h"
#include "liegrad/model.h"
#include "liegrad/policy.h"
#include "liegrad/program.h"
#include "liegrad/series.h"
#include "liegrad/table.h"
#include "tree.h"

static tree_record records[TREE_RECORDS];

/* The record of this name; NULL if there is none. */
static const tree_record *find(size_t count, const char *name) {
    const size_t length = strlen(name);
    for (size_t i = 0; i < count; i++)
        if (records[i].name_length == length && memcmp(records[i].name, name, length) == 0)
            return &records[i];
    return NULL;
}

/* ---- models ---- */

enum { MOST_NUMBERS = 1 << 12, MOST_WORK = 1 << 20 };

static void evaluate(const lg_model_file *file) {
    const lg_model *model = file->model;
    const size_t inputs = lg_model_inputs(model), outputs = lg_model_outputs(model);
    const size_t work = lg_model_work_size(model);
    const double *values;
    lg_slice_info slice;
    for (uint32_t i = 0; lg_model_file_slice(file, i, &slice, &values); i++)
        if (values == NULL) abort();
    if (inputs > MOST_NUMBERS || outputs > MOST_NUMBERS || inputs * outputs > MOST_NUMBERS ||
        work > MOST_WORK)
        return;
    double *x = lg_alloc(NULL, inputs, sizeof *x), *y = lg_alloc(NULL, outputs, sizeof *y);
    double *jacobian = lg_alloc(NULL, inputs * outputs, sizeof *jacobian);
    void *memory = lg_alloc(NULL, work, 1);
    if (x == NULL || y == NULL || jacobian == NULL || memory == NULL) abort();
    for (size_t i = 0; i < inputs; i++) x[i] = 0.25 + 0.5 * (double)(i % 3);
    lg_model_eval(model, x, y, memory);
    lg_model_jacobian(model, x, y, jacobian, memory);
    lg_free(NULL, memory);
    lg_free(NULL, jacobian);
    lg_free(NULL, y);
    lg_free(NULL, x);
}

void fuzz_model(const uint8_t *data, size_t size) {
    const char *path = tree_file(data, size);
    lg_error error = {LG_OK, ""};
    char kind[64] = "";
    lg_status status = lg_model_file_kind(NULL, path, NULL, kind, sizeof kind, &error);
    fuzz_status(status, &error);
    if (status == LG_OK && strcmp(kind, "classifier") == 0) {
        classifier_file file;
        status = classifier_file_load(NULL, path, &file, &error);
        fuzz_status(status, &error);
        if (status == LG_OK) classifier_file_free(&file);
    } else if (status == LG_OK) {
        lg_model_file file;
        status = lg_model_load(NULL, path, NULL, &file, &error);
        fuzz_status(status, &error);
        if (status != LG_OK) return;
        evaluate(&file);
        lg_model_file_destroy(&file);
    }
}

void fuzz_policy(const uint8_t *data, size_t size) {
    lg_error error = {LG_OK, ""};
    lg_policy *policy;
    char *text = NULL;
    fuzz_limit = 1 << 20; /* for the derivatives of a controller */
    const lg_status status = lg_policy_load(NULL, tree_file(data, size), NULL, &policy, &text, &error);
    fuzz_status(status, &error);
    if (status != LG_OK) return;
    lg_free(NULL, text);
    lg_policy_destroy(policy);
}

/* ---- data files ---- */

static void read_trajectories(const char *path) {
    lg_error error = {LG_OK, ""};
    lg_trajectories data;
    const lg_status status = lg_trajectories_read(NULL, path, NULL, &data, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) lg_trajectories_destroy(&data);
}

static void read_curves(const char *path) {
    lg_error error = {LG_OK, ""};
    lg_elastica_data data;
    const lg_status status = lg_elastica_data_read(NULL, path, NULL, &data, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) lg_elastica_data_destroy(&data);
}

static void read_series(const char *path) {
    lg_error error = {LG_OK, ""};
    lg_series_data data;
    const lg_status status = lg_series_read(NULL, path, NULL, NULL, &data, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) lg_series_data_destroy(&data);
}

static void read_log(const char *path) {
    static const char text[] = "columns: {time: time, run: run}\ncoordinates:\n"
                               "  - {name: x, kind: line, velocity: v}\n"
                               "  - {name: a, kind: angle, velocity: w}\ninputs: {columns: [u]}\n"
                               "measured: velocities\n";
    static lg_machine_file machine;
    lg_error error = {LG_OK, ""};
    if (machine.column_count == 0 &&
        lg_machine_file_parse(NULL, "machine.yaml", text, sizeof text - 1, &machine, &error) != LG_OK)
        abort();
    lg_logs logs;
    const lg_status status = lg_logs_read(NULL, &machine, &path, 1, NULL, &logs, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) lg_logs_destroy(&logs);
}

/* Each reader gets only files that contain its own data set. */
void fuzz_data(const uint8_t *data, size_t size) {
    static const struct {
        const char *mark;
        void (*read)(const char *path);
    } readers[] = {{"trajectories", read_trajectories},
                   {"boundary", read_curves},
                   {"X", read_series},
                   {"time", read_log},
                   {"column", fuzz_read_table}};
    const size_t count = tree_read(data, size, records);
    const char *path = tree_file(data, size);
    for (size_t i = 0; i < LG_COUNT(readers); i++)
        if (find(count, readers[i].mark) != NULL) readers[i].read(path);
}

/* ---- programs ---- */

/* Memory of exactly this size, so that sanitizers see accesses beyond it; NULL for large ports. */
static double *port_memory(size_t count) {
    double *memory = count <= MOST_NUMBERS ? malloc(count > 0 ? count * sizeof *memory : 1) : NULL;
    for (size_t i = 0; memory != NULL && i < count; i++) memory[i] = 0.25 + 0.5 * (double)(i % 3);
    return memory;
}

/* A program that could be loaded must be planned and run without a crash. */
static void run_program(const lg_program *program, size_t function) {
    enum { PORTS = 16 };
    double *ports[2 * PORTS] = {NULL};
    const void *inputs[PORTS];
    void *outputs[PORTS];
    lg_plan_options options;
    lg_plan_options_init(&options);
    options.max_size = MOST_WORK;
    options.most_work = 1e5;
    lg_error error = {LG_OK, ""};
    lg_plan *plan;
    const lg_status status = lg_plan_create(program, function, &options, &plan, &error);
    fuzz_status(status, &error);
    if (status != LG_OK) return;
    size_t input_count, output_count;
    (void)lg_program_inputs(program, function, &input_count);
    (void)lg_program_outputs(program, function, &output_count);
    bool fits = input_count <= PORTS && output_count <= PORTS;
    for (size_t i = 0; fits && i < input_count; i++) {
        inputs[i] = ports[i] = port_memory(lg_plan_input_count(plan, i));
        fits = inputs[i] != NULL;
    }
    for (size_t i = 0; fits && i < output_count; i++) {
        outputs[i] = ports[PORTS + i] = port_memory(lg_plan_output_count(plan, i));
        fits = outputs[i] != NULL;
    }
    void *work = fits ? lg_alloc(NULL, lg_plan_work_size(plan), 1) : NULL;
    if (work != NULL) lg_plan_eval(plan, inputs, outputs, work);
    lg_free(NULL, work);
    for (size_t i = 0; i < LG_COUNT(ports); i++) free(ports[i]);
    lg_plan_destroy(plan);
}

void fuzz_program(const uint8_t *data, size_t size) {
    lg_error error = {LG_OK, ""};
    lg_program *program;
    const lg_status status = lg_program_load(NULL, tree_file(data, size), NULL, &program, &error);
    fuzz_status(status, &error);
    if (status != LG_OK) return;
    const size_t functions = lg_program_functions(program);
    for (size_t i = 0; i < functions && i < 4; i++) run_program(program, i);
    lg_program_destroy(program);
}

/* Packing and unpacking the image again must give the same bytes. */
static void pack_again(const lg_function_image *image) {
    lg_error error = {LG_OK, ""};
    size_t size = 0, memory = MOST_WORK, again;
    lg_function_image *copy;
    if (lg_function_pack(image, NULL, &size, &error) != LG_OK) return; /* numbers beyond 2^62 */
    again = size;
    uint8_t *bytes = lg_alloc(NULL, size, 1), *others = lg_alloc(NULL, size, 1);
    if (bytes == NULL || others == NULL || lg_function_pack(image, bytes, &size, &error) != LG_OK ||
        lg_function_unpack(NULL, image->name, bytes, size, &memory, &copy, &error) != LG_OK ||
        lg_function_pack(copy, others, &again, &error) != LG_OK || again != size ||
        memcmp(bytes, others, size) != 0)
        abort();
    lg_function_image_destroy(copy);
    lg_free(NULL, bytes);
    lg_free(NULL, others);
}

static bool add_packed(lg_program *program, const uint8_t *data, size_t size) {
    char name[16];
    lg_error error = {LG_OK, ""};
    lg_function_image *image;
    size_t memory = MOST_WORK / 8;
    (void)snprintf(name, sizeof name, "f%zu", lg_program_functions(program));
    lg_status status = lg_function_unpack(NULL, name, data, size, &memory, &image, &error);
    fuzz_status(status, &error);
    if (status != LG_OK) return false;
    pack_again(image);
    status = lg_program_add_image(program, image, &error);
    fuzz_status(status, &error);
    lg_function_image_destroy(image);
    return status == LG_OK;
}

/* The C of a program that could be loaded. */
static void write_c(const lg_program *program) {
    lg_error error = {LG_OK, ""};
    lg_c_options options;
    lg_c_source *source;
    lg_c_options_init(&options);
    options.name = "fuzz";
    const lg_status status = lg_program_write_c(program, &options, &source, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) lg_c_source_destroy(source);
}

/* The input is a list of a program's functions, each after its length (u16, little-endian). */
static void take_functions(const lg_parameter_spec *parameters, size_t count, const uint8_t *data,
                           size_t size, bool c) {
    enum { MOST_FUNCTIONS = 8 };
    lg_program_spec spec;
    lg_program *program;
    lg_program_spec_init(&spec);
    spec.parameters = parameters;
    spec.parameter_count = count;
    if (lg_program_begin(NULL, &spec, &program, NULL) != LG_OK) abort();
    while (size >= 2 && lg_program_functions(program) < MOST_FUNCTIONS) {
        size_t length = data[0] + 256u * data[1];
        data += 2;
        size -= 2;
        if (length > size) length = size;
        if (!add_packed(program, data, length)) break;
        run_program(program, lg_program_functions(program) - 1);
        data += length;
        size -= length;
    }
    if (c && lg_program_functions(program) > 0) write_c(program);
    lg_program_destroy(program);
}

void fuzz_packed(const uint8_t *data, size_t size) {
    static const double numbers[86] = {0.5};
    const lg_parameter_spec parameters[] = {{"scale", {0, {0}}, numbers}, {"theta", {1, {86}}, numbers}};
    take_functions(parameters, LG_COUNT(parameters), data, size, false);
}

/* The parameters are the parameters of tests/autodiff/random. Only a quarter of the inputs is written as C,
 * because writing C takes as long as everything else. */
void fuzz_image(const uint8_t *data, size_t size) {
    static const double numbers[12] = {0.5, -1.25, 0.75, 1.5, -0.25, 1};
    const lg_parameter_spec parameters[] = {{"theta", {2, {4, 3}}, numbers}, {"beta", {1, {3}}, numbers}};
    take_functions(parameters, LG_COUNT(parameters), data, size, size % 4 == 0);
}

/* ---- checkpoints ---- */

static const lg_recipe *const kinds[] = {&lg_recipe_hamiltonian, &lg_recipe_surrogate, &lg_recipe_detector,
                                         &lg_recipe_table, &lg_recipe_machine_model};

static lg_status no_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                         size_t batch, lg_var *loss) {
    (void)user, (void)tape, (void)theta, (void)samples, (void)count, (void)batch, (void)loss;
    return LG_UNSUPPORTED;
}

static void load_fit(const lg_recipe *kind, const void *run, lg_file_reader *reader, size_t samples) {
    const lg_fit_settings *training = (const lg_fit_settings *)((const char *)run + kind->training);
    const size_t parameters = lg_recipe_parameters(kind, run);
    lg_error error = {LG_OK, ""};
    lg_archive_reader archive;
    lg_fit_options options;
    lg_fit *fit = NULL;
    if (training->epochs > MOST_NUMBERS || parameters > MOST_NUMBERS || samples > MOST_NUMBERS) return;
    const lg_fit_problem problem = {.parameters = parameters, .samples = samples, .loss = no_loss};
    double *theta = lg_alloc(NULL, parameters, sizeof *theta);
    lg_fit_options_init(&options);
    lg_fit_settings_apply(training, &options);
    options.shards = 1;
    lg_status status = lg_fit_create(NULL, &problem, &options, theta, &fit, &error);
    if (status == LG_OK && lg_file_reader_archive(reader, "fit", &archive) == LG_OK) {
        status = lg_fit_load(fit, &archive, &error);
        fuzz_status(status, &error);
        if (status == LG_OK) lg_fit_parameters(fit, theta);
    }
    lg_fit_destroy(fit);
    lg_free(NULL, theta);
}

void fuzz_checkpoint(const uint8_t *data, size_t size) {
    lg_error error = {LG_OK, ""};
    const size_t count = tree_read(data, size, records);
    const tree_record *name = find(count, "@kind"), *order = find(count, "fit/train/permutation");
    const lg_recipe *kind = kinds[0];
    for (size_t i = 0; name != NULL && i < LG_COUNT(kinds); i++) {
        const char *checkpoint = kinds[i]->checkpoint;
        if (name->length >= strlen(checkpoint) && memcmp(name->data, checkpoint, strlen(checkpoint)) == 0)
            kind = kinds[i];
    }
    lg_file_reader *reader;
    void *run = lg_alloc(NULL, 1, kind->run_size);
    if (run == NULL) abort();
    const lg_status status =
        lg_checkpoint_open(NULL, tree_file(data, size), NULL, kind, run, &reader, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) {
        load_fit(kind, run, reader, order != NULL && order->rank == 1 ? order->dims[0] : 10);
        lg_file_reader_destroy(reader);
    }
    lg_free(NULL, run);
}
