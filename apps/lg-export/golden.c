/* Golden vectors: their memory and their text. */
#include "lg-export/export.h"

#include <math.h>
#include <string.h>

void export_golden_make(export_source *source, bool jacobian) {
    const size_t count = (size_t)source->options->golden;
    source->golden = (export_golden){.count = count};
    source->golden.x = app_keep(count * source->inputs, sizeof(double));
    source->golden.y = app_keep(count * source->outputs, sizeof(double));
    if (jacobian)
        source->golden.jacobian = app_keep(count * source->outputs * source->inputs, sizeof(double));
}

double *export_golden_further(export_source *source, size_t size, const char *name) {
    export_golden *golden = &source->golden;
    double *values = app_keep(golden->count * size, sizeof *values);
    golden->further[golden->furthers].values = values;
    golden->further[golden->furthers++].size = size;
    if (name != NULL) golden->further_name = name;
    return values;
}

/* All further results of each vector, one behind the other; *size: how many a vector has. */
static double *join_further(const export_golden *golden, size_t *size) {
    *size = 0;
    for (size_t f = 0; f < golden->furthers; f++) *size += golden->further[f].size;
    double *all = app_alloc(golden->count * *size, sizeof *all), *to = all;
    for (size_t v = 0; v < golden->count; v++)
        for (size_t f = 0; f < golden->furthers; to += golden->further[f++].size)
            memcpy(to, golden->further[f].values + v * golden->further[f].size,
                   golden->further[f].size * sizeof *to);
    return all;
}

void export_test_begin(const export_source *source, size_t count, text *to) {
    lg_text_add(to, "enum { GOLDEN = %zu };\n#define EPSILON %s\n\n%s\n", count,
                source->options->dtype == LG_F32 ? "(double)FLT_EPSILON" : "DBL_EPSILON",
                export_fragment_text("test_types"));
}

void export_test_end(const export_source *source, const text *rows, size_t largest, text *to) {
    lg_text_add(to,
                "\nstatic const function functions[] = {\n%s    {NULL, NULL, NULL, NULL, 0, 0, 0, NULL}};\n"
                "enum { LARGEST = %zu };\n\n",
                rows->data, largest > 0 ? largest : 1);
    lg_text_add_named(to, source->options->name, export_fragment_text("test_main"));
}

void export_golden_write(const export_source *source, text *to) {
    const export_golden *golden = &source->golden;
    const char *name = source->options->name;
    const size_t in = source->inputs, out = source->outputs, all = out * in;
    size_t extras;
    APP_FREE double *extra = join_further(golden, &extras);
    const struct {
        const char *id, *name, *array, *call;
        const double *values;
        size_t size;
    } rows[] = {{"value", "value", "value", "eval(x, y, work)", golden->y, out},
                {"gradient", "gradient", "gradient", "grad(x, NULL, y, work)", golden->jacobian, all},
                {"both", "value with gradient", "value", "grad(x, y, other, work)", golden->jacobian, out},
                {"extra", golden->further_name, "extra", "extra(x, y, work)", extra, extras}};
    text table = app_text();
    size_t largest = 0;
    export_test_begin(source, golden->count, to);
    export_reals(source, to, "golden_x", golden->x, golden->count * in);
    lg_text_add(to, "%s\n", source->test.data != NULL ? source->test.data : "");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        APP_FREE char *array = app_format("golden_%s", rows[i].array);
        const size_t size = rows[i].size, other = i == 2 ? all : 1;
        if (rows[i].values == NULL || size == 0) continue;
        if (i != 2) export_reals(source, to, array, rows[i].values, golden->count * size);
        lg_text_add(to,
                    "static void run_%s(const real *x, real *y, int only, real *work) {\n"
                    "    static real other[%zu];\n    (void)only, (void)other;\n    %s%s%s;\n}\n"
                    "static const result outputs_of_%s[] = {{\"\", -1, 0, %zu}, {NULL, 0, 0, 0}};\n",
                    rows[i].id, other, i < 3 ? name : "", i < 3 ? "_" : "", rows[i].call, rows[i].id, size);
        lg_text_add(&table, "    {");
        lg_text_add_literal(&table, rows[i].name);
        lg_text_add(&table, ", run_%s, golden_x, %s, %zu, %zu, %s_TOLERANCE, outputs_of_%s},\n", rows[i].id,
                    array, in, size, name, rows[i].id);
        if (size > largest) largest = size;
    }
    export_test_end(source, &table, largest, to);
    lg_text_destroy(&table);
}

double export_squares(const export_options *options, const double *values, size_t count) {
    double sum = 0;
    for (size_t i = 0; values != NULL && i < count; i++) {
        const double value = export_round(options, values[i]);
        sum += value * value;
    }
    return sum;
}

bool export_golden_fits(const export_source *source) {
    const export_golden *golden = &source->golden;
    const export_options *options = source->options;
    const size_t in = golden->count * source->inputs, out = golden->count * source->outputs;
    size_t extras;
    APP_FREE double *extra = join_further(golden, &extras);
    return isfinite(export_squares(options, golden->x, in)) &&
           isfinite(export_squares(options, golden->y, out)) &&
           isfinite(export_squares(options, golden->jacobian, out * source->inputs)) &&
           isfinite(export_squares(options, extra, golden->count * extras));
}
