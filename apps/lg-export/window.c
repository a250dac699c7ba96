/* Windows of sensor data: what detectors and classical classifiers say of them. */
#include "lg-export/window.h"

#include <math.h>
#include <string.h>

/* ---- code ---- */

void export_window_code(export_source *source, const export_window *window) {
    const char *name = source->options->name;
    export_size(source, "CHANNELS", window->channels, "signals of a window");
    export_size(source, "LENGTH", window->length, "samples of each");
    export_size(source, "CLASSES", window->classes, NULL);
    lg_text_add(&source->sizes, "#define %s_RATE ", name);
    lg_text_add_real(&source->sizes, LG_F64, window->rate);
    lg_text_add(&source->sizes, " /* samples a second of the training data%s */\n",
                window->rate > 0 ? "" : ", not known");
    lg_text_add(&source->code, "\nconst char *const %s_class_names[%s_CLASSES] = {\n", name, name);
    for (uint32_t i = 0; i < window->classes; i++) {
        lg_text_add(&source->code, "    ");
        lg_text_add_literal(&source->code, window->class_name[i]);
        lg_text_add(&source->code, ",\n");
    }
    lg_text_add(&source->code, "};\n");
    lg_text_add(&source->declarations,
                "/* The class of a window, a number below %s_CLASSES, with the %s of all classes\n"
                " * (%s_CLASSES) or NULL; -1, and NaN, where a number of the window is not finite, or the "
                "scores overflow.\n * %s */\n",
                name, window->scores, name, window->score_words);
    lg_text_add_named(&source->declarations, name,
                      "int NAME_classify(const NAME_real *window, NAME_real *probability, NAME_real "
                      "*work);\n/* Names of the classes, UTF-8. */\nextern const char *const "
                      "NAME_class_names[NAME_CLASSES];\n");
}

int export_window_check(const app *self, const export_source *source, double largest) {
    const double jacobian = (double)source->inputs * (double)source->outputs;
    if (fmax(fmax(largest, jacobian), (double)source->work) < 0x1p31) return APP_EXIT_OK;
    (void)app_fail(self, LG_UNSUPPORTED, "%s: too large for the integers of C code, 2^31 numbers at most",
                   source->options->file);
    return APP_EXIT_FILE;
}

/* ---- words ---- */

void export_window_words(export_source *source, const export_window *window) {
    text *to = &source->about;
    lg_text_add(to,
                "inputs x (%llu): a window of %u channels and %u samples each, x[channel * %u + "
                "sample].\nThe window is as recorded: the code scales it.\n",
                (unsigned long long)window->channels * window->length, window->channels, window->length,
                window->length);
    for (uint32_t i = 0; i < window->channels; i++)
        lg_text_add(to, "  channel %-5u %s\n", i,
                    window->channel_name != NULL && window->channel_name[i][0] != '\0'
                        ? window->channel_name[i]
                        : "(no name)");
    if (window->rate > 0)
        lg_text_add(to, "Sampled at %.12g Hz: a window is %.6g s.\n", window->rate,
                    window->length / window->rate);
    export_units(source, "those of the training data, channel by channel");
    lg_text_add(to, "\n");
}

void export_window_score_words(text *to, const export_window *window) {
    for (uint32_t i = 0; i < window->classes; i++)
        lg_text_add(to, "  class %-7u %s\n", i, window->class_name[i]);
    if (isfinite(window->accuracy))
        lg_text_add(to, "accuracy      %.6g on the test part, F1 %.6g (mean over the classes)\n",
                    window->accuracy, window->f1);
    else
        lg_text_add(to, "accuracy      unknown: there was no test part\n");
}

/* ---- golden vectors ---- */

/* Bytes of NAME_test.c that golden vectors may take, and those of one number. */
enum { TEST_BYTES = 1600000, NUMBER_BYTES = 25 };

void export_window_golden(export_source *source, size_t extras, const char *extra_name) {
    const double numbers =
        (double)source->inputs * (1 + (double)source->outputs) + (double)source->outputs + (double)extras;
    const double fit = floor(TEST_BYTES / (numbers * NUMBER_BYTES));
    export_options fewer = *source->options;
    const export_options *options = source->options;
    if (fit < (double)fewer.golden) fewer.golden = fit < 1 ? 1 : (uint64_t)fit;
    source->options = &fewer;
    export_golden_make(source, true, extras, extra_name);
    source->options = options;
}

float export_window_number(const export_source *source, double value) {
    return (float)export_round(source->options, value);
}

bool export_window_clear(const double *score, uint32_t classes) {
    uint32_t best = 0;
    for (uint32_t i = 1; i < classes; i++)
        if (score[i] > score[best]) best = i;
    for (uint32_t i = 0; i < classes; i++)
        if (i != best && !(score[best] - score[i] > 1e-3)) return false;
    return true;
}
