/* Golden vectors: their memory and their text. */
#include "lg-export/export.h"

#include <math.h>

void export_golden_make(export_source *source, bool jacobian, size_t extras, const char *extra_name) {
    const size_t count = (size_t)source->options->golden;
    source->golden = (export_golden){.count = count, .extras = extras, .extra_name = extra_name};
    source->golden.x = app_keep(count * source->inputs, sizeof(double));
    source->golden.y = app_keep(count * source->outputs, sizeof(double));
    if (jacobian)
        source->golden.jacobian = app_keep(count * source->outputs * source->inputs, sizeof(double));
    if (extras > 0) source->golden.extra = app_keep(count * extras, sizeof(double));
}

void export_golden_write(const export_source *source, text *to) {
    const export_golden *golden = &source->golden;
    const size_t sizes[] = {source->inputs, source->outputs, source->outputs * source->inputs,
                            golden->extras};
    const double *const tables[] = {golden->x, golden->y, golden->jacobian, golden->extra};
    static const char *const names[] = {"golden_x", "golden_value", "golden_gradient", "golden_extra"};
    size_t largest = 0;
    for (size_t i = 1; i < LG_COUNT(tables); i++)
        if (tables[i] != NULL && sizes[i] > largest) largest = sizes[i];
    lg_text_add(to, "enum { GOLDEN = %zu, LARGEST = %zu };\n", golden->count, largest);
    if (golden->jacobian != NULL) lg_text_add(to, "#define GRADIENT\n");
    if (golden->extras > 0) {
        lg_text_add(to, "#define EXTRAS %zu\n#define EXTRA_NAME ", golden->extras);
        lg_text_add_literal(to, golden->extra_name);
        lg_text_add(to, "\n");
    }
    for (size_t i = 0; i < LG_COUNT(tables); i++)
        if (tables[i] != NULL && sizes[i] > 0)
            export_reals(source, to, names[i], tables[i], golden->count * sizes[i]);
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
    return isfinite(export_squares(options, golden->x, in)) &&
           isfinite(export_squares(options, golden->y, out)) &&
           isfinite(export_squares(options, golden->jacobian, out * source->inputs)) &&
           isfinite(export_squares(options, golden->extra, golden->count * golden->extras));
}
