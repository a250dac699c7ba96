/* lg-fit import: a network that was trained elsewhere, from its weights, as a program. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "core/text.h"
#include "lg-fit/fit.h"
#include "liegrad/activation.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"

enum { MOST_LAYERS = 64 };

typedef struct import_values {
    const char *out, *layers;
    int activation, last, layout;
} import_values;

/* lg_activation, in its order. */
static const char *const activations[] = {"identity", "tanh",       "sigmoid", "swish",
                                          "relu",     "leaky-relu", "sine",    NULL};
_Static_assert(LG_COUNT(activations) == LG_ACTIVATION_COUNT + 1, "a name for each activation");
static const char *const layouts[] = {"auto", "out-in", "in-out", NULL};
enum { LAYOUT_AUTO, LAYOUT_OUT_IN, LAYOUT_IN_OUT };

static import_values values;

static const lg_field options[] = {
    LG_OPTION(import_values, out, STRING, "MODEL.h5", "Write the network here (required)"),
    LG_OPTION(import_values, layers, STRING, "A,B,...",
              "The layers in their order from input to output, by their stems (numpy files: by their names "
              "without ending); default: by the numbers and letters of the stems, files as given"),
    LG_OPTION(import_values, activation, NAME, NULL, "Between the layers", .names = activations,
              .value = "tanh"),
    LG_OPTION(import_values, last, NAME, NULL, "After the last layer", .names = activations,
              .value = "identity"),
    LG_OPTION(import_values, layout, NAME, NULL,
              "Weights are (out, in), as PyTorch has them, or (in, out); auto (default): as the file says, "
              "else out-in",
              .names = layouts),
    LG_FIELD_END};

/* A layer y = x W + b; weight (in, out). */
typedef struct layer {
    char name[128];
    size_t in, out;
    double *weight, *bias; /* bias NULL: none */
} layer;

typedef struct network {
    layer layers[MOST_LAYERS];
    size_t count;
    bool by_name; /* names that do not count through put the layers of a file in order */
} network;

/* ---- layers from tensors ---- */

/* "net.10.weight" behind "net.2.weight". */
static int compare_names(const char *a, const char *b) {
    while (*a != '\0' && *b != '\0') {
        if (isdigit((unsigned char)*a) && isdigit((unsigned char)*b)) {
            char *end_a, *end_b;
            const unsigned long long x = strtoull(a, &end_a, 10), y = strtoull(b, &end_b, 10);
            if (x != y) return x < y ? -1 : 1;
            a = end_a;
            b = end_b;
        } else if (*a != *b) {
            return *a < *b ? -1 : 1;
        } else {
            a++;
            b++;
        }
    }
    return (*a != '\0') - (*b != '\0');
}

static int compare_layers(const void *a, const void *b) {
    return compare_names(((const layer *)a)->name, ((const layer *)b)->name);
}

/* "net.2" of "net.2.weight", "2" of "weight2". */
static void stem_of(const char *name, char *out) {
    const char *dot = strrchr(name, '.');
    while (dot == NULL && isalpha((unsigned char)*name)) name++;
    const size_t length = dot != NULL ? (size_t)(dot - name) : strlen(name);
    memcpy(out, name, length);
    out[length] = '\0';
}

/* Whether they differ in numbers alone. */
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

/* Biases of the layers from `first` on. */
static int take_biases(const app *self, const char *path, const lg_tensors *tensors, network *n,
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
            return app_fail(self, LG_FORMAT,
                            "%s: tensor '%s' is the bias of no layer: expected is STEM.bias beside "
                            "STEM.weight, with a number for each output",
                            path, t->name);
        of->bias = transposed(t->values, 1, t->count);
    }
    return APP_EXIT_OK;
}

/* A table network has a linear part beside its layers, and scales: its weights alone are no chain. */
static int check_tensor(const app *self, const char *path, const lg_tensors *tensors, const lg_tensor *t) {
    if (tensors->inputs_first && strcmp(t->name, "linear.weight") == 0)
        return app_fail(self, LG_FORMAT,
                        "%s: was written by lg-export from a table network, whose linear part '%s' stands "
                        "beside its layers: it is no chain of layers; use the model itself",
                        path, t->name);
    return APP_EXIT_OK;
}

static void sort_layers(network *n, size_t first) {
    qsort(n->layers + first, n->count - first, sizeof n->layers[0], compare_layers);
    for (size_t i = first + 1; i < n->count; i++)
        n->by_name = n->by_name || !are_numbered(n->layers[i - 1].name, n->layers[i].name);
}

static int take_tensors(const app *self, const char *path, network *n) {
    lg_tensors tensors;
    lg_error error = {LG_OK, ""};
    int code = APP_EXIT_OK;
    char stem[128];
    const size_t first = n->count;
    const lg_status status = lg_tensors_read(self->context, path, &tensors, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    for (size_t i = 0; i < tensors.count && code == APP_EXIT_OK; i++) {
        const lg_tensor *t = &tensors.tensor[i];
        if (t->rank == 1) continue;
        code = check_tensor(self, path, &tensors, t);
        if (code != APP_EXIT_OK) break;
        stem_of(t->name, stem);
        if (t->rank != 2 || t->count == 0 || n->count == MOST_LAYERS)
            code = app_fail(self, LG_FORMAT,
                            "%s: tensor '%s' is no weight of a dense layer (rank 2, at most %d layers)", path,
                            t->name, MOST_LAYERS);
        else
            add_weight(n, stem, t->values, t->dims[0], t->dims[1], inputs_first_of(tensors.inputs_first));
    }
    sort_layers(n, first);
    if (code == APP_EXIT_OK) code = take_biases(self, path, &tensors, n, first);
    lg_tensors_destroy(&tensors);
    return code;
}

/* ---- layers from numpy files: a weight, then its bias, and so on ---- */

/* All columns of a file as one array. */
static int read_array(const app *self, const char *path, lg_table_data *out) {
    lg_table_names names;
    lg_error error = {LG_OK, ""};
    lg_status status = lg_table_names_read(self->context, path, NULL, &names, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    const char **columns = app_alloc(names.count, sizeof *columns);
    for (uint32_t i = 0; i < names.count; i++) columns[i] = names.name[i];
    status = lg_table_read(self->context, path, columns, names.count, NULL, NULL, out, &error);
    free(columns);
    lg_table_names_destroy(&names);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, path);
}

static bool is_bias_of(const layer *l, const lg_table_data *data) {
    return l->bias == NULL && (data->columns == 1 || data->rows == 1) && data->rows * data->columns == l->out;
}

/* "W1" of "net/W1.npy" */
static void name_of_file(const char *path, char *out, size_t size) {
    const char *slash = strrchr(path, '/'), *name = slash != NULL ? slash + 1 : path,
               *dot = strrchr(name, '.');
    (void)snprintf(out, size, "%.*s", (int)(dot != NULL && dot > name ? dot - name : (long)strlen(name)),
                   name);
}

static int take_array(const app *self, const char *path, network *n) {
    lg_table_data data;
    char name[128];
    layer *last = n->count > 0 ? &n->layers[n->count - 1] : NULL;
    int code = read_array(self, path, &data);
    if (code != APP_EXIT_OK) return code;
    name_of_file(path, name, sizeof name);
    if (last != NULL && is_bias_of(last, &data))
        last->bias = transposed(data.values, 1, last->out);
    else if (n->count < MOST_LAYERS)
        add_weight(n, name, data.values, data.rows, data.columns, inputs_first_of(false));
    else
        code = app_fail(self, LG_FORMAT, "%s: is the weight of one more layer than the %d that there may be",
                        path, MOST_LAYERS);
    lg_table_data_destroy(&data);
    return code;
}

/* ---- the order ---- */

static void add_names(const network *n, lg_text *to) {
    for (size_t i = 0; i < n->count; i++) lg_text_add(to, "%s%s", i > 0 ? "," : "", n->layers[i].name);
}

/* The layer of the name, from `first` on; n->count: none. */
static size_t find_layer(const network *n, size_t first, const char *name) {
    size_t at = first;
    while (at < n->count && strcmp(n->layers[at].name, name) != 0) at++;
    return at;
}

/* --layers: each layer once. */
static int order_layers(const app *self, network *n) {
    if (values.layers == NULL) return APP_EXIT_OK;
    char *list = app_format("%s", values.layers);
    size_t done = 0;
    bool fits = true;
    for (char *save = NULL, *name = strtok_r(list, ",", &save); name != NULL && fits;
         name = strtok_r(NULL, ",", &save)) {
        const size_t at = find_layer(n, done, name);
        fits = at < n->count;
        if (!fits) break;
        const layer moved = n->layers[at];
        n->layers[at] = n->layers[done];
        n->layers[done++] = moved;
    }
    free(list);
    if (fits && done == n->count) return APP_EXIT_OK;
    lg_text names = app_text();
    add_names(n, &names);
    const int code = app_usage(self, "--layers: '%s' does not name each layer once; in some order: %s",
                               values.layers, names.data != NULL ? names.data : "none");
    lg_text_destroy(&names);
    return code;
}

/* Whether the layers make another chain too. The widths w_0 ... w_n are a way through a graph with an edge a
 * layer; there is another way if two pieces between the same two widths can change places, or if the way is
 * closed and can begin elsewhere (Ukkonen, Theoret. Comput. Sci. 92 (1992) 191). */
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
    lg_text names = app_text();
    add_names(n, &names);
    app_warn(self,
             "the layers fit each other in other orders too; taken in the order of their names, %s: give "
             "another with --layers",
             names.data);
    lg_text_destroy(&names);
}

/* ---- the program ---- */

static int check_chain(const app *self, const network *n) {
    if (n->count == 0)
        return app_fail(self, LG_FORMAT, "%s: there is no weight of a layer", self->arguments[0]);
    for (size_t i = 1; i < n->count; i++) {
        const layer *from = &n->layers[i - 1], *to = &n->layers[i];
        if (from->out != to->in)
            return app_fail(
                self, LG_FORMAT,
                "layer %zu, %s, gives %zu numbers, layer %zu, %s, takes %zu: give the order of the "
                "layers with --layers, or another order of files, or --layout %s",
                i, from->name, from->out, i + 1, to->name, to->in,
                values.layout == LAYOUT_IN_OUT ? "out-in" : "in-out");
    }
    return APP_EXIT_OK;
}

/* Parameters: weight1, bias1, ..., those that there are. */
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

static lg_status build(const app *self, network *n, lg_program **out, lg_error *error) {
    lg_parameter_spec parameters[2 * MOST_LAYERS];
    char names[2 * MOST_LAYERS][16];
    size_t count = 0;
    for (size_t i = 0; i < n->count; i++) {
        const layer *l = &n->layers[i];
        (void)snprintf(names[count], sizeof names[count], "weight%u", (unsigned)(i + 1));
        parameters[count] =
            (lg_parameter_spec){names[count], lg_shape2((uint32_t)l->in, (uint32_t)l->out), l->weight};
        count++;
        if (l->bias == NULL) continue;
        (void)snprintf(names[count], sizeof names[count], "bias%u", (unsigned)(i + 1));
        parameters[count] = (lg_parameter_spec){names[count], lg_shape1((uint32_t)l->out), l->bias};
        count++;
    }
    const lg_port x = {.name = "x", .shape = lg_shape1((uint32_t)n->layers[0].in)}, y = {.name = "y"};
    const lg_function_spec value = {"value", &x, 1, &y, 1, record, n};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.parameters = parameters;
    spec.parameter_count = count;
    spec.functions = &value;
    spec.function_count = 1;
    spec.description = "a network whose weights were imported";
    return lg_program_build(self->context, &spec, out, error);
}

static int write_program(const app *self, network *n) {
    lg_program *program;
    lg_error error = {LG_OK, ""};
    const lg_provenance provenance = app_provenance(self, self->seed);
    lg_status status = build(self, n, &program, &error);
    if (status != LG_OK) return app_fail(self, status, "%s", error.message);
    status = lg_program_save(self->context, values.out, program, &provenance, &error);
    lg_program_destroy(program);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, values.out);
}

static void report(const app *self, const network *n) {
    size_t parameters = 0;
    for (size_t i = 0; i < n->count; i++)
        parameters += n->layers[i].in * n->layers[i].out + (n->layers[i].bias != NULL ? n->layers[i].out : 0);
    if (self->json) {
        app_json json;
        app_json_begin(&json);
        app_json_text(&json, "out", values.out);
        app_json_size(&json, "layers", n->count);
        app_json_open(&json, "order", '[');
        for (size_t i = 0; i < n->count; i++) app_json_text(&json, NULL, n->layers[i].name);
        app_json_close(&json, ']');
        app_json_size(&json, "inputs", n->layers[0].in);
        app_json_size(&json, "outputs", n->layers[n->count - 1].out);
        app_json_size(&json, "parameters", parameters);
        app_json_end(&json);
        return;
    }
    (void)printf("%s: a program with the function value:", values.out);
    for (size_t i = 0; i < n->count; i++) (void)printf(" %zu -", n->layers[i].in);
    (void)printf(" %zu, %zu parameters, %s\n", n->layers[n->count - 1].out, parameters,
                 activations[values.activation]);
    (void)printf("layers:");
    for (size_t i = 0; i < n->count; i++)
        (void)printf("%s %s %zu -> %zu", i > 0 ? "," : "", n->layers[i].name, n->layers[i].in,
                     n->layers[i].out);
    (void)printf("\n");
}

static bool is_safetensors(const char *path) {
    const size_t n = strlen(path), m = strlen(".safetensors");
    return n > m && strcmp(path + n - m, ".safetensors") == 0;
}

static int run(app *self) {
    network *n = app_alloc(1, sizeof *n);
    const app_path out = {"out", values.out, LG_FILE_WRITTEN};
    int code = values.out == NULL ? app_usage(self, "--out is missing: give a file for the network")
                                  : app_check_outputs(self, &out, 1);
    for (int i = 0; i < self->argument_count && code == APP_EXIT_OK; i++)
        code = (is_safetensors(self->arguments[i]) ? take_tensors : take_array)(self, self->arguments[i], n);
    if (code == APP_EXIT_OK) code = order_layers(self, n);
    if (code == APP_EXIT_OK) code = check_chain(self, n);
    if (code == APP_EXIT_OK) warn_order(self, n);
    if (code == APP_EXIT_OK) code = write_program(self, n);
    if (code == APP_EXIT_OK) report(self, n);
    for (size_t i = 0; i < n->count; i++) {
        free(n->layers[i].weight);
        free(n->layers[i].bias);
    }
    free(n);
    return code;
}

const app_command import_command = {
    .name = "import",
    .arguments = "WEIGHTS.safetensors | W1.npy B1.npy ...",
    .summary = "Make a program of the weights of a network that was trained elsewhere",
    .details =
        "Dense layers y = sigma(x W + b). A safetensors file has STEM.weight and STEM.bias of each layer; "
        "the "
        "layers follow the order of their stems, numbers in them counted, or --layers; the order is printed. "
        "Numpy files follow each other: a "
        "weight, "
        "its bias if it has one, the next weight. The program has the function value (x) -> y; lg-export and "
        "liegrad/program.h differentiate, run and export it.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
