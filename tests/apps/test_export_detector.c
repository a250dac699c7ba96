/* Detectors exported as C against the library: value, gradient, probabilities and classes of random windows
 * in both types; what is written beside them. */
#include "export_detector.h"

#include <float.h>

enum { ROWS = 1000 };

typedef struct pair {
    lg_model_file file;
    export_library lib;
    void *work, *score_work;
    double *near;
    float *window;
    lg_detector_plan *scores;
} pair;

static void *aligned(size_t bytes) {
    void *memory = aligned_alloc(64, (bytes + 64) / 64 * 64);
    assert_non_null(memory);
    return memory;
}

static void open_pair(pair *p, const sample *of, const char *dtype) {
    char folder[64], name[64], path[1024];
    detector_export(of, dtype, folder, sizeof folder);
    (void)snprintf(name, sizeof name, "%s.h5", of->folder);
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_load(NULL, path, NULL, &p->file, NULL));
    p->lib = export_open(folder, "m", export_has(of->compiler) ? of->compiler : "cc", of->flags);
    const lg_detector_file *file = &p->file.detector;
    p->work = aligned(lg_model_work_size(p->file.model));
    assert_ok(lg_detector_plan_create(NULL, &file->run.model, &file->scaler, file->theta, LG_F64, &p->scores,
                                      NULL));
    p->score_work = aligned(lg_detector_work_size(p->scores));
    p->near = calloc((p->lib.inputs + 1) * (p->lib.outputs + 1) * 2, sizeof(double));
    p->window = calloc(p->lib.inputs, sizeof(float));
    assert_int_equal(p->lib.inputs, lg_model_inputs(p->file.model));
    assert_int_equal(p->lib.outputs, lg_model_outputs(p->file.model));
}

static void close_pair(pair *p) {
    export_close(&p->lib);
    lg_model_file_destroy(&p->file);
    free(p->work);
    free(p->score_work);
    lg_detector_plan_destroy(p->scores);
    free(p->near);
    free(p->window);
}

/* ---- windows ---- */

static bool has_kinks(const lg_cnn *net) {
    bool kinks = net->activation == LG_RELU || net->activation == LG_LEAKY_RELU;
    for (uint32_t i = 0; i < net->blocks; i++) kinks = kinks || net->block[i].pooling == LG_POOL_MAX;
    return kinks;
}

/* Where a kink lies within rounding, the gradient may be that of its other side. */
static bool is_smooth(const pair *p, lg_rng *rng, const double *x) {
    const size_t n = p->lib.inputs, all = n * p->lib.outputs, length = p->file.detector.run.model.net.length;
    const double eps = p->lib.single ? FLT_EPSILON : DBL_EPSILON;
    double *here = p->near, *there = here + all, *moved = there + all, change = 0, sum = 0;
    if (!has_kinks(&p->file.detector.run.model.net)) return true;
    lg_model_jacobian(p->file.model, x, NULL, here, p->work);
    for (int k = 0; k < 2; k++) {
        for (size_t i = 0; i < n; i++)
            moved[i] = x[i] + 16 * eps * lg_rng_normal(rng) * p->file.detector.scaler.scale[i / length];
        lg_model_jacobian(p->file.model, moved, NULL, there, p->work);
        change += pow(export_norm(there, here, all), 2);
        sum += pow(export_norm(here, NULL, all), 2);
    }
    return change <= pow(p->lib.tolerance / 2, 2) * sum;
}

static void draw_window(void *user, lg_rng *rng, double *x) {
    const pair *p = user;
    const lg_detector *model = &p->file.detector.run.model;
    const lg_scaler *scaler = &p->file.detector.scaler;
    do {
        for (size_t c = 0; c < model->net.channels; c++) {
            const double offset = model->centred ? 3 * scaler->scale[c] * lg_rng_normal(rng) : 0;
            for (size_t i = c * model->net.length; i < (c + 1) * model->net.length; i++)
                x[i] = (float)(scaler->mean[c] + offset + scaler->scale[c] * lg_rng_normal(rng));
        }
    } while (!is_smooth(p, rng, x));
}

static void reference(void *user, const double *x, double *y, double *jacobian) {
    const pair *p = user;
    lg_model_jacobian(p->file.model, x, y, jacobian, p->work);
}

/* ---- NAME_classify ---- */

static int call_classify(const pair *p, const double *x, double *probability) {
    const uint32_t classes = p->file.detector.run.model.classes;
    void *in = export_reals(&p->lib, x, p->lib.inputs), *out = export_reals(&p->lib, probability, classes);
    EXPORT_FUNCTION(&p->lib, "classify", int, (const void *, void *, void *), classify);
    export_spoil(&p->lib);
    const int class = classify(in, out, p->lib.work);
    export_doubles(&p->lib, out, probability, classes);
    free(out);
    free(in);
    return class;
}

static void check_classes(pair *p) {
    const lg_detector_file *file = &p->file.detector;
    const uint32_t classes = file->run.model.classes;
    double *x = calloc(p->lib.inputs, sizeof *x), got[8], want[8], worst = 0;
    size_t seen[8] = {0};
    lg_rng rng;
    lg_rng_seed(&rng, 3, 4);
    for (size_t r = 0; r < ROWS; r++) {
        draw_window(p, &rng, x);
        for (size_t i = 0; i < p->lib.inputs; i++) p->window[i] = (float)x[i];
        lg_detector_eval(p->scores, p->window, want, NULL, p->score_work);
        const uint32_t class = lg_class_of(want, classes);
        double second = 0;
        for (uint32_t k = 0; k < classes; k++)
            if (k != class && want[k] > second) second = want[k];
        const int found = call_classify(p, x, got);
        const double error = export_norm(got, want, classes);
        assert_true(error <= p->lib.tolerance * 4);
        worst = fmax(worst, error);
        assert_true(found >= 0 && found < (int)classes);
        assert_int_equal(call_classify(p, x, NULL), found);
        if (want[class] - second > 10 * p->lib.tolerance) assert_int_equal(found, class);
        seen[found]++;
    }
    print_message("  probabilities %.2e; classes", worst);
    for (uint32_t k = 0; k < classes; k++) print_message(" %zu", seen[k]);
    print_message("\n");
    free(x);
}

static void check_names(const pair *p) {
    const uint32_t classes = p->file.detector.run.model.classes;
    const char *const *names = export_symbol(&p->lib, "class_names");
    for (uint32_t k = 0; k < classes; k++) assert_string_equal(names[k], p->file.detector.class_name[k]);
}

/* NAME_EVAL_WORK_SIZE numbers are enough for value and class. */
static void check_small_work(pair *p, const char *folder) {
    const size_t size = (size_t)export_constant(folder, "m", "EVAL_WORK_SIZE");
    const size_t bytes = p->lib.single ? sizeof(float) : sizeof(double), past = p->lib.work_size - size;
    double *x = calloc(p->lib.inputs, sizeof *x), y[8], probability[8];
    unsigned char *work = p->lib.work;
    assert_true(size > 0 && size <= p->lib.work_size);
    void *in = export_reals(&p->lib, x, p->lib.inputs), *out = export_reals(&p->lib, y, p->lib.outputs);
    void *to = export_reals(&p->lib, probability, p->file.detector.run.model.classes);
    EXPORT_FUNCTION(&p->lib, "eval", void, (const void *, void *, void *), eval);
    EXPORT_FUNCTION(&p->lib, "classify", int, (const void *, void *, void *), classify);
    memset(work, 0x5a, p->lib.work_size * bytes);
    eval(in, out, work);
    (void)classify(in, to, work);
    for (size_t i = 0; i < past * bytes; i++) assert_int_equal(work[size * bytes + i], 0x5a);
    free(to);
    free(out);
    free(in);
    free(x);
}

/* NaN anywhere gives NaN. */
static void check_nan(pair *p) {
    double *x = calloc(p->lib.inputs, sizeof *x), y[8] = {0};
    for (size_t i = 0; i < p->lib.inputs; i += 1 + p->lib.inputs / 7) {
        lg_rng rng;
        lg_rng_seed(&rng, 1, i);
        draw_window(p, &rng, x);
        x[i] = NAN;
        export_eval(&p->lib, x, y);
        double mine[8];
        lg_model_eval(p->file.model, x, mine, p->work);
        for (size_t o = 0; o < p->lib.outputs; o++) assert_true(isnan(y[o]) == isnan(mine[o]));
    }
    free(x);
}

static void same_numbers(const char *dtype) {
    for (size_t s = 0; s < SAMPLES; s++) {
        pair p;
        char title[96], folder[64];
        open_pair(&p, &samples[s], dtype);
        (void)snprintf(title, sizeof title, "%s %s", samples[s].folder, dtype);
        (void)snprintf(folder, sizeof folder, "%s-%s", samples[s].folder, dtype);
        export_compare(&p.lib, title, ROWS, draw_window, reference, &p);
        check_classes(&p);
        check_names(&p);
        check_nan(&p);
        check_small_work(&p, folder);
        close_pair(&p);
    }
}

static void in_double(void **state) {
    (void)state;
    same_numbers("f64");
}

static void in_float(void **state) {
    (void)state;
    same_numbers("f32");
}

static void expect_words(const char *path, const char *const *words, size_t count) {
    static char text[CLI_TEXT];
    assert_true(cli_read(path, text, sizeof text) > 0);
    for (size_t i = 0; i < count; i++)
        if (strstr(text, words[i]) == NULL) fail_msg("%s does not say '%s'", path, words[i]);
}

static void documented(void **state) {
    (void)state;
    char folder[64];
    detector_export(&samples[0], "f32", folder, sizeof folder);
    static const char *const header[] = {"#define m_CHANNELS 3",
                                         "#define m_LENGTH 40",
                                         "#define m_CLASSES 2",
                                         "#define m_RATE 12.5",
                                         "x[channel * 40 + sample]",
                                         "logit",
                                         "0.9375",
                                         "aaaaaaaa",
                                         "channel 2",
                                         "units",
                                         "scaling",
                                         "m_classify"};
    expect_words("average-f32/m.h", header, LG_COUNT(header));
    static const char *const weights[] = {"/* theta from 0 on */", "/* mean */", "/* inverse_scale */"};
    expect_words("average-f32/m_weights.c", weights, LG_COUNT(weights));
    /* offsets of 10 at scales from 0.01 on: the rounding of the mean to float is given beside it */
    assert_close(export_constant("average-f32", "m", "DEPTH"), 6, 0, 0);
}

static void builds(void **state) {
    (void)state;
    char folder[64];
    detector_export(&samples[3], "f32", folder, sizeof folder);
    export_check_ways(folder, "m");
    export_check_objects(folder, "m");
    detector_export(&samples[0], "f64", folder, sizeof folder);
    export_check_objects(folder, "m");
}

/* A default network: the stack, with the flags of the Makefile too. */
static void default_size(void **state) {
    (void)state;
    char folder[64];
    const sample of = detector_default("default", 4, 64, 3, false);
    detector_export(&of, "f64", folder, sizeof folder);
    export_expect("make -C default-f64 test stack");
    export_check_stack(folder);
}

/* A logit that is a small difference of large terms: the tolerance says so, and self-tests pass whatever the
 * seed. */
static void small_logit(void **state) {
    (void)state;
    static const char *const dtypes[] = {"f64", "f32"};
    sample of = detector_default("small", 2, 64, 2, false);
    of.net.activation = LG_SIGMOID;
    detector_save(&of);
    detector_change(&of, 1, -detector_mean(&of));
    for (int seed = 0; seed < 12; seed++) {
        char folder[64], command[128];
        detector_export_saved(&of, dtypes[seed % 2], seed, folder, sizeof folder);
        (void)snprintf(command, sizeof command, "make -C %s test CFLAGS=-O1", folder);
        export_expect(command);
        const double eps = seed % 2 == 0 ? DBL_EPSILON : (double)FLT_EPSILON;
        const double usual = 20 * eps * export_constant(folder, "m", "DEPTH");
        const double factor = export_constant(folder, "m", "TOLERANCE") / usual;
        if (!(factor > 5 && factor < 500)) fail_msg("factor %g", factor);
    }
    export_expect("grep -q 'contains the factor' small-f32/m.h");
}

/* Finite values whose norm is not: the self-test could not tell an error. */
static void large_numbers(void **state) {
    (void)state;
    static cli result;
    const sample of = detector_default("huge", 2, 64, 2, false);
    detector_save(&of);
    detector_change(&of, 2, 1e200);
    cli_expect("lg-export", "huge.h5 --out huge", 3, "huge.h5: gives numbers", &result);
    cli_expect("lg-export", "huge.h5 --out huge --dtype f32", 3, "huge.h5: holds numbers", &result);
    assert_false(cli_exists("huge"));
}

static void damaged_file(void **state) {
    (void)state;
    static cli result;
    detector_save(&samples[0]);
    export_expect("head -c 3000 average.h5 > half.h5");
    cli_expect("lg-export", "half.h5 --out half", 3, "half.h5", &result);
    assert_false(cli_exists("half"));
}

static int setup(void **state) {
    (void)state;
    return export_begin();
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(in_double),     cmocka_unit_test(in_float),     cmocka_unit_test(documented),
        cmocka_unit_test(builds),        cmocka_unit_test(default_size), cmocka_unit_test(small_logit),
        cmocka_unit_test(large_numbers), cmocka_unit_test(damaged_file),
    };
    return cmocka_run_group_tests(tests, setup, export_end);
}
