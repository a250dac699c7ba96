/* Table networks: golden rows like the training data, and the description in NAME.h. */
#include <math.h>

#include "lg-export/faces.h"
#include "liegrad/table.h"

static bool is_regression(const lg_table_file *file) {
    return file->run.model.options.task == LG_TABLE_REGRESSION;
}

static size_t depth_of(const void *contents) {
    const lg_net *net = &((const lg_table_file *)contents)->run.model.net;
    const size_t steps = net->kind == LG_NET_RESNET || net->kind == LG_NET_MULT_AFFINE ? 2 : 1;
    return 1 + steps * net->layers + 1 + 2; /* The last two are the scaling of inputs and outputs. */
}

static void draw(export_model *m, double *x, size_t v) {
    const lg_table_file *file = m->file->contents;
    for (size_t c = 0; c < m->source->inputs; c++) {
        x[c] = file->inputs.mean[c] + file->inputs.scale[c] * lg_rng_normal(&m->rng);
        if (file->low != NULL) x[c] = fmax(x[c], file->low[c]);
        if (file->high != NULL) x[c] = fmin(x[c], file->high[c]);
    }
}

static void give_names(const void *contents, export_window *out) {
    out->names.class_name = ((const lg_table_file *)contents)->output_name;
}

/* ---- description in NAME.h ---- */

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

static void tell(export_model *m) {
    const lg_table_file *file = m->file->contents;
    export_source *source = m->source;
    const lg_table_options *options = &file->run.model.options;
    text *to = &source->about;
    lg_text_add(to, "Table network: %s of the rows of a table.\n\n", lg_table_task_name(options->task));
    add_columns(to, file);
    export_units(source, "those of the table");
}

const export_kind export_kind_table = {.recipe = &lg_recipe_table,
                                       .stream = 0x7461626c,
                                       .draw = draw,
                                       .depth = depth_of,
                                       .window = give_names,
                                       .tell = tell};
