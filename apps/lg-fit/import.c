/* lg-fit import: makes a program from the weights of a network that was trained elsewhere. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "core/text.h"
#include "lg-fit/fit.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"
#include "liegrad/tape.h"

enum { MOST_LAYERS = 64 };

typedef struct import_values {
    const char *out, *layers;
    int activation, last, layout;
} import_values;

/* Names of the activations, in the order of lg_activation. */
static const char *const activations[] = {"identity", "tanh",       "sigmoid", "swish",
                                          "relu",     "leaky-relu", "sine",    NULL};
_Static_assert(LG_COUNT(activations) == LG_ACTIVATION_COUNT + 1, "a name for each activation");
static const char *const layouts[] = {"auto", "out-in", "in-out", NULL};
enum { LAYOUT_AUTO, LAYOUT_OUT_IN, LAYOUT_IN_OUT };

static import_values values;

static const lg_field options[] = {
    LG_OPTION(import_values, out, STRING, "MODEL.h5", "Write the network here (required)",
              .file = LG_FILE_WRITTEN, .required = true),
    LG_OPTION(import_values, layers, STRING, "A,B,...",
              "The layers in their order from input to output, by their stems (numpy files: by their names "
              "without ending); default: by the numbers and letters of the stems, files as given"),
    LG_OPTION(import_values, activation, NAME, NULL, "Activation between the layers", .names = activations,
              .value = "tanh"),
    LG_OPTION(import_values, last, NAME, NULL, "Activation after the last layer", .names = activations,
              .value = "identity"),
    LG_OPTION(import_values, layout, NAME, NULL,
              "Weights are (out, in), as PyTorch has them, or (in, out); auto (default): as the file says, "
              "else out-in",
              .names = layouts),
    LG_FIELD_END};

/* A layer y = x W + b; weight is (in, out). */
typedef struct layer {
    char name[128];
    size_t in, out;
    double *weight, *bias; /* bias is NULL if the layer has none */
} layer;

typedef struct network {
    layer layers[MOST_LAYERS];
    size_t count;
    /* The order of a file's layers was decided by names that differ in more than their numbers. */
    bool by_name;
} network;

/* ---- layers from tensors ---- */

/* Sorts "net.10.weight" behind "net.2.weight". */
static int compare_layers(const void *a, const void *b) {
    return strverscmp(((const layer *)a)->name, ((const layer *)b)->name);
}

/* The layer's name in a tensor's name: "net.2" for "net.2.weight", "2" for "weight2". */
static void stem_of(const char *name, char *out) {
    const char *dot = strrchr(name, '.');
    while (dot == NULL && isalpha((unsigned char)*name)) name++;
    const size_t length = dot != NULL ? (size_t)(dot - name) : strlen(name);
    memcpy(out, name, length);
    out[length] = '\0';
}

/* Returns whether the two names differ only in their numbers. */
static bool are_numbered(const char *a, const char *b) {
    const char *const digits = "0123456789";
    while (*a != '\0' && *b != '\0') {
        const size_t m = strspn(a, digits), n = strspn(b, digits);
        if ((m > 0) != (n > 0) || (m == 0 && *a != *b)) return false;
        a += m > 0 ? m : 1;
        b += n > 0 ? n : 1;
    }
    return *a == *b;
}

static double *transposed(const double *from, size_t rows, size_t columns) {
    double *to = app_alloc(rows * columns, sizeof *to);
    for (size_t r = 0; r < rows; r++)
        for (size_t c = 0; c < columns; c++) to[c * rows + r] = from[r * columns + c];
    return to;
}

static void add_weight(network *n, const char *name, const double *from, size_t rows, size_t columns,
                       bool inputs_first) {
    layer *l = &n->layers[n->count++];
    *l = (layer){.in = inputs_first ? rows : columns, .out = inputs_first ? columns : rows};
    (void)snprintf(l->name, sizeof l->name, "%s", name);
    l->weight = inputs_first ? transposed(from, 1, rows * columns) : transposed(from, rows, columns);
}

static bool inputs_first_of(bool told) {
    return values.layout == LAYOUT_IN_OUT || (values.layout == LAYOUT_AUTO && told);
}

/* Assigns the biases of the file to the layers from index `first` on. */
static void take_biases(const app *self, const char *path, const lg_tensors *tensors, network *n,
                        size_t first) {
    char stem[128];
    for (size_t i = 0; i < tensors->count; i++) {
        const lg_tensor *t = &tensors->tensor[i];
        layer *of = NULL;
        if (t->rank != 1) continue;
        stem_of(t->name, stem);
        for (size_t k = first; k < n->count; k++)
            if (strcmp(n->layers[k].name, stem) == 0) of = &n->layers[k];
        if (of == NULL || of->bias != NULL || t->count != of->out)
            app_stop(self, LG_FORMAT,
                     "%s: tensor '%s' is the bias of no layer: STEM.bias needs a STEM.weight and one number "
                     "for each output",
                     path, t->name);
        of->bias = transposed(t->values, 1, t->count);
    }
}

/* Checks a weight. The weights of a table network are refused: it has a linear part beside its layers, and
 * scales, so that it is not a chain of layers. */
static void check_weight(const app *self, const char *path, const lg_tensors *tensors, const lg_tensor *t,
                         size_t layers) {
    if (tensors->inputs_first && strcmp(t->name, "linear.weight") == 0)
        app_stop(self, LG_FORMAT,
                 "%s: was written by lg-export from a table network, which adds the linear part '%s' to its "
                 "layers: it is not a chain of layers and cannot be imported; use the model itself",
                 path, t->name);
    if (t->rank != 2 || t->count == 0 || layers == MOST_LAYERS)
        app_stop(self, LG_FORMAT,
                 "%s: tensor '%s' is not the weight of a dense layer: expected rank 2 and at most %d layers",
                 path, t->name, MOST_LAYERS);
}

static void sort_layers(network *n, size_t first) {
    qsort(n->layers + first, n->count - first, sizeof n->layers[0], compare_layers);
    for (size_t i = first + 1; i < n->count; i++)
        n->by_name = n->by_name || !are_numbered(n->layers[i - 1].name, n->layers[i].name);
}

static void take_tensors(const app *self, const char *path, network *n) {
    APP_CLEAN(lg_tensors_destroy) lg_tensors tensors = {0};
    char stem[128];
    const size_t first = n->count;
    APP_MUST_FILE(self, path, lg_tensors_read(self->context, path, &tensors, &error));
    for (size_t i = 0; i < tensors.count; i++) {
        const lg_tensor *t = &tensors.tensor[i];
        if (t->rank == 1) continue;
        check_weight(self, path, &tensors, t, n->count);
        stem_of(t->name, stem);
        add_weight(n, stem, t->values, t->dims[0], t->dims[1], inputs_first_of(tensors.inputs_first));
    }
    sort_layers(n, first);
    take_biases(self, path, &tensors, n, first);
}

/* ---- layers from numpy files: a weight, then its bias, then the next weight ---- */

/* Reads all columns of a file into one array. */
static void read_array(const app *self, const char *path, lg_table_data *out) {
    APP_CLEAN(lg_table_names_destroy) lg_table_names names = {0};
    APP_MUST_FILE(self, path, lg_table_names_read(self->context, path, NULL, &names, &error));
    APP_FREE const char **columns = app_alloc(names.count, sizeof *columns);
    for (uint32_t i = 0; i < names.count; i++) columns[i] = names.name[i];
    APP_MUST_FILE(self, path,
                  lg_table_read(self->context, path, columns, names.count, NULL, NULL, out, &error));
}

static bool is_bias_of(const layer *l, const lg_table_data *data) {
    return l->bias == NULL && (data->columns == 1 || data->rows == 1) && data->rows * data->columns == l->out;
}

/* The name of a file without folder and ending: "W1" for "net/W1.npy". */
static void name_of_file(const char *path, char *out, size_t size) {
    const char *slash = strrchr(path, '/'), *name = slash != NULL ? slash + 1 : path,
               *dot = strrchr(name, '.');
    (void)snprintf(out, size, "%.*s", (int)(dot != NULL && dot > name ? dot - name : (long)strlen(name)),
                   name);
}

static void take_array(const app *self, const char *path, network *n) {
    APP_CLEAN(lg_table_data_destroy) lg_table_data data = {0};
    char name[128];
    layer *last = n->count > 0 ? &n->layers[n->count - 1] : NULL;
    read_array(self, path, &data);
    name_of_file(path, name, sizeof name);
    if (last != NULL && is_bias_of(last, &data))
        last->bias = transposed(data.values, 1, last->out);
    else if (n->count < MOST_LAYERS)
        add_weight(n, name, data.values, data.rows, data.columns, inputs_first_of(false));
    else
        app_stop(self, LG_FORMAT, "%s: is the weight of one layer too many; at most %d are possible", path,
                 MOST_LAYERS);
}

/* ---- the order of the layers ---- */

static void add_names(const network *n, lg_text *to) {
    for (size_t i = 0; i < n->count; i++) lg_text_add(to, "%s%s", i > 0 ? "," : "", n->layers[i].name);
}

/* Orders the layers by --layers, which must name each layer once. */
static void order_layers(const app *self, network *n) {
    if (values.layers == NULL) return;
    APP_FREE char *list = app_format("%s", values.layers);
    size_t done = 0, at = 0;
    for (char *save = NULL, *name = strtok_r(list, ",", &save); name != NULL && at < n->count;
         name = strtok_r(NULL, ",", &save)) {
        for (at = done; at < n->count && strcmp(n->layers[at].name, name) != 0;) at++;
        if (at == n->count) break;
        const layer moved = n->layers[at];
        n->layers[at] = n->layers[done];
        n->layers[done++] = moved;
    }
    if (at < n->count && done == n->count) return;
    lg_text names = app_text();
    add_names(n, &names);
    app_stop_usage(self, "--layers: '%s' does not name each layer once; the layers are: %s", values.layers,
                   names.data != NULL ? names.data : "none");
}

/* Returns whether the layers also fit together in another order. The widths w_0 ... w_n are a path through a
 * graph that has an edge per layer. There is another path if two pieces between the same two widths can
 * change places, or if the path is closed and can begin elsewhere (Ukkonen, Theoret. Comput. Sci. 92 (1992)
 * 191). */
static bool has_other_order(const network *n) {
    size_t w[MOST_LAYERS + 1];
    bool other = false;
    for (size_t i = 0; i < n->count; i++) w[i] = n->layers[i].in;
    w[n->count] = n->layers[n->count - 1].out;
    for (size_t i = 0; i <= n->count; i++)
        for (size_t k = i + 1; k <= n->count; k++)
            for (size_t j = i; w[i] == w[k] && j < k; j++)
                for (size_t l = k + 1; l <= n->count; l++) other = other || w[j] == w[l];
    return other || (n->count > 1 && w[0] == w[n->count]);
}

static void warn_order(const app *self, const network *n) {
    if (values.layers != NULL || !n->by_name || !has_other_order(n)) return;
    APP_CLEAN(lg_text_destroy) lg_text names = app_text();
    add_names(n, &names);
    app_warn(self,
             "the layers fit each other in other orders too; they are taken in the order of their names, %s: "
             "give another order with --layers",
             names.data);
}

/* ---- making the program ---- */

static void check_chain(const app *self, const network *n) {
    if (n->count == 0)
        app_stop(self, LG_FORMAT, "%s: there is no tensor that is the weight of a layer", self->arguments[0]);
    for (size_t i = 1; i < n->count; i++) {
        const layer *from = &n->layers[i - 1], *to = &n->layers[i];
        if (from->out != to->in)
            app_stop(self, LG_FORMAT,
                     "layer %zu, %s, gives %zu numbers, layer %zu, %s, takes %zu: give the order of the "
                     "layers with --layers, or another order of files, or --layout %s",
                     i, from->name, from->out, i + 1, to->name, to->in,
                     values.layout == LAYOUT_IN_OUT ? "out-in" : "in-out");
    }
}

/* Records the network on the tape. The parameters are weight1, bias1, weight2, ..., without the biases of
 * layers that have none. */
static lg_status record(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const network *n = user;
    lg_var at = x[0];
    size_t next = 0;
    for (size_t i = 0; i < n->count; i++) {
        at = lg_matmul(tape, at, theta[next++]);
        if (n->layers[i].bias != NULL) at = lg_add(tape, at, theta[next++]);
        at = lg_act(tape, at, (lg_activation)(i + 1 < n->count ? values.activation : values.last));
    }
    y[0] = at;
    return lg_tape_status(tape);
}

typedef struct parameter_list {
    size_t count;
    lg_parameter_spec of[2 * MOST_LAYERS];
    char names[2 * MOST_LAYERS][16];
} parameter_list;

static void add_parameter(parameter_list *list, const char *what, size_t at, lg_shape shape,
                          const double *numbers) {
    char *name = list->names[list->count];
    (void)snprintf(name, sizeof list->names[0], "%s%u", what, (unsigned)(at + 1));
    list->of[list->count++] = (lg_parameter_spec){name, shape, numbers};
}

static lg_status build(const app *self, network *n, lg_program **out, lg_error *error) {
    parameter_list parameters = {.count = 0};
    for (size_t i = 0; i < n->count; i++) {
        const layer *l = &n->layers[i];
        const uint32_t in = (uint32_t)l->in, to = (uint32_t)l->out;
        add_parameter(&parameters, "weight", i, lg_shape2(in, to), l->weight);
        if (l->bias != NULL) add_parameter(&parameters, "bias", i, lg_shape1(to), l->bias);
    }
    const lg_port x = {.name = "x", .shape = lg_shape1((uint32_t)n->layers[0].in)}, y = {.name = "y"};
    const lg_function_spec value = {"value", &x, 1, &y, 1, record, n};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.parameters = parameters.of;
    spec.parameter_count = parameters.count;
    spec.functions = &value;
    spec.function_count = 1;
    spec.description = "a network whose weights were imported";
    return lg_program_build(self->context, &spec, out, error);
}

static void write_program(const app *self, network *n) {
    lg_program *program;
    const lg_provenance provenance = app_provenance(self, self->seed);
    APP_MUST(self, build(self, n, &program, &error));
    APP_MUST_FILE(self, values.out, lg_program_save(self->context, values.out, program, &provenance, &error));
    lg_program_destroy(program);
}

static void report(const app *self, const network *n) {
    size_t parameters = 0;
    app_json out;
    APP_CLEAN(lg_text_destroy) lg_text layers = app_text();
    app_result_begin(&out, self);
    app_result_text(&out, "out", values.out, "a program with the function value");
    app_json_size(&out, "layers", n->count);
    app_json_open(&out, "order", '[');
    for (size_t i = 0; i < n->count; i++) {
        const layer *l = &n->layers[i];
        app_json_text(&out, NULL, l->name);
        lg_text_add(&layers, "%s %s %zu -> %zu", i > 0 ? "," : "", l->name, l->in, l->out);
        parameters += l->in * l->out + (l->bias != NULL ? l->out : 0);
    }
    app_json_close(&out, ']');
    app_result_line(&out, "layers:%s, %s", layers.data, activations[values.activation]);
    app_result_size(&out, "inputs", n->layers[0].in, NULL);
    app_result_size(&out, "outputs", n->layers[n->count - 1].out, NULL);
    app_result_size(&out, "parameters", parameters, NULL);
    app_json_end(&out);
}

static bool is_safetensors(const char *path) {
    const size_t n = strlen(path), m = strlen(".safetensors");
    return n > m && strcmp(path + n - m, ".safetensors") == 0;
}

static void network_destroy(network *n) {
    for (size_t i = 0; i < n->count; i++) {
        free(n->layers[i].weight);
        free(n->layers[i].bias);
    }
}

static int run(app *self) {
    APP_CLEAN(network_destroy) network n = {.count = 0};
    for (int i = 0; i < self->argument_count; i++)
        (is_safetensors(self->arguments[i]) ? take_tensors : take_array)(self, self->arguments[i], &n);
    order_layers(self, &n);
    check_chain(self, &n);
    warn_order(self, &n);
    write_program(self, &n);
    report(self, &n);
    return APP_EXIT_OK;
}

const app_command import_command = {
    .name = "import",
    .arguments = "WEIGHTS.safetensors | W1.npy B1.npy ...",
    .summary = "Make a program of the weights of a network that was trained elsewhere",
    .details = "Dense layers y = sigma(x W + b). A safetensors file has STEM.weight and STEM.bias of each "
               "layer; the layers are taken in the order of their stems, where numbers compare as numbers, "
               "or in the order of --layers; the order is printed. Numpy files are given in the order "
               "weight, bias if there is one, next weight. The program has the function value (x) -> y; "
               "lg-export and liegrad/program.h differentiate, run and export it.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
