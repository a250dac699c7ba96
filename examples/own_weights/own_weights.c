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

enum { LAYERS = 64, COLUMNS = 4096 };
static lg_parameter_spec parameter[2 * LAYERS]; /* the weight and, if there is one, the bias of each layer */
static uint32_t parameters, layers, out;        /* out: outputs of the last layer so far */
static lg_error error;

static void need(bool holds, const char *name, const char *what) {
    if (holds) return;
    (void)fprintf(stderr, "own_weights: %s: %s\n", name, what);
    exit(1);
}

static lg_status record(void *user, lg_tape *tape, const lg_var *w, const lg_var *x, lg_var *y) {
    (void)user;
    y[0] = x[0];
    for (uint32_t i = 0; i < parameters; i++) {
        const bool bias = parameter[i].shape.rank == 1;
        if (!bias && i > 0) y[0] = lg_act(tape, y[0], inner);
        y[0] = (bias ? lg_add : inputs_first ? lg_matmul : lg_matmul_nt)(tape, y[0], w[i]);
    }
    y[0] = lg_act(tape, y[0], last);
    return lg_tape_status(tape);
}

static void add_parameter(const char *kind, lg_shape shape, const double *values) {
    static char names[2 * LAYERS][16];
    (void)snprintf(names[parameters], sizeof names[0], "%s%u", kind, layers);
    parameter[parameters] = (lg_parameter_spec){names[parameters], shape, values};
    parameters++;
}

static void add_layer(const char *name, const lg_tensor *w, const lg_tensor *b) {
    need(w != NULL && w->rank == 2, name, "has no tensor .weight of rank 2 in the file");
    need(layers++ < LAYERS, name, "is one layer too many");
    const uint32_t rows = (uint32_t)w->dims[0], columns = (uint32_t)w->dims[1];
    need(layers == 1 || out == (inputs_first ? rows : columns), name,
         "takes another number of inputs than the layer before it gives; check the order of the layers, and "
         "whether weights are (in, out)");
    out = inputs_first ? columns : rows;
    need(b == NULL || b->count == out, name, "the bias needs one number for each output");
    add_parameter("weight", lg_shape2(rows, columns), w->values);
    if (b != NULL) add_parameter("bias", lg_shape1(out), b->values);
}

static const lg_tensor *tensor_of(const lg_tensors *all, const char *stem, const char *what) {
    char name[2 * sizeof all->tensor->name];
    (void)snprintf(name, sizeof name, "%s%s", stem, what);
    for (size_t i = 0; i < all->count; i++)
        if (strcmp(all->tensor[i].name, name) == 0) return &all->tensor[i];
    return NULL;
}

/* Reads a numpy file. The values live until the process ends. */
static lg_tensor array_of(const char *path) {
    const char *columns[COLUMNS];
    lg_table_names names;
    lg_table_data data;
    need(lg_table_names_read(NULL, path, NULL, &names, &error) == LG_OK, path, error.message);
    need(names.count <= COLUMNS, path, "has too many columns");
    for (uint32_t i = 0; i < names.count; i++) columns[i] = names.name[i];
    const lg_status status = lg_table_read(NULL, path, columns, names.count, NULL, NULL, &data, &error);
    need(status == LG_OK, path, error.message);
    const lg_tensor made = {"", 2, {data.rows, data.columns}, data.rows * data.columns, data.values};
    data.values = NULL;
    lg_table_data_destroy(&data);
    lg_table_names_destroy(&names);
    return made;
}

int main(int argc, char **argv) {
    static lg_tensors all;
    if (argc < 4)
        return (void)fputs("usage: own_weights MODEL.h5 {NET.safetensors STEM... | W.npy B.npy ...}\n",
                           stderr),
               2;
    const bool numpy = strstr(argv[2], ".safetensors") == NULL;
    if (numpy) {
        for (char **path = argv + 2; *path != NULL; path += 2) {
            need(path[1] != NULL, *path, "the file of the bias is missing");
            add_layer(*path, (lg_tensor[]){array_of(path[0])}, (lg_tensor[]){array_of(path[1])});
        }
    } else {
        need(lg_tensors_read(NULL, argv[2], &all, &error) == LG_OK, argv[2], error.message);
        inputs_first = all.inputs_first;
        for (char **stem = argv + 3; *stem != NULL; stem++)
            add_layer(*stem, tensor_of(&all, *stem, ".weight"), tensor_of(&all, *stem, ".bias"));
    }
    const lg_port x = {.name = "x", .shape = lg_shape1(parameter[0].shape.dims[inputs_first ? 0 : 1])},
                  y = {.name = "y"};
    const lg_function_spec value = {"value", &x, 1, &y, 1, record, NULL};
    lg_program_spec spec;
    lg_program *program;
    lg_program_spec_init(&spec);
    spec.parameters = parameter, spec.parameter_count = parameters;
    spec.functions = &value, spec.function_count = 1;
    need(lg_program_build(NULL, &spec, &program, &error) == LG_OK, argv[1], error.message);
    need(lg_program_save(NULL, argv[1], program, NULL, &error) == LG_OK, argv[1], error.message);
    printf("%u layers, %u inputs, %u outputs\n", layers, x.shape.dims[0], out);
    lg_program_destroy(program);
    lg_tensors_destroy(&all);
    return 0;
}
