/* Table networks: functions of their program, words and golden vectors. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-export/export.h"
#include "liegrad/metrics.h"
#include "liegrad/random.h"
#include "liegrad/table.h"

enum { GOLDEN_STREAM = 0x7461626c, STACK = 1024, CALLS = 2, CLEAR_ATTEMPTS = 20 };

static bool is_regression(const lg_table_file *file) {
    return file->run.model.options.task == LG_TABLE_REGRESSION;
}

static size_t depth_of(const lg_net *net) {
    const size_t steps = net->kind == LG_NET_RESNET || net->kind == LG_NET_MULT_AFFINE ? 2 : 1;
    return 1 + steps * net->layers + 1 + 2; /* and the scaling on both sides */
}

/* ---- code ---- */

/* NAME_classify and NAME_class_names, as of detectors. */
static void add_classify(export_source *source, const lg_table_file *file, size_t probability) {
    const uint32_t classes = file->run.model.net.outputs;
    const size_t scores = (classes + 7) / 8 * 8;
    const char *name = source->options->name;
    if (scores + probability > source->work) source->work = scores + probability;
    source->stack += STACK;
    source->calls += CALLS;
    export_size(source, "CLASSES", classes, NULL);
    export_constant(source, "AT_NET", scores);
    export_code(source, "detector_class");
    export_code(source, "detector_main");
    lg_text_add(&source->code, "\nconst char *const %s_class_names[%s_CLASSES] = {\n", name, name);
    for (uint32_t i = 0; i < classes; i++) {
        lg_text_add(&source->code, "    ");
        lg_text_add_literal(&source->code, file->output_name[i]);
        lg_text_add(&source->code, ",\n");
    }
    lg_text_add(&source->code, "};\n");
    lg_text_add_named(
        &source->declarations, name,
        "/* The class of a row, a number below NAME_CLASSES, with the probabilities of all classes\n"
        " * (NAME_CLASSES) or NULL; -1, and NaN, where a number of the row is not finite. It is the one of "
        "the\n"
        " * largest probability: of two equal ones class 1, of more the first. */\n"
        "int NAME_classify(const NAME_real *row, NAME_real *probability, NAME_real *work);\n"
        "/* Names of the classes, UTF-8. */\nextern const char *const NAME_class_names[NAME_CLASSES];\n");
}

/* By how much value and gradient multiply rounding at the golden vectors. */
static lg_status find_condition(export_source *source, lg_program *program, lg_error *error) {
    static const char *const functions[] = {"value", "grad"};
    const size_t numbers = source->golden.count * source->inputs;
    double *x = app_alloc(numbers, sizeof *x);
    lg_status status = LG_OK;
    for (size_t i = 0; i < numbers; i++) x[i] = (double)(float)source->golden.x[i];
    for (size_t f = 0; f < LG_COUNT(functions) && status == LG_OK; f++) {
        size_t function;
        double found = 1.0;
        status = lg_program_find(program, functions[f], &function);
        if (status == LG_OK)
            status = export_amplification(program, function, x, source->golden.count, source->depth, &found,
                                          error);
        if (status == LG_OK && isfinite(found)) source->condition = fmax(source->condition, ceil(found));
    }
    free(x);
    return status;
}

/* ---- golden vectors ---- */

/* A row like the trained ones. */
static void draw_row(const export_source *source, const lg_table_file *file, lg_rng *rng, double *x) {
    for (size_t c = 0; c < source->inputs; c++) {
        double value = file->inputs.mean[c] + file->inputs.scale[c] * lg_rng_normal(rng);
        if (file->low != NULL) value = fmax(value, file->low[c]);
        if (file->high != NULL) value = fmin(value, file->high[c]);
        x[c] = export_round(source->options, value);
    }
}

/* Probabilities and class of logits. False where rounding could give another class. */
static bool add_extra(const double *y, uint32_t classes, double *extra) {
    double largest = -INFINITY, sum = 0, second = 0;
    for (uint32_t c = 0; c < classes; c++) largest = fmax(largest, y[c]);
    for (uint32_t c = 0; c < classes; c++) sum += extra[c] = exp(y[c] - largest);
    for (uint32_t c = 0; c < classes; c++) extra[c] /= sum;
    const uint32_t found = (uint32_t)lg_class_of(extra, classes);
    extra[classes] = found;
    for (uint32_t c = 0; c < classes; c++)
        if (c != found) second = fmax(second, extra[c]);
    return extra[found] - second > 1e-3;
}

static void add_golden(export_source *source, const lg_table_file *file, const lg_model *model) {
    const uint32_t classes = file->run.model.net.outputs;
    const bool regression = is_regression(file);
    lg_rng rng;
    void *work = app_alloc(lg_model_work_size(model), 1);
    lg_rng_seed(&rng, source->options->seed, GOLDEN_STREAM);
    export_golden_make(source, true, regression ? 0 : classes + 1,
                       regression ? NULL : "probabilities, class");
    export_golden *golden = &source->golden;
    for (size_t v = 0; v < golden->count; v++) {
        double *x = golden->x + v * source->inputs, *y = golden->y + v * source->outputs;
        bool clear = false;
        for (int attempt = 0; attempt < CLEAR_ATTEMPTS && !clear; attempt++) {
            draw_row(source, file, &rng, x);
            lg_model_jacobian(model, x, y, golden->jacobian + v * source->outputs * source->inputs, work);
            clear = regression || add_extra(y, classes, golden->extra + v * golden->extras);
        }
    }
    if (!regression) export_test_code(source, "test_detector");
    free(work);
}

/* ---- words ---- */

static void add_columns(text *to, const lg_table_file *file) {
    const lg_net *net = &file->run.model.net;
    lg_text_add(to, "inputs x (%u): a row as in the table, the code scales it\n", net->inputs);
    for (uint32_t c = 0; c < net->inputs; c++) {
        lg_text_add(to, "  %-5u %s: mean %.6g, deviation %.6g", c, file->input_name[c], file->inputs.mean[c],
                    file->inputs.scale[c]);
        if (file->low != NULL && file->high != NULL)
            lg_text_add(to, ", trained from %.6g to %.6g", file->low[c], file->high[c]);
        lg_text_add(to, "\n");
    }
    lg_text_add(to,
                is_regression(file) ? "outputs y (%u): columns in their units. Gradient: d y/d x, one row an "
                                      "output.\n"
                                    : "outputs y (%u): a logit a class; probabilities are exp(y_i)/sum_j "
                                      "exp(y_j). Gradient: d y/d x, one row an output.\n",
                net->outputs);
    for (uint32_t o = 0; o < net->outputs; o++)
        lg_text_add(to, is_regression(file) ? "  %-5u %s\n" : "  class %-5u %s\n", o, file->output_name[o]);
}

static void add_words(export_source *source, const lg_table_file *file) {
    const lg_table_options *options = &file->run.model.options;
    text *to = &source->about;
    lg_text_add(to, "Table network: %s of the rows of a table.\n\n", lg_table_task_name(options->task));
    add_columns(to, file);
    export_units(source, "those of the table");
    lg_text_add(to, "\nnetwork       %s, %u hidden layers of %u, %s%s\n", lg_net_kind_name(options->network),
                options->hidden_count, options->hidden[0], lg_activation_name(options->activation),
                options->linear ? ", and a linear map beside it" : "");
    if (isfinite(file->rmse)) lg_text_add(to, "rmse          %.6g of the outputs' deviation\n", file->rmse);
    if (isfinite(file->accuracy)) lg_text_add(to, "accuracy      %.6g, F1 %.6g\n", file->accuracy, file->f1);
    lg_text_add(to, "training      %zu epochs, %llu rows\n", file->epochs_done,
                (unsigned long long)file->run.rows);
    export_provenance(source, &file->provenance, file->run.data_sha256);
}

/* ---- all of it ---- */

static int add_code(const app *self, const lg_table_file *file, lg_program *program, export_source *source) {
    export_function functions[] = {{.function = "value", .name = "eval"},
                                   {.function = "grad", .name = "grad"},
                                   {.function = "probability", .name = "probability"}};
    const bool regression = is_regression(file);
    const int code = export_bundle(self, source, program, true, functions, regression ? 2 : 3);
    if (code == APP_EXIT_OK && !regression) add_classify(source, file, functions[2].work);
    return code;
}

int export_table(const app *self, const lg_model_file *file, export_source *source) {
    const lg_table_file *table = lg_model_file_of(file, &lg_recipe_table);
    lg_program *program = NULL;
    lg_error error = {LG_OK, ""};
    source->inputs = lg_model_inputs(file->model);
    source->outputs = lg_model_outputs(file->model);
    source->depth = depth_of(&table->run.model.net);
    lg_status status = lg_model_file_program(file, NULL, &program, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, source->options->file);
    const int code = add_code(self, table, program, source);
    if (code == APP_EXIT_OK) {
        add_golden(source, table, file->model);
        status = find_condition(source, program, &error);
        add_words(source, table);
    }
    lg_program_destroy(program);
    if (code != APP_EXIT_OK) return code;
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, source->options->file);
}
