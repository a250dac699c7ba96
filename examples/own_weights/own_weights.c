/* own_weights: makes a program of the weights of a network that was trained elsewhere, such as by PyTorch.
 * The program has the function `value` (x) -> y, which lg-export, lg_program_load and lg_model_load take.
 *   own_weights MODEL.h5 NET.safetensors net.0 net.2      the layers in order: net.0.weight, net.0.bias, ...
 *   own_weights MODEL.h5 W1.npy b1.npy W2.npy b2.npy      the weight and the bias of each layer in order
 * In safetensors files a layer may have no bias. The activations may be changed here, and the shape of the
 * weights in numpy files: (out, in), or (in, out). */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <liegrad/ops.h>
#include <liegrad/program.h>
#include <liegrad/table.h>

static const lg_activation inner = LG_TANH, last = LG_IDENTITY;
static const bool numpy_in_out = false;
enum { MOST = 64 };
static lg_error error;

static void stop(const char *name, const char *what) {
    (void)fprintf(stderr, "own_weights: %s: %s\n", name, what);
    exit(1);
}

static void need(lg_status status) {
    if (status != LG_OK) stop(lg_status_name(status), error.message);
}

/* Layers y = sigma(x W + b). The parameters are the weight and, if there is one, the bias of each layer. */
typedef struct network {
    lg_parameter_spec parameter[2 * MOST];
    char name[2 * MOST][16];
    size_t count, layers;
    bool in_out, has_bias[MOST];   /* in_out: the weights are (in, out), else (out, in) */
    uint32_t in, out;              /* of the network that is made of the layers so far */
    lg_tensors tensors;            /* what a safetensors file holds */
    lg_table_data table[2 * MOST]; /* what numpy files hold */
    size_t tables;
} network;

static lg_status record(void *user, lg_tape *tape, const lg_var *w, const lg_var *x, lg_var *y) {
    const network *n = user;
    y[0] = x[0];
    for (size_t i = 0; i < n->layers; i++) {
        y[0] = (n->in_out ? lg_matmul : lg_matmul_nt)(tape, y[0], *w++);
        if (n->has_bias[i]) y[0] = lg_add(tape, y[0], *w++);
        y[0] = lg_act(tape, y[0], i + 1 < n->layers ? inner : last);
    }
    return lg_tape_status(tape);
}

static void add_parameter(network *n, const char *what, lg_shape shape, const double *values) {
    char *name = n->name[n->count];
    (void)snprintf(name, sizeof n->name[0], "%s%zu", what, n->layers + 1);
    n->parameter[n->count++] = (lg_parameter_spec){name, shape, values};
}

/* Adds a layer with a weight (rows, columns), and a bias of `count` numbers unless it is NULL. */
static void add_layer(network *n, const char *name, uint64_t rows, uint64_t columns, const double *weight,
                      const double *bias, size_t count) {
    const uint32_t in = (uint32_t)(n->in_out ? rows : columns), out = (uint32_t)(n->in_out ? columns : rows);
    if (n->layers == MOST) stop(name, "is one layer too many");
    if (n->layers > 0 && in != n->out)
        stop(name, "takes another number of inputs than the layer before it gives; check the order of the "
                   "layers, and whether weights are (in, out)");
    if (bias != NULL && count != out) stop(name, "the bias needs one number for each output");
    if (n->layers == 0) n->in = in;
    n->out = out;
    add_parameter(n, "weight", lg_shape2((uint32_t)rows, (uint32_t)columns), weight);
    if (bias != NULL) add_parameter(n, "bias", lg_shape1(out), bias);
    n->has_bias[n->layers++] = bias != NULL;
}

static const lg_tensor *tensor_of(const network *n, const char *stem, const char *what) {
    const size_t length = strlen(stem);
    for (const lg_tensor *t = n->tensors.tensor; t < n->tensors.tensor + n->tensors.count; t++)
        if (strncmp(t->name, stem, length) == 0 && strcmp(t->name + length, what) == 0) return t;
    return NULL;
}

static void take_tensors(network *n, const char *path, char **stems) {
    need(lg_tensors_read(NULL, path, &n->tensors, &error));
    n->in_out = n->tensors.inputs_first;
    for (; *stems != NULL; stems++) {
        const lg_tensor *w = tensor_of(n, *stems, ".weight"), *b = tensor_of(n, *stems, ".bias");
        if (w == NULL || w->rank != 2) stop(*stems, "has no tensor .weight of rank 2 in the file");
        add_layer(n, *stems, w->dims[0], w->dims[1], w->values, b != NULL ? b->values : NULL,
                  b != NULL ? b->count : 0);
    }
}

/* Reads all columns of a numpy file. */
static const lg_table_data *array_of(network *n, const char *path) {
    lg_table_names names;
    if (n->tables == 2 * MOST) stop(path, "there are too many layers");
    lg_table_data *data = &n->table[n->tables++];
    need(lg_table_names_read(NULL, path, NULL, &names, &error));
    const char **columns = calloc(names.count, sizeof *columns);
    if (columns == NULL) stop(path, "no memory");
    for (uint32_t i = 0; i < names.count; i++) columns[i] = names.name[i];
    need(lg_table_read(NULL, path, columns, names.count, NULL, NULL, data, &error));
    lg_table_names_destroy(&names);
    free(columns);
    return data;
}

static void take_arrays(network *n, char **paths) {
    n->in_out = numpy_in_out;
    for (; paths[0] != NULL; paths += 2) {
        if (paths[1] == NULL) stop(paths[0], "the file of the bias is missing");
        const lg_table_data *w = array_of(n, paths[0]), *b = array_of(n, paths[1]);
        add_layer(n, paths[0], w->rows, w->columns, w->values, b->values, b->rows * b->columns);
    }
}

int main(int argc, char **argv) {
    static network n;
    if (argc < 4)
        return (void)fputs("usage: own_weights MODEL.h5 {NET.safetensors STEM... | W.npy B.npy ...}\n",
                           stderr),
               2;
    if (strstr(argv[2], ".safetensors") != NULL)
        take_tensors(&n, argv[2], argv + 3);
    else
        take_arrays(&n, argv + 2);
    const lg_port x = {.name = "x", .shape = lg_shape1(n.in)}, y = {.name = "y"};
    const lg_function_spec value = {"value", &x, 1, &y, 1, record, &n};
    lg_program_spec spec;
    lg_program *program;
    lg_program_spec_init(&spec);
    spec.parameters = n.parameter, spec.parameter_count = n.count;
    spec.functions = &value, spec.function_count = 1;
    need(lg_program_build(NULL, &spec, &program, &error));
    need(lg_program_save(NULL, argv[1], program, NULL, &error));
    printf("%zu layers, %u inputs, %u outputs\n", n.layers, n.in, n.out);
    lg_program_destroy(program);
    lg_tensors_destroy(&n.tensors);
    for (size_t i = 0; i < n.tables; i++) lg_table_data_destroy(&n.table[i]);
    return 0;
}
