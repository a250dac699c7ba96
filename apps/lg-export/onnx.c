/* ONNX (onnx.ai, opset 13): a function of a program as a graph of standard operators. Values that depend on
 * parameters alone are initializers. */
#include <string.h>

#include "lg-export/onnx.h"

enum { IR_VERSION = 8, OPSET = 13 };

/* ---- nodes ---- */

/* Adds a constant that has one row per row of the batch, all rows equal. Returns false if it has another
 * form. */
static bool add_row_constant(onnx_job *j, uint32_t node) {
    const lg_operation *op = &j->g->nodes[node].op;
    int64_t dims[LG_MAX_RANK];
    size_t count = 1;
    if (op->shape[0].rows != 1 || op->shape[0].base != 0) return false;
    dims[0] = 1;
    for (uint32_t k = 1; k < op->rank; k++) count *= (size_t)(dims[k] = op->shape[k].base);
    if (op->real_count > count || count % op->real_count != 0) return false;
    APP_FREE double *values = app_alloc(count, sizeof *values);
    for (size_t i = 0; i < count; i++) values[i] = op->reals[i % op->real_count];
    const onnx_name one = onnx_new_name(j), out = onnx_name_of(j, node);
    onnx_add_reals(j, one.text, dims, op->rank, values, count);
    const onnx_operation o = {.j = j, .op = op, .out = out.text};
    return onnx_give(&o, onnx_for_each_row(j, one, op));
}

static void add_constant(onnx_job *j, uint32_t node) {
    const graph_node *n = &j->g->nodes[node];
    int64_t dims[LG_MAX_RANK];
    for (uint32_t k = 0; k < n->op.rank; k++) dims[k] = n->op.shape[k].base;
    onnx_add_reals(j, onnx_name_of(j, node).text, dims, n->op.rank, n->values, n->count);
}

static lg_status add_nodes(onnx_job *j, const char *file, lg_error *error) {
    for (uint32_t k = 0; k < j->g->count; k++) {
        const graph_node *n = &j->g->nodes[k];
        bool done = true;
        if (!n->needed || strcmp(n->op.name, "input") == 0) continue;
        if (!n->varies)
            add_constant(j, k);
        else if (strcmp(n->op.name, "constant") == 0)
            done = add_row_constant(j, k);
        else
            done = onnx_translate(j, k);
        if (!done)
            return lg_fail(error, LG_UNSUPPORTED,
                           "%s: its operation '%s' has no form in ONNX here; choose another function with "
                           "--functions, or --target c",
                           file, n->op.name);
    }
    return LG_OK;
}

/* ---- the file ---- */

static void add_value_info(onnx_job *j, int field, const char *called, const lg_port *port) {
    text dims = app_text(), tensor = app_text(), type = app_text(), info = app_text();
    for (uint32_t k = 0; k < port->shape.rank + !port->shared; k++) {
        text dim = app_text();
        if (k == 0 && !port->shared)
            proto_text(&dim, 2, "rows");
        else
            proto_whole(&dim, 1, port->shape.dims[k - !port->shared]);
        proto_message(&dims, 1, &dim);
    }
    proto_whole(&tensor, 1, onnx_real_type(j));
    proto_message(&tensor, 2, &dims);
    proto_message(&type, 1, &tensor);
    proto_text(&info, 1, called);
    proto_message(&info, 2, &type);
    proto_message(&j->graph, field, &info);
}

static void write_file(onnx_job *j, const export_source *source, const char *description, text *to) {
    APP_FREE char *producer = app_format("lg-export: %s", source->options->name);
    text opset = app_text();
    proto_whole(to, 1, IR_VERSION);
    proto_text(to, 2, producer);
    proto_text(to, 3, lg_version());
    proto_text(to, 6, description);
    proto_text(&j->graph, 2, source->options->name);
    for (size_t i = 0; i < j->g->input_count; i++)
        add_value_info(j, 11, j->g->inputs[i].name, &j->g->inputs[i]);
    for (size_t o = 0; o < j->g->output_count; o++)
        add_value_info(j, 12, j->g->outputs[o].name, &j->g->outputs[o]);
    to->unfit = j->graph.unfit;
    proto_message(to, 7, &j->graph);
    proto_text(&opset, 1, "");
    proto_whole(&opset, 2, OPSET);
    proto_message(to, 8, &opset);
}

/* Adds nodes that give the results the names of the outputs. */
static void name_outputs(onnx_job *j) {
    for (size_t o = 0; o < j->g->output_count; o++) {
        const onnx_name result = onnx_name_of(j, j->g->results[o]);
        onnx_emit_to(j, j->g->outputs[o].name, "Identity", &result, 1, NULL, 0);
    }
}

/* Chooses single precision if --dtype is not given and onnxruntime has some operation in single precision
 * only. */
static void choose_type(const app *self, const graph *g, export_source *source, export_options *options) {
    const char *single = options->dtype == LG_F64 ? onnx_single_only(g) : NULL;
    if (single == NULL) return;
    if (app_given(self, "dtype")) {
        app_warn(self, "onnxruntime has no %s in double precision: use --dtype f32 with it", single);
        return;
    }
    app_warn(self, "written in single precision: onnxruntime has no %s in double; --dtype f64 writes double",
             single);
    options->dtype = LG_F32;
    source->single = true;
}

static void build(const app *self, const char *path, lg_program *program, export_source *source) {
    static const char *const usual[] = {"value", NULL};
    export_names chosen;
    size_t function;
    graph g;
    lg_error error = {LG_OK, ""};
    export_choose(self, source->options, program, usual, &chosen);
    if (chosen.count > 1 && source->options->functions != NULL)
        app_stop_usage(self, "--functions: an ONNX file has one function; export it for each");
    if (chosen.count > 1)
        app_warn(self, "an ONNX file has one function: this one has %s; --functions chooses another",
                 chosen.name[0]);
    (void)lg_program_find(program, chosen.name[0], &function, NULL);
    lg_status status = graph_make(program, function, &g, &error);
    export_options options = *source->options;
    onnx_job j = {.g = &g, .options = &options, .graph = app_text()};
    if (status == LG_OK) choose_type(self, &g, source, &options);
    if (status == LG_OK) status = add_nodes(&j, source->options->file, &error);
    if (status == LG_OK) {
        name_outputs(&j);
        source->lost += j.graph.lost;
        write_file(&j, source, lg_program_description(program), export_add_file(source, "%s.onnx"));
    }
    lg_text_destroy(&j.graph);
    graph_free(&g);
    app_must(self, status == LG_NOT_FINITE ? LG_FILE : status, &error);
}

const export_target export_target_onnx = {.build = build};
