/* own_weights: makes a program of the weights of a network that was trained elsewhere, such as by PyTorch.
 *   own_weights MODEL.h5 NET.safetensors net.0 net.2      the layers in order: net.0.weight, net.0.bias, ...
 *   own_weights MODEL.h5 W1.npy b1.npy W2.npy b2.npy      the weight and the bias of each layer in order
 * In safetensors files a layer may have no bias. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <liegrad/ops.h>
#include <liegrad/program.h>
#include <liegrad/table.h>

static const lg_activation inner = LG_TANH, last = LG_IDENTITY;
static bool inputs_first = false; /* weights in numpy files are (in, out), not (out, in) */

enum { MOST = 128, COLUMNS = 4096 };
static lg_parameter_spec parameter[MOST]; /* of each layer the weight and, if there is one, the bias */
static const char *layer[MOST];           /* the name of the parameter's layer, for messages */
static uint32_t parameters, layers;
static lg_error error;

static void need(bool holds, const char *name, const char *what) {
    if (holds) return;
    (void)fprintf(stderr, "own_weights: %s: %s\n", name, what);
    exit(1);
}

static lg_status record(void *user, lg_tape *tape, const lg_var *w, const lg_var *x, lg_var *y) {
    y[0] = x[0];
    for (uint32_t i = 0; i < parameters;) {
        lg_scope_push(tape, layer[i]);
        const lg_var weight = inputs_first ? w[i] : lg_transpose(tape, w[i]);
        const lg_var bias = ++i < parameters && parameter[i].shape.rank == 1 ? w[i++] : LG_NONE;
        y[0] = lg_dense(tape, y[0], weight, bias, i < parameters ? inner : last);
        lg_scope_pop(tape);
    }
    return lg_tape_status(tape);
}

/* Adds a weight (rank 2) or, if there is one, a bias (rank 1). */
static void add(const char *name, const lg_tensor *t, uint32_t rank) {
    static char names[MOST][16];
    if (rank == 1 && t == NULL) return;
    need(t != NULL && (rank == 1 || t->rank == 2), name, "has no tensor .weight of rank 2 in the file");
    need(parameters < MOST, name, "is one layer too many");
    layers += rank == 2;
    layer[parameters] = name;
    (void)snprintf(names[parameters], sizeof names[0], "%s%u", rank == 2 ? "weight" : "bias", layers);
    const uint32_t rows = (uint32_t)t->dims[0], columns = (uint32_t)t->dims[1];
    const lg_shape shape = rank == 2 ? lg_shape2(rows, columns) : lg_shape1((uint32_t)t->count);
    parameter[parameters] = (lg_parameter_spec){names[parameters], shape, t->values};
    parameters++;
}

static const lg_tensor *tensor_of(const lg_tensors *all, const char *stem, const char *what) {
    const size_t n = strlen(stem);
    for (const lg_tensor *t = all->tensor; t < all->tensor + all->count; t++)
        if (strncmp(t->name, stem, n) == 0 && strcmp(t->name + n, what) == 0) return t;
    return NULL;
}

/* Adds a numpy file. Its values live until the process ends. */
static void add_file(const char *path, uint32_t rank) {
    const char *columns[COLUMNS];
    lg_table_names names;
    lg_table_data data;
    need(lg_table_names_read(NULL, path, NULL, &names, &error) == LG_OK, path, error.message);
    for (uint32_t i = 0; i < names.count && i < COLUMNS; i++) columns[i] = names.name[i];
    need(names.count <= COLUMNS, path, "has too many columns");
    const lg_status read = lg_table_read(NULL, path, columns, names.count, NULL, NULL, &data, &error);
    need(read == LG_OK, path, error.message);
    add(path, &(lg_tensor){"", 2, {data.rows, data.columns}, data.rows * data.columns, data.values}, rank);
    data.values = NULL;
    lg_table_data_destroy(&data);
    lg_table_names_destroy(&names);
}

int main(int argc, char **argv) {
    static lg_tensors all;
    static lg_program *program;
    size_t count;
    if (argc < 4) return (void)fputs("usage: own_weights MODEL.h5 NET.safetensors STEM...\n", stderr), 2;
    const bool numpy = strstr(argv[2], ".safetensors") == NULL;
    need(numpy || lg_tensors_read(NULL, argv[2], &all, &error) == LG_OK, argv[2], error.message);
    need(!numpy || argc % 2 == 0, argv[argc - 1], "the file of the bias is missing");
    if (!numpy) inputs_first = all.inputs_first;
    for (int i = 2; numpy && i < argc; i++) add_file(argv[i], i % 2 == 0 ? 2 : 1);
    for (int i = 3; !numpy && i < argc; i++) {
        add(argv[i], tensor_of(&all, argv[i], ".weight"), 2);
        add(argv[i], tensor_of(&all, argv[i], ".bias"), 1);
    }
    const lg_port x = {.name = "x", .shape = lg_shape1(parameter[0].shape.dims[!inputs_first])};
    const lg_function_spec value = {"value", &x, 1, &(lg_port){.name = "y"}, 1, record, NULL};
    const lg_program_spec spec = {sizeof spec, parameter, parameters, &value, 1, NULL};
    need(lg_program_build(NULL, &spec, &program, &error) == LG_OK, argv[1], error.message);
    need(lg_program_save(NULL, argv[1], program, NULL, &error) == LG_OK, argv[1], error.message);
    printf("%u layers, %u inputs, %u outputs\n", layers, x.shape.dims[0],
           lg_program_outputs(program, 0, &count)->shape.dims[0]);
    lg_tensors_destroy(&all);
    return 0; /* the process ends and frees the rest */
}
