/* Classes: what detectors, classifications of tables and classical classifiers report about a window or a
 * row. */
#include <math.h>

#include "lg-export/faces.h"

/* ---- code ---- */

static void add_names(export_source *source, const export_window *window) {
    const char *name = source->options->name;
    lg_text_add(&source->code, "\nconst char *const %s_class_names[%s_CLASSES] = {\n", name, name);
    for (uint32_t i = 0; i < window->names.classes; i++) {
        char number[16];
        (void)snprintf(number, sizeof number, "%u", i);
        lg_text_add(&source->code, "    ");
        lg_text_add_literal(&source->code,
                            window->names.class_name != NULL ? window->names.class_name[i] : number);
        lg_text_add(&source->code, ",\n");
    }
    lg_text_add(&source->code, "};\n");
}

/* Number of the class that means "all is well". */
static uint32_t healthy_of(const export_window *window) {
    return window->healthy != NULL ? lg_series_healthy(&window->names, window->healthy) : LG_NO_CLASS;
}

static void add_window(export_source *source, const export_window *window) {
    export_size(source, "CHANNELS", window->names.channels, "signals of a window");
    export_size(source, "LENGTH", window->names.length, "samples of each");
    export_size(source, "CLASSES", window->names.classes, NULL);
    lg_text_add(&source->sizes, "#define %s_RATE ", source->options->name);
    lg_text_add_real(&source->sizes, LG_F64, window->names.rate);
    lg_text_add(&source->sizes, " /* samples per second of the training data%s */\n",
                window->names.rate > 0 ? "" : ", not known");
    if (window->healthy != NULL && window->healthy[0] != '\0')
        lg_text_add(&source->sizes, "#define %s_HEALTHY %u /* the class that means that all is well */\n",
                    source->options->name, healthy_of(window));
}

void export_window_code(export_source *source, const export_window *window) {
    const char *name = source->options->name, *what = window->names.channels > 0 ? "window" : "row";
    if (window->names.channels > 0)
        add_window(source, window);
    else
        export_size(source, "CLASSES", window->names.classes, NULL);
    add_names(source, window);
    lg_text_add(&source->declarations,
                "/* The class of a %s, a number below %s_CLASSES, with the %s of all classes\n"
                " * (%s_CLASSES) or NULL; -1, and NaN, where a number of the %s is not finite, or the "
                "scores overflow.\n * %s */\n"
                "int %s_classify(const %s_real *%s, %s_real *probability, %s_real *work);\n",
                what, name, window->scores != NULL ? window->scores : "probabilities", name, what,
                window->score_words != NULL
                    ? window->score_words
                    : "It is the one of the largest probability: of two equal ones class 1,\n"
                      " * of more the first.",
                name, name, what, name, name);
    lg_text_add_named(&source->declarations, name,
                      "/* Names of the classes, UTF-8. */\nextern const char *const "
                      "NAME_class_names[NAME_CLASSES];\n");
}

void export_window_check(const app *self, const export_source *source, double largest) {
    const double jacobian = (double)source->inputs * (double)source->outputs;
    if (!(fmax(fmax(largest, jacobian), (double)source->work) < 0x1p31))
        app_stop(self, LG_FILE, "%s: too large for the integers of C code: at most 2^31 numbers are possible",
                 source->options->file);
}

/* ---- description in NAME.h ---- */

void export_window_words(export_source *source, const export_window *window) {
    text *to = &source->about;
    lg_text_add(to,
                "inputs x (%llu): a window of %u channels and %u samples each, x[channel * %u + "
                "sample].\nThe window is as recorded: the code scales it.\n",
                (unsigned long long)window->names.channels * window->names.length, window->names.channels,
                window->names.length, window->names.length);
    for (uint32_t i = 0; i < window->names.channels; i++)
        lg_text_add(to, "  channel %-5u %s\n", i,
                    window->names.channel_name != NULL && window->names.channel_name[i][0] != '\0'
                        ? window->names.channel_name[i]
                        : "(no name)");
    if (window->names.rate > 0)
        lg_text_add(to, "Sampled at %.12g Hz: a window is %.6g s.\n", window->names.rate,
                    window->names.length / window->names.rate);
    export_units(source, "those of the training data, channel by channel");
    lg_text_add(to, "\n");
}

void export_window_score_words(text *to, const export_window *window) {
    const uint32_t healthy = healthy_of(window);
    for (uint32_t i = 0; i < window->names.classes; i++)
        lg_text_add(to, "  class %-7u %s%s\n", i, window->names.class_name[i],
                    i != healthy                 ? ""
                    : window->healthy[0] == '\0' ? " (healthy, by its name)"
                                                 : " (healthy)");
    if (window->healthy != NULL && healthy == LG_NO_CLASS)
        lg_text_add(to, "  It is unknown which class means that all is well.\n");
}

/* ---- golden vectors ---- */

/* Bytes of NAME_test.c that golden vectors may take, and the bytes of one number there. */
enum { TEST_BYTES = 1600000, NUMBER_BYTES = 25 };

void export_window_golden(export_source *source, size_t further) {
    const double numbers =
        (double)source->inputs * (1 + (double)source->outputs) + (double)source->outputs + (double)further;
    const double fit = floor(TEST_BYTES / (numbers * NUMBER_BYTES));
    export_options fewer = *source->options;
    const export_options *options = source->options;
    if (fit < (double)fewer.golden) fewer.golden = fit < 1 ? 1 : (uint64_t)fit;
    source->options = &fewer;
    export_golden_make(source, true);
    source->options = options;
}

void export_draw_channel(export_model *m, double mean, double size, size_t channel, double *x) {
    const size_t length = m->window.names.length;
    for (size_t i = channel * length; i < (channel + 1) * length; i++)
        x[i] = (double)(float)export_round(m->source->options, mean + size * lg_rng_normal(&m->rng));
}

bool export_window_clear(const double *score, uint32_t classes) {
    uint32_t best = 0;
    for (uint32_t i = 1; i < classes; i++)
        if (score[i] > score[best]) best = i;
    for (uint32_t i = 0; i < classes; i++)
        if (i != best && !(score[best] - score[i] > 1e-3)) return false;
    return true;
}

/* ---- the face ---- */

static bool has_classes(const export_model *m) {
    return m->window.names.classes > 1 && export_has(m, &export_face_value);
}

static void classes_code(export_model *m) {
    export_source *source = m->source;
    const size_t scores = ((size_t)m->window.names.classes + 7) / 8 * 8,
                 classify = scores + export_work_of(m, "probability"), value = export_work_of(m, "value"),
                 most = value > classify ? value : classify;
    if (most > source->work) source->work = most;
    if (m->window.names.channels > 0)
        export_size(source, "EVAL_WORK_SIZE", most, "numbers of work that suffice for all but the gradient");
    export_constant(source, "AT_NET", scores);
    export_code(source, "detector_class");
    export_code(source, "detector_main");
    export_window_code(source, &m->window);
    export_test_code(source, "test_detector");
}

bool export_draw_classes(export_model *m, size_t v) {
    const uint32_t classes = m->window.names.classes;
    double *score = m->scores + v * (classes + 1);
    export_evaluate(&m->probability, m->source->golden.x + v * m->source->inputs, score);
    score[classes] = lg_metrics_class(score, classes);
    return export_window_clear(score, classes);
}

const export_face export_face_classes = {.functions = {{"probability", "probability", false}},
                                         .fits = has_classes,
                                         .code = classes_code,
                                         .stack = 1024,
                                         .calls = 2};
